"""Coal asked how far apart two shapes are (it comes with Pinocchio's package `pin`).

What is switched off: the guess kept from the call before, timings and the acceleration of the
search, which are off by default, and the early end of a search: both tolerances, 1e-6 by default,
are set to 1e-12. What stays on is the signed distance, which asks for the depth where shapes are in
each other. Poses are set before the clock starts. `Pair` is called from Python for each pair;
`Batch` is Pinocchio's `computeDistances`, one call in C++ for all of them. `CapsuleArm` asks
whether an arm touches anything, with `computeCollisions`, which stops at the first collision.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import invalid
from course.contact.shapes import Shape
from course.kinematics import Chain
from course.libraries import import_error
from course.oracles import pinocchio as pinocchio_arm
from course.rigid_body.spatial import poses

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
        # Qhull's triangles have no orientation; Coal needs them counter-clockwise from outside.
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
        # Local names: attribute look-ups stay outside the timed loop.
        distance, a, b = self._distance, self.a, self.b
        request, result = self.request, self.result
        outcome = []
        for p, q in zip(at_a, at_b, strict=True):
            result.clear()
            outcome.append(distance(a, p, b, q, request, result))
        return outcome

    def distances(self, pose_a: ArrayLike, pose_b: ArrayLike) -> Array:
        """Return signed distances [m], shape (N,).

        Poses are made here, so this one is not for timing.

        Args:
            pose_a: poses of the first shape, (7, N).
            pose_b: poses of the second shape, (7, N).
        """
        return np.array(self.loop(transforms(pose_a), transforms(pose_b)))


class Batch:
    """Many pairs of two shapes at fixed poses, for Pinocchio's `computeDistances`.

    Args:
        a, b: shapes in space.
        pose_a, pose_b: their poses, (7, N).
        tolerance: of both searches; None leaves Coal's own, 1e-6.

    Raises:
        ImportError: if Pinocchio is not installed.
    """

    def __init__(
        self,
        a: Shape,
        pose_a: ArrayLike,
        b: Shape,
        pose_b: ArrayLike,
        tolerance: float | None = 1e-12,
    ) -> None:
        try:
            import pinocchio
        except ImportError as error:
            raise import_error("Pinocchio", "pip install 'pin>=4.0'", error) from error
        self._compute = pinocchio.computeDistances
        self._model = pinocchio.GeometryModel()
        shapes = geometry(a), geometry(b)
        batches = poses("pose_a", pose_a, 3), poses("pose_b", pose_b, 3)
        for i in range(batches[0].shape[1]):
            ends = []
            for name, shape, q in zip("ab", shapes, batches, strict=True):
                w, x, y, z = q[3:, i]
                place = pinocchio.SE3(pinocchio.Quaternion(w, x, y, z), q[:3, i].copy())
                what = pinocchio.GeometryObject(f"{name}{i}", 0, 0, place, shape)
                ends.append(self._model.addGeometryObject(what))
            self._model.addCollisionPair(pinocchio.CollisionPair(*ends))
        self._data = self._model.createData()
        if tolerance is not None:
            for request in self._data.distanceRequests:
                request.gjk_tolerance = request.epa_tolerance = tolerance
        base = pinocchio.Model()
        pinocchio.updateGeometryPlacements(
            base, base.createData(), self._model, self._data, np.zeros(0)
        )

    def compute(self) -> None:
        """Compute all distances: the part to be timed."""
        self._compute(self._model, self._data)

    def distances(self) -> Array:
        """Return the signed distances that `compute` found [m], shape (N,)."""
        return np.array([result.min_distance for result in self._data.distanceResults])


class CapsuleArm:
    """An arm of capsules among obstacles, as Pinocchio and Coal have it.

    Args:
        chain: an arm whose joints are numbered from the base on.
        capsules: of each the frame that carries it (`chain.n` is the tool), both ends in that frame
            [m], the radius [m].
        obstacles: shapes in space with their poses (7,).
        pairs: numbers of two capsules, or of a capsule and a held shape, that must not meet.
        held: shapes in the hand with their poses (7,) in the tool's frame, numbered after the
            capsules.

    Raises:
        ImportError: if Pinocchio is not installed.
    """

    def __init__(
        self,
        chain: Chain,
        capsules: Sequence[tuple[int, Any, Any, float]],
        obstacles: Sequence[tuple[Shape, ArrayLike]],
        pairs: Iterable[tuple[int, int]] = (),
        held: Sequence[tuple[Shape, ArrayLike]] = (),
    ) -> None:
        coal = _coal()
        import pinocchio

        self._collide = pinocchio.computeCollisions
        self.model, self._shapes = pinocchio_arm.model(chain), pinocchio.GeometryModel()
        self._data = self.model.createData()
        links = []
        tool = pinocchio.SE3(pinocchio.Quaternion(*chain.tool[3:]).matrix(), chain.tool[:3])
        for k, (frame, start, end, radius) in enumerate(capsules):
            a, b = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
            # Coal's capsule lies along its z axis, about its middle.
            turn = pinocchio.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), b - a)
            place = pinocchio.SE3(turn.matrix(), 0.5 * (a + b))
            shape = coal.Capsule(radius, float(np.linalg.norm(b - a)))
            joint = self.model.getJointId(f"joint {min(frame, chain.n - 1)}")
            place = tool * place if frame == chain.n else place
            what = pinocchio.GeometryObject(f"link {k}", joint, joint, place, shape)
            links.append(self._shapes.addGeometryObject(what))
        for k, (shape, pose) in enumerate(held):
            (x, y, z, *quaternion) = np.asarray(pose, dtype=float)
            turn = pinocchio.Quaternion(*quaternion).matrix()
            place = tool * pinocchio.SE3(turn, np.array([x, y, z]))
            joint = self.model.getJointId(f"joint {chain.n - 1}")
            what = pinocchio.GeometryObject(f"held {k}", joint, joint, place, geometry(shape))
            links.append(self._shapes.addGeometryObject(what))
        for i, j in pairs:
            self._shapes.addCollisionPair(pinocchio.CollisionPair(links[int(i)], links[int(j)]))
        for k, (shape, pose) in enumerate(obstacles):
            (x, y, z, *quaternion) = np.asarray(pose, dtype=float)
            turn = pinocchio.Quaternion(*quaternion).matrix()
            place = pinocchio.SE3(turn, np.array([x, y, z]))
            what = pinocchio.GeometryObject(f"obstacle {k}", 0, 0, place, geometry(shape))
            other = self._shapes.addGeometryObject(what)
            for link in links:
                self._shapes.addCollisionPair(pinocchio.CollisionPair(link, other))
        self._pairs = self._shapes.createData()

    def state_free(self, q: Array) -> bool:
        """Return whether the arm touches nothing at q, shape (n,)."""
        return not self._collide(self.model, self._data, self._shapes, self._pairs, q, True)

    def edge_free(self, a: Array, b: Array, spacing: float) -> bool:
        """Return whether it touches nothing at postures of an edge at most `spacing` apart [rad].

        The postures lie next to each other, as in OMPL's check with a fixed resolution.
        """
        pieces = max(int(np.ceil(np.linalg.norm(b - a) / spacing)), 1)
        return all(self.state_free(a + k / pieces * (b - a)) for k in range(1, pieces + 1))
