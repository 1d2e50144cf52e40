"""A 7-R arm as capsules among spheres, boxes and capsules in space, and two shelves to reach into.

An edge between two postures is proved free, not sampled. Turn the joints one after the other, the
one at the base first: the joints after it are carried along as a rigid body, so no axis has changed
its distance from the points that it will turn. So however the joints move from q by dq, no point
moves farther than the sum of |dq_k| rho_k, rho_k its distance from axis k at q. A posture that is
free by a gap frees all around it that this bound does not let across the gap; what is left of the
edge is halved, and given up where less than `FLOOR` is free.

Links may pass through each other, unless `course.planning.held` adds pairs of capsules to the rows
of `body`. For a pair the same bound holds, with the joints between its two frames alone: seen from
the frame that carries the one, only they move the other.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import invalid, one_of, vector
from course.compiled import compiled
from course.contact import shapes
from course.contact.shapes import Shape
from course.kinematics import Chain, ik, panda
from course.kinematics.chain import PARENT, PLACE, SLIDES, WIDTH
from course.kinematics.motion import axis_of, cross3, place, point_of, scaled, three
from course.planning.worlds import CLEARANCE, FLOOR, LEAST, World, state_free
from course.rigid_body.quaternion import from_matrix, to_matrix
from course.rigid_body.spatial import poses

Array = NDArray[np.float64]

# Columns of an obstacle: what it is, centre, half sizes of a box or half the line of a capsule,
# radius around it, radius of the ball about all of it, the rotation of a box, row by row.
KIND, CENTRE, HALF, RADIUS, BALL, TURN, COLUMNS = 0, 1, 4, 7, 8, 9, 18
POINT, SEGMENT, BOX = 0.0, 1.0, 2.0
# Columns of a capsule, in the rows of `body` after those of `Chain.table`: the frame that carries
# it, both ends in that frame, its radius, and how far at most it is from the axis of each joint.
FRAME, FROM, TO, THICK, REACH = 0, 1, 4, 7, 8
# Columns of a pair of capsules, in the rows after those: `PAIR` where a capsule has its frame, the
# rows of both, the last joint that moves both alike (-1: none). From `REACH` on as for a capsule,
# of the joints between them only.
PAIR, ONE, OTHER, COMMON = -1.0, 1, 2, 3

# Of the arm of `panda`, with a hand 0.23 m wide and its fingers closed: frame, ends, radius [m].
HAND = (
    (0, (0, 0, -0.19), (0, 0, 0), 0.08),
    (1, (0, 0, 0), (0, -0.316, 0), 0.07),
    (2, (0, 0, 0), (0.0825, 0, 0), 0.07),
    (3, (0, 0, 0), (-0.0825, 0.1, 0), 0.065),
    (3, (-0.0825, 0.1, 0), (-0.0825, 0.384, 0), 0.06),
    (5, (0, 0, 0), (0.088, 0, 0), 0.055),
    (6, (0, 0, 0), (0, 0, 0.107), 0.05),
    (7, (0, -0.075, 0.03), (0, 0.075, 0.03), 0.04),
    (7, (0, 0, 0.07), (0, 0, 0.12), 0.025),
)
FINGERTIP = 0.145  # beyond the flange [m]
SPACING = 0.01  # of the states tried by `sampled` [rad]


# --- distances ------------------------------------------------------------------------------------


@register_jitable
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@register_jitable
def _to_point(p, d, c):
    """Return the distance of the segment from p along d from the point c."""
    e = scaled(c, p, -1.0)
    # Project the point onto the line and clamp; a segment without length is a point.
    length, along = _dot(d, d), _dot(e, d)
    t = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    e = scaled(e, d, -t)
    return math.sqrt(_dot(e, e))


@register_jitable
def _to_segment(p, d, c, e):
    """Return the distance of two segments, p along d and c along e.

    The nearest points lie inside both segments, or one of them is an end (Ericson, Real-Time
    Collision Detection, 2005, sec. 5.1.9).
    """
    w = scaled(p, c, -1.0)
    dd, ee, de, dw, ew = _dot(d, d), _dot(e, e), _dot(d, e), _dot(d, w), _dot(e, w)
    # The lines' closest points, if both lie within the segments (Ericson, Real-Time Collision
    # Detection, 2005, sec. 5.1.9). Otherwise an end of one of the two is nearest.
    area = dd * ee - de * de
    if area > 1e-12 * dd * ee:  # for parallel segments the ends below suffice
        s, t = (de * ew - ee * dw) / area, (dd * ew - de * dw) / area
        if 0.0 <= s <= 1.0 and 0.0 <= t <= 1.0:
            w = scaled(scaled(w, d, s), e, -t)
            return math.sqrt(_dot(w, w))
    at_ends = min(_to_point(p, d, c), _to_point(p, d, scaled(c, e, 1.0)))
    return min(at_ends, min(_to_point(c, e, p), _to_point(c, e, scaled(p, d, 1.0))))


@register_jitable
def _over(x, half):
    """Return how far x is outside of -half to half, with its sign."""
    return x - half if x > half else x + half if x < -half else 0.0


@register_jitable
def _pull(p, d, half, t):
    """Return the squared distance of p + t d from a box, half its slope and half its curvature.

    The slope and the curvature are the first and second derivative with respect to t.
    """
    square, slope, bend = 0.0, 0.0, 0.0
    for i in range(3):
        e = _over(p[i] + t * d[i], half[i])
        if e != 0.0:
            square += e * e
            slope += e * d[i]
            bend += d[i] * d[i]
    return square, slope, bend


@register_jitable
def _to_box(p, d, half):
    """Return the distance of a segment from a box about the origin, 0 where they overlap.

    The squared distance is convex along the segment and its slope is piecewise linear with at most
    seven pieces. Newton's method, safeguarded by bisection, therefore ends at the exact root.
    """
    # The squared distance is convex in t: at an end with an outward slope that end is nearest.
    low, high = 0.0, 1.0
    square, slope, bend = _pull(p, d, half, low)
    if slope >= 0.0:
        return math.sqrt(square)
    square, slope, bend = _pull(p, d, half, high)
    if slope <= 0.0:
        return math.sqrt(square)
    # Newton on the slope, which is piecewise linear, safeguarded by bisection.
    t = 0.5
    for _ in range(60):
        square, slope, bend = _pull(p, d, half, t)
        if slope == 0.0:
            break
        low, high = (low, t) if slope > 0.0 else (t, high)
        last, t = t, t - slope / bend
        if not low < t < high:  # a Newton step that leaves the bracket: bisect instead
            t = 0.5 * (low + high)
        if abs(t - last) < 1e-15:
            break
    return math.sqrt(square)


@register_jitable
def _gap(row, p, d, thick):
    """Return the signed distance of a capsule (a segment p, d and its radius) from an obstacle.

    It is negative where they overlap, and for a box never below minus the radius.
    """
    centre, half = (row[CENTRE], row[CENTRE + 1], row[CENTRE + 2]), (row[HALF], row[5], row[6])
    if row[KIND] == POINT:
        gap = _to_point(p, d, centre)
    elif row[KIND] == SEGMENT:
        gap = _to_segment(p, d, scaled(centre, half, -1.0), scaled((0.0, 0.0, 0.0), half, 2.0))
    else:
        # Into the frame of the box, whose axes are the columns of its rotation.
        e = scaled(p, centre, -1.0)
        x, y, z = (
            (row[9], row[12], row[15]),
            (row[10], row[13], row[16]),
            (row[11], row[14], row[17]),
        )
        p, d = (_dot(x, e), _dot(y, e), _dot(z, e)), (_dot(x, d), _dot(y, d), _dot(z, d))
        gap = _to_box(p, d, half)
    return gap - row[RADIUS] - thick


# --- the three answers of a world -----------------------------------------------------------------


@register_jitable
def _postured(body, q, pose):
    """Write the frames of posture q into pose (n + 1, 7)."""
    place(body[: q.size + 1], q.reshape(q.size, 1), 0, pose)


@register_jitable
def _line(body, i, pose):
    """Return where the line of capsule i begins, and along which it goes."""
    p = point_of(pose, int(body[i, FRAME]), three(body, i, FROM))
    return p, scaled(point_of(pose, int(body[i, FRAME]), three(body, i, TO)), p, -1.0)


@register_jitable
def _speed(body, i, pose, p, d, rates, fixed):
    """Bound how far a point of the segment p, d of capsule i moves when the joints move by `rates`.

    The bound is the sum of |dq_k| rho_k over the joints below the capsule, with rho_k the larger
    distance of the segment's two ends from axis k. It is relative to the frame `fixed`, one of
    those joints, or relative to the world where that is -1.
    """
    # The frame of the tool, number n, moves with the last joint.
    total, k = 0.0, min(int(body[i, FRAME]), rates.size - 1)
    while k > fixed:
        if body[k, SLIDES] != 0.0:
            total += rates[k]
        else:
            # A point at distance r from the axis moves by r times the angle; r is convex along the
            # segment, so its largest value is at an end.
            axis, e = axis_of(pose, k), scaled(p, three(pose, k, 0), -1.0)
            a, b = cross3(axis, e), cross3(axis, scaled(e, d, 1.0))
            total += rates[k] * math.sqrt(max(_dot(a, a), _dot(b, b)))
        k = int(body[k, 0])
    return total


@register_jitable
def _freed(obstacles, body, pose, rates, far):
    """Return the share of the motion `rates`, at most `far`, for which the arm surely is free.

    This is the step of conservative advancement around the posture `pose`. It is negative where the
    arm is free by less than `FLOOR`.
    """
    # Capsules towards the hand are last in the table and tested first: they sweep farthest, which
    # makes an early exit likely.
    last = _last_capsule(body)
    for i in range(last, rates.size, -1):
        p, d = _line(body, i, pose)
        thick, bound, speed = body[i, THICK], 0.0, -1.0
        # A bound that needs no posture: the largest distance from each axis, over all postures.
        for k in range(rates.size):
            bound += rates[k] * body[i, REACH + k]
        half = 0.5 * math.sqrt(_dot(d, d)) + thick
        x, y, z = scaled(p, d, 0.5)
        for j in range(obstacles.shape[0]):
            row = obstacles[j]
            near = half + row[BALL] + max(far * bound, FLOOR)
            if (row[1] - x) ** 2 + (row[2] - y) ** 2 + (row[3] - z) ** 2 > near * near:
                continue  # broad phase: the bounding balls stay apart during the motion
            gap = _gap(row, p, d, thick)
            if gap < FLOOR:
                return -1.0
            if gap < far * bound:  # the cheap bound does not suffice: take the posture's own
                if speed < 0.0:
                    speed = _speed(body, i, pose, p, d, rates, -1)
                # Conservative advancement: within gap / speed of the motion the capsule cannot
                # touch. The nanometre covers the rounding of the gap.
                far = min(far, (gap - 1e-9) / speed)
    if last + 1 < body.shape[0]:
        far = _pairs_freed(body, last, pose, rates, far)
    return far


@register_jitable
def _last_capsule(body):
    """Return the row of the last capsule; those of the pairs come after it."""
    last = body.shape[0] - 1
    while body[last, FRAME] == PAIR:
        last -= 1
    return last


@register_jitable
def _pairs_freed(body, last, pose, rates, far):
    """Return the share of the motion, at most `far`, for which no pair of capsules can meet.

    As `_freed`: relative to the last frame that both capsules share, each moves by at most its own
    bound over the joints after that frame, and the gap closes by at most the sum of the two.
    """
    # Each capsule is in several pairs: its line is computed once.
    lines = np.empty((last + 1, 6))
    for i in range(rates.size + 1, last + 1):
        p, d = _line(body, i, pose)
        lines[i, 0], lines[i, 1], lines[i, 2] = p
        lines[i, 3], lines[i, 4], lines[i, 5] = d
    for r in range(last + 1, body.shape[0]):
        i, j = int(body[r, ONE]), int(body[r, OTHER])
        p, d, c, e = three(lines, i, 0), three(lines, i, 3), three(lines, j, 0), three(lines, j, 3)
        thick, bound = body[i, THICK] + body[j, THICK], 0.0
        for k in range(rates.size):
            bound += rates[k] * body[r, REACH + k]
        w = scaled(scaled(scaled(p, d, 0.5), c, -1.0), e, -0.5)
        near = 0.5 * (math.sqrt(_dot(d, d)) + math.sqrt(_dot(e, e))) + thick
        near += max(far * bound, FLOOR)
        if _dot(w, w) > near * near:
            continue  # broad phase, as in `_freed`
        gap = _to_segment(p, d, c, e) - thick
        if gap < FLOOR:
            return -1.0
        if gap < far * bound:
            common = int(body[r, COMMON])
            speed = _speed(body, i, pose, p, d, rates, common)
            speed += _speed(body, j, pose, c, e, rates, common)
            far = min(far, (gap - 1e-9) / speed)
    return far


@register_jitable
def _pair_gap(body, r, pose):
    """Return the signed distance of the two capsules of a pair's row."""
    i, j = int(body[r, ONE]), int(body[r, OTHER])
    p, d = _line(body, i, pose)
    c, e = _line(body, j, pose)
    return _to_segment(p, d, c, e) - body[i, THICK] - body[j, THICK]


