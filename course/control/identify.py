"""What a joint is, from a log of its angle and its commands; and what is wrong with its model.

inertia q'' + damping q' + coulomb sign(q') + gravity cos q = constant x the torque that arrives,
which is the command, limited, a delay later. Nothing measured is differentiated: the equation is
multiplied with a smooth bump and integrated over a window, which moves the derivatives to the bump
(modulating functions, Shinbrot, 1957). The held command is integrated exactly, for any delay.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from course.check import finite, invalid, positive, vector

Array = NDArray[np.float64]

# For `identify`: share of a window in which the joint may rest, fewest windows, and the largest
# condition number of their four columns, each of length one.
_REST, _FEWEST, _WORST = 0.1, 12, 1e3
# For `diagnose`: without any fault, one number more lowers the sum of squares over K windows by a
# factor of up to 1 + _CHANCE / K. Measured on 4,000 logs without a fault (3, 4, 6 and 12 s; noise
# of 0.01 to 1 mrad; 50 seeds, four joints each): K times the excess was 32.2 at most, so none was a
# false alarm.
_CHANCE = 40.0
# Flat to the fourth order at both ends, so that sums over samples are integrals.
_BUMP = Polynomial([0.0, 1.0, -1.0]) ** 5


@dataclass(frozen=True)
class Log:
    """What was recorded of one joint.

    Attributes:
        dt: sample time [s].
        q: measured angles, from the horizontal if there is gravity, shape (T + 1,) [rad].
        command: torques that were sent, each held for a sample, shape (T,) [N m].
    """

    dt: float
    q: Array
    command: Array

    def __post_init__(self) -> None:
        positive("dt", self.dt, unit="s")
        q = vector("q", self.q, (None,), unit="rad")
        vector("command", self.command, (max(len(q) - 1, 0),), unit="N m")


@dataclass(frozen=True)
class JointModel:
    """The seven numbers that a log can be at odds with.

    Attributes:
        inertia, damping, coulomb: [kg m^2, N m s/rad, N m].
        gravity: the torque that holds the joint at q = 0 [N m].
        constant: delivered torque over commanded torque.
        delay: from command to torque [s].
        limit: of the commanded torque, in both directions [N m].
    """

    inertia: float
    damping: float = 0.0
    coulomb: float = 0.0
    gravity: float = 0.0
    constant: float = 1.0
    delay: float = 0.0
    limit: float = math.inf

    def __post_init__(self) -> None:
        positive("inertia", self.inertia, unit="kg m^2")
        positive("constant", self.constant)
        for name in ("damping", "coulomb", "delay"):
            finite(name, getattr(self, name), 0.0)
        finite("gravity", self.gravity, unit="N m")
        if not self.limit > 0.0:
            raise invalid("limit", self.limit, "a positive number [N m]")


LINEAR = ("inertia", "damping", "coulomb", "gravity")
CAUSES = (*LINEAR, "constant", "delay", "limit")


class _Windows:
    """The integrals of a log over all windows; the columns are those of `LINEAR`."""

    def __init__(self, log: Log, window: float, longest: float, rest: float | None = None) -> None:
        """Integrate a log over windows.

        Args:
            log: as for `identify`.
            window: as for `identify`.
            longest: largest delay of a command that will be queried [s].
            rest: share of a window in which the joint may rest. None keeps the two fifths of the
                windows that rest least, however much that is.
        """
        self._dt, self._n = log.dt, round(positive("window", window, unit="s") / log.dt)
        self._back = math.ceil(finite("longest", longest, 0.0, unit="s") / log.dt) + 1
        # Windows overlap by three quarters; each starts late enough for the longest delay.
        n, last = self._n, len(log.q) - 1 - self._n
        starts = np.arange(self._back, last + 1, max(1, n // 4))
        if n < 20 or len(starts) < 12:
            allowed = f"of 20 samples or more, and a log of 4 of them (it has {len(log.q)} samples)"
            raise invalid("window", window, allowed)
        # Modulating functions (Shinbrot, 1957): integration by parts moves both derivatives from
        # the measured angle to the smooth bump, so that noise is never differentiated.
        s, length = np.linspace(0.0, 1.0, n + 1), n * log.dt
        bump, slope, bend = (
            log.dt * p(s) / length**k for k, p in enumerate((_BUMP, _BUMP.deriv(), _BUMP.deriv(2)))
        )
        # Which way it moves, seen over 10 ms: all that is asked of the speed. Where that is less
        # than the noise the joint rests or turns round, and friction is anything up to Coulomb's.
        wide = max(1, round(0.005 / log.dt))
        padded = np.pad(log.q, wide, mode="edge")
        moved = padded[2 * wide :] - padded[: -2 * wide]
        # Fourth differences of a smooth motion vanish; what remains is noise, with the factor
        # sqrt(70).
        noise = float(np.std(np.diff(log.q, 4))) / math.sqrt(70.0)
        resting = np.abs(moved) < 5.0 * noise
        # Time at rest in each window, weighted with the bump.
        self.weight = float(bump.sum())  # of a window [s]: an impulse over it is a mean torque
        still = sliding_window_view(resting, n + 1)[starts] @ bump
        calmest = max(0.01 * bump.sum(), np.quantile(still, 0.4))
        starts = starts[still <= (calmest if rest is None else rest * bump.sum())]
        self.count = len(starts)
        rows = [
            sliding_window_view(x, n + 1)[starts] for x in (log.q, np.sign(moved), np.cos(log.q))
        ]
        # Weak form of the four terms: one integration by parts changes the sign of the damping's
        # column, a second one restores that of the inertia's.
        self.columns = np.column_stack(
            [rows[0] @ bend, -rows[0] @ slope, rows[1] @ bump, rows[2] @ bump]
        )
        self._sent = sliding_window_view(log.command, n + self._back)[starts - self._back]
        self.highest = float(np.abs(log.command).max())

    def torque(self, delay: float, limit: float = math.inf) -> Array:
        """Return the impulse of the commands in each window, weighted with it, (K,) [N m s]."""
        # The bump's weight over each held command, shifted by the delay.
        edges = self._dt * np.arange(-self._back, self._n + 1) + delay
        area = _BUMP.integ()(np.clip(edges / (self._n * self._dt), 0.0, 1.0))
        weights = self._n * self._dt * np.diff(area)
        sent = self._sent if limit == math.inf else np.clip(self._sent, -limit, limit)
        return np.asarray(sent @ weights)

    def misfit(self, model: JointModel) -> Array:
        """Return the impulse that the torque has too much for the motion, (K,) [N m s]."""
        known = np.array([getattr(model, name) for name in LINEAR])
        return model.constant * self.torque(model.delay, model.limit) - self.columns @ known


class Identified(NamedTuple):
    """What a log tells of a joint.

    Attributes:
        model: the joint.
        deviation: standard deviations of inertia, damping, coulomb and gravity, (4,); 0 for one
            that is in `at_zero`.
        at_zero: those of damping and coulomb whose best value was below 0, within its deviation.
            They were set to 0, and the others fitted again without them.
    """

    model: JointModel
    deviation: Array
    at_zero: tuple[str, ...] = ()


def identify(
    log: Log, *, delay: float = 0.0, constant: float = 1.0, window: float = 0.3
) -> Identified:
    """Return inertia, friction and gravity by least squares over the windows of a log.

    Args:
        log: a motion that speeds up, slows down and turns round.
        delay: known delay of the torque [s].
        constant: known ratio of torque to command: the log alone can't distinguish a weak motor
            from a heavy joint.
        window: length of the bump; short ones let noise in, long ones are few [s].

    A joint at rest tells nothing: friction is then anything up to Coulomb's. So only windows in
    which it hardly rests are used, and a log of a single step, which rests most of the time, is
    rejected. It would make gravity out of the friction that holds the joint.

    Raises:
        ValueError: for a log too short for the window, or one whose motion can't tell the four: it
            rests, it is always alike, or it wants a friction below 0.
    """
    delay = finite("delay", delay, 0.0, unit="s")
    windows = _Windows(log, window, delay, rest=_REST)
    if windows.count < _FEWEST:
        actual = f"one that moves through {windows.count} windows only, and rests in the others"
        allowed = f"a motion that goes on for {_FEWEST} windows or more: an excitation, not a step"
        raise invalid("log", actual, allowed)
    # Unit columns: their condition number says whether the log separates the four terms.
    scale = np.linalg.norm(windows.columns, axis=0)
    if not (scale > 0.0).all() or np.linalg.cond(windows.columns / scale) > _WORST:
        raise invalid("log", "one that cannot tell the four terms", "a motion with more variety")
    torque = positive("constant", constant) * windows.torque(delay)
    free = np.ones(4, dtype=bool)
    while True:
        columns = windows.columns[:, free] / scale[free]
        answer, *_ = np.linalg.lstsq(columns, torque, rcond=None)
        remaining = torque - columns @ answer
        # Neighbours overlap by three quarters: about two in four tell something new.
        variance = 2.0 * (remaining @ remaining) / max(1, windows.count - 8)
        value, deviation = np.zeros(4), np.zeros(4)
        value[free] = answer / scale[free]
        # Covariance of least squares: the variance times the inverse of X^T X.
        spread = np.diag(np.linalg.inv(columns.T @ columns))
        deviation[free] = np.sqrt(variance * spread) / scale[free]
        # Friction and inertia are never negative: a coefficient that noise pushes below 0 is fixed
        # there and the rest fitted again.
        below = free & np.array([False, True, True, False]) & (value < 0.0)
        if not below.any():
            break
        # A friction that is negative by three standard deviations contradicts the model; it is not
        # noise.
        for name, number, sigma in zip(LINEAR, value, deviation, strict=True):
            if name in ("damping", "coulomb") and number < -3.0 * sigma:
                actual = f"one that wants a {name} of {number:.2g} +- {sigma:.2g}"
                raise invalid(
                    "log", actual, "a motion with more variety, of the joint's own commands"
                )
        free &= ~below
    result = dict(zip(LINEAR, value.tolist(), strict=True))
    if result["inertia"] <= 0.0:
        raise invalid("log", "one with an inertia below 0", "a log of the joint's own commands")
    at_zero = tuple(name for name, used in zip(LINEAR, free, strict=True) if not used)
    return Identified(JointModel(**result, constant=constant, delay=delay), deviation, at_zero)


class Diagnosis(NamedTuple):
    """Which single cause explains a log.

    Attributes:
        causes: those of `CAUSES` that explain it as well as the best does, that one first; none
            where the model as it stands explains it.
        values: what each of the seven numbers would have to be.
        misfit: mean square left with each, over that of the model as it stands.
        remaining: root mean square of the torque that each leaves unexplained, as means over the
            windows [N m].
    """

    causes: tuple[str, ...]
    values: dict[str, float]
    misfit: dict[str, float]
    remaining: dict[str, float]


def diagnose(
    log: Log, model: JointModel, *, longest: float = 0.05, window: float = 0.3
) -> Diagnosis:
    """Try each of the seven causes by itself: the one number that fits best, and what is left.

    A cause is told from another by the shape of what it leaves over time. A motor constant scales
    every term alike, so only friction or gravity can tell it from an inertia: for a joint without
    gravity and friction both are returned. Only the two fifths of the windows are used in which the
    joint rests least.

    Where two numbers are wrong at once, or something else is wrong, the best single cause is named
    all the same. Compare its `remaining` with that of a log of a sound joint: several times as much
    says that the cause does not explain the log.

    Args:
        log: of the joint under any commands, its own loop's too.
        model: what it is believed to be.
        longest: longest delay that is tried [s].
        window: as for `identify` [s].

    Returns:
        The diagnosis. A torque limit is tried up to the largest command, whether the model believes
        in a lower or a higher one. A value at the largest command stands for
        any limit above it, as the log can't show more.

    Raises:
        ValueError: for a log too short for the window, and for one with fewer than 12 windows that
            count.
    """
    windows = _Windows(log, window, max(finite("longest", longest, 0.0, unit="s"), model.delay))
    if windows.count < _FEWEST:
        allowed = (
            f"one with {_FEWEST} windows or more that count: a longer log, or a shorter window"
        )
        raise invalid("log", f"one with {windows.count}", allowed)
    residual = windows.misfit(model)
    squares = float(residual @ residual)
    values, squares_left = asdict(model), dict.fromkeys(CAUSES, squares)

    def squares_with(name: str, value: float) -> float:
        """Return the sum of squares after a change of one number."""
        changed = windows.misfit(replace(model, **{name: value}))
        return float(changed @ changed)

    # Linear causes: the best change of one number alone has a closed form. Each column is minus the
    # residual's derivative with respect to its number.
    torque = windows.torque(model.delay, model.limit)
    for name, column in [*zip(LINEAR, windows.columns.T, strict=True), ("constant", -torque)]:
        if column @ column > 0.0:
            best = values[name] + float(column @ residual / (column @ column))
            bound = -math.inf if name == "gravity" else 0.0
            # Frictions may be 0; inertia and constant stay as they are where 0 would be best.
            if best > bound or name in ("damping", "coulomb"):
                values[name] = max(best, bound)
                squares_left[name] = squares_with(name, values[name])
    # Delay and torque limit enter nonlinearly: a search in one dimension each, for the limit below
    # and above what the model believes. A limit above the largest command changes nothing.
    believed = min(windows.highest, model.limit)
    searches = (
        ("delay", 0.0, longest),
        ("limit", 0.02 * believed, believed),
        ("limit", believed, windows.highest),
    )
    for name, low, high in searches:
        if high > low:
            best = _lowest(functools.partial(squares_with, name), low, high)
            remaining = squares_with(name, best)
            if remaining < squares_left[name]:
                values[name], squares_left[name] = best, remaining
    # One number more always fits a little better, by chance up to this factor.
    chance = 1.0 + _CHANCE / windows.count
    lowest = min(squares_left.values())
    # A floor of rounding errors, for logs without noise.
    floor = 1e-12 * float(torque @ torque)
    near = sorted(
        (squares_left[c], c) for c in CAUSES if squares_left[c] <= chance * lowest + floor
    )
    causes = () if squares <= chance * lowest + floor else tuple(c for _, c in near)
    misfit = {c: squares_left[c] / squares if squares else 1.0 for c in CAUSES}
    torques = {c: math.sqrt(squares_left[c] / windows.count) / windows.weight for c in CAUSES}
    return Diagnosis(causes, values, misfit, torques)


def _lowest(cost: Callable[[float], float], low: float, high: float, parts: int = 40) -> float:
    """Minimise a function with several valleys by a grid and then golden-section search."""
    points = [low + (high - low) * i / parts for i in range(parts + 1)]
    # The grid brackets the lowest of several valleys; golden-section search refines it.
    best = int(np.argmin([cost(x) for x in points]))
    a, b = points[max(best - 1, 0)], points[min(best + 1, parts)]
    # Golden section: every step keeps 0.618 of the bracket.
    ratio = 0.5 * (math.sqrt(5.0) - 1.0)
    for _ in range(30):
        c, d = b - ratio * (b - a), a + ratio * (b - a)
        if cost(c) <= cost(d):
            b = d
        else:
            a = c
    return 0.5 * (a + b)
