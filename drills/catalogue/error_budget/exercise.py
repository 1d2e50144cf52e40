"""An error budget: one stage, two that cancel, then four, each number against the worked answer."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return biases that cancel or add, noise, and two stages that act on each other."""

    def runs(
        label: str,
        level: str = "core",
        *,
        k: int = 4,
        n: int = 20,
        bias: float = 5e-3,
        noise: float = 3e-3,
        both: float = 0.3,
        opposed: bool = False,
    ) -> Case:
        real = np.arange(1 << k)[:, None] >> np.arange(k) & 1
        means = bias * rng.normal(size=(k, 2))
        if opposed:
            means[0], noise = [0.8 * bias, -0.6 * bias], 5e-4
            means[1] = -0.8 * means[0]
        single = means[:, None] + noise * rng.normal(size=(k, n, 2))
        errors = np.tensordot(real, single, 1)
        pairs = [(i, j) for i in range(k) for j in range(i)]
        for i, j in pairs:  # what one stage does is more where the other is at fault
            errors += both * (real[:, i] * real[:, j])[:, None, None] * single[i]
        return Case((errors + 1e-4 * rng.normal(size=(n, 2)),), label, level)

    return [
        runs("one stage", "simple", k=1),
        runs("one run, two stages", "simple", k=2, n=1),
        runs("biases alone", "simple", k=2, noise=0.0, both=0.0),
        runs("two that cancel", k=2, opposed=True),
        runs("three stages", k=3),
        *(runs("four stages") for _ in range(2)),
        runs("noise alone", bias=0.0),
        runs("four, two cancel", opposed=True),
        runs("five stages", "edge", k=5, n=5),
        Case((rng.integers(-9, 9, (8, 4, 2)),), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-12 of the largest error or of its square."""
    top = float(np.linalg.norm(case.args[0], axis=2).max())
    return [1e-12 * top, 1e-12 * top**2, 1e-12 * top**2]


def bars(figure: Any, shown: Shown) -> None:
    """Plot the shares, stage by stage."""
    axes = picture.plane(figure, "stage", "share of the mean squared error [m^2]")
    for values, style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(np.asarray(values[1], dtype=float), "o", **style | {"ls": "-"})
    axes.legend()


_SQUARE = "square = np.mean(np.sum(e**2, axis=2), axis=1)"
_MEAN = "np.mean(e, axis=1), square"
_WEIGHT = "weight = 1.0 / (k * math.comb(k - 1, s.bit_count()))"
_RETURN = "return parts[:, :2], parts[:, 2], np.array(mended)"

SLIPS = slips(
    parts_alone=(
        _WEIGHT,
        "weight = float(s == 0)",
        "Each stage was taken as real alone, and the squares were added. They add up to the "
        "whole only if the errors are independent and none has a mean.",
    ),
    share_is_what_its_repair_gains=(
        _WEIGHT,
        "weight = float(s.bit_count() == k - 1)",
        "The share is what making this stage alone ideal gains. If errors cancel, these gains "
        "don't add up to the whole: fixing one of two opposed stages makes it worse.",
    ),
    one_order_only=(
        _WEIGHT,
        "weight = float(s == (1 << i) - 1)",
        "The stages become real in one order only, and the shares depend on it. Average over "
        "all orders.",
    ),
    all_sets_alike=(
        _WEIGHT,
        "weight = 0.5 ** (k - 1)",
        "All sets have the same weight, as in Banzhaf's index: for three stages or more the "
        "shares don't add up. Average over the orders.",
    ),
    bias_averaged_away=(
        _SQUARE,
        "square = np.sum(np.var(e, axis=1), axis=1)",
        "That is the variance about the mean: a bias, which is the same in every run, is lost.",
    ),
    noise_averaged_away=(
        _SQUARE,
        "square = np.sum(np.mean(e, axis=1) ** 2, axis=1)",
        "The mean error is squared, so the noise, which differs from run to run, has been "
        "averaged away.",
    ),
    root_mean_square=(
        "axis=1)\n    values",
        "axis=1) ** 0.5\n    values",
        "The root is taken before the shares are computed. Mean squares add up; their roots do"
        " not.",
    ),
    signs_ignored=(
        _MEAN,
        "np.mean(np.abs(e), axis=1), square",
        "Absolute values are averaged instead of vectors: contributions in opposite directions"
        " then add instead of cancelling.",
    ),
    negative_share_refused=(
        _RETURN,
        _RETURN.replace("parts[:, 2]", "np.abs(parts[:, 2])"),
        "A share has lost its sign. A stage that cancels another's error has a negative share.",
    ),
    forced_to_sum=(
        _WEIGHT,
        "weight = float(s == 0)",
        _RETURN,
        _RETURN.replace(
            "parts[:, 2]", "parts[:, 2] * (square[-1] - square[0]) / parts[:, 2].sum()"
        ),
        "The errors of single real stages are scaled until they add up. That hides that they "
        "don't.",
    ),
    only_it_at_fault=(
        "square[-1 - (1 << i)]",
        "square[1 << i]",
        "That is the error with only this stage real. The task wants the error with only this "
        "stage ideal.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "sums of some dozen numbers: rounding", explain=coarse),
    examples=("error_budget([[[0.0, 0.0]], [[3.0, 0.0]], [[-2.0, 0.0]], [[1.0, 0.0]]])",),
    picture=bars,
    slips=SLIPS
    + coarse_slips("error_budget", "A budget that closes is a check; these digits are.")
    + value_slips("error_budget"),
)
