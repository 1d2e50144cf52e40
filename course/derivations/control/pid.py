"""Claims of chapter 6: integral windup, and angles that wrap."""

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
    "rad. One that is symmetric about zero also winds up where the set-point is on the side to "
    "which the load pulls. Conditional integration needs no range, and a jam that keeps the "
    "command at its limit adds nothing to the integral. A jam with the command below its limit "
    "still winds up, by {short_jam_rad:.2f} rad.",
    source="K. J. Astrom, T. Hagglund, Advanced PID Control, 2006, sec. 3.5",
)
def integral_clamp(result):
    from course.control import PID, ExactJoint, closed_loop

    class Clamped(PID):
        """The same controller, its integral clamped to a range and integrated always."""

        bound = floor = np.inf

        def update(self, setpoint, measurement):
            before = self.integral
            command = super().update(setpoint, measurement)
            free = before + self.ki * (setpoint - measurement) * self.dt
            self.integral = min(max(free, -self.floor), self.bound)
            return command

    dt, steps = 0.002, 5000
    ki_jam = result.input("ki_jam", 6.0)
    inertia, friction = result.input("inertia", 0.05), result.input("friction", 0.2)
    push, damping_gain = result.input("load_n_m", 0.3), result.input("kd", 0.5)

    def run(
        bound=None, kp=4.0, ki=ki_jam, load=push, jam=3.0, target=1.0, kd=damping_gain, floor=None
    ):
        """Return (overshoot, error at the end) [rad] of a joint that is blocked first.

        Bound None is conditional integration. The range is from -floor, or -bound, to the bound.
        """
        gains = {"kp": kp, "ki": ki, "kd": kd, "dt": dt, "u_min": -2.0, "u_max": 2.0, "tau": 0.01}
        controller = PID(**gains)
        if bound is not None:
            controller = Clamped(**gains)
            controller.bound, controller.floor = bound, bound if floor is None else floor
        joint = ExactJoint(inertia=inertia, damping=friction, dt=dt, load=-load)
        blocked = np.arange(steps) < round(jam / dt)
        angles, _ = closed_loop(controller, joint, np.full(steps, target), blocked)
        side = np.sign(target)
        return np.max(side * angles) - abs(target), side * (target - angles[-1])

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

    def cured(share, floor=0.0, **changed):
        """Return whether a clamp at a share of the load adds no overshoot, and leaves no error."""
        case = drawn() | {"floor": floor} | changed
        bound = share * case["load"]
        overshoot, remaining = run(bound, **case)
        return overshoot - max(run(bound, **case | {"jam": 0})[0], 0.0) < 0.05 and remaining < 0.02

    inside = [cured(share) for share in result.rng.uniform(1.0, 1.04, 8)]
    outside = [cured(share) for share in (0.7, 0.8, 0.9, 2, 3, 4, 5, 6)]
    cases = [drawn() for _ in range(8)]
    # Chosen to break it: set-points near the start, also on the side to which the load pulls. There
    # a range that is symmetric about zero lets the I term wind up to the other side.
    inside += [cured(1.03, target=x, ki=4.0) for x in (0.05, -0.1, -1.0)]
    pulled = {"target": -0.1, "ki": 4.0, "jam": 4.0}
    symmetric = [cured(1.03, None, kp=x, load=0.15 * x, **pulled) for x in (4.0, 8.0)]
    result.statement_holds(
        wide < 0.5 * free and slow_clamped < 0.5 * slow_free,
        only_if="the range is from zero to a few per cent above what the load needs, and the load "
        "is known and constant",
        inside=inside,
        outside=outside + symmetric,
    )
    added = [run(**case)[0] - max(run(**case | {"jam": 0})[0], 0.0) for case in cases]
    result.correction_holds(
        abs(wide - free) < 1e-9,
        conditional < 0.2 * free,
        remaining > 0.01,
        slow_clamped > 0.5 * slow_free,
        run(None, kp, ki)[0] < 0,
        max(added) < 0.01,
        short > 0.05,
        not any(symmetric),
    )


