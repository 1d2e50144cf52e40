"""DBSCAN by hand: points on a line first, then blobs, chains, borders between two clusters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def clear(points: Array, eps: float) -> bool:
    """Return whether no distance is a close call."""
    distance = np.linalg.norm(points[:, :, None] - points[:, None, :], axis=0)
    return bool(np.abs(distance - eps).min() > 1e-8)


def cases(rng: np.random.Generator) -> list[Case]:
    """Return lines whose clusters one sees; then blobs with strays, in any order."""

    def line(label: str, xs: list[float], eps: float, least: int, level: str = "core") -> Case:
        points = np.outer([1.0, 0.0, 0.0], xs)
        return Case((np.asarray(points, dtype=float), eps, least), label, level)

    def blobs(
        label: str,
        count: int,
        eps: float,
        least: int,
        stray: int = 15,
        level: str = "core",
        flat: float = 1.0,
    ) -> Case:
        while True:
            middles = 0.12 * rng.normal(size=(3, count))
            points = [middle[:, None] + 0.02 * rng.normal(size=(3, 20)) for middle in middles.T]
            points.append(rng.uniform(-0.3, 0.3, (3, stray)))
            cloud = np.hstack(points) * np.array([[1.0], [1.0], [flat]])
            cloud = cloud[:, rng.permutation(cloud.shape[1])]
            if clear(cloud, eps):
                return Case((cloud, eps, least), label, level)

    # Two dense ends; the point between them is near one core point of each and no core itself.
    bridge = [0.0, 0.5, 1.0, 1.5, 2.4, 3.4, 3.9, 4.4, 4.9]
    grid = np.array([(3 * i, 4 * j, 0) for i in range(3) for j in range(3)]).T
    return [
        line("two parts", [0.0, 1.0, 2.0, 8.0, 9.0, 10.0], 1.5, 2, "simple"),
        line("two parts and a stray", [0.0, 1.0, 2.0, 5.0, 8.0, 9.0, 10.0], 1.5, 2, "simple"),
        line("three neighbours or more", [0.0, 1.0, 5.0, 6.0, 7.0], 1.2, 3, "simple"),
        line("exactly eps", [0.0, 2.0, 4.0, 6.0, 9.0], 2.0, 3),
        line("a border between two clusters", bridge, 1.1, 4),
        line("the same from the other end", bridge[::-1], 1.1, 4),
        line("a border point first", [0.0, 1.0, 1.2, 1.4, 9.0], 1.1, 4),
        line("a border point of the second", [3.3, 0.0, 0.5, 1.0, 4.0, 4.5, 5.0], 1.1, 3),
        Case((grid.astype(float), 3.0, 3), "a lattice, along x"),
        *(blobs(f"{n} blobs", n, eps, least) for n, eps, least in ((2, 0.03, 5), (4, 0.025, 6))),
        *(blobs("sparse", 3, 0.03, least) for least in (8, 10)),
        blobs("flat", 3, 0.02, 5, flat=0.0),
        blobs("mostly strays", 1, 0.04, 4, 60),
        blobs("every point is core", 2, 0.02, 1, level="edge"),
        blobs("nothing but noise", 1, 0.005, 6, level="edge"),
        Case((np.zeros((3, 0)), 1.0, 3), "no point", "edge"),
        Case((grid, 4, 4), "whole numbers on a lattice", "edge"),
    ]


def clusters(figure: Any, shown: Shown) -> None:
    """Plot the points from above, with the labels that came back and the right ones."""
    for i, (labels, name) in enumerate(((shown.got, "yours"), (shown.expected, "right"))):
        axes = figure.add_subplot(1, 2, i + 1, title=name, aspect="equal", xlabel="x [m]")
        for k in np.union1d(shown.got[0], shown.expected[0]):
            axes.plot(*shown.args[0][:2, labels[0] == k], "x" if k < 0 else "o", label=f"{k:.0f}")


_CORE = "core = near.sum(axis=1) >= least"
_BORDER = "labels[i] = labels[np.argmin(np.where(near[i] & core, distance[i], np.inf))]"
_GROW = "near[queue.pop()] & core & (labels < 0)"

SLIPS = slips(
    self_not_counted=(
        _CORE,
        _CORE.replace("axis=1)", "axis=1) - 1"),
        "A point is not counted among its own neighbours. Here, as in the paper, it is.",
    ),
    strict_distance=(
        "near = distance <= eps",
        "near = distance < eps",
        "Points at exactly eps are left out. They are neighbours.",
    ),
    border_left_as_noise=(
        _BORDER,
        "pass",
        "Border points stay noise. One that was noise when you met it is claimed by a cluster that "
        "is found later.",
    ),
    border_points_join=(
        _GROW,
        "near[queue.pop()] & (labels < 0)",
        "Border points hand the cluster on, so that two clusters become one over a single point. "
        "Only core points do.",
    ),
    all_points_core=(
        _CORE,
        "core = near.sum(axis=1) >= 1",
        "Every point is taken for a core point: these are chains, not dense places.",
    ),
    first_cluster_that_reaches=(
        _BORDER,
        "labels[i] = labels[near[i] & core].min()",
        "A border point goes to the first cluster that reaches it, so that the order of the points "
        "decides. The nearest core point does.",
    ),
    squared_distance=(
        "near = distance <= eps",
        "near = distance**2 <= eps",
        "The squared distance is compared with eps. Square both or none.",
    ),
    one_ring_only=(
        "                queue.append(j)\n",
        "",
        "A cluster takes the neighbours of its first point and stops. Go on from each core point.",
    ),
    numbered_from_one=(
        "    return labels",
        "    return np.where(labels < 0, 0, labels + 1)",
        "Noise is 0 and clusters begin at 1. Asked for are -1 and 0.",
    ),
    numbered_by_first_point=(
        "    return labels",
        "    found = list(dict.fromkeys(labels[labels "
        ">= 0]))\n    return np.array([found.index(k) if k >= 0 else -1 for k in labels])",
        "Clusters are numbered by their first points, border points included. The first core "
        "point decides.",
    ),
    clusters_from_one=(
        "    return labels",
        "    return np.where(labels >= 0, labels + 1, -1)",
        "Noise is -1, as it should be, but the first cluster is 1. Number the clusters from 0.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "labels are whole numbers"),
    examples=(
        "dbscan([[0, 1, 2, 9], [0, 0, 0, 0], [0, 0, 0, 0]], 1.5, 2)",
        "dbscan([[0, 1, 2, 9], [0, 0, 0, 0], [0, 0, 0, 0]], 1, 3)",
        "dbscan(np.zeros((3, 0)), 1.0, 3)",
    ),
    picture=clusters,
    slips=SLIPS + value_slips("dbscan", in_part=False, whole=False),
)
