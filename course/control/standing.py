"""Standing on an incline: the quadratic program that shares a planar biped's weight among contacts.

Legs and feet have no mass. Each of two legs has a hip, a knee and an ankle, and touches the ground
at heel and toe. The program is solved as a least distance problem (Lawson and Hanson, Solving Least
Squares Problems, 1974, chapter 23), whose residual vanishes exactly if no forces are allowed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from course.check import finite, invalid, positive

Array = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2
INFEASIBLE = 1e-6  # squared residual of the least distance problem below which there are no forces


class Biped(NamedTuple):
    """A planar biped at rest on an incline, x horizontal and y up.

    Attributes:
        mass: [kg].
        mu: coefficient of friction.
        slope: of the ground [rad]; it rises along x.
        com: centre of mass (2,) [m].
        joints: hip, knee and ankle of each leg, (2, 3, 2) [m].
        contacts: heel and toe of each leg, (2, 2, 2) [m].
        limit: largest torque of a joint [N m].
        weight: of the contact forces in the cost.
    """

    mass: float
    mu: float
    slope: float
    com: Array
    joints: Array
    contacts: Array
    limit: float
    weight: float


class Program(NamedTuple):
    """The quadratic program of a biped in forces over m g: tangents and normals, shape (8,).

    Attributes:
        root: the cost is |root x|^2, (14, 8).
        E, e: equations E x = e of the balance, (3, 8) and (3,).
        G, h: inequalities G x <= h of friction and torque limits, (20, 8) and (20,).
        torques: joint torques over m g times 1 m, (6, 8).
    """

    root: Array
    E: Array
    e: Array
    G: Array
    h: Array
    torques: Array


class Standing(NamedTuple):
    """How a biped stands.

    Attributes:
        forces: (tangent, normal) on each leg's heel and toe, (2, 2, 2) [N].
        torques: of each leg's hip, knee and ankle, (2, 3) [N m].
        feasible: whether forces exist; otherwise both are zero.
    """

    forces: Array
    torques: Array
    feasible: bool


def biped(
    slope: float,
    mu: float,
    *,
    lean: float = 0.0,
    stance: float = 0.15,
    limit: float = 1e4,
    weight: float = 0.2,
    mass: float = 50.0,
) -> Biped:
    """Return a biped whose feet stand astride on an incline.

    Args:
        slope: of the ground [rad], below a right angle.
        mu: coefficient of friction.
        lean: horizontal distance of the centre of mass from the middle of the feet [m].
        stance: half of the distance between the feet along the ground [m].
        limit: largest torque of a joint [N m].
        weight: of the contact forces in the cost.
        mass: [kg].

    Raises:
        ValueError: for a negative friction or a slope that is too steep.
    """
    finite("mu", mu, 0.0)
    positive("limit", limit)
    positive("weight", weight)
    positive("mass", mass)
    if not abs(slope) < 0.5 * math.pi:
        raise invalid("slope", slope, "an angle below pi / 2")
    along, across = _axes(slope)
    feet = np.array([-stance, stance])[:, None] * along
    contacts = feet[:, None] + np.array([-0.08, 0.08])[:, None] * along
    ankles = feet - 0.04 * along + 0.07 * across
    com = np.array([lean, 0.9])
    hips = np.tile(com - [0.0, 0.1], (2, 1))
    knees = 0.5 * (hips + ankles) + [0.06, 0.0]
    joints = np.stack((hips, knees, ankles), axis=1)
    return Biped(mass, mu, slope, com, joints, contacts, limit, weight)


def _axes(slope: float) -> tuple[Array, Array]:
    """Return tangent and normal of the ground, (2,) each."""
    c, s = math.cos(slope), math.sin(slope)
    return np.array([c, s]), np.array([-s, c])


def _moments(levers: Array, axes: Array) -> Array:
    """Return the moment of a unit force along each axis, (..., 2) [m]."""
    return np.asarray(levers[..., :1] * axes[:, 1] - levers[..., 1:] * axes[:, 0])


def program(standing: Biped) -> Program:
    """Return the program: cost, balance, friction cones and torque limits."""
    axes = np.array(_axes(standing.slope))
    contacts = standing.contacts.reshape(4, 2)
    # Balance: the forces carry the weight, and have no moment about the centre of mass.
    E = np.vstack((np.tile(axes.T, 4), _moments(contacts - standing.com, axes).ravel()))
    e = np.array([0.0, 1.0, 0.0])
    # A joint carries the moment of its leg's contact forces about it.
    torques = np.zeros((2, 3, 2, 2, 2))
    for leg in range(2):
        levers = standing.contacts[leg][None] - standing.joints[leg][:, None]
        torques[leg, :, leg] = _moments(levers, axes)
    T = torques.reshape(6, 8)
    bound = standing.limit / (standing.mass * GRAVITY)
    cones = np.kron(np.eye(4), [[1.0, -standing.mu], [-1.0, -standing.mu]])
    root = np.vstack((T / bound, math.sqrt(standing.weight) * np.eye(8)))
    h = np.concatenate((np.zeros(8), np.full(12, bound)))
    return Program(root, E, e, np.asarray(np.vstack((cones, T, -T)), dtype=float), h, T)


def stand(standing: Biped) -> Standing:
    """Return the forces and torques of least cost, or that there are none.

    The cost is the sum of squares of the torques over their limit, plus the weight times the sum of
    squares of the forces over m g.
    """
    from scipy.optimize import nnls

    p = program(standing)
    # x = x0 + Z y meets the equations. With u = R y + Q^T root x0 the cost is |u|^2, up to a
    # constant.
    x0 = np.linalg.pinv(p.E) @ p.e
    Z = np.linalg.svd(p.E)[2][3:].T
    Q, R = np.linalg.qr(p.root @ Z)
    centre = Q.T @ (p.root @ x0)
    A = np.linalg.solve(R.T, (p.G @ Z).T).T
    b = p.h - p.G @ x0 + A @ centre
    # Least |u| with A u <= b, by nonnegative least squares; rows of length 1 have equal scales.
    size = np.linalg.norm(A, axis=1)
    stacked = np.vstack((-A.T / size, -b / size))
    target = np.append(np.zeros(5), 1.0)
    r = stacked @ nnls(stacked, target)[0] - target
    # At the minimum the last component is minus the squared length.
    if -r[5] < INFEASIBLE:
        return Standing(np.zeros((2, 2, 2)), np.zeros((2, 3)), False)
    u = -r[:5] / r[5]
    x = (x0 + Z @ np.linalg.solve(R, u - centre)) * standing.mass * GRAVITY
    return Standing(x.reshape(2, 2, 2), (p.torques @ x).reshape(2, 3), True)


def steepest(mu: float, **changed: float) -> float:
    """Return the steepest slope on which the biped of `biped` stands, by bisection [rad]."""
    low, high = 0.0, 0.49 * math.pi
    for _ in range(30):
        middle = 0.5 * (low + high)
        feasible = stand(biped(middle, mu, **changed)).feasible
        low, high = (middle, high) if feasible else (low, middle)
    return low
