"""A sampled loop as a matrix: what holding, waiting and estimating cost, before anything is tuned.

A plant x' = A x + B u is solved exactly from sample to sample while the command is held and comes
late by any time; `stepped` gives the same for a simulator's own steps instead. A law is a small
linear system that maps the measurement (q, v) to a command. Both together are one matrix, whose
largest eigenvalue is the growth per sample (Astrom and Wittenmark, Computer-Controlled Systems,
1997, ch. 2, 3). The last part holds the limits that have a closed form.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, one_of, positive, vector
from course.compiled import MATRIX, VECTOR, loop

Array = NDArray[np.float64]
System = tuple[Array, Array]

RATES = ("filtered", "observer", "exact")
_FILTERED, _OBSERVER, _EXACT = range(3)
STABLE = 1.0 + 1e-9  # a growth up to here is 1 but for rounding


# --- the plant between samples --------------------------------------------------------------------


def joint_system(
    inertia: float, damping: float = 0.0, stiffness: float = 0.0, lag: float = 0.0
) -> System:
    """Return inertia q'' + damping q' + stiffness q = torque as x' = A x + B u with x = (q, v).

    Args:
        inertia: [kg m^2], or a mass [kg].
        damping: [N m s/rad], or [N s/m].
        stiffness: [N m/rad], or [N/m].
        lag: time constant of the current loop [s]; above 0 the torque is a third state.

    Returns:
        A, shape (n, n), and B, shape (n,), with n = 2, or 3 with a lag.
    """
    positive("inertia", inertia)
    finite("damping", damping, 0.0)
    finite("stiffness", stiffness, 0.0)
    pull = [-stiffness / inertia, -damping / inertia]
    if finite("lag", lag, 0.0, unit="s") == 0.0:
        return np.array([[0.0, 1.0], pull]), np.array([0.0, 1.0 / inertia])
    A = np.array([[0.0, 1.0, 0.0], [*pull, 1.0 / inertia], [0.0, 0.0, -1.0 / lag]])
    return A, np.array([0.0, 0.0, 1.0 / lag])


@dataclass(frozen=True)
class Held:
    """x[k+1] = transition x[k] + now u[k - whole] + before u[k - whole - 1].

    Attributes:
        transition, now, before: shapes (n, n), (n,) and (n,).
        whole: samples that the command waits.
        dt: sample time [s].
    """

    transition: Array
    now: Array
    before: Array
    whole: int
    dt: float


def _driven(A: Array, B: Array, seconds: float) -> System:
    """Return the state's transition over a time, and what a command held meanwhile adds."""
    from scipy.linalg import expm

    # Van Loan (1978): the exponential of the block matrix holds both the transition and its
    # integral.
    n = B.size
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = A * seconds, B * seconds
    full = expm(block)
    return full[:n, :n], full[:n, n]


def held(A: ArrayLike, B: ArrayLike, dt: float, delay: float = 0.0) -> Held:
    """Return a plant behind a zero-order hold whose command comes late, exactly.

    Args:
        A: matrix of x' = A x + B u, shape (n, n).
        B: its input vector, shape (n,).
        dt: sample time [s].
        delay: of the command [s], any length; within a sample it switches once.

    Raises:
        ValueError: for shapes that do not fit, dt that is not positive, a negative delay.
    """
    A = vector("A", A, (len(np.atleast_1d(A)),) * 2)
    B = vector("B", B, (A.shape[0],))
    # A delay is whole samples and a part; within a sample the command switches once.
    whole, rest = split_delay(delay, dt)
    first, late = _driven(A, B, rest)
    second, now = _driven(A, B, dt - rest)
    return Held(second @ first, now, second @ late, whole, dt)


def split_delay(delay: float, dt: float) -> tuple[int, float]:
    """Return a delay as whole samples and the rest of one [s]."""
    positive("dt", dt, unit="s")
    # The offset keeps rounding from turning a whole number of samples into one less and a rest of
    # almost a sample.
    whole = math.floor(finite("delay", delay, 0.0, unit="s") / dt + 1e-9)
    return whole, max(0.0, delay - whole * dt)


