"""Manifolds, contacts of a scene, and time of impact: closed forms, MuJoCo, brute force."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import contact
from course.charts.contact.geometry import random_poses
from course.contact.sweep import moved
from course.rigid_body.quaternion import exp, rotate
from tests.budget import examples
from tests.contact.draws import CUBE, SHAPES, at


def scene(*columns):
    return np.array(columns, dtype=float).T


def area(points):
    """Area of the convex hull of points in a plane z = const., shape (3, n)."""
    middle = points.mean(axis=1, keepdims=True)
    x, y = (points - middle)[:2, np.argsort(np.arctan2(*(points - middle)[:2]))]
    return abs(np.sum(x * np.roll(y, 1) - y * np.roll(x, 1))) / 2.0


@pytest.mark.prove
@pytest.mark.parametrize("sink", [0.01, 0.0, -0.01])
@pytest.mark.parametrize("swap", [False, True])
def test_the_faces_of_stacked_boxes_meet_in_their_common_polygon(sink, swap):
    for x, y, yaw, corners, common in (
        (0.0, 0.0, 0.0, 4, 1.0),
        (0.3, -0.2, 0.0, 4, 0.7 * 0.8),
        (0.0, 0.0, math.pi / 4, 8, 2.0 * (math.sqrt(2.0) - 1.0)),
    ):
        poses = scene(at(z=0.5), at(x, y, 1.5 - sink, (0.0, 0.0, yaw)))
        result = contact.contacts([CUBE, CUBE], poses[:, ::-1] if swap else poses, 0.02)
        assert result.distance == pytest.approx(np.full(corners, -sink), abs=1e-14)
        assert area(result.point) == pytest.approx(common, rel=1e-12)
        assert np.abs(result.point[2] - (1.0 - sink / 2.0)).max() < 1e-14
        assert np.abs(result.normal[2] - (-1.0 if swap else 1.0)).max() < 1e-14
        assert (result.bodies == [[0], [1]]).all()


def test_edges_that_cross_meet_in_one_point():
    high = 2.0 * math.sqrt(0.5) - 0.01
    poses = scene(at(turn=(math.pi / 4, 0, 0)), at(z=high, turn=(0, math.pi / 4, 0)))
    result = contact.contacts([CUBE, CUBE], poses)
    assert result.distance == pytest.approx([-0.01], abs=1e-14)
    assert result.point[:, 0] == pytest.approx([0.0, 0.0, high / 2.0], abs=1e-14)


def test_a_shape_on_a_plane_has_a_contact_for_each_corner():
    rod, ball = contact.capsule(0.1, 0.4), contact.sphere(0.2)
    poses = scene(at(), at(z=0.49), at(3, 0, 0.099, (math.pi / 2, 0, 0)), at(6, 0, 0.15))
    result = contact.contacts([contact.plane(), CUBE, rod, ball], poses)
    assert np.bincount(result.bodies[1]).tolist() == [0, 4, 2, 1]
    depths = [0.01] * 4 + [0.001] * 2 + [0.05]
    assert result.distance == pytest.approx(-np.array(depths), abs=1e-14)
    assert result.point[2] == pytest.approx(result.distance / 2.0, abs=1e-14)
    assert (result.normal == [[0.0], [0.0], [1.0]]).all()
    back = contact.contacts([CUBE, contact.plane()], poses[:, [1, 0]])
    assert (back.normal == [[0.0], [0.0], [-1.0]]).all()


def test_in_the_plane_two_faces_meet_in_two_points():
    square, floor = contact.box([0.5, 0.5]), contact.plane(dim=2)
    result = contact.contacts(
        [floor, square, square], scene((0, 0, 0), (0, 0.49, 0), (0.3, 1.48, 0))
    )
    assert result.bodies.tolist() == [[0, 0, 1, 1], [1, 1, 2, 2]]
    assert np.sort(result.point[0, 2:]) == pytest.approx([-0.2, 0.5], abs=1e-14)
    assert result.distance == pytest.approx(np.full(4, -0.01), abs=1e-14)
    assert result.normal.T == pytest.approx(np.tile([0.0, 1.0], (4, 1)), abs=1e-14)


@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_a_scene_has_the_contacts_of_its_pairs(margin):
    rng = np.random.default_rng(11)
    kinds = [*SHAPES.values(), contact.plane()]
    shapes = [kinds[k] for k in rng.integers(0, len(kinds), 40)]
    poses = random_poses(rng, 40, 2.0)
    result = contact.contacts(shapes, poses, margin)
    expected = []
    for i in range(40):
        for j in range(i + 1, 40):
            if shapes[i].name != "plane" or shapes[j].name != "plane":
                measured = contact.distance(shapes[i], poses[:, i], shapes[j], poses[:, j])
                if measured.distance <= margin:
                    expected.append((i, j, measured.distance))
    pairs = sorted({(int(i), int(j)) for i, j in result.bodies.T})
    assert pairs == [(i, j) for i, j, _ in expected]
    assert list(map(tuple, result.bodies.T.tolist())) == sorted(
        map(tuple, result.bodies.T.tolist())
    )
    for i, j, far in expected:
        of = (result.bodies[0] == i) & (result.bodies[1] == j)
        assert result.distance[of].min() == pytest.approx(far, abs=1e-12)
        assert (result.distance[of] <= margin).all()


def test_the_manifold_supports_what_mujoco_supports():
    """Boxes dropped flat on each other: as many corners, at the same places and depths."""
    from course.oracles.mujoco import shapes as oracle

    rng = np.random.default_rng(12)
    for _ in range(20):
        x, y, yaw = rng.uniform(-0.4, 0.4, 3)
        poses = scene(at(z=0.5), at(x, y, 1.49, (0.0, 0.0, yaw)))
        result = contact.contacts([CUBE, CUBE], poses)
        points, distances = oracle.box_contacts(CUBE.half, CUBE.half, poses)
        assert distances == pytest.approx(np.full(distances.size, -0.01), abs=1e-12)
        assert area(result.point) == pytest.approx(area(points), rel=1e-9)


# --- time of impact -------------------------------------------------------------------------------


def flight(rng, n):
    """Two batches of poses apart, and velocities with turning that bring many of them together."""
    pose_a, pose_b = random_poses(rng, n, 2.0), random_poses(rng, n, 2.0)
    return pose_a, rng.normal(size=(6, n)) * 2.0, pose_b, rng.normal(size=(6, n)) * 2.0


def test_balls_touch_when_the_closed_form_says():
    rng = np.random.default_rng(13)
    a, b = contact.sphere(0.3), contact.sphere(0.5)
    pose_a, v, pose_b, w = flight(rng, 2000)
    result = contact.time_of_impact(a, pose_a, v, b, pose_b, w, 3.0, 1e-11)
    offset, rate = (pose_b - pose_a)[:3], (w - v)[:3]
    exact = contact.spheres_time_of_impact(offset, rate, 0.8)
    hit = exact <= 3.0
    assert hit.sum() > 100
    # Where they only graze, the tolerance makes a hit of a near miss.
    graze = np.abs(np.linalg.norm(offset + rate * np.where(hit, exact, 0.0), axis=0) - 0.8) < 1e-9
    assert np.isfinite(result.time[hit]).all()
    assert graze[hit & (exact > 0)].all()
    assert (np.abs(result.time - np.where(hit, exact, 0.0))[hit] < 1e-8).mean() > 0.99
    assert result.converged.all()


@pytest.mark.parametrize(("first", "second"), [("box", "box"), ("capsule", "points")])
def test_nothing_touches_before_the_time_of_impact(first, second):
    rng = np.random.default_rng(14)
    a, b = SHAPES[first], SHAPES[second]
    pose_a, v, pose_b, w = flight(rng, 600)
    near = 1e-8
    result = contact.time_of_impact(a, pose_a, v, b, pose_b, w, 1.0, near)
    start = contact.distance(a, pose_a, b, pose_b).distance
    hit, free = np.isfinite(result.time), start > near
    assert (result.time[~free] == 0.0).all()
    assert 30 < (hit & free).sum() < free.sum()
    assert result.converged.all()

    def distance_at(t):
        return contact.distance(a, moved(pose_a, v, t), b, moved(pose_b, w, t)).distance

    until = np.where(hit, result.time, 1.0)
    for share in np.linspace(0.0, 0.999, 60):
        assert (distance_at(share * until)[free] > 0.0).all()
    assert np.abs(distance_at(until)[hit & free] - near / 2.0).max() <= near / 2.0


def test_a_turning_square_meets_the_floor_with_its_corner():
    result = contact.time_of_impact(
        contact.box([0.5, 0.5]),
        (0.0, 2.0, math.pi / 4),
        (0.0, -1.0, 0.0),
        contact.plane(2),
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        5.0,
    )
    assert result.time == pytest.approx(2.0 - math.sqrt(0.5), abs=1e-8)
    assert result.normal == pytest.approx([0.0, -1.0])
    assert result.point == pytest.approx([0.0, 0.0], abs=1e-8)


@given(st.floats(1.0, 400.0), st.floats(0.0, 1.0))
@examples(40)
def test_no_wall_is_thin_enough_and_no_step_long_enough(speed, phase):
    """A ball at a sheet of a tenth of a millimetre, which a test once a step would miss."""
    ball, sheet = contact.sphere(0.02), contact.box([0.00005, 1.0, 1.0])
    gap = 0.3 + phase
    result = contact.time_of_impact(
        ball, at(-gap), (speed, 0, 0, 0, 0, 0), sheet, at(), np.zeros(6), 2.0
    )
    assert result.time == pytest.approx((gap - 0.02005) / speed, abs=2e-9 / speed)
    assert result.advances <= 4


@pytest.mark.parametrize(("gap", "ends"), [(1e-3, True), (1e-7, False)])
def test_a_search_beside_a_turning_face_ends_or_reports_that_it_was_cut_short(gap, ends):
    """The face of a cube turns into a ball, whose centre moves on a circle in the cube's frame.

    It touches where the centre's distance from the face, c cos(angle) - 1/2, is the radius.
    """
    radius = 0.3
    centre = 0.5 + radius + gap
    cube, spin = contact.box([0.5] * 3), (0, 0, 0, 0, 0, 1.0)
    ball = contact.sphere(radius)
    result = contact.time_of_impact(cube, at(), spin, ball, at(centre), np.zeros(6), 1.0)
    truth = math.acos((0.5 + radius) / centre)
    assert result.converged == ends
    if ends:
        assert result.time == pytest.approx(truth, abs=1e-6)
        return
    # Cut short, it has not passed the impact, and it names no normal.
    assert 0.0 < result.time < truth
    assert np.isnan(result.normal).all() and np.isnan(result.point).all()


def test_balls_in_any_dimension_and_hard_cases():
    toi = contact.spheres_time_of_impact
    assert toi([3.0], [-1.0], 1.0) == 2.0
    assert toi([3.0, 0.0], [1.0, 0.0], 1.0) == np.inf
    assert toi([0.5, 0.0], [0.0, 0.0], 1.0) == 0.0
    assert toi([3.0, 0.0], [0.0, 0.0], 1.0) == np.inf
    # Far away and slow: the textbook formula loses ten digits here.
    assert toi([1e8, 0.0, 0.0], [-1e-3, 0.0, 0.0], 1.0) == pytest.approx((1e8 - 1) * 1e3, rel=1e-15)
    near = toi([1.0 + 1e-12, 0.0], [-1.0, 0.0], 1.0)
    assert near == pytest.approx((1.0 + 1e-12) - 1.0, rel=1e-3)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"duration": -1.0}, "duration"),
        ({"duration": np.nan}, "duration"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"velocity_a": np.zeros(3)}, "velocity_a.shape"),
        ({"velocity_b": np.full(6, np.nan)}, "velocity_b"),
        ({"b": contact.plane(), "velocity_b": np.ones(6)}, "without turning"),
    ],
)
def test_bad_flights_are_named(change, words):
    usual = {
        "a": CUBE,
        "pose_a": at(),
        "velocity_a": np.zeros(6),
        "b": CUBE,
        "pose_b": at(3.0),
        "velocity_b": np.zeros(6),
        "duration": 1.0,
    }
    with pytest.raises(ValueError, match=words):
        contact.time_of_impact(**(usual | change))
    with pytest.raises(ValueError, match="reach"):
        contact.spheres_time_of_impact([1.0], [1.0], 0.0)
    with pytest.raises(ValueError, match=r"velocity\.shape"):  # not broadcast to three flights
        contact.spheres_time_of_impact([1.0, 2.0, 3.0], np.ones((3, 3)), 0.1)
    with pytest.raises(ValueError, match=r"reach\.shape"):
        contact.spheres_time_of_impact(np.ones((3, 2)), np.ones((3, 2)), np.ones(5))


def test_turning_is_about_the_origin_of_the_shape():
    rod = contact.capsule(0.1, 1.0)
    ball = contact.sphere(0.1)
    # The rod's end comes round to the ball after a quarter turn, less what both radii span.
    result = contact.time_of_impact(
        rod, at(), (0, 0, 0, 0, 1.0, 0), ball, at(0.9), np.zeros(6), 3.0, 1e-10
    )
    assert result.time == pytest.approx(math.pi / 2 - math.asin(0.2 / 0.9), abs=1e-8)
    end = rotate(exp(np.array([0.0, result.time, 0.0])), np.array([0.0, 0.0, 0.9]))
    assert end[0] < 0.9
