"""How much is solved, and for how much: the share of problems solved against a budget.

A method that fails has cost infinitely much: it stays in every share and every median. Seeds are
runs of one method on the same problems; what is drawn is the median over them, and Wilson's
interval for the number of problems says how far chance in choosing them may have moved it. `trials`
says how many problems it takes to tell two methods apart.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, positive, vector
from course.measure.colours import key_of
from course.measure.figure import Series

Array = NDArray[np.float64]
Problem = TypeVar("Problem")

TWO_SIGMA = 1.959963984540054  # the normal quantile of a two-sided 95 %


def wilson(solved: ArrayLike, tried: int, z: float = TWO_SIGMA) -> tuple[Array, Array]:
    """Return Wilson's interval for a share (Wilson, J. Am. Stat. Assoc. 22, 1927).

    Inside 0 and 1 and right for shares near them, where the usual p +- z sqrt(p (1 - p) / n) has no
    width: of 100 tries without a failure it says that up to 3.7 % may fail.

    Args:
        solved: how many of the tries worked; any shape, need not be whole (a median of counts).
        tried: of how many, from 1 on.
        z: normal quantile of the confidence, 1.96 for 95 %.

    Returns:
        Both ends, each of the shape of `solved`.
    """
    count("tried", tried, 1)
    share = vector("solved", solved, low=0.0, high=float(tried)) / tried
    return score_interval(share, tried, positive("z", z))


def score_interval(share: Any, tried: int, z: float = TWO_SIGMA) -> tuple[Any, Any]:
    """Return both ends of Wilson's interval: `wilson` without its checks.

    It can be compiled: `course.simulations.interval`.

    Args:
        share: successes / tried, a number or an array.
        tried: number of tries.
        z: normal quantile of the confidence.
    """
    # Wilson's score interval; the clips undo rounding at shares of 0 and 1.
    square = z * z
    middle = share + 0.5 * square / tried
    half = np.sqrt(square * (share * (1.0 - share) + 0.25 * square / tried) / tried)
    low, high = (middle - half) / (1.0 + square / tried), (middle + half) / (1.0 + square / tried)
    return np.minimum(np.maximum(low, 0.0), share), np.maximum(np.minimum(high, 1.0), share)


@dataclass(frozen=True)
class Success:
    """What one method took for each problem, with each seed.

    Attributes:
        name: as in the legend.
        cost: shape (seeds, problems), infinite where it failed.
        unit: of the cost, such as "s" or "iterations".
    """

    name: str
    cost: Array
    unit: str

    def __post_init__(self) -> None:
        cost = np.asarray(self.cost, dtype=float)
        if cost.ndim != 2 or not cost.size:
            raise invalid("cost.shape", cost.shape, "(seeds, problems), each at least 1")
        if np.isnan(cost).any() or (cost < 0.0).any():
            raise invalid("cost", cost, "non-negative numbers, infinite for a failure")
        object.__setattr__(self, "cost", cost)

    def shares(self, budgets: ArrayLike) -> Array:
        """Return the share solved within each budget by each seed, shape (seeds, budgets)."""
        within = vector("budgets", budgets, (None,), low=0.0)
        # The empirical distribution of costs: a failure is infinitely expensive, so it never
        # counts.
        return np.mean(self.cost[:, :, None] <= within, axis=1)

    def share(self, budgets: ArrayLike) -> Array:
        """Return share solved within each budget, the median over the seeds, shape (budgets,)."""
        return np.median(self.shares(budgets), axis=0)

    def band(self, budgets: ArrayLike, z: float = TWO_SIGMA) -> tuple[Array, Array]:
        """Return Wilson's interval around `share`, two arrays (budgets,).

        It counts the problems once: more seeds on the same problems say nothing about others.
        """
        # Seeds on the same problems are not independent tries.
        problems = self.cost.shape[1]
        return wilson(self.share(budgets) * problems, problems, z)

    @property
    def ever(self) -> float:
        """Share solved at all, the median over the seeds."""
        return float(np.median(np.mean(np.isfinite(self.cost), axis=1)))

    def budget(self, share: float = 0.5) -> tuple[float, float, float]:
        """Return the budget within which a share of the problems is solved.

        Args:
            share: of the problems, failures counted; above 0, at most 1.

        Returns:
            Median, least and largest over the seeds; infinite where so much is never solved.
        """
        problems = self.cost.shape[1]
        # The smallest budget that solves at least this share of the problems; 1e-12 undoes
        # rounding.
        rank = math.ceil(finite("share", share, 1e-12, 1.0) * problems * (1.0 - 1e-12)) - 1
        needed = np.sort(self.cost, axis=1)[:, rank]
        # Two infinite values around the middle are no number minus itself: the upper one counts.
        median = float(np.sort(needed)[needed.size // 2])
        if needed.size % 2 == 0 and math.isfinite(median):
            median = float(np.median(needed))
        return median, float(needed.min()), float(needed.max())

    def series(self, budgets: ArrayLike, key: str = "", style: str = "-") -> Series:
        """Return the share solved against budget, with its band, for a `Panel`."""
        low, high = self.band(budgets)
        # The share of all problems, not of the solved ones, so that failures are not hidden.
        median, *_ = self.budget()
        half = "never" if math.isinf(median) else f"within {median:.3g} {self.unit}"
        note = f"{self.name:<32} solves {self.ever:7.2%}, half of all {half}"
        return Series(
            self.name,
            np.asarray(budgets, float),
            self.share(budgets),
            key or key_of(self.name),
            style,
            low=low,
            high=high,
            note=note,
        )


def collect(
    name: str,
    solve: Callable[[Problem, np.random.Generator], float],
    problems: Sequence[Problem],
    seeds: Sequence[int],
    unit: str,
    clock: Callable[[], float] = time.process_time,
) -> tuple[Success, Success]:
    """Run one method on every problem with every seed.

    Args:
        name: of the method.
        solve: (problem, rng) -> its count, infinite where it failed.
        problems: the same for all seeds.
        seeds: one generator each; a problem's stream does not depend on the ones before it.
        unit: of the count.
        clock: what time is taken from; that of this process by default.

    Returns:
        By count, and by time [s]. A failure costs infinitely much in both.
    """
    if not problems or not seeds:
        raise invalid("problems and seeds", (len(problems), len(seeds)), "one or more of each")
    costs, times = np.empty((2, len(seeds), len(problems)))
    for i, seed in enumerate(seeds):
        for j, problem in enumerate(problems):
            # A generator for each pair of seed and problem: results do not depend on the order of
            # the runs.
            rng = np.random.default_rng((seed, j))
            start = clock()
            costs[i, j] = solve(problem, rng)
            times[i, j] = clock() - start
    times[np.isinf(costs)] = math.inf
    return Success(name, costs, unit), Success(name, times, "s")


def paired(first: ArrayLike, second: ArrayLike, z: float = TWO_SIGMA) -> tuple[float, float, float]:
    """Return how much more often the second method works than the first, on the same trials.

    What both do alike says nothing of the difference, so the interval is as narrow as the trials in
    which one works and the other fails allow (Bonett and Price, Adjusted Wald confidence interval
    for a difference of binomial proportions based on paired data, 2012).

    Args:
        first: whether each trial of the first method worked, shape (n,).
        second: the same for the second method, in the same order.
        z: normal quantile of the confidence, 1.96 for 95 %.

    Returns:
        The difference of the shares and both ends of its interval.
    """
    a, b = (np.asarray(x, dtype=bool) for x in (first, second))
    if a.ndim != 1 or a.shape != b.shape or not a.size:
        raise invalid("(first.shape, second.shape)", (a.shape, b.shape), "(n,) twice, n at least 1")
    n = a.size
    # Bonett and Price (2012): one is added to both discordant counts.
    up, down = ((np.sum(x & ~y) + 1.0) / (n + 2.0) for x, y in ((b, a), (a, b)))
    half = positive("z", z) * math.sqrt((up + down - (up - down) ** 2) / (n + 2.0))
    middle = float(up - down)
    return float(np.mean(b) - np.mean(a)), max(-1.0, middle - half), min(1.0, middle + half)


def trials(
    first: float,
    second: float,
    *,
    together: float | None = None,
    power: float = 0.8,
    level: float = 0.05,
) -> int:
    """Return how many trials of each policy it takes to tell two success rates apart.

    If each policy has trials of its own, this is the normal approximation with the pooled variance
    (Fleiss, Levin and Paik, Statistical Methods for Rates and Proportions, 2003, eq. 4.14). If both
    run the same trials in pairs, it is McNemar's test (eq. 13.17 there): only the discordant trials
    count, in which one policy succeeds and the other fails.

    Both formulas are normal approximations without a correction for continuity, so an exact test
    needs more trials, above all where the result is small. For the rates 0 and 1 the result is 2,
    but with 2 trials each Fisher's exact test can't reach a p-value below 1/3; at the level 0.05 it
    takes 4. For 0.2 and 0.8 the result is 10, and Fisher's test detects the difference with a
    probability of 0.64 instead of 0.8; for 0.5 and 0.8 it is 39, with 0.73.

    Args:
        first: one success rate, from 0 to 1.
        second: the other success rate, not equal.
        together: share of the paired trials in which both succeed; None for trials of their own.
        power: probability of detecting the difference, from 0.5 to 1 - 1e-9.
        level: two-sided significance level, the probability of claiming a difference where there is
            none, from 1e-9 to 0.5.

    Returns:
        The number of trials of each policy; in paired trials, the number of pairs.

    Raises:
        ValueError: for equal rates, for a number out of its range, and for a share of common
            successes that the two rates don't allow.
    """
    p1, p2 = finite("first", first, 0.0, 1.0), finite("second", second, 0.0, 1.0)
    if p1 == p2:
        raise invalid("second", second, f"a rate other than the first, {first}")
    # Normal quantiles of the significance level (two-sided) and of the power.
    z_level = NormalDist().inv_cdf(1.0 - 0.5 * finite("level", level, 1e-9, 0.5))
    z_power = NormalDist().inv_cdf(finite("power", power, 0.5, 1.0 - 1e-9))
    difference = abs(p1 - p2)
    # Variances of the difference in one trial: if the rates are equal, and if they are as given.
    if together is None:
        # Two independent proportions (Fleiss, Levin and Paik, 2003).
        pooled = 0.5 * (p1 + p2)
        variance_if_equal = 2.0 * pooled * (1.0 - pooled)
        variance = p1 * (1.0 - p1) + p2 * (1.0 - p2)
    else:
        # Paired proportions (McNemar, 1947). The rates bound the share of common successes, up to
        # the rounding of their sum.
        low, high = max(0.0, p1 + p2 - 1.0), min(p1, p2)
        both = finite("together", together, low - 1e-12, high + 1e-12)
        discordant = p1 + p2 - 2.0 * both
        variance_if_equal, variance = discordant, max(discordant - difference**2, 0.0)
    numerator = z_level * math.sqrt(variance_if_equal) + z_power * math.sqrt(variance)
    return math.ceil((numerator / difference) ** 2)
