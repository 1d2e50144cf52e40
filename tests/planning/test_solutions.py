"""Chapter 5's worked answers against closed forms, SciPy, the chapter and its judge of paths."""

import itertools
import math
import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from course.planning import check_path, edge_free, plan, planar_arm, plane, scenes
from drills import cards
from drills import exercise as exercises
from drills.catalogue.certify_edge.exercise import cases as edges
from drills.catalogue.certify_edge.exercise import certain
from drills.geometry import clearances
from solutions import planning as solutions
from tests.budget import examples

BOUNDS = scenes.SQUARE


@pytest.fixture(autouse=True)
def _floating_point_is_quiet():
    """No answer may warn, whatever it is given here."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


def clutter(rng, count=25):
    discs = np.column_stack((rng.uniform(0, 10, (count, 2)), rng.uniform(0.2, 0.9, count)))
    distance = np.minimum(*(np.hypot(*(discs[:, :2] - p).T) for p in (scenes.START, scenes.GOAL)))
    return discs[distance > discs[:, 2] + 0.1]


def length(path):
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


# --- an edge with a guarantee ---------------------------------------------------------------------


@examples(40)
@given(st.floats(0.2, 2.0), st.floats(0.5, 6.0), st.floats(0.01, 0.15), st.floats(-3.0, 3.0))
def test_a_link_touches_a_disc_where_geometry_says(far, at, radius, start):
    """By the side of the link, by its tip, or not at all; far apart from a graze."""
    reach = math.sqrt(max(far * far - radius * radius, 0.0))  # where a tangent touches the disc
    if reach <= 1.0:
        half = math.asin(radius / far)
    else:
        cosine = (1.0 + far * far - radius * radius) / (2.0 * far)
        half = math.acos(cosine) if cosine < 1.0 else -1.0
        if abs(1.0 + radius - far) < 1e-3:
            return
    if half > 0.0 and min(at, 2.0 * math.pi - at) < half + 1e-3:
        return  # the link touches the disc at the start already
    centre = far * math.cos(start + at), far * math.sin(start + at)
    for turn in (7.0, -7.0):  # clockwise the other side of the disc is met first
        first = (at if turn > 0.0 else 2.0 * math.pi - at) - half
        result = solutions.edge_check([1.0], [[*centre, radius]], [start], [start + turn])
        truth = first / 7.0 if half > 0.0 else 1.0
        assert result == pytest.approx(truth, abs=2e-5) and result <= truth + 1e-12


@examples(40)
@given(rngs(), st.integers(1, 5), st.floats(0.005, 0.3))
def test_what_is_called_free_is_proved_free_by_the_chapter_and_by_the_judge(rng, n, radius):
    lengths = rng.uniform(0.4, 1.0, n)
    discs = np.column_stack((rng.uniform(-1, 1, (6, 2)) * lengths.sum(), np.full(6, radius)))
    world = planar_arm(lengths, discs=discs, bounds=[[-9.0] * n, [9.0] * n])
    a, b = rng.uniform(-1.5, 1.5, (2, n))
    share = solutions.edge_check(lengths, discs, a, b)
    assert (share == 1.0) == edge_free(world, a, b)
    if share > 0.0:
        assert check_path(world, np.column_stack((a, a + share * (b - a))))
    if share < 1.0:
        nudged = [
            check_path(world, (a + min(share + d, 1.0) * (b - a))[:, None])
            for d in (0.0, 1e-6, 1e-4, 1e-2)
        ]
        assert not all(nudged) or np.abs(b - a).max() < 1e-3


# --- two trees ------------------------------------------------------------------------------------


@examples(40)
@given(rngs(), st.integers(0, 10**6), st.floats(0.3, 3.0))
def test_two_trees_are_those_of_the_chapter_with_the_same_draws(rng, seed, step):
    discs = clutter(rng)
    world = plane(BOUNDS, discs)
    result = plan(
        world,
        scenes.START,
        scenes.GOAL,
        method="rrt_connect",
        budget=200,
        rng=np.random.default_rng(seed),
        step=step,
    )
    samples = np.random.default_rng(seed).uniform(BOUNDS[0], BOUNDS[1], (200, 2))
    path, sizes = solutions.rrt_connect(scenes.START, scenes.GOAL, discs, samples, step)
    assert result.solved == bool(len(path)) and sizes.sum() == result.nodes.shape[1]
    assert (result.parents < 0).tolist().index(True, 1) == sizes[0]
    if result.path is not None:
        np.testing.assert_allclose(path, result.path.T, rtol=0, atol=1e-11)
        assert check_path(world, path.T, scenes.START, scenes.GOAL)
        assert np.hypot(*np.diff(path, axis=0).T).max() <= step + 1e-12


# --- shortcuts ------------------------------------------------------------------------------------


@examples(40)
@given(rngs(), st.integers(0, 60))
def test_a_shortcut_neither_lengthens_nor_collides_nor_moves_the_ends(rng, draws):
    discs, samples = clutter(rng), rng.uniform(*BOUNDS, (400, 2))
    path, _ = solutions.rrt_connect(scenes.START, scenes.GOAL, discs, samples, 0.8)
    if len(path):
        before = path.copy()
        short = solutions.shortcut(path, discs, rng.random((draws, 2)))
        assert check_path(plane(BOUNDS, discs), short.T, path[0], path[-1])
        assert length(short) <= length(path) + 1e-12
        np.testing.assert_array_equal(path, before)


def test_shortcuts_pull_a_path_tight_around_a_disc():
    """The shortest way around one disc is known: two tangents and the arc between them."""
    away, radius = 3.0, 1.0
    corner, disc = np.array([[-away, 0.0], [0.0, 2.5], [away, 0.0]]), [[0.0, 0.0, radius]]
    tangent = math.sqrt(away**2 - radius**2)
    tight = 2.0 * tangent + radius * (math.pi - 2.0 * math.acos(radius / away))
    lengths = [
        length(solutions.shortcut(corner, disc, np.random.default_rng(1).random((draws, 2))))
        for draws in (0, 10, 100, 1000)
    ]
    assert lengths == sorted(lengths, reverse=True)
    assert tight < lengths[-1] < 1.003 * tight < 1.02 * tight < lengths[0]


# --- a lazy roadmap -------------------------------------------------------------------------------


def shortest(points, pairs, start, goal):
    """SciPy's shortest route over pairs of points, [] where there is none."""
    weights = [math.dist(points[i], points[j]) for i, j in pairs]
    graph = csr_array((weights, np.array(list(pairs)).reshape(-1, 2).T), (len(points),) * 2)
    far, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
    route = [goal] if far[goal] < math.inf else []
    while route and route[-1] != start:
        route.append(int(before[route[-1]]))
    return route[::-1]