def _wrap(angle):
    """Return an angle, or an array of them, in [-pi, pi] [rad]."""
    return np.arctan2(np.sin(angle), np.cos(angle))


def _turn(reference, angle, *, wrapped, noise=None, stop=np.inf, kd=8.0):
    """Return the angle of a continuous joint under PD control, counted over turns, shape (n,).

    Args:
        reference: desired angle [rad].
        angle: of the joint at the start [rad].
        wrapped: whether the law wraps its error; the encoder always reports one turn.
        noise: of each measurement, shape (n - 1,) [rad]; None for 3 s without.
        stop: where hard stops end the motion on both sides [rad].
        kd: rate gain [N m s/rad]; 8 is more than critical damping.
    """
    from course.control.joint import Actuator, Encoder, Joint, run_joint
    from course.control.pid import Gains

    parts = Joint(0.5, 0.5), Actuator(), Encoder(), Gains(20.0, 0.0, kd, rate="exact")
    noise = np.zeros(1500) if noise is None else noise
    q, v, dt = np.full(noise.size + 1, float(angle)), 0.0, 2e-3
    for k, wrong in enumerate(noise):
        error = reference - _wrap(q[k] + wrong)
        error = _wrap(error) if wrapped else error
        # A PD law with the exact rate has no memory, so one sample at a time is the same loop.
        step = run_joint(*parts, q[k] + error, dt, dt, start=(q[k], v, 0.0))
        q[k + 1], v = step.q[-1], step.v[-1]
        if abs(q[k + 1]) > stop:
            q[k + 1], v = np.copysign(stop, q[k + 1]), 0.0
    return q


