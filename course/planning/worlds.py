"""Worlds as data: what may be where, and three compiled functions that answer for it.

A `World` is its bounds, two tables of numbers and three plain functions over them, which `kernels`
compiles for one signature each. A planner is compiled once and takes them as arguments, so one
source serves every world; a new world needs these three functions and no planner:

    state_free(obstacles, body, q) -> bool      whether state q touches nothing
    edge_free(obstacles, body, a, b) -> bool    whether the straight edge from a to b is free
    clearance(obstacles, body, q) -> float      signed distance to the nearest obstacle [m]

Touching is a collision. In the plane an edge is tested exactly (up to rounding). An arm's edge is
proved: where an arm is free by a distance, it stays free for as long as no point of it can have
moved by that distance. Such a test never passes an edge that collides, and gives up, as if it
collided, where less than `FLOOR` is free.

States are rows inside the kernels; a path that is handed out is (n, k), one state a column.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, invalid, positive, vector
from course.compiled import MATRIX, VECTOR, address_of, compiled, function_argument

Array = NDArray[np.float64]

# What a world answers, compiled: of its obstacles, its body, and one state or the two of an edge.
STATE = types.boolean(MATRIX, MATRIX, VECTOR)
EDGE = types.boolean(MATRIX, MATRIX, VECTOR, VECTOR)
CLEARANCE = types.float64(MATRIX, MATRIX, VECTOR)

FLOOR = 5e-6  # m; an edge is given up where it is free by less: 10 um of motion between two tests
LEAST = 1e-12  # of an edge; one of which a test frees less is given up, so that each test ends

# First column of a row of plane obstacles: a disc (x, y, radius), an edge of a polygon (ax, ay, bx,
# by), or the edge that closes it.
DISC, SIDE, LAST_SIDE = 0.0, 1.0, 2.0


@dataclass(frozen=True, eq=False)
class World:
    """Where a state may be, and what is in the way.

    Attributes:
        kind: "plane", "planar arm", "function", ...: `check_path` picks its judge by it.
        bounds: lowest and highest state, rows, shape (2, n) [m or rad].
        obstacles: one row each, as the kind has them.
        body: what moves, one row a part, as the kind has it.
        state_free, edge_free, clearance: plain functions over these tables, see the top.
    """

    kind: str
    bounds: Array
    obstacles: Array
    body: Array
    state_free: Callable[..., Any]
    edge_free: Callable[..., Any]
    clearance: Callable[..., Any]

    @property
    def dim(self) -> int:
        """Numbers of a state."""
        return self.bounds.shape[1]

    @functools.cached_property
    def extent(self) -> float:
        """Length of the diagonal of the bounds."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    @functools.cached_property
    def _limits(self) -> list[list[float]]:
        return self.bounds.tolist()

    def within(self, q: Array) -> bool:
        """Return whether a state, shape (n,), is in bounds; a NaN is not."""
        low, high = self._limits
        state = q.tolist()  # few numbers: a list is faster than an array
        return all(map(operator.le, low, state)) and all(map(operator.le, state, high))

    @functools.cached_property
    def kernels(self) -> tuple[Any, Any]:
        """State test and edge test, compiled, in the form in which a compiled loop takes them."""
        return _argument(self.state_free, STATE), _argument(self.edge_free, EDGE)

    @functools.cached_property
    def addresses(self) -> tuple[Any, Any]:
        """The same as numbers, see `course.compiled.address_of`."""
        state, edge = self.kernels
        return address_of(state), address_of(edge)


@functools.cache
def _argument(function: Callable[..., Any], signature: Any) -> Any:
    return function_argument(compiled(function, signature))


def state_free(world: World, q: ArrayLike) -> bool:
    """Return whether a state, shape (n,), touches nothing. Bounds are not asked."""
    test = compiled(world.state_free, STATE)
    return bool(test(world.obstacles, world.body, _state("q", q, world)))


def edge_free(world: World, a: ArrayLike, b: ArrayLike) -> bool:
    """Return whether the straight edge between two states, each (n,), is proved free."""
    test = compiled(world.edge_free, EDGE)
    return bool(test(world.obstacles, world.body, _state("a", a, world), _state("b", b, world)))