def stepped(
    inertia: float, damping: float, dt: float, steps: int, delay: float = 0.0, stiffness: float = 0
) -> Held:
    """Return the joint as semi-implicit Euler moves it, with `steps` steps a sample.

    Damping is taken implicitly and the spring explicitly, as in MuJoCo's Euler and implicitfast
    (its documentation, Computation, Numerical integration). The delay is rounded to a step.
    """
    h = positive("dt", dt, unit="s") / count("steps", steps, 1)
    # Semi-implicit Euler: v' = slow (v + h (u - stiffness q) / inertia), then q' = q + h v'.
    slow = 1.0 / (1.0 + h * finite("damping", damping, 0.0) / positive("inertia", inertia))
    pull = -h * finite("stiffness", stiffness, 0.0) / inertia * slow
    one = np.array([[1.0 + h * pull, h * slow], [pull, slow]])
    kick = h / inertia * slow * np.array([h, 1.0])
    whole, rest = split_delay(delay, dt)
    late = round(rest / h)
    transition, added = np.eye(2), [np.zeros(2), np.zeros(2)]
    for i in range(steps):
        # The first `late` steps of a sample still apply the older command.
        old = i < late
        transition = one @ transition
        added = [one @ a for a in added]
        added[old] = added[old] + kick
    return Held(transition, added[0], added[1], whole, dt)


# --- laws -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Law:
    """c[k+1] = A c[k] + B y[k], u[k] = C c[k] + D y[k], with y = (q, v) and the set-point 0.

    Attributes:
        A, B, C, D: shapes (m, m), (m, 2), (m,) and (2,).
        dt: sample time that its numbers were made for [s]; 0 for a law that is the same at any.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    dt: float = 0.0

    def matrices(self, plant: Held) -> tuple[Array, Array, Array, Array]:
        """Return A, B, C and D for the loop with a plant.

        Raises:
            ValueError: the law was made for another sample time than the plant was.
        """
        if self.dt and not math.isclose(self.dt, plant.dt, rel_tol=1e-9):
            raise invalid("dt of the law", self.dt, f"that of the plant, {plant.dt:g} s")
        return self.A, self.B, self.C, self.D


@register_jitable
def observer_gains(tau: float, dt: float) -> tuple[float, float]:
    """Return (alpha, beta) of the tracking observer with both poles at tau / (tau + dt).

    It predicts x + dt r, and corrects x by alpha and r by beta / dt times what it missed
    (Benedict and Bordner, 1962). tau = 0 is the plain difference.
    """
    pole = tau / (tau + dt)
    return 1.0 - pole**2, (1.0 - pole) ** 2


def pid_law(
    kp: float,
    ki: float = 0.0,
    kd: float = 0.0,
    *,
    dt: float,
    rate: str = "filtered",
    tau: float = 0.0,
) -> Law:
    """Return P, PD or PID around an estimate of the rate, as `course.control.pid` runs it.

    Args:
        kp: gain [u/y].
        ki: gain [u/(y s)].
        kd: gain [u s/y].
        dt: sample time [s].
        rate: "filtered", the backward difference behind a low-pass (a plain one with tau = 0);
            "observer", see `observer_gains`; "exact", v itself.
        tau: time constant of the low-pass or the observer [s].
    """
    one_of("rate", rate, RATES)
    finite("tau", tau, 0.0, unit="s")
    positive("dt", dt, unit="s")
    kp, ki, kd = (finite(n, gain) for n, gain in (("kp", kp), ("ki", ki), ("kd", kd)))
    A, B, C, D = _pid(kp, ki, kd, dt, RATES.index(rate), tau)
    return Law(A, B, C, D, dt)


@register_jitable
def _pid(kp, ki, kd, dt, rate, tau):
    """Return the four of `Law`, with the rate's number in RATES."""
    # The state is (integral, rate, last or predicted place); rows that nothing reads are cut.
    A, B = np.zeros((3, 3)), np.zeros((3, 2))
    rated, observed = np.zeros(3), np.zeros(2)  # the rate's estimate as rows of c and y
    # The integral of the error, which is -q because the set-point is 0.
    A[0, 0], B[0, 0] = 1.0, -ki * dt
    used = np.array([ki != 0.0, False, False])
    if rate == _FILTERED:
        # Backward difference behind a low-pass: (tau rate + q - last) / (tau + dt).
        rated[1], rated[2], observed[0] = tau / (tau + dt), -1.0 / (tau + dt), 1.0 / (tau + dt)
        A[1], B[1], B[2, 0] = rated, observed, 1.0
        used[1], used[2] = tau > 0.0 and kd != 0.0, kd != 0.0
    elif rate == _OBSERVER:
        # Alpha-beta filter: prediction and correction, multiplied out into rows.
        alpha, beta = observer_gains(tau, dt)
        rated[1], rated[2], observed[0] = 1.0 - beta, -beta / dt, beta / dt
        A[1], B[1] = rated, observed
        A[2, 1], A[2, 2], B[2, 0] = (1.0 - alpha) * dt, 1.0 - alpha, alpha
        used[1] = used[2] = kd != 0.0
    else:
        observed[1] = 1.0
    # The command uses the integral and the rate as they are after this sample's measurement.
    C, D = A[0] - kd * rated, B[0] - kd * observed
    D[0] -= kp
    # An integrator that nothing reads would add an eigenvalue of 1 to every loop.
    return A[used][:, used].copy(), B[used], C[used], D


