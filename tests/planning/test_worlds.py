"""Worlds: exact segment tests against rational arithmetic and many points, proved edges of arms."""

import functools
import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from course.compiled import compiled
from course.kinematics import frames
from course.kinematics import planar as planar_chain
from course.planning import (
    clearance,
    edge_free,
    from_function,
    plan,
    planar_arm,
    plane,
    scenes,
    state_free,
)
from course.planning.worlds import CLEARANCE, FLOOR
from tests.budget import examples

NUMBER: Any = 3
WIDE = [[-100.0, -100.0], [100.0, 100.0]]
coordinate = st.integers(-80, 80).map(lambda k: k / 8)  # exact, and ties are common
point = st.tuples(coordinate, coordinate)
MINUS = [
    [0, 0],
    [4, 0],
    [4, 1],
    [3, 1],
    [3, 3],
    [4, 3],
    [4, 4],
    [0, 4],
    [0, 3],
    [1, 3],
    [1, 1],
    [0, 1],
]


def rational_meets(a, b, ring) -> bool:
    """Whether a segment shares a point with a closed polygon, without rounding."""
    (ax, ay), (bx, by) = (tuple(map(Fraction, p)) for p in (a, b))
    corners = [tuple(map(Fraction, p)) for p in ring]
    sides = list(zip(corners, corners[1:] + corners[:1], strict=True))
    cuts = {Fraction(0), Fraction(1)}
    for (px, py), (qx, qy) in sides:
        dx, dy, ex, ey = bx - ax, by - ay, qx - px, qy - py
        area = dx * ey - dy * ex
        if area:
            t, u = (
                ((px - ax) * ey - (py - ay) * ex) / area,
                ((px - ax) * dy - (py - ay) * dx) / area,
            )
            if 0 <= t <= 1 and 0 <= u <= 1:
                return True
            cuts |= {t} if 0 <= t <= 1 else set()
    for t in cuts:  # no side is crossed: the ends lie inside, outside or along a side
        x, y = ax + t * (bx - ax), ay + t * (by - ay)
        inside = False
        for (px, py), (qx, qy) in sides:
            area = (qx - px) * (y - py) - (qy - py) * (x - px)
            if area == 0 and min(px, qx) <= x <= max(px, qx) and min(py, qy) <= y <= max(py, qy):
                return True
            if (py > y) != (qy > y) and (area > 0) == (qy > py):
                inside = not inside
        if inside:
            return True
    return False


@examples(200)
@given(point, point, st.booleans())
@example((-1.0, 0.0), (5.0, 0.0), True)  # along a side
@example((-1.0, 1.0), (1.0, -1.0), False)  # through a corner
@example((2.0, 2.0), (2.0, 2.0), True)  # no length, inside
@example((3.5, 1.5), (3.5, 2.5), False)  # in a bay, outside
def test_a_segment_meets_a_polygon_as_in_rational_arithmetic(a, b, reverse) -> None:
    ring = MINUS[::-1] if reverse else MINUS
    assert edge_free(plane(WIDE, polygons=[ring]), a, b) != rational_meets(a, b, ring)


@pytest.mark.prove
@examples(200)
@given(point, point, point, st.integers(1, 40).map(lambda k: k / 8))
def test_a_segment_meets_a_disc_as_in_rational_arithmetic(a, b, centre, radius) -> None:
    (ax, ay), (bx, by), (x, y) = (tuple(map(Fraction, p)) for p in (a, b, centre))
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    t = ((x - ax) * dx + (y - ay) * dy) / square if square else Fraction(0)
    t = min(max(t, Fraction(0)), Fraction(1))
    gap = (x - ax - t * dx) ** 2 + (y - ay - t * dy) ** 2 - Fraction(radius) ** 2
    assume(gap == 0 or abs(gap) > 1e-12)
    if gap:  # a tangent is decided by rounding
        assert edge_free(plane(WIDE, discs=[[*centre, radius]]), a, b) == (gap > 0)


@pytest.mark.prove
@examples(60)
@given(st.integers(0, 10**6))
def test_the_clearance_is_that_of_the_nearest_of_many_points(seed) -> None:
    rng = np.random.default_rng(seed)
    world = plane(WIDE, rng.uniform(1, 3, (2, 3)), [[-4, -2, -1, 0]], [MINUS])
    q = rng.uniform(-6, 6, 2)
    gap, turn = clearance(world, q), np.linspace(0, 2 * np.pi, 48, endpoint=False)
    assert (gap > 0.0) == state_free(world, q)
    around = (
        q + abs(gap) * np.array([0.999, 1.001])[:, None, None] * np.c_[np.cos(turn), np.sin(turn)]
    )
    same = [[state_free(world, p) == (gap > 0) for p in ring] for ring in around]
    assert all(same[0])  # nothing changes within it
    if gap > 0:
        fine = np.linspace(0, 2 * np.pi, 4000)
        ring = q + 1.001 * gap * np.c_[np.cos(fine), np.sin(fine)]
        assert not all(state_free(world, p) for p in ring)  # and just beyond something is hit


# --- arms -----------------------------------------------------------------------------------------


