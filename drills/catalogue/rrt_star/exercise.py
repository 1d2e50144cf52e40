"""The silent-bug hunt of chapter 5: trees of RRT*, whose costs must be those of their paths."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import Case, judge_of, largest_error
from drills.catalogue.rrt.worlds import GOAL, HIGH, LOW, START, clutter, fence, paths
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return trees too small to have a grandchild rewired, where the bug hides.

    Then larger ones.
    """

    def tree(
        label: str,
        discs: Array,
        samples: int,
        level: str = "core",
        step: float = 1.2,
        radius: float = 2.5,
        start: Array = START,
    ) -> Case:
        targets = rng.uniform(LOW, HIGH, (samples, 2))
        return Case((start, discs, targets, step, radius), label, level)

    nothing, gate = np.zeros((0, 3)), fence(1.0, 0.25)
    gate = gate[np.abs(gate[:, 1] - rng.uniform(3.0, 7.0)) > 0.55]
    return [
        tree("two samples", nothing, 2, "simple"),
        tree("three samples", nothing, 3, "simple"),
        *(tree("no disc", nothing, 40) for _ in range(2)),
        *(tree("thick discs", clutter(rng, 22, 0.4, 0.8), 50) for _ in range(2)),
        tree("thin posts", clutter(rng, 90, 0.1, 0.2), 50),
        tree("a gate in a fence", gate, 60),
        tree("from the other side", gate, 50, start=GOAL),
        tree("a small neighbourhood", clutter(rng, 22, 0.4, 0.8), 50, radius=1.2),
        tree("everything is a neighbour", clutter(rng, 22, 0.4, 0.8), 30, "edge", radius=99.0),
        tree("a long step", clutter(rng, 22, 0.4, 0.8), 30, "edge", step=50.0, radius=50.0),
        tree("no sample", nothing, 0, "edge"),
    ]


def honest(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check whether each cost is the length of its path: what must be true of every tree."""
    count = int(np.size(parts[1]))
    nodes, parents, costs = parts
    if (
        largest_error(nodes, np.zeros((count, 2))) + largest_error(parents, np.zeros(count))
        == np.inf
    ):
        return  # the comparison of the values says what is wrong with it
    up = np.asarray(parents).astype(int)
    if largest_error(costs, np.zeros(count)) == np.inf or (up >= count).any():
        return
    lengths = np.zeros(count)
    here = np.arange(count)
    for _ in range(count):  # all nodes go up by one edge at a time
        going = up[here] >= 0
        edge = np.asarray(nodes)[here] - np.asarray(nodes)[up[here]]
        lengths += np.where(going, np.hypot(*edge.T), 0.0)
        here = np.where(going, up[here], here)
    more = np.abs(np.asarray(costs) - lengths)
    worst = int(more.argmax())
    attempt.require(
        f"{case.label}: costs and paths",
        bool(more[worst] <= 1e-9),
        sentence=f"Node {worst} has the cost {float(costs[worst]):.6g} m, and its path from the "
        f"root, added up edge by edge, is {lengths[worst]:.6g} m long.",
        error=float(more[worst]),
        tolerance=1e-9,
        unit="m",
        why="rounding of a sum",
        call=call,
    )


def trees(figure: Any, shown: Shown) -> None:
    """Plot both trees among the discs."""

    def lines(explain: Any) -> Array:
        nodes, up = np.asarray(explain[0]), np.clip(np.asarray(explain[1], dtype=int), 0, None)
        ends = (nodes, nodes[np.minimum(up, len(nodes) - 1)], np.full(nodes.shape, np.nan))
        return np.stack(ends, axis=1).reshape(-1, 2)

    paths(figure, shown.args[1], shown.args[:1], lines(shown.got), lines(shown.expected))


_SUBTREE = """                below = [i]
                while below:  # what hangs on the node gets nearer too
                    costs[below[-1]] -= saved
                    last = below.pop()
                    below += [k for k, p in enumerate(parents) if p == last]
"""
_NODE = "                costs[i] -= saved\n"
_PARENT = "parent = min([near, *around], key=lambda i: costs[i] + distance[i])"
_AROUND = "around = [i for i in around if i == near or edge_is_free(points[i], new, discs)]"
_END = "    return np.array(nodes), np.array(parents), np.array(costs)"

SLIPS = slips(
    bug_still_there=(
        _SUBTREE,
        _NODE,
        "The bug is still there: a rewired node gets a new cost, and its descendants keep the "
        "old one. Later parents are then chosen by costs that are too high.",
    ),
    children_only=(
        _SUBTREE,
        f"{_NODE}                for k, p in enumerate(parents):\n"
        "                    if p == i:\n                        costs[k] -= saved\n",
        "The costs of the children are updated, and those of their children are not. Update the "
        "whole subtree.",
    ),
    mended_at_the_end=(
        _SUBTREE,
        _NODE,
        _END,
        "    for _ in nodes:\n        for k, p in "
        "enumerate(parents[1:], 1):\n            costs[k] = costs[p] + "
        f"float(np.hypot(*(nodes[k] - nodes[p])))\n{_END}",
        "The costs are right at the end, but they were out of date while parents were chosen, "
        "so the tree is a different one. Update them whenever a node is rewired.",
    ),
    cost_of_the_parent=(
        _SUBTREE,
        _SUBTREE.replace(
            "costs[below[-1]] -= saved", "costs[below[-1]] = cost + distance[below[-1]]"
        ),
        "All nodes of the subtree get costs as if they were connected to the new node directly. "
        "Each keeps its own parent, and its cost falls by what was saved.",
    ),
    rewired_unchecked=(
        _AROUND,
        "around = around",
        "The check of the new edges is missing, so the tree goes through discs.",
    ),
    nearest_parent=(
        _PARENT,
        "parent = near",
        "The nearest node becomes the parent, as in RRT. RRT* takes the neighbour that gives "
        "the shortest path from the start.",
    ),
    not_rewired=(
        "if saved > 0.0:",
        "if False:",
        "Nothing is rewired any more. The costs are then right, but the paths are not short.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "sums of some dozen edges: rounding", first=honest),
    examples=(
        "rrt_star([0, 0], [], [[1, 1], [2, 0]], 5, 5)",
        "rrt_star([0, 0], [], [[0, 2], [1, 3], [2, 3], [1, 1]], 2.5, 2.5)[2]",
        "rrt_star([0, 0], [[1, 0, 0.5]], [[2, 0], [1, 1], [2, 0.5]], 2, 3)[1]",
    ),
    picture=trees,
    slips=SLIPS + value_slips("rrt_star", whole=False),
)
