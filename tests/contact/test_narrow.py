"""Narrow phase: against every feature, closed forms and Coal, in hard scenes, with bad input."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from course import contact
from course.charts.contact.geometry import random_poses
from course.contact.shapes import corners_in_space
from course.oracles import coal
from course.rigid_body.quaternion import exp
from tests.budget import examples
from tests.contact import draws
from tests.contact.draws import CUBE, SHAPES, at

PAIRS = list(itertools.combinations_with_replacement(SHAPES, 2))
HALF = math.sqrt(0.5)


def check_points(a, pose_a, b, pose_b, result):
    """The points lie on the surfaces, and are as far apart as the distance says."""
    size = a.size + b.size
    between = result.point_b - result.point_a
    assert np.abs(between - result.distance * result.normal).max() < 1e-13 * size
    assert np.abs(np.linalg.norm(result.normal, axis=0) - 1.0).max() < 1e-13
    point = contact.points(np.zeros((a.dim, 1)))
    for shape, pose, place in ((a, pose_a, result.point_a), (b, pose_b, result.point_b)):
        still = at() if a.dim == 3 else np.zeros(3)
        q = np.tile(still[:, None], place.shape[1])
        q[: a.dim] = place
        inside = contact.distance(shape, pose, point, q).distance
        assert np.abs(inside).max() < 1e-12 * size


@pytest.mark.parametrize("spread", [0.3, 1.5])
@pytest.mark.parametrize(("first", "second"), PAIRS)
def test_agrees_with_coal(first, second, spread):
    rng = np.random.default_rng([ord(letter) for letter in first + second])
    pose_a, pose_b = random_poses(rng, 300, spread), random_poses(rng, 300, spread)
    a, b = SHAPES[first], SHAPES[second]
    result = contact.distance(a, pose_a, b, pose_b)
    other = coal.Pair(a, b).distances(pose_a, pose_b)
    assert np.abs(result.distance - other).max() < 1e-9 * (a.size + b.size)
    assert result.gap.max() < 1e-13
    assert result.iterations.max() < 60
    check_points(a, pose_a, b, pose_b, result)
    # The other way round the same, with the normal turned.
    back = contact.distance(b, pose_b, a, pose_a)
    assert np.abs(back.distance - result.distance).max() < 1e-13


def test_positions_whose_squares_overflow_are_rejected():
    """At 1e155 m the distance of two boxes came out as 0."""
    box = contact.box([0.5, 0.5, 0.5])
    here, far = (np.array([x, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]) for x in (0.0, 1e150))
    assert contact.distance(box, here, box, far).distance == pytest.approx(1e150)
    with pytest.raises(ValueError, match="pose_b"):
        contact.distance(box, here, box, 1e5 * far)


def test_the_batch_that_is_timed_computes_every_pair():
    """Pinocchio's one call for all pairs finds what single calls of Coal find."""
    rng = np.random.default_rng(8)
    a, b = SHAPES["box"], SHAPES["capsule"]
    pose_a, pose_b = random_poses(rng, 40, 0.8), random_poses(rng, 40, 0.8)
    batch = coal.Batch(a, pose_a, b, pose_b)
    batch.compute()
    expected = coal.Pair(a, b).distances(pose_a, pose_b)
    assert batch.distances() == pytest.approx(expected, abs=1e-9)
    assert (expected > 0.0).any() and (expected < 0.0).any()


@pytest.mark.parametrize(
    ("first", "second"),
    [("box", "box"), ("capsule", "box"), ("sphere", "box"), ("capsule", "capsule")],
)
@pytest.mark.parametrize("angle", [None, 1e-4, 1e-8, 1e-12, 0.0])
def test_agrees_with_every_feature(first, second, angle):
    rng = np.random.default_rng(5)
    pose_a = random_poses(rng, 300, 0.6)
    pose_b = random_poses(rng, 300, 0.6)
    if angle is not None:
        pose_b[3:] = draws.turned(rng, pose_a, angle)[3:]
    a, b = SHAPES[first], SHAPES[second]
    if first == second == "capsule" and angle in (0.0, 1e-12):
        with pytest.raises(ValueError, match="two edges that are not parallel"):
            contact.enumerated(a, pose_a, b, pose_a)
        return
    result = contact.distance(a, pose_a, b, pose_b).distance
    assert (result > 0.0).any()
    assert (result < 0.0).any()
    assert np.abs(result - contact.enumerated(a, pose_a, b, pose_b)).max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("corners", [60, 200, 400])
