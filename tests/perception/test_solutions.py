"""The worked answers of chapter 7 against Open3D, SciPy, the chapter and closed forms."""

import warnings

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from course import perception
from course.kinematics.chain import compose
from course.oracles import open3d
from course.rigid_body.quaternion import rotate
from drills import cards
from solutions import perception as solutions
from tests.budget import examples
from tests.perception.draws import LONG, SMALL, at, blobs, scene


@pytest.fixture(autouse=True)
def _floating_point_is_quiet():
    """No answer may warn, whatever it is given here."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


# --- back-projection ------------------------------------------------------------------------------


@examples(10)
@given(rngs())
def test_points_are_the_chapters_and_open3ds(rng):
    depth, _ = perception.render(scene(rng), SMALL)
    result = solutions.back_project(depth, SMALL.fx, SMALL.fy, SMALL.cx, SMALL.cy, 1.0)
    ours, _ = perception.back_project(depth, SMALL)
    np.testing.assert_allclose(result, ours, rtol=0, atol=1e-15)
    theirs = open3d.Picture(depth, SMALL).points()  # in single precision
    np.testing.assert_allclose(result, theirs, rtol=0, atol=2e-7 * np.abs(result).max())
    # Seen again, a point is where its pixel was.
    v, u = np.nonzero(depth)
    np.testing.assert_allclose(SMALL.fx * result[0] / result[2] + SMALL.cx, u, rtol=0, atol=1e-11)
    np.testing.assert_allclose(SMALL.fy * result[1] / result[2] + SMALL.cy, v, rtol=0, atol=1e-11)


# --- rigid fit ------------------------------------------------------------------------------------


@examples(60)
@given(rngs(), st.integers(3, 30), st.floats(0.0, 0.3), st.booleans())
def test_the_fit_is_scipys_and_the_chapters(rng, n, noise, mirrored):
    a = rng.normal(size=(3, n)) + 3.0 * rng.normal(size=(3, 1))
    Q = Rotation.random(rng=rng).as_matrix()
    b = Q @ (a * [[1.0], [1.0], [-1.0 if mirrored else 1.0]]) + noise * rng.normal(size=(3, n))
    w = rng.uniform(0.1, 2.0, n)
    R, p = solutions.rigid_fit(a, b, w)
    share = w / w.sum()
    theirs, _ = Rotation.align_vectors(
        (b - (b @ share)[:, None]).T, (a - (a @ share)[:, None]).T, weights=w
    )
    for other, shift in ((theirs.as_matrix(), None), perception.rigid_fit(a, b, w)):
        shift = (b - other @ a) @ share if shift is None else shift
        # What is compared is how well it fits: a close call has more than one answer.
        sums = [
            w @ np.sum((M @ a + m[:, None] - b) ** 2, axis=0) for M, m in ((R, p), (other, shift))
        ]
        assert sums[0] <= sums[1] * (1.0 + 1e-9) + 1e-20
    np.testing.assert_allclose(R @ R.T, np.eye(3), rtol=0, atol=1e-13)
    assert np.linalg.det(R) > 0.0


# --- plane ----------------------------------------------------------------------------------------


def table(rng, n=60, stray=20):
    points = rng.uniform(-0.5, 0.5, (3, n + stray))
    points[2, :n] = 0.003 * rng.normal(size=n)
    return Rotation.random(rng=rng).as_matrix() @ points + [[0.0], [0.0], [1.5]]


@examples(20)
@given(rngs())
def test_the_table_is_open3ds(rng):
    """Where both draw enough, the refitted plane doesn't depend on the draws that led there."""
    points = table(rng)
    triples = rng.integers(0, 80, (150, 3))
    plane, near, tried = solutions.plane_ransac(points, triples, 0.015, 1.0 - 1e-12)
    theirs, mask = open3d.Cloud(points).plane(0.015, 400)
    assert abs(plane[:3] @ theirs[:3]) > 1.0 - 1e-4 and tried <= 150
    away = np.abs(plane[:3] @ points + plane[3])
    assert len(set(near) ^ set(np.flatnonzero(mask))) <= 4
    assert near.tolist() == np.flatnonzero(away <= 0.015).tolist()


@examples(20)
@given(rngs(), st.floats(0.5, 0.999))
def test_drawing_stops_when_the_chapters_formula_says_so(rng, sure):
    points = table(rng)
    triples = np.array([rng.permutation(80)[:3] for _ in range(60)])
    _, _, tried = solutions.plane_ransac(points, triples, 0.015, sure)
    counts = []
    for a, b, c in triples:
        n = np.cross(points[:, b] - points[:, a], points[:, c] - points[:, a])
        away = n @ (points - points[:, [a]]) / np.linalg.norm(n)
        counts.append(np.count_nonzero(np.abs(away) <= 0.015))
    enough = [k >= perception.draws_needed(max(counts[:k]) / 80, sure) for k in range(1, 61)]
    assert tried == (enough.index(True) + 1 if any(enough) else 60)


# --- point to plane -------------------------------------------------------------------------------