# --- the loop -------------------------------------------------------------------------------------


def loop_matrix(plant: Held, law: Law) -> Array:
    """Return the matrix of the closed loop over one sample.

    Its state is x, the commands under way, newest first, and the law's own state.
    """
    return _closed(plant.transition, plant.now, plant.before, plant.whole, *law.matrices(plant))


@register_jitable
def _closed(transition, now, before, whole, A, B, C, D):
    """Return `loop_matrix` of the parts of plant and law."""
    # State: x, the commands under way, the law's state.
    n, waiting, m = now.size, whole + int(np.any(before != 0.0)), C.size
    F = np.zeros((n + waiting + m, n + waiting + m))
    F[:n, :n] = transition
    fed = np.zeros(n + waiting)  # how the command of this sample enters
    if waiting:
        fed[n] = 1.0
        # Commands move up the queue by one each sample.
        F[n + 1 : n + waiting, n : n + waiting - 1] = np.eye(waiting - 1)
        if whole:
            F[:n, n + whole - 1] += now
        if waiting > whole:
            F[:n, n + whole] += before
    if not whole:
        fed[:n] = now
    # The law reads q and v, which are the first two states of any plant here.
    F[: n + waiting, :2] += np.outer(fed, D)
    F[: n + waiting, n + waiting :] = np.outer(fed, C)
    F[n + waiting :, :2], F[n + waiting :, n + waiting :] = B, A
    return F


def growth(matrix: ArrayLike) -> float:
    """Return growth per sample in the long run: the largest modulus of an eigenvalue."""
    return float(np.max(np.abs(np.linalg.eigvals(vector("matrix", matrix, (None, None))))))


@register_jitable
def growth_by_squares(matrix):
    """Return the same to 1e-10 for compiled code, which has no LAPACK.

    Gelfand's formula, |F^n|^(1/n) with n = 2^44, which takes 44 squares of the matrix.
    """
    # Spectral radius by repeated squaring: |F^(2^k)|^(1 / 2^k), scaled to avoid overflow.
    F, square, total, n = matrix.copy(), np.empty(matrix.shape), 0.0, matrix.shape[0]
    for half in range(45):
        size = np.max(np.abs(F))
        if size == 0.0:
            return 0.0
        total += math.log(size) * 0.5**half
        F /= size
        square[:] = 0.0
        for i in range(n):
            for k in range(n):
                # The queue of commands makes the matrix sparse: skip its zeros.
                if F[i, k] != 0.0:
                    for j in range(n):
                        square[i, j] += F[i, k] * F[k, j]
        F[:] = square
    return math.exp(total)