def test_the_depth_of_round_bodies_is_that_of_the_hull_of_their_differences(corners):
    """The least distance from the origin to a face of that hull; concentric balls are the worst."""
    rng = np.random.default_rng(corners)
    for _ in range(4):
        points = rng.standard_normal((2, 3, corners))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        shift = 0.02 * rng.standard_normal(3)
        a, b = (contact.points(p) for p in points)
        result = contact.distance(a, at(), b, at(*shift))
        differences = points[0][:, :, None] - points[1][:, None] - shift[:, None, None]
        depth = -ConvexHull(differences.reshape(3, -1).T).equations[:, 3].max()
        assert -result.distance >= depth - 1e-9
        assert -result.distance - result.gap <= depth + 1e-9
        assert result.gap < 1e-9


GAPS = [1e-3, 1e-6, 1e-9, 1e-12, 0.0, -1e-12, -1e-9, -1e-6, -1e-3]


@pytest.mark.parametrize("gap", GAPS)
def test_faces_that_are_all_but_touching(gap):
    exact = (1.0 + gap) - 1.0
    for place in (at(1.0 + gap), at(1.0 + gap, 0.1, 0.2), at(1.0 + gap, 0.99, -0.99)):
        result = contact.distance(CUBE, at(), CUBE, place)
        assert abs(result.distance - exact) < 1e-15
        assert result.normal[0] > 0.999999
    plate = contact.box([5.0, 5.0, 5e-4])
    result = contact.distance(plate, at(), plate, at(0.3, 0.2, 1e-3 + gap))
    # Plates that are deep in each other leave sideways only if that were nearer.
    assert abs(result.distance - (1e-3 + gap - 1e-3)) < 1e-15
    big, small = contact.box([500.0] * 3), contact.box([5e-4] * 3)
    result = contact.distance(big, at(), small, at(500.0005 + gap, 1.0, 2.0))
    assert abs(result.distance - (500.0005 + gap - 500.0 - 5e-4)) < 1e-12
    edge = at(turn=(0.0, 0.0, math.pi / 4))
    across = at(2 * HALF + gap, turn=(0.0, math.pi / 4, 0.0))
    assert abs(contact.distance(CUBE, edge, CUBE, across).distance - gap) < 1e-15
    for angle in (1e-4, 1e-8, 1e-12):
        turned = at(1.0 + gap, 0.1, 0.2, (angle, 0.3 * angle, -0.7 * angle))
        signed = contact.distance(CUBE, at(), CUBE, turned).distance
        assert abs(signed - contact.enumerated(CUBE, at(), CUBE, turned)[0]) < 1e-15


FLAT = contact.points([[0.0, 1.0, 1.0, 0.0], [0.0, 0.0, 1.0, 1.0], [0.0] * 4])
ROD = contact.capsule(0.2, 0.5)
BAR = contact.capsule(0.1, 0.5, dim=2)


