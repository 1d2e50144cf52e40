"""Worked answers of chapter 2, contact: complete, of the size of an interview."""

import math

import numpy as np
from numpy.typing import ArrayLike


def aabb_contact(a: ArrayLike, b: ArrayLike) -> tuple[float, np.ndarray]:
    """Return overlap of two axis-aligned boxes, and the shortest way out of it along an axis.

    Args:
        a: corners of the first box, rows low and high, shape (2, d) [m].
        b: corners of the second box, shape (2, d) [m].

    Returns:
        (depth, push): the length of the shortest move along one axis that parts the boxes [m],
        negative (minus the largest gap along an axis) when they are apart; the move of b itself,
        shape (d,) [m], zero when they are apart.
    """
    (low_a, high_a), (low_b, high_b) = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    up, down = high_a - low_b, high_b - low_a
    overlap = np.minimum(up, down)
    axis = int(np.argmin(overlap))
    depth, push = float(overlap[axis]), np.zeros(overlap.size)
    if depth > 0.0:
        push[axis] = depth if up[axis] < down[axis] else -depth
    return depth, push


def circle_contact(
    centre_a: ArrayLike, radius_a: float, centre_b: ArrayLike, radius_b: float
) -> tuple[float, np.ndarray, np.ndarray]:
    """Return gap, normal and point of contact of two circles, at any distance of their centres.

    Args:
        centre_a: of the first circle, shape (2,) [m].
        radius_a: of the first circle [m].
        centre_b: of the second circle, shape (2,) [m].
        radius_b: of the second circle [m].

    Returns:
        (gap, normal, point): negative when they overlap [m]; the unit vector from a to b, (1, 0)
        where the centres coincide, shape (2,); half way between the two surfaces, (2,) [m].
    """
    p, q = np.asarray(centre_a, dtype=float), np.asarray(centre_b, dtype=float)
    x, y = q - p
    distance = math.hypot(x, y)
    # Scaled before it is divided: two tiny numbers keep their ratio.
    size = max(abs(x), abs(y))
    normal = np.array([1.0, 0.0])
    if size > 0.0:
        normal = np.array([x / size, y / size])
        normal = normal / math.hypot(*normal)
    gap = distance - (radius_a + radius_b)
    point = p + (radius_a + 0.5 * gap) * normal
    return gap, normal, point


def pgs_sweep(impulses: ArrayLike, A: ArrayLike, b: ArrayLike, mu: float) -> np.ndarray:
    """Return the impulses after one sweep of projected Gauss-Seidel with friction cones.

    Args:
        impulses: of each contact: normal, then two tangents, shape (n, 3) [N s].
        A: velocity at the contacts by unit impulses, shape (3 n, 3 n) [1/kg].
        b: velocity at the contacts without impulses, shape (3 n,) [m/s].
        mu: coefficient of friction.

    Returns:
        The impulses after the sweep, shape (n, 3) [N s].
    """
    g, A = np.array(impulses, dtype=float), np.asarray(A, dtype=float)
    for i in range(len(g)):
        rows = slice(3 * i, 3 * i + 3)
        velocity = A[rows] @ g.ravel() + np.asarray(b, dtype=float)[rows]
        step = 1.0 / np.linalg.eigvalsh(A[rows, rows])[-1]
        normal, *tangent = g[i] - step * velocity
        slip = math.hypot(*tangent)
        if slip <= mu * normal:
            g[i] = normal, *tangent
        elif mu * slip <= -normal:
            g[i] = 0.0
        else:
            on_cone = (normal + mu * slip) / (1.0 + mu * mu)
            g[i] = on_cone, *(mu * on_cone / slip * np.array(tangent))
    return g


def impact_time(
    place: ArrayLike, velocity: ArrayLike, other: ArrayLike, other_velocity: ArrayLike, reach: float
) -> float:
    """Return when two balls in straight flight touch for the first time.

    Args:
        place: of the first ball's centre, shape (d,) [m].
        velocity: of the first ball, shape (d,) [m/s].
        other: of the second ball's centre, shape (d,) [m].
        other_velocity: of the second ball, shape (d,) [m/s].
        reach: both radii together [m].

    Returns:
        The time [s]; 0 when they overlap now, -1 when they never touch.
    """
    d = np.asarray(other, dtype=float) - np.asarray(place, dtype=float)
    v = np.asarray(other_velocity, dtype=float) - np.asarray(velocity, dtype=float)
    distance = math.sqrt(d @ d)
    c = (distance - reach) * (distance + reach)
    if c <= 0.0:
        return 0.0
    closing, speed = float(-(d @ v)), float(v @ v)
    if closing <= 0.0:
        return -1.0
    # The part of d across v says whether they pass; closing^2 - speed c would cancel.
    across = d + (closing / speed) * v
    root = speed * (reach * reach - float(across @ across))
    if root < 0.0:
        return -1.0
    # The smaller root of speed t^2 - 2 closing t + c = 0.
    return c / (closing + math.sqrt(root))


def contact_step(
    position: ArrayLike, velocity: ArrayLike, slope: float, mu: float, dt: float, steps: int
) -> tuple[np.ndarray, np.ndarray]:
    """Simulate a block on an inclined plane by time stepping with one frictional contact.

    Args:
        position: along the slope downwards, and above the plane, shape (2,) [m].
        velocity: along the same axes, shape (2,) [m/s].
        slope: inclination of the plane [rad].
        mu: coefficient of friction.
        dt: step [s].
        steps: how many.

    Returns:
        (position, velocity) at the end, each shape (2,).
    """
    x, v = np.array(position, dtype=float), np.array(velocity, dtype=float)
    gravity = 9.81 * np.array([math.sin(slope), -math.cos(slope)])
    for _ in range(steps):
        v = v + dt * gravity
        # Impulses per kilogram: the normal one lets the block just touch at the end of the step.
        normal = max(0.0, -(v[1] + x[1] / dt))
        friction = min(max(-v[0], -mu * normal), mu * normal)
        v = v + np.array([friction, normal])
        x = x + dt * v
    return x, v
