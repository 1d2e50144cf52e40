"""RANSAC with triples drawn beforehand: clean tables first, then noise, boxes, two planes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import WHOLE, Case, either_sign, judge_of
from drills.exercise import Exercise, slips, value_slips

Array = NDArray[np.float64]
TOLERANCE, MARGIN = 0.01, 1e-7


def clear(points: Array, triples: Array) -> bool:
    """Return whether no point is close to the tolerance of a tried plane or of a refit."""
    best = 0
    for triple in triples:
        a, b, c = points[:, triple].T
        normal = np.cross(b - a, c - a)
        if not normal.any():
            continue
        normal /= np.linalg.norm(normal)
        away = np.abs(normal @ points - normal @ a)
        near = points[:, away <= TOLERANCE]
        if near.shape[1] > best:
            best, middle = near.shape[1], near.mean(axis=1, keepdims=True)
            U, _, _ = np.linalg.svd(near - middle, full_matrices=False)
            away = np.append(away, np.abs(U[:, 2] @ (points - middle)))
        if np.abs(away - TOLERANCE).min() < MARGIN:
            return False
    return True


def cases(rng: np.random.Generator) -> list[Case]:
    """Return a cloud of a table and of what else there is, in any pose before the camera."""

    def cloud(
        label: str,
        table: int = 40,
        stray: int = 0,
        noise: float = 0.0,
        drawn: int = 25,
        level: str = "core",
        sure: float = 0.99,
        second: int = 0,
        broken: int = 0,
    ) -> Case:
        while True:
            flat = rng.uniform(-0.5, 0.5, (3, table + second + stray))
            flat[2, :table] = noise * rng.normal(size=table)
            flat[2, table : table + second] = 0.15 + noise * rng.normal(size=second)
            flat[2, table + second :] = rng.uniform(0.03, 0.5, stray)
            Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            points = Q @ flat + rng.uniform([[-0.3], [-0.3], [0.7]], [[0.3], [0.3], [1.5]])
            points = points[:, rng.permutation(points.shape[1])]
            triples = np.array([rng.permutation(points.shape[1])[:3] for _ in range(drawn)])
            triples[:broken, 2] = triples[:broken, 0]
            if clear(points, triples):
                return Case((points, triples, TOLERANCE, sure), label, level)

    # Five points on the plane 3 x + 4 y = 10, whose unit normal (0.6, 0.8, 0) is no integer.
    whole = (
        np.array([[2, -2, 6, 2, -2, 1, 3], [1, 4, -2, 1, 4, 2, 3], [0, 1, 3, 4, 5, 0, 5]]),
        np.array([[0, 1, 2], [0, 1, 0], [0, 6, 1], [3, 4, 5]]),
        1,
        0,
    )
    return [
        cloud("only a table", level="simple"),
        cloud("a table and strays", 40, 10, level="simple"),
        cloud("one triple", drawn=1, level="simple"),
        *(cloud("few strays", 50, 10, 0.003) for _ in range(2)),
        *(cloud("as many strays", 40, 40, 0.003, 40) for _ in range(3)),
        *(cloud("noise as large as the tolerance", 50, 10, 0.008, 40) for _ in range(3)),
        *(cloud("two planes", 40, 5, 0.003, 30, second=30) for _ in range(2)),
        cloud("mostly strays", 20, 60, 0.003, 40),
        cloud("sure", 50, 20, 0.003, 60, sure=1 - 1e-9),
        cloud("an index twice", 40, 10, 0.003, broken=3),
        cloud("an index twice, never sure", 40, 10, 0.003, 9, sure=1 - 1e-12, broken=3),
        cloud("no confidence asked for", 40, 10, 0.003, sure=0.0, level="edge"),
        cloud("three points", 3, drawn=1, level="edge"),
        Case(whole, WHOLE, "edge"),
    ]


_FOUND = "near = np.flatnonzero(np.abs(distance) <= tolerance)"
_REFIT = "middle = points[:, best].mean(axis=1)"
_NEAR = "np.flatnonzero(np.abs(plane[:3] @ points + plane[3]) <= tolerance)"

SLIPS = slips(
    signed_distance=(
        _FOUND,
        "near = np.flatnonzero(distance <= tolerance)",
        "The distance has a sign: all points on one side of the plane count as near. Take its "
        "absolute value.",
    ),
    normal_not_unit=(
        "normal @ (points - a[:, None]) / area",
        "normal @ (points - a[:, None])",
        "The normal of a triple is not of unit length, so that what is compared with the tolerance "
        "is no distance: small triples count everything.",
    ),
    last_instead_of_best=(
        "if len(near) > len(best):",
        "if len(near):",
        "The last plane is kept instead of the best one.",
    ),
    no_refit=(
        "near = np.flatnonzero(np.abs(distance) <= tolerance)\n",
        "near = np.flatnonzero(np.abs(distance) <= tolerance)\n            here = normal / area\n",
        "best = near",
        "best, kept = near, np.append(here, -here @ a)",
        "plane = np.append(normal, -normal @ middle)",
        "plane = kept",
        "The plane is the one through three noisy points. Fit it to all points near it.",
    ),
    refit_to_all=(
        _REFIT,
        "best = np.arange(points.shape[1])\n    " + _REFIT,
        "The last fit takes all points, strays too. Only the points near the best plane may.",
    ),
    near_before_the_refit=(
        _NEAR,
        "best",
        "The plane is the refitted one, and the points are those near the plane before it.",
    ),
    outlier_share=(
        "share = len(best) / points.shape[1]",
        "share = 1.0 - len(best) / points.shape[1]",
        "The formula has the share of strays where that of near points belongs: it stops early "
        "exactly when most is rubbish.",
    ),
    share_of_one_point=(
        "share**3",
        "share",
        "The chance of a good triple is w^3, as all three must be near. w is that of one point.",
    ),
    never_stops_early=(
        "            break\n",
        "            pass\n",
        "All triples are tried, however sure it is. Stop when enough were.",
    ),
    broken_triples_not_counted=(
        "        tried += 1\n",
        "",
        "        if area > 0.0:\n",
        "        tried += area > 0.0\n        if area > 0.0:\n",
        "Triples that give no plane are not counted. They were drawn, so they count as tried.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases, 1e-9, "singular vectors of centred points: rounding", nearest=either_sign
    ),
    examples=(
        "plane_ransac([[0, 1, 0, 1], [0, 0, 1, 1], [2, 2, 2, 2]], [[0, 1, 2]], 0.01, 0.99)",
        "plane_ransac([[0, 1, 0, 5], [0, 0, 1, 5], [2, 2, 2, 9]], [[0, 1, 0], [1, 2, 0]], 1, 0.9)",
        "plane_ransac([[0, 1, 0, 5], [0, 0, 1, 5], [2, 2, 2, 9]], [[0, 1, 2]] * 9, 0.1, 0.9)[2]",
    ),
    slips=SLIPS + value_slips("plane_ransac"),
)
