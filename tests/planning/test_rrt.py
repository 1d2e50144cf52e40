"""RRT and its judge: the exact edge test, the paths, the tree, the draws."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy import stats

from course.drills import GOAL_BIAS, edge_is_free, rrt
from drills import cards as catalogue
from drills import exercise as exercises
from drills.catalogue.rrt.replay import Run, faults, share_inside
from drills.catalogue.rrt.worlds import invalid_queries, worlds
from drills.geometry import TOLERANCE, clearances, missed_by_sampling, path_faults
from drills.grader import attempt
from drills.reasons import Reason
from drills.verify import in_this_process
from tests.budget import examples

BOUNDS = np.array([[0.0, 0.0], [10.0, 10.0]])
START, GOAL = np.array([1.0, 1.0]), np.array([9.0, 9.0])

coordinate = st.floats(-10.0, 10.0, allow_subnormal=False)
point = st.tuples(coordinate, coordinate)
disc = st.tuples(coordinate, coordinate, st.floats(0.0, 5.0))


def clutter(seed: int, count: int = 25) -> np.ndarray:
    rng = np.random.default_rng(seed)
    discs = np.column_stack((rng.uniform(0, 10, (count, 2)), rng.uniform(0.2, 0.8, count)))
    distance = np.minimum(*(np.hypot(*(discs[:, :2] - p).T) for p in (START, GOAL)))
    return discs[distance > discs[:, 2]]


# --- The exact judge ------------------------------------------------------------------------------


def gap_sign(a, b, disc) -> int:
    """Sign of the gap between segment and disc, in rational arithmetic: no rounding at all."""
    (ax, ay), (bx, by) = (tuple(map(Fraction, p)) for p in (a, b))
    x, y, radius = map(Fraction, disc)
    dx, dy = bx - ax, by - ay
    squared = dx * dx + dy * dy
    t = ((x - ax) * dx + (y - ay) * dy) / squared if squared else Fraction(0)
    t = min(max(t, Fraction(0)), Fraction(1))
    gap = (x - ax - t * dx) ** 2 + (y - ay - t * dy) ** 2 - radius**2
    return (gap > 0) - (gap < 0)


@examples(300)
@given(point, point, disc)
@example((0.0, 1.0), (4.0, 1.0), (2.0, 0.0, 1.0))  # tangent
@example((0.0, 0.0), (0.0, 0.0), (1.0, 0.0, 1.0))  # no length, touching
@example((0.5, 0.0), (0.5, 0.0), (0.0, 0.0, 1.0))  # no length, inside
@example((-0.1, 0.0), (0.1, 0.0), (0.0, 0.0, 5.0))  # an edge inside a disc
@example((1.0, 0.0), (2.0, 0.0), (0.0, 0.0, 1.0))  # begins on the circle, leads away
@example((1e-9, 0.0), (0.0, 1e-9), (1.0, 1.0, 1.4))  # tiny
def test_the_judge_agrees_with_rational_arithmetic(a, b, disc) -> None:
    (gap,) = clearances(a, b, [disc])
    if abs(gap) > 1e-12:
        assert math.copysign(1, gap) == gap_sign(a, b, disc)
    assert edge_is_free(np.array(a), np.array(b), np.array([disc])) == (gap > 0) or abs(gap) < 1e-12


@examples(100)
@given(point, point, disc)
def test_the_gap_is_that_of_the_nearest_of_many_points(a, b, disc) -> None:
    (gap,) = clearances(a, b, [disc])
    ts = np.linspace(0.0, 1.0, 2001)[:, None]
    points = np.array(a) + ts * (np.array(b) - np.array(a))
    sampled = np.hypot(*(points - disc[:2]).T).min() - disc[2]
    spacing = math.dist(a, b) / 2000
    assert gap - 1e-12 <= sampled
    assert sampled - gap <= spacing / 2 + 1e-12


@pytest.mark.parametrize("depth", [1e-3, 1e-6, 1e-8])
def test_a_grazing_cut_is_seen_and_a_near_miss_is_not(depth: float) -> None:
    a, b = np.array([0.0, 0.0]), np.array([10.0, 0.0])
    for sign in (-1, 1):
        disc = np.array([[5.0, 1.0 + sign * depth, 1.0]])
        assert clearances(a, b, disc)[0] == pytest.approx(sign * depth, rel=1e-6)
        assert edge_is_free(a, b, disc) == (sign > 0)


def test_the_share_of_an_edge_inside_a_disc() -> None:
    a, b = np.array([0.0, 0.0]), np.array([4.0, 0.0])
    discs = np.array([[2.0, 0.0, 1.0], [0.0, 0.0, 0.5], [2.0, 3.0, 1.0]])
    assert share_inside(a, b, discs) == pytest.approx(0.5)
    assert share_inside(a, b, discs[1:]) == pytest.approx(0.125)
    assert share_inside(a, b, discs[2:]) == 0.0
    assert share_inside(a, a, discs) == 0.0


@pytest.mark.parametrize("spacing", [0.1, 0.5, 1.0, 2.0])
def test_points_along_an_edge_miss_discs_at_the_rate_derived(spacing: float) -> None:
    rng, lines = np.random.default_rng(int(10 * spacing)), 400_000
    chord = 2.0 * np.sqrt(1.0 - rng.uniform(0.0, 1.0, lines) ** 2)
    missed = int(np.sum(rng.uniform(0.0, spacing, lines) > chord))  # the first point lies beyond
    share = missed_by_sampling(spacing, 1.0)
    assert stats.binomtest(missed, lines, share).pvalue > 1e-4


def test_the_prompt_tells_the_measured_rates() -> None:
    text = catalogue.card("rrt").prompt()
    assert f"miss {100 * missed_by_sampling(1.0, 1.0):.1f} %" in text
    assert round(1 / missed_by_sampling(0.1, 1.0), -2) == 2400 and "one in\n2400" in text
    assert missed_by_sampling(0.01, 1.0) == pytest.approx(0.01**2 / 24.0, rel=1e-3)
    with pytest.raises(ValueError, match="spacing"):
        missed_by_sampling(3.0, 1.0)


def test_every_kind_of_wrong_path_is_found() -> None:
    discs = [[5.0, 5.0, 1.0]]
    round_it = [START, [1.0, 9.0], GOAL]

    def kinds(path, step=20.0, bounds=BOUNDS):
        return {fault.kind for fault in path_faults(path, START, GOAL, discs, bounds, step)}

    assert kinds(round_it) == set()
    assert kinds([START, GOAL]) == {"collision"}
    assert kinds(round_it, step=7.9) == {"step"}
    assert kinds(round_it[1:]) == {"start"}
    assert kinds([*round_it[:2], [9.0, 8.999999]]) == {"goal"}
    assert kinds([START, [1.0, 11.0], GOAL]) == {"bounds"}
    assert kinds([[5.0, 5.5]]) == {"start", "goal", "collision"}
    assert kinds([]) == kinds([1.0, 2.0]) == kinds([[math.nan, 0.0]]) == {"shape"}


# --- The planner ----------------------------------------------------------------------------------


@examples(40)
@given(st.integers(0, 10**6), st.integers(0, 40), st.floats(0.2, 3.0))
def test_every_path_is_right_by_the_exact_judge(seed: int, count: int, step: float) -> None:
    discs = clutter(seed, count)
    path, nodes, parents, samples = rrt(
        START, GOAL, discs, BOUNDS, step, 400, np.random.default_rng(seed)
    )
    assert len(samples) <= 400
    if path is None:
        assert len(samples) == 400
        assert not (nodes == GOAL).all(axis=1).any()
    else:
        assert path_faults(path, START, GOAL, discs, BOUNDS, step) == []
        chain = [len(nodes) - 1]
        while parents[chain[-1]] >= 0:
            chain.append(int(parents[chain[-1]]))
        assert np.array_equal(path, nodes[chain[::-1]])


@examples(25)
@given(st.integers(0, 10**6), st.floats(0.3, 3.0))
def test_the_tree_is_the_one_that_its_targets_ask_for(seed: int, step: float) -> None:
    discs = clutter(seed)
    _, nodes, parents, samples = rrt(
        START, GOAL, discs, BOUNDS, step, 150, np.random.default_rng(seed)
    )
    grown, last = [START], 0
    for target in samples:
        distance = [math.dist(node, target) for node in grown]
        near = min(range(len(grown)), key=distance.__getitem__)
        direction = np.divide(target - grown[near], distance[near])
        new = target if distance[near] <= step else grown[near] + step * direction
        if clearances(grown[near], new, discs).min(initial=1.0) <= 0.0:
            continue
        grown.append(new)
        last += 1
        assert parents[last] == near
        np.testing.assert_allclose(nodes[last], new, atol=1e-12)
    assert len(nodes) - 1 - last in (0, 1)  # one more if a node was joined to the goal
    if len(nodes) - 1 > last:
        assert np.array_equal(nodes[-1], GOAL) and parents[-1] == last


def closed_world(seed: int, count: int = 4000):
    wall = np.array([[5.0, y, 0.3] for y in np.arange(0.0, 10.1, 0.5)])
    return rrt(START, GOAL, wall, BOUNDS, 0.5, count, np.random.default_rng(seed))


def test_an_unreachable_goal_gives_no_path_and_all_targets() -> None:
    path, nodes, parents, samples = closed_world(0, 500)
    assert path is None and len(samples) == 500
    assert (nodes[:, 0] < 5.0).all() and len(parents) == len(nodes)


def test_one_target_in_ten_is_the_goal_and_the_others_are_uniform() -> None:
    samples = closed_world(3)[3]
    goals = (samples == GOAL).all(axis=1)
    assert stats.binomtest(int(goals.sum()), len(samples), GOAL_BIAS).pvalue > 1e-3
    for axis in range(2):
        assert stats.kstest(samples[~goals, axis] / 10.0, "uniform").pvalue > 1e-3
    assert abs(stats.spearmanr(samples[~goals]).statistic) < 4.0 / math.sqrt(len(samples))


def test_the_same_seed_gives_the_same_tree_and_another_one_another() -> None:
    one, same, other = closed_world(1, 100), closed_world(1, 100), closed_world(2, 100)
    for a, b in zip(one[1:], same[1:], strict=True):
        assert np.array_equal(a, b)
    assert not np.array_equal(one[3], other[3])


def test_start_equals_goal() -> None:
    path, nodes, parents, samples = rrt(
        START, START, clutter(0), BOUNDS, 0.5, 10, np.random.default_rng(0)
    )
    assert path is not None
    assert path.tolist() == nodes.tolist() == [START.tolist()]
    assert parents.tolist() == [-1] and samples.shape == (0, 2)


def test_no_target_allowed() -> None:
    path, nodes, _, samples = rrt(START, GOAL, [], BOUNDS, 0.5, 0, np.random.default_rng(0))
    assert path is None and nodes.shape == (1, 2) and samples.shape == (0, 2)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"start": [5.0, 5.5]}, "start"),
        ({"goal": [5.0, 5.5]}, "goal"),
        ({"start": [5.0, 6.0]}, "start"),  # touching
        ({"start": [-1.0, 0.0]}, "start"),
        ({"goal": [1.0, math.nan]}, "goal"),
        ({"step": 0.0}, "step"),
        ({"step": math.nan}, "step"),
        ({"max_samples": -1}, "max_samples"),
        ({"bounds": [[0.0, 0.0], [0.0, 1.0]]}, "bounds"),
        ({"discs": [[1.0, 2.0]]}, "discs"),
    ],
)
def test_wrong_queries_are_refused_and_named(changed, named) -> None:
    query: dict[str, Any] = {"start": START, "goal": GOAL, "bounds": BOUNDS}
    query |= {"discs": [[5.0, 5.0, 1.0]]}
    query |= {"step": 0.5, "max_samples": 10, **changed}
    with pytest.raises(ValueError, match=named):
        rrt(**query, rng=np.random.default_rng(0))


# --- The worlds and the replay of the drill -------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_the_replay_finds_nothing_wrong_with_the_reference(seed: int) -> None:
    for world in worlds(np.random.default_rng(seed)):
        run = Run(*rrt(*world.arguments(), np.random.default_rng(seed + 1)))
        assert faults(world, run) == [], world.label
        if world.closed:
            assert run.path is None and len(run.samples) == world.max_samples
    for world in invalid_queries(np.random.default_rng(seed)):
        with pytest.raises(ValueError):
            rrt(*world.arguments(), np.random.default_rng(0))


@examples(30)
@given(st.integers(0, 10**6), st.sampled_from(["node", "parent", "target", "path", "shorter"]))
def test_the_replay_sees_one_changed_figure(seed: int, what: str) -> None:
    rng = np.random.default_rng(seed)
    world = next(w for w in worlds(rng) if w.label == "thick discs")
    run = Run(*rrt(*world.arguments(), rng))
    assume(len(run.nodes) > 3)
    assert run.nodes.flags.writeable
    i = int(rng.integers(1, len(run.nodes)))
    if what == "node":
        run.nodes[i] += 1e-6
    elif what == "parent":
        run.parents[i] = -1 if run.parents[i] else i
    elif what == "target":  # one that made a node, as a refused one may be anywhere
        made = np.flatnonzero((run.samples == run.nodes[i]).all(axis=1))
        assume(len(made) and not np.array_equal(run.nodes[i], world.goal))
        run.samples[made[0]] += 0.3 * world.step
    elif what == "path":
        assume(run.path is not None and len(run.path) > 3)
        assert run.path is not None
        run = Run(np.delete(run.path, 1, axis=0), run.nodes, run.parents, run.samples)
    else:
        run = Run(None, run.nodes[:-1], run.parents[:-1], run.samples)
    assert faults(world, run)


# As most people write it first: a list of nodes, a loop for the nearest, a loop over the discs.
PLAIN = """\
import math
import numpy as np

