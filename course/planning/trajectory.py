"""From a path to a motion: shorter, smoother, and as fast as the joints allow.

A path is waypoints joined by straight edges, one a column, shape (n, k). What may be passed is
asked of a world, or of a function `free(a, b)` of two states; every edge of a path that comes back
was asked, so a path is as sure as the test of an edge is.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, finite, invalid, one_of, positive, vector
from course.compiled import MATRIX, VECTOR, compiled, function_argument
from course.planning.worlds import CLEARANCE, EDGE, World

Array = NDArray[np.float64]
Free = Callable[[Array, Array], bool] | World
Distance = Callable[[Array], Array] | World

_CHORD = 1e-5  # by which a rounded corner may leave the chords that are checked [rad or m]


def _rows(path: ArrayLike) -> Array:
    """Return the waypoints of a path from outside as rows, which is how this file has them."""
    path = vector("path", path, (None, None))
    if not path.size:
        raise invalid("path.shape", path.shape, "(n, k): at least one state of at least one joint")
    return np.ascontiguousarray(path.T)


def _test(free: Free) -> Callable[[Array, Array], bool]:
    """Return the test of an edge that a world stands for."""
    if not isinstance(free, World):
        return free
    test, obstacles, body = compiled(free.edge_free, EDGE), free.obstacles, free.body
    return lambda a, b: bool(test(obstacles, body, a, b))


def _field(distance: Distance) -> Callable[[Array], Array]:
    """Return distances of states that are rows, shape (m, n) -> (m,)."""
    if not isinstance(distance, World):
        return lambda X: np.asarray(distance(X.T))
    # One compiled call measures all waypoints and their displaced copies.
    measure = function_argument(compiled(distance.clearance, CLEARANCE))
    count, obstacles, body = _clearances_kernel(), distance.obstacles, distance.body
    return lambda X: count(measure, obstacles, body, np.ascontiguousarray(X))


def _clearances(measure, obstacles, body, states):
    result = np.empty(states.shape[0])
    for i in range(states.shape[0]):
        result[i] = measure(obstacles, body, states[i])
    return result


@functools.cache
def _clearances_kernel() -> Any:
    return compiled(_clearances, VECTOR(types.FunctionType(CLEARANCE), MATRIX, MATRIX, MATRIX))


def _length(path: Array) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _all_free(path: Array, free: Callable[[Array, Array], bool]) -> bool:
    return all(free(a, b) for a, b in itertools.pairwise(path))


def _stations(path: Array) -> Array:
    """Return arc length from the start to each waypoint, shape (k,)."""
    return np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))


def _along(path: Array, stations: Array, places: Array) -> Array:
    """Return states at arc lengths along a path, shape (len(places), n)."""
    return np.column_stack([np.interp(places, stations, column) for column in path.T])


# --- shorter --------------------------------------------------------------------------------------


def shortcut(
    path: ArrayLike,
    free: Free,
    rng: np.random.Generator,
    *,
    rounds: int = 200,
    kind: str = "partial",
) -> Array:
    """Return a path with the same ends that is never longer and whose new edges are all free.

    "vertex" joins two waypoints. "partial" takes two places anywhere on the path and straightens
    between them either all joints or a single one, the others kept as they were (Geraerts and
    Overmars, Int. J. Robotics Research 26, 2007). One joint is straightened over arc length: by
    Jensen's inequality that can't lengthen a path, where over any other parameter it can.

    Args:
        path: shape (n, k).
        free: a world, or whether the edge between two states, each (n,), is free.
        rng: where the random numbers come from.
        rounds: how many shortcuts are tried.
        kind: "vertex" or "partial".

    Raises:
        ValueError: for a path that is not (n, k), a kind that is not there.
    """
    path, free = _rows(path), _test(free)
    stations, far = _stations(path), _length(path)
    one_of("kind", kind, ("vertex", "partial"))
    for _ in range(count("rounds", rounds)):
        if len(path) < 3:
            break
        # Vertex shortcut: join two waypoints directly (Geraerts and Overmars, 2007).
        if kind == "vertex":
            i, j = (int(k) for k in np.sort(rng.choice(len(path), 2, replace=False)))
            before, after, piece = path[:i], path[j + 1 :], path[[i, j]]
            if j - i < 2:
                continue
        else:
            # Partial shortcut: straighten one joint, or with -1 all of them, between two points of
            # the path.
            a, b = np.sort(rng.uniform(0.0, stations[-1], 2))
            inner = (stations > a) & (stations < b)
            joint = int(rng.integers(-1, path.shape[1]))
            if not inner.any():
                continue
            places = np.concatenate(([a], stations[inner], [b]))
            piece = _along(path, stations, places)
            if joint < 0:
                piece = piece[[0, -1]]
            else:
                share = (places - a) / (b - a)
                piece[:, joint] = piece[0, joint] + share * (piece[-1, joint] - piece[0, joint])
            before, after = path[stations <= a], path[stations >= b]
        # Only edges that changed are checked again.
        trial = np.vstack((before, piece, after))
        touched = trial[max(len(before) - 1, 0) : len(before) + len(piece) + 1]
        if (shorter := _length(trial)) <= far and _all_free(touched, free):
            path, stations, far = trial, _stations(trial), shorter
    return _fewer(path, free).T


def _fewer(path: Array, free: Callable[[Array, Array], bool]) -> Array:
    """Remove waypoints whose neighbours are joined by a free edge, in one pass.

    By the triangle inequality no removal lengthens the path, whatever rounding says of its length.
    """
    i = 1
    while i < len(path) - 1:
        trial = np.delete(path, i, axis=0)
        if free(trial[i - 1], trial[i]):
            path = trial
        else:
            i += 1
    return path


# --- smoother -------------------------------------------------------------------------------------


def smooth(path: ArrayLike, free: Free, *, rounds: int = 3) -> Array:
    """Return a path near a cubic B-spline, by subdivision; corners that would collide stay.

    Each round halves every edge and moves each waypoint to (1, 6, 1) / 8 of itself and its
    neighbours (Lane and Riesenfeld, IEEE PAMI 2, 1980), if both edges there are free then. It never
    lengthens the path; its ends stay.

    Args:
        path: as for `shortcut`.
        free: as for `shortcut`.
        rounds: each doubles the number of edges.
    """
    path, free = _rows(path), _test(free)
    for _ in range(count("rounds", rounds)):
        if len(path) < 3:
            break
        fine = np.empty((2 * len(path) - 1, path.shape[1]))
        fine[::2], fine[1::2] = path, 0.5 * (path[:-1] + path[1:])
        # Halves of a free edge are free, but for rounding of the middle.
        if not _all_free(fine, free):
            break
        for i in range(2, len(fine) - 1, 2):
            # Lane and Riesenfeld's rule (1, 2, 1) / 4 on the refined path, (1, 6, 1) / 8 on the old
            # one.
            moved = 0.25 * (fine[i - 1] + 2.0 * fine[i] + fine[i + 1])
            if free(fine[i - 1], moved) and free(moved, fine[i + 1]):
                fine[i] = moved
        path = fine
    return path.T


# --- out of obstacles -----------------------------------------------------------------------------


class Optimised(NamedTuple):
    """What an optimiser made of a path.

    Attributes:
        path: shape (n, points + 2).
        costs: after each iteration, shape (iterations,): smoothness and collision, weighted.
        clearance: the least distance found on it, at 8 places an edge; below 0 it is stuck.
        evaluations: states whose distance was computed.
    """

    path: Array
    costs: Array
    clearance: float
    evaluations: int


def _prepared(path: ArrayLike, points: int) -> tuple[Array, Array, Array]:
    """Return the path in equal steps, the quadratic form of its squared steps, and its ends."""
    path = _rows(path)
    N = count("points", points, 1)
    stations = _stations(path)
    X = _along(path, stations, np.linspace(0.0, stations[-1], N + 2))
    # Matrix of the squared first differences: half x^T A x - ends . x is the smoothness of the
    # inner states, whose slope is A x - ends.
    A = (N + 1) * (2.0 * np.eye(N) - np.eye(N, k=1) - np.eye(N, k=-1))
    ends = np.zeros((N, path.shape[1]))
    ends[0] += (N + 1) * X[0]
    ends[-1] += (N + 1) * X[-1]
    return X, A, ends


def _between(states: int, pieces: int) -> Array:
    """Return the matrix that maps states to points on their edges.

    Each edge has the given number of points, ends included.
    """
    places = np.arange(pieces * (states - 1) + 1) / pieces
    # Linear hat functions: each row weights the two states next to its point.
    return np.maximum(1.0 - np.abs(places[:, None] - np.arange(states)), 0.0)


def _slope(distance: Callable[[Array], Array], X: Array, step: float = 1e-6) -> Array:
    """Return the gradient of the distance at states (N, n) by central differences, (N, n)."""
    N, n = X.shape
    near = X[:, None] + np.array([step, -step])[:, None, None, None] * np.eye(n)
    d = distance(near.reshape(-1, n)).reshape(2, N, n)
    return (d[0] - d[1]) / (2.0 * step)


def _smoothness(X: Array) -> float:
    """Return half the squared speed, integrated over a time of 1."""
    return 0.5 * (len(X) - 1) * float(np.sum(np.diff(X, axis=0) ** 2))


def _optimised(
    X: Array, costs: list[float], distance: Callable[[Array], Array], requested: int
) -> Optimised:
    states = _between(len(X), 8) @ X
    return Optimised(X.T, np.array(costs), float(distance(states).min()), requested + len(states))


def covariant_gradient(
    path: ArrayLike,
    distance: Distance,
    *,
    margin: float,
    weight: float = 10.0,
    points: int = 40,
    iterations: int = 200,
    rate: float = 0.05,
) -> Optimised:
    """Push a path out of obstacles along the gradient of a distance, smoothly (CHOMP).

    The cost of a state grows from 0 at the margin on; it is summed over the length of the path, not
    over time, so running through faster does not pay. A step is measured by the smoothness, so one
    waypoint that is pushed takes its neighbours along (Zucker et al., Int. J. Robotics Research 32,
    2013). It finds a minimum near the start, which need not be free.

    Args:
        path: where to start, shape (n, k); the ends stay.
        distance: a world, or the signed distance of states (n, m) to the obstacles, shape (m,).
        margin: desired clearance [unit of the distance].
        weight: of the obstacles against the smoothness.
        points: waypoints between the ends.
        iterations: how many steps.
        rate: of a step, below 1.
    """
    X, A, ends = _prepared(path, points)
    margin, ask = positive("margin", margin), _field(distance)
    N, n = X[1:-1].shape
    inverse, costs = np.linalg.inv(A), []
    for _ in range(count("iterations", iterations, 1)):
        x = X[1:-1]
        d = ask(x)
        # CHOMP's obstacle cost: linear inside an obstacle, quadratic within the margin, 0 beyond.
        lack = np.maximum(margin - d, 0.0)
        c = np.where(d < 0.0, 0.5 * margin - d, lack**2 / (2.0 * margin))
        # Velocity over a time of 1, by central differences. The floor on its norm protects the
        # divisions where neighbouring states coincide.
        v = 0.5 * (N + 1) * (X[2:] - X[:-2])
        speed = np.maximum(np.linalg.norm(v, axis=1), 1e-9)[:, None]
        # The speed weights the cost by arc length, so that hurrying through an obstacle is no gain.
        bend = (N + 1) ** 2 * (X[2:] - 2.0 * x + X[:-2]) / speed**2
        # Along the path neither the slope of the cost nor the curvature counts.
        push = -np.minimum(lack / margin, 1.0)[:, None] * _slope(ask, x) - c[:, None] * bend
        push -= np.sum(push * v, axis=1, keepdims=True) * v / speed**2
        costs.append(_smoothness(X) + weight * float(c @ speed[:, 0]) / (N + 1))
        # Covariant step: the inverse of A spreads each push smoothly over the path (Zucker et al.,
        # 2013).
        X[1:-1] = x - rate * inverse @ (A @ x - ends + weight / (N + 1) * speed * push)
    return _optimised(X, costs, ask, iterations * N * (2 * n + 1))


def sequential_convex(
    path: ArrayLike,
    distance: Distance,
    *,
    margin: float,
    points: int = 40,
    iterations: int = 60,
    penalty: float = 10.0,
) -> Optimised:
    """Return the smoothest path nearby that keeps a margin.

    It takes convex steps with hinge costs (TrajOpt; Schulman and others, 2014).

    Each step minimises smoothness + penalty * sum of max(0, margin - linearised distance) over the
    waypoints and the middles of edges, held near the last one; a step that does not bring what it
    promised is taken back and made shorter, and the penalty grows while the margin is not kept
    (Schulman et al., Int. J. Robotics Research 33, 2014). The hinges' forces lie between 0 and the
    penalty: the dual is a least-squares problem in a box.

    Args:
        path: as for `covariant_gradient`.
        distance: as for `covariant_gradient`.
        margin: as for `covariant_gradient`.
        points: as for `covariant_gradient`.
        iterations: convex steps at most.
        penalty: of the hinges at first.
    """
    from scipy.optimize import lsq_linear

    X, A, ends = _prepared(path, points)
    margin, mu, near = positive("margin", margin), positive("penalty", penalty), 1.0
    ask, N = _field(distance), count("points", points, 1)
    # Hinges act at the waypoints and at the middles of edges, without the two fixed ends.
    S = _between(N + 2, 2)[1:-1]
    inner = S[:, 1:-1]

    def lack(d: Array) -> float:
        return float(np.maximum(margin - d, 0.0).sum())

    d, costs, requested = ask(S @ X), [], len(S)
    for _ in range(count("iterations", iterations, 1)):
        here = _smoothness(X) + mu * lack(d)
        # Only what is near: the rest is looked at again before a step is taken.
        active = np.flatnonzero(d < 3.0 * margin)
        # Linearise the distances: gradients, and the weights of the inner states at each point.
        G, J = _slope(ask, (S @ X)[active]), inner[active]
        requested += 2 * G.size
        while True:
            # Proximal step: the trust region is a quadratic penalty 1 / (2 near) on the change.
            inverse, new = np.linalg.inv(A + np.eye(N) / near), X.copy()
            new[1:-1] = inverse @ (ends + X[1:-1] / near)
            # The dual of the hinges is a box-constrained least-squares problem in their forces,
            # from 0 to mu; the small diagonal keeps the Cholesky factor of a singular matrix.
            if active.size:
                short = margin - d[active] - np.sum(G * (J @ (new - X)[1:-1]), axis=1)
                D = (J @ inverse @ J.T) * (G @ G.T)
                L = np.linalg.cholesky(D + 1e-8 * (1e-3 + D.max()) * np.eye(len(D)))
                force = lsq_linear(L.T, np.linalg.solve(L, short), (0.0, mu), method="bvls").x
                new[1:-1] += inverse @ J.T @ (G * force[:, None])
            present, requested = ask(S @ new), requested + len(S)
            # Accept by the ratio of the actual to the predicted gain, else shrink the trust region.
            promised = lack(d[active] + np.sum(G * (J @ (new - X)[1:-1]), axis=1))
            gain = here - _smoothness(new) - mu * promised
            got = here - _smoothness(new) - mu * lack(present)
            if got >= 0.25 * gain or near < 1e-6:
                break
            near *= 0.25
        if got > 0.0:
            X, d = new, present
        costs.append(_smoothness(X) + mu * lack(d))
        # Widen the trust region again for the next linearisation.
        near = min(2.0 * near, 1e3)
        # Converged for this penalty: stop if the margins hold, else raise the penalty.
        if gain <= 1e-6 * here:
            if lack(d) <= 1e-4 * margin or mu >= 1e6 * penalty:
                break
            mu *= 10.0
    return _optimised(X, costs, ask, requested)


# --- timed ----------------------------------------------------------------------------------------


class Limits(NamedTuple):
    """What each joint can do, numbers or shape (n,): rate [rad/s], acceleration [rad/s^2]."""

    velocity: Any
    acceleration: Any


def trapezoid(distance: ArrayLike, velocity: ArrayLike, acceleration: ArrayLike) -> tuple[Any, Any]:
    """Return duration and peak speed of the fastest motion from rest to rest, joint by joint.

    A trapezoid of the rate where there is room to reach the limit, else a triangle.
    """
    far = np.abs(np.asarray(distance, dtype=float))
    # A triangle reaches sqrt(distance * acceleration) before it must brake; a trapezoid the limit.
    peak = np.minimum(velocity, np.sqrt(far * acceleration))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(far > 0.0, far / peak + peak / acceleration, 0.0)[()], peak[()]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion, in m intervals of constant acceleration along a path of lines and parabolas.

    Attributes:
        times: where intervals begin, and the end, shape (m + 1,) [s].
        speeds: along the path at these times, shape (m + 1,).
        push: acceleration along the path in each interval, shape (m,).
        place, first, second: of the path where each interval begins: the state, its derivative by
            arc length and the second one, which is constant, each (m, n).
        stations: arc lengths where intervals begin, and the end, shape (m + 1,).
    """

    times: Array
    speeds: Array
    push: Array
    place: Array
    first: Array
    second: Array
    stations: Array

    @property
    def duration(self) -> float:
        """When the motion ends [s]."""
        return float(self.times[-1])

    def __call__(self, t: ArrayLike) -> Array:
        """Return the state, rate and acceleration at times (...), shape (3, n, ...).

        Before and after the motion it is at rest.
        """
        t = np.asarray(t, dtype=float)
        flat = np.clip(t.ravel(), 0.0, self.duration)
        i = np.clip(np.searchsorted(self.times, flat, side="right") - 1, 0, len(self.push) - 1)
        past = flat - self.times[i]
        # Along an interval with constant acceleration u the squared speed is linear in arc length;
        # rounding at its end may leave it below 0.
        speed = np.maximum(self.speeds[i] + self.push[i] * past, 0.0)
        # At constant acceleration the arc length is the mean speed times the time.
        r = 0.5 * (self.speeds[i] + speed) * past
        first = self.first[i].T + self.second[i].T * r
        q = self.place[i].T + 0.5 * (self.first[i].T + first) * r
        # Chain rule for the second derivative by time: q'' = first * push + second * speed^2.
        a = first * self.push[i] + self.second[i].T * speed**2
        moving = (t.ravel() >= 0.0) & (t.ravel() <= self.duration)
        return np.stack((q, first * speed * moving, a * moving)).reshape(3, -1, *t.shape)

    @functools.cached_property
    def table(self) -> Array:
        """What `state_at` reads, a row an interval and one for the end, shape (m + 1, 4 + 3 n)."""
        rows = np.column_stack((self.push, self.place, self.first, self.second))
        ends = np.column_stack((self.times, self.speeds, self.stations))
        return np.ascontiguousarray(np.hstack((ends, np.vstack((rows, rows[-1])))))

    def waypoints(self, spacing: float = 0.01) -> Array:
        """Return states on the path at most `spacing` of arc length apart, (n, k).

        The corners of the path are among them.
        """
        positive("spacing", spacing)
        pieces = [
            p + r[:, None] * (f + 0.5 * r[:, None] * c)
            for p, f, c, h in zip(
                self.place, self.first, self.second, np.diff(self.stations), strict=True
            )
            for r in [np.linspace(0.0, h, math.ceil(h / spacing) + 1)[:-1]]
        ]
        return np.vstack((*pieces, self(self.duration)[0])).T


