"""Where an arm is and how its tip moves: frames, Jacobians, and how near they are to singular.

q is (n,) for one posture, (n, N) for a batch of N columns: a square (n, n) array counts as n
postures, so transpose an array that has one posture in each row. A pose is (x, y, z, qw, qx, qy,
qz); a twist is the velocity of a point [m/s] over the angular velocity [rad/s], both in world axes.
Joints lie along axis 1, the batch comes last: a Jacobian is (6, n) or (6, n, N). The compiled loops
take batches; a single posture is a batch of one.

Source: Siciliano, Sciavicco, Villani and Oriolo, Robotics (2009), ch. 2-3.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, positive, vector
from course.compiled import compiled
from course.kinematics.chain import LOWER, PARENT, PLACE, QUAT, SLIDES, UPPER, Chain
from course.rigid_body.quaternion import to_euler_zyx

Array = NDArray[np.float64]
CUBE = types.Array(numba.float64, 3, "C")
# What is only read may be read-only; a signature that says so takes both.
ROW, ROWS = (types.Array(numba.float64, ndim, "C", readonly=True) for ndim in (1, 2))


# --- vectors of three numbers, kept in registers --------------------------------------------------


@register_jitable
def cross3(a, b):
    """Return a x b of two triples."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@register_jitable
def add3(a, b):
    """Return a + b of two triples."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@register_jitable
def scaled(a, b, factor):
    """Return a + factor b of two triples."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@register_jitable
def three(array, i, c):
    """Return the three numbers of row i from column c on."""
    return array[i, c], array[i, c + 1], array[i, c + 2]


@register_jitable
def four(array, i, c):
    """Return the four numbers of row i from column c on: of a pose, from 3 on, its quaternion."""
    return array[i, c], array[i, c + 1], array[i, c + 2], array[i, c + 3]


@register_jitable
def product4(p, r):
    """Return the product of two quaternions, as `quaternion.product`."""
    w, x, y, z = p
    a, b, c, d = r
    return (
        w * a - x * b - y * c - z * d,
        w * b + x * a + y * d - z * c,
        w * c - x * d + y * a + z * b,
        w * d + x * c - y * b + z * a,
    )


@register_jitable
def turned(quat, v):
    """Return a triple turned by a unit quaternion, as `quaternion.rotate`."""
    axis = quat[1], quat[2], quat[3]
    # v + 2 w (u x v) + 2 u x (u x v), u the vector part.
    t = cross3(axis, v)
    return scaled(scaled(v, t, 2.0 * quat[0]), cross3(axis, t), 2.0)


# --- compiled -------------------------------------------------------------------------------------


@register_jitable
def axis_of(pose, i):
    """Return the z axis of frame i in the world, a triple."""
    w, x, y, z = four(pose, i, 3)
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


@register_jitable
def point_of(pose, i, point):
    """Return a point given in frame i, in the world, a triple."""
    turn = turned(four(pose, i, 3), (point[0], point[1], point[2]))
    return add3(three(pose, i, 0), turn)


@register_jitable
def place(table, q, k, pose):
    """Write the world poses of all joints and, in the last row, of the tool into `pose` (n + 1, 7).

    Column k of q. A joint's turn is its half angle about z, so quaternions compose in 24 products.
    """
    n = table.shape[0] - 1
    for i in range(n + 1):
        parent = int(table[i, PARENT])
        spot, turn = three(table, i, PLACE), four(table, i, QUAT)
        if parent >= 0:
            spot, turn = point_of(pose, parent, spot), product4(four(pose, parent, 3), turn)
        if i < n and table[i, SLIDES] != 0.0:
            # A slide shifts its frame along its own z axis.
            spot = add3(spot, turned(turn, (0.0, 0.0, q[i, k])))
        # A half-angle quaternion about z, multiplied from the right.
        elif i < n:
            cosine, sine = np.cos(0.5 * q[i, k]), np.sin(0.5 * q[i, k])
            a, b, c, d = turn
            turn = (
                a * cosine - d * sine,
                b * cosine + c * sine,
                c * cosine - b * sine,
                d * cosine + a * sine,
            )
        # Written once the joint has moved: the children read this pose.
        pose[i, 0], pose[i, 1], pose[i, 2] = spot
        pose[i, 3], pose[i, 4], pose[i, 5], pose[i, 6] = turn


