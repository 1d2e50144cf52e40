"""The trees: every path is right, the budget holds, a seed is an answer, RRT is the drill's, RRT*
converges; samplers and neighbours do what they say."""

import math
import time
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from course import drills
from course.compiled import MATRIX, VECTOR, compiled
from course.planning import (
    Budget,
    Plan,
    Region,
    check_path,
    neighbours,
    plan,
    plane,
    problem,
    scenes,
)
from course.planning.samplers import SAMPLERS
from course.planning.trees import LONGEST
from tests.budget import examples, sampled

TREES = ("rrt", "rrt_connect", "rrt_star", "informed_rrt_star")
SCENES = scenes.all_scenes()


def planned(scene, method: str, budget=1500, rng=0, **options) -> Plan:
    return plan(
        scene.world,
        scene.start,
        scene.goal,
        method=method,
        budget=budget,
        rng=rng,
        **{"step": scene.step, **options},
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", TREES)
@pytest.mark.parametrize("scene", sampled(SCENES, 2), ids=lambda scene: scene.name)
def test_every_path_is_right(scene, method) -> None:
    for seed in range(6):
        result = planned(scene, method, rng=seed)
        assert result.samples <= 1500 and result.solved == (result.status == "solved")
        if result.path is not None:
            verdict = check_path(scene.world, result.path, scene.start, scene.goal)
            assert verdict, verdict.reason
            assert np.linalg.norm(np.diff(result.path, axis=1), axis=0).max() <= scene.step + 1e-12
        for i, parent in enumerate(result.parents[:40]):  # and of every edge of the tree
            if parent >= 0:
                assert check_path(scene.world, result.nodes[:, [parent, i]])


@pytest.mark.parametrize("method", TREES)
@pytest.mark.parametrize("step", [1e-3, 1e-6, 1e-12])
def test_a_budget_holds_for_any_step(method: str, step: float) -> None:
    """A chain of RRT-Connect takes distance / step nodes, which is any number."""
    world = plane([[0.0, 0.0], [10.0, 10.0]], discs=[[5.0, 5.0, 2.0]])
    result = plan(world, [1.0, 1.0], [9.0, 9.0], method=method, step=step, budget=60)
    assert result.samples <= 60 and len(result.nodes.T) <= 61 * (LONGEST + 3)


def test_a_long_chain_is_left_and_taken_up_again() -> None:
    """Ten thousand nodes: the arrays grow several times, and each thousand is a sample."""
    world = plane([[0.0, 0.0], [10.0, 10.0]])
    start, goal, step = [1.0, 1.0], [9.0, 8.0], 1e-3
    result = plan(world, start, goal, step=step, budget=200, rng=1)
    assert result.path is not None and check_path(world, result.path, start, goal)
    spacing = np.linalg.norm(np.diff(result.path, axis=1), axis=0)
    assert spacing.max() <= step + 1e-12 and result.path.shape[1] > 8 * LONGEST
    assert result.samples >= result.path.shape[1] // LONGEST
    parents, nodes = result.parents, result.nodes
    i = np.flatnonzero(parents >= 0)
    lengths = np.linalg.norm(nodes[:, i] - nodes[:, parents[i]], axis=0)
    np.testing.assert_allclose(result.costs[i], result.costs[parents[i]] + lengths, atol=1e-9)


@pytest.mark.parametrize("method", [*TREES, "prm", "lazy_prm"])
def test_compiling_is_no_part_of_a_time_budget(method: str, monkeypatch) -> None:
    """The clock here moves only while loops are compiled."""
    now = [0.0]

    def slow() -> None:
        now[0] += 100.0

    monkeypatch.setattr(problem.time, "perf_counter", lambda: now[0])
    monkeypatch.setitem(problem.LOOPS, method, slow)
    world = plane([[0.0, 0.0], [10.0, 10.0]])
    budget = Budget(50, seconds=1.0)
    result = plan(world, [1.0, 1.0], [9.0, 9.0], method=method, budget=budget)
    assert result.status in ("solved", "out of samples") and result.seconds == 0.0


@examples(25)
@given(st.integers(0, 10**6), st.floats(0.3, 3.0))
def test_rrt_is_the_drill(seed: int, step: float) -> None:
    rng = np.random.default_rng(seed)
    discs = np.column_stack((rng.uniform(0, 10, (25, 2)), rng.uniform(0.2, 0.8, 25)))
    start, goal, bounds = scenes.START, scenes.GOAL, scenes.SQUARE
    distance = np.minimum(*(np.hypot(*(discs[:, :2] - p).T) for p in (start, goal)))
    discs = discs[distance > discs[:, 2]]
    path, nodes, parents, samples = drills.rrt(
        start, goal, discs, bounds, step, 400, np.random.default_rng(seed)
    )
    result = plan(
        plane(bounds, discs),
        start,
        goal,
        method="rrt",
        budget=400,
        rng=np.random.default_rng(seed),
        step=step,
        goal_bias=drills.GOAL_BIAS,
    )
    np.testing.assert_allclose(result.nodes.T, nodes, atol=1e-12)
    assert np.array_equal(result.parents, parents) and result.samples == len(samples)
    assert result.solved == (path is not None)
    if path is not None and result.path is not None:
        np.testing.assert_allclose(result.path.T, path, atol=1e-12)


@pytest.mark.parametrize("method", TREES)
def test_a_seed_is_an_answer_and_the_budget_holds(method) -> None:
    scene = scenes.gap(0.02)
    one, same, other = (planned(scene, method, 777, seed) for seed in (3, 3, 4))
    assert np.array_equal(one.nodes, same.nodes) and np.array_equal(one.parents, same.parents)
    assert one.cost == same.cost and one.edge_checks == same.edge_checks
    assert not np.array_equal(one.nodes[:, 1:4], other.nodes[:, 1:4])
    shut = plane(scenes.SQUARE, boxes=[[4, 0, 5, 10]])
    closed = scenes.Scene("shut", shut, scenes.START, scenes.GOAL, 0.5)
    for budget in (1, 63, 1000):
        result = planned(closed, method, budget)
        assert (result.status, result.samples, result.path) == ("out of samples", budget, None)
    begun = time.process_time()
    result = planned(closed, method, Budget(10**9, 0.05))
    assert result.status == "out of time" and 0.05 <= result.seconds
    assert time.process_time() - begun < 1.0 and 0 < result.samples < 10**8


def test_a_tree_grows_beyond_its_first_arrays() -> None:
    """The same answer whether or not arrays were made larger on the way: nothing is drawn twice."""
    result = planned(scenes.empty(), "rrt_star", 6000)
    assert result.nodes.shape[1] > 5000 and result.samples == 6000
    goals = planned(scenes.discs(), "rrt_star", 6000).history
    first = planned(scenes.discs(), "rrt_star", 3000).history
    assert np.array_equal(goals[[0, 2]][:, : first.shape[1]], first[[0, 2]])


def test_what_is_wrong_with_start_or_goal_is_named() -> None:
    world = plane(scenes.SQUARE, discs=[[5, 5, 1]])
    inside, outside, free = [5.0, 5.5], [5.0, 11.0], [1.0, 1.0]
    for begin, end, status in (
        (inside, free, "start in collision"),
        (free, inside, "goal in collision"),
        (outside, free, "start out of bounds"),
        (free, outside, "goal out of bounds"),
    ):
        for method in TREES:
            result = plan(world, begin, end, method=method)
            assert (result.status, result.path, result.samples) == (status, None, 0)
    covered = Region(np.array([4.9, 4.9]), np.array([5.1, 5.1]))
    assert plan(world, free, covered).status == "goal in collision"
    nowhere = plan(world, free, free)
    assert nowhere.path is not None and nowhere.path.T.tolist() == [free]


@pytest.mark.parametrize("method", ["rrt", "rrt_connect", "rrt_star"])
def test_a_region_is_reached_anywhere(method) -> None:
    world = plane(scenes.SQUARE, discs=[[8, 8, 1]])
    region = Region(np.array([7.0, 7.0]), np.array([9.5, 9.5]))
    ends = []
    for seed in range(20):
        result = plan(world, [1, 1], region, method=method, budget=400, rng=seed)
        assert check_path(world, result.path, [1, 1], [region.low, region.high])
        assert result.path is not None
        ends.append(result.path[:, -1])
    if method == "rrt_star":
        np.testing.assert_allclose(ends, 7.0)  # the nearest of them
    else:
        assert len(np.unique(ends, axis=0)) > 10


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"start": [1.0]}, "start"),
        ({"goal": [1.0, np.nan]}, "goal"),
        ({"budget": 0}, "budget"),
        ({"budget": 1.5}, "budget"),
        ({"method": "a_star"}, "method"),
        ({"step": 0.0}, "step"),
        ({"goal_bias": 1.5}, "goal_bias"),
        ({"sampler": "sobol"}, "sampler"),
        ({"stepp": 1.0}, "stepp"),
        ({"spread": -1.0}, "spread"),
        ({"world": 3}, "world"),
        ({"goal": Region(np.ones(2), np.zeros(2))}, "goal.low"),
        ({"goal": Region(np.ones(2), 2 * np.ones(2)), "method": "informed_rrt_star"}, "goal"),
    ],
)
def test_a_wrong_question_is_refused_and_named(change, named) -> None:
    question: dict[str, Any] = {
        "world": plane(scenes.SQUARE),
        "start": [3.0, 3.0],
        "goal": [9.0, 9.0],
        **change,
    }
    with pytest.raises(ValueError, match=named):
        plan(**question)
    for seconds in (0.0, math.nan, "a", None):
        with pytest.raises(ValueError, match=r"budget\.seconds must be a positive number \[s\]"):
            Budget(1, seconds)  # pyrefly: ignore[bad-argument-type]


