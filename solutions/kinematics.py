"""Worked answers of the graded exercises of chapter 4: kinematics and dynamics of arms.

Every function stands alone, so that it can be read, copied and explained by itself; closed forms,
Pinocchio and MuJoCo judge them in the tests. A Jacobian has the linear rows first, then the angular
ones, in world axes. Quaternions are scalar first, (w, x, y, z).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def two_link_ik(lengths: Array, target: Array) -> Array:
    """Return both pairs of joint angles that bring the tip of a planar two-link arm to a target.

    The half-angle form of the law of cosines: tan^2(q2 / 2) = (L^2 - r^2) / (r^2 - D^2) with L the
    sum of the lengths and D their difference. Unlike acos it keeps its digits near q2 = 0 and pi.

    Args:
        lengths: of both links, shape (2,) [m], positive.
        target: of the tip, shape (2,) [m].

    Returns:
        Rows (q1, q2), shape (2, 2) [rad]: q2 from 0 to pi, then from -pi to 0. Both rows are the
        same arm on the edges of what can be reached.

    Raises:
        ValueError: when the target misses the annulus D <= r <= L by more than 1e-9 m.
    """
    first, second = (float(length) for length in lengths)
    x, y = (float(value) for value in target)
    r, inner, outer = math.hypot(x, y), abs(first - second), first + second
    if not inner - 1e-9 <= r <= outer + 1e-9:
        raise ValueError(f"target must be from {inner} to {outer} m from the base, got {r} m")
    to_outer = max((outer - r) * (outer + r), 0.0)
    to_inner = max((r - inner) * (r + inner), 0.0)
    bend = 2.0 * math.atan2(math.sqrt(to_outer), math.sqrt(to_inner))
    rows = []
    for q2 in (bend, -bend):
        # Seen from the base, the tip lies this far to the left of the first link.
        aside = math.atan2(second * math.sin(q2), first + second * math.cos(q2))
        rows.append([math.atan2(y, x) - aside, q2])
    return np.array(rows)


def geometric_jacobian(placements: Array, q: Array, tool: Array) -> Array:
    """Return velocity and angular velocity of a tool point for each joint rate of an arm in space.

    A joint that turns about the axis z through p gives a point at x the velocity z cross (x - p)
    and the last link the angular velocity z (Siciliano et al. 2009, Robotics, sec. 3.1.3).

    Args:
        placements: of each joint in the frame of the joint before it (of the first one in the
            world) while its own angle is zero, homogeneous, shape (n, 4, 4) [1, m].
        q: joint angles about each frame's own z, shape (n,) [rad].
        tool: the point, in the frame of the last joint, shape (3,) [m].

    Returns:
        The Jacobian in world axes, shape (6, n): three linear rows [m/rad], three angular ones [1].
    """
    frame = np.eye(4)
    axes, points = [], []
    for placement, angle in zip(placements, q, strict=True):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        frame = frame @ placement @ turn
        axes.append(frame[:3, 2])
        points.append(frame[:3, 3])
    tip = frame[:3, 3] + frame[:3, :3] @ tool
    linear = np.cross(axes, tip - np.array(points))
    return np.vstack((linear.T, np.array(axes).T))


def damped_step(J: Array, error: Array, damping: float) -> Array:
    """Return one step of damped least squares (Wampler 1986; Nakamura and Hanafusa 1986).

    Each singular value s answers with the gain s / (s^2 + damping^2), which is at most
    1 / (2 damping), at s = damping. By singular values it keeps its digits where
    J J^T + damping^2 I has lost the damping to rounding.

    Args:
        J: Jacobian, shape (m, n) [m/rad].
        error: what the tip has yet to move, shape (m,) [m].
        damping: positive [m/rad].

    Returns:
        The step dq, shape (n,) [rad], never longer than |error| / (2 damping).
    """
    U, s, Vt = np.linalg.svd(np.asarray(J, dtype=float), full_matrices=False)
    gain = s / (s**2 + damping**2)
    return Vt.T @ (gain * (U.T @ np.asarray(error, dtype=float)))


def null_space_step(J: Array, dx: Array, secondary: Array, weights: Array) -> Array:
    """Return the step that moves the tip by dx and, for the rest, follows a second wish.

    With the weighted pseudo-inverse A = W^-1 J^T (J W^-1 J^T)^-1 it is A dx + (I - A J) secondary:
    of all steps with J dq = dx the one nearest to `secondary`, where the square of joint i counts
    `weights[i]` times (Liégeois 1977; Whitney 1969). I - A J is symmetric for equal weights only.

    Args:
        J: Jacobian of full row rank, shape (m, n) with m <= n [m/rad].
        dx: of the tip, shape (m,) [m].
        secondary: what the joints would like to do, shape (n,) [rad].
        weights: of the joints, shape (n,), positive.

    Returns:
        The step, shape (n,) [rad].
    """
    J, secondary = np.asarray(J, dtype=float), np.asarray(secondary, dtype=float)
    # In units in which all joints weigh the same, it is the plain pseudo-inverse.
    scale = np.sqrt(np.asarray(weights, dtype=float))
    inverse = np.linalg.pinv(J / scale) / scale[:, None]
    return secondary + inverse @ (dx - J @ secondary)


def rnea_planar(
    lengths: Array, masses: Array, q: Array, v: Array, a: Array, gravity: float
) -> Array:
    """Return joint torques of a planar arm of uniform rods.

    By the recursive Newton-Euler algorithm.

    Outward the motion of each link, inward its forces (Luh, Walker and Paul 1980). A base that
    accelerates upwards at g feels the same as one at rest under gravity.

    Args:
        lengths: of the links, shape (n,) [m].
        masses: of the links, shape (n,) [kg]; each a thin uniform rod.
        q: joint angles, each relative to the link before, shape (n,) [rad].
        v: their rates, shape (n,) [rad/s].
        a: their accelerations, shape (n,) [rad/s^2].
        gravity: downwards, along -y [m/s^2].

    Returns:
        Torques at the joints, shape (n,) [N m].
    """
    angle, rate, turning = np.cumsum(q), np.cumsum(v), np.cumsum(a)
    along = np.column_stack((np.cos(angle), np.sin(angle)))
    across = np.column_stack((-np.sin(angle), np.cos(angle)))
    joint = np.array([0.0, gravity])  # acceleration of the joint, gravity included
    forces, levers = [], []
    for i, length in enumerate(lengths):
        lever = length * (turning[i] * across[i] - rate[i] ** 2 * along[i])
        forces.append(masses[i] * (joint + 0.5 * lever))
        levers.append(length * along[i])
        joint = joint + lever
    torques = np.zeros(len(lengths))
    force, moment = np.zeros(2), 0.0  # what link i hands on to the links beyond it
    for i in reversed(range(len(lengths))):
        x, y = levers[i]
        spin = masses[i] * lengths[i] ** 2 / 12.0 * turning[i]
        moment += spin + 0.5 * (x * forces[i][1] - y * forces[i][0]) + x * force[1] - y * force[0]
        force = force + forces[i]
        torques[i] = moment
    return torques


def wrist_ik(q: Array, target: Array, damping: float, steps: int) -> Array:
    """Return joint angles that turn a wrist of three joints to a target orientation, the short way.

    Damped steps along the rotation that is left. q and -q are one orientation: of the two
    rotations that lead there the one with w >= 0 is at most half a turn.

    Args:
        q: joint angles at the start, about z, then y, then x, shape (3,) [rad].
        target: orientation of the hand, unit quaternion (w, x, y, z) of either sign, shape (4,).
        damping: of the steps, positive [1].
        steps: how many.

    Returns:
        The angles after all steps, shape (3,) [rad].
    """

    def product(p, r):
        (w, x, y, z), (a, b, c, d) = p, r
        return np.array(
            [
                w * a - x * b - y * c - z * d,
                w * b + x * a + y * d - z * c,
                w * c - x * d + y * a + z * b,
                w * d + x * c - y * b + z * a,
            ]
        )

    def about(axis, angle):
        turn = [math.cos(angle / 2), 0.0, 0.0, 0.0]
        turn[1 + axis] = math.sin(angle / 2)
        return turn

    q = np.array(q, dtype=float)
    for _ in range(steps):
        hand = product(about(2, q[0]), product(about(1, q[1]), about(0, q[2])))
        left = product(target, hand * [1.0, -1.0, -1.0, -1.0])
        error = 2.0 * math.copysign(1.0, left[0]) * left[1:]
        c, s = math.cos(q[0]), math.sin(q[0])
        J = np.array(
            [
                [0.0, -s, c * math.cos(q[1])],
                [0.0, c, s * math.cos(q[1])],
                [1.0, 0.0, -math.sin(q[1])],
            ]
        )
        q = q + 0.3 * J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(3), error)
    return q
