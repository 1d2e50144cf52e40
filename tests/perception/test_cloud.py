"""Points, planes and clusters against closed forms, their definitions, SciPy and Open3D."""

import math
import resource

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage
from scipy.spatial import cKDTree

from course.oracles import open3d
from course.perception import (
    back_project,
    cloud,
    components,
    dbscan,
    draws_needed,
    fit_plane,
    inverse_depth_plane,
    radius_search,
    ransac_plane,
    render,
    shape,
    together,
    voxel_mean,
)
from course.rigid_body.quaternion import to_matrix
from tests.budget import examples
from tests.perception.draws import SMALL, at, blobs, facing, scene

seeds = st.integers(0, 2**32 - 1)


def angle(plane: np.ndarray, truth: np.ndarray) -> float:
    """Between two unit normals [rad]."""
    return float(np.linalg.norm(np.cross(plane[:3], truth[:3])))


def truth_of(wall) -> np.ndarray:
    """The plane (normal, offset) of a plane of a scene."""
    normal = to_matrix(wall.poses[3:, 0])[:, 2]
    return np.append(normal, -normal @ wall.poses[:3, 0])


@pytest.mark.prove
def test_points_lie_on_what_was_seen():
    shapes = scene(np.random.default_rng(2), 6)
    depth, ids = render(shapes, SMALL)
    points, pixels = back_project(depth, SMALL)
    assert np.array_equal(pixels, np.flatnonzero(depth))
    wall = truth_of(shapes)
    on_wall = ids.ravel()[pixels] == 0
    assert np.abs(wall[:3] @ points[:, on_wall] + wall[3]).max() < 1e-14
    v, u = np.divmod(pixels, SMALL.width)
    assert np.abs(SMALL.project(points) - np.stack((u, v))).max() < 1e-12
    theirs = open3d.Picture(depth, SMALL).points()
    assert np.abs(theirs - points).max() < 2.0**-23 * np.abs(points).max()


@pytest.mark.slow
@pytest.mark.parametrize("voxel", [0.003, 0.01, 0.05, 3.0])
def test_voxel_means_are_open3ds_to_the_last_bit(voxel):
    points, _ = back_project(render(scene(np.random.default_rng(4), 6), SMALL)[0], SMALL)
    means, counts = voxel_mean(points, voxel)
    other = open3d.Cloud(points)
    theirs = other.array(other.voxel_mean(voxel))
    assert np.array_equal(means[:, np.lexsort(means)], theirs[:, np.lexsort(theirs)])
    assert counts.sum() == points.shape[1]


