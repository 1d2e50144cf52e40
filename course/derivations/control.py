"""Claims of chapter 6: integral windup."""

import numpy as np

from course.derivations import Finding, Verdict, claim


def _recovery(controller: object, blocked: float) -> tuple[float, float]:
    """Overshoot [rad] and time to 2 % [s] of a joint that was blocked for a time [s]."""
    from course.drills import Joint, closed_loop

    dt, steps = 0.002, 6000
    jam = np.arange(steps) < round(blocked / dt)
    joint = Joint(inertia=0.05, damping=0.2, dt=dt, load=-0.3)
    angles, _ = closed_loop(controller, joint, np.ones(steps), jam)
    outside = np.flatnonzero(np.abs(angles - 1.0) > 0.02)
    settled = (outside[-1] + 1) * dt - blocked if outside.size else 0.0
    return float(np.max(angles) - 1.0), float(settled)


@claim(
    "integral_clamp",
    6,
    "Clamping the integral to a fixed range is anti-windup.",
    verdict=Verdict.CONDITIONAL,
    condition="the range is no wider than the command that the actuator can give, and no narrower "
    "than the load",
    corrected="A range of its own is a second limit beside the actuator's. Wide, it changes "
    "nothing: a joint blocked for 3 s overshoots as without it. Narrower than the load, it "
    "leaves an error that never goes. What stops windup at any setting is to stop integrating "
    "while the command is at its limit and the error pushes further.",
    figures={
        "overshoot_no_anti_windup_rad": (3.517, 0.001),
        "overshoot_wide_clamp_rad": (3.517, 0.001),
        "overshoot_conditional_rad": (0.0888, 0.002),
        "error_left_by_narrow_clamp_rad": (0.05, 0.01),
    },
    source="K. J. Astrom, T. Hagglund, Advanced PID Control, 2006, sec. 3.5",
)
def _integral_clamp() -> Finding:
    from course.drills import PID, Joint, closed_loop

    class Clamped(PID):
        """The same controller, its integral clamped to a range and integrated always."""

        bound = np.inf

        def update(self, setpoint: float, measurement: float) -> float:
            error = setpoint - measurement
            before = self.integral
            command = super().update(setpoint, measurement)
            free = before + self.ki * error * self.dt
            self.integral = min(max(free, -self.bound), self.bound)
            return command

    def settings() -> dict[str, float]:
        gains = {"kp": 4.0, "ki": 6.0, "kd": 0.5, "dt": 0.002}
        return gains | {"u_min": -2.0, "u_max": 2.0, "tau": 0.01}

    def clamped(bound: float) -> Clamped:
        controller = Clamped(**settings())
        controller.bound = bound
        return controller

    free, wide = _recovery(clamped(np.inf), 3.0), _recovery(clamped(20.0), 3.0)
    fitting = _recovery(clamped(2.0), 3.0)
    conditional = _recovery(PID(**settings()), 3.0)
    joint = Joint(inertia=0.05, damping=0.2, dt=0.002, load=-0.3)
    angles, _ = closed_loop(clamped(0.1), joint, np.ones(6000))
    left = float(1.0 - angles[-1])
    figures = {
        "overshoot_no_anti_windup_rad": free[0],
        "overshoot_wide_clamp_rad": wide[0],
        "overshoot_conditional_rad": conditional[0],
        "error_left_by_narrow_clamp_rad": left,
    }
    return Finding(
        figures,
        f"Overshoot after 3 s blocked: {free[0]:.2f} rad without anti-windup, {wide[0]:.2f} with a "
        f"wide clamp, {fitting[0]:.2f} with the actuator's range, {conditional[0]:.2f} with "
        f"conditional integration. A clamp below the load leaves {left:.3f} rad.",
        holds=wide[0] < 0.5 * free[0],
        holds_if=fitting[0] < 0.5 * free[0],
        corrected=conditional[0] < 0.2 * free[0] and left > 0.01,
    )
