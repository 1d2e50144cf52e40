"""What a robot's parameters are, from a log of what was sent and what was measured.

Output error: simulate what was sent, compare with what was measured, move the parameters until the
squares are least (Levenberg, 1944; Marquardt, 1963). All columns of a Jacobian are one batched
rollout, beside the point that is tried.
The error bars come from that Jacobian (Ljung, System Identification, 1999, ch. 9). They hold if the
model and the time stamps are right, and the noise is zero on average and independent from sample to
sample. A coloured residual shows that one of these is violated; a white one doesn't show that all
of them hold.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from course.check import count, finite, invalid, one_of, positive, vector
from course.sim_to_real import plants

Array = NDArray[np.float64]
Parameters = Mapping[str, float]
Bounds = Mapping[str, tuple[float, float]]
# Of parameters by name, (K,) each, and a log, whose commands it takes: the signals, (n, T + 1, K).
Simulate = Callable[[Mapping[str, Array], "Log"], Array]

BASE = plants.ROWS[:5]  # what a flat arm can tell of itself, see `TwoLink`
LAGS, ALARM = 20, 0.01  # of the test of whiteness: how far it looks, how often it may err


@dataclass(frozen=True)
class Log:
    """What was sent and what came back; NaN, a gap and a second clock are refused.

    Attributes:
        times: of the measurements, evenly spaced, shape (T + 1,) [s].
        measured: n signals at these times, shape (n, T + 1).
        command: m signals, each value held until the next, shape (m, T).
        sent: when they were sent, shape (T,) [s]; None for at times[:-1].
    """

    times: Array
    measured: Array
    command: Array
    sent: Array | None = None

    def __post_init__(self) -> None:
        t = vector("times", self.times, (None,), unit="s")
        count("times.size", t.size, 3)
        vector("measured", self.measured, (None, t.size))
        vector("command", self.command, (None, t.size - 1))
        positive("times[-1] - times[0]", t[-1] - t[0], unit="s")
        sent = t if self.sent is None else vector("sent", self.sent, (t.size - 1,), unit="s")
        # Even spacing, and commands on the clock of the measurements: else a delay would look like
        # physics.
        jitter, other = np.diff(t) - np.median(np.diff(t)), sent[: t.size - 1] - t[:-1]
        for name, values, deviation in (("times", t[1:], jitter), ("sent", sent, other)):
            i = int(np.argmax(np.abs(deviation)))
            if abs(deviation[i]) > 0.01 * self.dt:
                raise invalid(
                    f"{name}[{i + (values is not sent)}]",
                    values[i],
                    f"{values[i] - deviation[i]:g} s: evenly spaced, one clock",
                )

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return float(self.times[-1] - self.times[0]) / (self.times.size - 1)


@dataclass(frozen=True)
class Visible:
    """What a log can tell of P parameters.

    Attributes:
        names, covariance: of the parameters, (P, P) [their units]; inf where not identifiable.
        rank: how many combinations, moved by their own size, change the log by more than the noise.
        null: a sentence for each that does not.
        directions: these, a row each, in units of the parameters' sizes, shape (P - rank, P).
        condition: largest over smallest singular value, in these units.
    """

    names: tuple[str, ...]
    covariance: Array
    rank: int
    null: tuple[str, ...]
    directions: Array
    condition: float


@dataclass(frozen=True)
class Fit(Visible):
    """Parameters out of a log, and what that log tells of them.

    Attributes:
        value: of each parameter, shape (P,).
        residual: measured minus simulated, shape (n, T + 1).
        noise: its standard deviation, less what the parameters took.
        white: how often a right model leaves a residual as coloured as this one.
        slope, rollouts: d simulated / d parameter, (n, T + 1, P), and how many simulations it took.
        reason: what speaks against the answer; empty if nothing does.
    """

    value: Array
    residual: Array
    noise: float
    white: float
    slope: Array
    rollouts: int
    reason: str

    def half_width(self, level: float = 0.95) -> Array:
        """Return half the width of the intervals that hold the parameters in this share of logs.

        They do so under the assumptions at the top of this module. The shape is (P,).
        """
        from scipy.special import stdtrit

        quantile = stdtrit(self.residual.size - len(self.names), 0.5 * (1.0 + level))
        return np.asarray(quantile * np.sqrt(np.diag(self.covariance)))


def _prepared(simulate: Simulate, log: Log, start: Parameters, free: Bounds) -> tuple:
    """Return names, values, bounds and sizes of the free parameters, and the simulator.

    The simulator takes points (P, K).
    """
    names = tuple(one_of("free", name, start) for name in free)
    low, high = np.array([free[name] for name in names], dtype=float).reshape(-1, 2).T
    if not (names and (low < high).all()):
        raise invalid("free", dict(free), "a lower bound below the upper one for each")
    x = np.array([finite(f"start[{n!r}]", start[n], *free[n]) for n in names])
    # The size of a parameter, for steps and scaling.
    wide = np.where(np.isfinite(high - low), high - low, 1.0)

    def run(points: Array) -> Array:
        all_of_them = {n: np.full(points.shape[1], float(v)) for n, v in start.items()}
        simulated = np.asarray(simulate(all_of_them | dict(zip(names, points, strict=True)), log))
        expected = (*log.measured.shape, points.shape[1])
        if simulated.shape != expected:
            rule = f"{expected}: signals, times and columns of parameters"
            raise invalid("simulate(parameters, log).shape", simulated.shape, rule)
        return simulated

    return names, x, low, high, np.where(x != 0.0, np.abs(x), wide), run


def _slope(run: Callable, x: Array, low: Array, high: Array, size: Array) -> Array:
    """Return d simulated / d parameter by central differences, shape (n, T + 1, P).

    All differences are taken in one batched rollout.
    """
    # Central differences, one-sided at a bound; all of them in one batched rollout.
    up, down = np.minimum(x + 6e-6 * size, high) - x, np.maximum(x - 6e-6 * size, low) - x
    both = run(x[:, None] + np.hstack([np.diag(up), np.diag(down)]))
    return np.asarray((both[..., : x.size] - both[..., x.size :]) / (up - down))


def fit(simulate: Simulate, log: Log, start: Parameters, free: Bounds, *, steps: int = 100) -> Fit:
    """Return the parameters whose simulation comes closest to a log, and how well they are known.

    A start out of its bounds or without a finite simulation, a name that it lacks, and fewer
    samples than parameters are each a ValueError.

    Args:
        simulate: parameters -> simulated signals, all of which count alike.
        log: the measured signals and the commands.
        start: all that `simulate` wants, by name; what is not free stays.
        free: bounds of each parameter that is to be found.
        steps: limit on the Gauss-Newton steps.
    """
    names, x, low, high, size, run = _prepared(simulate, log, start, free)
    desired, P = np.asarray(log.measured, dtype=float), len(names)
    if desired.size <= P:
        raise invalid("log", f"of {desired.size} samples", f"one of more than {P}")

    def tried(point: Array) -> tuple[Array, float, Array]:
        # Forward differences, away from a bound; their error, about 1e-8, moves no answer.
        # Forward differences suffice for the search; the final slope is central.
        h = np.where(point + 1e-7 * size > high, -1e-7, 1e-7) * size
        result = run(point[:, None] + np.hstack([np.zeros((P, 1)), np.diag(h)]))
        r = (desired - result[..., 0]).ravel()
        # A simulation that diverged costs infinitely much, so that its step is rejected.
        cost = float(r @ r) if np.isfinite(result).all() else math.inf
        # Derivatives with respect to relative changes, so that all columns are comparable.
        return r, cost, (result[..., 1:] - result[..., :1]).reshape(-1, P) * (size / h)

    r, cost, J = tried(x)
    if cost == math.inf:
        raise invalid("start", dict(start), "one whose simulation stays finite")
    damping, taken, against = 1e-4, 0, ["not settled"]
    while taken < steps and against[:1] == ["not settled"]:
        taken += 1
        # Normal equations of Gauss-Newton.
        A, g = J.T @ J, J.T @ r
        # Marquardt's scaling; what does not show stays where it is.
        A += np.diag(damping * np.maximum(np.diag(A), 1e-12 * np.trace(A) + 1e-300))
        # Active set: parameters that are pushed against a bound do not move.
        held = ((x <= low) & (g < 0.0)) | ((x >= high) & (g > 0.0))  # pushed against its bound
        # Their equations become those of the identity, with a step of 0.
        A[held], A[:, held], A[held, held], g[held] = 0.0, 0.0, 1.0, 0.0
        point = np.clip(x + size * np.linalg.solve(A, g), low, high)
        # A step this small ends the search, unless only the damping has made it small.
        if np.max(np.abs(point - x) / size) < 1e-6:
            against = [] if damping < 1.0 else ["no step goes down, as small as it is"]
        now = tried(point)
        # Levenberg-Marquardt: accept a step that lowers the cost and trust it more, else less.
        if now[1] < cost:
            x, (r, cost, J), damping = point, now, 0.1 * damping
        else:
            damping *= 10.0
    # An unbiased variance: each parameter takes a degree of freedom.
    noise, inside = math.sqrt(cost / (desired.size - P)), (low < x) & (x < high)
    slope, residual = _slope(run, x, low, high, size), r.reshape(desired.shape)
    against += [f"{names[i]} is at its bound, {x[i]:g}" for i in np.flatnonzero(~inside)]
    observed, white = _visible(names, slope, noise, size, inside), whiteness(residual)
    if white < ALARM and noise > 1e-9 * np.abs(desired).max():  # else it is rounding that is left
        against.append("the residual is not white: the model, the clock or the start is wrong")
    taken = (taken + 1) * (P + 1) + 2 * P
    return Fit(
        **vars(observed),
        value=x,
        residual=residual,
        noise=noise,
        white=white,
        slope=slope,
        rollouts=taken,
        reason="; ".join([*against, *observed.null]),
    )


def arm(parameters: Mapping[str, Array], log: Log) -> Array:
    """Return a `Simulate`: angles of flat arms under the torques of a log, (2, T + 1, K) [rad].

    Takes `BASE` and, where they are given, other `plants.ROWS` and q1, q2, v1, v2 at the start.
    """
    given, empty = {"torque": np.ones(len(parameters["a"])), **parameters}, 0.0 * parameters["a"]
    rows, start = (
        np.array([given.get(name, empty) for name in names])
        for names in (plants.ROWS, ("q1", "q2", "v1", "v2"))
    )
    return plants.driven(rows, log.command.T, start, log.dt).measured.swapaxes(1, 2)


def scan(
    simulate: Simulate, log: Log, start: Parameters, free: Bounds, name: str, values: Array
) -> tuple[float, Fit]:
    """Return one parameter by trying values and fitting the others at each.

    The lowest point of the parabola through the best value and its neighbours, and the fit at the
    best.
    """
    given = vector("values", values, (None,))
    tries = [fit(simulate, log, {**start, name: float(v)}, free) for v in given]
    cost = np.array([result.noise**2 for result in tries])
    best = int(np.argmin(cost))
    if not 0 < best < given.size - 1:
        raise invalid("values", given, f"some on both sides of {given[best]:g}, which is the best")
    # Vertex of the parabola through the best value and its two neighbours.
    near = slice(best - 1, best + 2)
    bend, slope, _ = np.polyfit(given[near] - given[best], cost[near], 2)
    return float(given[best] - 0.5 * slope / bend), tries[best]


def validate(simulate: Simulate, log: Log, start: Parameters, result: Fit) -> tuple[float, float]:
    """Return another log with the parameters of a fit.

    Standard deviation of its residual over that of the fit, and how often a right model leaves one
    as coloured.
    """
    values = dict(start) | dict(zip(result.names, result.value, strict=True))
    residual = log.measured - simulate({n: np.array([v]) for n, v in values.items()}, log)[..., 0]
    return float(np.sqrt(np.mean(residual**2))) / result.noise, whiteness(residual)


def excitation(
    simulate: Simulate,
    logs: Mapping[str, Log],
    start: Parameters,
    free: Bounds,
    noise: float = 1e-3,
) -> dict[str, Visible]:
    """Predict how well each of several logs would identify the parameters.

    The logs come in the order of their condition numbers. The log with the smallest errors may be
    another one: compare the covariances. Nothing needs to be measured: only the logs' commands
    count, and the parameters are those of `start`.
    """
    report = {}
    for name, log in logs.items():
        names, x, low, high, size, run = _prepared(simulate, log, start, free)
        slope = _slope(run, x, low, high, size)
        report[name] = _visible(names, slope, positive("noise", noise), size, x == x)
    return dict(sorted(report.items(), key=lambda item: item[1].condition))


def _visible(
    names: tuple[str, ...], slope: Array, noise: float, size: Array, inside: NDArray[np.bool_]
) -> Visible:
    """Return what a slope shows of the parameters that are `inside`, which is not at a bound."""
    which = np.flatnonzero(inside)
    J = slope.reshape(-1, size.size)[:, which] * (size[which] / max(noise, 1e-15))
    # QR first: the triangle has the singular values of the tall matrix.
    _, s, V = np.linalg.svd(np.linalg.qr(J, "r"))  # the triangle has the same values, and is small
    s = np.pad(s, (0, which.size - s.size))
    # A direction shows if one relative unit of it moves the log by more than the noise.
    shows = s > max(1.0, 1e-8 * s.max(initial=0.0))
    # Covariance by the pseudoinverse on the directions that show, in the parameters' own units.
    root = V[shows].T / s[shows] * size[which][:, None]
    covariance = np.full((size.size, size.size), np.inf)
    covariance[np.ix_(which, which)] = root @ root.T
    # A parameter with a part in a hidden direction is not known at all.
    hidden = which[np.linalg.norm(V[~shows], axis=0) > 1e-3]
    covariance[hidden], covariance[:, hidden] = np.inf, np.inf
    directions = np.zeros((shows.size - np.count_nonzero(shows), size.size))
    directions[:, which] = V[~shows]
    rows = directions
    for i in range(len(rows)):  # Gauss and Jordan: the same span, with few entries in a row
        j = int(np.argmax(np.abs(rows[i])))
        rows = rows - np.outer(rows[:, j] - (np.arange(len(rows)) == i), rows[i] / rows[i, j])
    null = tuple(_sentence(names, row, size) for row in rows)
    condition = float(s[0] / s[-1]) if s.size and s[-1] > 0.0 else math.inf
    return Visible(names, covariance, int(shows.sum()), null, directions, condition)


def _sentence(names: Sequence[str], row: Array, size: Array) -> str:
    # Entries below one per cent of the largest stay out of the sentence.
    parts = np.flatnonzero(np.abs(row) > 1e-2 * np.abs(row).max()).tolist()
    if len(parts) == 1:
        return f"{names[parts[0]]} does not show"
    if len(parts) == 2:
        i, j = parts
        factor = -row[j] * size[j] / (row[i] * size[i])
        return f"of {names[i]} and {names[j]} only {names[j]} {factor:+.4g} {names[i]} shows"
    change = ", ".join(f"{names[i]} by {100.0 * row[i]:+.3g} %" for i in parts)
    return f"together {change} do not show"


def whiteness(residual: Array) -> float:
    """Return how often white noise is as coloured as this, shape (n, T).

    The test of Ljung and Box (1978). Below `ALARM` something is left to explain, by however little
    it moved the answer.
    """
    from scipy.special import gammaincc

    n, T = residual.shape
    lags = np.arange(1, min(LAGS, T - 1) + 1)
    # The floor guards a residual of exactly 0.
    power = np.maximum(np.sum(residual**2, axis=1), 1e-300)
    # Ljung and Box's statistic (1978) of the autocorrelations, chi-squared for white noise.
    share = np.array([np.sum(residual[:, k:] * residual[:, :-k], axis=1) for k in lags]) / power
    Q = T * (T + 2.0) * np.sum(share**2 / (T - lags)[:, None])
    # Probability of a larger value of chi squared, with one degree of freedom per signal and lag.
    return float(gammaincc(0.5 * n * lags.size, 0.5 * Q))


def measurement_lag(result: Fit, log: Log) -> tuple[float, float]:
    """Return by how much the measurements are late, and its standard deviation [s].

    The residual against the rate of the simulated signals, what the parameters explain taken out.
    """
    # To first order a delay adds rate times delay to the residual; what the parameters can explain
    # is projected out.
    rate = -np.gradient(log.measured - result.residual, log.dt, axis=1).ravel()
    others = result.slope.reshape(rate.size, -1)
    others = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    rate -= others @ np.linalg.lstsq(others, rate, rcond=1e-8)[0]
    # Least squares with a single unknown: its value, and its standard deviation.
    power = float(rate @ rate)
    return float(rate @ result.residual.ravel()) / power, result.noise / math.sqrt(power)
