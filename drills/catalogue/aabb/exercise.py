"""Two axis-aligned boxes: values against the worked answer."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return boxes that overlap, lie apart, lie inside each other, in one to six dimensions."""

    def box(d: int, size: float = 1.0, at: float = 1.0) -> Array:
        half = size * rng.uniform(0.2, 1.0, d)
        centre = rng.uniform(-at, at, d)
        return np.array([centre - half, centre + half])

    def near(a: Array, shift: Array) -> Array:
        """Return a box of another size whose centre is that of a, moved."""
        half = rng.uniform(0.3, 0.8, a.shape[1]) * 0.5 * (a[1] - a[0])
        centre = a.mean(axis=0) + shift * 0.5 * (a[1] - a[0])
        return np.array([centre - half, centre + half])

    def inside(d: int) -> Case:
        a = box(d)
        return Case((a, near(a, rng.uniform(-0.15, 0.15, d))), "one inside the other")

    def apart(d: int, axes: int, label: str) -> Case:
        a = box(d)
        shift = rng.uniform(-0.3, 0.3, d)
        chosen = rng.permutation(d)[:axes]
        shift[chosen] = rng.choice([-1.0, 1.0], axes) * rng.uniform(2.5, 4.0, axes)
        return Case((a, near(a, shift)), label)

    corner = np.array([[0.0, 0.0], [1.0, 1.0]])
    low = rng.uniform(0.1, 0.4)
    return [
        Case((corner, corner + [1.0 - low, 0.1]), "overlap at a side", "simple"),
        Case((corner, corner + [-0.1, low - 1.0]), "overlap from below", "simple"),
        Case((corner, corner + [2.0, 0.3]), "apart along x", "simple"),
        *(Case((box(d), box(d)), f"{d} dimensions") for d in (1, 2, 2, 3, 3, 4, 6)),
        inside(2),
        inside(3),
        apart(2, 1, "apart on one axis only"),
        apart(3, 1, "apart on one axis only"),
        apart(3, 3, "apart on all axes"),
        Case((corner, corner[:, ::-1] + [1.0, 0.25]), "just touching", "edge"),
        Case((corner, np.array([[0.2, 0.3], [0.9, 0.3]])), "a flat box", "edge"),
        Case((box(3, 1e3), box(3, 1e-3)), "boxes of very different size", "edge"),
        Case((box(2) + 1e3, box(2) + 1e3), "far from the origin", "edge"),
        Case((np.array([[0, 0], [4, 5]]), np.array([[3, 3], [9, 7]])), "integers", "edge"),
    ]


def boxes(figure: Any, shown: Shown) -> None:
    """Plot both boxes, and the second where the push moves it, in the first two dimensions."""
    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    a, b = (np.asarray(box, dtype=float) for box in shown.args)
    if a.shape[1] == 1:
        a, b = (np.column_stack((box, [0.0, 0.1])) for box in (a, b))

    def draw(box: Array, **style: Any) -> None:
        (x, y), (u, v) = box[:, :2]
        axes.plot([x, u, u, x, x], [y, y, v, v, y], **style)

    draw(a, color="k", label="a")
    draw(b, color="k", ls=":", label="b")
    for push, style in ((shown.got[1], picture.YOURS), (shown.expected[1], picture.RIGHT)):
        moved = np.zeros(b.shape[1])
        moved[: len(push)] = push
        draw(b + moved, **style)
    axes.legend()


OVERLAP, PUSH = "np.minimum(up, down)", "depth if up[axis] < down[axis] else -depth"

SLIPS = slips(
    shared_length=(
        OVERLAP,
        "np.minimum(high_a, high_b) - np.maximum(low_a, low_b)",
        "On an axis where one box lies inside the other, you return the length that both share. "
        "Getting out takes a longer move: the smaller of high_a - low_b and high_b - low_a.",
    ),
    largest_overlap=(
        "np.argmin(overlap)",
        "np.argmax(overlap)",
        "You choose the axis with the largest overlap. The shortest way out is along the axis with "
        "the smallest one, and a single axis with a gap keeps the boxes apart.",
    ),
    pushes_the_other=(
        PUSH,
        "-depth if up[axis] < down[axis] else depth",
        "The push has the right length but the opposite direction, so it moves b deeper into a. "
        "The push is the move of b.",
    ),
    always_up=(
        PUSH,
        "depth",
        "Your push always points up the axis. If b lies below a, down is the shorter way.",
    ),
    one_way_only=(
        OVERLAP,
        "up",
        "You only consider the move up, high_a - low_b. A box below a leaves faster by moving "
        "down, high_b - low_a. Take the smaller of the two.",
    ),
    two_axes_only=(
        "axis = int(np.argmin(overlap))",
        "axis = int(np.argmin(overlap[:2]))",
        "You only check the first two axes. Check all axes that the corners have.",
    ),
    pushed_when_apart=(
        "if depth > 0.0:",
        "if True:",
        "You push boxes that are apart. Return zeros for them.",
    ),
    gap_not_told=(
        "return depth, push",
        "return max(depth, 0.0), push",
        "You clip the depth at zero. If the boxes are apart, it is minus the largest gap.",
    ),
    centre_distance=(
        "axis = int(np.argmin(overlap))",
        "axis = int(np.argmax(np.abs(low_a + high_a - low_b - high_b)))",
        "You choose the axis on which the centres are farthest apart. The sizes of the boxes "
        "matter too: choose the axis with the smallest overlap.",
    ),
    half_of_it=(
        "push[axis] = depth",
        "push[axis] = 0.5 * depth",
        "else -depth",
        "else -0.5 * depth",
        "You push by half the depth, as if both boxes moved. Here only b moves.",
    ),
    low_and_high_swapped=(
        "up, down = high_a - low_b, high_b - low_a",
        "up, down = low_b - high_a, low_a - high_b",
        "The signs are reversed: an overlap, such as high_a - low_b, is positive; a gap is "
        "negative.",
    ),
    columns_for_rows=(
        "np.asarray(a, dtype=float), np.asarray(b, dtype=float)",
        "np.asarray(a, float).reshape(-1, 2).T, np.asarray(b, float).reshape(-1, 2).T",
        "You read the corners as columns. A box has two rows: its lowest and its highest "
        "coordinates.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: 1e-12 * float(max(np.abs(box).max() for box in case.args)),
        "the result is a difference of coordinates, so only rounding remains",
        explain=coarse,
    ),
    examples=(
        "aabb_contact(np.array([[0.0, 0.0], [2.0, 1.0]]), np.array([[1.5, 0.2], [3.0, 0.9]]))",
        "aabb_contact(np.array([[0.0, 0.0], [2.0, 1.0]]), np.array([[2.5, 0.2], [3.0, 0.9]]))",
        "aabb_contact(np.array([[0.0, 0.0, 0.0], [9.0, 9.0, 9.0]]), "
        "np.array([[1.0, 4.0, 3.0], [2.0, 5.0, 4.0]]))",
    ),
    picture=boxes,
    slips=SLIPS
    + coarse_slips("aabb_contact", "Touching boxes then look as if there were a gap.")
    + value_slips("aabb_contact", whole=False),
)
