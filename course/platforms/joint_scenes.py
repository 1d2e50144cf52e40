"""Two scenes of joints that a model file describes in one line each: a limit, and a mimic joint.

URDF says where a joint ends and which joint copies which. It does not say how stiff the stop is,
whether the joint bounces, or how exact the copy is: each engine has its own answer.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np

from course import kinematics
from course.check import finite, positive
from course.platforms.scenes import GRAVITY, Scene, linked
from course.platforms.state import Array
from course.rigid_body import problems
from course.rigid_body.integrators import System

DOWN = (0.0, -GRAVITY, 0.0)  # the arms move in the plane of x and y


@dataclass(frozen=True, eq=False)
class Stop:
    """A rod that falls against the lower limit of its joint.

    Attributes:
        scene: the rod, released at rest. Its truth ends where the limit is reached: it is the
            angle of an unlimited rod before, and the limit after (a stop without a bounce).
        limit: [rad].
        speed: of the joint when it reaches the limit, by the conservation of energy [rad/s].
    """

    scene: Scene
    limit: float
    speed: float


def stop(start: float = 0.0, limit: float = -1.0, length: float = 0.4) -> Stop:
    """Return a uniform rod of 1 kg that falls from an angle to the lower limit of its joint.

    Args:
        start: angle above the horizontal [rad].
        limit: lower limit of the joint, from -pi/2 to below the start [rad].
        length: of the rod [m].

    Raises:
        ValueError: for a limit that the falling rod does not reach.
    """
    finite("start", start, -1.5, 1.5, unit="rad")
    finite("limit", limit, -0.5 * math.pi, start - 1e-3, unit="rad")
    positive("length", length, unit="m")
    rod = kinematics.planar(np.array([length]), np.array([1.0]))
    rod = replace(rod, lower=np.array([limit]), upper=np.array([limit + math.pi]))
    free = linked("stop", rod, [start], 1.0, 1e-3, DOWN)
    fall = _fall(start, limit, length)
    # A rod about its end: m l^2 v^2 / 6 = m g l (sin start - sin limit) / 2.
    speed = math.sqrt(3.0 * GRAVITY * (math.sin(start) - math.sin(limit)) / length)

    def truth(time: float) -> Array:
        return free.truth(time) if time < fall else np.array([limit])

    return Stop(replace(free, truth=truth), limit, speed)


def _fall(start: float, limit: float, length: float) -> float:
    """Return the time of the fall from rest to the limit [s], by quadrature.

    The substitution q = start - u^2 takes the singularity of 1 / speed at the start away.
    """
    nodes, weights = np.polynomial.legendre.leggauss(64)
    top = math.sqrt(start - limit)
    u = 0.5 * top * (nodes + 1.0)
    fallen = 2.0 * np.cos(start - 0.5 * u**2) * np.sin(0.5 * u**2)  # sin start - sin q
    return float(0.5 * top * (weights @ (2.0 * u / np.sqrt(3.0 * GRAVITY * fallen / length))))


def coupled(ratio: float = 2.0, start: float = -0.5, duration: float = 1.0) -> Scene:
    """Return two rods of 0.2 m and 0.5 kg; the second joint copies the first, times a ratio.

    It swings from rest under gravity. The truth is the motion with one degree of freedom, in which
    the copy is exact.

    Args:
        ratio: `multiplier` of the `<mimic>` element.
        start: of the first joint [rad].
        duration: [s].
    """
    finite("ratio", ratio)
    finite("start", start, unit="rad")
    arm = kinematics.planar(np.full(2, 0.2), np.full(2, 0.5))
    both = np.array([1.0, ratio])
    free = linked("coupled", arm, start * both, duration, 1e-3, DOWN)

    def acceleration(q: Array, v: Array, params: Array) -> Array:
        # d'Alembert along the one direction of motion that is left: both . (M a + h) = 0.
        angle, rate = both * q[0], both * v[0]
        mass = both @ kinematics.mass_matrix(arm, angle) @ both
        return np.array([-(both @ kinematics.bias(arm, angle, rate, gravity=DOWN)) / mass])

    system = System(
        "coupled", acceleration, np.zeros(0), np.array([start]), np.zeros(1), compile=False
    )

    @functools.lru_cache(maxsize=64)
    def truth(time: float) -> Array:
        return np.asarray(both * problems.tight_reference(system, time)[0])

    end = free.urdf.rindex("</joint>")
    copy = f'<mimic joint="joint0" multiplier="{ratio:.17g}"/>'
    return replace(free, urdf=free.urdf[:end] + copy + free.urdf[end:], truth=truth)
