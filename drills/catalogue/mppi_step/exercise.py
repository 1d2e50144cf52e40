"""One step of MPPI: plain weights first, then large costs, failed rollouts and limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases with costs near zero and far from it, limits, and failed rollouts."""

    def step(
        label: str = "random",
        level: str = "core",
        *,
        k: int = 12,
        m: int = 2,
        limit: float = 9.0,
        base: float = 0.0,
        spread: float = 1.0,
        failed: tuple[float, ...] = (),
        temperature: float = 0.0,
    ) -> Case:
        """Return costs from the base on; the first ones replaced by those of failed rollouts."""
        plan, noise = rng.normal(size=(6, m)), rng.normal(size=(k, 6, m))
        costs = base + spread * rng.uniform(0.0, 3.0, k)
        costs[: len(failed)] = failed
        return Case(
            (
                plan,
                noise,
                rng.permutation(costs),
                temperature or rng.uniform(0.5, 1.5),
                -limit * rng.uniform(0.8, 1.0, m),
                limit * rng.uniform(0.8, 1.0, m),
            ),
            label,
            level,
        )

    nan, inf = float("nan"), float("inf")
    one = step(k=1).args
    flat, noise = np.zeros((3, 1)), np.array([1.0, -1.0])[:, None, None] * np.ones((2, 3, 1))
    far = step(limit=0.8).args
    far[0][1:3] *= 5.0
    whole = (
        np.array([[1, 0], [2, -1], [0, 1]]),
        rng.integers(-4, 5, (5, 3, 2)),
        np.array([3, 1, 2, 4, 2]),
        2,
        np.array([-3, -2]),
        np.array([3, 2]),
    )
    return [
        Case(
            (flat, noise, np.array([0.0, 1.0]), 1.0, -np.full(1, 5.0), np.full(1, 5.0)),
            "two rollouts, up and down",
            "simple",
        ),
        step("costs near zero", "simple"),
        step("one command", "simple", m=1),
        step("limits that bind", limit=0.8),
        step("limits that bind", limit=0.5, m=3),
        step("a low temperature", temperature=0.1),
        step("a high temperature", temperature=20.0),
        step("many rollouts", k=60),
        step("costs below zero", base=-5.0),
        step("large costs", base=5e4),
        step("large costs below zero", base=-5e4),
        step("one rollout failed", failed=(nan,)),
        step("one rollout is infinite", failed=(inf,)),
        step("half of them failed", failed=(nan, inf, nan, nan, inf, nan), base=10.0),
        step("one takes it all", "edge", spread=1e5),
        step("all failed", "edge", failed=(nan,) * 6 + (inf,) * 6, limit=0.8),
        step("all but one failed", "edge", failed=(nan,) * 11),
        step("large costs, some failed", "edge", failed=(nan, inf, nan), base=1e6, limit=0.8),
        Case(one, "one rollout", "edge"),
        Case(far, "a plan beyond its limits", "edge"),
        Case(whole, WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Any, ...]) -> float:
    """Return 1e-10 of the largest command, one added."""
    return 1e-10 * (1.0 + float(np.abs(truth[0]).max()))


def plans(figure: Any, shown: Shown) -> None:
    """Plot the first command over the steps: as planned, and the new ones, between the limits."""
    axes = picture.plane(figure, "step", "first command")
    plan, noise, _, _, low, high = shown.args
    axes.axhspan(low[0], high[0], color="0.95")
    tried = np.clip(plan + noise, low, high)[:, :, 0]
    axes.plot(tried.T, color="0.8", lw=0.6)
    axes.plot(plan[:, 0], ":", color="tab:blue", label="the plan before")
    axes.plot(np.asarray(shown.got[0])[:, 0], "o-", **picture.YOURS)
    axes.plot(shown.expected[0][:, 0], marker="o", **picture.RIGHT)
    axes.legend()


_TRIED = "tried = np.clip(plan + np.asarray(noise), low, high)"
_GOOD = "good = np.isfinite(costs)"
_EXP = "np.exp(-(costs[good] - costs[good].min()) / temperature)"
_RETURN = "return np.tensordot(weights, tried, axes=1), float(1.0 / (weights @ weights))"