def open_loop(plant: Held, law: Law, w: ArrayLike) -> NDArray[np.complex128]:
    """Return the loop's transfer function, opened at the command.

    It is evaluated at angular frequencies w [rad/s].
    """
    turns = np.ascontiguousarray(np.asarray(w, dtype=float) * plant.dt)
    return np.asarray(_open_loop(*_parts(plant, law), turns))


def _parts(plant: Held, law: Law) -> tuple[Any, ...]:
    """Return plant and law in the form that compiled code takes."""
    arrays = plant.transition, plant.now, plant.before, *law.matrices(plant)
    transition, now, before, *rest = map(np.ascontiguousarray, arrays)
    return transition, now, before, plant.whole, *rest


@register_jitable
def _solve(M, b):
    """M x = b for complex M (n, n), by Gauss; b (n,) becomes x."""
    n = b.size
    for k in range(n):
        # Partial pivoting.
        top = k + np.argmax(np.abs(M[k:, k]))
        for j in range(n):
            M[k, j], M[top, j] = M[top, j], M[k, j]
        b[k], b[top] = b[top], b[k]
        for i in range(k + 1, n):
            share = M[i, k] / M[k, k]
            M[i, k:] -= share * M[k, k:]
            b[i] -= share * b[k]
    # Back substitution.
    for k in range(n - 1, -1, -1):
        b[k] = (b[k] - np.sum(M[k, k + 1 :] * b[k + 1 :])) / M[k, k]


@register_jitable
def _response(transition, now, before, whole, A, B, C, D, turn):
    """Return the opened loop where the frequency turns by so much a sample [rad]."""
    # The whole samples of the delay turn the phase; the part is in `now` and `before`.
    z, late = complex(math.cos(turn), math.sin(turn)), -turn * whole
    x = (now + before / z) * complex(math.cos(late), math.sin(late))
    # Transfer function of the plant at z: (z I - transition)^-1 times its input.
    _solve(z * np.eye(now.size) - transition, x)
    u = D[0] * x[0] + D[1] * x[1]
    if C.size:
        # Dynamic part of the law, C (z I - A)^-1 B, driven by q and v.
        c = B[:, 0] * x[0] + B[:, 1] * x[1]
        _solve(z * np.eye(C.size) - A, c)
        u += np.sum(C * c)
    # Negative feedback: the closed loop is at its limit where this number is -1 (Nyquist).
    return -u


@register_jitable
def _responses(transition, now, before, whole, A, B, C, D, turns):
    result = np.empty(turns.size, np.complex128)
    for k in range(turns.size):
        result[k] = _response(transition, now, before, whole, A, B, C, D, turns[k])
    return result


_PARTS = MATRIX, VECTOR, VECTOR, numba.int64, MATRIX, MATRIX, VECTOR, VECTOR
_open_loop = loop(_responses, types.Array(numba.complex128, 1, "C")(*_PARTS, VECTOR))


@dataclass(frozen=True)
class Margins:
    """How far a stable loop is from its limits; all 0 for one that is not stable.

    Attributes:
        gain, lower: the factors on all gains between which the loop stays stable, above and below
            1; infinity and 0 where there is no limit.
        phase: lag that it stands [rad].
        delay: further delay that it stands [s], from the loop's matrix with that delay.
    """

    gain: float
    lower: float
    phase: float
    delay: float


# Where crossings are looked for [rad a sample].
_TURNS = math.pi * np.concatenate((np.geomspace(1e-6, 0.2, 400), np.linspace(0.2, 1.0, 300)[1:-1]))


@register_jitable
def _above(value, size):
    return abs(value) > 1.0 if size else value.imag > 0.0