@register_jitable
def columns(table, pose, frame, tip, J, k):
    """Write the Jacobian of the point `tip`, fixed to `frame`, into J[:, :, k], zero before."""
    # The tool moves with its parent, the last joint; from there the path leads to the base.
    i = int(table[frame, PARENT]) if frame == table.shape[0] - 1 else frame
    while i >= 0:
        # A column is z x (tip - origin) over z for a turning joint, z over 0 for a sliding one.
        z = axis_of(pose, i)
        if table[i, SLIDES] != 0.0:
            J[0, i, k], J[1, i, k], J[2, i, k] = z
        else:
            J[0, i, k], J[1, i, k], J[2, i, k] = cross3(z, scaled(tip, three(pose, i, 0), -1.0))
            J[3, i, k], J[4, i, k], J[5, i, k] = z
        i = int(table[i, PARENT])


def _poses(table, q):
    """Return poses of all joints and of the tool, (7, n + 1, N)."""
    n, batch = q.shape
    pose, result = np.empty((n + 1, 7)), np.empty((7, n + 1, batch))
    for k in range(batch):
        place(table, q, k, pose)
        for i in range(n + 1):
            for c in range(7):
                result[c, i, k] = pose[i, c]
    return result


def _jacobian(table, q, frame, point):
    """Return Jacobians of a point of a frame, (6, n, N)."""
    n, batch = q.shape
    pose, J = np.empty((n + 1, 7)), np.zeros((6, n, batch))
    for k in range(batch):
        place(table, q, k, pose)
        columns(table, pose, frame, point_of(pose, frame, point), J, k)
    return J


def _jacobian_rate(table, q, v, frame, point):
    """Return the time derivatives of these Jacobians, (6, n, N)."""
    n, batch = q.shape
    pose, rate = np.empty((n + 1, 7)), np.zeros((6, n, batch))
    spin, speed = np.empty((n, 3)), np.empty((n, 3))  # of each link, and of its joint's origin
    last = n - 1 if frame == n else frame
    for k in range(batch):
        place(table, q, k, pose)
        # Outwards: angular velocity of each link, and velocity of its joint's origin.
        for i in range(n):
            parent, z = int(table[i, PARENT]), axis_of(pose, i)
            w, u = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
            if parent >= 0:
                w = three(spin, parent, 0)
                u = _velocity(pose, spin, speed, parent, three(pose, i, 0))
            if table[i, SLIDES] != 0.0:
                u = scaled(u, z, v[i, k])
            else:
                w = scaled(w, z, v[i, k])
            spin[i, 0], spin[i, 1], spin[i, 2] = w
            speed[i, 0], speed[i, 1], speed[i, 2] = u
        i, tip = last, point_of(pose, frame, point)
        # Velocity of the point itself, fixed to the last link of the path.
        flown = _velocity(pose, spin, speed, last, tip)
        # Product rule on each column: the axis turns with its link, the arm changes with both ends.
        while i >= 0:
            z = axis_of(pose, i)
            turning = cross3(three(spin, i, 0), z)
            if table[i, SLIDES] != 0.0:
                rate[0, i, k], rate[1, i, k], rate[2, i, k] = turning
            else:
                arm = scaled(tip, three(pose, i, 0), -1.0)
                past = scaled(flown, three(speed, i, 0), -1.0)
                swing = add3(cross3(turning, arm), cross3(z, past))
                rate[0, i, k], rate[1, i, k], rate[2, i, k] = swing
                rate[3, i, k], rate[4, i, k], rate[5, i, k] = turning
            i = int(table[i, PARENT])
    return rate


@register_jitable
def _velocity(pose, spin, speed, i, point):
    """Return the velocity of a point of the world that link i carries along, a triple."""
    arm = scaled(point, three(pose, i, 0), -1.0)
    return add3(three(speed, i, 0), cross3(three(spin, i, 0), arm))


