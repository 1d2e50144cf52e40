"""OMPL's RRT: its adapter on queries with known answers, then the same worlds for both planners."""

import math

import numpy as np
import pytest
from scipy import stats

from course.drills import rrt
from course.oracles import ompl
from drills.geometry import path_faults

BOUNDS = np.array([[0.0, 0.0], [10.0, 10.0]])
START, GOAL = np.array([1.0, 1.0]), np.array([9.0, 9.0])
SEEDS = range(1, 61)
EMPTY = np.zeros((0, 3))


def clutter() -> np.ndarray:
    rng = np.random.default_rng(3)
    discs = np.column_stack((rng.uniform(1.5, 8.5, (30, 2)), rng.uniform(0.3, 0.7, 30)))
    distance = np.minimum(*(np.hypot(*(discs[:, :2] - p).T) for p in (START, GOAL)))
    return discs[distance > 1.0]


def wall(gap: bool) -> np.ndarray:
    posts = [[5.0, y, 0.3] for y in np.arange(0.0, 10.1, 0.5)]
    return np.array([p for p in posts if not (gap and abs(p[1] - 7.0) < 0.1)])


WORLDS = {"free": EMPTY, "clutter": clutter(), "gap": wall(True), "unreachable": wall(False)}


def test_a_plan_is_right_by_the_exact_judge() -> None:
    for seed in range(1, 21):
        plan = ompl.rrt(START, GOAL, WORLDS["clutter"], BOUNDS, 0.5, 2000, seed)
        assert plan.path is not None
        assert path_faults(plan.path, START, GOAL, WORLDS["clutter"], BOUNDS, 0.5) == []
        assert len(plan.path) <= len(plan.nodes) <= plan.samples + 2
        assert plan.samples <= plan.checks <= 2 * plan.samples
        assert 0.0 < plan.callback_seconds < plan.seconds


def test_the_same_seed_gives_the_same_plan_and_another_one_another() -> None:
    one, other, same = (
        ompl.rrt(START, GOAL, WORLDS["clutter"], BOUNDS, 0.5, 2000, seed) for seed in (5, 6, 5)
    )
    assert np.array_equal(one.nodes, same.nodes) and one.samples == same.samples
    assert not np.array_equal(one.nodes[:5], other.nodes[:5])


def test_samples_are_counted_and_bounded() -> None:
    plan = ompl.rrt(START, GOAL, WORLDS["unreachable"], BOUNDS, 0.5, 123, 1)
    assert plan.path is None
    assert plan.samples == 123
    assert (plan.nodes[:, 0] < 5.0).all()
    assert ompl.rrt(START, GOAL, EMPTY, BOUNDS, 0.5, 0, 1).samples == 0


def test_the_goal_is_joined_through_free_edges_only() -> None:
    between = [[5.0, 5.0, 0.5]]
    for seed in range(1, 11):
        plan = ompl.rrt([4.4, 5.0], [5.6, 5.0], between, BOUNDS, 1.5, 500, seed)
        assert plan.path is not None and len(plan.path) > 2
        assert path_faults(plan.path, [4.4, 5.0], [5.6, 5.0], between, BOUNDS, 1.5) == []


def test_points_along_edges_pass_through_thin_posts() -> None:
    """OMPL's own validator at 5 % of the diagonal (0.7 m) lets through what the exact one stops."""
    posts = [[5.0, y, 0.06] for y in np.arange(0.0, 10.1, 0.1)]
    query = (START, GOAL, posts, BOUNDS, 0.5, 300)
    through = [ompl.rrt(*query, seed, exact=False, resolution=0.05).path for seed in range(1, 6)]
    assert all(path is not None for path in through)
    for path in through:
        assert path is not None
        assert {f.kind for f in path_faults(path, START, GOAL, posts, BOUNDS, 0.5)} == {"collision"}
    assert all(ompl.rrt(*query, seed).path is None for seed in range(1, 6))


@pytest.mark.parametrize(
    ("start", "goal", "seed", "named"),
    [
        ([5.0, 1.0], GOAL, 1, "start"),
        (START, [5.0, 1.0], 1, "goal"),
        ([-1.0, 1.0], GOAL, 1, "start"),
        (START, GOAL, 0, "seed"),
    ],
)
def test_wrong_queries_are_refused_and_named(start, goal, seed, named) -> None:
    with pytest.raises(ValueError, match=named):
        ompl.rrt(start, goal, WORLDS["gap"], BOUNDS, 0.5, 10, seed)


# --- Ours beside it -------------------------------------------------------------------------------


@pytest.fixture(scope="module", params=list(WORLDS))
def both(request):
    """(name, ours, OMPL's): rows (solved, nodes, targets, path length) over the seeds."""
    discs, budget = WORLDS[request.param], 400

    def row(path, nodes, samples) -> tuple[float, ...]:
        length = math.nan if path is None else float(np.hypot(*np.diff(path, axis=0).T).sum())
        return float(path is not None), float(len(nodes)), float(samples), length

    ours, theirs = [], []
    for seed in SEEDS:
        path, nodes, _, samples = rrt(
            START, GOAL, discs, BOUNDS, 0.5, budget, np.random.default_rng(seed)
        )
        ours.append(row(path, nodes, len(samples)))
        plan = ompl.rrt(START, GOAL, discs, BOUNDS, 0.5, budget, seed)
        theirs.append(row(plan.path, plan.nodes, plan.samples))
    return request.param, np.array(ours), np.array(theirs)


@pytest.mark.prove
def test_both_solve_as_many_queries(both) -> None:
    name, ours, theirs = both
    solved = np.array([ours[:, 0].sum(), theirs[:, 0].sum()], dtype=int)
    if name == "unreachable":
        assert solved.tolist() == [0, 0]
    elif name == "free":
        assert solved.tolist() == [len(SEEDS)] * 2
    else:
        table = [solved, len(SEEDS) - solved]
        assert solved.min() > 10 and stats.fisher_exact(table).pvalue > 1e-3


@pytest.mark.prove
@pytest.mark.slow
def test_both_need_as_many_targets_nodes_and_metres(both) -> None:
    name, ours, theirs = both
    for column in (1, 2, 3):
        a, b = (rows[np.isfinite(rows[:, column]), column] for rows in (ours, theirs))
        if name == "unreachable" and column != 1:
            assert len(a) == len(b) and not np.any(a - b)  # all targets, no path
            continue
        assert 0.6 < np.median(a) / np.median(b) < 1.0 / 0.6
        assert stats.mannwhitneyu(a, b).pvalue > 1e-3