@register_jitable
def _gain_crossover(transition, now, before, whole, A, B, C, D):
    """Return where the open loop has the size 1 [rad a sample], and its lag there [rad].

    Where it is real, and what it is there: where that is negative the loop with -1 / value times
    the gains swings for ever.
    """
    values = _responses(transition, now, before, whole, A, B, C, D, _TURNS)
    largest = _TURNS.size
    at, lags, flat, reals = (
        np.empty(largest),
        np.empty(largest),
        np.empty(largest),
        np.empty(largest),
    )
    flat[0] = math.pi  # half the sample rate: there it is always real
    reals[0] = _response(transition, now, before, whole, A, B, C, D, math.pi).real
    sizes, real = 0, 1
    # Both kinds of crossing: sign changes between grid points, bisected.
    for size in (False, True):
        for k in range(_TURNS.size - 1):
            side = _above(values[k], size)
            if _above(values[k + 1], size) == side:
                continue
            low, high = _TURNS[k], _TURNS[k + 1]
            for _ in range(50):
                middle = 0.5 * (low + high)
                value = _response(transition, now, before, whole, A, B, C, D, middle)
                if _above(value, size) == side:
                    low = middle
                else:
                    high = middle
            middle = 0.5 * (low + high)
            value = _response(transition, now, before, whole, A, B, C, D, middle)
            if size:
                at[sizes] = middle
                # Phase margin: the angle between the response and the negative real axis.
                lags[sizes] = (math.atan2(value.imag, value.real) + math.pi) % (2.0 * math.pi)
                sizes += 1
            else:
                flat[real], reals[real] = middle, value.real
                real += 1
    return at[:sizes], lags[:sizes], flat[:real], reals[:real]


_crossed = loop(_gain_crossover, types.UniTuple(VECTOR, 4)(*_PARTS))


@register_jitable
def _margins(at, lags, reals, dt):
    """Return the four of `Margins` from what was found."""
    gain, lower, phase, delay = math.inf, 0.0, math.inf, math.inf
    # Gain margins from real-axis crossings, phase and delay margins from unit-circle crossings.
    for value in reals:
        if -1.0 <= value < 0.0:
            gain = min(gain, -1.0 / value)
        elif value < -1.0:
            lower = max(lower, -1.0 / value)
    for k in range(at.size):
        # A further delay d adds a lag of w d, so the delay margin is the phase margin over the
        # frequency.
        phase, delay = min(phase, lags[k]), min(delay, lags[k] * dt / at[k])
    return gain, lower, phase, delay


def crossings(plant: Held, law: Law) -> Margins:
    """Return the margins of a stable loop as its frequency response has them.

    Its delay is lag over frequency; what the hold does to a part of a sample is left out.
    """
    at, lags, _, reals = _crossed(*_parts(plant, law))
    return Margins(*map(float, _margins(at, lags, reals, plant.dt)))


def margins(A: ArrayLike, B: ArrayLike, law: Law, dt: float, delay: float = 0.0) -> Margins:
    """Return gain, phase and delay margin of a law on a plant, all of one sampled loop.

    Args:
        A: state matrix of the plant, see `joint_system`.
        B: its input vector.
        law: with the gains as they are.
        dt: sample time [s].
        delay: the delay that the loop has already [s].

    Raises:
        ValueError: the law was made for another sample time.
    """

    def holds(extra: float) -> bool:
        return growth(loop_matrix(held(A, B, dt, delay + extra), law)) <= STABLE

    if not holds(0.0):
        return Margins(0.0, 0.0, 0.0, 0.0)
    result = crossings(held(A, B, dt, delay), law)
    if result.delay == math.inf:
        return result
    # The delay margin is refined by the eigenvalues, as a loop may be stable again later.
    step = result.delay / 8.0
    last = next((k for k in range(1, 40) if not holds(k * step)), 40) * step
    low, high = last - step, last
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return replace(result, delay=low)


