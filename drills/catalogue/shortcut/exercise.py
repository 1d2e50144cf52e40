"""Shortcuts with given draws: the path that is left, its edges and its length judged exactly."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import WHOLE, Case, judge_of, largest_error
from drills.catalogue.rrt.worlds import paths
from drills.exercise import Exercise, slips, value_slips
from drills.geometry import path_faults

Array = NDArray[np.float64]
EVERYWHERE = np.array([[-99.0, -99.0], [99.0, 99.0]])


def length(path: Any) -> float:
    """Return the total length of all edges."""
    return float(np.hypot(*np.diff(np.asarray(path, dtype=float), axis=0).T).sum())


def cases(rng: np.random.Generator) -> list[Case]:
    """Return one corner, then zigzags among discs beside the path, many of them blocking it."""

    def zigzag(
        label: str,
        corners: int,
        draws: int,
        radius: float = 0.6,
        gap: float = 1e-3,
        level: str = "core",
        count: int = 30,
    ) -> Case:
        """Return discs that touch the path but for a gap, or are smaller."""
        edges = rng.uniform(0.3, 2.0, corners + 1)
        x = np.concatenate(([0.0], np.cumsum(edges)))
        path = np.column_stack((x, rng.uniform(-1.5, 1.5, corners + 2)))
        discs = np.column_stack(
            (rng.uniform(0.0, x[-1], count), rng.uniform(-3.0, 3.0, count), np.full(count, radius))
        )
        distance = [
            min(_away(p, q, disc) for p, q in itertools.pairwise(path)) for disc in discs[:, :2]
        ]
        discs[:, 2] = np.minimum(discs[:, 2], np.array(distance) - gap)
        return Case((path, discs[discs[:, 2] > 0.02], rng.random((draws, 2))), label, level)

    corner = np.array([[0.0, 0.0], [1.0, 2.0], [2.0, 0.0]])
    one, far = np.array([[0.3, 0.6]]), np.array([[1.0, -5.0, 0.5]])
    tip = np.array([[1.0, 1.7, 0.1]])
    return [
        Case((corner, far, one), "one corner, one cut", "simple"),
        Case((corner, far, one[:, ::-1].copy()), "the farther place first", "simple"),
        Case((corner, tip, np.array([[0.1, 0.9]])), "a disc in the way", "simple"),
        zigzag("no disc", 4, 5, count=0),
        zigzag("a long zigzag, no disc", 12, 20, count=0),
        *(zigzag("among discs", corners, 30) for corners in (3, 6, 12)),
        *(zigzag("among small discs", corners, 30, 0.1) for corners in (8,)),
        zigzag("draw after draw", 8, 80),
        Case((corner, far, np.array([[0.1, 0.3], [0.6, 0.6]])), "on one edge", "edge"),
        Case((corner, tip, np.array([[0.1, 0.9], [0.48, 0.52]])), "a cut after a hit", "edge"),
        zigzag("no draw", 5, 0, level="edge"),
        zigzag("a straight path", 0, 5, level="edge"),
        Case((np.array([[0, 0], [0, 3], [4, 3]]), far, np.array([[0.25, 0.75]])), WHOLE, "edge"),
    ]


def _away(p: Array, q: Array, centre: Array) -> float:
    """Return the distance of a point to a segment: the best of many points on it will do here."""
    on = p + np.linspace(0.0, 1.0, 200)[:, None] * (q - p)
    return float(np.hypot(*(on - centre).T).min()) - 0.5 * math.dist(p, q) / 199


def honest(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check whether a path came back that is free and no longer than it was."""
    path, discs, _ = case.args
    if np.ndim(parts[0]) != 2 or largest_error(parts[0], np.shape(parts[0])) == np.inf:
        return  # the comparison of the values says what is wrong with it
    result = path_faults(parts[0], path[0], path[-1], discs, EVERYWHERE, np.inf)
    message = f"What came back is no path from end to end: {result[0].sentence}." if result else ""
    attempt.require(f"{case.label}: the path", not result, sentence=message, call=call)
    if not result:
        more = length(parts[0]) - length(path)
        attempt.require(
            f"{case.label}: its length",
            more <= 1e-9,
            sentence=f"The path has become longer, by {more:.4g} m.",
            error=max(more, 0.0),
            tolerance=1e-9,
            unit="m",
            why="rounding of a sum",
            call=call,
        )


