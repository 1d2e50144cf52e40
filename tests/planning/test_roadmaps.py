"""Roadmaps: every path through the judge, shortest ways by another search, obstacles that move."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from course import charts
from course.planning import (
    Region,
    adapted,
    build_roadmap,
    check_path,
    edge_free,
    from_function,
    plan,
    planar_arm,
    plane,
    revalidated,
    scenes,
    shelf,
    with_paths,
)
from course.planning.roadmaps import BLOCKED, FREE, UNKNOWN
from tests.budget import examples

SQUARE = [[0.0, 0.0], [10.0, 10.0]]
METHODS = ("prm", "lazy_prm", "prm_star")
ALL = [s for s in scenes.all_scenes() if s.name != "empty"]
seeds = st.integers(0, 2**32 - 1)


def discs(rng, count=12):
    return np.column_stack((rng.uniform(1.5, 8.5, (count, 2)), rng.uniform(0.2, 0.9, count)))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("scene", ALL, ids=[s.name for s in ALL])
def test_every_path_is_right(scene, method) -> None:
    result = plan(scene.world, scene.start, scene.goal, method=method, budget=800, rng=1)
    assert result.status in ("solved", "out of samples")
    if result.path is not None:
        assert check_path(scene.world, result.path, scene.start, scene.goal)
    assert result.samples <= 800 and (method != "prm_star" or result.samples == 800)
    again = plan(scene.world, scene.start, scene.goal, method=method, budget=800, rng=1)
    assert again.cost == result.cost and again.edge_checks == result.edge_checks


@examples(15)
@given(seeds)
def test_the_answer_is_the_shortest_way_through_the_graph(seed) -> None:
    """Against Dijkstra's search in SciPy over the edges that the plan says are free."""
    rng = np.random.default_rng(seed)
    world = plane(SQUARE, discs(rng))
    result = plan(world, [0.5, 0.5], [9.5, 9.5], method="prm_star", budget=150, rng=rng)
    i, j = result.edges
    far = np.linalg.norm(result.nodes[:, i] - result.nodes[:, j], axis=0)
    m = result.nodes.shape[1]
    graph = coo_matrix((far, (i, j)), shape=(m, m))
    best = dijkstra(graph, directed=False, indices=0)[1]
    assert result.cost == pytest.approx(best)
    # Every edge that it holds is free, so is each step of the path one of them.
    assert all(check_path(world, result.nodes[:, [a, b]]) for a, b in result.edges.T[:50])


@examples(15)
@given(seeds)
def test_lazy_and_eager_find_the_same_way_in_the_same_roadmap(seed) -> None:
    rng = np.random.default_rng(seed)
    world = plane(SQUARE, discs(rng))
    requested = {}
    for lazy in (False, True):
        roadmap = build_roadmap(world, 200, 7, neighbours=8, lazy=lazy)
        assert ((roadmap.status == UNKNOWN) == lazy).all()
        result = plan(
            world, [0.5, 0.5], [9.5, 9.5], method="roadmap", roadmap=roadmap, budget=50, rng=2
        )
        requested[lazy] = result
        again = plan(
            world, [0.5, 0.5], [9.5, 9.5], method="roadmap", roadmap=roadmap, budget=50, rng=2
        )
        assert again.cost == result.cost and again.edge_checks <= result.edge_checks
    assert requested[True].cost == pytest.approx(requested[False].cost)
    assert requested[True].edge_checks >= requested[False].edge_checks


def test_neighbours_are_the_nearest_before_each_node() -> None:
    roadmap = build_roadmap(plane(SQUARE), 120, 3, neighbours=5)
    for i in range(6, 120):
        mine = set(roadmap.pairs[roadmap.pairs[:, 1] == i, 0].tolist())
        _, theirs = cKDTree(roadmap.nodes[:i]).query(roadmap.nodes[i], 5)
        assert mine == set(theirs.tolist())
    grown = [len(build_roadmap(plane(SQUARE), m, 3).pairs) / m for m in (100, 1000)]
    assert grown[1] - grown[0] == pytest.approx(np.exp(1.0) * 1.5 * np.log(10.0), rel=0.05)  # PRM*