def ultimate_gain(A: ArrayLike, B: ArrayLike, dt: float, delay: float = 0.0) -> tuple[float, float]:
    """Return the gain at which P alone oscillates for ever, and the period of that [s].

    Args:
        A: state matrix of the plant, see `joint_system`.
        B: its input vector.
        dt: sample time [s].
        delay: of the loop [s].

    Raises:
        ValueError: if there is no such gain: without friction every gain is unstable, and some
            loops are stable at every gain.
    """
    plant = held(A, B, dt, delay)
    if len(plant.now) < 2:
        raise invalid("A.shape", np.shape(A), "that of a plant whose first states are q and v")
    # P alone oscillates where the loop's phase is -180 degrees: a real, negative response.
    _, _, flat, reals = _crossed(*_parts(plant, pid_law(1.0, dt=dt)))
    gain, w = min(
        ((-1.0 / x, f / dt) for x, f in zip(reals, flat, strict=True) if x < 0.0),
        default=(0.0, 1.0),
    )
    # This gain is the limit only if the loop is stable just below it.
    if not gain or growth(loop_matrix(plant, pid_law(0.99 * gain, dt=dt))) > STABLE:
        system = np.asarray(A).tolist(), np.asarray(B).tolist()
        raise invalid("(A, B)", system, "a plant that P holds up to some gain")
    return float(gain), float(2.0 * math.pi / w)


# --- limits with a closed form --------------------------------------------------------------------


def delay_limit(inertia: float, damping: float, lateness: float) -> tuple[float, float]:
    """Return the largest gain of P on a joint whose command is late, and its period [s].

    w tan(w lateness) = damping / inertia and K = w sqrt((inertia w)^2 + damping^2); a hold is half
    a sample of lateness (Franklin, Powell and Workman, Digital Control, 1998, sec. 4.3).

    Args:
        inertia: positive [kg m^2].
        damping: positive [N m s/rad].
        lateness: delay + dt / 2 [s], positive.
    """
    b = positive("damping", damping) / positive("inertia", inertia)
    # The first root is below a quarter turn, where the tangent is finite.
    low, high = 0.0, 0.5 * math.pi / positive("lateness", lateness, unit="s")
    # The phase condition w tan(w late) = b is monotone in w: bisection.
    for _ in range(80):
        w = 0.5 * (low + high)
        low, high = (w, high) if w * math.tan(w * lateness) < b else (low, w)
    return w * math.hypot(inertia * w, damping), 2.0 * math.pi / w


def pd_limit(kd: float, inertia: float, dt: float, rate: str = "exact") -> float:
    """Return the largest kp of PD on a free inertia; 0 where none is stable.

    Args:
        kd: [N m s/rad].
        inertia: of the joint [kg m^2].
        dt: sample time [s].
        rate: "exact", v itself; "difference" of the last two angles; "late", v itself and the
            command a sample late.
    """
    one_of("rate", rate, ("exact", "difference", "late"))
    unit = positive("inertia", inertia) / positive("dt", dt, unit="s") ** 2
    V = finite("kd", kd, 0.0) * dt / inertia  # and P = kp / (2 unit)
    if rate == "exact":  # kp dt / 2 < kd < 2 I / dt
        return 2.0 * unit * V if V < 2.0 else 0.0
    if rate == "difference":  # P < 2 c (1 - c) / (1 + c) with c = V / 2
        return max(0.0, 2.0 * unit * V * (2.0 - V) / (2.0 + V))
    return unit * (2.0 * V - 3.0 + math.sqrt(9.0 - 8.0 * V)) if V < 1.0 else 0.0


def force_limit(damping: float, wall: float, lateness: float) -> float:
    """Return the largest stable gain of proportional force control at a wall.

    It holds while the delay is short compared with the oscillation.

    Args:
        damping: of the arm [N s/m].
        wall: its stiffness [N/m].
        lateness: delay + dt / 2 [s].
    """
    return finite("damping", damping, 0.0) / (
        positive("wall", wall) * positive("lateness", lateness)
    )


def passive_stiffness(damping: float, dt: float, delay: float = 0.0) -> float:
    """Return the largest stiffness of an undamped controller that an arm's friction keeps passive.

    It is 2 b / (dt + 2 delay).

    Colgate and Schenkel, Passivity of a class of sampled-data systems, 1997, with the delay added
    to half a sample.
    """
    late = 0.5 * positive("dt", dt, unit="s") + finite("delay", delay, 0.0, unit="s")
    return finite("damping", damping, 0.0) / late