@claim(
    "The error of a continuous joint is reference minus angle.",
    "That is right only while the difference is less than half a turn. With a reference of "
    "{reference_deg:.0f} degrees and an angle of -{reference_deg:.0f} degrees the plain difference "
    "is {plain_error_deg:.0f} degrees, and the joint turns by {plain_travel_deg:.0f} degrees. The "
    "wrapped error atan2(sin e, cos e) is -{wrapped_error_deg:.0f} degrees, and the joint turns by "
    "{wrapped_travel_deg:.0f}. Half a turn apart, noise or rounding chooses the direction: with "
    "{noise_deg:g} degrees of noise {forwards:.0f} of {runs:.0f} runs turn forwards. A joint with "
    "stops must not wrap its error. With stops at {stop_deg:.0f} degrees on both sides, the "
    "wrapped error from -{far_deg:.0f} to {far_deg:.0f} degrees pushes the joint against the wrong "
    "stop, {left_deg:.0f} degrees from its reference. Compute the rate from the unwrapped angle or "
    "from the wrapped difference of two samples: with samples of {dt_ms:.0f} ms the plain "
    "difference jumps to {spike:.0f} rad/s at the end of a turn, about 2 pi / dt.",
    source="K. M. Lynch, F. C. Park, Modern Robotics, 2017, sec. 2.3 (configuration spaces)",
)
def angle_error_wraps(result):
    degrees = np.pi / 180.0
    at = result.input("reference_deg", 179.0) * degrees
    plain, short = (_turn(at, -at, wrapped=wrapped) for wrapped in (False, True))
    error = result.measure("plain_error_deg", 2.0 * at / degrees, 1e-9)
    least = result.measure("wrapped_error_deg", abs(_wrap(2.0 * at)) / degrees, 1e-6)
    long = result.measure("plain_travel_deg", np.abs(np.diff(plain)).sum() / degrees, 1e-2)
    travel = result.measure("wrapped_travel_deg", np.abs(np.diff(short)).sum() / degrees, 1e-2)

    # Opposite angles: every measurement is noisy, and the reference is half a turn away.
    noise, runs = result.input("noise_deg", 0.1) * degrees, result.input("runs", 20)
    ends = [
        _turn(np.pi / 2, -np.pi / 2, wrapped=True, noise=noise * result.rng.standard_normal(1500))[
            -1
        ]
        for _ in range(runs)
    ]
    forwards = result.measure("forwards", np.sum(np.array(ends) > -np.pi / 2), 1e-6)

    stop = result.input("stop_deg", 170.0) * degrees
    far = result.input("far_deg", 160.0) * degrees
    jammed = _turn(far, -far, wrapped=True, stop=stop)
    free = _turn(far, -far, wrapped=False, stop=stop)
    result.measure("left_deg", (far - jammed[-1]) / degrees, 1e-3)

    # What a derivative of the encoder sees in the short motion through the seam.
    dt = 1e-3 * result.input("dt_ms", 2.0)
    jumps = np.diff(_wrap(short))
    spike = result.measure("spike", np.abs(jumps).max() / dt, 1e-3)
    true = np.abs(np.diff(short)).max() / dt
    # With less damping the plain error sees a joint that overshoots the seam a whole turn away.
    again = _turn(at, at - 1.0, wrapped=False, kd=1.0)
    calm = _turn(at, at - 1.0, wrapped=True, kd=1.0)
    result.statement = (
        f"From -179 to 179 degrees the joint turns {long:.1f} degrees with the plain error and "
        f"{travel:.2f} with the wrapped one; {forwards:.0f} of {runs} noisy runs from the opposite "
        f"side turn forwards."
    )

    def shortest(gap):
        """Return whether the plain error takes the short way over a difference [rad]."""
        low, high = max(-np.pi, -np.pi - gap), min(np.pi, np.pi - gap)
        angle = result.rng.uniform(low, high)
        moved = _turn(angle + gap, angle, wrapped=False)
        return abs(np.abs(np.diff(moved)).sum() - abs(_wrap(gap))) < 0.05

    def swinging(reference, gap):
        """Return the largest plain difference of a lightly damped joint, and if wrapping alters it.

        The difference is that of the wrapped law, which always takes the short direction.
        """
        wrapped, plain = (
            _turn(reference, reference - gap, wrapped=x, kd=1.0) for x in (True, False)
        )
        return np.abs(reference - _wrap(wrapped)).max(), np.allclose(wrapped, plain, atol=1e-9)

    signs = np.resize([1.0, -1.0], 8)
    within = [shortest(gap) for gap in signs * result.rng.uniform(0.1, np.pi - 0.01, 8)]
    across = [shortest(gap) for gap in signs * result.rng.uniform(1.02, 1.3, 8) * np.pi]
    # Chosen to break it: joints that overshoot, up to just before the seam of the encoder or across
    # it.
    swings = [swinging(x, gap) for x, gap in ((2.2, 1.0), (-2.2, -1.0), (2.9, 1.0), (-0.1, 3.0))]
    result.statement_holds(
        long < 2.0 * travel,
        only_if="the difference stays below half a turn during the whole motion, overshoot "
        "included",
        inside=within + [same for largest, same in swings if largest < np.pi],
        outside=across + [same for largest, same in swings if not largest < np.pi],
    )
    result.correction_holds(
        abs(long - error) < 1.0,
        abs(travel - least) < 0.05,
        0 < forwards < runs,
        # Rounding alone: two references that are the same angle go opposite directions.
        _wrap(np.pi) > 0 > _wrap(-np.pi),
        jammed[-1] == -stop,
        abs(free[-1] - far) < 0.01,
        abs(spike - 2.0 * np.pi / dt) < 1.01 * true,
        np.abs(_wrap(jumps)).max() / dt < 1.001 * true,
        abs(again[-1] - at) > np.pi,
        abs(_wrap(calm[-1] - at)) < 0.3 and np.ptp(calm) < 2.0,
    )
