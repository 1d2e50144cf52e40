"""VAMP's Panda: edges and RRT-Connect with vector instructions (Thomason and others, 2024)."""

from __future__ import annotations

import functools
import math
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, positive, vector
from course.kinematics import frames, panda, tip
from course.libraries import import_error
from course.planning import World
from course.planning.capsules import CENTRE, HALF, KIND, POINT, RADIUS, SEGMENT, TURN
from course.rigid_body.quaternion import to_matrix

Array = NDArray[np.float64]
Capsule = tuple[int, Array, Array, float]

LANES = 8  # configurations that one instruction checks, of 256 bits in single precision
RANGE = 1.0  # longest step of RRT-Connect that VAMP's authors chose for the Panda [rad]
SAMPLES = 10_000  # of a plan at most; each call reserves memory for all of them


def library() -> ModuleType:
    """Return VAMP, or raise an ImportError that says how to install it."""
    try:
        import vamp
    except ImportError as error:
        raise import_error("VAMP", "pip install 'vamp-planner>=0.6.4'", error) from error
    return vamp


def spacing() -> float:
    """Return the spacing of the points along an edge in VAMP's planners [rad]."""
    return 1.0 / float(library().panda.resolution())


@functools.cache
def spheres() -> tuple[Capsule, ...]:
    """Return the spheres of VAMP's Panda, as capsules without length, in the order of the frames.

    VAMP returns them in the world only. A sphere belongs to the frame of the chain in which its
    centre is the same for all postures.

    Raises:
        ImportError: if VAMP is not installed.
        ValueError: if a sphere is fixed in no frame of `panda()`.
    """
    arm, chain = library().panda, panda()
    rng = np.random.default_rng(0)
    postures = rng.uniform(chain.lower, chain.upper, (8, chain.n))
    spheres_of = [arm.fk(q.tolist()) for q in postures]
    centres = np.array([[(s.x, s.y, s.z) for s in row] for row in spheres_of])
    places = [*np.moveaxis(frames(chain, postures.T)[:, : chain.n], 1, 0), tip(chain, postures.T)]
    result = []
    for i, sphere in enumerate(spheres_of[0]):
        # Its centre in each frame, and how far it moves there from posture to posture.
        local = [
            np.einsum("jin,nj->ni", to_matrix(at[3:]), centres[:, i] - at[:3].T) for at in places
        ]
        spread = [float(np.ptp(row, axis=0).max()) for row in local]
        frame = int(np.argmin(spread))
        if spread[frame] > 1e-4:
            raise invalid("VAMP's sphere", i, "fixed in a frame of the chain")
        centre = local[frame].mean(axis=0)
        result.append((frame, centre, centre, float(sphere.r)))
    return tuple(sorted(result, key=lambda one: one[0]))


class Plan(NamedTuple):
    """What VAMP's RRT-Connect answered.

    Attributes:
        path: from the start to the goal, shape (7, k), or None if none was found.
        seconds: of its own search, by the clock, without what it reserves [s].
        nodes: of both trees.
    """

    path: Array | None
    seconds: float
    nodes: int


class Arm:
    """VAMP's Panda among the obstacles of a world.

    It also checks the arm against itself, which cannot be switched off.

    Args:
        world: of kind "capsule arm"; None for no obstacle. Only its obstacles are taken: spheres,
            capsules and boxes along the axes.

    Raises:
        ImportError: if VAMP is not installed.
        ValueError: for another kind of world or a rotated box.
    """

    def __init__(self, world: World | None = None) -> None:
        self._library = vamp = library()
        self._environment = vamp.Environment()
        if world is None:
            return
        if world.kind != "capsule arm":
            raise invalid("world.kind", world.kind, "'capsule arm'")
        for row in world.obstacles:
            centre, half, radius = row[CENTRE:HALF], row[HALF:RADIUS], float(row[RADIUS])
            if row[KIND] == POINT:
                self._environment.add_sphere(vamp.Sphere(centre.tolist(), radius))
            elif row[KIND] == SEGMENT:
                # By centre and direction: VAMP 0.6.4 crashes on a capsule between two ends.
                length = 2.0 * float(np.linalg.norm(half))
                tilt = math.atan2(math.hypot(half[0], half[1]), half[2])
                turned = [0.0, tilt, math.atan2(half[1], half[0])]
                capsule = vamp.Cylinder(centre.tolist(), turned, radius, length)
                self._environment.add_capsule(capsule)
            elif np.array_equal(row[TURN:], np.eye(3).ravel()):
                box = vamp.Cuboid(centre.tolist(), [0.0, 0.0, 0.0], half.tolist())
                self._environment.add_cuboid(box)
            else:
                raise invalid("world", "a rotated box", "boxes along the axes")

    def state_free(self, q: ArrayLike) -> bool:
        """Return whether a posture, shape (7,), touches neither an obstacle nor itself."""
        q = vector("q", q, (7,))
        return bool(self._library.panda.validate(q.tolist(), self._environment))

    def path(self, *states: ArrayLike) -> Any:
        """Return postures, each (7,), as a path of VAMP, to be made before the clock starts."""
        result = self._library.panda.Path()
        for q in states:
            result.append(vector("state", q, (7,)).astype(np.float32))
        return result

    def path_free(self, path: Any) -> bool:
        """Return whether the edges of a path are free at points with the spacing of the planners.

        The points lie on both halves of an edge and in batches of `LANES`. A path of a single
        posture has no edge and is free: that costs what any call costs.
        """
        return bool(path.validate(self._environment))

    def edge_free(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Return the result of VAMP's `validate_motion` for an edge, whose points are coarse.

        Its spacing is a radian at most, with at least `LANES` points on an edge.
        """
        ends = (vector(name, q, (7,)).tolist() for name, q in (("a", a), ("b", b)))
        return bool(self._library.panda.validate_motion(*ends, self._environment, False))

    def planner(self, skipped: int = 0, step: float = RANGE) -> tuple[Any, Any]:
        """Return settings and samples for `plan`, to be made before the clock starts.

        Args:
            skipped: how many of Halton's points are left out; it takes the place of a seed.
            step: longest edge [rad].
        """
        settings = self._library.RRTCSettings()
        settings.range = positive("step", step, unit="rad")
        settings.max_samples = settings.max_iterations = SAMPLES
        samples = self._library.panda.halton()
        samples.skip(count("skipped", skipped, 0))
        return settings, samples

    def plan(self, start: ArrayLike, goal: ArrayLike, planner: tuple[Any, Any]) -> Plan:
        """Return a plan of RRT-Connect from start to goal, each (7,), not shortened."""
        settings, samples = planner
        ends = (vector(name, q, (7,)).tolist() for name, q in (("start", start), ("goal", goal)))
        result = self._library.panda.rrtc(*ends, self._environment, settings, samples)
        path = np.array(result.path.numpy(), dtype=float).T if result.solved else None
        return Plan(path, 1e-9 * result.nanoseconds, sum(result.size))
