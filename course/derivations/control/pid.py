"""Claims of chapter 6: integral windup."""

import numpy as np

from course.derivations import claim


@claim(
    "Limiting the I term to a fixed range prevents windup.",
    "Such a range is a second limit, independent of the motor's. A wide one changes nothing: "
    "after a jam of {blocked_s:.0f} s the joint overshoots by {overshoot_wide_clamp_rad:.2f} "
    "rad, as without it. One as wide as the motor's range still unwinds slowly where ki is "
    "small: with kp {kp:.0f} and ki {ki:.0f} the overshoot is {slow_clamped_rad:.2f} rad "
    "with it, {slow_free_rad:.2f} without, and none with conditional integration. One "
    "narrower than the load leaves an error for ever: {error_left_by_narrow_clamp_rad:.2f} "
    "rad. Conditional integration needs no range, and a jam that keeps the command at its "
    "limit adds nothing to the integral. A jam with the command below its limit still winds "
    "up, by {short_jam_rad:.2f} rad.",
    source="K. J. Astrom, T. Hagglund, Advanced PID Control, 2006, sec. 3.5",
)
def integral_clamp(result):
    from course.drills import PID, Joint, closed_loop

    class Clamped(PID):
        """The same controller, its integral clamped to a range and integrated always."""

        bound = np.inf

        def update(self, setpoint, measurement):
            before = self.integral
            command = super().update(setpoint, measurement)
            free = before + self.ki * (setpoint - measurement) * self.dt
            self.integral = min(max(free, -self.bound), self.bound)
            return command

    dt, steps = 0.002, 5000

    def run(bound=None, kp=4.0, ki=6.0, load=0.3, jam=3.0, target=1.0, kd=0.5):
        """Return (overshoot, error at the end) [rad] of a joint that is blocked first.

        Bound None is conditional integration.
        """
        gains = {"kp": kp, "ki": ki, "kd": kd, "dt": dt, "u_min": -2.0, "u_max": 2.0, "tau": 0.01}
        controller = PID(**gains) if bound is None else Clamped(**gains)
        if isinstance(controller, Clamped):
            controller.bound = bound
        joint = Joint(inertia=0.05, damping=0.2, dt=dt, load=-load)
        blocked = np.arange(steps) < round(jam / dt)
        angles, _ = closed_loop(controller, joint, np.full(steps, target), blocked)
        return np.max(angles) - target, target - angles[-1]

    jam = result.input("blocked_s", 3)
    kp, ki = result.input("kp", 4), result.input("ki", 1)
    free = result.measure("overshoot_no_anti_windup_rad", run(np.inf, jam=jam)[0], 1e-3)
    wide = result.measure("overshoot_wide_clamp_rad", run(20.0, jam=jam)[0], 1e-3)
    conditional = result.measure("overshoot_conditional_rad", run(jam=jam)[0], 2e-3)
    remaining = result.measure("error_left_by_narrow_clamp_rad", run(0.1, jam=0)[1], 0.01)
    slow_free = result.measure("slow_free_rad", run(np.inf, kp, ki)[0], 1e-3)
    slow_clamped = result.measure("slow_clamped_rad", run(2.0, kp, ki)[0], 1e-3)
    short = result.measure("short_jam_rad", run(target=0.3)[0] - run(target=0.3, jam=0)[0], 0.01)
    fitting = run(2.0, jam=jam)[0]
    result.statement = (
        f"Overshoot after 3 s blocked: {free:.2f} rad without anti-windup, {wide:.2f} with a wide "
        f"clamp, {fitting:.2f} with the actuator's range, {conditional:.2f} with conditional "
        f"integration. A clamp below the load leaves {remaining:.3f} rad."
    )

    def drawn():
        """Return gains, load and time of a jam, with the setpoint far enough to hold the limit."""
        low, high = (3, 1, 0.2, 1, 0.5), (9, 8, 1.2, 4, 1.0)
        values = result.rng.uniform(low, high)
        return dict(zip(("kp", "ki", "load", "jam", "kd"), values, strict=True))

    def cured(share):
        """Return whether a clamp at a share of the load adds no overshoot, and leaves no error."""
        case = drawn()
        bound = share * case["load"]
        overshoot, remaining = run(bound, **case)
        return overshoot - max(run(bound, **case | {"jam": 0})[0], 0.0) < 0.05 and remaining < 0.02

    result.statement_holds(
        wide < 0.5 * free and slow_clamped < 0.5 * slow_free,
        only_if="the range is just what the load needs, a few hundredths above it, and the load "
        "is known and constant",
        inside=[cured(share) for share in result.rng.uniform(1.0, 1.04, 8)],
        outside=[cured(share) for share in (0.7, 0.8, 0.9, 2, 3, 4, 5, 6)],
    )
    cases = [drawn() for _ in range(8)]
    added = [run(**case)[0] - max(run(**case | {"jam": 0})[0], 0.0) for case in cases]
    result.correction_holds(
        abs(wide - free) < 1e-9,
        conditional < 0.2 * free,
        remaining > 0.01,
        slow_clamped > 0.5 * slow_free,
        run(None, kp, ki)[0] < 0,
        max(added) < 0.01,
        short > 0.05,
    )