@pytest.mark.parametrize("kind", ["plane", "polygons", "arm", "capsules"])
def test_a_revalidated_roadmap_is_the_one_that_would_be_built(kind) -> None:
    """Each edge as the world says by itself; and only what an obstacle touches is asked."""
    rng = np.random.default_rng(4)
    square = np.array([[4.0, 4.0], [6.0, 4.0], [6.0, 6.0], [4.0, 6.0]])
    if kind == "plane":
        table = discs(rng)
        old, new = plane(SQUARE, table), plane(SQUARE, np.vstack((table[1:], [[5.0, 5.0, 0.8]])))
    elif kind == "polygons":
        old, new = (plane(SQUARE, polygons=[square + deviation]) for deviation in (0.0, [1.0, 0.0]))
    elif kind == "arm":
        old = scenes.arm().world
        new = replace(old, obstacles=old.obstacles[1:])
    else:
        open_shelf = shelf("open")
        old, new = open_shelf.world, open_shelf.disturbed(rng, *open_shelf.query(rng))
    roadmap = build_roadmap(old, 150, 5, neighbours=6)
    before = roadmap.status.copy()
    now, requested = revalidated(roadmap, new)
    truth = [edge_free(new, *roadmap.nodes[pair]) for pair in roadmap.pairs]
    np.testing.assert_array_equal(now.status == FREE, truth)
    assert (roadmap.status == before).all() and (now.status != before).any()
    if kind == "capsules":  # nothing went, so what was blocked still is
        assert requested == (before == FREE).sum()
    back, _ = revalidated(now, old)
    np.testing.assert_array_equal(back.status, before)
    twice, _ = revalidated(adapted(roadmap, new), old)  # adapted twice, not asked between
    np.testing.assert_array_equal(twice.status, before)


@pytest.mark.slow
@pytest.mark.parametrize("attach", ["trees", "list"])
def test_queries_of_a_cached_roadmap_while_an_obstacle_moves(attach) -> None:
    requested, rng = shelf("tight"), np.random.default_rng(6)
    roadmap = build_roadmap(requested.world, 400, 0)
    blocked = (roadmap.status == BLOCKED).sum()
    for k in range(4):
        start, goal = requested.query(rng)
        world = requested.disturbed(rng, start, goal) if k % 2 else requested.world
        result = plan(
            world,
            start,
            goal,
            method="roadmap",
            roadmap=roadmap,
            attach=attach,
            rng=k,
            budget=20_000,
        )
        assert result.path is not None and check_path(world, result.path, start, goal)
    assert (roadmap.status == BLOCKED).sum() == blocked  # what a passing ball blocks is not kept
    assert result.path is not None
    more, k = with_paths(roadmap, [result.path]), result.path.shape[1]
    assert len(more.pairs) == len(roadmap.pairs) + k - 1 + 5 * k
    same = plan(world, start, goal, method="roadmap", roadmap=more)
    assert same.path is not None and check_path(world, same.path, start, goal)


def test_trees_solve_what_a_roadmap_does_not_reach() -> None:
    """Two rooms and no door in the roadmap's world: the way is found by the trees alone."""
    wall = [[4.9, 0.0, 5.1, 10.0]]
    closed = plane(SQUARE, boxes=wall)
    doors = [[4.9, 0.0, 5.1, 6.0], [4.9, 6.5, 5.1, 10.0]]
    door = plane(SQUARE, boxes=doors)
    roadmap = build_roadmap(closed, 100, 0, neighbours=6)
    result = plan(door, [1, 1], [9, 1], method="roadmap", roadmap=roadmap, rng=1)
    assert result.path is not None and check_path(door, result.path, [1, 1], [9, 1])
    empty = plan(closed, [1, 1], [9, 1], method="roadmap", roadmap=roadmap, budget=200)
    assert empty.status == "out of samples" and empty.path is None


def test_a_region_a_function_and_a_goal_that_cannot_be() -> None:
    world = from_function(lambda q: abs(q[0] - 5.0) > 1.0 or q[1] > 8.0, SQUARE, 0.05)
    box = Region(np.array([8.0, 1.0]), np.array([9.0, 2.0]))
    for method in ("prm", "lazy_prm"):
        result = plan(world, [1, 1], box, method=method, budget=400)
        assert result.path is not None
        assert check_path(world, result.path, [1, 1], np.array([box.low, box.high]))
    inside = Region(np.array([4.5, 1.0]), np.array([5.5, 2.0]))
    assert plan(world, [1, 1], inside, method="prm").status == "goal in collision"


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"method": "roadmap"}, "roadmap"),
        ({"method": "prm", "neighbours": 65}, "neighbours"),
        (
            {"method": "prm", "step": 1.0},
            "options of prm must be among mix, neighbours, sampler, spread, got 'step'",
        ),
        (
            {"method": "rrt", "stepp": 1.0},
            "options of rrt must be among goal_bias, mix, sampler, spread, step, got 'stepp'",
        ),
        ({"method": "lazy_prm", "sampler": "best"}, "sampler"),
    ],
)
def test_bad_input_is_named(options, named) -> None:
    with pytest.raises(ValueError, match=named):
        plan(plane(SQUARE, [[5.0, 5.0, 1.0]]), [1, 1], [9, 9], **options)


