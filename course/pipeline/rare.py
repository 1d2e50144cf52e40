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
_TWO_SIGMA = 1.959963984540054  # normal quantile of a two-sided 95 %


@dataclass(frozen=True, eq=False)
class Rare:
    """What was found.

    Attributes:
        share, error: of failures, and its standard error as it would be stated. Without a failure
            in the sample, or without a success in plain sampling, the error is what Wilson's
            interval leaves open, divided by 1.96.
        low, high: ends of the 95 % interval of the share, by Wilson's formula. They know nothing
            of failures that the proposal never meets.
        runs: number of severities that were evaluated.
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


def _interval(share: float, n: float) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a share of n runs (a chapter can't import `measure`)."""
    # Wilson's score interval: it stays within 0 and 1, and has a width for 0 failures.
    square = _TWO_SIGMA**2
    middle = share + 0.5 * square / n
    half = math.sqrt(square * (share * (1.0 - share) + 0.25 * square / n) / n)
    low, high = ((middle + sign * half) / (1.0 + square / n) for sign in (-1.0, 1.0))
    # The interval contains the share, whatever rounding does at 0 and 1.
    return min(max(low, 0.0), share), max(min(high, 1.0), share)


def _estimate(weights: Array, runs: int, plain_runs: int, mean: Array, width: Array) -> Rare:
    """Return the estimate from the weights of the counted runs, 0 for a success.

    Args:
        weights: of the counted runs.
        runs: severities evaluated in all.
        plain_runs: runs among them that were sampled from the true distribution. Only they say
            how rare a failure is that no run has met.
        mean: of the proposal.
        width: of the proposal, standard deviations.
    """
    n, total, square = weights.size, float(weights.sum()), float(np.sum(weights**2))
    share = min(total / n, 1.0)  # weights are noisy: their mean may exceed 1
    error = math.sqrt(max(square / n - share * share, 0.0) / n)
    # A sample without spread says nothing of its error; Wilson's interval does.
    if share in (0.0, 1.0) or error == 0.0:
        low, high = _interval(share, plain_runs)
        error = (high - low) / _TWO_SIGMA
    else:
        # The number of plain runs with the same standard error enters Wilson's formula.
        low, high = _interval(share, share * (1.0 - share) / error**2)
    # Kish's effective sample size, of the failures alone.
    effective = total * total / square if square else 0.0
    heaviest = float(weights.max()) / max(total, 1e-300)
    return Rare(share, error, low, high, runs, effective, heaviest, mean, width)


def _severities(severity: Severity, disturbances: Array) -> Array:
    """Return the severities of some runs, checked."""
    result = np.asarray(severity(disturbances), dtype=float)
    if result.shape != disturbances.shape[1:]:
        raise invalid("shape of the severities", result.shape, f"{disturbances.shape[1:]}")
    if np.isnan(result).any():
        allowed = "a number for each run: call a run that breaks off a failure, such as infinity"
        raise invalid("severity", math.nan, allowed)
    return result


def plain(severity: Severity, size: int, runs: int, rng: np.random.Generator) -> Rare:
    """Return the share of `runs` runs that fail; arguments as for `cross_entropy`."""
    failed = _severities(severity, rng.standard_normal((size, count("runs", runs, 1)))) > 0.0
    return _estimate(failed.astype(float), runs, runs, np.zeros(size), np.ones(size))


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
    """Return the share of failures under disturbances that are standard normal.

    The proposal is a normal distribution with independent components, at first the standard one.
    Each round fits it to the worst runs of the round, its elites (Rubinstein and Kroese, 2004). The
    runs after the last round are counted, each with the weight density / proposal (importance
    sampling), so that the expected share is right whatever the proposal is.

    Args:
        severity: disturbances, shape (size, N), in standard deviations -> how bad each of the N
            runs was, shape (N,), in any unit; above 0 it is a failure.
        size: number of disturbances in a run.
        rng: source of all random numbers.
        rounds: number of rounds of the search; 0 is plain sampling.
        each: runs in a round of the search, at least 10.
        last: runs that are counted.
        elite: share of a round that counts as elites, 0.001 to 1. Once failures are more than
            that, all of them are elites.
        least: lower bound on the proposal's width [standard deviations of the disturbance].
        defence: share of the runs that is drawn from the true distribution instead of the
            proposal, 0 to 1, in the search and in the count. The runs then come from a defensive
            mixture (Hesterberg, 1995), and no weight exceeds 1 / defence: a failure that the
            proposal makes unlikely can't dominate the answer. 0 switches it off.

    Returns:
        The estimate; `runs` counts the search as well.

    Raises:
        ValueError: for a severity that is NaN, or an argument outside of its range.
    """
    finite("elite", elite, 1e-3, 1.0)
    share = finite("defence", defence, 0.0, 1.0)
    mean, width = np.zeros(size), np.ones(size)
    # Runs that are certain to come from the true distribution: the first round, before the proposal
    # has moved, and the expected defence of the count. They bound the share where no run fails.
    plain_runs = count("each", each, 10) if count("rounds", rounds) else count("last", last, 1)
    plain_runs += round(share * last) if rounds else 0

    def drawn(n: int) -> tuple[Array, Array]:
        # Defensive mixture (Hesterberg, 1995): a share is sampled from the true distribution, so
        # that no weight exceeds 1 / share.
        x = mean[:, None] + width[:, None] * rng.standard_normal((size, n))
        x = np.where(rng.random(n) < share, rng.standard_normal((size, n)), x)
        z = (x - mean[:, None]) / width[:, None]
        # Likelihood ratio of the proposal to the standard normal.
        ratio = np.exp(0.5 * np.sum(x * x - z * z, axis=0)) / np.prod(width)
        # Density over that of the mixture from which the run was drawn.
        return x, 1.0 / (share + (1.0 - share) * ratio)

    for _ in range(rounds):
        x, weight = drawn(each)
        bad = _severities(severity, x)
        # Elites: the worst runs of the round, or all failures once there are enough; weighted.
        worst = weight * (bad >= min(float(np.quantile(bad, 1.0 - elite)), 0.0))
        # Fit of a normal distribution to the weighted elites, each disturbance by itself.
        mean = x @ worst / worst.sum()
        spread = np.sqrt((x - mean[:, None]) ** 2 @ worst / worst.sum())
        # A floor on the width keeps the proposal from collapsing onto one run.
        width = np.maximum(spread, max(least, 1e-3))
    x, weight = drawn(count("last", last, 1))
    failed = _severities(severity, x) > 0.0
    return _estimate(weight * failed, rounds * each + last, plain_runs, mean, width)