@given(seed=seeds, voxel=st.floats(1e-4, 1.0))
@examples(30)
def test_a_voxel_mean_is_the_mean_of_its_voxel(seed, voxel):
    points = blobs(np.random.default_rng(seed), 200)
    means, counts = voxel_mean(points, voxel, [-1.0, -1.0, -1.0])
    cells = np.floor((points + 1.0) / voxel).astype(int)
    retained, first, of = np.unique(cells, axis=1, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    expected = np.stack([np.bincount(of.ravel(), row) for row in points]) / np.bincount(of.ravel())
    assert retained.shape[1] == counts.size
    assert np.abs(means[:, order] - expected).max() < 1e-15
    assert np.array_equal(counts[order], np.bincount(of.ravel()))


@pytest.mark.prove
@given(seed=seeds, radius=st.floats(1e-3, 0.5))
@examples(30)
def test_a_search_finds_what_scipy_finds(seed, radius):
    rng = np.random.default_rng(seed)
    points = blobs(rng, 300)
    queries = np.hstack((points[:, :20], rng.uniform(-1.0, 1.0, (3, 20))))
    start, result = radius_search(points, queries, radius)
    expected = cKDTree(points.T).query_ball_point(queries.T, radius)
    for i, members in enumerate(expected):
        assert sorted(result[start[i] : start[i + 1]]) == sorted(members)


# --- Clusters -------------------------------------------------------------------------------------


def same_partition(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether labels differ in their names only."""
    pairs = np.unique(np.stack((a, b)), axis=1)
    return len(set(pairs[0])) == len(set(pairs[1])) == pairs.shape[1]


def check_dbscan(points, eps, least):
    """Labels and core points as the definition says them, from all distances."""
    labels, core = dbscan(points, eps, least)
    distance = np.linalg.norm(points[:, :, None] - points[:, None], axis=0)
    near = distance <= eps
    assert np.array_equal(core, near.sum(axis=0) >= least)
    _, expected = joined(near[np.ix_(core, core)])
    assert same_partition(labels[core], expected)
    first = [np.flatnonzero(core & (labels == k))[0] for k in range(labels.max() + 1)]
    assert first == sorted(first)
    border = ~core & (near & core).any(axis=1)
    assert np.array_equal(labels >= 0, core | border)
    for i in np.flatnonzero(border):
        reach = np.where(core, distance[i], np.inf)
        assert labels[i] in labels[np.flatnonzero(reach <= reach.min() * (1.0 + 1e-12))]


def joined(graph):
    from scipy.sparse.csgraph import connected_components

    return connected_components(graph) if graph.size else (0, np.zeros(0, int))


@given(seed=seeds, n=st.integers(1, 120), eps=st.floats(0.002, 0.2), least=st.integers(1, 12))
@examples(60)
def test_clusters_are_those_of_the_definition(seed, n, eps, least):
    check_dbscan(blobs(np.random.default_rng(seed), n), eps, least)


def test_clusters_in_hard_places():
    grid = np.stack(np.meshgrid(*3 * [np.arange(5.0)])).reshape(3, -1)
    for least in (1, 4, 5, 7, 8):  # neighbours at exactly eps count
        check_dbscan(grid, 1.0, least)
    check_dbscan(np.tile(grid, 2), 0.5, 3)
    check_dbscan(np.zeros((3, 7)), 1e-3, 7)
    check_dbscan(np.zeros((3, 7)), 1e-3, 8)
    check_dbscan(np.stack((np.arange(40.0), 0 * grid[0, :40], 0 * grid[0, :40])), 1.0, 3)


@pytest.mark.parametrize(("eps", "least"), [(0.012, 8), (0.02, 20), (0.03, 30)])
def test_clusters_are_open3ds_but_for_the_border(eps, least):
    points = np.random.default_rng(6).normal(size=(3, 1500)) * np.array([[0.06], [0.04], [0.03]])
    labels, core = dbscan(points, eps, least)
    theirs = open3d.Cloud(points).dbscan(eps, least)
    assert np.array_equal(labels[core], theirs[core])
    assert np.array_equal(labels < 0, theirs < 0)
    # Where a border point differs, it is within reach of both clusters.
    tree = cKDTree(points.T)
    for i in np.flatnonzero(labels != theirs):
        reached = set(labels[[j for j in tree.query_ball_point(points[:, i], eps) if core[j]]])
        assert {labels[i], theirs[i]} <= reached


def test_dense_points_need_no_more_memory():
    """All neighbourhoods of these points would be 2.5 thousand million numbers."""
    points = np.random.default_rng(7).uniform(0.0, 0.01, (3, 50_000))
    dbscan(points[:, :10], 0.02, 5)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    labels, core = dbscan(points, 0.02, 5)
    assert core.all() and not labels.any()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@pytest.mark.prove
def test_components_are_those_of_scipy():
    rng = np.random.default_rng(8)
    depth = np.where(rng.random((60, 80)) < 0.55, 1.0, 0.0)
    labels = components(depth, SMALL, 0.1)
    expected, count = ndimage.label(depth)
    assert np.array_equal(labels, expected - 1) and labels.max() == count - 1
    # A step parts them: heights of whole steps, joined along equal ones.
    stairs = rng.integers(1, 4, (60, 80)).astype(float)
    labels = components(stairs, SMALL, 0.5)
    for height in (1.0, 2.0, 3.0):
        own = stairs == height
        assert same_partition(labels[own], ndimage.label(own)[0][own])
    assert np.array_equal(np.unique(labels), np.arange(labels.max() + 1))


# --- Planes ---------------------------------------------------------------------------------------


@given(seed=seeds, tilt=st.floats(-1.0, 1.0), z=st.floats(0.3, 3.0))
@examples(30)
def test_every_fit_finds_an_exact_plane(seed, tilt, z):
    rng = np.random.default_rng(seed)
    wall = facing(z, tilt)
    depth, truth = render(wall, SMALL)[0], truth_of(wall)
    depth[depth > 5.0] = 0.0
    points, _ = back_project(depth, SMALL)
    result = (
        fit_plane(points),
        inverse_depth_plane(depth, SMALL),
        ransac_plane(points, 1e-6, rng)[0],
    )
    for plane in result:
        assert angle(plane, truth) < 1e-10 and abs(plane[3] - truth[3]) < 1e-10
        assert plane[3] > 0.0 and abs(np.linalg.norm(plane[:3]) - 1.0) < 1e-14


def test_draws_needed_and_the_early_stop():
    assert draws_needed(0.5, 0.99) == pytest.approx(math.log(0.01) / math.log(1.0 - 0.125))
    assert draws_needed(1.0, 0.99) == 1.0 and draws_needed(0.0, 0.5) == math.inf
    assert draws_needed(0.0, 0.0) == draws_needed(1.0, 0.0) == 0.0
    wall = np.vstack((np.random.default_rng(1).uniform(size=(2, 50)), np.ones(50)))
    assert ransac_plane(wall, 1e-6, RNG)[2] == 1
    assert ransac_plane(wall, 1e-6, RNG, confidence=1.0, at_most=7)[2] == 7
    points, inliers = np.random.default_rng(11).uniform(-0.3, 0.3, (3, 500)), np.arange(500) < 300
    points[2] = 1.0 + np.where(inliers, 0.0, points[2])
    _, near, tried = ransac_plane(points, 1e-6, np.random.default_rng(12), confidence=0.999)
    assert tried == math.ceil(draws_needed(near.mean(), 0.999))
    assert np.array_equal(near, inliers)


def test_of_two_planes_the_larger_one():
    table, shelf = facing(1.0), shape("box", 0.15, 0.3, 0.1, pose=at(0.2, 0.0, 0.8))
    depth, ids = render(together([table, shelf]), SMALL)
    points, pixels = back_project(depth, SMALL)
    on_shelf = ids.ravel()[pixels] == 1
    z = 0.7 if on_shelf.mean() > 0.5 else 1.0
    assert 0.3 < on_shelf.mean() < 0.7
    plane, near, _ = ransac_plane(points, 1e-3, np.random.default_rng(13), confidence=0.9999)
    assert plane[3] == pytest.approx(z, abs=1e-9)
    assert near.mean() == pytest.approx(max(on_shelf.mean(), 1.0 - on_shelf.mean()), abs=0.05)


def test_plain_python_finds_the_same(monkeypatch):
    rng = np.random.default_rng(14)
    points, depth = blobs(rng, 150), render(scene(rng, 3), SMALL)[0][20:32, 20:36]
    eye = type(SMALL).symmetric(16, 12, 0.3)

    def all_of_it():
        return [
            *back_project(depth, eye),
            *voxel_mean(points, 0.02),
            *dbscan(points, 0.02, 4),
            *radius_search(points, points[:, :9], 0.03),
            components(depth, eye, 0.01),
            ransac_plane(points, 0.02, np.random.default_rng(0), at_most=20)[0],
        ]

    expected = all_of_it()
    for function in cloud._KERNELS:
        monkeypatch.setattr(cloud, f"{function.__name__}_loop", function)
    for plain, compiled in zip(all_of_it(), expected, strict=True):
        np.testing.assert_allclose(plain, compiled, rtol=1e-13, atol=1e-15)


RNG = np.random.default_rng(0)
LINE = np.outer([1.0, 2.0, 3.0], np.arange(5.0))
FEW = np.zeros((3, 2))
BAD = [
    (lambda: back_project(np.zeros((60, 80)), SMALL), "0 everywhere"),
    (lambda: voxel_mean(np.zeros((2, 4)), 0.1), "points.shape"),
    (lambda: voxel_mean(np.zeros((3, 0)), 0.1), "points.shape"),
    (lambda: voxel_mean(np.full((3, 4), np.nan), 0.1), r"points\[0, 0\] must be .*, got nan"),
    (lambda: voxel_mean(LINE, 0.0), "voxel"),
    (lambda: voxel_mean(LINE, -1.0), "voxel"),
    (lambda: voxel_mean(LINE, 1e-15), "voxel"),
    (lambda: voxel_mean(LINE, 1e-6), "a larger length"),
    (lambda: voxel_mean(LINE, 1.0, [1.0, 1.0, 1.0]), "origin"),
    (lambda: dbscan(LINE, 0.0, 3), "eps"),
    (lambda: dbscan(LINE, 1e-7, 3), "a larger length"),
    (lambda: dbscan(LINE, 1.0, 0), "least"),
    (lambda: radius_search(LINE, LINE, np.inf), "radius"),
    (lambda: radius_search(LINE, FEW[:2], 1.0), "points.shape"),
    (lambda: components(np.ones((60, 80)), SMALL, 0.0), "step"),
    (lambda: fit_plane(FEW), r"N at least 3"),
    (lambda: fit_plane(LINE), "not all in one line"),
    (lambda: ransac_plane(FEW, 0.1, RNG), r"N at least 3"),
    (lambda: ransac_plane(LINE, 0.1, RNG), "not all in one line"),
    (lambda: ransac_plane(LINE + RNG.normal(size=LINE.shape), 0.0, RNG), "tolerance"),
    (lambda: ransac_plane(LINE + RNG.normal(size=LINE.shape), 1e-16, RNG), "tolerance"),
    (lambda: ransac_plane(LINE, 0.1, RNG, at_most=0), "most"),
    (lambda: ransac_plane(LINE, 0.1, RNG, confidence=1.1), "confidence"),
    (lambda: inverse_depth_plane(np.ones((60, 80)), SMALL, np.zeros((60, 80), bool)), "mask"),
    (lambda: inverse_depth_plane(np.ones((60, 80)), SMALL, np.eye(60, 80) > 0), "one line"),
    (lambda: draws_needed(1.5, 0.9), "share"),
]


@pytest.mark.parametrize(("call", "words"), BAD, ids=range(len(BAD)))
def test_bad_input_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()
