"""The judge of paths: exact where the geometry allows it, and none of the planners' code.

Every path of every planner, chart and exercise goes through `check_path`, which uses other methods
than the planners do. In the plane it cuts a segment where it meets the sides of a polygon, and
tests the middle of each piece by its winding number. An arm's edge is halved until no point of the
arm can travel as far as its clearance within a part (`prove`). Rounding may make a planner's own
test wrong by a little, so a collision up to `TOLERANCE` deep passes; of an arm, one up to
`TOLERANCE` + `RESOLVED` deep may pass, as its edge is halved no further than that.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import invalid
from course.contact.narrow import measured
from course.contact.shapes import points
from course.kinematics import motion
from course.kinematics.chain import PARENT, PLACE, SLIDES
from course.planning.capsules import (
    BOX,
    CENTRE,
    FRAME,
    FROM,
    HALF,
    KIND,
    ONE,
    OTHER,
    PAIR,
    RADIUS,
    SEGMENT,
    THICK,
    TURN,
)
from course.planning.worlds import DISC, LAST_SIDE, World, function_behind

Array = NDArray[np.float64]

TOLERANCE = 1e-9  # m; a state that is deeper collides
RESOLVED = (
    1e-8  # m; a part of an edge is not halved if the arm moves less from its middle to its ends
)
UNDECIDED = 100_000  # parts of an edge; only a link that grazes along an obstacle needs more


@dataclass(frozen=True)
class Verdict:
    """Result of validating a path.

    Attributes:
        free: it is, from start to goal.
        reason: what is wrong with it; empty if nothing is.
        edge: the first wrong edge, or state; -1 if it is about the whole path.
        state: where it is wrong, a state (n,), or None.
    """

    free: bool
    reason: str = ""
    edge: int = -1
    state: Array | None = None

    def __bool__(self) -> bool:
        return self.free


def check_path(
    world: World,
    path: ArrayLike | None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
) -> Verdict:
    """Return whether a path stays in bounds and touches nothing, between its states too.

    Args:
        world: the world.
        path: states, one a column, shape (n, k), k from 1 on; None, as a plan may have, is wrong.
        start: the state that it must begin with, exactly, shape (n,), if given.
        goal: the state that it must end with, likewise, or the corners of the goal box as rows,
            shape (2, n).

    Returns:
        The verdict: true where the path is right. In a world of kind "function" only the points
        that its resolution asks for are looked at.
    """
    if path is None:
        return Verdict(False, "there is no path")
    try:
        states: Array = np.asarray(path, dtype=float)
    except (TypeError, ValueError):
        states = np.asarray([], dtype=float)
    if states.ndim != 2 or states.shape[0] != world.bounds.shape[1] or not states.shape[1]:
        return Verdict(False, f"the shape {states.shape} is not ({world.bounds.shape[1]}, k)")
    low, high = world.bounds
    for k, q in enumerate(states.T):
        if not np.isfinite(q).all():
            return Verdict(False, "a state is not finite", k, q)
        if (q < low).any() or (q > high).any():
            return Verdict(False, "a state is out of bounds", k, q)
    if start is not None and not np.array_equal(states[:, 0], np.asarray(start, float)):
        return Verdict(False, "it does not begin at the start", 0, states[:, 0])
    if goal is not None:
        box = np.broadcast_to(np.asarray(goal, float), (2, len(states)))
        if (states[:, -1] < box[0]).any() or (states[:, -1] > box[1]).any():
            return Verdict(False, "it does not end at the goal", states.shape[1] - 1, states[:, -1])
    if world.kind not in JUDGES:
        raise invalid("world.kind", world.kind, f"one of {', '.join(JUDGES)}")
    # A path of a single state is judged as an edge from that state to itself.
    for k in range(max(1, states.shape[1] - 1)):
        hit = JUDGES[world.kind](world, states[:, k], states[:, min(k + 1, states.shape[1] - 1)])
        if hit is not None:
            return Verdict(False, "an edge collides", k, hit)
    return Verdict(True)


# --- the plane ------------------------------------------------------------------------------------


def _obstacles(world: World) -> Iterator[tuple[Any, float]]:
    """Yield discs as (centre, radius), polygons as (corners, -1); a point is a complex number."""
    corners: list[complex] = []
    for kind, a, b, c, _ in world.obstacles.tolist():
        if kind == DISC:
            yield complex(a, b), c
            continue
        corners.append(complex(a, b))
        if kind == LAST_SIDE:
            yield np.array(corners), -1.0
            corners = []


def _to_segments(p: Any, a: Any, b: Any) -> Any:
    """Return the distance of points from segments, complex arrays that broadcast."""
    along = b - a
    # The smallest float makes a segment without length a point instead of a division by 0.
    square = np.maximum(np.abs(along) ** 2, np.finfo(float).tiny)
    t = np.clip(((p - a) * np.conj(along)).real / square, 0.0, 1.0)
    return np.abs(p - a - t * along)


def _depth(p: Any, ring: Any) -> Array:
    """Return how deep points (m,) are in a polygon, by winding number; negative outside."""
    ends = np.roll(ring, -1)
    away = _to_segments(p[:, None], ring, ends).min(axis=1)
    # Winding number: the angles under which a point sees the sides sum to 2 pi inside and to 0
    # outside. At a corner, a division by 0, the angle is set to 0: the depth is 0 there anyway.
    with np.errstate(all="ignore"):
        turn = np.nan_to_num(np.angle((ends - p[:, None]) / (ring - p[:, None]))).sum(axis=1)
    return np.where(np.abs(turn) > math.pi, away, -away)


def _pieces(a: complex, b: complex, ring: Any) -> Array:
    """Return the middles, from 0 to 1, of the pieces that a polygon's sides cut a segment into."""
    along, sides = b - a, np.roll(ring, -1) - ring
    # Quotient of two cross products: where the lines meet, as a share of the segment. Parallel
    # lines give an infinity or NaN, which the comparisons below remove.
    with np.errstate(all="ignore"):
        met = ((ring - a) * np.conj(sides)).imag / (along * np.conj(sides)).imag
    cuts = np.unique(np.concatenate(([0.0, 1.0], met[(met > 0.0) & (met < 1.0)])))
    return np.concatenate(([0.0, 1.0], 0.5 * (cuts[1:] + cuts[:-1])))