# --- RRT* -----------------------------------------------------------------------------------------

ONE_DISC = scenes.Scene(
    "one disc",
    plane(scenes.SQUARE, discs=[[5, 5, 2]]),
    np.array([1.0, 5.0]),
    np.array([9.0, 5.0]),
    2.0,
)
# Two tangents of sqrt(d^2 - r^2) and the arc between them.
OPTIMUM = 2 * math.sqrt(12) + 2 * (math.pi - 2 * math.acos(0.5))


@pytest.mark.parametrize("method", ["rrt_star", "informed_rrt_star"])
def test_rrt_star_keeps_its_books_and_converges(method) -> None:
    ratios = []
    for seed in range(3):
        result = planned(ONE_DISC, method, 4000, seed)
        lengths = np.linalg.norm(result.nodes - result.nodes[:, result.parents], axis=0)
        lengths[result.parents < 0] = 0.0
        above = np.where(result.parents < 0, 0.0, result.costs[result.parents])
        np.testing.assert_allclose(result.costs, above + lengths, rtol=1e-14)
        assert result.cost == pytest.approx(result.history[2, -1], rel=1e-13)
        assert (np.diff(result.history[2]) < 0.0).all()
        assert (result.history[2] >= OPTIMUM * (1 - 1e-12)).all()
        straight = np.linalg.norm(result.nodes - ONE_DISC.start[:, None], axis=0)
        assert (result.costs >= straight * (1 - 1e-12)).all()
        ratios.append(result.cost / OPTIMUM)
    early = [planned(ONE_DISC, method, 500, seed).cost / OPTIMUM for seed in range(len(ratios))]
    assert np.median(ratios) < min(1.012, np.median(early) - 0.001)