SLIPS = slips(
    not_clipped=(
        _TRIED,
        "tried = plan + np.asarray(noise)",
        "The commands are not clipped: the plan goes beyond its limits, where no rollout went.",
    ),
    no_baseline=(
        _EXP,
        "np.exp(-costs[good] / temperature)",
        "No baseline is subtracted: with large costs all weights are zero, and below zero they "
        "overflow. Take the least cost off before the exponential; it cancels in the ratio.",
    ),
    nan_wins=(
        _GOOD,
        "costs = np.nan_to_num(costs, nan=0.0, posinf=np.inf)\n    " + _GOOD,
        "A cost of NaN is counted as zero: the rollout that failed is then the cheapest. It has "
        "no weight at all.",
    ),
    nan_poisons=(
        _GOOD,
        "good = np.ones(costs.size, dtype=bool)",
        "A single NaN among the costs makes everything NaN: the least of them, every weight, the "
        "plan. Leave failed rollouts out before you look for the least.",
    ),
    infinity_not_left_out=(
        _GOOD,
        "good = ~np.isnan(costs)",
        "NaN is left out and infinity is not: where all rollouts failed, the least cost is "
        "infinity too, and infinity less infinity is NaN.",
    ),
    clipped_at_the_end=(
        _TRIED,
        "tried = plan + np.asarray(noise)",
        _RETURN,
        "return (np.clip(np.tensordot(weights, tried, axes=1), low, high), "
        "float(1.0 / (weights @ weights)))",
        "The mean is clipped, and not what was tried. The costs belong to clipped commands, so "
        "these are to be averaged.",
    ),
    noise_clipped=(
        _TRIED,
        "tried = plan + np.clip(noise, low, high)",
        "The noise is clipped by itself. The limits are those of the commands, plan plus noise.",
    ),
    sign_of_the_exponent=(
        _EXP,
        "np.exp((costs[good] - costs[good].max()) / temperature)",
        "The expensive rollouts get the weight: use exp of *minus* the cost.",
    ),
    temperature_multiplied=(
        _EXP,
        "np.exp(-(costs[good] - costs[good].min()) * temperature)",
        "The costs are multiplied by the temperature. Divide by it: at a high temperature "
        "all rollouts have about the same weight.",
    ),
    temperature_ignored=(
        _EXP,
        "np.exp(-(costs[good] - costs[good].min()))",
        "The temperature has no effect.",
    ),
    costs_normalised=(
        _EXP,
        "np.exp(-(costs[good] - costs[good].min()) / max(float(np.ptp("
        "costs[good])), 1e-9) / temperature)",
        "The costs are divided by their range. Some programs do that. Here the temperature "
        "has the unit of the costs, which are used as they are.",
    ),
    mean_for_the_least=(
        _EXP,
        "np.exp(-(costs[good] - costs[good].mean()) / temperature)",
        "The mean is subtracted instead of the lowest cost. The best rollout may be "
        "thousands of temperatures below the mean, and its weight overflows.",
    ),
    best_only=(
        _EXP,
        "1.0 * (np.arange(good.sum()) == costs[good].argmin())",
        "The best rollout gets all the weight. That is predictive sampling. In MPPI all "
        "rollouts count, weighted by their cost.",
    ),
    weights_not_normalised=(
        "weights = weights / weights.sum()",
        "weights = 1.0 * weights",
        "The weights are not divided by their sum.",
    ),
    noise_alone=(
        _TRIED,
        "tried = np.clip(plan + np.asarray(noise), low, high) - plan",
        "What comes back is the change of the plan. The new plan itself is asked for.",
    ),
    change_added_twice=(
        _RETURN,
        _RETURN.replace("return ", "return plan + "),
        "The plan counts twice: what was tried holds it already.",
    ),
    rollouts_counted=(
        _RETURN,
        "return np.tensordot(weights, tried, axes=1), float(good.sum())",
        "You count the rollouts that did not fail. Asked is how many of them the weights amount "
        "to: one over the sum of their squares.",
    ),
    weights_squared_outside=(
        _RETURN,
        "return np.tensordot(weights, tried, axes=1), float(weights @ weights)",
        "The number is upside down: one over the sum of the squares.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases, allowed, "a mean whose weights are exponentials of 1e-12 and better", explain=coarse
    ),
    examples=(
        "mppi_step(np.zeros((2, 1)), np.array([[[1.0], [1.0]], [[-1.0], [-1.0]]]), "
        "np.array([0.0, 1.0]), 1.0, np.array([-5.0]), np.array([5.0]))",
        "mppi_step(np.zeros((2, 1)), np.array([[[1.0], [1.0]], [[-1.0], [-1.0]]]), "
        "np.array([np.nan, 1e6]), 1.0, np.array([-0.5]), np.array([0.5]))",
    ),
    picture=plans,
    slips=SLIPS
    + coarse_slips("mppi_step", "A plan that is handed on step by step keeps each rounding.")
    + value_slips("mppi_step"),
)