def _judge_plane(world: World, a: Array, b: Array) -> Array | None:
    p, q = complex(*a), complex(*b)
    # Discs: the depth is the radius minus the distance of the centre from the segment.
    _, x, y, radii, _ = world.obstacles[world.obstacles[:, 0] == DISC].T
    deep = radii - _to_segments(x + 1j * y, p, q)
    if deep.max(initial=0.0) > TOLERANCE:
        k, along = deep.argmax(), abs(q - p) ** 2
        t = ((complex(x[k], y[k]) - p) * (q - p).conjugate()).real / along if along else 0.0
        return np.asarray(a + min(max(t, 0.0), 1.0) * (b - a))
    # Polygons: no side cuts a piece, so all of it is inside or outside, as its middle is.
    for ring in (ring for ring, radius in _obstacles(world) if radius < 0.0):
        parts = _pieces(p, q, ring)
        deep = _depth(p + parts * (q - p), ring)
        if deep.max() > TOLERANCE:
            return np.asarray(a + parts[deep.argmax()] * (b - a))
    return None


# --- arms -----------------------------------------------------------------------------------------


def prove(a: Array, b: Array, gaps: Callable[[Array], Array], travels: ArrayLike) -> Array | None:
    """Return a state on an edge that collides, or None if the edge is proved free.

    Adaptive bisection of the edge (Schwarzer, Saha and Latombe, Adaptive dynamic collision checking
    for single and multiple articulated robots in complex environments, 2005). A part is free if, at
    its middle, every link has at least the clearance that it can travel to the ends of the part.
    The other parts are halved, until the arm moves less than `RESOLVED` from a middle to the ends
    of its part. So every state of an edge that passes is at most `TOLERANCE` + `RESOLVED` deep.

    Args:
        a: first end of the edge, shape (n,).
        b: other end of the edge, shape (n,).
        gaps: states (n, m) -> clearance of each link, shape (links, m) [m]; negative where the link
            penetrates an obstacle. NaN counts as a collision.
        travels: upper bound on the distance that a point of each link moves from a to b, shape
            (links,) [m].

    Returns:
        The state, shape (n,), or None. An edge is rejected as well where more than `UNDECIDED`
        parts are undecided, because a link grazes along an obstacle: the state is then the middle
        with the least clearance.
    """
    # Middles of the parts and half their length, as shares of the edge from 0 to 1.
    middles, half = np.array([0.5]), 0.5
    ends = np.array([0.0, 1.0])
    travel = np.asarray(travels, dtype=float)[:, None]
    # The ends of the edge first. Written with `not`, so that a clearance that is NaN collides.
    least = gaps(a[:, None] + ends * (b - a)[:, None]).min(axis=0)
    if not least.min() >= -TOLERANCE:
        return np.asarray(a + ends[least.argmin()] * (b - a))
    while middles.size:
        clearance = gaps(a[:, None] + middles * (b - a)[:, None])
        least = clearance.min(axis=0)
        if not least.min() >= -TOLERANCE or middles.size > UNDECIDED:
            return np.asarray(a + middles[least.argmin()] * (b - a))
        # Within half a part the arm moves less than `RESOLVED`: what is undecided passes as free.
        if travel.max() * half < RESOLVED:
            return None
        # Only the parts that the clearance at their middle does not cover are halved again. Depths
        # up to `TOLERANCE` pass, so a link that rests against something is covered as well.
        undecided = middles[(clearance + TOLERANCE < travel * half).any(axis=0)]
        half *= 0.5
        middles = np.concatenate((undecided - half, undecided + half))
    return None


