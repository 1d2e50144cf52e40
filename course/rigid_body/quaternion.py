"""Rotations as unit quaternions.

A quaternion is (w, x, y, z), scalar first, under Hamilton's product, as in MuJoCo. It turns body
vectors into world vectors: x_world = q x_body q*. Both q and -q are the same rotation.

The components lie along axis 0: one quaternion has the shape (4,), a batch of N has (4, N); a
vector has (3,) or (3, N). Every function takes either, and where it takes two arrays one of them
may be single and the other a batch. All but the two checks are plain NumPy when Python calls
them, and are compiled into whatever compiled function calls them.

There is one place for checks: `unit_quaternion` and `rotation_matrix`. Call them where values
come in from outside. The other functions are the inside of hot loops, so they check nothing; a
NaN that goes in comes out.

Source for the formulas: Sola, Quaternion kinematics for the error-state Kalman filter (2017),
unless a function names another one.
"""

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from numba.extending import register_jitable

from course.check import invalid, vector

__all__ = [
    "angle_between",
    "conjugate",
    "cross",
    "derivative",
    "dexp_inverse",
    "euler_zyx_rate_matrix",
    "exp",
    "from_euler_zyx",
    "from_matrix",
    "identity",
    "log",
    "normalise",
    "product",
    "rotate",
    "rotation_matrix",
    "to_euler_zyx",
    "to_matrix",
    "unit_quaternion",
]

Array = npt.NDArray[np.float64]

# Added to a squared length before its root, so that sin(a) / a and the like never divide zero by
# zero. It vanishes in rounding as soon as the length exceeds 1e-142.
_TINY = 1e-300

# Closer than this to a pitch of +-90 degrees the rotation no longer says what is yaw and what is
# roll: the difference drowns in the rounding of the quaternion.
_EULER_LOCK = 1e-14

# How far from unit length (or from orthonormal) a value from outside may be.
_UNIT_TOLERANCE = 1e-6


def unit_quaternion(values: Any, name: str = "quaternion") -> Array:
    """Check that values from outside are unit quaternions.

    Args:
        values: anything NumPy makes an array of, of shape (4,) or (4, N), scalar first.
        name: what the error message calls them, usually the caller's argument.

    Returns:
        A new C-ordered float64 array with the same values; they are not renormalised.

    Raises:
        ValueError: wrong shape, not numbers, not finite, or a length more than 1e-6 from 1.
    """
    q = np.array(vector(name, values, (4,), (4, None)), order="C")
    length = np.atleast_1d(np.sqrt(np.sum(q * q, axis=0)))
    wrong = np.flatnonzero(np.abs(length - 1.0) > _UNIT_TOLERANCE)
    if wrong.size:
        i = wrong[0]
        column = f"[:, {i}]" if q.ndim == 2 else ""
        raise invalid(
            f"{name}{column}",
            q.reshape(4, -1)[:, i],
            f"a length of 1 within {_UNIT_TOLERANCE:g} (here {length[i]:.9g}): normalise it",
        )
    return q


def rotation_matrix(values: Any, name: str = "matrix") -> Array:
    """Check that values from outside are rotation matrices.

    Args:
        values: anything NumPy makes an array of, of shape (3, 3) or (3, 3, N).
        name: what the error message calls them, usually the caller's argument.

    Returns:
        A new C-ordered float64 array with the same values.

    Raises:
        ValueError: wrong shape, not numbers, not finite, columns that are not orthonormal
            within 1e-6, or a reflection (determinant -1).
    """
    R = np.array(vector(name, values, (3, 3), (3, 3, None)), order="C")
    stack = np.moveaxis(R.reshape(3, 3, -1), 2, 0)
    # The Gram matrix of the columns minus the identity: how far they are from orthonormal.
    error = np.abs(np.swapaxes(stack, 1, 2) @ stack - np.eye(3)).reshape(-1, 9).max(axis=1)
    determinant = np.linalg.det(stack)
    wrong = np.flatnonzero((error > _UNIT_TOLERANCE) | (determinant < 0.0))
    if wrong.size:
        i = wrong[0]
        index = f"[:, :, {i}]" if R.ndim == 3 else ""
        raise invalid(
            f"{name}{index}",
            stack[i],
            f"columns that are orthonormal within {_UNIT_TOLERANCE:g} (here {error[i]:.3g}) and a "
            f"determinant of 1 (here {determinant[i]:.9g})",
        )
    return R


