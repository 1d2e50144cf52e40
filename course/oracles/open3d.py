"""Open3D asked for what chapter 7 does: pictures, clouds, planes, clusters, registration.

Open3D computes with several threads where it can. It is loaded with one OpenMP thread; what other
threads it starts stays, so compare processor time. A `Cloud` is made before the clock starts.
Its random numbers come from one seed a process.
"""

from __future__ import annotations

import ctypes
import os
import sys
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import invalid, one_of
from course.libraries import import_error
from course.perception.camera import Array, Camera, Ids, Shapes
from course.rigid_body.quaternion import from_matrix, to_matrix


def library() -> ModuleType:
    """Open3D, which asks for the system's libusb when it is imported: a package brings it along.

    Raises:
        ImportError: it is not installed; the message names the package.
    """
    os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")  # which prints in notebooks
    threads = os.environ.get("OMP_NUM_THREADS")
    # Read when the library is loaded, so it is set before the import and put back after it.
    os.environ["OMP_NUM_THREADS"] = "1"
    try:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), ctypes.RTLD_GLOBAL)
        import open3d
    except (ImportError, OSError) as error:
        install = "pip install 'open3d>=0.19' 'libusb-package>=1.0.26'"
        raise import_error("Open3D", install, error) from error
    finally:
        del os.environ["OMP_NUM_THREADS"]
        if threads is not None:
            os.environ["OMP_NUM_THREADS"] = threads
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


def matrix(pose: ArrayLike) -> Array:
    """Return a pose (7,) as a 4 x 4 matrix."""
    q = np.asarray(pose, dtype=float)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = to_matrix(q[3:]), q[:3]
    return T


def pose_of(T: Array) -> Array:
    """Return the pose (7,) of a 4 x 4 matrix, turned to the nearest rotation where it is none."""
    # Polar projection onto the rotations.
    u, _, vt = np.linalg.svd(T[:3, :3])
    return np.concatenate((T[:3, 3], from_matrix(u @ vt)))


class Rays:
    """Embree, through Open3D: single precision, triangles; so boxes only."""

    def __init__(self, shapes: Shapes, camera: Camera) -> None:
        o3d = library()
        if set(shapes.kinds) - {"box"}:
            raise invalid("shapes.kinds", shapes.kinds, "boxes only: others are no triangles")
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        for size, pose in zip(shapes.sizes.T, shapes.poses.T, strict=True):
            box = o3d.geometry.TriangleMesh.create_box(*(2.0 * size)).translate(-size)
            box.transform(matrix(pose))
            self._scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(box))
        x, y = camera.rays()
        rays = np.zeros((y.size, x.size, 6), np.float32)
        rays[..., 3], rays[..., 4], rays[..., 5] = x, y[:, None], 1.0
        self._rays = o3d.core.Tensor(rays)

    def cast(self) -> Any:
        """Return all rays, in one call: the part to be timed."""
        # The rays are built before the clock starts.
        return self._scene.cast_rays(self._rays, nthreads=1)

    def picture(self) -> tuple[Array, Ids]:
        """Return depth, 0 without a hit, and the number of the shape, -1 without a hit; (H, W)."""
        result = self.cast()
        depth, ids = result["t_hit"].numpy().astype(float), result["geometry_ids"].numpy()
        hit = np.isfinite(depth)
        return np.where(hit, depth, 0.0), np.where(hit, ids.astype(np.int64), -1)


class Picture:
    """A depth picture, to be made points of; Open3D keeps it in single precision."""

    def __init__(self, depth: Array, camera: Camera) -> None:
        self._o3d = o3d = library()
        self._image = o3d.geometry.Image(depth.astype(np.float32))
        self._camera = o3d.camera.PinholeCameraIntrinsic(
            camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy
        )

    def cloud(self) -> Any:
        """Return `PointCloud.create_from_depth_image`: the part to be timed."""
        make = self._o3d.geometry.PointCloud.create_from_depth_image
        return make(self._image, self._camera, depth_scale=1.0, depth_trunc=1e9)

    def points(self) -> Array:
        """Return shape (3, N) [m]."""
        return np.asarray(self.cloud().points).T.copy()


@dataclass(frozen=True)
class Registered:
    """What a registration answered.

    Attributes:
        pose: of the source in the frame of the target, shape (7,).
        matched: share of the source's points with a match.
        residual: root mean square distance of matches [m].
    """

    pose: Array
    matched: float
    residual: float