def _between(p: Any, q: Any, u: Any, v: Any) -> Array:
    """Return the distance of segments from p to q and from u to v in the plane, 0 where they cross.

    Complex arrays that broadcast, as in `_to_segments`.
    """
    distance = np.minimum(
        np.minimum(_to_segments(p, u, v), _to_segments(q, u, v)),
        np.minimum(_to_segments(u, p, q), _to_segments(v, p, q)),
    )
    # Parameters of the lines' intersection, by Cramer's rule. Parallel lines give an infinity or
    # NaN and do not count as crossing; where they overlap, an end is on the other segment and
    # `distance` is 0.
    along, side = q - p, v - u
    with np.errstate(all="ignore"):
        area = (along * np.conj(side)).imag
        s = ((u - p) * np.conj(side)).imag / area
        t = ((u - p) * np.conj(along)).imag / area
    crossing = (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    return np.where(crossing, 0.0, distance)


def _judge_arm(world: World, a: Array, b: Array) -> Array | None:
    lengths, thick = world.body.T
    obstacles = list(_obstacles(world))

    def gaps(q: Array) -> Array:
        # Forward kinematics in the complex plane: a link is its length times exp(i angle).
        steps = lengths[:, None] * np.exp(1j * np.cumsum(q, axis=0))
        tips = np.cumsum(steps, axis=0)
        bases = tips - steps
        least = np.full(tips.shape, np.inf)
        for obstacle, radius in obstacles:
            if radius > 0.0:
                distance = _to_segments(obstacle, bases, tips) - radius
            else:
                ends = np.roll(obstacle, -1)
                distance = _between(bases[..., None], tips[..., None], obstacle, ends).min(axis=-1)
                deep = _depth(tips.ravel(), obstacle).reshape(tips.shape)
                # A link that just touches a side, at distance 0, counts as a collision: the offset
                # takes it below -`TOLERANCE`.
                distance = np.where(
                    deep > 0.0, -deep, distance - 2.0 * TOLERANCE * (distance == 0.0)
                )
            least = np.minimum(least, distance - thick[:, None])
        return least

    reach = np.cumsum(lengths[::-1])[::-1]  # from each joint to the tip
    return prove(a, b, gaps, np.cumsum(np.abs(b - a) * reach))


def _carriers(table: Array, frame: int, n: int) -> NDArray[np.bool_]:
    """Return which of n joints move a frame, shape (n,)."""
    moves = np.zeros(n, dtype=bool)
    k = min(frame, n - 1)
    while k >= 0:
        moves[k], k = True, int(table[k, PARENT])
    return moves


def _judge_capsules(world: World, a: Array, b: Array) -> Array | None:
    """Return distances by chapter 2's search among differences of points.

    Travels from the lengths of the links alone, which no posture changes.
    """
    n = len(a)
    table, rows = world.body[: n + 1], world.body[n + 1 :]
    capsules = rows[rows[:, FRAME] != PAIR]
    pairs = rows[rows[:, FRAME] == PAIR][:, [ONE, OTHER]].astype(int) - (n + 1)
    ends = [c[FROM:THICK].reshape(2, 3).T for c in capsules]
    arm = [points(p, c[THICK]) for p, c in zip(ends, capsules, strict=True)]
    blocks = []
    for row in world.obstacles:
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3))).T
        turn = row[TURN:].reshape(3, 3) if row[KIND] == BOX else np.eye(3)
        corners = turn @ (signs * row[HALF:RADIUS, None])
        if row[KIND] == SEGMENT:
            corners = np.outer(row[HALF:RADIUS], [-1.0, 1.0])
        blocks.append(points(row[CENTRE:HALF, None] + corners, row[RADIUS]))
    reach = np.linalg.norm(table[:, PLACE : PLACE + 3], axis=1)
    rates, shares = np.abs(b - a), np.zeros((len(capsules), n))
    # Triangle inequality down the chain to the base: `far` bounds the distance of the capsule's
    # line from joint k, in every posture.
    for i, row in enumerate(capsules):
        k, far = int(row[FRAME]), float(np.linalg.norm(ends[i], axis=0).max())
        while k >= 0:
            if k < n:
                shares[i, k] = rates[k] * (1.0 if table[k, SLIDES] else far)
                far += abs(table[k, SLIDES]) * np.abs(world.bounds[:, k]).max()
            far, k = far + reach[k], int(table[k, PARENT])
    # Two capsules approach each other only by the joints that carry one of them and not the other.
    below = np.array([_carriers(table, int(row[FRAME]), n) for row in capsules])
    one, other = pairs.T
    apart = np.where(below[one] != below[other], shares[one] + shares[other], 0.0)
    travels = np.concatenate((shares.sum(axis=1), apart.sum(axis=1)))

    def gaps(q: Array) -> Array:
        frames = motion.kernels()[0](table, np.ascontiguousarray(q))
        here = np.zeros((7, q.shape[1]))
        here[3] = 1.0
        least = np.full((len(arm) + len(pairs), q.shape[1]), np.inf)
        poses = [np.ascontiguousarray(frames[:, int(row[FRAME])]) for row in capsules]
        for i, link in enumerate(arm):
            for block in blocks:
                least[i] = np.minimum(least[i], measured(link, poses[i], block, here)[0])
        for k, (i, j) in enumerate(pairs, len(arm)):
            least[k] = measured(arm[i], poses[i], arm[j], poses[j])[0]
        return least

    return prove(a, b, gaps, travels)


# --- a function of the user -----------------------------------------------------------------------


def _judge_function(world: World, a: Array, b: Array) -> Array | None:
    function = function_behind(world)
    assert function is not None
    # The same points as the planner's edge check tries, including the tolerance in the rounding.
    pieces = max(1, math.ceil(math.dist(a, b) / world.body[0, 0] - 1e-9))
    for t in np.arange(pieces + 1) / pieces:
        q = a + t * (b - a) if t < 1.0 else b
        if not function.valid(q.copy()):
            return np.asarray(q)
    return None


# kind of world -> (world, a, b) -> a state on the edge that collides, or None
JUDGES: dict[str, Callable[[World, Array, Array], Array | None]] = {
    "plane": _judge_plane,
    "planar arm": _judge_arm,
    "capsule arm": _judge_capsules,
    "function": _judge_function,
}
