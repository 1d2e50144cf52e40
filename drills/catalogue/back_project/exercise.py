"""Points of a depth picture: one pixel first, then pictures with holes, in metres and in counts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture as drawn
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return a pixel on the axis, a wall, a wall far off the axis; then pictures of all kinds."""

    def observed(
        label: str,
        rows: int = 7,
        columns: int = 9,
        holes: float = 0.0,
        level: str = "core",
        unit: float = 1.0,
        kind: type = float,
        fill: float = 0.0,
    ) -> Case:
        """Return a picture of depths from 0.3 to 4 m."""
        depth = rng.uniform(0.3, 4.0, (rows, columns)) / unit
        depth[rng.random(depth.shape) < holes] = fill
        fx, fy = rng.uniform(0.6, 1.4, 2) * columns
        cx, cy = rng.uniform(0.3, 0.7, 2) * (columns, rows)
        return Case((depth.astype(kind), fx, fy, cx, cy, unit), label, level)

    wall, steep = np.full((3, 5), 2.0), np.full((4, 6), 1.5)
    return [
        Case((np.array([[1.5]]), 9.0, 9.0, 0.0, 0.0, 1.0), "a pixel on the axis", "simple"),
        Case((wall, 5.0, 5.0, 2.0, 1.0, 1.0), "a wall", "simple"),
        Case((steep, 6.0, 4.0, -3.0, 9.0, 1.0), "a wall beside the axis", "simple"),
        *(observed("all pixels", *size) for size in ((7, 9), (12, 5), (1, 8))),
        *(observed("holes", holes=share) for share in (0.1, 0.6)),
        observed("holes that are NaN", holes=0.3, fill=np.nan),
        observed("millimetres", unit=1e-3),
        observed("millimetres, holes", holes=0.3, unit=1e-3),
        observed("unsigned counts of 1 mm", holes=0.2, unit=1e-3, kind=np.uint16),
        observed("unsigned counts of 0.1 mm", holes=0.2, unit=1e-4, kind=np.uint16),
        observed("nothing measured", holes=1.0, level="edge"),
        observed("nothing but NaN", holes=1.0, fill=np.nan, level="edge"),
        Case((np.array([[0, 3, 1], [2, 0, 5]]), 2, 4, 1, 1, 1), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> float:
    """Return 1e-12 of the farthest coordinate."""
    return 1e-12 * max(1.0, float(np.abs(truth[0]).max(initial=0.0)))


def from_above(figure: Any, shown: Shown) -> None:
    """Plot both clouds from above: x and z."""
    axes = drawn.plane(figure, "x [m]", "z [m]", equal=True)
    axes.plot(*shown.got[0][[0, 2]], "o", ms=6, **drawn.YOURS | {"lw": 0})
    axes.plot(*shown.expected[0][[0, 2]], ".", **drawn.RIGHT | {"ls": ""})
    axes.legend()


_RAYS = "x, y = (u - cx) / fx, (v - cy) / fy"
_POINTS = "return np.array([x * z, y * z, z])"
_SEEN = "v, u = np.nonzero(depth > 0.0)"

SLIPS = slips(
    range_for_depth=(
        _RAYS,
        f"{_RAYS}\n    z = z / np.sqrt(1.0 + x * x + y * y)",
        "The number is taken for the length of the ray. It is z: right on the axis either way, and "
        "towards the edge a flat wall would be a bowl.",
    ),
    u_and_v_swapped=(
        _SEEN,
        _SEEN.replace("v, u", "u, v"),
        "depth[v, u]",
        "depth[u, v]",
        "Columns and rows are swapped: the first index of an array is the row v, and y comes from "
        "it.",
    ),
    half_a_pixel=(
        _RAYS,
        _RAYS.replace("(u -", "(u + 0.5 -").replace("(v -", "(v + 0.5 -"),
        "Half a pixel is added. Here a pixel's centre is at the whole number.",
    ),
    holes_at_the_origin=(
        _SEEN,
        "v, u = np.indices(depth.shape).reshape(2, -1)",
        "Pixels without a measurement give points. They all lie at the origin, or are NaN: leave "
        "them out.",
    ),
    counts_for_metres=(
        "* float(unit)",
        "* 1.0",
        "The unit is not used: these are counts. Millimetres taken for metres make a cloud of the "
        "right form that is a thousand times too large.",
    ),
    only_zero_is_a_hole=(
        "depth > 0.0",
        "depth",
        "Zeros are left out and NaN is not. NaN is not 0: ask for what is greater than 0.",
    ),
    picture_centre_for_the_axis=(
        _RAYS,
        "x, y = (u - (depth.shape[1] - 1) / 2) / fx, (v - (depth.shape[0] - 1) / 2) / fy",
        "The axis is taken to meet the middle of the picture. cx and cy say where it does.",
    ),
    one_focal_length=(
        _RAYS,
        _RAYS.replace("fy", "fx"),
        "y is divided by fx. Pixels need not be square.",
    ),
    column_by_column=(
        _SEEN,
        "u, v = np.nonzero((depth > 0.0).T)",
        "The points come column by column. They are asked for row by row.",
    ),
    a_point_a_row=(
        _POINTS,
        f"{_POINTS}.T",
        "A point is a row here. The components are asked for along the first axis: (3, n).",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a quotient and a product: rounding", explain=coarse),
    examples=(
        "back_project([[0, 2], [4, 0]], 1.0, 1.0, 0.5, 0.5, 1.0)",
        "back_project(np.full((1, 3), 1500, dtype=np.uint16), 500.0, 500.0, 1.0, 0.0, 0.001)",
        "back_project(np.zeros((2, 2)), 1.0, 1.0, 0.0, 0.0, 1.0)",
    ),
    picture=from_above,
    slips=SLIPS
    + coarse_slips("back_project", "A micrometre is lost where a fit could see it.")
    # Every image here is of integers, so an answer that keeps their type is wrong in all cases.
    + value_slips("back_project", in_part=False, whole=False),
)