@register_jitable
def _batch(a, b):
    """Return the trailing shape of a result of `a` and `b`, one of which may be single."""
    if a.ndim >= b.ndim:
        return a.shape[1:]
    else:
        return b.shape[1:]


@register_jitable
def _sign(w, x, y, z):
    """Return 1 or -1: the sign of the first component that is not zero (0 if all are)."""
    # The weights are powers of two, so a component outweighs all the later ones together.
    return np.sign(8.0 * np.sign(w) + 4.0 * np.sign(x) + 2.0 * np.sign(y) + np.sign(z))


@register_jitable
def identity() -> Array:
    """Return the rotation that turns nothing: (1, 0, 0, 0), shape (4,)."""
    return np.array([1.0, 0.0, 0.0, 0.0])


@register_jitable
def cross(a: Array, b: Array) -> Array:
    """Return the cross product a x b along axis 0.

    Args:
        a: vectors, shape (3,) or (3, N).
        b: vectors, shape (3,) or (3, N).

    Returns:
        a x b, shape (3,) or (3, N).
    """
    result = np.empty((3,) + _batch(a, b))
    result[0] = a[1] * b[2] - a[2] * b[1]
    result[1] = a[2] * b[0] - a[0] * b[2]
    result[2] = a[0] * b[1] - a[1] * b[0]
    return result


@register_jitable
def product(p: Array, q: Array) -> Array:
    """Return Hamilton's product p q: the rotation q, followed by p.

    Args:
        p: quaternions, shape (4,) or (4, N), of any length.
        q: quaternions, shape (4,) or (4, N), of any length.

    Returns:
        p q, shape (4,) or (4, N). Its length is the product of the two lengths.
    """
    result = np.empty((4,) + _batch(p, q))
    # Hamilton's product written out; the cross product of the vector parts makes it
    # non-commutative.
    result[0] = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    result[1] = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    result[2] = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    result[3] = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    return result


@register_jitable
def conjugate(q: Array) -> Array:
    """Return the conjugate (w, -x, -y, -z); of a unit quaternion, the inverse rotation.

    Args:
        q: quaternions, shape (4,) or (4, N).

    Returns:
        Same shape as q.
    """
    result = -q
    result[0] = q[0]
    return result


@register_jitable
def rotate(q: Array, v: Array) -> Array:
    """Turn vectors from the body frame into the world frame: q v q*.

    Args:
        q: unit quaternions, shape (4,) or (4, N).
        v: vectors in the body frame, shape (3,) or (3, N), any unit.

    Returns:
        The same vectors in the world frame, shape (3,) or (3, N). `rotate(conjugate(q), v)`
        goes back.
    """
    # v + w t + u x t with t = 2 u x v, u the vector part: 18 products, where the two quaternion
    # products would take 32.
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    result = np.empty((3,) + _batch(q, v))
    result[0] = v[0] + q[0] * tx + (q[2] * tz - q[3] * ty)
    result[1] = v[1] + q[0] * ty + (q[3] * tx - q[1] * tz)
    result[2] = v[2] + q[0] * tz + (q[1] * ty - q[2] * tx)
    return result


@register_jitable
def normalise(q: Array) -> Array:
    """Return q scaled to unit length.

    Args:
        q: quaternions, shape (4,) or (4, N), of lengths between 1e-140 and 1e150.

    Returns:
        Same shape as q. A zero quaternion has no direction and stays zero.
    """
    return q / np.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3] + _TINY)


# Largest component of a rotation vector [rad] for which nine terms of the series are enough.
_SERIES_BELOW = 1.0


# Taylor coefficients of sin(x) / x and of cos(x) in x^2, from the second one on.
_S = tuple((-1.0) ** k / math.factorial(2 * k + 1) for k in range(1, 9))
_C = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(1, 10))


@register_jitable
def _sine_series(s):
    """Return sin(x) / x for s = x^2 up to 0.75: Taylor's terms to s^8 leave less than 1e-17."""
    # One expression: compiled, it is one pass over a batch with nothing stored in between.
    s1, s2, s3, s4, s5, s6, s7, s8 = _S
    return 1.0 + s * (s1 + s * (s2 + s * (s3 + s * (s4 + s * (s5 + s * (s6 + s * (s7 + s * s8)))))))