@pytest.mark.parametrize(
    ("a", "b", "pose_b", "expected"),
    [
        (contact.sphere(1.0), contact.sphere(0.5), at(), -1.5),
        (ROD, ROD, at(), -0.4),
        (ROD, ROD, at(turn=(math.pi / 2, 0.0, 0.0)), -0.4),
        (ROD, ROD, at(y=1e-9, turn=(0.0, math.pi / 2, 0.0)), 1e-9 - 0.4),
        (ROD, ROD, at(z=0.3), -0.4),
        (ROD, ROD, at(z=1.3), -0.1),
        (CUBE, CUBE, at(), -1.0),
        (contact.box([500.0] * 3), contact.box([5e-4] * 3), at(100.0, 1.0, 2.0), -400.0005),
        (
            contact.box([1.0, 1e-6, 1e-6]),
            contact.box([1.0, 1e-6, 1e-6]),
            at(z=1e-6, turn=(0.0, 0.0, math.pi / 2)),
            -1e-6,
        ),
        (FLAT, FLAT, at(0.5, 0.5), 0.0),
        (FLAT, FLAT, at(1.5, 0.5), 0.5),
        (FLAT, FLAT, at(0.5, 0.5, -0.5, (math.pi / 2, 0.0, 0.0)), -0.5),
        (FLAT, contact.sphere(0.25), at(0.5, 0.5, 0.1), -0.15),
        (contact.points([[0.3], [0.4], [0.0]]), contact.sphere(0.1), at(), 0.4),
        (contact.box([0.5, 0.5, 0.5], radius=0.1), CUBE, at(1.3), 0.2),
    ],
)
def test_degenerate_shapes_and_places(a, b, pose_b, expected):
    result = contact.distance(a, at(), b, pose_b)
    assert result.distance == pytest.approx(expected, abs=1e-15 * max(1.0, a.size))
    assert np.linalg.norm(result.normal) == pytest.approx(1.0, abs=1e-14)
    assert result.iterations < 30


