"""MuJoCo asked about bodies that turn freely: the torque-free tumble and the heavy top."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from course.check import POSITIVE, invalid, positive, vector
from course.oracles.mujoco.kit import (
    GRAVITY,
    BatchRunner,
    Runner,
    inertial,
    principal_moments,
    scene_xml,
)


def free_body(
    inertia: ArrayLike,
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
    *,
    mass: float = 1.0,
    gravity: float = 0.0,
) -> Runner:
    """Return a free rigid body; without gravity, the torque-free tumble.

    Seven positions make a free joint. Four (a quaternion alone) make a ball joint through the
    centre of mass: the same tumble with half the state, but MuJoCo treats it differently:
    implicitfast and discrete take the gyroscopic torque implicitly for free joints only.

    Args:
        inertia: the three principal moments in the body frame [kg m^2].
        q0: (x, y, z, qw, qx, qy, qz), scalar first, or (qw, qx, qy, qz).
        v0: linear velocity in the world, angular velocity in the body [m/s, rad/s]; the angular
            velocity alone with four positions.
        dt: step [s].
        integrator: one of `MUJOCO_INTEGRATORS`.
        mass: [kg].
        gravity: downwards along z [m/s^2].

    Returns:
        A prepared `Runner`.
    """
    moments = principal_moments("inertia", inertia)
    joint = '<joint type="ball"/>' if np.size(q0) == 4 else "<freejoint/>"
    body = f"<body>{joint}{inertial(mass, 0.0, moments)}</body>"
    return Runner(scene_xml(body, dt, integrator, gravity), q0, v0, integrator)


def heavy_top(
    inertia: Sequence[float],
    weight: float,
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
) -> Runner:
    """Return a symmetric top on a ball joint at the origin, its centre of mass on its own z axis.

    The motion depends on the moments about the pivot and on the product m g l alone, so mass and
    distance are chosen here such that the moments about the centre of mass are a body's.

    Args:
        inertia: (I1 = I2, I3) about the **pivot** [kg m^2].
        weight: m g l, mass times gravity times distance to the centre of mass [N m].
        q0: unit quaternion (w, x, y, z), body to world.
        v0: angular velocity in the body frame [rad/s].
        dt: step [s].
        integrator: one of `MUJOCO_INTEGRATORS`.

    Returns:
        A prepared `Runner`; q is the quaternion, v the angular velocity in the body.
    """
    i1, i3 = vector("inertia", inertia, (2,), low=POSITIVE, unit="kg m^2").tolist()
    positive("weight", weight, unit="N m")
    if i1 <= 0.5 * i3:
        raise invalid("inertia", (i1, i3), "I1 above I3 / 2")
    shift = 0.5 * (i1 - 0.5 * i3)  # m l^2, half of the most that parallel axes allow
    mass = (weight / GRAVITY) ** 2 / shift
    distance = shift * GRAVITY / weight
    central = np.array([i1 - shift, i1 - shift, i3])
    body = f'<body><joint type="ball"/>{inertial(mass, distance, central)}</body>'
    return Runner(scene_xml(body, dt, integrator, GRAVITY), q0, v0, integrator)


def batch_free_bodies(
    inertia: ArrayLike,
    q0: ArrayLike,
    v0: ArrayLike,
    dt: float,
    integrator: str,
    *,
    threads: int = 1,
    gravity: float = 0.0,
) -> BatchRunner:
    """Return N free bodies in `mujoco.batch`.

    It is `free_body` with q0 (7, N), v0 (6, N), and one inertia for all.

    `threads` counts the caller's own; 0 takes one a core.
    """
    q, v = np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)
    one = free_body(inertia, q[:, 0], v[:, 0], dt, integrator, gravity=gravity)
    return BatchRunner(one, q, v, threads)
