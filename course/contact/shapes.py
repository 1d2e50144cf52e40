"""Shapes as data: a core (a point, a segment, a box or a set of points) and a radius around it.

A sphere is a point with a radius, a capsule a segment with one. So whatever compares two cores only
ever sees polytopes, and ends exactly; the radii are added afterwards (van den Bergen, Collision
Detection in Interactive 3D Environments, 2003, sec. 4.3.2).

A pose in space is (x, y, z, qw, qx, qy, qz), shape (7,) or (7, N); in the plane (x, y, angle),
shape (3,) or (3, N) [m, rad].
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import finite, invalid, one_of, positive, vector
from course.rigid_body.quaternion import to_matrix
from course.rigid_body.spatial import poses

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Shape:
    """The points within `radius` of a core: the vertices, each swept over the box of `half`.

    A shape of the plane stands in the plane z = 0 of its core. Make one by `sphere`, `capsule`,
    `box`, `points` or `plane`.

    Attributes:
        name: which of these made it.
        dim: 2 or 3.
        vertices: in the shape's frame, shape (3, n) [m].
        half: half lengths of a box about each vertex, along the shape's axes, shape (3,) [m].
        radius: [m].
    """

    name: str
    dim: int
    vertices: Array
    half: Array
    radius: float

    @cached_property
    def corners(self) -> Array:
        """All corners of the core in the shape's frame, shape (3, n) [m]."""
        used = np.flatnonzero(self.half)
        # From the middle outwards: every axis with an extent doubles the number of corners.
        signs = np.zeros((3, 1))
        for axis in used:
            step = self.half[axis] * np.eye(3)[:, axis : axis + 1]
            signs = np.hstack((signs - step, signs + step))
        return (self.vertices[:, :, None] + signs[:, None, :]).reshape(3, -1)

    @cached_property
    def size(self) -> float:
        """Distance of the farthest point from the shape's origin [m]; infinite for a plane."""
        if self.name == "plane":
            return math.inf
        # The farthest point of a convex core is a corner.
        return float(np.linalg.norm(self.corners, axis=0).max()) + self.radius


def _shape(name: str, dim: int, half: tuple[float, ...] = (), radius: float = 0.0) -> Shape:
    """Return a shape whose core is a box about its origin: a point, a segment, or the whole box.

    Args:
        name: kind of shape, as in `Shape.name`.
        dim: 2 or 3.
        half: half lengths of the core along x, y and z [m]; those that are omitted are 0, so ()
            is a point and one number a segment along x.
        radius: distance that the shape reaches beyond its core [m].

    Raises:
        ValueError: for a `dim` that is neither 2 nor 3. The callers check the sizes.
    """
    whole = np.zeros(3)
    whole[: len(half)] = half
    return Shape(name, one_of("dim", dim, (2, 3)), np.zeros((3, 1)), whole, radius)


def sphere(radius: float, dim: int = 3) -> Shape:
    """Return a ball about its origin; with `dim` 2 a disc.

    Raises:
        ValueError: for a radius that is not positive, or a `dim` that is neither 2 nor 3.
    """
    return _shape("sphere", dim, (), positive("radius", radius, unit="m"))


def capsule(radius: float, half_length: float, dim: int = 3) -> Shape:
    """Return a ball swept along a segment: along z in space, along x in the plane.

    Args:
        radius: of the ball [m].
        half_length: of the segment [m].
        dim: 2 or 3.

    Raises:
        ValueError: for a size that is not positive, or a `dim` that is neither 2 nor 3.
    """
    half = positive("half_length", half_length, unit="m")
    along = (half,) if dim == 2 else (0.0, 0.0, half)
    return _shape("capsule", dim, along, positive("radius", radius, unit="m"))


def box(half: ArrayLike, radius: float = 0.0) -> Shape:
    """Return a box about its origin, in as many dimensions as it has half sizes.

    Args:
        half: half sizes along its axes, shape (2,) or (3,) [m].
        radius: by which edges and corners are rounded [m]; it adds to the size.

    Raises:
        ValueError: for a half size that is not positive or a negative radius.
    """
    sizes = vector("half", half, (2,), (3,), unit="m")
    for i, value in enumerate(sizes):
        positive(f"half[{i}]", value, unit="m")
    return _shape("box", sizes.size, tuple(sizes), finite("radius", radius, 0.0, unit="m"))


def points(vertices: ArrayLike, radius: float = 0.0) -> Shape:
    """Return the convex hull of points; they need not be its corners, and may lie in a plane.

    Args:
        vertices: shape (2, n) or (3, n), n at least 1 [m].
        radius: by which the hull is rounded [m].

    Raises:
        ValueError: for no point, a NaN or a negative radius.
    """
    given = vector("vertices", vertices, (2, None), (3, None), unit="m")
    if not given.shape[1]:
        raise invalid("vertices.shape", given.shape, "at least one point")
    # Points of the plane get z = 0, so that one narrow phase serves both dimensions.
    inside = np.zeros((3, given.shape[1]))
    inside[: len(given)] = given
    size = finite("radius", radius, 0.0, unit="m")
    return Shape("points", len(given), inside, np.zeros(3), size)


def plane(dim: int = 3) -> Shape:
    """Return all below z = 0 of its frame, in the plane all below y = 0: ground, a wall, a ramp."""
    return _shape("plane", dim)


def bounds(shape: Shape, pose: ArrayLike) -> Array:
    """Return the axis-aligned bounding boxes of a shape, as tight as they can be.

    Args:
        shape: the shape; a plane has an infinite box.
        pose: see the top of this file.

    Returns:
        Lower and upper corners, shape (2, dim) or (2, dim, N) [m].
    """
    box = bounds_in_space(shape, poses("pose", pose, shape.dim))
    return box[:, : shape.dim].reshape(2, shape.dim, *np.shape(pose)[1:])


def corners_in_space(shape: Shape, q: Array) -> Array:
    """Return all corners of the core in the world, (3, n, N) [m], for poses in space (7, N)."""
    return np.einsum("ijn,jk->ikn", to_matrix(q[3:]), shape.corners) + q[:3, None]


def bounds_in_space(shape: Shape, q: Array) -> Array:
    """Return `bounds` for poses in space that are checked, shape (7, N): shape (2, 3, N)."""
    if shape.name == "plane":
        # A half-space has no finite bounding box.
        return np.stack((np.full((3, q.shape[1]), -np.inf), np.full((3, q.shape[1]), np.inf)))
    R = to_matrix(q[3:])
    turned = np.einsum("ijn,jk->ikn", R, shape.vertices)
    # Support function of a turned box: |R| times its half sizes, without visiting its corners.
    reach = np.einsum("ijn,j->in", np.abs(R), shape.half) + shape.radius
    # The hull of the turned vertices, each swept by the box and the radius.
    return np.stack((turned.min(axis=1) + q[:3] - reach, turned.max(axis=1) + q[:3] + reach))
