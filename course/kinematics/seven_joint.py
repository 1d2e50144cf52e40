"""Inverse kinematics of a 7-R arm in closed form: one joint is chosen, six follow.

The arm has the layout of the Franka Emika Panda: three axes that meet in a shoulder, an elbow with
an offset to both sides, and a wrist in which two axes meet and the third is offset. A pose of the
tip has a curve of solutions. The last joint angle chooses a point of it: then the wrist's centre is
known, the triangle of shoulder, elbow and wrist has three known sides, and the forearm lies on the
intersection of a cone with a plane (Y. He and S. Liu, Analytical inverse kinematics for Franka
Emika Panda, 2021). The swivel angle says where the elbow then is, on its circle about the line from
shoulder to wrist (D. Tolani, A. Goswami and N. Badler, 2000).
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import invalid, vector
from course.compiled import compiled
from course.kinematics.chain import Chain, panda
from course.kinematics.motion import CUBE, ROW, ROWS, cross3, frames, scaled
from course.rigid_body.quaternion import rotate, unit_quaternion

Array = NDArray[np.float64]

# Two signs each: the elbow's bend, the side of the forearm, the shoulder's flip.
BRANCHES = 8


@functools.lru_cache(maxsize=8)  # a chain is constant, and to compare it takes longer than to solve
def _dimensions(chain: Chain) -> tuple[float, float, float, float, float, float]:
    """Return shoulder height, upper arm, elbow offset, forearm, wrist offset, flange [m]."""
    model = panda()
    if chain.n == 7 and not chain.slides.any() and (chain.parent == model.parent).all():
        place = chain.placement
        height, upper, elbow = place[2, 0], -place[1, 2], place[0, 3]
        forearm, wrist, flange = place[1, 4], place[0, 6], chain.tool[2]
        # The arm built from these numbers has to be the arm that was handed in.
        same = np.zeros((3, 7))
        same[2, 0], same[1, 2], same[1, 4] = height, -upper, forearm
        same[0, 3], same[0, 4], same[0, 6] = elbow, -elbow, wrist
        if (
            np.allclose(place[:3], same, rtol=0.0, atol=1e-12)
            and np.allclose(place[3:], model.placement[3:], rtol=0.0, atol=1e-12)
            and np.allclose(chain.tool, [0, 0, flange, 1, 0, 0, 0], rtol=0.0, atol=1e-12)
        ):
            return height, upper, elbow, forearm, wrist, flange
    raise invalid("chain", "another arm", "a 7-R arm with the layout of `panda()`")


# --- compiled -------------------------------------------------------------------------------------


@register_jitable
def _dot3(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@register_jitable
def _angle3(v, x, y):
    """Return the angle of v from the direction x towards y."""
    return math.atan2(_dot3(v, y), _dot3(v, x))


@register_jitable
def _wrapped(angle):
    """Return an angle from -pi on and below pi."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def _closed_form(sizes, place, x7, y7, z7, last):
    """Return all branches for each pose and last angle, (7, 8, N); NaN where there is none.

    Rows of `place`, `x7`, `y7` and `z7` are the flange's origin and axes.
    """
    height, upper, elbow, forearm, wrist, flange = (
        sizes[0],
        sizes[1],
        sizes[2],
        sizes[3],
        sizes[4],
        sizes[5],
    )
    q = np.full((7, 8, len(last)), np.nan)
    # The triangle of shoulder, elbow and wrist in its plane, with the elbow at the origin.
    squares = 2.0 * elbow**2 + upper**2 + forearm**2
    sides = math.sqrt((elbow**2 + upper**2) * (elbow**2 + forearm**2))
    apart = math.atan2(forearm, -elbow) - math.atan2(-upper, -elbow)
    for k in range(len(last)):
        c, s = math.cos(last[k]), math.sin(last[k])
        axis7 = (z7[k, 0], z7[k, 1], z7[k, 2])
        # The last angle turns the wrist offset about the flange's axis: this places the wrist.
        x6 = (
            c * x7[k, 0] - s * y7[k, 0],
            c * x7[k, 1] - s * y7[k, 1],
            c * x7[k, 2] - s * y7[k, 2],
        )
        z6 = cross3(axis7, x6)
        to_shoulder = scaled(
            scaled((-place[k, 0], -place[k, 1], height - place[k, 2]), axis7, flange), x6, wrist
        )
        # The law of cosines gives the elbow's angle, twice.
        cosine = (squares - _dot3(to_shoulder, to_shoulder)) / (2.0 * sides)
        # Axis 5 lies in the plane perpendicular to axis 6: there is the line to the shoulder seen.
        flat = scaled(to_shoulder, z6, -_dot3(to_shoulder, z6))
        length = math.sqrt(_dot3(flat, flat))
        if abs(cosine) > 1.0 or length == 0.0:
            continue
        flat = (flat[0] / length, flat[1] / length, flat[2] / length)
        beside = cross3(z6, flat)
        for bend in range(2):
            q4 = (math.acos(cosine) if bend == 0 else -math.acos(cosine)) - apart
            c4, s4 = math.cos(q4), math.sin(q4)
            # From wrist to shoulder, seen across the forearm (x of link 4) and along it (axis 5).
            across = elbow - c4 * elbow - s4 * upper
            along = s4 * elbow - c4 * upper - forearm
            # The angle of axis 5 with the line to the shoulder is known, which makes a cone. A
            # plane through the tip of a cone meets it in two lines, or in none.
            share = along / length
            if abs(share) > 1.0 or across == 0.0:
                continue
            for side in range(2):
                height5 = math.sqrt(1.0 - share**2) * (1.0 if side == 0 else -1.0)
                z5 = (
                    share * flat[0] + height5 * beside[0],
                    share * flat[1] + height5 * beside[1],
                    share * flat[2] + height5 * beside[2],
                )
                x4 = scaled(to_shoulder, z5, -along)
                x4 = (x4[0] / across, x4[1] / across, x4[2] / across)
                # Back through the elbow to the upper arm, and on to the wrist.
                x3 = scaled((c4 * x4[0], c4 * x4[1], c4 * x4[2]), z5, -s4)
                z3 = scaled((s4 * x4[0], s4 * x4[1], s4 * x4[2]), z5, c4)
                x5 = cross3(z5, z6)
                q5 = _angle3(x5, x4, cross3(z5, x4))
                q6 = _angle3(x6, x5, z5)
                for flip in range(2):
                    # The shoulder is a spherical joint: z3 = (c1 s2, s1 s2, c2), twice.
                    turn = 1.0 if flip == 0 else -1.0
                    q2 = turn * math.atan2(math.hypot(z3[0], z3[1]), z3[2])
                    q1 = math.atan2(turn * z3[1], turn * z3[0])
                    c2 = math.cos(q2)
                    x2 = (math.cos(q1) * c2, math.sin(q1) * c2, -math.sin(q2))
                    q3 = _angle3(x3, x2, cross3(z3, x2))
                    branch = 4 * bend + 2 * side + flip
                    q[0, branch, k], q[1, branch, k], q[2, branch, k] = q1, q2, q3
                    q[3, branch, k], q[4, branch, k] = _wrapped(q4), q5
                    q[5, branch, k], q[6, branch, k] = q6, _wrapped(last[k])
    return q