@register_jitable
def state_at(table, t, i, out):
    """Return the state, rate and acceleration at a time t into `out` (3, n), for compiled loops.

    `table` is that of a `Trajectory`, i the interval of an earlier time. Returns the interval of
    this one, and the share of the path's length that lies behind it; at rest outside.
    """
    m, n = table.shape[0] - 1, out.shape[1]
    inside = table[0, 0] <= t <= table[m, 0]
    t = min(max(t, table[0, 0]), table[m, 0])
    # Time runs forward in a simulation, so a short walk from the last interval finds the next one.
    while i < m - 1 and t >= table[i + 1, 0]:
        i += 1
    past, push = t - table[i, 0], table[i, 3]
    speed = max(table[i, 1] + push * past, 0.0)
    r = 0.5 * (table[i, 1] + speed) * past
    for j in range(n):
        begins, bend = table[i, 4 + n + j], table[i, 4 + 2 * n + j]
        first = begins + bend * r
        out[0, j] = table[i, 4 + j] + 0.5 * (begins + first) * r
        out[1, j] = first * speed if inside else 0.0
        out[2, j] = first * push + bend * speed * speed if inside else 0.0
    length = table[m, 2]
    return i, (table[i, 2] + r) / length if length > 0.0 else 1.0


def _curve(path: Array, blend: float, free: Any, grid: int) -> tuple[Array, ...]:
    """Return pieces of the rounded path.

    Lengths (m,), states, tangents, curvatures (m, n), stops (m,).

    A corner is a parabola from `cut` before it to `cut` after it, whose tangent has length 1 at
    both ends: so it joins the lines without a jump. A stop is where a piece begins at a corner.
    """
    far = np.linalg.norm(np.diff(path, axis=0), axis=1)
    edges = np.diff(path, axis=0) / far[:, None]
    cuts = np.zeros(len(path))
    for i in range(1, len(path) - 1):
        # At most half an edge on either side, so neighbouring corners do not overlap.
        cut = min(blend, 0.5 * far[i - 1], 0.5 * far[i])
        turn = edges[i] - edges[i - 1]
        # Halve a rounding that collides, at most 12 times; after that the corner becomes a stop.
        for _ in range(12 if free is not None else 0):
            # Twice as many chords come four times as near.
            n = math.ceil(math.sqrt(0.25 * cut * float(np.linalg.norm(turn)) / _CHORD)) + 1
            s = np.linspace(0.0, 2.0 * cut, n + 1)[:, None]
            arc = path[i] - cut * edges[i - 1] + s * edges[i - 1] + 0.25 * s * s / cut * turn
            # Check the arc's chords together with the straight pieces between it and the middles of
            # its edges.
            ends = [0.5 * (path[i - 1] + path[i]), 0.5 * (path[i] + path[i + 1])]
            if cut <= 0.0 or _all_free(np.vstack((ends[0], arc, ends[1])), free):
                break
            cut *= 0.5
        else:
            cut = cut if free is None else 0.0
        cuts[i] = cut
    parts: list[tuple[Any, ...]] = []
    for i, edge in enumerate(edges):
        if i and cuts[i] > 0.0:
            h, turn = 2.0 * cuts[i] / grid, (edge - edges[i - 1]) / (2.0 * cuts[i])
            s = h * np.arange(grid)[:, None]
            # Quadratic blend: the tangent turns linearly from one edge to the next.
            place = path[i] + (s - cuts[i]) * edges[i - 1] + 0.5 * s * s * turn
            bends = np.broadcast_to(turn, place.shape)
            parts.append((np.full(grid, h), place, edges[i - 1] + s * turn, bends, [False] * grid))
        line = far[i] - cuts[i] - cuts[i + 1]
        # Two roundings may use up the edge between them; a piece without length is dropped.
        if line > 1e-12 * far[i]:
            stop = i == 0 or cuts[i] == 0.0
            parts.append(([line], [path[i] + cuts[i] * edge], [edge], [0.0 * edge], [stop]))
    return tuple(np.ascontiguousarray(np.concatenate(c)) for c in zip(*parts, strict=True))