def clearance(world: World, q: ArrayLike) -> float:
    """Return signed distance from the body at state q, shape (n,), to the nearest obstacle [m].

    Inside, only a point in the plane has its full depth. An arm's is no deeper than its radius (and
    a capsule's) where the middle of a link goes through: there it is flat, without a way out.
    """
    measure = compiled(world.clearance, CLEARANCE)
    return float(measure(world.obstacles, world.body, _state("q", q, world)))


def _state(name: str, q: ArrayLike, world: World) -> Array:
    return np.ascontiguousarray(vector(name, q, (world.dim,)))


# --- a point in the plane -------------------------------------------------------------------------


@register_jitable
def _side_of(ax, ay, bx, by, x, y):
    """Return positive where (x, y) is left of the line from a to b, zero on it."""
    return (bx - ax) * (y - ay) - (by - ay) * (x - ax)


@register_jitable
def _cross(ax, ay, bx, by, px, py, qx, qy):
    """Return whether two closed segments share a point; either may have no length."""
    # Bounding boxes first: most pairs of segments end here, and it settles collinear ones.
    if max(ax, bx) < min(px, qx) or max(px, qx) < min(ax, bx):
        return False
    if max(ay, by) < min(py, qy) or max(py, qy) < min(ay, by):
        return False
    # Proper test: each segment's ends lie on different sides of the other's line, or on it.
    u, v = _side_of(ax, ay, bx, by, px, py), _side_of(ax, ay, bx, by, qx, qy)
    if (u > 0.0 and v > 0.0) or (u < 0.0 and v < 0.0):
        return False
    u, v = _side_of(px, py, qx, qy, ax, ay), _side_of(px, py, qx, qy, bx, by)
    return not ((u > 0.0 and v > 0.0) or (u < 0.0 and v < 0.0))


@register_jitable
def _passes(px, py, qx, qy, x, y):
    """Return whether the ray from (x, y) along +x crosses a side.

    An odd number of sides is inside.
    """
    # Half-open in y, so that a ray through a corner counts one of the two sides that meet there.
    if (py > y) == (qy > y):
        return False
    return (_side_of(px, py, qx, qy, x, y) > 0.0) == (qy > py)


@register_jitable
def _point_to_segment(x, y, ax, ay, bx, by):
    """Return the distance of a point from a segment, which may have no length."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    t = 0.0
    if square > 0.0:
        t = min(max(((x - ax) * dx + (y - ay) * dy) / square, 0.0), 1.0)
    return math.hypot(x - ax - t * dx, y - ay - t * dy)


@register_jitable
def _meets_disc(ax, ay, bx, by, x, y, radius):
    """Return whether a segment touches a disc.

    |a + t (b - a) - centre|^2 - r^2 is a quadratic in t.
    """
    dx, dy, fx, fy = bx - ax, by - ay, ax - x, ay - y
    square, slope = dx * dx + dy * dy, fx * dx + fy * dy
    first = fx * fx + fy * fy - radius * radius
    if first <= 0.0:
        return True  # begins inside
    if slope >= 0.0:
        return False  # moves away
    if square + 2.0 * slope + first <= 0.0:
        return True  # ends inside
    return -slope < square and slope * slope >= square * first  # enters and leaves in between


@register_jitable
def segment_free(obstacles, ax, ay, bx, by):
    """Return whether a segment touches no disc and no polygon.

    It crosses no side of a polygon, and its first point is inside none (Ericson, Real-Time
    Collision Detection, 2005, sec. 5.1.9 and 5.3.2).
    """
    inside = False
    for i in range(obstacles.shape[0]):
        kind, u, v = obstacles[i, 0], obstacles[i, 1], obstacles[i, 2]
        w, z = obstacles[i, 3], obstacles[i, 4]
        if kind == DISC:
            if _meets_disc(ax, ay, bx, by, u, v, w):
                return False
            continue
        if _cross(ax, ay, bx, by, u, v, w, z):
            return False
        # Even-odd rule: the start is inside if a ray from it crosses the sides an odd number of
        # times.
        if _passes(u, v, w, z, ax, ay):
            inside = not inside
        # The last side closes the polygon: only now the parity of all crossings is known.
        if kind == LAST_SIDE:
            if inside:
                return False
            inside = False
    return True


@register_jitable
def segment_gap(obstacles, ax, ay, bx, by):
    """Return the distance of a segment to the nearest obstacle [m].

    Negative inside, by the way to the nearest side or to the circle; zero where it crosses a side.
    """
    least, nearest, inside = np.inf, np.inf, False
    for i in range(obstacles.shape[0]):
        kind, u, v = obstacles[i, 0], obstacles[i, 1], obstacles[i, 2]
        w, z = obstacles[i, 3], obstacles[i, 4]
        if kind == DISC:
            least = min(least, _point_to_segment(u, v, ax, ay, bx, by) - w)
            continue
        if _cross(ax, ay, bx, by, u, v, w, z):
            nearest = 0.0
        if nearest > 0.0:  # without a crossing the nearest points are an end of one of the two
            nearest = min(nearest, _point_to_segment(ax, ay, u, v, w, z))
            nearest = min(nearest, _point_to_segment(bx, by, u, v, w, z))
            nearest = min(nearest, _point_to_segment(u, v, ax, ay, bx, by))
        if _passes(u, v, w, z, ax, ay):
            inside = not inside
        # Only with the last side is the polygon's sign known.
        if kind == LAST_SIDE:
            least = min(least, -nearest if inside else nearest)
            nearest, inside = np.inf, False
    return least


def _plane_state(obstacles, body, q):
    return segment_free(obstacles, q[0], q[1], q[0], q[1])


def _plane_edge(obstacles, body, a, b):
    return segment_free(obstacles, a[0], a[1], b[0], b[1])


def _plane_clearance(obstacles, body, q):
    return segment_gap(obstacles, q[0], q[1], q[0], q[1])


# --- a planar arm ---------------------------------------------------------------------------------


@register_jitable
def arm_gap(obstacles, body, q):
    """Return the smallest distance between the arm's links at q and the obstacles [m]."""
    x, y, angle, least = 0.0, 0.0, 0.0, np.inf
    for i in range(body.shape[0]):
        angle += q[i]
        ex, ey = x + body[i, 0] * math.cos(angle), y + body[i, 0] * math.sin(angle)
        least = min(least, segment_gap(obstacles, x, y, ex, ey) - body[i, 1])
        x, y = ex, ey
    return least


