"""A query of an unchecked roadmap: the route, and how many edges it took to be sure of it."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import Case, judge_of, largest_error
from drills.catalogue.rrt.worlds import paths
from drills.exercise import Exercise, slips, value_slips
from drills.geometry import edge_faults
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return a handful of points first, then roadmaps of forty among discs of all sizes."""

    def roadmap(
        label: str,
        discs: int,
        radius: float,
        level: str = "core",
        near: int = 6,
        count: int = 40,
        spread: float = 1.0,
    ) -> Case:
        """Return points, free of all discs, each joined to its nearest ones; corner to corner."""
        result = np.column_stack((rng.uniform(0.0, 10.0, (discs, 2)), np.full(discs, radius)))
        points = np.vstack(([0.5, 0.5], rng.uniform(0.0, 10.0, (4 * count, 2)), [9.5, 9.5]))
        distance = np.linalg.norm(points[:, None] - result[:, :2], axis=2)
        free = np.flatnonzero((distance > radius + 0.05).all(axis=1))
        retained = points[np.unique([0, *free[:count], len(points) - 1])]
        result = result[
            (np.linalg.norm(retained[[0, -1], None] - result[:, :2], axis=2) > radius + 0.05).all(
                axis=0
            )
        ]
        far = np.linalg.norm(retained[:, None] - retained, axis=2) + np.diag(
            np.full(len(retained), np.inf)
        )
        pairs = {
            (min(i, int(j)), max(i, int(j)))
            for i in range(len(retained))
            for j in np.argsort(far[i])[:near]
        }
        edges = rng.permuted(rng.permutation(np.array(sorted(pairs))), axis=1)
        return Case((retained, edges, result, 0, len(retained) - 1), label, level)

    def walled() -> Case:
        retained, edges, _, start, goal = roadmap("", 0, 0.0).args
        ring = np.linspace(0.0, 6.2, 40)
        posts = retained[goal] + 0.3 * np.column_stack((np.cos(ring), np.sin(ring)))
        clear = np.linalg.norm(retained[:, None] - posts, axis=2).min() - 1e-3
        discs = np.column_stack((posts, np.full(40, min(0.1, clear))))
        return Case((retained, edges, discs, start, goal), "the goal walled in", "edge")

    square = np.array([[0.0, 0.0], [1.0, 1.2], [1.0, -1.5], [2.0, 0.0]])
    sides = np.array([[0, 1], [1, 3], [0, 2], [2, 3], [0, 3]])
    post, island = np.array([[1.0, 0.0, 0.2]]), roadmap("", 5, 0.5).args
    return [
        Case((square, sides, np.zeros((0, 3)), 0, 3), "nothing in the way", "simple"),
        Case((square, sides, post, 0, 3), "the straight edge hits", "simple"),
        Case((square, sides, np.vstack((post, [1.5, 0.6, 0.1])), 0, 3), "two edges hit", "simple"),
        *(
            roadmap(f"{discs} discs", discs, radius)
            for discs, radius in ((4, 1.0), (12, 0.6), (25, 0.4), (60, 0.2))
        ),
        roadmap("many edges", 25, 0.4, near=10),
        Case((*roadmap("", 25, 0.4).args[:3], 7, 3), "between inner points"),
        walled(),
        roadmap("few edges", 12, 0.6, "edge", near=2),
        Case((*island[:3], 5, 5), "the goal is the start", "edge"),
        Case((island[0], np.zeros((0, 2), dtype=int), *island[2:]), "no edge", "edge"),
    ]


def honest(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check whether the route is one: edges of the roadmap that touch no disc."""
    points, edges, discs, *_ = case.args
    if np.ndim(parts[0]) != 1 or not 0.0 <= largest_error(parts[0], np.zeros(len(parts[0]))) < len(
        points
    ):
        return  # the comparison of the values says what is wrong with it
    route = [int(i) for i in parts[0]]
    known = {tuple(sorted(edge)) for edge in edges.tolist()}
    for i, j in itertools.pairwise(route):
        result = [fault.sentence for fault in edge_faults(points[i], points[j], discs, np.inf)]
        message = f"The route takes {i} to {j}: "
        message += f"{result[0]}." if result else "there is no such edge."
        right = not result and (min(i, j), max(i, j)) in known
        attempt.require(f"{case.label}: edges of the route", right, sentence=message, call=call)


def routes(figure: Any, shown: Shown) -> None:
    """Plot the roadmap and both routes."""
    points, edges, discs, *_ = shown.args
    ends = np.stack((*points[edges.T], np.full((len(edges), 2), np.nan)), axis=1)
    report = (
        np.clip(route[0].astype(int), 0, len(points) - 1) for route in (shown.got, shown.expected)
    )
    paths(figure, discs, ends.reshape(-1, 2), *(points[route] for route in report))


_TEST = "free[edge] = edge_is_free(points[i], points[j], discs)"
_KNOWN = "if edge not in free:"
_EDGE = "free.get((min(i, j), max(i, j)), True)"

SLIPS = slips(
    all_checked_first=(
        "    checks = 0\n",
        "    checks = len(edges)\n    for i, j in edges:\n"
        "        free[min(i, j), max(i, j)] = edge_is_free(points[i], points[j], discs)\n",
        "All edges are checked before the search. That is the ordinary PRM. A lazy one checks "
        "only the edges that a route uses, a small part of them.",
    ),
    checked_twice=(
        _KNOWN,
        "if True:",
        "Edges are checked again for every route. Store the results.",
    ),
    goes_on_after_a_hit=(
        "            if not free[edge]:\n                break\n        else:",
        "        if all(free[min(e), max(e)] for e in itertools.pairwise(route)):",
        "A route is checked to its end although one of its edges has collided. Stop there: the "
        "edges behind it may never be needed.",
    ),
    gives_up=(
        "                break\n        else:",
        "                return np.zeros(0), checks\n        else:",
        "You give up after the first route that collides. Remove that edge and search again.",
    ),
    not_checked=(
        _TEST,
        "free[edge] = True",
        "Nothing is checked, or only the points, which are free anyway. Lazy means later, not "
        "never.",
    ),
    points_dropped=(
        _EDGE,
        f"{_EDGE} and j not in {{max(e) for e, f in free.items() if not f}} - {{start, goal}}",
        "When an edge collides, you remove one of its points, and with it all other edges "
        "there. Remove only the edge.",
    ),
    fewest_edges=(
        "length = math.dist(points[i], points[j])",
        "length = 1.0",
        "The route has the fewest edges. The task asks for the shortest one in metres.",
    ),
    first_found=(
        "cost + length < best.get(j, np.inf)",
        "j not in best",
        "A point keeps the first route by which it was reached. A longer sequence of short "
        "edges may be a shorter route: update the point as long as it is in the queue.",
    ),
    one_way=(
        "        neighbours[j].append((i, length))\n",
        "",
        "Edges are used in one direction only, from the first index to the second.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "indices and counts: whole numbers", first=honest),
    examples=(
        "lazy_prm([[0, 0], [1, 1], [2, 0]], [[0, 1], [1, 2], [0, 2]], [[1, 0, 0.2]], 0, 2)",
        "lazy_prm([[0, 0], [1, 1], [2, 0]], [[0, 1], [1, 2], [0, 2]], [[1, 5, 0.2]], 0, 2)",
        "lazy_prm([[0, 0], [1, 1], [2, 0]], [[0, 1], [0, 2]], [[1, 0, 0.2]], 0, 2)",
    ),
    picture=routes,
    slips=SLIPS + value_slips("lazy_prm", whole=False),
)
