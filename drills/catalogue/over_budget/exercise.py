"""The critical path of a small graph, and on it the first edge over its budget."""

from __future__ import annotations

import numpy as np

from drills.case_judge import Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return chains, two ways, then graphs with side branches and dead ends, in any order."""

    def graph(
        label: str,
        boxes: int,
        share: float,
        level: str = "core",
        over: float = 0.5,
        exact: bool = False,
    ) -> Case:
        """Return edges go up in a hidden order; a chain of all boxes, and a share of all others."""
        pairs = [
            (i, j)
            for i in range(boxes)
            for j in range(i + 1, boxes)
            if j == i + 1 or rng.random() < share
        ]
        pairs = [pairs[k] for k in rng.permutation(len(pairs))]
        names = rng.permutation(boxes)
        # A jump over many boxes is often the longer way.
        latencies = np.array(
            [rng.uniform(0.2, 1.0) * (j - i) ** rng.uniform(0, 2) for i, j in pairs]
        )
        budgets = latencies * np.where(rng.random(len(pairs)) < over, 0.7, 1.3)
        edges = np.array([(names[i], names[j]) for i, j in pairs])
        goal = names[-2] if boxes > 3 and share > 0.0 else names[-1]  # the last is a dead end
        budgets = latencies.copy() if exact else budgets
        return Case((edges, latencies, budgets, int(names[0]), int(goal)), label, level)

    def line(
        label: str, edges: list[list[int]], taken: list[float], allowed: list[float], level: str
    ) -> Case:
        return Case(
            (np.array(edges), np.array(taken), np.array(allowed), 0, len(edges)), label, level
        )

    return [
        line("three edges", [[1, 2], [0, 1], [2, 3]], [0.2, 0.1, 0.3], [0.1, 0.05, 0.1], "simple"),
        line("one to spare", [[0, 1], [1, 2]], [0.1, 0.3], [0.5, 0.2], "simple"),
        graph("a chain", 4, 0.0, "simple"),
        *(graph("a graph", n, 0.6) for n in (4, 5, 5, 6, 6, 7, 7)),
        *(graph("every pair", n, 1.0, over=0.8) for n in (5, 6, 7)),
        *(graph("few over budget", n, 0.7, over=0.3) for n in (6, 7, 8)),
        graph("all over budget", 6, 0.6, over=1.0),
        graph("none over budget", 6, 0.6, "edge", 0.0),
        graph("exactly on budget", 5, 0.6, "edge", exact=True),
        graph("start is goal's neighbour", 3, 1.0, "edge"),
    ]


_OVER = "over = [k for k in path if taken[k] > allowed[k]]"
_BEST = "best = max(best, (taken[k] + rest, [k, *path]))"
_NONE = "best: tuple[float, list[int]] = (-np.inf, [])"
_FIRST = "over[0] if over else -1"

SLIPS = slips(
    any_edge=(
        _OVER,
        "over = [k for k in range(len(boxes)) if taken[k] > allowed[k]]",
        "The first edge over its budget in the list is returned. It may not be on the critical "
        "path, where alone time matters.",
    ),
    in_order_of_the_list=(
        _OVER,
        "over = sorted(k for k in path if taken[k] > allowed[k])",
        "The edges of the path are gone through in the order of the list, not along the path.",
    ),
    shortest_way=(
        _NONE,
        "best: tuple[float, list[int]] = (np.inf, [])",
        _BEST,
        _BEST.replace("max(", "min("),
        "That is the shortest way. The command waits for the longest.",
    ),
    most_edges=(
        _BEST,
        "best = max(best, (taken[k] + rest, [k, *path]), "
        "key=lambda w: (np.isfinite(w[0]), len(w[1])))",
        "The way of the most edges is taken. It is the sum of their times that counts.",
    ),
    greedy=(
        _BEST,
        "best = max(best, (taken[k] + rest, [k, *path]), "
        "key=lambda w: taken[w[1][0]] if np.isfinite(w[0]) else -np.inf)",
        "From each box the slowest next edge is taken. A short edge may lead to a long way.",
    ),
    at_the_budget=(
        _OVER,
        _OVER.replace("> allowed", ">= allowed"),
        "An edge that takes exactly what it may is said to be over its budget.",
    ),
    last_one=(
        _FIRST,
        "over[-1] if over else -1",
        "The last edge over its budget is returned, or the path is followed from the goal.",
    ),
    worst_one=(
        _FIRST,
        "max(over, key=lambda k: taken[k] - allowed[k]) if over else -1",
        "The edge furthest over its budget is returned. Asked for is the first.",
    ),
    place_in_the_path=(
        _FIRST,
        "path.index(over[0]) if over else -1",
        "That is the place of the edge in the path, not its number in the list.",
    ),
    sum_of_all=(
        "return (over[0] if over else -1), total",
        "return (over[0] if over else -1), float(np.sum(latencies))",
        "The latency is that of all edges together. Branches run side by side.",
    ),
    total_against_total=(
        _OVER,
        "over = [k for i, k in enumerate(path) "
        "if sum(taken[j] for j in path[: i + 1]) > sum(allowed[j] for j in path[: i + 1])]",
        "Sums along the path are compared. Each edge has a budget of its own.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "sums of a few numbers: rounding", explain=coarse),
    examples=(
        "over_budget([[0, 1], [1, 2]], [0.1, 0.3], [0.2, 0.2], 0, 2)",
        "over_budget([[0, 1], [1, 2], [0, 2]], [0.1, 0.3, 0.5], [0.2, 0.2, 0.6], 0, 2)",
    ),
    slips=SLIPS + coarse_slips("over_budget", "Sums of budgets are compared to the microsecond."),
)