@register_jitable
def _state(obstacles, body, q):
    pose = np.empty((q.size + 1, 7))
    _postured(body, q, pose)
    return _freed(obstacles, body, pose, np.zeros(q.size), 0.0) >= 0.0


def _edge(obstacles, body, a, b):
    # A halving adds at most one waiting interval, and `LEAST` ends them after about 40: 64 rows
    # suffice.
    n = a.size
    pose, rates, waiting = np.empty((n + 1, 7)), np.abs(b - a), np.empty((64, 2))
    # The end first: it is what most often collides.
    _postured(body, b, pose)
    far = _freed(obstacles, body, pose, rates, 1.0)
    if far < 0.0:
        return False
    # Intervals of the edge that are not proved free yet wait on a stack, and each is tested at its
    # middle; what the bounds free on both sides of it is cut out.
    waiting[0, 0], waiting[0, 1], top = 0.0, 1.0 - far, 1 if far < 1.0 else 0
    while top > 0:
        top -= 1
        low, high = waiting[top, 0], waiting[top, 1]
        middle = 0.5 * (low + high)
        _postured(body, a + middle * (b - a), pose)
        # A little more than half of it, so that rounding leaves nothing over.
        far = _freed(obstacles, body, pose, rates, 0.5 * (high - low) + LEAST)
        if far < LEAST:
            return False
        if middle - far > low:
            waiting[top, 0], waiting[top, 1] = low, middle - far
            waiting[top + 1, 0], waiting[top + 1, 1] = middle + far, high
            top += 2
    return True