@register_jitable
def _pushes(x, K, h, first, second, limit):
    """Return the range of the acceleration u, and its slopes, for a piece with squared speed x.

    The squared speed is x + 2 u s, the tangent first + second s: acceleration of a joint is linear
    in s, so that both ends of the piece speak for all of it.
    """
    # Squared speed must stay between 0 and K at the end of the piece.
    low, low_slope = -0.5 * x / h, -0.5 / h
    high, high_slope = 0.5 * (K - x) / h, -0.5 / h
    # Acceleration of joint j is first_j u + second_j (x + 2 u s): linear in s, so its limits hold
    # on the piece if they hold at both ends.
    for j in range(first.size):
        for factor in (first[j], first[j] + 3.0 * h * second[j]):
            if factor != 0.0:
                slope, reach = -second[j] / factor, limit[j] / abs(factor)
                if slope * x + reach < high:
                    high, high_slope = slope * x + reach, slope
                if slope * x - reach > low:
                    low, low_slope = slope * x - reach, slope
    return low, low_slope, high, high_slope


def _reach(h, first, second, cap, limit, x):
    """Squared speeds x (m + 1,) of the fastest motion; cap (m + 1,) is what rates and stops allow.

    Backwards the largest speed from which the end can be reached, forwards the largest that can be.
    """
    m, n = first.shape
    # Backward pass: the largest squared speed from which braking within the limits is possible
    # (controllable sets of TOPP-RA; Pham and Pham, 2018).
    x[m] = 0.0
    for i in range(m - 1, -1, -1):
        x[i] = cap[i]
        # A zero-inertia point (Pham, 2014): where the factor of u is 0, the joint's acceleration is
        # second * x, which limits x itself.
        for j in range(n):
            if second[i, j] != 0.0 and first[i, j] * (first[i, j] + 3.0 * h[i] * second[i, j]) == 0:
                x[i] = min(x[i], limit[j] / abs(second[i, j]))
        # The width of the range is concave in x and not negative at 0: Newton from above ends at
        # the largest x, after as many steps as there are kinks.
        for _ in range(4 * n + 4):
            low, low_slope, high, high_slope = _pushes(
                x[i], x[i + 1], h[i], first[i], second[i], limit
            )
            if low - high <= 1e-13 * (abs(low) + abs(high)) or x[i] <= 0.0:
                break
            x[i] = max(x[i] - (high - low) / (high_slope - low_slope), 0.0)
    # Forward pass: accelerate as much as the limits and the controllable sets allow.
    x[0] = 0.0
    for i in range(m):
        high = _pushes(x[i], x[i + 1], h[i], first[i], second[i], limit)[2]
        x[i + 1] = min(x[i + 1], max(x[i] + 2.0 * h[i] * high, 0.0))