_FREE = "if edge_is_free(p, q, discs):"
_PLACES = "places = np.sort(pair) * along[-1]"
_KEEP = "np.vstack((path[: i + 1], p, q, path[j + 1 :]))"

SLIPS = slips(
    not_checked=(_FREE, "if True:", "The new edge is not checked, so cuts go through discs."),
    points_only=(
        _FREE,
        "if edge_is_free(p, p, discs) and edge_is_free(q, q, discs):",
        "Only the ends of the new edge are checked. They lie on the path and are free anyway.",
    ),
    vertices_only=(
        _KEEP,
        "np.vstack((path[: i + 1], path[j + 1 :]))",
        "p, q = path[[i, j]] + share[:, None] * (path[[i + 1, j + 1]] - path[[i, j]])",
        "p, q = path[i], path[j + 1]",
        "You cut between vertices. The two points lie on edges, wherever the draw says, and "
        "become vertices. Only this removes corners whose neighbouring vertices can't see each "
        "other.",
    ),
    by_number_of_edges=(
        "(places - along[[i, j]]) / edges[[i, j]]",
        "places - [i, j]",
        _PLACES,
        "places = np.sort(pair) * len(edges)",
        'i, j = np.searchsorted(along, places, side="right") - 1',
        "i, j = np.floor(places).astype(int)",
        "A draw is treated as a fraction of the number of edges. It is a fraction of the "
        "length, so that long edges are tried more often.",
    ),
    order_of_the_draw=(
        "np.sort(pair)",
        "pair",
        "If the second fraction is smaller than the first, the path is assembled wrongly. Sort "
        "the two.",
    ),
    one_vertex_too_many=(
        _KEEP,
        _KEEP.replace("path[j + 1 :]", "path[j:]"),
        "A vertex before the second point stays, so the path runs back to it. Keep the vertices "
        "from j + 1 on.",
    ),
    one_vertex_too_few=(
        _KEEP,
        _KEEP.replace("path[: i + 1]", "path[: max(i, 1)]"),
        "The vertex before the first point is lost. The edge that replaces it was never checked.",
    ),
    stops_at_a_hit=(
        "            path = np.vstack",
        "            pass\n        else:\n            "
        "break\n        if True:\n            path = np.vstack",
        "The first cut that touches a disc ends the whole loop. Go on with the next draw.",
    ),
    split_edges=(
        "        if i == j:\n            continue\n",
        "",
        "Two places on one edge split it in three. Nothing is gained: leave the path as it is.",
    ),
    first_length_for_all=(
        "    for pair in np.asarray(draws, dtype=float):\n",
        "    whole = np.hypot(*np.diff(path, axis=0).T).sum()\n"
        "    for pair in np.asarray(draws, dtype=float):\n",
        _PLACES,
        "places = np.minimum(np.sort(pair) * whole, along[-1] * (1 - 1e-12))",
        "The fractions are those of the first path's length for all draws. Each cut makes the "
        "path shorter: measure it again for every draw.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "places on edges: rounding of a dozen cuts", first=honest),
    examples=(
        "shortcut([[0, 0], [1, 2], [2, 0]], [[1, -5, 0.5]], [[0.25, 0.75]])",
        "shortcut([[0, 0], [1, 2], [2, 0]], [[1, 1, 0.1]], [[0.25, 0.75]])",
        "shortcut([[0, 0], [1, 2], [2, 0]], [], [[0.1, 0.2], [0.75, 0.25]])",
    ),
    picture=lambda figure, shown: paths(
        figure, shown.args[1], shown.args[0], shown.got[0], shown.expected[0]
    ),
    slips=SLIPS + value_slips("shortcut", in_part=False),
)
