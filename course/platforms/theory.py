"""Closed forms of what the steppers do to a scene, to be drawn over what is measured."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from course.check import count, finite, one_of, positive
from course.contact.soft import Softness
from course.platforms.contract import Array
from course.platforms.scenes import GRAVITY

CONES = ("circle", "inscribed", "box")


def braking_distance(
    speed: float = 2.0, friction: float = 0.5, dt: float = 0.0, gravity: float = GRAVITY
) -> float:
    """Return how far a block slides that is sent off along an axis [m].

    A step takes mu g dt from the speed and then moves with what is left, so the places are a sum of
    the speeds after each step: the true distance v^2 / (2 mu g), less v dt / 2, where the steps end
    with the motion. The stop in the middle of a step adds less than mu g dt^2 / 8.

    Args:
        speed: at the start [m/s].
        friction: Coulomb coefficient.
        gravity: [m/s^2].
        dt: step [s]; 0 for the true distance.
    """
    positive("speed", speed, unit="m/s")
    loss = positive("friction", friction) * positive("gravity", gravity, unit="m/s^2")
    if not finite("dt", dt, 0.0, unit="s"):
        return speed**2 / (2.0 * loss)
    # Whole steps with a positive speed left; the arithmetic series of their speeds.
    n = math.floor(speed / (loss * dt))
    return dt * (n * speed - loss * dt * n * (n + 1) / 2)


def stopped_short(
    speed: float = 2.0, friction: float = 0.5, dt: float = 1e-3, gravity: float = GRAVITY
) -> float:
    """Return the share mu g dt / v of the way that is missing: v dt / 2 of v^2 / (2 mu g)."""
    return friction * gravity * dt / positive("speed", speed, unit="m/s")


def stop(
    heading: Any,
    cone: str = "circle",
    speed: float = 2.0,
    friction: float = 0.5,
    gravity: float = GRAVITY,
) -> tuple[Array, Array]:
    """Return where a block that slides on level ground comes to rest.

    It depends on the cross-section of its friction cone.

    Friction is the force of its section that takes out most power. With D = v^2 / (2 mu g):

    - "circle": against the velocity, so D along the heading.
    - "box", |f_x| and |f_y| both up to mu N: each axis brakes by itself. It stops at
      D (cos^2, sin^2) with the signs of the heading, and steers to the nearer axis.
    - "inscribed", |f_x| + |f_y| up to mu N: all friction goes against the larger component of the
      velocity until both are equal, then each gets half. For a heading from 0 to 45 degrees the
      first phase takes v (cos - sin) / (mu g); the sum of both is (D, D sin 2 heading), and it
      steers to the nearer diagonal.

    Args:
        heading: angles from the x axis, which is an axis of the section [rad], any shape.
        cone: one of `CONES`.
        speed: at the start [m/s].
        friction: Coulomb coefficient.
        gravity: [m/s^2].

    Returns:
        Distance from the start [m] and direction of the place of rest less the heading [rad], each
        of the shape of `heading`.
    """
    one_of("cone", cone, CONES)
    full = braking_distance(speed, friction, gravity=gravity)
    angle = np.asarray(heading, dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    x, y = full * c, full * s
    if cone == "box":
        x, y = x * np.abs(c), y * np.abs(s)
    elif cone == "inscribed":
        # By symmetry only the larger and the smaller component of the heading matter.
        large, small = np.maximum(np.abs(c), np.abs(s)), np.minimum(np.abs(c), np.abs(s))
        near, far = full, full * 2.0 * large * small
        x = np.copysign(np.where(np.abs(c) >= np.abs(s), near, far), c)
        y = np.copysign(np.where(np.abs(c) >= np.abs(s), far, near), s)
    deviation = np.arctan2(y, x) - angle
    return np.hypot(x, y), np.asarray((deviation + math.pi) % (2.0 * math.pi) - math.pi)


def grasp_threshold(mass: float = 0.2, friction: float = 0.5, gravity: float = GRAVITY) -> float:
    """Return the least force of each of two fingers that holds a part: m g / (2 mu) [N]."""
    return positive("mass", mass, unit="kg") * gravity / (2.0 * positive("friction", friction))


def creep_speed(
    load: float, gap: float, inverse_mass: float, friction: float, dt: float, **softness: Any
) -> float:
    """Return how fast a contact of MuJoCo slides that should stick: R_t f_t / b [m/s].

    Friction rows have no stiffness. A steady slip v asks for the force f_t = b v / R_t, since the
    acceleration is 0 and the reference acceleration -b v. R_t is the compliance of a friction row,
    (1 - d) / d times the inverse mass over `impratio`; b is 2 / (d_max time constant). Two opposite
    edges of a pyramid come to the same law, with 1 + mu^2 times the compliance, as long as both are
    loaded; and it holds for no contact that slips in earnest (Todorov 2014).

    Args:
        load: tangential force of one contact [N].
        gap: of the contact at rest, negative [m].
        inverse_mass: of both bodies together, as MuJoCo takes it [1/kg].
        friction: coefficient.
        dt: step [s].
        **softness: fields of chapter 2's `Softness`: cone, impratio, solref, solimp.
    """
    soft = Softness(**softness)
    # Impedance at the depth at which the contact rests.
    d = float(soft.impedance(np.array([finite("gap", gap, unit="m")]))[0])
    b = soft.stiffness(soft.solref, positive("dt", dt, unit="s"))[1]
    weight = inverse_mass * (1.0 + friction**2 if soft.cone == "pyramidal" else 1.0)
    return load * (1.0 - d) / d * weight / (soft.impratio * b)


def sag_growth(n: int, compliance: str = "springs") -> float:
    """Return how much deeper a tower of n equal cubes sinks at its top than one cube.

    The contact below cube i carries n - i of them. Equal "springs" sink in proportion to the load:
    n (n + 1) / 2. MuJoCo's compliance goes with the "inverse mass" of both bodies, twice as much
    between two cubes as on the ground: n + 2 (1 + ... + n - 1) = n^2.
    """
    one_of("compliance", compliance, ("springs", "inverse mass"))
    count("n", n, 1)
    return 0.5 * n * (n + 1) if compliance == "springs" else float(n * n)