@pytest.mark.parametrize(
    ("a", "b", "pose_b", "expected"),
    [
        (contact.sphere(1.0, 2), contact.sphere(1.0, 2), (0.0, 0.0, 0.0), -2.0),
        (contact.sphere(1.0, 2), contact.sphere(1.0, 2), (3.0, 4.0, 1.0), 3.0),
        (contact.box([0.5, 0.5]), contact.box([0.5, 0.5]), (0.9, 0.3, 0.0), -0.1),
        (contact.box([0.5, 0.5]), contact.box([0.5, 0.5]), (1.0, 0.3, 0.0), 0.0),
        (contact.box([0.5, 0.5]), contact.box([0.5, 0.5]), (1.2, 0.0, math.pi / 4), 0.7 - HALF),
        (BAR, BAR, (0.1, 0.2, math.pi / 2), -0.5),
        (BAR, BAR, (0.1, 0.0, 0.0), -0.2),
        (
            contact.points([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
            contact.sphere(0.1, 2),
            (0.25, 0.25, 0.0),
            -0.35,
        ),
    ],
)
def test_the_plane_by_the_same_source(a, b, pose_b, expected):
    result = contact.distance(a, (0.0, 0.0, 0.0), b, pose_b)
    assert result.distance == pytest.approx(expected, abs=2e-15)
    assert result.normal.shape == (2,)
    assert np.linalg.norm(result.normal) == pytest.approx(1.0, abs=1e-14)


def test_boxes_of_the_plane_are_bars_of_space():
    rng = np.random.default_rng(8)
    pose_a, pose_b = rng.uniform(-1, 1, (3, 300)), rng.uniform(-1, 1, (3, 300))
    flat = contact.box([0.3, 0.5])
    result = contact.distance(flat, pose_a, flat, pose_b)
    check_points(flat, pose_a, flat, pose_b, result)
    long = contact.box([0.3, 0.5, 50.0])
    space = [
        np.vstack((p[:2], 0 * p[:1], exp(np.outer([0, 0, 1], p[2])))) for p in (pose_a, pose_b)
    ]
    expected = contact.enumerated(long, space[0], long, space[1])
    assert np.abs(result.distance - expected).max() < 1e-12


sizes = st.floats(-3.0, 3.0).map(lambda power: 10.0**power)


@st.composite
def any_shape(draw):
    scale = draw(sizes)
    kind = draw(st.sampled_from(["sphere", "capsule", "box", "points", "flat", "line"]))
    if kind == "sphere":
        return contact.sphere(scale)
    if kind == "capsule":
        return contact.capsule(scale, draw(sizes))
    if kind == "box":
        return contact.box([scale, draw(sizes), draw(sizes)])
    count = draw(st.integers(1, 8))
    grid = np.array(
        draw(st.lists(st.tuples(*[st.integers(-2, 2)] * 3), min_size=count, max_size=count)),
        dtype=float,
    ).T
    grid[{"points": 3, "flat": 2, "line": 1}[kind] :] = 0.0
    return contact.points(scale * grid)


angles = st.sampled_from([0.0, 1e-12, 1e-8, 1e-4, 0.3, math.pi / 4, math.pi / 2, math.pi])
turns = st.tuples(angles, angles, angles)
shares = st.sampled_from([0.0, 1e-14, 1e-9, 1e-3, 0.5, 1.0, 1.0 + 1e-12, 2.0])


FOLDED = [
    (
        ([7.35963762127484, 0.22810732859546926, 0.02088383760813431], (0.0, 1e-8, 0.0)),
        ([0.02778773028981968, 1.4940582899329333, 0.1460264100304901], (math.pi / 2, 1e-12, 0.0)),
        (0.5, 0.0, 1e-14),
    ),
    (
        ([0.2831201420373842, 4.179988585016341, 0.015928433335387685], (1e-8, 1e-12, 1e-12)),
        ([0.6940224372231328, 1.44375499011734, 13.084698729833645], (0.0, 0.0, 0.3)),
        (0.0, 1e-3, 1e-14),
    ),
]


@pytest.mark.parametrize(("first", "second", "where"), FOLDED)
def test_a_face_that_folds_back_within_its_plane_leaves_the_depth_certain(first, second, where):
    """A new vertex 1e-14 outside of its neighbour's plane turns a face of EPA's polytope around."""
    (half_a, turn_a), (half_b, turn_b) = first, second
    assert_certified(contact.box(half_a), contact.box(half_b), turn_a, turn_b, where)


def test_a_face_on_its_back_is_not_where_the_polytope_grows():
    """A thin segment in a box turned by 1e-12: a new face in a plane of the box looked inwards."""
    segment = contact.points([[0.0, -1e-3], [0.0, 0.0], [0.0, 1e-3]])
    box = contact.box([1.0, 1.0, 1.0])
    assert_certified(segment, box, (0.0, 0.0, 0.0), (1e-12, 0.0, 0.0), (0.0, 0.0, 0.0))


def assert_certified(a, b, turn_a, turn_b, where):
    """Check a distance by supports alone: nothing is nearer, and no plane separates them better."""
    pose_a = at(turn=turn_a)
    x, y, z = np.array(where) * max(a.size, b.size)
    pose_b = at(x, y, z, turn_b)
    result = contact.distance(a, pose_a, b, pose_b)
    size = a.size + b.size + np.linalg.norm(pose_b[:3])
    core = result.distance + a.radius + b.radius
    # Rounding turns a short normal, which moves the far ends of long shapes along it.
    turned = 1e-15 * size / core if core > 0.0 else 0.0
    assert np.linalg.norm(result.normal) == pytest.approx(1.0, abs=1e-12)
    assert result.gap <= (1e-12 + turned) * size
    # Moved apart by the distance along the normal they touch: no direction is left to separate
    # them less, and along this one they meet in a plane.
    reach_a, reach_b = (
        result.normal @ corners_in_space(s, q[:, None])[:, :, 0]
        for s, q in ((a, pose_a), (b, pose_b))
    )
    along = reach_b.min() - reach_a.max() - a.radius - b.radius
    assert along == pytest.approx(result.distance, abs=(1e-12 + turned) * size)


@pytest.mark.prove
@given(any_shape(), any_shape(), turns, turns, st.tuples(shares, shares, shares))
@examples(300)
def test_it_always_ends_and_no_plane_proves_it_wrong(a, b, turn_a, turn_b, where):
    """On any scene: the result is certified from both sides by supports alone."""
    assert_certified(a, b, turn_a, turn_b, where)


@pytest.mark.parametrize("angle", [1e-15, 1e-12, 1e-8, 1e-4])
@pytest.mark.parametrize("width", [1.0, 1.0 - 2.3e-5])
def test_a_box_that_is_all_but_aligned_has_needles_and_a_depth(angle, width):
    """Its set of differences has edges that are all but one line: faces as thin as rounding."""
    capsule, box = contact.capsule(1.0, 1.0), contact.box([width, 1.0, 1.0])
    for turn_a, turn_b in (((0.0, 0.0, 0.0), (0.0, 0.0, angle)), ((0.0, 0.0, angle), (0.0,) * 3)):
        turn_a = (math.pi / 2, *turn_a[1:])
        assert_certified(capsule, box, turn_a, turn_b, (0.0, 0.0, 1e-14))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4])
