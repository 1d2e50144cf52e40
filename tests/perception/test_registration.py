"""Registration: against SciPy and closed forms, its covariance tried, and what it cannot see."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from course.kinematics.chain import invert
from course.oracles import open3d
from course.perception.camera import shape, together
from course.perception.registration import DIRECTIONS, icp, known
from course.perception.rigid import rigid_fit
from course.perception.tree import Cloud
from course.rigid_body.quaternion import exp, from_matrix, to_matrix
from tests.budget import examples
from tests.perception.part_images import (
    BOX,
    CYLINDER,
    SENSOR,
    SPHERE,
    error,
    measured,
    nudged,
    on_surface,
    visible_pose,
)

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.prove
@given(SEEDS, st.integers(1, 400), st.sampled_from([0.0, 0.3, 2.0]))
@examples(40)
def test_nearest_points_are_those_of_scipy(seed, count, grid):
    """With a grid many points are equal, and many equally far."""
    rng = np.random.default_rng(seed)
    points, queries = rng.standard_normal((3, count)), 1.5 * rng.standard_normal((3, 50))
    if grid:
        points = np.round(points / grid) * grid
    distance, index = Cloud.of(points).nearest(queries)
    assert np.abs(distance - cKDTree(points.T).query(queries.T)[0]).max() < 1e-14
    reached = np.linalg.norm(points[:, index] - queries, axis=0)
    assert np.abs(reached - distance).max() < 1e-14
    near, which = Cloud.of(points).nearest(queries, within=0.5)
    assert np.array_equal(which >= 0, distance < 0.5)
    assert np.array_equal(near[which >= 0], distance[distance < 0.5])


@given(SEEDS, st.integers(3, 40), st.sampled_from(["solid", "flat", "mirrored"]))
@examples(40)
def test_rigid_fit_is_that_of_scipy(seed, count, kind):
    """A mirrored cloud, and one in a plane, are where a fit without the determinant reflects."""
    rng = np.random.default_rng(seed)
    a, w = rng.standard_normal((3, count)), rng.uniform(0.1, 1.0, count)
    a[2] *= kind != "flat"
    b = to_matrix(exp(rng.standard_normal(3))) @ a + rng.standard_normal((3, 1))
    b += 0.01 * rng.standard_normal(b.shape)
    if kind == "mirrored":
        b[0] *= -1.0
    R, p = rigid_fit(a, b, w)
    ca, cb = a @ w / w.sum(), b @ w / w.sum()
    other = Rotation.align_vectors((b - cb[:, None]).T, (a - ca[:, None]).T, w)[0].as_matrix()
    cost = [
        np.sum(w * np.sum((Q @ (a - ca[:, None]) + cb[:, None] - b) ** 2, 0)) for Q in (R, other)
    ]
    assert abs(cost[0] - cost[1]) < 1e-12 * max(1.0, cost[1])
    assert np.abs(R @ ca + p - cb).max() < 1e-13
    assert np.abs(R.T @ R - np.eye(3)).max() < 1e-13 and np.linalg.det(R) > 0.0
    if kind != "mirrored":
        assert np.abs(R - other).max() < 1e-9


@pytest.mark.parametrize("part", [BOX, CYLINDER, SPHERE], ids=lambda s: s.kinds[0])
def test_exact_pictures_give_the_pose(part):
    rng = np.random.default_rng(1)
    for _ in range(5):
        pose = visible_pose(yaw=rng.uniform(0.3, 1.2), tilt=rng.uniform(0.5, 0.9))
        points, _ = measured(part, pose)
        fit = icp(points, part, nudged(pose, rng, 0.01, 0.1), iterations=100)
        assert fit.converged and fit.matched.all() and fit.residual < 1e-8
        blind = [name in fit.unobserved for name in DIRECTIONS]
        assert np.abs(error(fit.R, fit.p, pose))[np.logical_not(blind)].max() < 1e-9


def test_an_l_of_two_boxes_is_one_target():
    rng = np.random.default_rng(2)
    other = shape("box", 0.02, 0.06, 0.02, pose=(0.08, 0.04, 0.0, 1.0, 0.0, 0.0, 0.0))
    part, pose = together([shape("box", 0.06, 0.02, 0.02), other]), visible_pose()
    points, sigma = measured(part, pose)
    fit = icp(points, part, nudged(pose, rng, 0.005, 0.05), sigma=sigma)
    assert fit.converged and fit.unobserved == ()
    assert np.abs(error(fit.R, fit.p, pose)).max() < 1e-9


def test_a_cloud_is_as_good_as_its_spacing():
    """On planes a cloud with exact normals ends at the same pose as the shape; points stall."""
    rng = np.random.default_rng(3)
    pose = visible_pose()
    target = Cloud.of(*on_surface(BOX.sizes[:, 0], 6000, rng))
    points, _ = measured(BOX, pose)
    start = nudged(pose, rng, 0.003, 0.03)
    plane = icp(points, target, start, gate=(0.03, 0.004))
    point = icp(points, target, start, method="point", gate=(0.03, 0.004))
    assert np.abs(error(plane.R, plane.p, pose)).max() < 1e-3
    assert point.residual > 5.0 * plane.residual


def test_every_iteration_is_that_of_open3d():
    """Points: the same at each step. Planes: Open3D composes a step from three angles, so that the
    first ones differ, and the end does not."""
    rng = np.random.default_rng(9)
    pose = visible_pose()
    surface, normals = on_surface(BOX.sizes[:, 0], 2000, rng)
    points, _ = measured(BOX, pose)
    start = nudged(pose, rng, 0.005, 0.05)
    ours, theirs, source = Cloud.of(surface, normals), open3d.Cloud(surface), open3d.Cloud(points)
    theirs.set_normals(normals)

    def deviation(method, steps):
        fit = icp(points, ours, start, method=method, gate=0.03, iterations=steps, tolerance=0.0)
        other = source.icp(theirs, invert(start), 0.03, steps, method == "plane", 0.0)
        assert method == "plane" or abs(fit.residual - other.residual) < 1e-14
        assert fit.matched.mean() == other.matched
        return np.abs(open3d.matrix(invert(fit.pose)) - open3d.matrix(other.pose)).max()

    assert max(deviation("point", steps) for steps in (1, 2, 5, 20)) < 1e-12
    assert deviation("plane", 1) > 1e-5 and deviation("plane", 40) < 1e-12


# Ratio of spread to prediction in each direction that is seen in every run; a normalised error
# squared over its number.
def calibration(part, pose, sensor, runs, seed, free=DIRECTIONS, **options):
    rng = np.random.default_rng(seed)
    errors, variances, squares, seen_in = [], [], [], []
    for _ in range(runs):
        points, sigma = measured(part, pose, sensor, rng)
        start = nudged(pose, rng, 0.002, 0.02) if len(free) == 6 else pose
        fit = icp(points, part, start, sigma=sigma, gate=(0.03, 0.01), free=free, **options)
        e, C = error(fit.R, fit.p, pose), fit.covariance
        report = np.isfinite(np.diag(C)) & np.isin(DIRECTIONS, free)
        squares.append(
            e[report] @ np.linalg.solve(C[np.ix_(report, report)], e[report]) / report.sum()
        )
        errors.append(e)
        variances.append(np.diag(C))
        seen_in.append(report)
    always = np.all(seen_in, axis=0)
    spread = np.mean(np.square(errors)[:, always], axis=0)
    ratio = np.sqrt(spread / np.mean(np.array(variances)[:, always], axis=0))
    return ratio, float(np.mean(squares)), fit.unobserved


@pytest.mark.prove
@pytest.mark.parametrize(
    ("part", "tilt", "blind"),
    [
        (BOX, 0.7, ()),
        (CYLINDER, 0.7, ("turn z",)),
        (SPHERE, 0.7, ("turn x", "turn y", "turn z")),
        (BOX, 0.0, ("x", "y", "turn z")),
    ],
    ids=["box", "cylinder", "sphere", "one face"],
)
def test_the_covariance_is_what_happens(part, tilt, blind):
    """200 pictures: within the band of chi squared, and 0.85 to 1.15 in every direction."""
    pose = visible_pose(tilt=tilt, place=(0.02, 0.03, 0.7) if tilt else (0.0, 0.0, 0.7))
    ratio, nees, unobserved = calibration(part, pose, SENSOR, 200, 4)
    assert unobserved == blind
    k = 6 - len(blind)
    assert abs(nees - 1.0) < 3.0 * np.sqrt(2.0 / (k * 200))
    assert 0.85 < ratio.min() and ratio.max() < 1.15


def test_closest_points_alone_are_sure_of_what_they_do_not_see():
    """Noise at the edges of a face passes for its neighbours: the reason for the steps on rays."""
    ratio, nees, unobserved = calibration(BOX, visible_pose(yaw=0.0), SENSOR, 40, 5, rays=False)
    assert unobserved == () and nees > 10.0 and ratio[0] > 5.0
    ratio, nees, unobserved = calibration(BOX, visible_pose(yaw=0.0), SENSOR, 40, 5)
    assert unobserved == ("x",) and nees < 1.5


def test_three_free_directions_leave_the_others():
    """Knowing where the table is helps by what the information says that it does."""
    pose, free = visible_pose(), ("x", "y", "turn z")
    three, nees, _ = calibration(BOX, pose, SENSOR, 100, 6, free=free)
    assert abs(nees - 1.0) < 3.0 * np.sqrt(2.0 / 300) and 0.8 < three.min() < three.max() < 1.2
    points, sigma = measured(BOX, pose, SENSOR, np.random.default_rng(6))
    six = icp(points, BOX, pose, sigma=sigma, gate=0.01)
    fit = icp(points, BOX, pose, sigma=sigma, gate=0.01, free=free)
    assert np.abs(error(fit.R, fit.p, pose))[2:5].max() < 1e-12
    assert not fit.covariance[2:5].any() and fit.unobserved == ()
    less = np.diag(fit.covariance)[[0, 1, 5]] / np.diag(six.covariance)[[0, 1, 5]]
    assert less.max() < 1.01


@given(SEEDS, st.floats(-6.0, 6.0), st.integers(0, 3))
@examples(30)
def test_what_is_blind_does_not_hang_on_the_units(seed, power, rank):
    """The covariance inverts what is seen; a null motion makes its axes infinite."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((6, 30))
    null = np.zeros((6, rank))
    null[rng.choice(6, rank, replace=False), np.arange(rank)] = 1.0
    if rank == 2:  # one motion between two axes
        null = null.sum(axis=1, keepdims=True) / np.sqrt(2.0)
    J -= null @ (null.T @ J)
    J[3:] *= 10.0**power
    C, blind = known(J @ J.T)
    lost = null.any(axis=1)
    assert blind == tuple(np.array(DIRECTIONS)[lost]) and np.all(np.isinf(np.diag(C)) == lost)
    assert not C[lost][:, ~lost].any()
    if rank != 2:
        retained = np.ix_(~lost, ~lost)
        unit = np.abs(C[retained] @ (J @ J.T)[retained] - np.eye(6 - lost.sum())) / np.sqrt(
            np.outer(np.diag(C)[~lost], 1.0 / np.diag(C)[~lost])
        )
        assert unit.max() < 1e-9


