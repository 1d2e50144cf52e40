"""An edge of the 7-R arm checked in batches of configurations, for the CPU's vector instructions.

The idea is that of VAMP (Thomason, Kingston and Kavraki, 2024, Motions in microseconds via
vectorized sampling-based planning): 32 configurations that are spread over the whole edge are
checked together, one number of each in one register, so that every instruction does the work of
eight. A collision that is long compared with the spacing of the first batch is noticed there, in
whatever part of the edge. All batches together are points along the edge at a spacing, like those
of `capsules.sampled`: what lies between two points is not checked.

Robot and obstacles are simple, so that there are few branches: the arm is covered by spheres, and
a sphere's distance from a box is a few comparisons. Two thirds of the trigonometry vanish, because
equal steps along an edge turn each joint by the same angle: its cosine and sine follow from those
before by the angle sum. The numbers have single precision, about 1e-6 m here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from course.check import invalid, positive
from course.kinematics.chain import PARENT, PLACE, QUAT, SLIDES, WIDTH
from course.planning.capsules import (
    BOX,
    CENTRE,
    FRAME,
    FROM,
    HALF,
    KIND,
    PAIR,
    RADIUS,
    REACH,
    THICK,
    TO,
    TURN,
    _state,
    capsule_arm,
)
from course.planning.worlds import World

Array = NDArray[np.float64]
LANES = 32  # configurations in a batch: four registers of 256 bits in single precision
# Columns of a sphere's row: how many spheres its group has, centre and radius of a ball around all
# of them (in the place of the reach, which no check of a state reads), and the spacing of points
# along an edge [rad].
AROUND, GROUP, SPACING = REACH, WIDTH - 2, WIDTH - 1


def spheres_over(
    capsules: Sequence[tuple[int, Any, Any, float]], swell: float = 0.1
) -> list[tuple[int, Any, Any, float]]:
    """Return spheres that cover capsules, as capsules whose two ends are one point.

    Between two centres at a distance h, a sphere of radius sqrt(r^2 + h^2 / 4) contains the capsule
    of radius r.

    Args:
        capsules: as `capsule_arm` takes them.
        swell: by which share of r the spheres may be larger; smaller ones are more.
    """
    positive("swell", swell)
    result = []
    # The hand first: it collides most often.
    for frame, a, b, radius in reversed(list(capsules)):
        a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
        length = float(np.linalg.norm(b - a))
        if length == 0.0:
            result.append((frame, a, a, radius))
            continue
        # The largest spacing with which the spheres are no larger than allowed.
        reach = 2.0 * radius * math.sqrt((1.0 + swell) ** 2 - 1.0)
        pieces = math.ceil(length / reach)
        h = length / pieces
        fat = math.sqrt(radius**2 + 0.25 * h**2)
        for k in range(pieces + 1):
            centre = a + (b - a) * k / pieces
            # The two outer spheres reach over the capsule's ends by themselves.
            result.append((frame, centre, centre, fat))
    return result


@register_jitable
def _nearer(row, radius, x, y, z, gap):
    """Lower `gap` to what is left between points x, y, z, one a lane, and an obstacle.

    What is left is the squared distance less that at which a sphere of this radius touches: there
    is no root, and no decision before all obstacles have been asked.
    """
    hx, hy, hz = np.float32(row[HALF]), np.float32(row[HALF + 1]), np.float32(row[HALF + 2])
    cx, cy, cz = np.float32(row[CENTRE]), np.float32(row[CENTRE + 1]), np.float32(row[CENTRE + 2])
    touch, zero = np.float32(row[RADIUS]) + radius, np.float32(0.0)
    touch = touch * touch
    if row[KIND] == BOX and row[TURN] == 1.0 and row[TURN + 4] == 1.0:
        for w in range(LANES):
            # Outside of the box by so much along each axis.
            p = max(abs(x[w] - cx) - hx, zero)
            q = max(abs(y[w] - cy) - hy, zero)
            r = max(abs(z[w] - cz) - hz, zero)
            gap[w] = min(gap[w], p * p + q * q + r * r - touch)
    elif row[KIND] == BOX:
        m = row[TURN : TURN + 9].astype(np.float32)
        for w in range(LANES):
            u, v, s = x[w] - cx, y[w] - cy, z[w] - cz
            p = max(abs(m[0] * u + m[3] * v + m[6] * s) - hx, zero)
            q = max(abs(m[1] * u + m[4] * v + m[7] * s) - hy, zero)
            r = max(abs(m[2] * u + m[5] * v + m[8] * s) - hz, zero)
            gap[w] = min(gap[w], p * p + q * q + r * r - touch)
    else:
        # The line of a capsule from its middle by `half` to both sides; of a sphere a point.
        square, one = hx * hx + hy * hy + hz * hz, np.float32(1.0)
        inverse = one / square if square > zero else zero
        for w in range(LANES):
            u, v, s = x[w] - cx, y[w] - cy, z[w] - cz
            t = min(max((u * hx + v * hy + s * hz) * inverse, -one), one)
            u, v, s = u - t * hx, v - t * hy, s - t * hz
            gap[w] = min(gap[w], u * u + v * v + s * s - touch)


@register_jitable
def _rotation(row, m):
    """Write the fixed rotation of a joint's placement into m (9,), row by row."""
    w, x, y, z = row[QUAT], row[QUAT + 1], row[QUAT + 2], row[QUAT + 3]
    m[0], m[1], m[2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    m[3], m[4], m[5] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    m[6], m[7], m[8] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@register_jitable
def _frames(body, n, cosine, sine, fixed, pose):
    """Write rotation and position of all frames in each lane into pose (n + 1, 12, LANES)."""
    for i in range(n + 1):
        f, out, parent = fixed[i], pose[i], int(body[i, PARENT])
        px, py, pz = f[9], f[10], f[11]
        if parent < 0:
            for k in range(9):
                for w in range(LANES):
                    out[k, w] = f[k]
            for w in range(LANES):
                out[9, w], out[10, w], out[11, w] = px, py, pz
        else:
            base = pose[parent]
            for r in range(3):
                for w in range(LANES):
                    a, b, c = base[3 * r, w], base[3 * r + 1, w], base[3 * r + 2, w]
                    out[3 * r, w] = a * f[0] + b * f[3] + c * f[6]
                    out[3 * r + 1, w] = a * f[1] + b * f[4] + c * f[7]
                    out[3 * r + 2, w] = a * f[2] + b * f[5] + c * f[8]
                    out[9 + r, w] = base[9 + r, w] + a * px + b * py + c * pz
        if i < n:
            # The turn about the joint's own z axis mixes the first two columns.
            for r in range(3):
                for w in range(LANES):
                    a, b, c, s = out[3 * r, w], out[3 * r + 1, w], cosine[i, w], sine[i, w]
                    out[3 * r, w] = a * c + b * s
                    out[3 * r + 1, w] = b * c - a * s


@register_jitable
def _left_over(obstacles, at, u, v, s, radius, work):
    """Return the least that is left between a sphere of the arm and the obstacles, in any lane.

    It is negative or zero where they touch. The sphere has its centre at (u, v, s) in the frame
    whose rotations and positions are `at`, (12, LANES).
    """
    x, y, z, gap = work[0], work[1], work[2], work[3]
    u, v, s, radius = np.float32(u), np.float32(v), np.float32(s), np.float32(radius)
    for w in range(LANES):
        x[w] = at[9, w] + at[0, w] * u + at[1, w] * v + at[2, w] * s
        y[w] = at[10, w] + at[3, w] * u + at[4, w] * v + at[5, w] * s
        z[w] = at[11, w] + at[6, w] * u + at[7, w] * v + at[8, w] * s
        gap[w] = np.float32(np.inf)
    for j in range(obstacles.shape[0]):
        _nearer(obstacles[j], radius, x, y, z, gap)
    least = gap[0]
    for w in range(1, LANES):
        least = min(least, gap[w])
    return least


@register_jitable
def _batch_free(obstacles, body, n, pose, work):
    """Return whether no sphere touches an obstacle in any lane."""
    i = n + 1
    while i < body.shape[0]:
        last = i + int(body[i, GROUP]) - 1
        at, ball = pose[int(body[i, FRAME])], body[i, AROUND : AROUND + 4]
        # One ball around all spheres of the group first: mostly it is free.
        if _left_over(obstacles, at, ball[0], ball[1], ball[2], ball[3], work) <= 0.0:
            for k in range(i, last + 1):
                spot = body[k, FROM:TO]
                if _left_over(obstacles, at, spot[0], spot[1], spot[2], body[k, THICK], work) <= 0:
                    return False
        i = last + 1
    return True


def _raked(obstacles, body, a, b):
    # The number of joints from the rows: spheres come after the tool.
    n = a.size
    length = 0.0
    for i in range(n):
        length += (b[i] - a[i]) ** 2
    batches = max(1, math.ceil(math.sqrt(length) / body[n + 1, SPACING] / LANES))
    cosine, sine = np.empty((n, LANES), np.float32), np.empty((n, LANES), np.float32)
    back = np.empty((n, 2), np.float32)
    fixed, pose = np.empty((n + 1, 12), np.float32), np.empty((n + 1, 12, LANES), np.float32)
    work = np.empty((4, LANES), np.float32)
    for i in range(n + 1):
        _rotation(body[i], fixed[i])
        fixed[i, 9:12] = body[i, PLACE : PLACE + 3]
    # Lane w has the configurations ((w + 1) batches - j) / (LANES batches) of the edge: the last
    # lane begins at its end. Each batch goes back by one of them.
    for i in range(n):
        change = b[i] - a[i]
        for w in range(LANES):
            angle = a[i] + change * (w + 1) / LANES
            cosine[i, w], sine[i, w] = math.cos(angle), math.sin(angle)
        step = -change / (LANES * batches)
        back[i, 0], back[i, 1] = math.cos(step), math.sin(step)
    for _ in range(batches):
        _frames(body, n, cosine, sine, fixed, pose)
        if not _batch_free(obstacles, body, n, pose, work):
            return False
        for i in range(n):
            c, s = back[i, 0], back[i, 1]
            for w in range(LANES):
                old = cosine[i, w]
                cosine[i, w] = old * c - sine[i, w] * s
                sine[i, w] = sine[i, w] * c + old * s
    return True


def points_of(a: Array, b: Array, spacing: float) -> Array:
    """Return the configurations of an edge that the batches check, shape (n, m), by batches."""
    batches = max(1, math.ceil(float(np.linalg.norm(b - a)) / spacing / LANES))
    shares = [
        ((w + 1) * batches - j) / (LANES * batches) for j in range(batches) for w in range(LANES)
    ]
    return np.asarray(a[:, None] + (b - a)[:, None] * np.array(shares))


def _groups(capsules: Sequence[tuple[int, Any, Any, float]], swell: float) -> list[int]:
    """Return how many of `spheres_over` belong to each group, in their order.

    The spheres of a capsule are a group, and so are spheres on one frame that follow each other.
    """
    result, before = [], -1
    for capsule in reversed(capsules):
        frame, a, b, _ = capsule
        single = np.array_equal(a, b)
        if single and frame == before:
            result[-1] += 1
        else:
            result.append(len(spheres_over([capsule], swell)))
        before = frame if single else -1
    return result


def in_batches(world: World, spacing: float = 0.05, swell: float = 0.1) -> World:
    """Return a world of `capsule_arm` with the arm as spheres and its edges checked in batches.

    Args:
        world: of the arm with the capsules `HAND`, or of other capsules on the same chain.
        spacing: largest distance of two neighbouring points of an edge [rad], all joints together.
        swell: see `spheres_over`.

    Raises:
        ValueError: for another kind of world, for one with pairs of capsules (self-collision or a
            held object), or for a chain with a sliding joint.
    """
    if world.kind != "capsule arm":
        raise invalid("world.kind", world.kind, "'capsule arm'")
    n = world.dim
    if np.any(world.body[:n, SLIDES] != 0.0):
        raise invalid("world", "a chain with a sliding joint", "revolute joints only")
    positive("spacing", spacing, unit="rad")
    rows = world.body[n + 1 :]
    if np.any(rows[:, FRAME] == PAIR):
        raise invalid("world", "a world with pairs of capsules", "one without self-collision")
    capsules = [(int(r[FRAME]), r[FROM : FROM + 3], r[FROM + 3 : FROM + 6], r[THICK]) for r in rows]
    body = capsule_arm([], None, spheres_over(capsules, swell)).body
    body[n + 1 :, SPACING] = spacing
    first = n + 1
    for size in _groups(capsules, swell):
        these = body[first : first + size]
        centre = 0.5 * (these[:, FROM:TO].min(axis=0) + these[:, FROM:TO].max(axis=0))
        away = np.linalg.norm(these[:, FROM:TO] - centre, axis=1) + these[:, THICK]
        body[first, AROUND : AROUND + 4] = *centre, away.max()
        body[first, GROUP] = size
        first += size
    return replace(world, body=body, edge_free=_raked)


def _one_by_one(obstacles, body, a, b):
    length = math.sqrt(np.sum((b - a) ** 2))
    pieces = max(1, math.ceil(length / body[a.size + 1, SPACING]))
    # From the end backwards, which is where an edge most often collides.
    for k in range(pieces, 0, -1):
        if not _state(obstacles, body, a + k / pieces * (b - a)):
            return False
    return True


def one_by_one(world: World) -> World:
    """Return a world of `in_batches` that checks the points of an edge one after the other.

    The same spheres at the same spacing, as ordinary code: in double precision, with an end at the
    first collision and bounding balls for what is far away.
    """
    if world.edge_free is not _raked:
        raise invalid("world", world.kind, "a world of `in_batches`")
    return replace(world, edge_free=_one_by_one)


def warm() -> None:
    """Compile, or load from the cache, the edge check in batches."""
    assert in_batches(capsule_arm([])).kernels