DISCS = [[1.2, 0.9, 0.35], [-1.0, 1.2, 0.4]]


@pytest.mark.parametrize(
    ("world", "named"),
    [
        (planar_arm([1.3, 1.3], 0.15, discs=DISCS), "body"),
        (planar_arm([1.0, 1.0], 0.02, discs=DISCS, bounds=[[-1, -1], [2, 2]]), "bounds"),
        (plane([[-3, -3], [3, 3]], discs=DISCS), "kind"),
        (planar_arm([1.0, 1.0, 1.0], 0.02, discs=DISCS), "bounds"),
    ],
)
def test_a_roadmap_answers_for_no_other_robot(world, named) -> None:
    """What was free for one body says nothing of another."""
    roadmap = build_roadmap(planar_arm([1.0, 1.0], 0.02, discs=DISCS), 300, 0)
    ends = np.array([[-0.9] * world.dim, [-0.5] * world.dim])
    with pytest.raises(ValueError, match=rf"{named} of the world must be .*that of the roadmap"):
        plan(world, *ends, method="roadmap", roadmap=roadmap)
    with pytest.raises(ValueError, match=named):
        revalidated(roadmap, world)


@pytest.mark.parametrize("attach", ["list", "trees"])
def test_a_world_that_is_changed_in_place_is_another_world(attach) -> None:
    """Its roadmap has tables of its own to compare with."""
    rng = np.random.default_rng(3)
    world = plane([[0.0, 0.0], [10.0, 10.0]], discs=[[9.0, 1.0, 0.5]])
    roadmap = build_roadmap(world, 400, 0)
    for _ in range(40):
        world.obstacles[0, 1:4] = *rng.uniform(2.0, 8.0, 2), rng.uniform(0.5, 1.5)
        ends = rng.uniform(0.0, 1.5, 2), rng.uniform(8.5, 10.0, 2)
        result = plan(world, *ends, method="roadmap", roadmap=roadmap, attach=attach, rng=rng)
        assert result.path is not None and check_path(world, result.path, *ends)


@pytest.mark.prove
def test_a_function_that_answers_otherwise_than_before_is_asked_again() -> None:
    radius = [0.1]

    def free(q) -> bool:
        return bool(np.hypot(*(q - 5.0)) > radius[0])

    world = from_function(free, [[0.0, 0.0], [10.0, 10.0]], 0.05)
    roadmap = build_roadmap(world, 200, 0)
    radius[0] = 2.0
    for seed in range(5):
        result = plan(world, [1.0, 1.0], [9.0, 9.0], method="roadmap", roadmap=roadmap, rng=seed)
        assert result.path is not None
        assert check_path(world, result.path, [1.0, 1.0], [9.0, 9.0])


def test_what_was_asked_in_the_same_world_is_remembered() -> None:
    world = plane([[0.0, 0.0], [10.0, 10.0]], discs=discs(np.random.default_rng(0)))
    roadmap = build_roadmap(world, 300, 0, lazy=True)
    ends = [0.2, 0.2], [9.8, 9.8]
    first, again = (
        plan(world, *ends, method="roadmap", roadmap=roadmap, attach="list") for _ in range(2)
    )
    assert again.edge_checks < first.edge_checks


@pytest.mark.prove
def test_the_ladder_of_the_five_second_question() -> None:
    """Small: the rungs that hold are faster than those before; what is proved does not collide."""
    sizes = {"queries": 3, "nodes": 200, "names": ("open",), "naive": 0.05, "samples": 300}
    (panel,) = charts.build("shelf_ladder", **sizes)
    for place in ("still", "moved"):
        middle = panel[f"median, {place}"].y
        assert np.isfinite(middle[[1, 5, 6, 7]]).all()
        assert (panel[f"slowest, {place}"].y >= middle).all()
    proved = [note for note in panel.notes[2:] if "collide" in note]
    proved = [note for note in proved if not note.startswith(("RRT in", "compiled", "in batches"))]
    proved = [note for note in proved if not note.startswith("both, in batches")]
    assert len(proved) == 16 and all(" 0 collide" in note for note in proved)
