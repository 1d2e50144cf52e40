"""Drake's graphs of convex sets: the shortest path through convex regions of free space.

Marcucci, Petersen, von Wrangel and Tedrake, 2023, Motion planning around obstacles with convex
optimization. The regions are given; finding them is another problem. One convex optimisation
chooses the regions and the corners of the path; rounding then makes a path of its answer.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import invalid
from course.libraries import import_error
from course.oracles.quiet import quiet

Array = NDArray[np.float64]
ROUNDED = 5  # paths that rounding tries, Drake's default
Region = tuple[Array, Array]  # A (m, n) and b (m,) of A x <= b


@dataclass(frozen=True)
class Answer:
    """What the optimisation returned.

    Attributes:
        path: its corners, start and goal among them, shape (n, k), or None if there is none.
        seconds: of building the graph and solving [s].
    """

    path: Array | None
    seconds: float


def solve(start: ArrayLike, goal: ArrayLike, regions: Sequence[Region]) -> Answer:
    """Return the shortest path that is a line in each region that it passes.

    Args:
        start: in one of the regions, shape (n,).
        goal: likewise.
        regions: half spaces of bounded polytopes; two of them are joined where they meet.

    Raises:
        ValueError: without a region.
        ImportError: if Drake is not installed.
    """
    try:
        from pydrake.geometry.optimization import GraphOfConvexSetsOptions, HPolyhedron, Point
        from pydrake.planning import GcsTrajectoryOptimization
    except ImportError as error:
        install = "make platforms, or pip install 'drake>=1.51'"
        raise import_error("Drake", install, error) from error
    if not regions:
        raise invalid("regions", regions, "one region or more")
    begin, end = np.asarray(start, dtype=float), np.asarray(goal, dtype=float)
    clock = time.perf_counter()
    problem = GcsTrajectoryOptimization(begin.size)
    # Order 1: a line in each region. Times do not matter, so their bounds are wide.
    inside = problem.AddRegions(
        [HPolyhedron(A, b) for A, b in regions], order=1, h_min=0.0, h_max=100.0
    )
    source, target = (
        problem.AddRegions([Point(x)], order=0, h_min=0.0, h_max=0.0) for x in (begin, end)
    )
    problem.AddEdges(source, inside)
    problem.AddEdges(inside, target)
    problem.AddPathLengthCost()
    options = GraphOfConvexSetsOptions()
    # The convex relaxation is solved first; rounding tries several paths of its answer.
    options.convex_relaxation, options.max_rounded_paths = True, ROUNDED
    options.preprocessing = True
    with quiet():
        motion, result = problem.SolvePath(source, target, options)
    seconds = time.perf_counter() - clock
    if not result.is_success():
        return Answer(None, seconds)
    corners = [begin]
    for k in range(motion.get_number_of_segments()):
        corner = np.ravel(motion.value(motion.end_time(k)))
        if np.linalg.norm(corner - corners[-1]) > 1e-9:
            corners.append(corner)
    # The solver meets the goal to its tolerance only.
    corners[-1] = end
    return Answer(np.array(corners).T, seconds)
