"""Looking for a failure that is rare: sampling where it is, and weighing what is found.

Plain sampling sees one failure in 1 / p runs. Cross-entropy sampling (Rubinstein and Kroese, The
Cross-Entropy Method, 2004) moves a normal proposal to the worst runs of each round, then counts
failures by their weight, density over proposal (black-box validation: Corso and others, A survey of
algorithms for black-box safety validation, 2021). A proposal that is narrower than the failure
region never sees the weights that it lacks: the answer is too low and sure of itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from course.check import count, finite, invalid

Array = NDArray[np.float64]
Severity = Callable[[Array], Array]
_TWO_SIGMA = 1.96  # the normal quantile of a two-sided 95 %


@dataclass(frozen=True, eq=False)
class Rare:
    """What was found.

    Attributes:
        share, error: of failures, and its standard error as it would be stated.
        low, high: interval of 95 % for the share. Where no run failed, the error says nothing: the
            upper end is then Wilson's, times the largest weight that a run can have.
        runs: severities asked for.
        effective: failures that would say as much if each weighed the same, (sum w)^2 / sum w^2.
        heaviest: share of the answer that rests on one run: near 1 it is an alarm.
        mean, width: of the proposal, shape (n,), in standard deviations of the disturbances.
    """

    share: float
    error: float
    low: float
    high: float
    runs: int
    effective: float
    heaviest: float
    mean: Array
    width: Array


def _estimate(weights: Array, largest: float, runs: int, mean: Array, width: Array) -> Rare:
    """Return what the weights of the failed runs say, 0 for a run that did not fail.

    Args:
        weights: shape (n,).
        largest: weight that a run can have, infinite where nothing bounds it.
        runs, mean, width: for the record.
    """
    n, total, square = weights.size, float(weights.sum()), float(np.sum(weights**2))
    share = min(total / n, 1.0)
    error = math.sqrt(max(square / n - share * share, 0.0) / n)
    effective = total * total / square if square else 0.0
    if total and largest > 1.0:
        low, high = max(share - _TWO_SIGMA * error, 0.0), min(share + _TWO_SIGMA * error, 1.0)
    else:  # a count of failures: 0 where weights may hide some
        from scipy.stats import binomtest

        interval = binomtest(round(total), n).proportion_ci(method="wilson")
        low, high = float(interval.low), min(float(interval.high) * largest, 1.0)
    top = float(weights.max()) / max(total, 1e-300)
    return Rare(share, error, low, high, runs, effective, top, mean, width)


def _severities(severity: Severity, disturbances: Array) -> Array:
    """Return the severities of runs.

    Raises:
        ValueError: one of them is NaN, which is neither a failure nor a success.
    """
    result = np.asarray(severity(disturbances), dtype=float)
    if np.isnan(result).any():
        raise invalid("severity", "NaN", "a number for every run; infinite for one that broke off")
    return result


def plain(severity: Severity, size: int, runs: int, rng: np.random.Generator) -> Rare:
    """Return share of runs that fail, of so many; arguments as for `cross_entropy`."""
    failed = _severities(severity, rng.standard_normal((size, count("runs", runs, 1)))) > 0.0
    return _estimate(failed.astype(float), 1.0, runs, np.zeros(size), np.ones(size))


def cross_entropy(
    severity: Severity,
    size: int,
    rng: np.random.Generator,
    *,
    rounds: int = 4,
    each: int = 250,
    last: int = 1500,
    elite: float = 0.1,
    least: float = 0.0,
    defence: float = 0.0,
) -> Rare:
    """Return share of failures under disturbances that are standard normal.

    Args:
        severity: disturbances (size, N) -> how bad each run was, above 0 a failure.
        size: how many disturbances.
        rng: all random numbers.
        rounds, each: of the search, and runs in one.
        last: runs that are counted.
        elite: share of a round that the proposal is fitted to, by weight.
        least: width below which no disturbance's proposal may fall.
        defence: share of the counted runs that is drawn as plain sampling would; a weight is then
            below 1 / defence, so no failure can be missing much.
    """
    finite("elite", elite, 1e-3, 1.0)
    share = finite("defence", defence, 0.0, 1.0)
    mean, width = np.zeros(size), np.ones(size)

    def drawn(n: int) -> tuple[Array, Array]:
        x = mean[:, None] + width[:, None] * rng.standard_normal((size, n))
        x = np.where(rng.random(n) < share, rng.standard_normal((size, n)), x)
        z = (x - mean[:, None]) / width[:, None]
        ratio = np.exp(0.5 * np.sum(x * x - z * z, axis=0)) / np.prod(width)
        return x, 1.0 / (share + (1.0 - share) * ratio)

    for _ in range(count("rounds", rounds)):
        x, weight = drawn(count("each", each, 10))
        bad = _severities(severity, x)
        worst = weight * (bad >= min(float(np.quantile(bad, 1.0 - elite)), 0.0))
        mean = x @ worst / worst.sum()
        spread = np.sqrt((x - mean[:, None]) ** 2 @ worst / worst.sum())
        width = np.maximum(spread, max(least, 1e-3))
    x, weight = drawn(count("last", last, 1))
    failed = weight * (_severities(severity, x) > 0.0)
    return _estimate(failed, 1.0 / share if share else math.inf, rounds * each + last, mean, width)