@functools.cache
def kernels() -> tuple[Any, Any, Any]:
    """Return the compiled functions: poses, Jacobian, its rate."""
    return (
        compiled(_poses, CUBE(ROWS, ROWS)),
        compiled(_jacobian, CUBE(ROWS, ROWS, numba.int64, ROW)),
        compiled(_jacobian_rate, CUBE(ROWS, ROWS, ROWS, numba.int64, ROW)),
    )


# --- the doors ------------------------------------------------------------------------------------


def batch(chain: Chain, **states: Any) -> tuple[bool, list[Array]]:
    """Return whether the states of an arm are single, and all of them as checked batches (n, N).

    The states come by name, each of shape (n,) or (n, N), all of one shape.
    """
    n, result, first = len(chain.table) - 1, [], None
    for name, value in states.items():
        # With few postures at a time the checks take most of the time. If the sum of squares is
        # finite, so are the numbers, and it is faster than a look at each.
        quick = type(value) is np.ndarray and value.dtype == np.float64 and value.ndim in (1, 2)
        if not (quick and len(value) == n and math.isfinite(np.vdot(value, value))):
            value = vector(name, value, (n,), (n, None))
        if first is not None and value.shape != first:
            raise invalid(f"{name}.shape", value.shape, f"that of {next(iter(states))}, {first}")
        first = value.shape
        result.append(np.ascontiguousarray(value).reshape(n, -1))
    return first is not None and len(first) == 1, result


def _spot(chain: Chain, point: ArrayLike | None, joint: int | None) -> tuple[int, Array]:
    frame = chain.n if joint is None else count("joint", joint, 0, chain.n - 1)
    return frame, np.zeros(3) if point is None else np.ascontiguousarray(
        vector("point", point, (3,), unit="m")
    )


def frames(chain: Chain, q: ArrayLike) -> Array:
    """Return world poses of the joints' frames, which are those of the links, (7, n) or (7, n, N).

    Raises:
        ValueError: for a q of another shape than (n,) or (n, N) [rad or m], or that is not finite.
    """
    single, (q,) = batch(chain, q=q)
    result = kernels()[0](chain.table, q)[:, :-1]
    return result[:, :, 0] if single else result


def tip(chain: Chain, q: ArrayLike) -> Array:
    """Return world pose of the tool, shape (7,) or (7, N); arguments and errors as for `frames`."""
    single, (q,) = batch(chain, q=q)
    result = kernels()[0](chain.table, q)[:, -1]
    return result[:, 0] if single else result


def jacobian(
    chain: Chain, q: ArrayLike, point: ArrayLike | None = None, *, joint: int | None = None
) -> Array:
    """Return the geometric Jacobian, (6, n) or (6, n, N): the twist of a point is J v.

    Args:
        chain: the arm.
        q: its joint positions, shape (n,) or (n, N) [rad or m].
        point: given in the frame that it is fixed to, shape (3,) [m]; default: its origin.
        joint: whose link it is fixed to; default: the tool. Joints that do not move it have zeros.

    Raises:
        ValueError: for another shape, a joint that is not there, or numbers that are not finite.
    """
    single, (q,) = batch(chain, q=q)
    result = kernels()[1](chain.table, q, *_spot(chain, point, joint))
    return result[:, :, 0] if single else result


def jacobian_rate(
    chain: Chain,
    q: ArrayLike,
    v: ArrayLike,
    point: ArrayLike | None = None,
    *,
    joint: int | None = None,
) -> Array:
    """Return dJ/dt at rates v, as for `jacobian`: the point's acceleration is J a + (dJ/dt) v."""
    single, (q, v) = batch(chain, q=q, v=v)
    result = kernels()[2](chain.table, q, v, *_spot(chain, point, joint))
    return result[:, :, 0] if single else result