@register_jitable
def _arm_reach(obstacles, body, a, b, t):
    """Return how far t may move in both directions from a + t (b - a) before anything can touch.

    It is negative where less than FLOOR is free.

    Link k turns at a constant rate w_k, the sum of the rates of the joints up to it, so no point of
    link i is faster than the sum of l_k |w_k| over k <= i.
    """
    x, y, angle, rate, fastest, reach = 0.0, 0.0, 0.0, 0.0, 0.0, np.inf
    for i in range(body.shape[0]):
        angle += a[i] + t * (b[i] - a[i])
        rate += b[i] - a[i]
        # No point of the links so far moves faster than the sum of length times rate.
        fastest += body[i, 0] * abs(rate)
        ex, ey = x + body[i, 0] * math.cos(angle), y + body[i, 0] * math.sin(angle)
        # Conservative advancement: within gap / fastest nothing can touch.
        gap = segment_gap(obstacles, x, y, ex, ey) - body[i, 1]
        if gap < FLOOR:
            return -1.0
        # A comparison without a division: while nothing moves, the product is NaN (infinity times
        # 0), and the reach stays infinite.
        if gap < reach * fastest:
            reach = gap / fastest
        x, y = ex, ey
    return reach


def _arm_state(obstacles, body, q):
    return arm_gap(obstacles, body, q) > 0.0


def _arm_edge(obstacles, body, a, b):
    # The middle of an interval frees what is around it; the rests wait, at most one a halving.
    waiting = np.empty((64, 2))
    # Intervals that are not proved free yet wait on a stack; each is tested at its middle.
    waiting[0, 0], waiting[0, 1], top = 0.0, 1.0, 1
    while top > 0:
        top -= 1
        low, high = waiting[top, 0], waiting[top, 1]
        middle = 0.5 * (low + high)
        reach = _arm_reach(obstacles, body, a, b, middle)
        if reach < LEAST:
            return False
        # The remainders on both sides of the proved middle wait.
        if middle - reach > low:
            waiting[top, 0], waiting[top, 1] = low, middle - reach
            waiting[top + 1, 0], waiting[top + 1, 1] = middle + reach, high
            top += 2
    return True


def _arm_clearance(obstacles, body, q):
    return arm_gap(obstacles, body, q)


# --- a function of the user -----------------------------------------------------------------------