@pytest.mark.parametrize("where", [(0.0, 0.0, 2.0), (1e-3, 0.0, 2.0), (0.0, 1e-3, 1.0), (0.5,) * 3])
def test_segments_that_are_all_but_parallel_have_a_normal(angle, where):
    long, short = contact.capsule(1.0, 10.0), contact.capsule(0.01, 0.002)
    for a, b in ((long, long), (long, short), (short, long)):
        assert_certified(a, b, (0.0, 0.0, 0.0), (angle, 0.0, 0.0), where)


def test_sizes_do_not_change_what_is_found():
    rng = np.random.default_rng(9)
    pose_a, pose_b = random_poses(rng, 200, 0.7), random_poses(rng, 200, 0.7)
    expected = contact.distance(SHAPES["box"], pose_a, SHAPES["points"], pose_b).distance
    for scale in (1e-3, 1e3):
        a, b = (
            contact.box(scale * SHAPES["box"].half),
            contact.points(scale * SHAPES["points"].vertices),
        )
        big_a, big_b = pose_a.copy(), pose_b.copy()
        big_a[:3] *= scale
        big_b[:3] *= scale
        result = contact.distance(a, big_a, b, big_b).distance
        assert np.abs(result / scale - expected).max() < 1e-13


@pytest.mark.parametrize("name", list(SHAPES))
def test_a_plane_is_a_box_that_never_ends(name):
    rng = np.random.default_rng(10)
    shape, pose = SHAPES[name], random_poses(rng, 100, 1.0)
    slab = contact.box([1e3, 1e3, 1e3])
    ground, below = at(), at(z=-1e3)
    result = contact.distance(contact.plane(), ground, shape, pose)
    expected = contact.distance(slab, below, shape, pose)
    assert np.abs(result.distance - expected.distance).max() < 1e-11
    back = contact.distance(shape, pose, contact.plane(), ground)
    assert np.array_equal(back.distance, result.distance)
    assert np.array_equal(back.normal, -result.normal)
    assert np.array_equal(back.point_a, result.point_b)


BAD = [
    (lambda: contact.sphere(0.0), "radius"),
    (lambda: contact.sphere(1.0, 4), "dim"),
    (lambda: contact.capsule(0.1, -1.0), "half_length"),
    (lambda: contact.box([1.0, 0.0, 1.0]), r"half\[1\]"),
    (lambda: contact.box([1.0, np.nan, 1.0]), r"half\[1\]"),
    (lambda: contact.box([1.0]), "half.shape"),
    (lambda: contact.points(np.zeros((3, 0))), "at least one point"),
    (lambda: contact.points([[np.inf], [0.0], [0.0]]), r"vertices\[0, 0\]"),
    (lambda: contact.points([[0.0], [0.0]], radius=-1.0), "radius"),
    (lambda: contact.distance(CUBE, np.zeros(7), CUBE, at()), "length of 1"),
    (lambda: contact.distance(CUBE, np.full(7, np.nan), CUBE, at()), "pose_a"),
    (lambda: contact.distance(CUBE, (0, 0, 0), CUBE, at()), "pose_a.shape"),
    (lambda: contact.distance(CUBE, at(), contact.sphere(1.0, 2), (0, 0, 0)), "b.dim"),
    (lambda: contact.distance(contact.plane(), at(), contact.plane(), at()), "no plane"),
    (
        lambda: contact.distance(CUBE, np.tile(at()[:, None], 2), CUBE, np.tile(at()[:, None], 3)),
        "pose_a.shape",
    ),
    (lambda: contact.enumerated(FLAT, at(), CUBE, at()), "a box, a capsule or a sphere"),
    (lambda: contact.contacts([], np.zeros((7, 0))), "shapes"),
    (lambda: contact.contacts([CUBE, CUBE], at()[:, None]), "a column for each shape"),
    (lambda: contact.contacts([CUBE, contact.sphere(1, 2)], at()[:, None]), "one dimension"),
    (lambda: contact.contacts([CUBE], at()[:, None], margin=-1.0), "margin"),
]


@pytest.mark.parametrize(("call", "words"), BAD, ids=range(len(BAD)))
def test_bad_input_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()