@functools.cache
def _kernel() -> Any:
    return compiled(_reach, numba.void(VECTOR, MATRIX, MATRIX, VECTOR, VECTOR, VECTOR))


def time_parameterise(
    path: ArrayLike,
    limits: Limits | tuple[ArrayLike, ArrayLike],
    *,
    blend: float = 0.0,
    free: Free | None = None,
    grid: int = 16,
) -> Trajectory:
    """Return the fastest motion along a path.

    From rest to rest, that keeps the joints' limits always.

    By backward and forward reachability of the squared speed (Pham and Pham, IEEE Trans. Robotics
    34, 2018). Lines are exact: the speed along them is a trapezoid. A corner is either a stop or a
    parabola; there the speed is constrained at both ends of each interval, which bounds the
    acceleration between them exactly and the rate from above, so no limit is broken at any time.
    Because of this bound on the rate, a motion with roundings is a little slower than the fastest.

    Args:
        path: waypoints, shape (n, k).
        limits: of rate and acceleration, numbers or shape (n,).
        blend: how far from a corner its rounding begins, at most half an edge; 0 stops at each.
        free: where given, a rounding that collides is made smaller, down to a stop. Its chords are
            asked, which it leaves by at most 1e-5.
        grid: intervals of each rounding.

    Returns:
        The motion; a path of one state lasts 0 s.

    Raises:
        ValueError: for limits that are not positive, a negative blend, a path that is not (n, k).
    """
    path, n = _rows(path), len(np.asarray(path))
    v, a = (
        np.array(np.broadcast_to(vector(name, x, (), (n,), low=POSITIVE), (n,)))
        for name, x in zip(("limits.velocity", "limits.acceleration"), limits, strict=True)
    )
    finite("blend", blend, 0.0)
    step = np.linalg.norm(np.diff(path, axis=0), axis=1)
    # Repeated waypoints would make edges without a direction.
    path = path[np.concatenate(([True], step > 0.0))]
    if len(path) < 2:
        empty = np.zeros((1, n))
        return Trajectory(np.zeros(2), np.zeros(2), np.zeros(1), path, empty, empty, np.zeros(2))
    h, place, first, second, stops = _curve(
        path, blend, None if free is None else _test(free), count("grid", grid, 2)
    )
    # Rate limits: the squared path speed at which the fastest joint reaches its limit.
    with np.errstate(divide="ignore"):
        rate = np.maximum(np.abs(first), np.abs(first + h[:, None] * second))
        top = np.min(v / rate, axis=1) ** 2
        # On a straight piece the tangent alone limits the acceleration along the path.
        strength = np.min(a / np.abs(first), axis=1)
    # A station's cap is the lower one of its two pieces; stops have speed 0.
    cap = np.minimum(np.append(top, np.inf), np.append(np.inf, top))
    cap[:-1][stops] = cap[-1] = 0.0
    x = np.empty(len(cap))
    _kernel()(h, first, second, cap, a, x)
    curved = np.any(second, axis=1).tolist()
    rows = []  # arc length within the piece, squared speed there, the piece
    for i, (here, other) in enumerate(itertools.pairwise(x)):
        rows.append((0.0, here, i))
        # On a straight piece the motion may speed up to a peak and brake again within the piece.
        if not curved[i]:
            # In the phase plane the squared speed rises and falls along lines of slope 2 *
            # strength, which meet at this peak unless the rate limit cuts it off.
            peak = min(top[i], 0.5 * (here + other) + strength[i] * h[i])
            up, down = 0.5 * (peak - here) / strength[i], h[i] - 0.5 * (peak - other) / strength[i]
            # The two switching points of the trapezoid; those at an end of the piece, or equal
            # ones, add no interval.
            for at in (up, down):
                if rows[-1][0] + 1e-13 * h[i] < at < (1.0 - 1e-13) * h[i]:
                    rows.append((at, peak, i))
    r, square, piece = (np.array(column) for column in zip(*rows, strict=True))
    begins = np.concatenate(([0.0], np.cumsum(h)))
    stations = np.append(begins[piece] + r, begins[-1])
    square, w = np.append(square, 0.0), np.sqrt(np.append(square, 0.0))
    # Distance to the next station: within the same piece, or up to the end of the piece.
    gaps = np.append(np.where(np.diff(piece) > 0, h[piece[:-1]], r[1:]) - r[:-1], h[-1] - r[-1])
    # Constant acceleration between stations: u = (x1 - x0) / (2 gap), time = 2 gap / (w0 + w1).
    push = 0.5 * np.diff(square) / gaps
    times = np.concatenate(([0.0], np.cumsum(2.0 * gaps / (w[1:] + w[:-1]))))
    r = r[:, None]
    start = place[piece] + r * (first[piece] + 0.5 * r * second[piece])
    return Trajectory(
        times, w, push, start, first[piece] + r * second[piece], second[piece], stations
    )


def warm() -> None:
    """Compile, or load from the cache, the loops of this file."""
    _kernel()
    _clearances_kernel()
