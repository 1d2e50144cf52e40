"""Samples from a flow: uniform velocities, then exact fields of mixtures."""

from collections.abc import Callable
from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def mixture(centres: Any, width: float) -> Callable[[Any, float], Any]:
    """Return the flow field from a standard normal to a mixture of equal normals.

    Samples move along straight lines towards normals about the centres.
    """

    def field(x: Any, t: float) -> Any:
        variance, middles = (1.0 - t) ** 2 + (t * width) ** 2, np.asarray(centres)[:, :, None]
        away = np.asarray(x, dtype=float)[:, None] - t * middles
        square = np.sum(away**2, axis=0)
        share = np.exp(0.5 * (square.min(axis=0) - square) / variance)
        paths = middles + (t * width**2 - (1.0 - t)) / variance * away
        return np.sum(share / share.sum(axis=0) * paths, axis=1)

    return field


def cases(rng: np.random.Generator) -> list[Case]:
    """Return fields in one to three dimensions, and few and many steps."""

    def flow(
        label: str,
        level: str = "core",
        *,
        d: int = 2,
        modes: int = 2,
        steps: int = 5,
        n: int = 6,
        field: Any = None,
    ) -> Case:
        field = field or mixture(2.0 * rng.normal(size=(d, modes)), float(rng.uniform(0.2, 0.5)))
        return Case((field, rng.normal(size=(d, n)), steps), label, level)

    def wind(x: Any, t: float) -> Any:
        return 1.5 + 0.0 * np.asarray(x)

    def rising(x: Any, t: float) -> Any:
        return 3.0 * t**2 + 0.0 * np.asarray(x)

    return [
        flow("a steady wind", "simple", field=wind),
        flow("a rising wind", "simple", field=rising),
        flow("one mode", modes=1),
        *(flow("two modes") for _ in range(3)),
        flow("two modes, ten steps", steps=10),
        flow("three modes in three dimensions", d=3, modes=3),
        flow("one step", "edge", steps=1),
        flow("one sample", "edge", d=1, n=1),
        Case((rising, np.array([[1, -2]]), 2), WHOLE, "edge"),
    ]


def ends(figure: Any, shown: Shown) -> None:
    """Plot where the samples end, first component over the noise it came from."""
    axes, noise = picture.plane(figure, "noise", "sample"), np.asarray(shown.args[1])[0]
    for (part,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(noise, np.asarray(part)[0], **style | {"ls": "", "marker": "o"})
    axes.legend()


_MOVE = "x + 0.5 * h * (slope + field(x + h * slope, t + h))"

SLIPS = slips(
    time_reversed=(
        "t = k * h",
        "t = 1.0 - k * h",
        "t + h)",
        "t - h)",
        "Time runs backwards: here the noise is at time 0 and the samples are at time 1. Many "
        "diffusion models count the other way round.",
    ),
    one_step_too_few=(
        "range(steps)",
        "range(steps - 1)",
        "One step is missing, so the samples stop before time 1.",
    ),
    noise_at_the_end=(
        "return x",
        "return x + h * np.random.default_rng(0).normal(size=x.shape)",
        "Noise is added at the end. A flow samples noise only once, at the start; after that "
        "nothing is random.",
    ),
    time_of_the_wrong_end=(
        "slope = field(x, t)",
        "slope = field(x, t + h)",
        "The first velocity is evaluated at the time of the step's end. It belongs to the "
        "beginning of the step.",
    ),
    second_slope_too_early=(
        "slope, t + h)",
        "slope, t)",
        "The second velocity is evaluated at the time where the step began. It belongs to the end "
        "of the step.",
    ),
    euler=(
        _MOVE,
        "x + h * slope",
        "These are Euler steps: the second velocity is missing.",
    ),
    both_slopes_at_one_place=(
        "field(x + h * slope, t + h)",
        "field(x, t + h)",
        "The second velocity is evaluated at x, where the step began. Evaluate it where the first "
        "one leads.",
    ),
    midpoint=(
        _MOVE,
        "x + h * field(x + 0.5 * h * slope, t + 0.5 * h)",
        "This is the midpoint method: it is of second order too, but it is not Heun's.",
    ),
    sum_for_mean=(
        "0.5 * h *",
        "h *",
        "The velocities are added up. Use their mean, or each step goes twice as far.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "ten steps along a smooth field", explain=coarse),
    examples=(
        "flow_sample(lambda x, t: 2.0 * t + 0.0 * np.asarray(x), [[0.0, 1.0]], 3)",
        "flow_sample(lambda x, t: -np.asarray(x), [[1.0]], 1)",
    ),
    picture=ends,
    slips=SLIPS
    + coarse_slips("flow_sample", "The order of the method is then invisible.")
    + value_slips("flow_sample", in_part=False),
)
