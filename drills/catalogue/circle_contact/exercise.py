"""Contact of two circles, judged at every distance of their centres."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return circles apart, overlapping, inside each other, and nearly concentric."""

    def direction() -> Array:
        angle = rng.uniform(-math.pi, math.pi)
        return np.array([math.cos(angle), math.sin(angle)])

    def pair(share: float, label: str, level: str = "core") -> Case:
        """Return centres apart by a share of the radii together."""
        centre, (r, s) = rng.uniform(-2.0, 2.0, 2), rng.uniform(0.3, 1.5, 2)
        return Case((centre, r, centre + share * (r + s) * direction(), s), label, level)

    def tiny(distance: float) -> Case:
        at = np.zeros(2)  # at the origin, where so small a distance can be told
        return Case((at, 0.4, distance * direction(), 0.7), "centres nearly coincide", "edge")

    r, s = rng.uniform(0.3, 1.0, 2)
    return [
        Case((np.zeros(2), r, np.array([2.5, 0.0]), s), "apart along x", "simple"),
        Case((np.zeros(2), r, np.array([0.0, 0.6 * (r + s)]), s), "overlap along y", "simple"),
        pair(rng.uniform(0.5, 0.9), "overlap", "simple"),
        *(pair(share, "overlap") for share in rng.uniform(0.3, 0.95, 3)),
        *(pair(share, "apart") for share in rng.uniform(1.1, 3.0, 3)),
        pair(1.0 + 1e-9, "nearly touching"),
        pair(rng.uniform(0.02, 0.1), "one inside the other"),
        Case((np.array([0.3, -0.2]), 0.5, np.array([0.3, -0.2]), 0.8), "the same centre", "edge"),
        tiny(1e-7),
        tiny(1e-20),
        tiny(1e-200),
        Case((rng.uniform(-1, 1, 2), 0.0, rng.uniform(2, 3, 2), 0.0), "two points", "edge"),
        Case((np.array([3, -1]), 2, np.array([7, 2]), 4), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> float:
    """Return 1e-12 of the largest length; of 1 for the normal, which is not longer."""
    centre_a, radius_a, centre_b, radius_b = case.args
    return 1e-12 * max(1.0, np.abs([*centre_a, *centre_b]).max(), radius_a, radius_b)


def circles(figure: Any, shown: Shown) -> None:
    """Plot both circles with the normal from the point."""
    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    centre_a, radius_a, centre_b, radius_b = shown.args
    around = np.linspace(0.0, 2.0 * math.pi, 100)
    for centre, radius in ((centre_a, radius_a), (centre_b, radius_b)):
        axes.plot(centre[0] + radius * np.cos(around), centre[1] + radius * np.sin(around), "k")
    size = 0.5 * (radius_a + radius_b) + 0.1
    for (_, normal, point), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        end = np.asarray(point) + size * np.asarray(normal)
        axes.plot([point[0], end[0]], [point[1], end[1]], marker="o", markevery=[0], **style)
    axes.legend()


SCALED = """    size = max(abs(x), abs(y))
    normal = np.array([1.0, 0.0])
    if size > 0.0:
        normal = np.array([x / size, y / size])
        normal = normal / math.hypot(*normal)
"""

SLIPS = slips(
    divided_by_zero=(
        SCALED,
        "    with np.errstate(all='ignore'):\n"
        "        normal = np.array([x, y]) / np.float64(distance)\n",
        "If the centres coincide, your normal is 0/0. The task requires (1, 0) there.",
    ),
    small_number_added=(
        SCALED,
        "    normal = np.array([x, y]) / (distance + 1e-9)\n",
        "A small number in the denominator avoids 0/0 but makes every normal too short: zero if "
        "the centres coincide, and wrong in the ninth digit elsewhere. Handle that one case "
        "separately.",
    ),
    threshold=(
        "if size > 0.0:",
        "if size > 1e-6:",
        "You treat centres that nearly coincide as if they did. Their direction still counts, "
        "however small the distance is.",
    ),
    squares_underflow=(
        SCALED,
        "    normal = np.array([1.0, 0.0])\n"
        "    length = math.sqrt(x * x + y * y)\n"
        "    if length > 0.0:\n"
        "        normal = np.array([x, y]) / length\n",
        "The square of 1e-200 underflows to zero, so your distance is zero. Divide x and y by the "
        "larger of them before you square, or use math.hypot.",
    ),
    from_b_to_a=(
        "x, y = q - p",
        "x, y = p - q",
        "Your normal points from b to a. It must point from the first circle to the second.",
    ),
    depth_for_gap=(
        "gap = distance - (radius_a + radius_b)",
        "gap = radius_a + radius_b - distance",
        "The sign of the gap is reversed: it is negative if the circles overlap. What you return "
        "is the depth.",
    ),
    one_radius_forgotten=(
        "(radius_a + radius_b)\n",
        "radius_a\n",
        "One radius is missing: the gap is the distance between the centres minus both radii.",
    ),
    on_the_surface_of_a=(
        "radius_a + 0.5 * gap",
        "radius_a",
        "Your point is on the surface of a. It should be halfway between the two surfaces: go on "
        "by half of the gap, which is negative for an overlap.",
    ),
    half_way_between_centres=(
        "p + (radius_a + 0.5 * gap) * normal",
        "0.5 * (p + q)",
        "Your point is halfway between the centres. That is right for equal radii only; the point "
        "should be halfway between the surfaces.",
    ),
    radii_swapped=(
        "(radius_a + 0.5 * gap)",
        "(radius_b + 0.5 * gap)",
        "Starting at the centre of a, go the radius of a, not that of b.",
    ),
    no_normal=(
        "normal = np.array([1.0, 0.0])\n",
        "normal = np.array([0.0, 0.0])\n",
        "If the centres coincide, your normal is zero. A contact without a direction cannot push "
        "anything; the task requires (1, 0).",
    ),
    not_a_unit_vector=(
        "normal = normal / math.hypot(*normal)",
        "normal = normal * min(1.0, distance)",
        "Your normal does not have length one. Divide the difference of the centres by its length.",
    ),
    gap_squared=(
        "distance - (radius_a + radius_b)",
        "distance**2 - (radius_a + radius_b) ** 2",
        "You compare squared lengths. That shows whether the circles overlap, but not by how much.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "a closed form: only the rounding of the coordinates remains",
        explain=coarse,
    ),
    examples=(
        "circle_contact(np.array([0.0, 0.0]), 1.0, np.array([3.0, 0.0]), 1.0)",
        "circle_contact(np.array([0.0, 0.0]), 1.0, np.array([0.9, 1.2]), 1.0)",
        "circle_contact(np.array([0.5, 0.5]), 0.2, np.array([0.5, 0.5]), 0.3)",
    ),
    picture=circles,
    slips=SLIPS
    + coarse_slips("circle_contact", "Touching circles then look as if there were a gap.")
    + value_slips("circle_contact"),
)
