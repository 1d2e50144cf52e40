"""The judge of paths: what it must find, and that it shares no code with the planners' tests."""

import ast
import inspect
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.planning import check, check_path, edge_free, from_function, planar_arm, plane, scenes
from course.planning.worlds import World
from tests.budget import examples

WIDE = [[0.0, 0.0], [10.0, 10.0]]


def mixed(rng: np.random.Generator) -> World:
    discs = np.column_stack((rng.uniform(0, 10, (4, 2)), rng.uniform(0.2, 1, 4)))
    turn, size = np.arange(8) * np.pi / 4, np.tile([2.0, 0.7], 4)
    star = 5.0 + np.column_stack((size * np.cos(turn), size * np.sin(turn)))
    return plane(WIDE, discs, [[1, 6, 3, 7]], [star])


@examples(150)
@given(st.integers(0, 10**6))
def test_it_agrees_with_the_planners_test(seed) -> None:
    """Two ways to the same answer, written apart; random segments don't graze."""
    rng = np.random.default_rng(seed)
    world, (a, b) = mixed(rng), rng.uniform(0, 10, (2, 2))
    assert bool(check_path(world, np.column_stack((a, b)))) == edge_free(world, a, b)


@examples(30)
@given(st.integers(0, 10**6))
def test_it_agrees_about_arms(seed) -> None:
    rng = np.random.default_rng(seed)
    world = scenes.arm().world
    a = rng.uniform(-2, 2, 4)
    b = a + rng.uniform(-0.8, 0.8, 4)
    assert bool(check_path(world, np.column_stack((a, b)))) == edge_free(world, a, b)


@pytest.mark.parametrize("depth", [-1e-6, -1e-8, 1e-8, 1e-6])
def test_it_sees_a_cut_of_ten_nanometres(depth: float) -> None:
    across = np.array([[0.0, 10.0], [5.0, 5.0]])
    disc = plane(WIDE, discs=[[5.0, 6.0 - depth, 1.0]])
    spike = plane(WIDE, polygons=[[[4.0, 7.0], [5.0, 5.0 - depth], [6.0, 7.0]]])
    thin = plane(WIDE, boxes=[[5.0, 5.0 - depth, 5.0 + 1e-7, 7.0]])
    turn = planar_arm([1.0], discs=[[1.2 - depth, 0.0, 0.2]])
    for world in (disc, spike):
        assert bool(check_path(world, across)) == (depth < 0.0)
    assert bool(check_path(turn, [[-0.5, 0.5]])) == (depth < 0.0)
    if abs(depth) > 1e-7:
        assert bool(check_path(thin, across)) == (depth < 0.0)


def test_a_link_that_rests_against_a_disc_does_not_halve_the_edge_forever() -> None:
    """Joint 2 moves; link 1 stands, a trillionth of a metre deep, which passes."""
    world = planar_arm([1.0, 0.5], discs=[[0.5, 0.2 - 1e-12, 0.2]])
    states: list[int] = []
    assert check._judge_arm(world, np.zeros(2), np.array([0.0, 1.0])) is None

    def resting(q: np.ndarray) -> np.ndarray:
        states.append(q.shape[1])
        return np.stack((np.full(q.shape[1], -1e-12), np.full(q.shape[1], 1.0)))

    assert check.prove(np.zeros(2), np.array([0.0, 1.0]), resting, [0.0, 0.5]) is None
    assert sum(states) == 3  # both ends and the middle


def test_an_edge_along_which_a_link_grazes_is_refused_in_the_end() -> None:
    sizes: list[int] = []

    def grazing(q: np.ndarray) -> np.ndarray:
        sizes.append(q.shape[1])
        return np.zeros((1, q.shape[1]))

    assert check.prove(np.zeros(1), np.ones(1), grazing, [1.0]) is not None
    assert max(sizes) <= 2 * check.UNDECIDED + 2


def test_a_dip_passes_only_up_to_tolerance_and_resolved_together() -> None:
    """A clearance that falls as fast as the link travels, down to a dip at a random place."""

    def dip(place: float, depth: float) -> np.ndarray | None:
        def gaps(q: np.ndarray) -> np.ndarray:
            return np.abs(q - place) - depth

        return check.prove(np.zeros(1), np.ones(1), gaps, [1.0])

    places = np.random.default_rng(4).uniform(0.0, 1.0, 50)
    for place in places:
        assert dip(place, 0.9 * check.TOLERANCE) is None
        state = dip(place, 1.01 * (check.TOLERANCE + check.RESOLVED))
        assert state is not None and abs(state[0] - place) < 1.2 * check.RESOLVED
    # The bound is not an idle one: deeper than `TOLERANCE` alone, some dips do pass.
    assert any(dip(place, 4.0 * check.TOLERANCE) is None for place in places)


def test_a_clearance_that_is_no_number_collides() -> None:
    for at in (0.0, 0.5):

        def gaps(q: np.ndarray, at: float = at) -> np.ndarray:
            return np.where(q == at, np.nan, 1.0)

        state = check.prove(np.zeros(1), np.ones(1), gaps, [1.0])
        assert state is not None and state == [at]


def test_it_sees_a_path_through_two_corners() -> None:
    """The diagonal of a square crosses no side: only its middle is inside."""
    square = plane(WIDE, boxes=[[4, 4, 6, 6]])
    verdict = check_path(square, [[4.0, 6.0], [4.0, 6.0]])
    assert not verdict and verdict.edge == 0
    assert verdict.state is not None and verdict.state.tolist() == [5.0, 5.0]
    assert not check_path(square, [[5.0], [5.0]])  # a path of one state


def test_every_kind_of_wrong_path_is_named() -> None:
    world, start, goal = plane(WIDE, discs=[[5, 5, 1]]), np.array([1.0, 1.0]), np.array([9.0, 9.0])
    right = np.array([[1.0, 1.0, 9.0], [1.0, 9.0, 9.0]])

    def reason(path, **ends):
        return check_path(world, path, **ends).reason

    assert check_path(world, right, start, goal) and not reason(right)
    assert check_path(world, right, start, [[8, 8], [10, 10]])
    assert "collides" in reason(np.column_stack((start, goal)))
    assert "bounds" in reason(right + [[0.0], [1.5]])
    assert "finite" in reason(right * [[1.0], [np.nan]])
    assert "start" in reason(right, start=start + 1e-12)
    assert "goal" in reason(right, goal=goal - 1e-12)
    shapes: list[Any] = [right.T, [], right[0], "path"]
    assert all("shape" in reason(shape) for shape in shapes)
    assert "no path" in reason(None)
    with pytest.raises(ValueError, match="kind"):
        check_path(World("foam", *(world.bounds,) * 3, *(edge_free,) * 3), right)


def test_a_function_is_judged_at_the_points_that_its_resolution_asks_for() -> None:
    world = from_function(lambda q: abs(q[0] - 0.5) > 0.02, [[0.0], [1.0]], 0.1)
    assert not check_path(world, [[0.0, 1.0]])  # 0.5 is one of them
    assert check_path(world, [[0.05, 0.95]])  # the wall of 0.04 is between two of them


def test_it_is_of_its_own_code() -> None:
    tree = ast.parse(inspect.getsource(check))
    taken = {
        name.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("course.planning")
        for name in node.names
    }
    # Columns of tables are data: what can be called is code.
    assert {name for name in taken if callable(getattr(check, name))} == {
        "World",
        "function_behind",
    }
