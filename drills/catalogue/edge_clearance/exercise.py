"""Clearance of a straight edge: values against the worked answer."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases from a simple one to those at the edge."""

    def draw(label: str, level: str = "core", *, m: int = 5, size: float = 3.0) -> Case:
        a, b = rng.uniform(-size, size, (2, 2))
        discs = np.column_stack(
            (rng.uniform(-2 * size, 2 * size, (m, 2)), rng.uniform(0.1, 1.0, m))
        )
        return Case((a, b, discs), label, level)

    a, b = rng.uniform(-1.0, 1.0, (2, 2))
    beyond = np.array([[*(b + share * (b - a)), 0.2] for share in (0.5, 2.0, -2.0)])
    return [
        Case(
            (np.zeros(2), np.array([2.0, 0.0]), np.array([[1.0, 0.8, 0.5]])),
            "beside the edge",
            "simple",
        ),
        Case(
            (np.zeros(2), np.array([2.0, 0.0]), np.array([[3.0, 0.0, 0.4]])),
            "beyond its end",
            "simple",
        ),
        *(draw("any") for _ in range(6)),
        Case((a, b, beyond), "in line with the edge"),
        draw("a short edge", size=0.05),
        Case((a, a.copy(), rng.uniform(0.1, 2.0, (3, 3))), "an edge of no length", "edge"),
        draw("no discs", "edge", m=0),
        Case((np.array([0, 0]), np.array([3, 1]), np.array([[1, 2, 1], [5, 5, 2]])), WHOLE, "edge"),
    ]


SLIPS = slips(
    line_for_segment=(
        "np.clip(share, 0.0, 1.0)",
        "share",
        "The edge is taken for an endless line: beyond its ends the nearest point is an end. "
        "Clamp the share to 0 and 1.",
    ),
    nearer_end_only=(
        "np.clip(share, 0.0, 1.0)",
        "np.round(np.clip(share, 0.0, 1.0))",
        "Only the two ends are compared. The nearest point may lie anywhere between them.",
    ),
    radius_forgotten=(
        "np.hypot(*(centres - nearest).T) - radius",
        "np.hypot(*(centres - nearest).T)",
        "That is the distance from the centre. Subtract the radius.",
    ),
    never_negative=(
        "return np.hypot(*(centres - nearest).T) - radius",
        "return np.maximum(np.hypot(*(centres - nearest).T) - radius, 0.0)",
        "The clearance is cut off at 0. A negative one says how deep the edge goes in.",
    ),
    length_not_squared=(
        "float(along @ along)",
        "float(np.sqrt(along @ along))",
        "The share is divided by the length; (c - a) . (b - a) has to be divided by its square.",
    ),
    nearest_of_all=(
        "return np.hypot(*(centres - nearest).T) - radius",
        "return np.atleast_1d(np.min(np.hypot(*(centres - nearest).T) - radius, initial=np.inf))",
        "One number came back, that of the nearest disc. Return one for each disc.",
    ),
    ray_for_segment=(
        "np.clip(share, 0.0, 1.0)",
        "np.maximum(share, 0.0)",
        "The edge has no end at b in your answer. Limit the share from both sides, to 0 and to 1.",
    ),
    squared_distance=(
        "np.hypot(*(centres - nearest).T)",
        "np.sum((centres - nearest) ** 2, axis=1)",
        "The radius is subtracted from the square of the distance. Take the root first.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "a projection and a root", explain=coarse),
    examples=(
        "edge_clearance([0, 0], [2, 0], [[1.0, 0.8, 0.5], [3.0, 0.0, 0.4]])",
        "edge_clearance([0, 0], [1, 1], [[1.0, 0.0, 1.0]])",
    ),
    slips=SLIPS
    + coarse_slips("edge_clearance", "An edge that just touches then seems free.")
    + value_slips("edge_clearance", in_part=False),
)