@register_jitable
def _cosine_series(s):
    """Return cos(x) for s = x^2 up to 0.75: Taylor's terms to s^9 leave less than 1e-17."""
    c1, c2, c3, c4, c5, c6, c7, c8, c9 = _C
    tail = c5 + s * (c6 + s * (c7 + s * (c8 + s * c9)))
    return 1.0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * tail))))


@register_jitable
def exp(rotvec: Array) -> Array:
    """Return the rotation about the axis of `rotvec` by its length.

    Every component is within 1e-15 of the exact one for angles up to 2 pi. In a batch one large
    angle sends all of them through the library's sine and cosine, so the last bit of a result
    may depend on its neighbours.

    Args:
        rotvec: rotation vectors [rad], shape (3,) or (3, N); zero is allowed.

    Returns:
        Unit quaternions, shape (4,) or (4, N).
    """
    result = np.empty((4,) + rotvec.shape[1:])
    square = 0.25 * (rotvec[0] * rotvec[0] + rotvec[1] * rotvec[1] + rotvec[2] * rotvec[2])
    if np.all(np.abs(rotvec) < _SERIES_BELOW):
        # A step of an integrator: both series end below rounding, and in a batch they run
        # through the processor's vector units, which the library's sine and cosine do not.
        scale = 0.5 * _sine_series(square)
        result[0] = _cosine_series(square)
    else:
        # The tiny summand makes the scale 1 / 2 at zero, where it would be 0 / 0.
        half = np.sqrt(square + _TINY)
        scale = 0.5 * np.sin(half) / half
        result[0] = np.cos(half)
    result[1] = scale * rotvec[0]
    result[2] = scale * rotvec[1]
    result[3] = scale * rotvec[2]
    return result


@register_jitable
def log(q: Array) -> Array:
    """Return the shortest rotation vector of q: the inverse of `exp`.

    The error is within 1e-14 of the angle at every angle, because the angle is taken with atan2
    from both the sine and the cosine (acos(w) would lose half the digits near 0).
    q and -q give the same vector. At half a turn the axis has two directions; the one whose first
    component that is not zero is positive is returned.

    Args:
        q: quaternions, shape (4,) or (4, N); a length away from 1 does no harm, zero gives zero.

    Returns:
        Rotation vectors [rad] of length at most pi, shape (3,) or (3, N).
    """
    sine = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3] + _TINY)
    # The sign takes q or -q, whichever is the shorter rotation.
    scale = _sign(q[0], q[1], q[2], q[3]) * 2.0 * np.arctan2(sine, np.abs(q[0])) / sine
    result = np.empty((3,) + q.shape[1:])
    result[0] = scale * q[1]
    result[1] = scale * q[2]
    result[2] = scale * q[3]
    return result


@register_jitable
def angle_between(p: Array, q: Array) -> Any:
    """Return the angle of the rotation that takes p to q.

    Tiny angles keep their digits: the vector part of p* q is taken from p* (q - p), where the
    difference of two near quaternions is exact.

    Args:
        p: unit quaternions, shape (4,) or (4, N).
        q: unit quaternions, shape (4,) or (4, N).

    Returns:
        Angles in [0, pi] [rad], a number or of shape (N,).
    """
    cosine = p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]
    # Subtract q and p first: the difference of two near quaternions is exact.
    sign = np.sign(cosine)
    w = q[0] - sign * p[0]
    x = q[1] - sign * p[1]
    y = q[2] - sign * p[2]
    z = q[3] - sign * p[3]
    sx = p[0] * x - p[1] * w - p[2] * z + p[3] * y
    sy = p[0] * y + p[1] * z - p[2] * w - p[3] * x
    sz = p[0] * z - p[1] * y + p[2] * x - p[3] * w
    # Half the angle from its sine and cosine, so no digits are lost near 0 or near pi.
    return 2.0 * np.arctan2(np.sqrt(sx * sx + sy * sy + sz * sz), np.abs(cosine))


