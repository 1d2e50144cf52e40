"""Joint velocities for a velocity of the tip, within the limits of the joints.

Differential inverse kinematics chooses, once per control cycle, the joint velocities v that bring
the tip closest to a commanded twist:

    minimise  |J v - twist|^2 + damping^2 |v|^2   subject to   low <= v <= high

Without the bounds that is the damped pseudo-inverse (`damped_velocity`). The bounds hold the
speed limit of each joint, and they slow a joint that approaches a position limit
(`velocity_bounds`). With them it is a quadratic program whose constraints form a box, or bounded
least squares (`bounded_velocity`): a primal active-set method finds its solution (Stark and Parker,
Bounded-variable least squares, 1995). Kanoun, Lamiraux and Wieber (2011) describe the program with
further constraints; the libraries mink and pink solve it for MuJoCo and Pinocchio.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, bounds, finite, invalid, positive, vector
from course.kinematics.chain import Chain

Array = NDArray[np.float64]


class BoundedVelocity(NamedTuple):
    """The solution of the bounded problem.

    Attributes:
        v: joint velocities, shape (n,) [rad/s or m/s].
        active: which joints are at a bound that holds them back, shape (n,).
        solves: how many least-squares problems were solved.
    """

    v: Array
    active: NDArray[np.bool_]
    solves: int


def damped_velocity(J: ArrayLike, twist: ArrayLike, damping: float) -> Array:
    """Return the joint velocities of the damped pseudo-inverse, J^T (J J^T + damping^2 I)^-1 twist.

    Args:
        J: Jacobian, shape (m, n).
        twist: commanded velocity of the tip, shape (m,) [m/s, rad/s].
        damping: positive, in the unit of J.

    Returns:
        The velocities without regard to limits, shape (n,) [rad/s or m/s].
    """
    J = vector("J", J, (None, None))
    twist = vector("twist", twist, (J.shape[0],))
    square = positive("damping", damping) ** 2
    return np.asarray(J.T @ np.linalg.solve(J @ J.T + square * np.eye(J.shape[0]), twist))


def velocity_bounds(
    chain: Chain, q: ArrayLike, fastest: ArrayLike, dt: float, gain: float = 0.95
) -> tuple[Array, Array]:
    """Return the least and the largest velocity that each joint may have during one cycle.

    Args:
        chain: the arm, with its position limits.
        q: its posture, shape (n,) [rad or m].
        fastest: speed limits, a number or shape (n,) [rad/s or m/s].
        dt: length of the cycle [s].
        gain: the share of the distance to a position limit that a joint may cover in one cycle,
            above 0 and at most 1.

    Returns:
        Lower and upper bounds, shape (n,) each. Beyond a position limit they lead the joint back,
        no faster than its speed limit.
    """
    q = vector("q", q, (chain.n,))
    limit = np.broadcast_to(vector("fastest", fastest, (), (chain.n,), low=POSITIVE), (chain.n,))
    rate = finite("gain", gain, POSITIVE, 1.0) / positive("dt", dt, unit="s")
    low, high = rate * (chain.lower - q), rate * (chain.upper - q)
    return np.clip(low, -limit, limit), np.clip(high, -limit, limit)


def bounded_velocity(
    J: ArrayLike, twist: ArrayLike, low: ArrayLike, high: ArrayLike, damping: float
) -> BoundedVelocity:
    """Return the joint velocities within bounds that bring the tip closest to a twist.

    They minimise |J v - twist|^2 + damping^2 |v|^2 for low <= v <= high. The objective is strictly
    convex, so there is one solution.

    Args:
        J: Jacobian, shape (m, n).
        twist: commanded velocity of the tip, shape (m,) [m/s, rad/s].
        low: lower bounds, a number or shape (n,); may be infinite.
        high: upper bounds, likewise.
        damping: positive, in the unit of J.

    Raises:
        ValueError: for bounds that cross, shapes that disagree, NaN.
    """
    J = vector("J", J, (None, None))
    n = J.shape[1]
    least, largest = bounds("low", low, n), bounds("high", high, n)
    if not ((least <= largest) & (least < np.inf) & (largest > -np.inf)).all():
        raise invalid("(low, high)", (low, high), "bounds that do not cross")
    # Rows of damping below J turn the penalty into more equations of the same least squares.
    A = np.vstack([J, positive("damping", damping) * np.eye(n)])
    b = np.concatenate([vector("twist", twist, (J.shape[0],)), np.zeros(n)])
    # Without a bound in the way, the damped pseudo-inverse is the solution.
    unlimited = np.asarray(np.linalg.lstsq(A, b)[0], dtype=float)
    v = np.clip(unlimited, least, largest)
    free = (least < v) & (v < largest)
    if (v == unlimited).all():
        return BoundedVelocity(v, np.full(n, False), 1)
    released = -1
    for solves in range(2, 100 + 10 * n):
        # Minimise over the free joints; the others stay at their bounds.
        goal = v.copy()
        goal[free] = np.linalg.lstsq(A[:, free], b - A[:, ~free] @ v[~free])[0]
        outside = free & ((goal < least) | (goal > largest))
        if outside.any():
            # Move towards that minimum until the first joint meets its bound, and hold it there.
            bound = np.where(goal < least, least, largest)
            share = np.full(n, np.inf)
            share[outside] = (bound - v)[outside] / (goal - v)[outside]
            first = int(np.argmin(share))
            v = np.clip(v + share[first] * (goal - v), least, largest)
            v[first], free[first] = bound[first], False
            # Rounding alone released this joint: its multiplier is zero.
            if first == released and share[first] == 0.0:
                return BoundedVelocity(v, ~free, solves)
            continue
        v = goal
        # A joint at a bound is released if the cost falls when it moves back inside.
        gradient = A.T @ (A @ v - b)
        inwards = np.where(v == least, -gradient, gradient)
        inwards[free | (least == largest)] = 0.0
        released = int(np.argmax(inwards))
        size = np.abs(A).T @ (np.abs(A) @ np.abs(v) + np.abs(b))
        if inwards[released] <= 1e-14 * size[released]:
            return BoundedVelocity(v, ~free, solves)
        free[released] = True
    raise RuntimeError("the active set did not settle; please report J, twist and the bounds")