def _sampled(obstacles, body, a, b):
    pieces = math.ceil(math.sqrt(np.sum((b - a) ** 2)) / SPACING)
    for k in range(1, pieces + 1):
        if not _state(obstacles, body, a + k / pieces * (b - a)):
            return False
    return True


def _clearance(obstacles, body, q):
    pose, least = np.empty((q.size + 1, 7)), np.inf
    _postured(body, q, pose)
    last = _last_capsule(body)
    for i in range(q.size + 1, last + 1):
        p, d = _line(body, i, pose)
        for j in range(obstacles.shape[0]):
            least = min(least, _gap(obstacles[j], p, d, body[i, THICK]))
    for r in range(last + 1, body.shape[0]):
        least = min(least, _pair_gap(body, r, pose))
    return least


# --- as data --------------------------------------------------------------------------------------


def obstacle_rows(obstacles: Sequence[tuple[Shape, ArrayLike]]) -> Array:
    """Return shapes of chapter 2 and their poses (7,) as rows of a world.

    Raises:
        ValueError: for another shape than a sphere, a capsule or a box in space.
    """
    rows = np.zeros((len(obstacles), COLUMNS))
    for row, (shape, at) in zip(rows, obstacles, strict=True):
        one_of("shape", shape.name, ("sphere", "capsule", "box"))
        if shape.dim != 3:
            raise invalid("shape.dim", shape.dim, "3")
        pose = poses("pose", at, 3)[:, 0]
        R = to_matrix(pose[3:])
        row[KIND] = {"sphere": POINT, "capsule": SEGMENT, "box": BOX}[shape.name]
        row[CENTRE:HALF], row[RADIUS], row[BALL] = pose[:3], shape.radius, shape.size
        row[HALF:RADIUS] = shape.half if shape.name == "box" else R @ shape.half
        row[TURN:] = R.ravel()
    return rows


