"""Coal asked how far apart two shapes are (it comes with Pinocchio's package `pin`).

What is switched off: the guess kept from the call before, timings and the acceleration of the
search, which are off by default, and the early end of a search: both tolerances, 1e-6 by default,
are set to 1e-12. What stays on is the signed distance, which asks for the depth where shapes are in
each other. Poses are made before the clock starts, unless a caller asks for them in the loop.
"""

from __future__ import annotations

from collections.abc import Iterable
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import invalid
from course.contact.shapes import Shape, poses
from course.libraries import import_error
from course.rigid_body.quaternion import to_matrix

Array = NDArray[np.float64]


def _coal() -> ModuleType:
    try:
        import coal
    except ImportError as error:
        raise import_error("Coal, a part of Pinocchio", "pip install 'pin>=4.0'", error) from error
    return coal


def _convex(coal: ModuleType, vertices: Array) -> Any:
    """Return a convex polyhedron from points that span a volume."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(vertices.T)
    corners = coal.StdVec_Vec3s()
    number = {}
    for k, i in enumerate(hull.vertices):
        corners.append(vertices[:, i])
        number[int(i)] = k
    triangles = coal.StdVec_Triangle()
    for (i, j, k), plane in zip(hull.simplices, hull.equations, strict=True):
        p, q, r = vertices[:, i], vertices[:, j], vertices[:, k]
        outward = np.dot(np.cross(q - p, r - p), plane[:3]) > 0.0
        j, k = (j, k) if outward else (k, j)
        triangles.append(coal.Triangle(number[int(i)], number[int(j)], number[int(k)]))
    return coal.Convex(corners, triangles)


def geometry(shape: Shape) -> Any:
    """Return the same shape in Coal.

    Raises:
        ValueError: for a shape of the plane, or one that is rounded where Coal has none.
        ImportError: if Coal is not installed.
    """
    coal = _coal()
    if shape.dim != 3 or (shape.radius and shape.name not in ("sphere", "capsule")):
        raise invalid("shape", shape.name, "a shape in space, rounded only as sphere or capsule")
    if shape.name == "sphere":
        return coal.Sphere(shape.radius)
    if shape.name == "capsule":
        return coal.Capsule(shape.radius, 2.0 * float(shape.half[2]))
    if shape.name == "box":
        return coal.Box(*(2.0 * shape.half))
    if shape.name == "plane":
        return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
    return _convex(coal, shape.vertices)


def transforms(pose: ArrayLike) -> list[Any]:
    """Return poses in Coal's form, of shape (7, N)."""
    coal = _coal()
    q = poses("pose", pose, 3)
    return [coal.Transform3s(coal.Quaternion(*row[3:]), row[:3]) for row in q.T.copy()]


def parts(pose: ArrayLike) -> list[tuple[Array, Array]]:
    """Return the rotation matrix and position of each pose.

    A `Transform3s` is built from these in a loop.
    """
    q = poses("pose", pose, 3)
    R = to_matrix(q[3:])
    return [(R[:, :, i].copy(), q[:3, i].copy()) for i in range(q.shape[1])]


class Pair:
    """Two shapes, asked for their distance again and again.

    Args:
        a, b: shapes in space.
        tolerance: of both searches; None leaves Coal's own, 1e-6.
    """

    def __init__(self, a: Shape, b: Shape, tolerance: float | None = 1e-12) -> None:
        coal = _coal()
        self._distance = coal.distance
        self.a, self.b = geometry(a), geometry(b)
        self.request, self.result = coal.DistanceRequest(), coal.DistanceResult()
        if tolerance is not None:
            self.request.gjk_tolerance = tolerance
            self.request.epa_tolerance = tolerance

    def loop(self, at_a: Iterable[Any], at_b: Iterable[Any]) -> list[float]:
        """Return signed distances, one call of Coal a pair: the part to be timed."""
        distance, a, b = self._distance, self.a, self.b
        request, result = self.request, self.result
        outcome = []
        for p, q in zip(at_a, at_b, strict=True):
            result.clear()
            outcome.append(distance(a, p, b, q, request, result))
        return outcome

    def built_in_the_loop(self, a: list[tuple[Array, Array]], b: list[tuple[Array, Array]]) -> None:
        """Run `loop` with each pose built inside it, from what `parts` returns."""
        make = _coal().Transform3s
        self.loop((make(*p) for p in a), (make(*q) for q in b))

    def distances(self, pose_a: ArrayLike, pose_b: ArrayLike) -> Array:
        """Return signed distances [m], shape (N,).

        Poses are made here, so this one is not for timing.

        Args:
            pose_a: poses of the first shape, (7, N).
            pose_b: poses of the second shape, (7, N).
        """
        return np.array(self.loop(transforms(pose_a), transforms(pose_b)))