class Cloud:
    """A point cloud. What returns handles or arrays of Open3D is to be timed."""

    def __init__(self, points: ArrayLike) -> None:
        self._o3d = o3d = library()
        rows = np.ascontiguousarray(np.asarray(points, dtype=float).T)
        self.handle = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(rows))

    @classmethod
    def of(cls, handle: Any) -> Cloud:
        """Return what a handle of Open3D's holds, without a copy."""
        one = cls.__new__(cls)
        one._o3d, one.handle = sys.modules["open3d"], handle
        return one

    def voxel_mean(self, voxel: float) -> Any:
        """Return a handle of the voxel means; `array` gives them."""
        return self.handle.voxel_down_sample(voxel)

    def array(self, handle: Any) -> Array:
        """Return the points of a handle, shape (3, N) [m]."""
        return np.asarray(handle.points).T.copy()

    def dbscan(self, eps: float, least: int) -> Ids:
        """Return the cluster of each point, -1 for noise."""
        return np.asarray(self.handle.cluster_dbscan(eps, least), dtype=np.int64)

    def plane(
        self, tolerance: float, draws: int, confidence: float = 1.0, seed: int = 0
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Return `segment_plane`.

        The plane (a, b, c, d) towards the camera, and which points are near it.

        Open3D fits the plane again to the points near the best one, and returns those of that one.
        """
        self._o3d.utility.random.seed(seed)
        result, near = self.handle.segment_plane(tolerance, 3, draws, confidence)
        plane = np.asarray(result, dtype=float)
        mask = np.zeros(len(self.handle.points), bool)
        mask[near] = True
        # The sign of a plane is arbitrary: the camera, at the origin, is on its positive side.
        return (-plane if plane[3] < 0.0 else plane), mask

    def normals(self, neighbours: int = 12) -> None:
        """Estimate normals, which a target of point-to-plane registration has to have."""
        search = self._o3d.geometry.KDTreeSearchParamKNN(neighbours)
        self.handle.estimate_normals(search)

    def set_normals(self, normals: ArrayLike) -> None:
        """Normals that are known, shape (3, N)."""
        rows = np.ascontiguousarray(np.asarray(normals, dtype=float).T)
        self.handle.normals = self._o3d.utility.Vector3dVector(rows)

    def icp(
        self,
        target: Cloud,
        start: Array,
        gate: float,
        iterations: int = 30,
        to_plane: bool = False,
        change: float = 1e-12,
    ) -> Registered:
        """Return the registration of this cloud to a target (`registration_icp`).

        Args:
            target: with normals if `to_plane` is set.
            start: pose to begin with, shape (7,).
            gate: largest distance of a match [m].
            iterations: at most.
            to_plane: point-to-plane instead of point-to-point.
            change: of fitness and residual, relative, below which it stops.
        """
        r = self._o3d.pipelines.registration
        kind = (
            r.TransformationEstimationPointToPlane()
            if to_plane
            else r.TransformationEstimationPointToPoint()
        )
        stop = r.ICPConvergenceCriteria(change, change, iterations)
        result = r.registration_icp(self.handle, target.handle, gate, matrix(start), kind, stop)
        return Registered(pose_of(result.transformation), result.fitness, result.inlier_rmse)


# --- Without a start: features --------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Features:
    """A cloud on a grid, with normals and a feature for each point.

    Attributes:
        cloud: the means of the grid.
        feature: a fast point feature histogram (FPFH) for each (Rusu, Blodow and Beetz, 2009).
        voxel: of the grid [m].
    """

    cloud: Cloud
    feature: Any
    voxel: float

    @classmethod
    def of(
        cls,
        cloud: Cloud,
        voxel: float,
        towards: ArrayLike | None = None,
        flat: float = 0.0,
    ) -> Features:
        """Compute them, with the radii that Open3D's documentation uses: 2 and 5 cells.

        Args:
            cloud: with normals that point outwards, if `towards` is None.
            voxel: of the grid [m].
            towards: the camera, (3,) [m]: normals are estimated and turned to it. A feature depends
                on their sign, so that of model and image have to agree.
            flat: least radius for the normals, of noisy points several deviations [m].
        """
        o3d = library()
        some = cloud.handle.voxel_down_sample(voxel)
        if towards is not None:
            some.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(max(2.0 * voxel, flat), 100))
            some.orient_normals_towards_camera_location(np.asarray(towards, dtype=float))
        search = o3d.geometry.KDTreeSearchParamHybrid(5.0 * voxel, 100)
        feature = o3d.pipelines.registration.compute_fpfh_feature(some, search)
        return cls(Cloud.of(some), feature, voxel)


def register_features(
    source: Features, target: Features, method: str = "ransac", seed: int = 0
) -> Registered:
    """Return a registration that needs no start, by pairs of points with similar features.

    Args:
        source: of the image.
        target: of the model.
        method: "ransac", three pairs at a time, checked by the lengths of their edges; "fast", all
            pairs at once with a robust cost (Zhou, Park and Koltun, 2016).
        seed: of the samples.
    """
    one_of("method", method, ("ransac", "fast"))
    o3d = library()
    r = o3d.pipelines.registration
    o3d.utility.random.seed(seed)
    ends = (source.cloud.handle, target.cloud.handle, source.feature, target.feature)
    reach = 1.5 * source.voxel
    if method == "fast":
        option = r.FastGlobalRegistrationOption(maximum_correspondence_distance=reach)
        result = r.registration_fgr_based_on_feature_matching(*ends, option)
    else:
        result = r.registration_ransac_based_on_feature_matching(
            *ends,
            True,
            reach,
            r.TransformationEstimationPointToPoint(False),
            3,
            [
                r.CorrespondenceCheckerBasedOnEdgeLength(0.9),
                r.CorrespondenceCheckerBasedOnDistance(reach),
            ],
            r.RANSACConvergenceCriteria(100_000, 0.999),
        )
    return Registered(pose_of(result.transformation), result.fitness, result.inlier_rmse)