def capsule_arm(
    obstacles: Sequence[tuple[Shape, ArrayLike]],
    chain: Chain | None = None,
    capsules: Sequence[tuple[int, Any, Any, float]] = HAND,
) -> World:
    """Return a world for an arm of capsules in space, whose edge checks are proofs.

    Its states are joint positions within the limits.

    Args:
        obstacles: shapes of chapter 2 with their poses: spheres, capsules, boxes.
        chain: of chapter 4; without one `panda`.
        capsules: of each the frame that carries it (`chain.n` is the tool), both ends in that frame
            [m], the radius [m].

    Raises:
        ValueError: for a chain without finite limits, a frame that is not there, a plane.
    """
    chain = panda() if chain is None else chain
    bounds = np.stack((chain.lower, chain.upper))
    vector("chain limits", bounds)
    rows = capsule_rows(chain.table, bounds, capsules)
    body = np.ascontiguousarray(np.vstack((chain.table, rows)))
    return World("capsule arm", bounds, obstacle_rows(obstacles), body, _state, _edge, _clearance)


def capsule_rows(
    table: Array, bounds: Array, capsules: Sequence[tuple[int, Any, Any, float]]
) -> Array:
    """Return capsules as rows of `body`, shape (m, `WIDTH`).

    Args:
        table: of the chain, see `Chain.table`, (n + 1, `WIDTH`).
        bounds: of its joints, rows, (2, n).
        capsules: as for `capsule_arm`.
    """
    n = bounds.shape[1]
    rows = np.zeros((len(capsules), WIDTH))
    steps = np.linalg.norm(table[:, PLACE : PLACE + 3], axis=1)
    for row, (frame, a, b, radius) in zip(rows, capsules, strict=True):
        one_of("frame", frame, range(n + 1))
        a, b = vector("capsule end", a, (3,)), vector("capsule end", b, (3,))
        row[FRAME], row[FROM:TO], row[TO:THICK], row[THICK] = frame, a, b, radius
        # Triangle inequality along the chain: no posture takes the capsule's line farther than
        # `far` from joint k. A prismatic joint moves every point by its own rate.
        far, k = max(np.linalg.norm(a), np.linalg.norm(b)), min(frame, n - 1)
        far += steps[n] if frame == n else 0.0
        while k >= 0:
            slides = bool(table[k, SLIDES])
            row[REACH + k] = 1.0 if slides else far
            stroke = np.abs(bounds[:, k]).max() if slides else 0.0
            far, k = far + steps[k] + stroke, int(table[k, PARENT])
    return rows


