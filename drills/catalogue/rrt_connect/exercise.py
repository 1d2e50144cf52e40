"""RRT-Connect with given samples: path and sizes of the trees; edges of a path judged exactly."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import Case, judge_of, largest_error
from drills.catalogue.rrt.worlds import GOAL, HIGH, LOW, START, clutter, fence, paths, ring
from drills.exercise import Exercise, slips, value_slips
from drills.geometry import path_faults

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Open ground, thick and thin discs, gates, and a goal that no path reaches."""

    def query(
        label: str,
        discs: Array,
        step: float,
        level: str = "core",
        samples: int = 100,
        start: Array = START,
        goal: Array = GOAL,
    ) -> Case:
        return Case((start, goal, discs, rng.uniform(LOW, HIGH, (samples, 2)), step), label, level)

    def gate() -> Array:
        posts = fence(float(rng.uniform(0.0, 2.0)), 0.25)
        return posts[np.abs(posts[:, 1] - rng.uniform(3.0, 7.0)) > 0.55]

    nothing, near = np.zeros((0, 3)), START + np.array([0.3, 0.2])
    middle = np.array([[*(0.5 * (START + GOAL)), 2.0]])
    return [
        query("no disc at all", nothing, 0.7, "simple"),
        query("one disc between", middle, 0.7, "simple"),
        query("one small step apart", nothing, 0.7, "simple", goal=near),
        *(query("thick discs", clutter(rng, 22, 0.4, 0.8), 0.5) for _ in range(2)),
        *(query("thin posts", clutter(rng, 90, 0.1, 0.2), 0.8) for _ in range(2)),
        *(query("a gate in a fence", gate(), step) for step in (0.3, 0.5, 0.9)),
        query("from the goal to the start", gate(), 0.5, start=GOAL, goal=START),
        query("a ring around the goal", ring(GOAL, 0.6, 0.1), 0.9, "edge", samples=40),
        query("a ring around the start", ring(START, 0.6, 0.1), 0.9, "edge", samples=40),
        query("a long step", clutter(rng, 22, 0.4, 0.8), 50.0, "edge"),
        query("no sample", nothing, 0.5, "edge", samples=0),
    ]


def honest(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check whether what came back as a path is one: that says more than its values."""
    start, goal, discs, _, step = case.args
    if (
        np.ndim(parts[0]) != 2
        or not len(parts[0])
        or largest_error(parts[0], np.shape(parts[0])) == np.inf
    ):
        return  # the comparison of the values says what is wrong with it
    result = path_faults(parts[0], start, goal, discs, np.array([LOW, HIGH]), step)
    attempt.require(
        f"{case.label}: the path",
        not result,
        sentence=f"What came back is no path: {result[0].sentence}." if result else "",
        call=call,
    )


_ROLES = "tree, other = trees[turn % 2], trees[1 - turn % 2]"
_MEET = "if grow(tree, sample, False) and grow(other, tree[0][-1], True):"
_FREE = "if not edge_is_free(nodes[near], new, discs):"
_STACK = "path = np.vstack((halves[0][::-1], halves[1][1:]))"

SLIPS = slips(
    blocked_steps_taken_back=(
        "discs):\n                return False",
        "discs):\n                if greedy:\n"
        "                    del nodes[len(offsets) :], parents[len(offsets) :]\n"
        "                return False",
        "Where the other tree is blocked on its way, its steps up to there are thrown away. They "
        "are free and belong to the tree: the next connection may begin at them.",
    ),
    one_step_only=(
        _MEET,
        "if grow(tree, sample, False) and grow(other, tree[0][-1], False) and "
        "np.array_equal(other[0][-1], tree[0][-1]):",
        "The other tree takes only one step towards the new node. It has to be greedy: step "
        "after step, until it arrives or is blocked. Without that you have two RRTs, and "
        "crossing open space takes one sample per step.",
    ),
    both_greedy=(
        _MEET,
        _MEET.replace("False", "True"),
        "Both trees are greedy. The tree that goes towards the sample takes a single step; only "
        "the other one goes all the way.",
    ),
    towards_the_sample=(
        _MEET,
        _MEET.replace("tree[0][-1], True", "sample, True") + "\n            "
        "other[0][-1] = tree[0][-1]",
        "The other tree goes towards the sample. Its target is the node that was just added, "
        "which is usually not the sample but one step towards it.",
    ),
    never_swapped=(
        _ROLES,
        "tree, other = trees",
        "The trees never swap roles. They swap after every sample, so that both explore.",
    ),
    swapped_when_grown=(
        "path = np.zeros((0, 2))",
        "path, order = np.zeros((0, 2)), list(trees)",
        _ROLES,
        "tree, other = order",
        _MEET,
        "added = grow(tree, sample, False)\n        if added:\n            order.reverse()\n"
        "        if added and grow(other, tree[0][-1], True):",
        "The trees swap only if a node was added. They swap after every sample, whatever "
        "happened with it.",
    ),
    ends_only=(
        _FREE,
        "if not edge_is_free(new, new, discs):",
        "Only the ends of each edge are checked. Check the segment between them.",
    ),
    last_edge_unchecked=(
        _FREE,
        _FREE.replace("if not", "if distance > step and not"),
        "The last edge, the one that reaches its target, is not checked.",
    ),
    half_not_turned=(
        _STACK,
        _STACK.replace("halves[0][::-1]", "halves[0]"),
        "The half from the start's tree runs backwards, from the meeting point to the start.",
    ),
    meeting_point_twice=(
        _STACK,
        _STACK.replace("halves[1][1:]", "halves[1]"),
        "The meeting point appears twice in the path, because it is in both trees.",
    ),
    path_of_the_last_turn=(
        "for nodes, parents in trees:",
        "for nodes, parents in (tree, other):",
        "If the goal's tree grew last, your path runs from the goal to the start.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "some dozen steps are added up: rounding", first=honest),
    examples=(
        "rrt_connect([0, 0], [3, 0], [], [[0, 1]], 1.5)[0]",
        "rrt_connect([0, 0], [3, 0], [[1.5, 0, 0.5]], [[1.4, 2], [2, -2]], 1.25)",
        "rrt_connect([0, 0], [3, 0], [[1.5, 0, 0.5]], [[1, 0]], 1)",
    ),
    picture=lambda figure, shown: paths(
        figure, shown.args[2], shown.args[:2], shown.got[0], shown.expected[0]
    ),
    slips=SLIPS + value_slips("rrt_connect", whole=False),
)
