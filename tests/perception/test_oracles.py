"""What the libraries answer on cases that are known."""

import sys

import numpy as np
import pytest

from course.charts.perception import features
from course.kinematics.chain import invert
from course.oracles import open3d, small_gicp
from course.oracles.mujoco import camera as mujoco
from course.perception import Camera, pose_distance, render, shape, together, yaw_net
from course.rigid_body.quaternion import rotate, to_matrix
from tests.perception.draws import SMALL, at, boxes, facing

STILL, MOVED = at(), at(0.01, 0.02, -0.01, (0.05, 0.02, 0.1))


def sphere_seen(depth: np.ndarray, z: float, r: float) -> float:
    """How far the points of a picture are from a ball on the axis, at most."""
    x, y = SMALL.rays()
    v, u = np.nonzero(depth)
    points = np.stack((x[u], y[v], np.ones(u.size))) * depth[v, u]
    points[2] -= z
    return float(np.abs(np.linalg.norm(points, axis=0) - r).max())


def test_the_rays_of_mujoco_meet_a_ball_and_a_plane():
    depth, ids = mujoco.Rays(together([shape("sphere", 0.3, pose=at(z=1.0))]), SMALL).picture()
    assert sphere_seen(depth, 1.0, 0.3) < 1e-14 and np.array_equal(ids == 0, depth > 0.0)
    wall, _ = mujoco.Rays(facing(2.0), SMALL).picture()
    assert np.abs(wall - 2.0).max() < 1e-14


def facing_share(shapes, depth: np.ndarray, ids: np.ndarray) -> np.ndarray:
    """Cosine between the ray of each pixel that sees a box and the normal of the face it meets."""
    v, u = np.nonzero(depth)
    x, y = SMALL.rays()
    rays = np.stack((x[u], y[v], np.ones(u.size)))
    which = ids[v, u]
    R = to_matrix(shapes.poses[3:, which])
    inside = np.einsum("ijn,in->jn", R, rays * depth[v, u] - shapes.poses[:3, which])
    face = np.argmax(np.abs(inside) / shapes.sizes[:, which], axis=0)
    along = np.einsum("ijn,in->jn", R, rays / np.linalg.norm(rays, axis=0))
    return np.abs(along[face, np.arange(u.size)])


def test_the_rays_of_open3d_meet_boxes():
    rng, worst, other = np.random.default_rng(0), [], 0
    for _ in range(20):
        shapes = boxes(rng)
        depth, ids = render(shapes, SMALL)
        theirs, owner = open3d.Rays(shapes, SMALL).picture()
        # A face that is grazed makes more of the rounding.
        error = np.abs(depth - theirs)[ids >= 0] * facing_share(shapes, depth, ids)
        worst.append(error[owner[ids >= 0] == ids[ids >= 0]].max())
        other += int(np.count_nonzero(ids != owner))
    # In single precision a ray that passes an edge may end on the other side of it.
    assert max(worst) < 1e-6 and other <= 10
    with pytest.raises(ValueError, match="boxes only"):
        open3d.Rays(shape("sphere", 1.0), SMALL)


@pytest.mark.slow
def test_opengl_settles_where_the_middle_of_a_pixel_is():
    shapes = boxes(np.random.default_rng(1))
    try:
        drawn = mujoco.opengl(shapes, SMALL)
    except ImportError as error:
        pytest.skip(f"the middle of a pixel was NOT compared with OpenGL: {error}")
    depth, _ = render(shapes, SMALL)
    shifted = Camera(80, 60, SMALL.fx, SMALL.fy, 40.0, 30.0)
    both = (drawn > 0.0) & (depth > 0.0)
    assert both.sum() > 500
    assert np.median(np.abs(drawn - depth)[both]) < 1e-6
    assert np.median(np.abs(drawn - render(shapes, shifted)[0])[both]) > 1e-4
    with pytest.raises(ValueError, match="symmetric"):
        mujoco.opengl(shapes, shifted)