LINE = np.array([[0.0, 1.0, 2.0, 5.0]] * 3)
GOOD = np.eye(3)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rigid_fit(GOOD[:, :2], GOOD[:, :2]), "at least three points"),
        (lambda: rigid_fit(LINE, LINE), "off one line"),
        (lambda: rigid_fit(GOOD, LINE[:, :3]), "off one line"),
        (lambda: rigid_fit(GOOD, GOOD, [1.0, 0.0, 0.0]), "at least three points"),
        (lambda: rigid_fit(GOOD * np.nan, GOOD), "source"),
        (lambda: Cloud.of(np.zeros((3, 0))), "at least one point"),
        (lambda: Cloud.of(GOOD, 2.0 * GOOD), "unit length"),
        (lambda: icp(GOOD, Cloud.of(GOOD)), "normals"),
        (lambda: icp(GOOD, BOX, gate=(0.01, 0.02)), "smaller last"),
        (lambda: icp(GOOD + 9.0, BOX, gate=0.01), "3 points within the gate"),
        (lambda: icp(GOOD, BOX, method="surface"), "one of"),
        (lambda: icp(GOOD, BOX, method="point", free=("x",)), "all six"),
        (lambda: icp(GOOD, BOX, free=("w",)), "one of"),
        (lambda: icp(-GOOD, BOX, sigma=0.01), "before the camera"),
        (lambda: icp(GOOD, BOX, sigma=0.0), "sigma"),
        (lambda: icp(GOOD, BOX, (0, 0, 0, 2.0, 0, 0, 0)), "length of 1"),
        (lambda: from_matrix(icp(GOOD, BOX, iterations=0).R), "iterations"),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()
