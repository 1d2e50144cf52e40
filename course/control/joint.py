"""One joint with what real parts do to it, solved exactly between its events, and its loop.

inertia q'' = torque + load - damping q' - dry friction. The torque is a command that is limited,
limited in its rate, late by any time, and smoothed by a current loop of first order. Dry friction
is Coulomb's while the joint moves and holds up to the static value while it rests. Between two
events (a new command, a stop, a start) the joint is linear, so its state has a closed form and the
instant of the event is found, not stepped over.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, finite, invalid, positive, vector
from course.compiled import MATRIX, VECTOR, loop
from course.control.pid import Gains, update
from course.control.sampled import System, joint_system, split_delay

Array = NDArray[np.float64]

BAND, REST = 0.02, 0.1  # of `step_metrics`: a share of the step, and of the record


@dataclass(frozen=True)
class Joint:
    """The mechanical part.

    Attributes:
        inertia, damping: [kg m^2, N m s/rad].
        load: constant torque that acts beside the motor's [N m].
        coulomb: dry friction while it moves [N m].
        static: what it holds at rest [N m], at least `coulomb`; None for as much.
    """

    inertia: float
    damping: float = 0.0
    load: float = 0.0
    coulomb: float = 0.0
    static: float | None = None

    def __post_init__(self) -> None:
        positive("inertia", self.inertia, unit="kg m^2")
        finite("damping", self.damping, 0.0, unit="N m s/rad")
        finite("load", self.load, unit="N m")
        finite("coulomb", self.coulomb, 0.0, unit="N m")
        if self.static is not None:
            finite("static", self.static, self.coulomb, unit="N m")

    def system(self, lag: float = 0.0) -> System:
        """Return A and B of its linear part, see `course.control.sampled.joint_system`."""
        return joint_system(self.inertia, self.damping, lag=lag)


@dataclass(frozen=True)
class Actuator:
    """The motor and its drive.

    Attributes:
        limit: largest torque, both ways [N m].
        rate: largest change of what is sent to the drive [N m/s], applied once a sample.
        lag: time constant of the current loop [s].
        delay: from the measurement to the drive [s], any length.
    """

    limit: float = math.inf
    rate: float = math.inf
    lag: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        for name in ("limit", "rate"):
            if not getattr(self, name) > 0.0:
                raise invalid(name, getattr(self, name), "a positive number")
        finite("lag", self.lag, 0.0, unit="s")
        finite("delay", self.delay, 0.0, unit="s")


@dataclass(frozen=True)
class Encoder:
    """What is measured: the angle on a grid of 2^bits lines a turn, with white noise before that.

    Attributes:
        bits: 0 for an angle without a grid.
        noise: standard deviation [rad].
        seed: of the noise.
    """

    bits: int = 0
    noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        count("bits", self.bits, 0, 40)
        finite("noise", self.noise, 0.0, unit="rad")
        count("seed", self.seed)

    @property
    def line(self) -> float:
        """The distance of two lines [rad]; 0 without a grid."""
        return 2.0 * math.pi / 2**self.bits if self.bits else 0.0


@dataclass(frozen=True)
class Record:
    """What a run left, one joint or several along axis 0.

    Attributes:
        times: shape (n + 1,) [s].
        q, v: angle and speed at these times, shapes (..., n + 1) [rad, rad/s].
        torque: of the motor at these times, shape (..., n + 1) [N m].
        command: what was sent at the first n of them, shape (..., n) [N m].
        measured: the angle that the law saw, shape (..., n) [rad].
        setpoint: desired angles, shape (..., n) [rad].
    """

    times: Array
    q: Array
    v: Array
    torque: Array
    command: Array
    measured: Array
    setpoint: Array

    @property
    def diverged(self) -> bool:
        """Whether the loop was unstable beyond the largest float: angles are infinite or NaN."""
        return not bool(np.isfinite(self.q).all() and np.isfinite(self.v).all())


# --- between two events ---------------------------------------------------------------------------


@register_jitable
def _first(x, t):
    """Return (1 - e^(-x t)) / x, also where x t is small."""
    # Series for small arguments: the closed form would divide rounding by a small number.
    y = x * t
    if abs(y) < 1e-5:
        return t * (1.0 - y / 2.0 + y * y / 6.0)
    return -math.expm1(-y) / x


@register_jitable
def _responses(a, c, t):
    """Return what a time t does.

    Decay and integrals of the joint's rate a and the current loop's c.

    Speed by itself, by a steady torque, by the fading part of the torque; place likewise; and how
    much of that part is left.
    """
    decay, once = math.exp(-a * t), _first(a, t)
    y = a * t
    # Double integral of the decay; a Taylor series where t - once would cancel.
    if y < 1e-3:
        twice = t * t * (0.5 - y / 6.0 + y * y / 24.0 - y**3 / 120.0)
    else:
        twice = (t - once) / a
    # Without a lag the torque has no fading part.
    if c == math.inf:
        return decay, once, twice, 0.0, 0.0, 0.0
    # (e^(-low t) - e^(-high t)) / (high - low), in a form that stays finite where both rates agree.
    low, high = min(a, c), max(a, c)
    fading = math.exp(-low * t) * _first(high - low, t)
    # The integral of `fading` over time; again a Taylor series where the difference would cancel.
    if high * t < 1e-3:
        square = a * a + a * c + c * c
        drift = t * t * (0.5 - (a + c) * t / 6.0 + square * t * t / 24.0)
    else:
        drift = (_first(low, t) - fading) / high
    return decay, once, twice, fading, drift, math.exp(-c * t)


@register_jitable
def _speed(v, steady, fading, a, c, t):
    """Return the speed after a time, by a steady and a fading acceleration."""
    r = _responses(a, c, t)
    return r[0] * v + r[1] * steady + r[3] * fading


@register_jitable
def _stop(v, steady, fading, side, a, c, t):
    """Return when a speed of the given sign (1 or -1) first reaches 0 within t.

    It returns t + 1 if the speed does not.
    """
    turn = -1.0  # the speed has one turn at most, where its acceleration is 0
    # The turn is where the acceleration, -a v + steady + fading e^(-c t), vanishes: in closed form.
    if c < math.inf and fading != 0.0:
        ratio = (1.0 + (steady - a * v) / fading) / c
        if a == c:
            turn = ratio
        elif (a - c) * ratio > -1.0:
            turn = math.log1p((a - c) * ratio) / (a - c)
    # The speed is monotone before and after that one turn, so bisection brackets the first zero.
    before, after = 0.0, t
    if 0.0 < turn < t:
        if side * _speed(v, steady, fading, a, c, turn) < 0.0:
            after = turn
        else:
            before = turn
    if side * _speed(v, steady, fading, a, c, after) >= 0.0:
        return t + 1.0
    for _ in range(60):
        middle = 0.5 * (before + after)
        if side * _speed(v, steady, fading, a, c, middle) < 0.0:
            after = middle
        else:
            before = middle
    return after


@register_jitable
def _advance(q, v, u, inertia, a, load, coulomb, static, c, target, rest, whole):
    """Return (q, v, torque u) after `rest` seconds of one command, with dry friction.

    `whole` are the responses of all of `rest`, which most samples need and nothing else.
    """
    # Without a lag the torque is the command at once.
    if c == math.inf:
        u = target
    for _ in range(50):  # events; each is a stop or a start
        side = 1.0 if v > 0.0 else -1.0
        # Stiction: at rest the joint holds until the torque exceeds the static friction.
        if v == 0.0 and static > 0.0:
            side = math.copysign(1.0, u + load)
            if abs(u + load) <= static:
                wait, side = rest, math.copysign(1.0, target + load)
                if abs(target + load) > static:  # it starts where the torque passes the friction
                    edge = side * static - load
                    wait = min(rest, math.log((target - u) / (target - edge)) / c)
                # While the joint is stuck only the torque moves on, towards the command.
                u = target + (u - target) * math.exp(-c * wait) if c < math.inf else target
                rest -= wait
                if rest <= 0.0:
                    return q, v, u
            # The wait has shortened the time that is left.
            whole = _responses(a, c, rest)
        # Sliding: constant Coulomb friction, so the motion has a closed form up to the next stop.
        steady = (target + load - side * coulomb) / inertia
        fading = (u - target) / inertia
        # Without dry friction a change of direction is no event: the linear solution runs through
        # it.
        stop = _stop(v, steady, fading, side, a, c, rest) if static > 0.0 else rest + 1.0
        ends = stop > rest
        r = whole if ends else _responses(a, c, stop)
        q += r[1] * v + r[2] * steady + r[4] * fading
        # After a stop the speed is exactly 0, which the test for stiction above relies on.
        v = r[0] * v + r[1] * steady + r[3] * fading if ends else 0.0
        u = target + r[5] * (u - target)
        if ends:
            break
        rest -= stop
    return q, v, u


def _run(joint, drive, numbers, start, setpoint, extra, blocked, noise, out):
    """Run the loop; rows of `out` are q, v, torque, command and measurement.

    `joint` is (inertia, damping, load, coulomb, static), `drive` (limit, rate, 1 / lag, whole
    samples of delay, the rest of one, encoder line).
    """
    dt, limit, rate, c, line = numbers[3], drive[0], drive[1] * numbers[3], drive[2], drive[5]
    whole, part = int(drive[3]), drive[4]
    a = joint[1] / joint[0]
    # The two parts of a sample always have the same lengths: compute their responses once.
    early, late = _responses(a, c, part), _responses(a, c, dt - part)
    memory = np.zeros(5)
    q, v, u = start[0], start[1], start[2]
    sent = u
    for k in range(setpoint.size + 1):
        out[0, k], out[1, k], out[2, k] = q, v, u
        if k == setpoint.size:
            break
        # The encoder rounds to its nearest line.
        observed = q + noise[k]
        if line > 0.0:
            observed = line * math.floor(observed / line + 0.5)
        desired = update(numbers, memory, setpoint[k], observed, v)
        # Saturation, then the slew limit of the drive.
        desired = min(max(desired, -limit), limit)
        sent = min(max(desired, sent - rate), sent + rate)
        out[3, k], out[4, k] = sent, observed
        load = joint[2] + extra[k]
        # A delay within the sample splits it: the old command acts first, then the new one.
        for half in range(2):
            length = part if half == 0 else dt - part
            if length <= 0.0:
                continue
            at = k - whole - 1 + half
            command = out[3, at] if at >= 0 else start[2]
            # A jammed joint stands still, but its current loop goes on.
            if blocked[k]:
                v = 0.0
                u = command + (u - command) * math.exp(-c * length) if c < math.inf else command
            else:
                q, v, u = _advance(
                    q,
                    v,
                    u,
                    joint[0],
                    a,
                    load,
                    joint[3],
                    joint[4],
                    c,
                    command,
                    length,
                    early if half == 0 else late,
                )


_FLAGS = numba.types.Array(numba.boolean, 1, "C")
_run_loop = loop(
    _run,
    numba.void(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, _FLAGS, VECTOR, MATRIX),
)


def run_joint(
    joint: Joint,
    actuator: Actuator,
    encoder: Encoder,
    gains: Gains,
    setpoint: ArrayLike,
    dt: float,
    seconds: float,
    *,
    start: ArrayLike = (0.0, 0.0, 0.0),
    extra: ArrayLike = 0.0,
    blocked: ArrayLike = False,
) -> Record:
    """Run the joint under its controller, compiled: measure, command, wait, drive.

    Args:
        joint: inertia, friction and gravity of the joint.
        actuator: the motor with its limits and its lag.
        encoder: resolution and noise of the measured angle.
        gains: of the PID law.
        setpoint: one number, or one for each sample, shape (n,) [rad].
        dt: sample time [s].
        seconds: length of the run [s]; n = seconds / dt.
        start: (angle, speed, torque) [rad, rad/s, N m].
        extra: torque beside the motor's, a number or shape (n,) [N m]: a kick.
        blocked: whether the joint is jammed, for each sample or for all.

    Returns:
        The run; of a loop that diverges past the largest float it holds infinities and NaN, and
        `Record.diverged` says so.

    Raises:
        ValueError: for a number that is not finite or out of its range, and for a set-point that
            is longer or shorter than the run.
    """
    n = round(positive("seconds", seconds, unit="s") / positive("dt", dt, unit="s"))
    count("seconds / dt", n, 1)
    static = joint.coulomb if joint.static is None else joint.static
    parts = np.array([joint.inertia, joint.damping, joint.load, joint.coulomb, static], dtype=float)
    rest = 1.0 / actuator.lag if actuator.lag > 0.0 else math.inf
    delay = split_delay(actuator.delay, dt)
    drive = np.array([actuator.limit, actuator.rate, rest, *delay, encoder.line], dtype=float)
    desired = np.full(n, 1.0) * vector("setpoint", setpoint, (), (n,), unit="rad")
    kick = np.full(n, 1.0) * vector("extra", extra, (), (n,), unit="N m")
    jam = np.full(n, 1.0) * vector("blocked", blocked, (), (n,)) != 0.0
    noise = np.zeros(n)
    if encoder.noise > 0.0:
        noise = encoder.noise * np.random.default_rng(encoder.seed).standard_normal(n)
    x = vector("start", start, (3,))
    out = np.zeros((5, n + 1))
    _run_loop(parts, drive, gains.numbers(dt), x, desired, kick, jam, noise, out)
    return Record(
        np.linspace(0.0, n * dt, n + 1), out[0], out[1], out[2], out[3, :n], out[4, :n], desired
    )


# --- what a step shows ----------------------------------------------------------------------------


@dataclass(frozen=True)
class StepMetrics:
    """The three numbers of a step response.

    Attributes:
        overshoot: how far past the target, as a share of the step.
        settling: from when on it stays within the band [s]; infinity if it is not settled.
        error: what is left at the end, the mean of the last twentieth against the target [rad].
    """

    overshoot: float
    settling: float
    error: float


def step_metrics(
    times: ArrayLike, q: ArrayLike, target: float, *, band: float = BAND, rest: float = REST
) -> StepMetrics:
    """Return overshoot, settling and steady error of a step from q[0] to the target.

    Args:
        times: when each angle was measured, increasing, shape (n,) with n at least 1 [s].
        q: the angles, shape (n,) [rad].
        target: [rad], not q[0].
        band: settled within this share of the step.
        rest: share of the record that must lie in the band at the end, before it counts.
    """
    when, angle = vector("times", times, (None,)), np.asarray(q, dtype=float)
    if angle.shape != when.shape:
        raise invalid("q.shape", angle.shape, f"that of times, {when.shape}")
    if when.size == 0:
        raise invalid("times", times, "at least one sample")
    if not (np.diff(when) > 0.0).all():
        first = int(np.argmax(~(np.diff(when) > 0.0))) + 1
        raise invalid(f"times[{first}]", when[first], f"later than times[{first - 1}]")
    step = finite("target", target) - float(angle[0])
    if step == 0.0:
        raise invalid("target", target, "an angle that is not the first one")
    finite("band", band, POSITIVE, 1.0)
    finite("rest", rest, 0.0, 1.0)
    return StepMetrics(*map(float, _metrics(when, angle, target, band, rest)))


@register_jitable
def _metrics(when, angle, target, band, rest):
    """Return the three of `StepMetrics`."""
    # The response in units of the step; the last sample outside the band ends the settling.
    done = (angle - angle[0]) / (target - angle[0])
    # Written as a negation, so that a NaN counts as outside the band.
    out = np.flatnonzero(~(np.abs(done - 1.0) <= band))
    last = out[-1] + 1 if out.size else 0
    # A record that ends too soon after the response has entered the band proves nothing.
    settled = last <= (1.0 - rest) * when.size
    return (
        max(0.0, np.max(done) - 1.0) if np.all(np.isfinite(done)) else math.inf,
        when[last] - when[0] if settled else math.inf,
        target - np.mean(angle[-max(1, when.size // 20) :]),
    )