@examples(40)
@given(rngs(), st.integers(2, 40), st.floats(0.0, 0.3))
def test_the_lazy_route_is_that_of_a_roadmap_with_all_edges_checked(rng, n, share):
    points, discs = rng.uniform(0.0, 10.0, (n, 2)), clutter(rng, 12)
    pairs = {(i, j) for i in range(n) for j in range(i) if rng.random() < share}
    hits = {(i, j) for i, j in pairs if clearances(points[i], points[j], discs).min() <= 0.0}
    route, checks = solutions.lazy_prm(points, sorted(pairs), discs, 0, n - 1)
    assert route.tolist() == shortest(points, pairs - hits, 0, n - 1)
    # What it looks at: the routes of a roadmap from which one edge is gone after the other.
    remaining, visited = set(pairs), set()
    while tried := shortest(points, remaining, 0, n - 1):
        steps = [(max(e), min(e)) for e in itertools.pairwise(tried)]
        bad = next((k for k, edge in enumerate(steps) if edge in hits), None)
        visited |= set(steps[: None if bad is None else bad + 1])
        if bad is None:
            break
        remaining.discard(steps[bad])
    assert checks == len(visited)


# --- timing ---------------------------------------------------------------------------------------


@examples(60)
@given(rngs(), st.integers(1, 7), st.floats(-3.0, 1.0))
def test_a_motion_keeps_its_limits_and_always_is_at_one(rng, n, power):
    """At every time a joint is at its largest speed or acceleration: so none is quicker."""
    start, end = rng.uniform(-1.0, 1.0, n), 10.0**power * rng.uniform(-1.0, 1.0, n)
    end = start + end
    speed, acceleration = rng.uniform(0.2, 3.0, n), rng.uniform(0.2, 9.0, n)
    duration, _, _ = solutions.trapezoid(start, end, speed, acceleration, [])
    h = 1e-5 * duration
    middle = np.sort(rng.uniform(2.0 * h, duration - 2.0 * h, 60))
    _, q, rate = solutions.trapezoid(start, end, speed, acceleration, middle)
    _, after, faster = solutions.trapezoid(start, end, speed, acceleration, middle + h)
    np.testing.assert_allclose((after - q) / h, 0.5 * (rate + faster), atol=1e-4 * speed.max())
    pushed = np.max(np.abs(faster - rate) / h / acceleration[:, None], axis=0)
    driven = np.max(np.abs(rate) / speed[:, None], axis=0)
    assert driven.max() <= 1.0 + 1e-9 and pushed.max() <= 1.0 + 1e-6
    busy = np.maximum(driven, pushed) > 1.0 - 1e-6
    assert np.mean(busy) > 0.9  # between two pieces a difference sees both
    share = (q - start[:, None]) / (end - start)[:, None]
    assert np.abs(share - share[0]).max() < 1e-9
    _, ends, still = solutions.trapezoid(start, end, speed, acceleration, [-1.0, 0.0, duration, 99])
    np.testing.assert_allclose(ends.T, [start, start, end, end], atol=1e-12)
    assert np.abs(still).max() < 1e-12


# --- the hunt -------------------------------------------------------------------------------------