def free(a, b, discs):
    for disc in discs:
        centre, radius = disc[:2], disc[2]
        along = b - a
        squared = np.dot(along, along)
        t = 0.0 if squared == 0.0 else np.clip(np.dot(centre - a, along) / squared, 0.0, 1.0)
        if np.linalg.norm(a + t * along - centre) <= radius:
            return False
    return True

def rrt(start, goal, discs, bounds, step, max_samples, rng):
    start, goal = np.array(start, dtype=float), np.array(goal, dtype=float)
    discs = np.reshape(discs, (-1, 3))
    low, high = np.array(bounds, dtype=float)
    for point in (start, goal):
        if np.any(point < low) or np.any(point > high) or not free(point, point, discs):
            raise ValueError("start and goal must be free and within the bounds")
    nodes, parents, samples = [start], [-1], []
    found = bool(np.all(start == goal))
    while not found and len(samples) < max_samples:
        if rng.random() < 0.1:
            target = goal
        else:
            target = rng.uniform(low, high)
        samples.append(target)
        nearest, shortest = 0, math.inf
        for i, node in enumerate(nodes):
            distance = np.linalg.norm(target - node)
            if distance < shortest:
                nearest, shortest = i, distance
        new = target
        if shortest > step:
            new = nodes[nearest] + step * (target - nodes[nearest]) / shortest
        if free(nodes[nearest], new, discs):
            nodes.append(new)
            parents.append(nearest)
            found = bool(np.all(new == goal))
    path = None
    if found:
        path, i = [], len(nodes) - 1
        while i >= 0:
            path.insert(0, nodes[i])
            i = parents[i]
        path = np.array(path)
    return path, np.array(nodes), np.array(parents), np.reshape(samples, (-1, 2))
"""


@pytest.mark.prove
def test_a_plain_loop_over_a_list_of_nodes_is_right_and_in_time() -> None:
    graded = attempt(catalogue.card("rrt"), PLAIN, seed=3)
    assert graded.report.passed, graded.report.sentence
    learner = graded.learner  # what it took, in processor time; a second process takes it again
    assert 2.0 * learner.child.used < 5.0
    limits = exercises.of("rrt").limits
    assert limits is not None and learner.longest < limits.call / 10.0


@pytest.mark.prove
@pytest.mark.parametrize("seed", [100, 719625752])
def test_who_never_looks_at_the_bounds_is_told(seed: int) -> None:
    careless = PLAIN.replace("np.any(point < low) or np.any(point > high) or ", "")
    assert careless != PLAIN
    report = attempt(catalogue.card("rrt"), careless, seed=seed, place=in_this_process).report
    assert (report.slip, report.reason) == ("bounds_unchecked", Reason.MISSING_ERROR)


def test_tolerance_is_far_from_rounding_and_from_every_world() -> None:
    assert 1e-13 < TOLERANCE < 1e-8 < 1e-7  # the shallowest cut of a world is 1e-7 m