def moved_cloud(n: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """A cloud, and the same moved."""
    points = 0.1 * np.random.default_rng(2).normal(size=(3, n))
    return points, rotate(MOVED[3:], points) + MOVED[:3, None]


@pytest.mark.parametrize("to_plane", [False, True])
def test_open3d_finds_how_a_cloud_was_moved(to_plane):
    points, moved = moved_cloud()
    target = open3d.Cloud(points)
    if to_plane:
        target.set_normals(points / np.linalg.norm(points, axis=0))
    result = open3d.Cloud(moved).icp(target, STILL, 0.05, 60, to_plane)
    assert np.abs(result.pose - invert(MOVED)).max() < (1e-7 if to_plane else 1e-12)
    # The nearest point is no farther than the point's own place, missed by the error of the pose.
    back = rotate(result.pose[3:], moved) + result.pose[:3, None]
    missed = np.sqrt(np.mean(np.sum((back - points) ** 2, axis=0)))
    assert result.matched == 1.0 and result.residual < 1e-12 + 1.001 * missed


@pytest.mark.parametrize("kind", small_gicp.KINDS)
def test_small_gicp_finds_how_a_cloud_was_moved(kind):
    points, moved = moved_cloud()
    result = small_gicp.Cloud(moved, 12).align(
        small_gicp.Cloud(points, 12), STILL, 0.05, 60, kind, 1e-10
    )
    assert np.abs(result.pose - invert(MOVED)).max() < 1e-9
    assert result.matched == 400 and result.converged and result.iterations < 60
    assert np.abs(result.information - result.information.T).max() < 1e-6 * result.information.max()


def test_open3d_finds_a_plane_and_three_clusters():
    rng = np.random.default_rng(3)
    points = np.vstack((rng.uniform(-0.2, 0.2, (2, 400)), np.full(400, 0.7)))
    points[2, :100] -= 0.1
    plane, near = open3d.Cloud(points).plane(1e-4, 100)
    assert np.abs(plane - [0.0, 0.0, -1.0, 0.7]).max() < 1e-12
    assert np.array_equal(near, np.arange(400) >= 100)
    apart = np.repeat(np.array([[-1.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]), 5, axis=1)
    assert open3d.Cloud(apart).dbscan(0.1, 3).tolist() == np.repeat([0, 1, 2], 5).tolist()
    estimated = open3d.Cloud(points[:, 100:])
    estimated.normals()
    assert np.abs(np.abs(np.asarray(estimated.handle.normals)[:, 2]) - 1.0).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "adapter", "report"),
    [("open3d", open3d, "pip install 'open3d"), ("small_gicp", small_gicp, "pip install 'small")],
)
def test_a_missing_library_says_what_to_install(monkeypatch, name, adapter, report):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(ImportError, match=report):
        adapter.library()


def test_features_find_a_known_transform_without_a_start():
    """Of an L seen from all sides, so that nothing of it is missing."""
    points, normals = features.surface(yaw_net.L_PART, 20_000, np.random.default_rng(0))
    model = open3d.Cloud(points)
    model.set_normals(normals)
    pose = at(0.3, -0.2, 0.5, (0.4, 2.0, -1.1))
    R = to_matrix(pose[3:])
    moved = open3d.Cloud(R @ points + pose[:3, None])
    moved.set_normals(R @ normals)
    target, source = open3d.Features.of(model, 0.006), open3d.Features.of(moved, 0.006)
    result = open3d.register_features(source, target, "ransac")
    refined = source.cloud.icp(target.cloud, result.pose, 0.01, 50)
    shift, turn = pose_distance(yaw_net.L_PART, invert(refined.pose[:, None])[:, 0], pose)
    assert shift < 2e-3 and turn < 0.03
    with pytest.raises(ValueError, match="method must be"):
        open3d.register_features(source, target, "teaser")
