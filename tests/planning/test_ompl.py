"""Ours beside OMPL: the same algorithms, so the same distributions; each other's paths judged."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy import sparse, stats

from course.charts.planning import constraints
from course.kinematics import panda
from course.oracles import ompl
from course.planning import (
    Plan,
    build_roadmap,
    check_path,
    length,
    manifold,
    plan,
    plane,
    scenes,
    shelf,
)
from course.planning.roadmaps import FREE

SEEDS = range(1, 61)
BUDGET = 3000
SCENES = [*scenes.all_scenes(), scenes.gap(0.02, 0.05), scenes.gap(0.02, 2.0)]
QUICK = [scenes.gap(0.1), scenes.discs(), scenes.arm()]


def ours(scene: scenes.Scene, method: str, seed: int, budget: int = BUDGET) -> Plan:
    return plan(
        scene.world,
        scene.start,
        scene.goal,
        method=method,
        budget=budget,
        rng=seed,
        step=scene.step,
    )


def theirs(scene: scenes.Scene, method: str, seed: int, budget: int = BUDGET) -> Any:
    return ompl.solve(
        scene.world.bounds,
        scene.start,
        scene.goal,
        method,
        scene.step,
        budget,
        seed,
        *ompl.tests(scene.world),
    )


def power(sample: np.ndarray, share: float = 0.95, draws: int = 200) -> float:
    """The least factor on all values that the rank test would see, at 5 %, with a probability of
    `share`: from draws with replacement out of the sample itself."""
    rng = np.random.default_rng(0)
    for factor in (1.1, 1.2, 1.35, 1.5, 1.75, 2.0, 3.0, 5.0):
        one, other = rng.choice(sample, (2, draws, sample.size))
        observed = stats.mannwhitneyu(one, factor * other, axis=1).pvalue < 0.05
        if observed.mean() >= share:
            return factor
    return math.inf


def compare(scene: scenes.Scene, method: str, seeds: range) -> None:
    """Samples, lengths and success are of one distribution, and each judges the other's paths."""
    free, joined = ompl.tests(scene.world)
    mine, other = [], []
    for seed in seeds:
        result, answer = ours(scene, method, seed), theirs(scene, method, seed)
        if result.path is not None:  # by what OMPL was handed, and by its own interpolation
            states = result.path.T
            assert all(free(q) for q in states)
            assert all(joined(a, b) for a, b in pairwise(states))
        if answer.path is not None:
            assert check_path(scene.world, answer.path.T, scene.start, scene.goal)
        path = math.inf if answer.path is None else length(answer.path.T)
        mine.append((result.samples, result.cost))
        other.append((answer.samples, path))
    samples, costs = zip(np.transpose(mine), np.transpose(other), strict=True)
    if np.ptp(np.concatenate(samples)):
        assert stats.mannwhitneyu(*samples).pvalue > 1e-4
    solved = [np.isfinite(c) for c in costs]
    retained = [c[s] for c, s in zip(costs, solved, strict=True)]
    assert stats.mannwhitneyu(*retained).pvalue > 1e-4
    table = [[s.sum(), (~s).sum()] for s in solved]
    assert stats.fisher_exact(table).pvalue > 1e-4


@pytest.mark.prove
@pytest.mark.parametrize("method", ["rrt", "rrt_connect"])
@pytest.mark.parametrize("scene", QUICK, ids=lambda scene: scene.name)
def test_samples_and_lengths_come_from_one_distribution(scene, method) -> None:
    compare(scene, method, SEEDS)


def compare_roadmaps(scene: scenes.Scene, seeds: range) -> None:
    """Of as many free states: as many edges, as many parts, start and goal as often joined."""
    kinds: tuple[list[Any], list[Any]] = ([], [])
    for seed in seeds:
        mine = build_roadmap(scene.world, 60, seed, neighbours=10)
        other = ompl.roadmap(scene.world.bounds, len(mine.nodes), seed, *ompl.tests(scene.world))
        for kind, (nodes, pairs) in zip(
            kinds, ((mine.nodes, mine.pairs[mine.status == FREE]), other), strict=True
        ):
            matrix = sparse.coo_matrix((np.ones(len(pairs)), pairs.T), (len(nodes),) * 2)
            _, part = sparse.csgraph.connected_components(matrix, directed=False)
            several = int(np.sum(np.bincount(part) > 1))  # OMPL doesn't hand out single states
            near = np.bincount(pairs.ravel(), minlength=len(nodes)) > 0
            ends = [
                part[near][np.linalg.norm(nodes[near] - q, axis=1).argmin()]
                for q in (scene.start, scene.goal)
            ]
            kind.append((len(pairs), several, ends[0] == ends[1]))
    edges, parts, joined = zip(*(np.transpose(kind) for kind in kinds), strict=True)
    assert stats.mannwhitneyu(*edges).pvalue > 1e-4
    assert np.ptp(parts) == 0 or stats.mannwhitneyu(*parts).pvalue > 1e-4
    table = [[j.sum(), len(j) - j.sum()] for j in joined]
    assert stats.fisher_exact(table).pvalue > 1e-4


@pytest.mark.prove
def test_roadmaps_are_alike() -> None:
    compare_roadmaps(scenes.discs(), SEEDS)


