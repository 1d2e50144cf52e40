"""PPO's objective: each of the six cases alone, then batches, first passes and extreme ratios."""

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

WHERE = {"too low": (0.2, 0.7), "near 1": (0.9, 1.1), "too high": (1.4, 3.0)}


def cases(rng: np.random.Generator) -> list[Case]:
    """Return ratios on both sides of the clip, with advantages of both signs."""

    def actions(label: str, ratio: Any, advantage: Any, level: str = "core") -> Case:
        old = rng.uniform(-3.0, 0.0, len(ratio))
        clip = float(rng.uniform(0.15, 0.25))
        return Case((old + np.log(ratio), old, np.asarray(advantage), clip), label, level)

    def spread(n: int, size: float) -> Any:
        return np.exp(size * rng.normal(size=n))

    one = [
        actions(
            f"A {'> 0' if sign > 0 else '< 0'}, ratio {name}",
            rng.uniform(*ends, 1),
            [sign * float(rng.uniform(0.5, 2.0))],
            "simple",
        )
        for sign in (1.0, -1.0)
        for name, ends in WHERE.items()
    ]
    whole = np.array([0, -1, -2, 0]), np.array([-1, 0, 0, 0]), np.array([1, -2, 3, 1]), 0.5
    return [
        *one,
        *(actions("a batch", spread(20, 0.4), rng.normal(size=20)) for _ in range(3)),
        actions("advantages with a mean", spread(20, 0.4), rng.normal(size=20) + 2.0),
        actions("a large batch", spread(400, 0.2), rng.normal(size=400)),
        actions("all ratios are 1", np.ones(8), rng.normal(size=8), "edge"),
        actions("far ratios", spread(12, 2.0), rng.normal(size=12), "edge"),
        actions("no advantage", spread(6, 0.4), np.zeros(6), "edge"),
        Case(whole, WHOLE, "edge"),
    ]


def gradients(figure: Any, shown: Shown) -> None:
    """Plot gradient of each action over its ratio."""
    axes, clip = picture.plane(figure, "ratio", "gradient"), shown.args[3]
    ratio = np.exp(np.asarray(shown.args[0]) - shown.args[1])
    axes.axvspan(1.0 - clip, 1.0 + clip, color="0.93")
    for (_, part), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(ratio, part, **style | {"marker": "o", "ls": ""})
    axes.legend()


_RATIO = "np.exp(np.asarray(new, dtype=float) - np.asarray(old, dtype=float))"
_CLIPPED, _MEAN = (
    "np.clip(ratio, 1.0 - clip, 1.0 + clip) * A",
    "np.mean(np.minimum(plain, clipped))",
)
_GRADIENT = "np.where(plain <= clipped, plain, 0.0) / A.size"

SLIPS = slips(
    max_for_min=(
        _MEAN,
        _MEAN.replace("minimum", "maximum"),
        "plain <= c",
        "plain >= c",
        "The larger term is selected. PPO selects the smaller one, so that the objective is a "
        "lower bound.",
    ),
    clip_on_one_side=(
        _CLIPPED,
        "np.clip(ratio, None, 1.0 + clip) * A",
        "The ratio is clipped from above only. For a negative advantage it has to be clipped from "
        "below.",
    ),
    ratio_inverted=(
        _RATIO,
        "np.exp(np.asarray(old, dtype=float) - np.asarray(new, dtype=float))",
        "The ratio is inverted: it is the new probability over the old one, exp(new - old).",
    ),
    sum_for_mean=(
        _MEAN,
        _MEAN.replace("np.mean", "np.sum"),
        " / A.size",
        "",
        "This is the sum over the batch. The objective is the mean, so that a larger batch does "
        "not enlarge the step.",
    ),
    gradient_gone_outside=(
        "plain <= clipped",
        "np.abs(ratio - 1.0) <= clip",
        "The gradient is zero wherever the ratio is outside the range. Where the ratio moved in "
        "the wrong direction, the unclipped term is the smaller one, and its gradient pulls it "
        "back.",
    ),
    gradient_of_the_unclipped=(
        _GRADIENT,
        "plain / A.size",
        "The gradient is that of the unclipped term everywhere, so nothing is ever clipped.",
    ),
    gradient_by_the_ratio=(
        _GRADIENT,
        _GRADIENT.replace(" plain,", " A,"),
        "This is the derivative with respect to the ratio. With respect to the log-probability it "
        "has the ratio as a factor.",
    ),
    equal_terms_left_out=(
        "plain <= clipped",
        "plain < clipped",
        "Near 1 both terms are equal, and there the gradient is not zero.",
    ),
    logs_for_ratio=(
        _RATIO,
        "1.0 + (np.asarray(new, dtype=float) - np.asarray(old, dtype=float))",
        "1 + new - old is only a first-order approximation of the ratio. Use the exponential.",
    ),
    loss_for_objective=(
        _MEAN,
        f"-{_MEAN}",
        _GRADIENT,
        f"-{_GRADIENT}",
        "This is the loss, which is to be minimised. Return the objective, which is to be "
        "maximised.",
    ),
    product_clipped=(
        _CLIPPED,
        "np.clip(ratio * A, 1.0 - clip, 1.0 + clip)",
        "The product is clipped. Clip the ratio first, then multiply it by the advantage.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "some hundred products", explain=coarse),
    examples=("ppo_objective([-1.0, -0.5], [-1.2, -1.0], [1.0, 2.0], 0.2)",),
    picture=gradients,
    slips=SLIPS
    + coarse_slips(
        "ppo_objective", "The gradient of one action in a large batch is a small number."
    )
    + value_slips("ppo_objective"),
)