class Asked:
    """A user's function behind the compiled planners: counts its calls, keeps what it raises.

    A compiled loop can't pass an exception on. So after one every state is called blocked, and
    `plan` raises it at the end of the chunk.
    """

    known: ClassVar[list[Asked]] = []

    def __init__(self, valid: Callable[[Array], bool]) -> None:
        self.valid, self.calls = valid, 0
        self.raised: tuple[BaseException, Array] | None = None
        self.number = len(Asked.known)
        Asked.known.append(self)

    def __call__(self, q: Array) -> bool:
        """Ask the user's function whether a state is free; after an exception the answer is no."""
        if self.raised is not None:
            return False
        self.calls += 1
        try:
            return bool(self.valid(q.copy()))
        except BaseException as error:  # an interrupt too: it comes out of `plan`
            self.raised = (error, q.copy())
            return False


def _ask(number: int, q: Array) -> bool:
    return Asked.known[number](q)


def _function_state(obstacles, body, q):
    number = int(obstacles[0, 0])
    # Object mode: Numba returns to the Python interpreter for this call.
    with numba.objmode(free="boolean"):
        free = _ask(number, q)
    return free


def _function_edge(obstacles, body, a, b):
    number = int(obstacles[0, 0])
    square = 0.0
    for i in range(a.size):
        square += (b[i] - a[i]) ** 2
    # Equal pieces no longer than the resolution; the tolerance keeps rounding from adding one more.
    pieces = max(1, math.ceil(math.sqrt(square) / body[0, 0] - 1e-9))
    for k in range(pieces + 1):
        q = a + (k / pieces) * (b - a) if k < pieces else b
        with numba.objmode(free="boolean"):
            free = _ask(number, q)
        if not free:
            return False
    return True


def _function_clearance(obstacles, body, q):
    return np.nan


# --- making worlds --------------------------------------------------------------------------------


def box(name: str, value: ArrayLike) -> Array:
    """Return bounds from outside: rows low and high, shape (2, n), low below high everywhere."""
    bounds = np.ascontiguousarray(vector(name, value, (2, None)))
    if not bounds.shape[1] or not (bounds[0] < bounds[1]).all():
        raise invalid(name, bounds, "two rows, the first below the second everywhere")
    return bounds


def _is_simple(corners: Array) -> bool:
    """Return whether a polygon, corners (k, 2), has an area and no two sides that cross."""
    a, b = corners, np.roll(corners, -1, axis=0)

    def side(p: Array, q: Array, r: Array) -> Array:
        """Return on which side of the lines p q the points r are: -1, 0 or 1."""
        return np.sign(
            (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
            - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])
        )

    # Two sides cross properly if each separates the ends of the other. Sides that only touch, as
    # neighbours do, give a product of 0.
    first, second = (corners[:, None], b[:, None]), (a[None], b[None])
    crossing = (side(*first, second[0]) * side(*first, second[1]) < 0.0) & (
        side(*second, first[0]) * side(*second, first[1]) < 0.0
    )
    # Shoelace formula: twice the signed area.
    area = float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))
    return bool(area != 0.0 and not crossing.any())


def _plane_obstacles(discs: ArrayLike, boxes: ArrayLike, polygons: Sequence[ArrayLike]) -> Array:
    """Return rows of plane obstacles; a box is the polygon of its four sides."""
    round_ones = np.asarray(discs, dtype=float).reshape(-1, 3) if np.size(discs) == 0 else discs
    rows = [[DISC, *disc, 0.0] for disc in vector("discs", round_ones, (None, 3), unit="m")]
    for i, row in enumerate(rows):
        positive(f"discs[{i}][2]", row[3], unit="m")
    corners = []
    flat = np.asarray(boxes, dtype=float).reshape(-1, 4) if np.size(boxes) == 0 else boxes
    for i, (x, y, u, v) in enumerate(vector("boxes", flat, (None, 4), unit="m")):
        box(f"boxes[{i}]", [[x, y], [u, v]])
        corners.append(np.array([[x, y], [u, y], [u, v], [x, v]]))
    for i, polygon in enumerate(polygons):
        corners.append(vector(f"polygons[{i}]", polygon, (None, 2), unit="m"))
        count(f"len(polygons[{i}])", len(corners[-1]), 3)
        if not _is_simple(corners[-1]):
            allowed = "corners of a polygon with an area, whose sides meet at its corners only"
            raise invalid(f"polygons[{i}]", polygon, allowed)
    for ring in corners:
        sides = [[SIDE, *p, *q] for p, q in zip(ring, np.roll(ring, -1, axis=0), strict=True)]
        # The last side is marked, so that the loops see where a polygon ends.
        sides[-1][0] = LAST_SIDE
        rows += sides
    return np.array(rows, dtype=float).reshape(-1, 5)