def test_the_arm_is_that_of_chapter_4() -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        lengths, q = rng.uniform(0.3, 1.5, 3), rng.uniform(-3, 3, 3)
        chain = planar_chain(lengths)
        joints = frames(chain, q)[:2].T
        disc = rng.uniform(-2, 2, 2)
        free = clearance(planar_arm(lengths, 0.1, discs=[[*disc, 0.2]]), q)
        ends = np.vstack(
            (joints, joints[-1] + lengths[-1] * np.array([math.cos(q.sum()), math.sin(q.sum())]))
        )
        ts = np.linspace(0, 1, 2001)[:, None, None]
        points = ends[:-1] + ts * (ends[1:] - ends[:-1])
        assert free == pytest.approx(np.linalg.norm(points - disc, axis=2).min() - 0.3, abs=1e-3)


def arm_with(rng: np.random.Generator):
    boxes = [[x, y, x + 0.5, y + 0.4] for x, y in rng.uniform(-2.5, 2, (2, 2))]
    discs = np.column_stack((rng.uniform(-3, 3, (3, 2)), rng.uniform(0.1, 0.5, 3)))
    return planar_arm([1.0, 0.8, 0.6], [0.05, 0.04, 0.03], discs, boxes)


def test_a_proved_edge_is_free_and_few_free_ones_are_refused() -> None:
    rng = np.random.default_rng(2)
    wrong = rejected = passed = 0
    for _ in range(20):
        world = arm_with(rng)
        gap = functools.partial(compiled(world.clearance, CLEARANCE), world.obstacles, world.body)
        for _ in range(30):
            a = rng.uniform(-3, 3, 3)
            b = a + rng.normal(0, 0.4, 3)
            finer = np.linspace(a, b, 500)
            least = min(map(gap, finer))
            free = edge_free(world, a, b)
            wrong += free and least <= 0.0
            # Between two of the points no part of the arm moves more than this.
            unseen = 2.4 * np.abs(b - a).sum() / 500
            rejected += not free and least > unseen
            passed += free
    assert wrong == 0 and rejected == 0 and passed > 150


@pytest.mark.parametrize("gap", [0.5, 2.0])
def test_an_edge_that_grazes_is_given_up_at_the_floor(gap: float) -> None:
    """A link turned past a disc: free by less than the floor is refused, by more it is passed."""
    world = planar_arm([1.0], 0.0, discs=[[1.2 + gap * FLOOR, 0.0, 0.2]])
    assert edge_free(world, [-0.5], [0.5]) == (gap > 1.0)


def test_an_edge_that_would_take_a_quadrillion_tests_is_given_up() -> None:
    """A link of 1e11 m, its base 20 um from a disc: free, and never proved."""
    world = planar_arm([1e11], 0.0, discs=[[0.0, 0.5, 0.5 - 2e-5]])
    assert state_free(world, [-0.5]) and not edge_free(world, [-0.5], [-0.1])


# --- a function of the user, bad input ------------------------------------------------------------


def test_a_function_is_asked_along_an_edge_at_its_resolution() -> None:
    requested = []

    def valid(q):
        requested.append(q)
        return True

    world = from_function(valid, [[0, 0], [1, 1]], 0.1)
    assert edge_free(world, [0.0, 0.0], [0.6, 0.8])
    assert len(requested) == 11
    np.testing.assert_allclose(np.linalg.norm(np.diff(requested, axis=0), axis=1), 0.1)
    result = plan(world, [0.1, 0.1], [0.9, 0.9], budget=100)
    assert result.solved and result.state_checks == len(requested) - 11


def test_what_a_function_raises_comes_out() -> None:
    def valid(q):
        return 1 / bool(q[0] < 0.2) > 0  # a division by zero beyond

    world = from_function(valid, [[0, 0], [1, 1]], 0.05)
    with pytest.raises(ValueError, match=r"valid.*ZeroDivisionError.*at \["):
        plan(world, [0.1, 0.1], [0.1, 0.9], method="rrt", step=0.1)

    def stopped(q):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        plan(from_function(stopped, [[0, 0], [1, 1]], 0.05), [0.1, 0.1], [0.4, 0.4])


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: plane([[0, 0], [1, 0]]), "bounds"),
        (lambda: plane([[0.0, 0.0], [1.0, np.nan]]), "bounds"),
        (lambda: plane(WIDE, discs=[[0, 0, 0.0]]), "discs"),
        (lambda: plane(WIDE, boxes=[[0, 0, 0, 1]]), "boxes"),
        (lambda: plane(WIDE, polygons=[[[0, 0], [1, 1]]]), "polygons"),
        # A bow tie, and corners on a line.
        (lambda: plane(WIDE, polygons=[[[1, 1], [3, 3], [3, 1], [1, 3]]]), "sides meet at its"),
        (lambda: plane(WIDE, polygons=[[[1, 1], [2, 2], [3, 3]]]), "polygon with an area"),
        (lambda: planar_arm([1.0, -1.0]), "lengths"),
        (lambda: planar_arm([]), "lengths"),
        (lambda: planar_arm([1.0], -0.1), "radius"),
        (lambda: planar_arm([1.0, 1.0], bounds=[[0], [1]]), "bounds"),
        (lambda: from_function(lambda q: True, [[0.0], [1.0]], 0.0), "resolution"),
        (lambda: from_function(NUMBER, [[0.0], [1.0]], 0.1), "valid"),
        (lambda: scenes.gap(1.5), "share"),
        (lambda: state_free(plane(WIDE), [1.0, 2.0, 3.0]), "q"),
    ],
)
def test_a_wrong_world_is_refused_and_named(make, named) -> None:
    with pytest.raises(ValueError, match=named):
        make()