@examples(20)
@given(rngs())
def test_steps_end_where_those_of_open3d_and_the_chapter_do(rng):
    normals = rng.normal(size=(3, 80))
    normals /= np.linalg.norm(normals, axis=0)
    model = normals * [[1.0], [0.7], [0.5]]
    turn = Rotation.from_rotvec(0.05 * rng.normal(size=3)).as_matrix()
    points = turn @ model[:, :50] + 0.02 * rng.normal(size=(3, 1)) + 0.01 * rng.normal(size=(3, 50))
    R, p = np.eye(3), np.zeros(3)
    for _ in range(60):
        dR, dp = solutions.point_to_plane_step(R @ points + p[:, None], model, normals)
        R, p = dR @ R, dR @ p + dp
    # Where two ways to match take turns there is no end to agree on.
    assume(np.max(np.abs(dp)) < 1e-9)
    cloud = perception.Cloud.of(model, normals)
    target = open3d.Cloud(model)
    target.set_normals(normals)
    start = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])

    def chapter(iterations):
        fit = perception.icp(points, cloud, tolerance=1e-14, iterations=iterations)
        return fit.R.T, -fit.R.T @ fit.p

    def library(iterations):
        fit = open3d.Cloud(points).icp(target, start, 9.0, iterations, to_plane=True)
        pose = open3d.matrix(fit.pose)
        return pose[:3, :3], pose[:3, 3]

    for method, tolerance in ((chapter, 1e-7), (library, 1e-6)):
        turned, moved = method(60)
        # They linearise in other ways, so matches may take turns in one and not in the other.
        turned_on, moved_on = method(61)
        if max(np.abs(turned - turned_on).max(), np.abs(moved - moved_on).max()) > 1e-9:
            continue
        # For the same reason they may end at another pose: one that our step does not leave either.
        if np.abs(R - turned).max() > tolerance:
            dR, dp = solutions.point_to_plane_step(turned @ points + moved[:, None], model, normals)
            np.testing.assert_allclose(dR, np.eye(3), rtol=0, atol=1e-5)
            np.testing.assert_allclose(dp, 0.0, rtol=0, atol=1e-5)
        else:
            np.testing.assert_allclose(p, moved, rtol=0, atol=tolerance)


# --- clusters -------------------------------------------------------------------------------------


@examples(30)
@given(rngs(), st.integers(0, 150), st.sampled_from([1, 4, 8]))
def test_labels_are_the_chapters_and_core_points_those_of_open3d(rng, n, least):
    points = blobs(rng, n + 1)
    result = solutions.dbscan(points, 0.02, least)
    labels, core = perception.dbscan(points, 0.02, least)
    np.testing.assert_array_equal(result, labels)
    # Open3D leaves border points to the order of the points: noise and core points are the same.
    theirs = open3d.Cloud(points).dbscan(0.02, least)
    assert ((theirs < 0) == (result < 0)).all()
    pairs = set(zip(theirs[core].tolist(), result[core].tolist(), strict=True))
    assert len(pairs) == len(set(theirs[core])) == len(set(result[core]))


# --- blind directions -----------------------------------------------------------------------------


@examples(30)
@given(rngs(), st.floats(0.005, 5.0))
def test_blind_motions_are_those_of_geometry_wherever_the_part_is(rng, size):
    """Of a ball the turns about its centre, of a cylinder turn and shift along its axis."""
    Q, middle = Rotation.random(rng=rng).as_matrix(), size * rng.normal(size=3)
    axis, across = Q[:, 2], rng.normal(size=(3, 60))
    across /= np.linalg.norm(across, axis=0)
    round_ = across - np.outer(axis, axis @ across)
    round_ /= np.linalg.norm(round_, axis=0)
    about = np.hstack((np.cross(middle, np.eye(3)), size * np.eye(3)))  # turns about the middle
    along = np.concatenate((axis, np.zeros(3)))
    for points, normals, motions in (
        (size * across, across, about),
        (size * (round_ + np.outer(axis, rng.uniform(-2, 2, 60))), round_, [along, axis @ about]),
    ):
        count, P = solutions.blind_directions(points + middle[:, None], normals, size, 1e-3)
        basis = np.linalg.qr(np.transpose(motions))[0]
        assert count == basis.shape[1]
        np.testing.assert_allclose(P, basis @ basis.T, rtol=0, atol=1e-8)


# --- the hunt -------------------------------------------------------------------------------------

INTRINSICS = (LONG.fx, LONG.fy, LONG.cx, LONG.cy)


def log(turn=0.0, speed=0.0):
    times = np.linspace(0.0, 1.0, 11)
    return np.column_stack(
        (times, 0.3 + speed * times, 0.0 * times, 0.5 + 0.0 * times, 0.4 + turn * times)
    )


@examples(30)
@given(rngs())
def test_the_chain_is_the_chapters_frames_after_each_other(rng):
    depth = np.zeros((LONG.height, LONG.width))
    v, u = rng.integers(0, 120, 20), rng.integers(0, 160, 20)
    depth[v, u] = rng.uniform(0.4, 1.2, 20)
    observed, _ = perception.back_project(depth, LONG)
    v, u = np.nonzero(depth)
    x, y, z, yaw = mount = rng.uniform(-1.0, 1.0, 4)
    stamp, turn, speed = rng.uniform([0.0, -1.0, -1.0], 1.0)
    flange = at(0.3 + speed * stamp, 0.0, 0.5, (0.0, 0.0, 0.4 + turn * stamp))
    camera = compose(flange[:, None], at(x, y, z, (0.0, 0.0, yaw))[:, None])[:, 0]
    result = solutions.point_in_base(
        (u, v, depth[v, u]), stamp, INTRINSICS, mount, log(turn, speed)
    )
    np.testing.assert_allclose(
        result, rotate(camera[3:], observed) + camera[:3, None], rtol=0, atol=1e-12
    )


def test_the_starter_of_the_hunt_is_right_where_its_author_looked():
    names: dict = {}
    exec(cards.card("point_in_base").starter(), names)

    def missed(u, v, motion=0.0):
        args = np.array([[u], [v], [0.8]]), 0.5, INTRINSICS, (0.02, 0.0, 0.05, 1.2), log(motion)
        return float(np.linalg.norm(names["point_in_base"](*args) - solutions.point_in_base(*args)))

    assert missed(LONG.cx, LONG.cy) < 1e-3
    assert missed(0.0, 0.0) > 0.2 and missed(LONG.cx, LONG.cy, 3.0) > 5e-3