def sampled(world: World) -> World:
    """Return the world with edges that are only sampled, every 0.01 rad.

    Such a check is simple to write, but it can miss a collision between two samples.
    """
    return replace(world, edge_free=_sampled)


def with_sphere(world: World, centre: ArrayLike, radius: float = 0.08) -> World:
    """Return the world with an additional sphere [m], as an obstacle that moves between queries."""
    pose = np.append(vector("centre", centre, (3,), unit="m"), [1.0, 0.0, 0.0, 0.0])
    row = obstacle_rows([(shapes.sphere(radius), pose)])
    return replace(world, obstacles=np.vstack((world.obstacles, row)))


# --- shelves --------------------------------------------------------------------------------------

BOARD, FRONT, DEPTH, WIDE = 0.02, 0.5, 0.32, 0.42  # of both shelves [m]


_arm = functools.cache(panda)


@dataclass(frozen=True, eq=False)
class Shelf:
    """A shelf before the arm.

    Attributes:
        name: "open", 2 x 2 bays 0.38 m high, or "tight", 2 x 3 bays 0.25 m high.
        world: the arm and the boards.
        bays: middles of the openings, shape (3, m) [m].
        height: that is free in a bay [m].
    """

    name: str
    world: World
    bays: Array
    height: float

    def posture(self, bay: int, rng: np.random.Generator) -> Array | None:
        """Return a free posture with the fingertip in a bay, (7,), or None after 20 failed samples.

        The hand points into the bay, up to 0.3 rad to the sides and up, its wide side level.
        """
        for _ in range(20):
            spot = self.bays[:, bay] + rng.uniform(-1, 1, 3) * (
                0.06,
                0.3 * WIDE,
                0.25 * self.height,
            )
            spot[0] += 0.12
            forward = np.array([1.0, *rng.uniform(-0.3, 0.3, 2)])
            forward /= np.linalg.norm(forward)
            # The flange's frame: z points into the bay, y, along which the hand is wide, is
            # horizontal.
            side = np.cross([0.0, 0.0, 1.0], forward)
            side /= np.linalg.norm(side)
            quat = from_matrix(np.column_stack((np.cross(side, forward), side, forward)))
            flange = spot - FINGERTIP * forward
            result = ik(_arm(), np.append(flange, quat), rng=rng, restarts=10)
            if result.success and state_free(self.world, result.q):
                return result.q
        return None

    def query(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Return two free postures in different bays."""
        while True:
            bays = rng.choice(self.bays.shape[1], 2, replace=False)
            start, goal = (self.posture(int(bay), rng) for bay in bays)
            if start is not None and goal is not None:
                return start, goal

    def disturbed(self, rng: np.random.Generator, *postures: Array) -> World:
        """Return the world with a ball of 8 cm before the bays that leaves the postures free."""
        low, high = self.bays.min(axis=1), self.bays.max(axis=1)
        while True:
            spot = rng.uniform([FRONT - 0.15, low[1], low[2]], [FRONT, high[1], high[2]])
            world = with_sphere(self.world, spot)
            if all(state_free(world, q) for q in postures):
                return world


def shelf(name: str) -> Shelf:
    """Return the "open" or the "tight" shelf, on the floor 0.5 m in front of the arm's base."""
    one_of("name", name, ("open", "tight"))
    rows, height, bottom = (2, 0.38, 0.2) if name == "open" else (3, 0.25, 0.12)
    columns, here = 2, np.array([1.0, 0.0, 0.0, 0.0])
    tall, wide = rows * (height + BOARD) + BOARD, columns * (WIDE + BOARD) + BOARD
    middle, x = bottom + 0.5 * tall, FRONT + 0.5 * DEPTH
    back = FRONT + DEPTH + 0.5 * BOARD
    boards = [
        ((1.0, 1.0, 0.05), (0.0, 0.0, -0.05)),  # the floor
        ((0.5 * BOARD, 0.5 * wide, 0.5 * tall), (back, 0.0, middle)),
    ]
    for i in range(rows + 1):
        z = bottom + 0.5 * BOARD + i * (height + BOARD)
        boards.append(((0.5 * DEPTH, 0.5 * wide, 0.5 * BOARD), (x, 0.0, z)))
    for i in range(columns + 1):
        y = -0.5 * wide + 0.5 * BOARD + i * (WIDE + BOARD)
        boards.append(((0.5 * DEPTH, 0.5 * BOARD, 0.5 * tall), (x, y, middle)))
    bays = [
        (FRONT, (i - 0.5) * (WIDE + BOARD), bottom + BOARD + 0.5 * height + k * (height + BOARD))
        for i in range(columns)
        for k in range(rows)
    ]
    world = capsule_arm([(shapes.box(half), np.append(at, here)) for half, at in boards])
    return Shelf(name, world, np.array(bays).T, height)


def warm() -> None:
    """Compile, or load from the cache, the tests of this file's worlds."""
    world = shelf("open").world
    assert world.kernels
    assert sampled(world).kernels
    compiled(world.clearance, CLEARANCE)
