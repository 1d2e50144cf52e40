"""Backpropagation: one unit and one sample, then batches, several outputs and saturated units."""

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return networks and batches of different sizes."""

    def net(
        label: str,
        level: str = "core",
        *,
        d: int = 3,
        h: int = 5,
        m: int = 2,
        n: int = 8,
        size: float = 1.0,
    ) -> Case:
        shapes = (d, n), (m, n), (h, d), (h,), (m, h), (m,)
        return Case(tuple(size * rng.normal(size=shape) for shape in shapes), label, level)

    whole = tuple(
        np.array(a)
        for a in (
            [[1, 0, -1], [0, 1, 1]],
            [[2, 0, 1]],
            [[1, 0], [-1, 1]],
            [0, 1],
            [[2, -1]],
            [1],
        )
    )
    return [
        net("one unit, one sample", "simple", d=1, h=1, m=1, n=1),
        net("one sample", "simple", n=1),
        net("one output", "simple", m=1),
        net("two samples", n=2),
        *(net("a batch") for _ in range(3)),
        net("a large batch", n=60, h=12, m=4),
        net("square weights", d=4, h=4, m=4),
        net("units that saturate", "edge", size=3.0),
        net("one unit", "edge", h=1),
        Case(whole, WHOLE, "edge"),
    ]


def components(figure: Any, shown: Shown) -> None:
    """Plot all components of the four gradients in a row."""
    axes = picture.plane(figure, "component: W1, b1, W2, b2", "gradient")
    for parts, style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(np.concatenate([np.ravel(part) for part in parts]), marker="o", ms=3, **style)
    axes.legend()


_ERROR = "error = (output - desired) / inputs.shape[1]"
_RETURN = "return back @ inputs.T, back.sum(axis=1), error @ hidden.T, error.sum(axis=1)"
_SLOPE = "(1.0 - hidden**2)"

SLIPS = slips(
    derivative_at_the_output=(
        _SLOPE,
        "(1.0 - np.tanh(hidden) ** 2)",
        "The derivative of tanh is evaluated at its output. Evaluate it at its input z: it is 1 - "
        "tanh(z)^2, which is 1 minus the square of the hidden value.",
    ),
    bias_divided_twice=(
        _RETURN,
        _RETURN.replace("sum", "mean"),
        "The bias gradients are divided by the batch size twice. The errors already contain 1 / "
        "n, so sum them.",
    ),
    batch_mean_forgotten=(
        _ERROR,
        "error = output - desired",
        "The mean over the batch is missing: this is the gradient of the sum.",
    ),
    mean_over_outputs_too=(
        _ERROR,
        "error = (output - desired) / output.size",
        "The mean is taken over the outputs as well. The loss sums over the outputs, because it "
        "is a squared length.",
    ),
    half_forgotten=(
        _ERROR,
        _ERROR.replace("(output", "2.0 * (output"),
        "The gradients are twice too large: the loss contains a factor of one half.",
    ),
    sign_of_the_error=(
        _ERROR,
        "error = (desired - output) / inputs.shape[1]",
        "The sign is wrong: this is the direction of descent. The gradient points towards a "
        "larger loss.",
    ),
    no_derivative=(
        f" * {_SLOPE}",
        "",
        "The error passes through tanh unchanged. Multiply it by the derivative of tanh.",
    ),
    derivative_of_a_sigmoid=(
        _SLOPE,
        "hidden * (1.0 - hidden)",
        "h (1 - h) is the derivative of the logistic function. The derivative of tanh is 1 - h^2.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "sums of some hundred products", explain=coarse),
    examples=("backprop([[1.0, 2.0]], [[0.0, 1.0]], [[0.5]], [0.0], [[1.0]], [0.0])",),
    picture=components,
    slips=SLIPS
    + coarse_slips("backprop", "A comparison with finite differences then says little.")
    + value_slips("backprop"),
)