def plane(
    bounds: ArrayLike,
    discs: ArrayLike = (),
    boxes: ArrayLike = (),
    polygons: Sequence[ArrayLike] = (),
) -> World:
    """Return a point among obstacles in the plane, its edges tested exactly.

    Args:
        bounds: rows (xmin, ymin) and (xmax, ymax), shape (2, 2) [m].
        discs: rows (x, y, radius), shape (n, 3) [m].
        boxes: rows (xmin, ymin, xmax, ymax), shape (n, 4) [m].
        polygons: corners of each in order, either way round, shape (k, 2), k from 3 on [m]; sides
            must not cross each other.

    Raises:
        ValueError: for empty bounds, a NaN, a radius that is not positive, an empty box, a polygon
            without an area or with sides that cross.
    """
    limits = box("bounds", vector("bounds", bounds, (2, 2), unit="m"))
    return World(
        "plane",
        limits,
        _plane_obstacles(discs, boxes, polygons),
        np.zeros((1, 1)),
        _plane_state,
        _plane_edge,
        _plane_clearance,
    )


def planar_arm(
    lengths: ArrayLike,
    radius: ArrayLike = 0.0,
    discs: ArrayLike = (),
    boxes: ArrayLike = (),
    polygons: Sequence[ArrayLike] = (),
    bounds: ArrayLike | None = None,
) -> World:
    """Return an arm of n links in the plane, its base at the origin, its edges proved.

    Links pass each other, as in chapter 4: they lie in planes of their own. An angle does not wrap.

    Args:
        lengths: of the links, shape (n,) [m], positive.
        radius: of the capsule around a link, a number or shape (n,) [m], from 0 on.
        discs: as for `plane`.
        boxes: as for `plane`.
        polygons: as for `plane`.
        bounds: lowest and highest joint angles, shape (2, n) [rad]; from -pi to pi without it.

    Raises:
        ValueError: as `plane`.
    """
    links = vector("lengths", lengths, (None,), low=POSITIVE, unit="m")
    count("len(lengths)", links.size, 1)
    thick = vector("radius", radius, (), (links.size,), low=0.0, unit="m")
    turn = [[-math.pi] * links.size, [math.pi] * links.size] if bounds is None else bounds
    limits = box("bounds", vector("bounds", turn, (2, links.size), unit="rad"))
    body = np.column_stack((links, np.broadcast_to(thick, links.shape)))
    return World(
        "planar arm",
        limits,
        _plane_obstacles(discs, boxes, polygons),
        body,
        _arm_state,
        _arm_edge,
        _arm_clearance,
    )


def from_function(valid: Callable[[Array], bool], bounds: ArrayLike, resolution: float) -> World:
    """Return a world known only by a function of Python.

    An edge is tried at points no farther apart than `resolution`, its ends among them: what is
    thinner can be passed through, and `check_path` judges such a path at the same points.

    Args:
        valid: state (n,) -> whether it is free; what it raises comes out of `plan`.
        bounds: lowest and highest state, rows, shape (2, n).
        resolution: largest distance of two states tried, in the unit of a state.
    """
    if not callable(valid):
        raise invalid("valid", valid, "a function of a state")
    spacing = positive("resolution", resolution)
    number = np.array([[float(Asked(valid).number)]])
    return World(
        "function",
        box("bounds", bounds),
        number,
        np.array([[spacing]]),
        _function_state,
        _function_edge,
        _function_clearance,
    )


def function_behind(world: World) -> Asked | None:
    """Return the function behind a world of kind "function"; None for the others."""
    return Asked.known[int(world.obstacles[0, 0])] if world.kind == "function" else None


def warm() -> None:
    """Compile, or load from the cache, the tests of the worlds of this file."""
    for world in (
        plane([[0, 0], [1, 1]]),
        planar_arm([1.0]),
        from_function(np.all, [[0.0], [1.0]], 1.0),
    ):
        assert world.kernels
        compiled(world.clearance, CLEARANCE)
