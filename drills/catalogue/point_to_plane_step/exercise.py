"""One ICP step: shifts and small turns first, then noise, large turns, parts of a model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.catalogue.rigid_fit.exercise import brought
from drills.exercise import Exercise, coarse_slips, slips, value_slips

Array = NDArray[np.float64]


def turned(w: Array) -> Array:
    """Return the rotation of a vector, by its axes' images."""
    angle = float(np.linalg.norm(w))
    axis = w / max(angle, 1e-300)
    columns = np.eye(3)
    across = np.cross(axis, columns)
    return np.asarray(
        columns + np.sin(angle) * across + (1.0 - np.cos(angle)) * np.cross(axis, across)
    ).T


def clear(points: Array, model: Array, normals: Array) -> bool:
    """Return whether no match is a close call and all six numbers are told well."""
    distance = np.linalg.norm(points[:, :, None] - model[:, None, :], axis=0)
    first, second = np.partition(distance, 1, axis=1)[:, :2].T
    n = normals[:, distance.argmin(axis=1)]
    arms = points - points.mean(axis=1, keepdims=True)
    s = np.linalg.svd(np.hstack((n.T, np.cross(arms.T, n.T))))[1]
    return bool(np.all(second - first > 1e-6) and s[-1] > 0.03 * s[0])


def cases(rng: np.random.Generator) -> list[Case]:
    """Return a ball with dents as a model.

    A part of its points, moved back, is what was measured.
    """

    def part(
        label: str,
        n: int = 25,
        k: int = 25,
        *,
        shift: float = 0.0,
        turn: float = 0.0,
        noise: float = 0.0,
        far: float = 0.0,
        level: str = "core",
    ) -> Case:
        while True:
            normals = rng.normal(size=(3, k))
            normals /= np.linalg.norm(normals, axis=0)
            model = normals * np.array([[1.0], [0.7], [0.5]]) + far * rng.normal(size=(3, 1))
            middle = model.mean(axis=1, keepdims=True)
            Q = turned(turn * rng.normal(size=3))
            points = Q @ (model - middle) + middle + shift * rng.normal(size=(3, 1))
            points = (points + noise * rng.normal(size=(3, k)))[:, rng.permutation(k)[:n]]
            if clear(points, model, normals):
                return Case((points, model, normals), label, level)

    size = np.repeat(np.array([[3, 4, 5]]), 6, axis=0).T
    sides = np.hstack((np.eye(3, dtype=int), -np.eye(3, dtype=int)))
    faces = np.hstack((sides * size, sides * size + np.roll(sides, 1, axis=0)))
    whole = faces + np.eye(3, 12, dtype=int) + np.array([[0], [1], [0]])
    return [
        part("a shift", shift=0.02, level="simple"),
        part("a turn", turn=0.02, level="simple"),
        part("shift and turn", shift=0.02, turn=0.02, level="simple"),
        *(part("matches in another order", shift=0.05, turn=0.1) for _ in range(2)),
        *(part("noise", shift=0.05, turn=0.1, noise=0.02) for _ in range(2)),
        *(part("a part of the model", 15, 60, shift=0.05, turn=0.1) for _ in range(2)),
        *(part("a large turn", turn=0.4, k=40) for _ in range(2)),
        part("far from the origin", turn=0.1, shift=0.05, far=20.0),
        part("far from the origin, a part", 12, 40, turn=0.2, far=20.0),
        part("far off", shift=0.6, turn=0.5),
        part("many points", 60, 80, turn=0.1, noise=0.05),
        part("six points", 6, 8, turn=0.1, level="edge"),
        part("nothing to do", level="edge"),
        Case((whole, faces, np.hstack((sides, sides))), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-9 of R, and of the largest coordinate."""
    return [1e-9, 1e-9 * max(1.0, *(float(np.abs(value).max()) for value in case.args[:2]))]


_MATCH = "match = distance.argmin(axis=1)"
_GAP = "gap = np.sum(n * (model[:, match] - points), axis=0)"
_ROTATION = "R = np.eye(3) + np.sinc(angle / np.pi) * K + 0.5 * half**2 * K @ K"
_SHIFT = "return R, middle - R @ middle + t"

SLIPS = slips(
    cross_product_sign=(
        "np.cross(arms.T, n.T)",
        "np.cross(n.T, arms.T)",
        "The cross product has the wrong sign: every turn goes the wrong way. n . (w x arm) is "
        "(arm x n) . w.",
    ),
    turn_about_the_origin=(
        "middle = points.mean(axis=1)",
        "middle = np.zeros(3)",
        "The turn is about the origin of the frame. About the mean is asked for; far from the "
        "origin it makes a difference to the rotation that is applied.",
    ),
    shift_of_the_mean_for_p=(
        _SHIFT,
        "return R, t",
        "p is the shift of the mean. R turns about the origin, so p = c - R c + t.",
    ),
    not_a_rotation=(
        _ROTATION,
        "R = np.eye(3) + K",
        "I + [w] is no rotation: every step makes the part larger. Take the exponential of [w].",
    ),
    model_to_scene=(
        _MATCH + "\n    n = normals[:, match]",
        "match = np.arange(model.shape[1])\n    points = points[:, distance.argmin(axis=0)]\n"
        "    n = normals",
        "Each model point looks for its nearest measured one. Where the camera sees only a part, "
        "the rest of the model is then pulled into it.",
    ),
    matched_by_index=(
        _MATCH,
        "match = np.arange(points.shape[1])",
        "Points are matched by their index. Take the nearest one.",
    ),
    normals_by_index=(
        "n = normals[:, match]",
        "n = normals[:, : points.shape[1]]",
        "The normals are taken by the index of the measured point, not by that of its match.",
    ),
    gap_reversed=(
        _GAP,
        _GAP.replace("model[:, match] - points", "points - model[:, match]"),
        "The step goes the wrong way: the gap is from the point to its match.",
    ),
    shift_and_turn_swapped=(
        "np.hstack((n.T, np.cross(arms.T, n.T)))",
        "np.hstack((np.cross(arms.T, n.T), n.T))",
        "Shift and turn are read from each other's places in the solution.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "least squares in six numbers: rounding", explain=coarse),
    examples=(
        "point_to_plane_step([[2, -1, 0, 0, 0, 1], [0, 1, 1, -1, 0, 0], [0, 0, 1, 0, 1, -1]], "
        "[[1, -1, 0, 0, 0, 1], [0, 1, 1, -1, 0, 0], [0, 0, 1, 0, 1, -1]], "
        "[[1, 0, 0, 0, 1, 0], [0, 1, 0, 0, 0, 1], [0, 0, 1, 1, 0, 0]])",
    ),
    picture=brought,
    slips=SLIPS
    + coarse_slips("point_to_plane_step", "R is then no rotation to that digit.")
    + value_slips("point_to_plane_step"),
)
