"""Areas of radar charts: three axes, where no order matters, then up to seven."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return values on axes of which more or fewer have their best end below."""

    def chart(
        label: str,
        level: str = "core",
        *,
        n: int = 5,
        below: int = 2,
        equal: bool = False,
        beyond: int = 0,
    ) -> Case:
        worst = 10.0 ** rng.uniform(-4.0, 3.0, n)
        decades = rng.uniform(1.0, 4.0, n) * np.where(np.arange(n) < below, -1.0, 1.0)
        best = worst * 10.0 ** rng.permutation(decades)
        share = np.full(n, 0.6) if equal else rng.uniform(0.15, 0.95, n)
        share[:beyond] = rng.permutation([-0.3, 1.4, 1.2])[:beyond]
        return Case((worst * (best / worst) ** share, worst, best), label, level)

    whole = np.array([2, 30, 5, 7]), np.array([1, 1, 9, 1]), np.array([10, 100, 2, 20])
    return [
        chart("three axes", "simple", n=3, below=0),
        chart("all alike", "simple", equal=True),
        chart("larger is better", below=0),
        chart("smaller is better", below=5),
        *(chart("five axes") for _ in range(3)),
        chart("four axes", n=4),
        chart("six axes", n=6),
        chart("seven axes", "edge", n=7),
        chart("beyond the ends", "edge", beyond=3),
        Case(whole, WHOLE, "edge"),
    ]


def bars(figure: Any, shown: Shown) -> None:
    """Plot from the smallest to the largest area."""
    axes = picture.plane(figure, "area, smallest and largest", "")
    for row, (pair, style) in enumerate(
        ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT))
    ):
        axes.plot([float(one) for one in pair], [row, row], marker="o", **style)
    axes.legend()


_RADIUS = "radius = np.clip(np.log(value / low) / np.log(high / low), 0.0, 1.0)"
_CORNERS = "np.sum(ring * np.roll(ring, 1, axis=1), axis=1)"
_AREAS, _RING = "np.sin(2.0 * np.pi / n) / 2.0 * corners", "ring = radius[np.array(orders)]"

SLIPS = slips(
    linear_scale=(
        _RADIUS,
        "radius = np.clip((value - low) / (high - low), 0.0, 1.0)",
        "The axes are linear. Over decades everything but the best is then at the centre; the task "
        "asks for logarithms.",
    ),
    larger_is_better=(
        _RADIUS,
        "radius = np.clip(np.log(value / np.minimum(low, high)) / "
        "np.abs(np.log(high / low)), 0.0, 1.0)",
        "The smaller end is taken for the worst on every axis: where smaller is better the value "
        "is mirrored.",
    ),
    not_clipped=(
        _RADIUS,
        "radius = np.log(value / low) / np.log(high / low)",
        "A value beyond its axis is drawn beyond it. It ends at the end, and at the centre.",
    ),
    ring_not_closed=(
        _CORNERS,
        "np.sum(ring[:, 1:] * ring[:, :-1], axis=1)",
        "The triangle between the last axis and the first is missing.",
    ),
    sine_forgotten=(
        _AREAS,
        "corners / 2.0",
        "The angle between the axes is missing: two sides and the sine between them.",
    ),
    half_forgotten=(
        _AREAS,
        "np.sin(2.0 * np.pi / n) * corners",
        "The half of the triangles is missing.",
    ),
    half_the_angle=(
        _AREAS,
        "np.sin(np.pi / n) / 2.0 * corners",
        "The angle is half of what it is: n axes share a full turn, 2 pi.",
    ),
    order_as_given=(
        _RING,
        "ring = radius[None, :]",
        "Only the order in which the values came is looked at.",
    ),
    sorted_is_largest=(
        "return float(areas.min()), float(areas.max())",
        "ranked = np.sort(radius)\n"
        "    top = np.sin(2.0 * np.pi / n) / 2.0 * np.sum(ranked * np.roll(ranked, 1))\n"
        "    return float(areas.min()), float(top)",
        "The largest area is taken to be the sorted one. There the greatest stands beside the "
        "least; it is largest with its neighbours on both sides.",
    ),
    sectors=(
        _CORNERS,
        "np.sum(ring**2, axis=1)",
        "These are sectors of circles: no neighbour matters, and so no order. The chart's corners "
        "are joined by straight lines.",
    ),
    swaps_only=(
        "for others in permutations(range(1, n))]",
        "for k in range(1, n) for others in [tuple(range(k, n)) + tuple(range(1, k))]]",
        "Only turns of the row are tried, not all orders of it.",
    ),
    degrees_in_the_sine=(
        "np.sin(2.0 * np.pi / n)",
        "np.sin(360.0 / n)",
        "The angle between two axes is given to the sine in degrees. It takes radians: 2 pi / n.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "a sum of a few products: rounding", explain=coarse),
    examples=("radar_areas([10, 100, 10, 1000, 30], [1, 1, 100, 1, 1], [100, 1000, 1, 1e4, 100])",),
    picture=bars,
    slips=SLIPS
    + coarse_slips("radar_areas", "Two orders differ by less than one thinks.")
    + value_slips("radar_areas", swapped=True),
)