def test_no_edge_of_rrt_star_could_be_shortened_at_once() -> None:
    """What rewiring promises: where a node was the newest, no neighbour is a better parent."""
    result = planned(ONE_DISC, "rrt_star", 800, 5)
    best = result.costs.copy()
    new = result.nodes.shape[1] - 1
    near = np.linalg.norm(result.nodes - result.nodes[:, [new]], axis=0) < 0.5
    for i in np.flatnonzero(near):
        through = best[i] + np.linalg.norm(result.nodes[:, i] - result.nodes[:, new])
        if i != new and through < best[new] - 1e-12:
            assert not check_path(ONE_DISC.world, result.nodes[:, [i, new]])


# --- Samplers and neighbours ----------------------------------------------------------------------


@pytest.mark.parametrize("sampler", SAMPLERS)
def test_a_sampler_draws_what_its_name_says(sampler) -> None:
    """The targets themselves: with an endless step and a star of free edges they are the nodes."""
    wall = plane(scenes.SQUARE, discs=[[x, float(y), 0.4] for x in (3.0, 4.4) for y in range(11)])
    scene = scenes.Scene("rows", wall, np.array([0.5, 0.5]), np.array([9.5, 9.5]), 20.0)
    result = planned(scene, "rrt", 3000, 1, sampler=sampler, goal_bias=0.0, spread=0.5)
    if sampler in ("uniform", "halton"):
        assert result.state_checks == 2
    drawn = planned(scenes.empty(), "rrt_star", 2000, 1, sampler=sampler, goal_bias=0.0, step=20.0)
    if sampler == "halton":  # fills the square more evenly than chance
        chance = np.random.default_rng(0).uniform(0, 10, drawn.nodes.shape)
        even = [
            np.bincount((16 * (x // 0.625) + y // 0.625).astype(int)).var()
            for x, y in (drawn.nodes, chance)
        ]
        assert even[0] < 0.3 * even[1]
    near = np.min(np.abs(result.nodes[0][:, None] - [3, 4.4]), axis=1) < 0.9
    share = stats.binomtest(int(near.sum()), near.size, 0.32)
    if sampler in ("gaussian", "obstacle", "bridge") and near.size > 20:
        assert share.pvalue < 1e-3 and near.mean() > 0.5


@pytest.mark.prove
@pytest.mark.parametrize("n", [2, 4, 6])
def test_the_tree_of_neighbours_finds_what_looking_at_all_finds(n) -> None:
    rng = np.random.default_rng(n)
    whole, some = numba.int64, numba.int64[::1]
    tree = (MATRIX, whole[:, ::1], whole, whole)
    nearest = compiled(neighbours.nearest, whole(*tree, VECTOR, some, VECTOR))
    within = compiled(neighbours.within, whole(*tree, VECTOR, numba.float64, some, some))
    entered = compiled(neighbours.entered, whole(*tree))
    nodes = rng.uniform(0, 1, (2500, n))
    nodes[50:80] = nodes[20:50]  # the same place twice
    links = np.full((2500, neighbours.WIDTH), -1)
    stack, result, gaps = np.empty(2500, np.int64), np.empty(2500, np.int64), np.empty(2500)
    done = 0
    for count in (60, 500, 2100, 2500):
        done = entered(nodes, links, count, done)
        assert done in (0, count)
        for q in [*rng.uniform(-0.2, 1.2, (40, n)), nodes[60]]:
            squares = ((nodes[:count] - q) ** 2).sum(axis=1)
            for hung in {0, done}:
                at = nearest(nodes, links, count, hung, q, stack, gaps)
                assert squares[at] == pytest.approx(squares.min(), rel=1e-12)
                hits = within(nodes, links, count, hung, q, 0.3, stack, result)
                assert set(result[:hits]) == set(np.flatnonzero(squares <= 0.09))
    assert done == 2500


@pytest.mark.parametrize("n", [2, 4, 7])
def test_where_the_tree_takes_over_it_looks_at_few_nodes(n, monkeypatch) -> None:
    """One in twenty to one in five, and ever fewer beyond: so below it looking at all is faster,
    which is done in order and without a stack."""
    looks, distance, rng = [0], neighbours.to_node, np.random.default_rng(n)

    def counted(*arguments):
        looks[0] += 1
        return distance(*arguments)

    monkeypatch.setattr(neighbours, "to_node", counted)
    shares = []
    for count in (neighbours.brute_below(n) + 1, 4 * neighbours.brute_below(n)):
        nodes, links = rng.random((count, n)), np.empty((count, neighbours.WIDTH), np.int64)
        assert neighbours.entered(nodes, links, count, 0) == count
        stack, gaps, looks[0] = np.empty(count, np.int64), np.empty(count), 0
        for q in rng.random((20, n)):
            neighbours.nearest(nodes, links, count, count, q, stack, gaps)
        shares.append(looks[0] / (20 * count))
    assert 0.05 < shares[0] < 0.2 and shares[1] < 0.6 * shares[0]