def analytic_jacobian(chain: Chain, q: ArrayLike) -> Array:
    """Return the Jacobian of the tip's position and its yaw, pitch and roll (z, y, x).

    Its shape is (6, n) or (6, n, N).

    At a pitch of +-90 degrees they grow without bound: the angles lock there, not the arm.
    """
    single, (q,) = batch(chain, q=q)
    J, pose = kernels()[1](chain.table, q, chain.n, np.zeros(3)), tip(chain, q)
    yaw, pitch, _ = to_euler_zyx(pose[3:])[:, None]
    x, y, z = J[3:].copy()
    # Angular velocity is yaw rate times z, pitch rate times the turned y, roll rate times the axis.
    ahead = np.cos(yaw) * x + np.sin(yaw) * y
    with np.errstate(divide="ignore", invalid="ignore"):
        # Without bound at gimbal lock, where cos(pitch) is 0.
        roll_rate = ahead / np.cos(pitch)
    J[3] = z + np.sin(pitch) * roll_rate
    J[4] = np.cos(yaw) * y - np.sin(yaw) * x
    J[5] = roll_rate
    return J[:, :, 0] if single else J


def singular_values(J: ArrayLike) -> Array:
    """Return the singular values of a matrix (m, n) or a batch (m, n, N), largest first.

    The shape is (min(m, n),) or (min(m, n), N).
    """
    J = vector("J", J, (None, None), (None, None, None))
    return np.asarray(np.linalg.svd(J.T, compute_uv=False).T, dtype=float)


def manipulability(J: ArrayLike) -> Any:
    """Return the product of the singular values (Yoshikawa, 1985): 0 at a singularity.

    J has the rows of the task, (m, n) or (m, n, N): J[:2] for a planar arm. It is
    sqrt(det(J J^T)) for m <= n, and sqrt(det(J^T J)) for more rows than joints.
    """
    return np.prod(singular_values(J), axis=0)[()]


def condition_number(J: ArrayLike, length: float) -> Any:
    """Return the largest over smallest singular value of a whole Jacobian, (6, n) or (6, n, N).

    It is infinite at a singularity: where the smallest is no more than the rounding of the largest.

    Metres and radians have no common scale: without the length [m] by which the rows of velocity
    are divided it has no meaning. In millimetres (0.001) the same arm has another one.
    """
    J = np.array(vector("J", J, (6, None), (6, None, None)))
    # Velocities over the length have the unit of rates, as the rows below have.
    J[:3] /= positive("length", length, unit="m")
    s = singular_values(J)
    with np.errstate(divide="ignore", invalid="ignore"):
        # The rank threshold of `numpy.linalg.matrix_rank`.
        present = s[-1] > max(J.shape[:2]) * np.finfo(float).eps * s[0]
        return np.where(present, s[0] / s[-1], np.inf)[()]


def null_space(J: ArrayLike) -> Array:
    """Return the projector I - J^+ J onto the joint rates that leave the task still.

    Singular values below 1e-10 of the largest count as zero: at a singularity the null space has
    grown by the direction that the tip has lost. From the task's rows, (m, n) or (m, n, N), comes
    a symmetric matrix that is its own square, (n, n) or (n, n, N).
    """
    J = vector("J", J, (None, None), (None, None, None))
    single = J.ndim == 2
    stack = np.moveaxis(J.reshape(*J.shape[:2], -1), 2, 0)
    # Projector from the right singular vectors with a singular value that counts.
    _, s, Vt = np.linalg.svd(stack, full_matrices=False)
    selected = Vt * (s > 1e-10 * np.maximum(s[:, :1], 1e-300))[:, :, None]
    result = np.eye(J.shape[1]) - selected.transpose(0, 2, 1) @ selected
    return result[0] if single else np.moveaxis(result, 0, 2)


def within(chain: Chain, q: ArrayLike) -> Any:
    """Return whether a posture keeps the limits, a bool or shape (N,)."""
    single, (q,) = batch(chain, q=q)
    low, high = chain.table[:-1, LOWER, None], chain.table[:-1, UPPER, None]
    result = np.all((low <= q) & (q <= high), axis=0)
    return bool(result[0]) if single else result
