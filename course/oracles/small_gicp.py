"""small_gicp asked to register a cloud (Koide, small_gicp, Journal of Open Source Software, 2024).

It runs on one thread. Its own test of the end is on the size of a step. Clouds, normals and trees
are made before the clock starts; `align` is the part to be timed. It returns the matrix of its
normal equations, without a scale of noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from course.check import one_of
from course.libraries import import_error
from course.oracles.open3d import matrix, pose_of
from course.perception.camera import Array

KINDS = ("ICP", "PLANE_ICP", "GICP")


def library() -> ModuleType:
    """Return small_gicp.

    Raises:
        ImportError: it is not installed; the message names the package.
    """
    try:
        import small_gicp
    except ImportError as error:
        raise import_error("small_gicp", "pip install 'small-gicp>=1.0.1'", error) from error
    return small_gicp


@dataclass(frozen=True)
class Aligned:
    """What a registration answered.

    Attributes:
        pose: of the source in the frame of the target, shape (7,).
        matched: how many points of the source have a match.
        error: half the sum of squared residuals, as small_gicp counts it.
        information: of its last step, shape (6, 6): turns first, in the frame of the source.
        iterations: that it took.
        converged: whether the last step was small enough.
    """

    pose: Array
    matched: int
    error: float
    information: Array
    iterations: int
    converged: bool


class Cloud:
    """A point cloud with its tree, and normals and covariances of `neighbours` if it is above 0."""

    def __init__(self, points: ArrayLike, neighbours: int = 0) -> None:
        self._library = small = library()
        self.handle = small.PointCloud(np.ascontiguousarray(np.asarray(points, dtype=float).T))
        self.tree = small.KdTree(self.handle)
        if neighbours:
            small.estimate_normals_covariances(self.handle, self.tree, neighbours)

    def voxel_mean(self, voxel: float) -> Cloud:
        """Return the voxel means, without a tree, which only a target needs."""
        one = object.__new__(Cloud)
        one._library = self._library
        one.handle = self._library.voxelgrid_sampling(self.handle, voxel, 1)
        return one

    def align(
        self,
        target: Cloud,
        start: Array,
        gate: float,
        iterations: int = 30,
        kind: str = "ICP",
        step: float = 1e-12,
    ) -> Aligned:
        """Register this cloud to a target.

        Args:
            target: with normals for "PLANE_ICP", both with covariances for "GICP".
            start: pose to begin with, shape (7,).
            gate: largest distance of a match [m].
            iterations: at most.
            kind: one of `KINDS`.
            step: shift [m] and turn [rad] below which it stops.
        """
        result = self._library.align(
            target.handle,
            self.handle,
            target.tree,
            matrix(start),
            one_of("kind", kind, KINDS),
            gate,
            1,
            iterations,
            step,
            step,
        )
        return Aligned(
            pose_of(result.T_target_source),
            int(result.num_inliers),
            float(result.error),
            np.asarray(result.H),
            int(result.iterations),
            bool(result.converged),
        )