def test_the_rank_test_would_see_a_difference() -> None:
    """Its power on what is compared; and a step twice as long is seen."""
    scene = scenes.discs()
    samples = np.array([ours(scene, "rrt", seed).samples for seed in range(300)], dtype=float)
    assert power(samples) <= 1.35 and power(samples[:60]) <= 2.0
    world, ends = scene.world, (scene.start, scene.goal)
    longer = [plan(world, *ends, method="rrt", rng=seed, step=2.0).samples for seed in range(300)]
    assert stats.mannwhitneyu(samples, longer).pvalue < 1e-4


def test_rrt_star_is_as_long_after_the_same_samples() -> None:
    """OMPL reaches the goal only by drawing it; ours joins it when near. So ours is first, and
    after many samples both are as long to a percent."""
    scene, budget = scenes.discs(), 2000
    seeds = range(1, 9)
    mine = [ours(scene, "rrt_star", seed, budget) for seed in seeds]
    other = [theirs(scene, "rrt_star", seed, budget) for seed in seeds]
    for answer in other:
        assert check_path(scene.world, answer.path.T, scene.start, scene.goal)
    lengths = [
        float(np.median([p.cost for p in mine])),
        float(np.median([length(p.path.T) for p in other])),
    ]
    assert lengths[0] == pytest.approx(lengths[1], rel=0.03)
    checks = [np.median([p.edge_checks for p in mine]), np.median([p.checks for p in other])]
    assert checks[0] == pytest.approx(checks[1], rel=0.25)


def test_edges_and_states_are_counted_apart() -> None:
    """In the goal's tree OMPL asks the new state before its edge: its edges are fewer, and those
    that it was spared are the states that were blocked."""
    scene = scenes.discs()
    for seed in SEEDS[:20]:
        answer = theirs(scene, "rrt_connect", seed)
        assert answer.state_checks > 2 and answer.checks > len(answer.path) - 2
        assert 0.0 < answer.callback_seconds < answer.seconds
        assert answer.own_seconds == answer.seconds - answer.callback_seconds
    mine = np.median([ours(scene, "rrt_connect", seed).edge_checks for seed in SEEDS])
    other = np.median([theirs(scene, "rrt_connect", seed).checks for seed in SEEDS])
    assert other < mine


def test_pure_python_states_say_what_the_compiled_ones_say() -> None:
    rng = np.random.default_rng(4)
    for scene in SCENES:
        slow, (fast, _) = ompl.plain(scene.world), ompl.tests(scene.world)
        states = rng.uniform(scene.world.bounds[0], scene.world.bounds[1], (300, scene.world.dim))
        answers = [slow(q.tolist()) for q in states]
        assert answers == [fast(q) for q in states]
        assert scene.name == "empty" or not all(answers)


def test_points_along_an_edge_pass_what_an_exact_test_stops() -> None:
    scene = scenes.gap(0.02, 0.05)
    wrong = 0
    for seed in range(1, 21):
        answer = ompl.solve(
            scene.world.bounds,
            scene.start,
            scene.goal,
            "rrt_connect",
            scene.step,
            BUDGET,
            seed,
            ompl.plain(scene.world),
            None,
        )
        path = None if answer.path is None else answer.path.T
        wrong += not check_path(scene.world, path, scene.start, scene.goal)
    assert wrong >= 15  # a wall of 0.05 m among points 0.14 m apart


def test_an_approximate_answer_is_true_there() -> None:
    """Its status counts as true behind a closed wall, 0.5 short of the goal at the least."""
    text, exact, short = ompl.approximate()
    assert text and not exact and short >= 0.5
    shut = plane([[0, 0], [1, 1]], boxes=[[0.4, 0, 0.6, 1]])
    result = plan(shut, [0.1, 0.5], [0.9, 0.5], method="rrt", budget=200)
    assert not result.solved and result.path is None


def test_what_ompl_chooses_where_nothing_is_said() -> None:
    chosen = ompl.defaults()
    assert chosen == {
        "planner": "LBKPIECE1",
        "range": pytest.approx(0.2),
        "resolution": 0.01,
        "goal_bias": 0.05,
    }
    with pytest.raises(ValueError, match="method"):
        theirs(SCENES[0], "prm", 1)


def test_a_cup_carried_by_ompl_is_upright_at_every_state_and_moves_between_the_ends() -> None:
    world = shelf("open").world
    begin, end = constraints.carried("open", 0)
    answer = ompl.carry(world, manifold.CUP, begin, end, 0.2, 600, 1, split=True)
    assert answer.path is not None
    assert np.max(manifold.tilt(panda(), answer.path.T)) < 1.01 * manifold.PROJECTED
    assert np.allclose(answer.path[[0, -1]], [begin, end])
    # Projected states a spacing apart: OMPL lets a geodesic's states be twice as far.
    assert np.linalg.norm(np.diff(answer.path, axis=0), axis=1).max() <= 0.4 + 1e-9
    assert 0.0 < answer.own_seconds < answer.seconds


def test_the_controls_of_ompl_lead_along_its_states() -> None:
    answer, pulls, lasted = ompl.controls(
        np.zeros((0, 3)),
        constraints.ROOM,
        constraints.BEGIN,
        constraints.END,
        0.5,
        1.0,
        0.1,
        10,
        3000,
        1,
    )
    assert answer.path is not None and np.abs(pulls).max() <= 1.0
    for k, duration in enumerate(lasted):
        s, a, h = answer.path[k].copy(), pulls[k], duration / 1000
        for _ in range(1000):  # many small steps of Euler
            s += h * np.concatenate((s[2:], a))
        assert s == pytest.approx(answer.path[k + 1], abs=1e-2)
    assert np.linalg.norm(answer.path[-1] - constraints.END) <= 0.5