def paths_of(nodes, parents):
    """Length of each node's path from the root, edge by edge."""
    result = np.zeros(len(nodes))
    for i in range(len(nodes)):
        at = i
        while parents[at] >= 0:
            result[i] += math.dist(nodes[at], nodes[parents[at]])
            at = parents[at]
    return result


@pytest.mark.slow
@examples(20)
@given(rngs(), st.floats(0.5, 3.0))
def test_costs_are_lengths_and_with_all_as_neighbours_the_shortest(rng, step):
    discs, samples = clutter(rng, 12), rng.uniform(*BOUNDS, (60, 2))
    nodes, parents, costs = solutions.rrt_star(scenes.START, discs, samples, step, 1.5 * step)
    np.testing.assert_allclose(costs, paths_of(nodes, parents), rtol=0, atol=1e-11)
    nodes, parents, costs = solutions.rrt_star(scenes.START, [], samples, step, 99.0)
    truth = np.hypot(*(nodes - scenes.START).T)
    np.testing.assert_allclose(costs, truth, rtol=0, atol=1e-12)


@pytest.mark.slow
@examples(10)
@given(rngs())
def test_the_starter_of_the_hunt_is_all_that_its_author_says(rng):
    """Free edges, costs that never rise and are no lies downwards, and yet they are stale."""
    names: dict = {}
    exec(cards.card("rrt_star").starter(), names)
    discs, samples = clutter(rng, 12), rng.uniform(*BOUNDS, (150, 2))
    last = np.zeros(0)
    for count in (30, 60, 100, 150):
        nodes, parents, costs = names["rrt_star"](scenes.START, discs, samples[:count], 1.2, 2.5)
        for i in range(1, len(nodes)):
            assert clearances(nodes[i], nodes[parents[i]], discs).min() > 0.0
        assert (costs[: len(last)] <= last + 1e-12).all()
        assert (costs >= paths_of(nodes, parents) - 1e-12).all()
        last = costs
    assert (last > paths_of(nodes, parents) + 1e-3).any()


@pytest.mark.parametrize("seed", range(10))
def test_the_clearance_of_an_edge_is_the_least_along_it(seed):
    """The distance to a point is convex along the edge: SciPy finds its minimum by itself."""
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-2.0, 2.0, (2, 2))
    discs = np.column_stack((rng.uniform(-4.0, 4.0, (6, 2)), rng.uniform(0.1, 1.0, 6)))
    for disc, clearance in zip(discs, solutions.edge_clearance(a, b, discs), strict=True):

        def distance(share, centre=disc[:2]):
            return float(np.hypot(*(a + share * (b - a) - centre)))

        inside = minimize_scalar(distance, bounds=(0.0, 1.0), method="bounded").fun
        least = min(inside, distance(0.0), distance(1.0))
        assert clearance == pytest.approx(least - disc[2], abs=1e-6)
    assert solutions.edge_clearance(a, a, discs[:1])[0] == pytest.approx(
        np.hypot(*(discs[0, :2] - a)) - discs[0, 2]
    )


# --- an edge of a capsule -------------------------------------------------------------------------


@examples(30)
@given(rngs(), st.floats(0.0, 0.6), st.floats(-8.0, 8.0), st.floats(0.005, 0.2))
def test_a_capsule_edge_is_certified_as_an_exact_check_says(rng, half, turn, radius):
    a = np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(-3.0, 3.0)])
    b = a + [*rng.uniform(-2.0, 2.0, 2), turn]
    centres = rng.uniform(-2.0, 2.0, (6, 2)) @ [1.0, 1.0j]
    speed = np.hypot(*(b - a)[:2]) + half * abs(turn)

    def clearance(pose):
        own = (centres - complex(*pose[:2])) * np.exp(-1j * pose[2])  # in the capsule's frame
        return float(np.abs(own - np.clip(own.real, -half, half)).min()) - 0.05 - radius

    n = 300
    lowest = min(clearance(a + s * (b - a)) for s in np.linspace(0.0, 1.0, n + 1))
    if lowest < -1e-6:
        assert solutions.certify_edge(clearance, half, a, b) == 0.0
    elif lowest > 0.5 * speed / n + 1e-6:
        assert solutions.certify_edge(clearance, half, a, b) == 1.0


def test_a_certified_edge_takes_fewer_evaluations_than_a_march_or_halving():
    texts = {slip.name: slip for slip in exercises.of("certify_edge").slips}
    solution = cards.card("certify_edge").solution_text()
    drawn = edges(np.random.default_rng(7))
    used = dict.fromkeys(("worked", "from_one_end", "halved_blindly"), 0)
    for name in used:
        answer: dict = {}
        exec(solution if name == "worked" else texts[name].text(solution), answer)
        for case in drawn:
            if not np.any(case.args[0].move):
                continue
            clearance = case.args[0].fresh()
            assert answer["certify_edge"](clearance, *case.args[1:]) == certain(case.args[0])
            used[name] += len(clearance.shares)
    assert 1.2 * used["worked"] < min(used["from_one_end"], used["halved_blindly"])