@register_jitable
def to_matrix(q: Array) -> Array:
    """Return the rotation matrix of q; its columns are the body's axes seen from the world.

    Args:
        q: unit quaternions, shape (4,) or (4, N).

    Returns:
        Matrices R with x_world = R x_body, shape (3, 3) or (3, 3, N).
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    R = np.empty((3, 3) + q.shape[1:])
    R[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return R


@register_jitable
def from_matrix(R: Array) -> Array:
    """Return the unit quaternion of a rotation matrix, accurate at every angle.

    The entries of R give the ten products 4 q_i q_j. The row of the largest q_i is scaled to unit
    length, so nothing is ever divided by a small number (Shepperd, Quaternion from rotation
    matrix, 1978).

    Args:
        R: rotation matrices, shape (3, 3) or (3, 3, N).

    Returns:
        Unit quaternions with w >= 0, shape (4,) or (4, N).
    """
    # The products 4 q_i q_j: squares from the diagonal, mixed ones from sums and differences.
    ww = 1.0 + R[0, 0] + R[1, 1] + R[2, 2]
    xx = 1.0 + R[0, 0] - R[1, 1] - R[2, 2]
    yy = 1.0 - R[0, 0] + R[1, 1] - R[2, 2]
    zz = 1.0 - R[0, 0] - R[1, 1] + R[2, 2]
    wx = R[2, 1] - R[1, 2]
    wy = R[0, 2] - R[2, 0]
    wz = R[1, 0] - R[0, 1]
    xy = R[0, 1] + R[1, 0]
    xz = R[0, 2] + R[2, 0]
    yz = R[1, 2] + R[2, 1]
    # Exactly one of a, b, c, d is 1, the others 0: a choice that serves a number and a batch.
    largest = np.maximum(np.maximum(ww, xx), np.maximum(yy, zz))
    a = 1.0 * (ww >= largest)
    b = (1.0 - a) * (xx >= largest)
    c = (1.0 - a - b) * (yy >= largest)
    d = 1.0 - a - b - c
    # The row of the largest component: q times a number that is far from zero.
    w = a * ww + b * wx + c * wy + d * wz
    x = a * wx + b * xx + c * xy + d * xz
    y = a * wy + b * xy + c * yy + d * yz
    z = a * wz + b * xz + c * yz + d * zz
    scale = _sign(w, x, y, z) / np.sqrt(w * w + x * x + y * y + z * z)
    result = np.empty((4,) + R.shape[2:])
    result[0] = scale * w
    result[1] = scale * x
    result[2] = scale * y
    result[3] = scale * z
    return result


@register_jitable
def from_euler_zyx(yaw: Any, pitch: Any, roll: Any) -> Array:
    """Turn by yaw about z, then pitch about the new y, then roll about the newest x.

    Args:
        yaw: angle about z [rad], a number or shape (N,).
        pitch: angle about the turned y [rad], a number or shape (N,).
        roll: angle about the twice turned x [rad], a number or shape (N,).

    Returns:
        Unit quaternions, shape (4,) or (4, N).
    """
    cz, sz = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    cy, sy = np.cos(0.5 * pitch), np.sin(0.5 * pitch)
    cx, sx = np.cos(0.5 * roll), np.sin(0.5 * roll)
    result = np.empty((4,) + np.asarray(yaw + pitch + roll).shape)
    # The product of the three half-angle quaternions about z, y and x, written out.
    result[0] = cz * cy * cx + sz * sy * sx
    result[1] = cz * cy * sx - sz * sy * cx
    result[2] = cz * sy * cx + sz * cy * sx
    result[3] = sz * cy * cx - cz * sy * sx
    return result


@register_jitable
def to_euler_zyx(q: Array) -> Array:
    """Return yaw, pitch and roll of q: the inverse of `from_euler_zyx`.

    At a pitch of +-90 degrees (within 2e-14 rad) only yaw - roll, or yaw + roll, is defined.
    There roll is 0 by convention and yaw takes it all; nothing is NaN, and the angles still
    describe the rotation. Pitch keeps full accuracy there, which asin would not (Bernardes and
    Viollet, Quaternion to Euler angles conversion, 2022).

    Args:
        q: unit quaternions, shape (4,) or (4, N); q and -q give the same angles.

    Returns:
        (yaw, pitch, roll) [rad], shape (3,) or (3, N); yaw and roll in [-pi, pi], pitch in
        [-pi/2, pi/2].
    """
    sign = _sign(q[0], q[1], q[2], q[3])
    w, x, y, z = sign * q[0], sign * q[1], sign * q[2], sign * q[3]
    # w + y and z - x are r cos and r sin of (yaw - roll) / 2; w - y and z + x those of the sum.
    # r is sqrt(2) times the sine, or cosine, of pitch / 2 + 45 degrees.
    difference = np.arctan2(z - x, w + y)
    total = np.arctan2(z + x, w - y)
    rising = np.hypot(w + y, z - x)
    falling = np.hypot(w - y, z + x)
    # Gimbal lock: one of the two pairs is too short to have a direction.
    up = 1.0 * (falling < _EULER_LOCK)
    down = 1.0 * (rising < _EULER_LOCK)
    # Without a lock yaw is the sum and roll the difference of the two half angles.
    yaw = (1.0 + down - up) * total + (1.0 + up - down) * difference
    roll = (1.0 - up - down) * (total - difference)
    turn = 2.0 * np.pi
    result = np.empty((3,) + q.shape[1:])
    result[0] = yaw - turn * np.rint(yaw / turn)
    result[1] = 2.0 * np.arctan2(rising, falling) - 0.5 * np.pi
    result[2] = roll - turn * np.rint(roll / turn)
    return result


@register_jitable
def euler_zyx_rate_matrix(pitch: Any, roll: Any) -> Array:
    """Return the matrix E with angular velocity = E (yaw rate, pitch rate, roll rate).

    det E = -cos(pitch), and the smallest singular value is sqrt(1 - |sin(pitch)|). At a pitch of
    +-90 degrees the rank is 2: yaw and roll turn about the same axis, so a turn about the third
    axis would need an infinite rate (gimbal lock).

    Args:
        pitch: [rad], a number or shape (N,).
        roll: [rad], a number or shape (N,).

    Returns:
        E, shape (3, 3) or (3, 3, N); the angular velocity is in the body frame.
    """
    # The columns are the axes of the three rates, seen from the body.
    E = np.zeros((3, 3) + np.asarray(pitch + roll).shape)
    E[0, 0] = -np.sin(pitch)
    E[0, 2] = 1.0
    E[1, 0] = np.cos(pitch) * np.sin(roll)
    E[1, 1] = np.cos(roll)
    E[2, 0] = np.cos(pitch) * np.cos(roll)
    E[2, 1] = -np.sin(roll)
    return E


@register_jitable
def derivative(q: Array, omega: Array) -> Array:
    """Return dq/dt of a body that turns with the angular velocity omega: q (0, omega) / 2.

    Args:
        q: quaternions, shape (4,) or (4, N).
        omega: angular velocity in the body frame [rad/s], shape (3,) or (3, N).

    Returns:
        Rates of the four components [1/s], shape (4,) or (4, N); perpendicular to q.
    """
    result = np.empty((4,) + _batch(q, omega))
    result[0] = 0.5 * (-q[1] * omega[0] - q[2] * omega[1] - q[3] * omega[2])
    result[1] = 0.5 * (q[0] * omega[0] + q[2] * omega[2] - q[3] * omega[1])
    result[2] = 0.5 * (q[0] * omega[1] + q[3] * omega[0] - q[1] * omega[2])
    result[3] = 0.5 * (q[0] * omega[2] + q[1] * omega[1] - q[2] * omega[0])
    return result


@register_jitable
def dexp_inverse(u: Array, w: Array) -> Array:
    """Return the rate of u that makes q exp(u) turn with the body angular velocity w.

    It is w + u x w / 2 + c u x (u x w), with c = (1 - (a / 2) cot(a / 2)) / a^2 and a = |u|
    (Iserles, Munthe-Kaas, Norsett and Zanna, Lie-group methods, 2000; the sign of the second
    term is that of body-frame updates). c is 1/12 at zero; it is taken from Lambert's continued
    fraction of the cotangent, which subtracts nothing where a is small and needs no branch.

    Args:
        u: rotation vectors [rad], shape (3,) or (3, N), shorter than 2 pi (a full turn, where
            the map ends; there c is infinite).
        w: angular velocity in the body frame, shape (3,) or (3, N), any unit.

    Returns:
        Rates of u in the unit of w, shape (3,) or (3, N).
    """
    s = 0.25 * (u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    # 1 - x cot x = x^2 / (3 - x^2 / (5 - x^2 / (7 - ...))); cut at 29, the rest is below rounding.
    fraction = 27.0 - s / 29.0
    for k in range(12):
        fraction = (25.0 - 2.0 * k) - s / fraction
    # With x = a / 2 and a^2 = 4 s: c = (1 - x cot x) / a^2 = (s / fraction) / (4 s).
    c = 0.25 / fraction
    first = cross(u, w)
    return w + 0.5 * first + c * cross(u, first)