@functools.cache
def kernel() -> Any:
    """Return the compiled loop."""
    return compiled(_closed_form, CUBE(ROW, ROWS, ROWS, ROWS, ROWS, ROW))


# --- the doors ------------------------------------------------------------------------------------


def closed_form(chain: Chain, target: ArrayLike, last: ArrayLike) -> Array:
    """Return every posture that puts the tip at a pose and has the given last joint angle.

    Joint limits are not looked at; `within` does that. Where the shoulder, the wrist or the elbow
    is singular (the upper arm along the first axis, the shoulder on the line of the forearm), one
    angle is free, and it is not a number here, or zero for the first joint.

    Args:
        chain: an arm with the layout of `panda()`.
        target: pose of the tip, shape (7,) or (7, N).
        last: angle of the last joint, a number or shape (N,) [rad].

    Returns:
        Array: angles in -pi to pi, shape (7, 8) or (7, 8, N) [rad]; NaN in a branch that has no
            solution.

    Raises:
        ValueError: the arm has another layout, or shapes disagree.
    """
    dimensions = _dimensions(chain)
    q7 = vector("last", last, (), (None,), unit="rad")
    pose = vector("target", target, (7,), (7, None))
    unit_quaternion(pose[3:], "target[3:]")
    size = np.broadcast_shapes(pose.shape[1:], q7.shape)
    number = size[0] if size else 1
    pose = np.broadcast_to(pose.reshape(7, -1), (7, number))
    axes = [np.ascontiguousarray(rotate(pose[3:], axis[:, None]).T) for axis in np.eye(3)]
    last_angles = np.ascontiguousarray(np.broadcast_to(q7.reshape(-1), number))
    place = np.ascontiguousarray(pose[:3].T)
    q: Array = kernel()(np.array(dimensions), place, *axes, last_angles)
    return q if size else q[:, :, 0]


def postures_within_limits(chain: Chain, target: ArrayLike, last: ArrayLike) -> Array:
    """Return the closed form's postures for one pose that respect the joint limits.

    Args:
        chain: an arm with the layout of `panda()`.
        target: pose of the tip, shape (7,).
        last: angles of the last joint to try, a number or shape (N,) [rad].

    Returns:
        Array: postures, shape (7, M), in the order of `last`; M is 0 if none is within the limits.
    """
    q = closed_form(chain, vector("target", target, (7,)), np.atleast_1d(last))
    q = np.swapaxes(q, 1, 2).reshape(7, -1)
    low, high = chain.lower[:, None], chain.upper[:, None]
    # A joint may have more than half a turn to one side: the same angle, one turn on, counts too.
    q = np.where((q < low) & (q + 2.0 * np.pi <= high), q + 2.0 * np.pi, q)
    return np.asarray(q[:, ((q >= low) & (q <= high)).all(axis=0)])


def swivel_angle(chain: Chain, q: ArrayLike) -> Array:
    """Return where the elbow is on its circle about the line from shoulder to wrist.

    Zero where the elbow is in the vertical plane of that line and above it, positive towards the
    right-hand turn about the line. It is not defined where the line is vertical.

    Args:
        chain: an arm with the layout of `panda()`.
        q: its posture, shape (7,) or (7, N) [rad].

    Returns:
        Array: the angle, a scalar array or shape (N,) [rad].
    """
    height = _dimensions(chain)[0]
    joints = frames(chain, q)
    shoulder, up = np.zeros((2, *joints[:3, 3].shape))
    shoulder[2], up[2] = height, 1.0
    line = joints[:3, 5] - shoulder
    line = line / np.linalg.norm(line, axis=0)
    elbow = joints[:3, 3] - shoulder
    up = up - np.sum(up * line, axis=0) * line
    right = np.cross(line, up, axis=0)
    return np.asarray(np.arctan2(np.sum(elbow * right, axis=0), np.sum(elbow * up, axis=0)))
