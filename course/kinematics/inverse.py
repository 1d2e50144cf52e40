"""Joint positions for a pose of the tip: one loop, five steps, an honest end.

With the error e (position, and the rotation vector of what is left to turn) and the Jacobian J of
singular values s, a step is J^T e times a number, or it takes each singular direction times

    pseudo_inverse   1 / s
    damped           s / (s^2 + lambda^2)               never above 1 / (2 lambda)
    adaptive         1 / s above lambda, s / lambda^2 below it: never above 1 / lambda

(Nakamura and Hanafusa, 1986; Wampler, 1986; Maciejewski and Klein, 1988), or it solves the damped
equations with a lambda that follows success and failure (levenberg_marquardt: Marquardt, 1963). The
tip's position is in metres and its turn in radians; one of them counts as much as one of the other.

Limits hold by projection: a joint at its limit that would go beyond is held for a step, and what
oversteps is put back. A start may end in a place where no step helps; then comes the next start.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, one_of, positive, vector
from course.compiled import MATRIX, compiled
from course.kinematics.chain import LOWER, UPPER, Chain
from course.kinematics.motion import (
    ROWS,
    columns,
    frames,
    jacobian,
    null_space,
    place,
    point_of,
    product4,
    tip,
)
from course.rigid_body.quaternion import conjugate, log, product, rotate, unit_quaternion

Array = NDArray[np.float64]

METHODS = ("transpose", "pseudo_inverse", "damped", "adaptive", "levenberg_marquardt")
REASONS = ("solved", "unreachable", "stuck", "singularity", "limit", "iterations")
_TRANSPOSE, _PSEUDO, _DAMPED, _ADAPTIVE, _MARQUARDT = range(5)
_SOLVED, _UNREACHABLE, _STUCK, _SINGULAR, _LIMIT, _ITERATIONS = range(6)

_ZERO = 1e-12  # a singular value below this share of the largest is none
_NEAR = 1e-3  # and below this one, where no step helps, the place counts as singular
_STILL = 1e-13  # a step that moves no joint by more has ended [rad or m]
_PATIENCE = 6  # steps of Levenberg-Marquardt that each win less than a tenth, until it gives up


def pose_error(target: ArrayLike, pose: ArrayLike) -> Array:
    """Return the error of a pose, (7,) or (7, N), against a target, in world axes.

    The result, shape (6,) or (6, N), is the difference of the positions [m] over the shortest
    rotation from the pose to the target, as a rotation vector [rad].
    """
    t, p = (vector(s, x, (7,), (7, None)) for s, x in (("target", target), ("pose", pose)))
    turns = unit_quaternion(t[3:], "target[3:]"), unit_quaternion(p[3:], "pose[3:]")
    return np.concatenate([t[:3] - p[:3], log(product(turns[0], conjugate(turns[1])))])


# --- compiled -------------------------------------------------------------------------------------


@register_jitable
def decompose(J, A, U):
    """J = U A with orthogonal U (m, m) and rows of A (m, n) at right angles: s_i v_i^T.

    Turns pairs of rows until all are (Hestenes, 1958): small singular values keep their digits,
    which the eigenvalues of J J^T would not.
    """
    m, n = J.shape
    for i in range(m):
        for c in range(n):
            A[i, c] = J[i, c]
        for c in range(m):
            U[i, c] = 1.0 if i == c else 0.0
    # One-sided Jacobi (Hestenes, 1958): rotate pairs of rows until all are at right angles. It is
    # accurate to rounding for small singular values too.
    for _ in range(30):
        turned = False
        for i in range(m - 1):
            for j in range(i + 1, m):
                a, b, both = 0.0, 0.0, 0.0
                for x in range(n):
                    a += A[i, x] * A[i, x]
                    b += A[j, x] * A[j, x]
                    both += A[i, x] * A[j, x]
                if abs(both) <= 1e-15 * np.sqrt(a * b) + 1e-290:
                    continue
                turned = True
                # The rotation with the smaller angle, by the stable root of the quadratic.
                half = (b - a) / (2.0 * both)
                tangent = (1.0 if half >= 0.0 else -1.0) / (abs(half) + np.hypot(1.0, half))
                cosine = 1.0 / np.sqrt(1.0 + tangent * tangent)
                sine = cosine * tangent
                for x in range(n):
                    p, q = A[i, x], A[j, x]
                    A[i, x], A[j, x] = cosine * p - sine * q, sine * p + cosine * q
                for x in range(m):
                    p, q = U[x, i], U[x, j]
                    U[x, i], U[x, j] = cosine * p - sine * q, sine * p + cosine * q
        if not turned:
            break


@register_jitable
def gain(s, method, damping):
    """Return by how much a step turns the joints per error along one singular direction.

    `s` is the singular value, `method` the number of the method in METHODS.
    """
    if method == _DAMPED:
        return s / (s * s + damping * damping)
    if method == _ADAPTIVE and s < damping:
        return s / (damping * damping)
    return 1.0 / s


@register_jitable
def step(J, e, method, damping, A, U, dq):
    """Write one step into dq (n,), by the method of this number, except Levenberg-Marquardt.

    J (m, n) is the Jacobian, e (m,) the error; A (m, n) and U (m, m) are work space.
    """
    m, n = J.shape
    dq[:] = 0.0
    if method == _TRANSPOSE:
        # The length that makes the linearised error smallest along J^T e.
        for c in range(n):
            for i in range(m):
                dq[c] += J[i, c] * e[i]
        along, square = 0.0, 0.0
        for i in range(m):
            moved = 0.0
            for c in range(n):
                moved += J[i, c] * dq[c]
            along += moved * e[i]
            square += moved * moved
        for c in range(n):
            dq[c] *= along / square if square > 0.0 else 0.0
        return
    decompose(J, A, U)
    largest = 0.0
    for i in range(m):
        largest = max(largest, _length(A, i))
    for i in range(m):
        s = _length(A, i)
        # Directions of rank zero are skipped by all methods: no division by rounding noise.
        if s <= _ZERO * largest:
            continue
        desired = 0.0
        for x in range(m):
            desired += U[x, i] * e[x]
        # The rows of A are s v^T: the division by s leaves the unit vector v.
        share = gain(s, method, damping) * desired / s
        for c in range(n):
            dq[c] += share * A[i, c]


@register_jitable
def _length(A, i):
    total = 0.0
    for c in range(A.shape[1]):
        total += A[i, c] * A[i, c]
    return np.sqrt(total)


@register_jitable
def _marquardt(J, e, mu, K, y, dq):
    """Write the damped step J^T (J J^T + mu)^-1 e into dq, by Cholesky.

    K (m, m) and y (m,) are work space. (Levenberg, 1944; Marquardt, 1963; Wampler, 1986.)
    """
    m, n = J.shape
    for i in range(m):
        # Cholesky factor row by row; forward substitution goes along.
        for j in range(i + 1):
            total = mu if i == j else 0.0
            for c in range(n):
                total += J[i, c] * J[j, c]
            for c in range(j):
                total -= K[i, c] * K[j, c]
            K[i, j] = np.sqrt(total) if i == j else total / K[j, j]
        total = e[i]
        for c in range(i):
            total -= K[i, c] * y[c]
        y[i] = total / K[i, i]
    # Back substitution, then dq = J^T y.
    for back in range(m):
        i = m - 1 - back
        for c in range(i + 1, m):
            y[i] -= K[c, i] * y[c]
        y[i] /= K[i, i]
    for c in range(n):
        dq[c] = 0.0
        for i in range(m):
            dq[c] += J[i, c] * y[i]


@register_jitable
def _miss(table, q, target, k, pose, e):
    """Write the error of posture q (n, 1) into e; distance [m] and angle [rad]."""
    place(table, q, 0, pose)
    n = q.shape[0]
    for c in range(3):
        e[c] = target[c, k] - pose[n, c]
    distance = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    if e.size == 3:
        return distance, 0.0
    goal = target[3, k], target[4, k], target[5, k], target[6, k]
    # What is left to turn: the goal times the conjugate of the pose.
    real, x, y, z = product4(goal, (pose[n, 3], -pose[n, 4], -pose[n, 5], -pose[n, 6]))
    sine = np.sqrt(x * x + y * y + z * z)
    angle = 2.0 * np.arctan2(sine, abs(real))
    # Past half a turn the short way round is the other way.
    scale = 2.0 if sine < 1e-150 else angle / sine
    if real < 0.0:
        scale = -scale
    e[3], e[4], e[5] = scale * x, scale * y, scale * z
    return distance, angle


@register_jitable
def _held(table, J, e, q, held):
    """Mark the joints at a limit that would go beyond, and take them out of J; how many."""
    result = 0
    for c in range(q.shape[0]):
        pull = 0.0
        for i in range(e.size):
            pull += J[i, c] * e[i]
        low, high = table[c, LOWER], table[c, UPPER]
        # At a limit a joint is held only if J^T e, the descent direction, points beyond it.
        held[c] = (q[c, 0] <= low and pull < 0.0) or (q[c, 0] >= high and pull > 0.0)
        if held[c]:
            result += 1
            for i in range(e.size):
                J[i, c] = 0.0
    return result


def _solve(table, target, starts, method, damping, near, turn, at_most, rank):
    """Run every start (N, S, n) until one succeeds, for N targets (7, N) or (3, N).

    Args:
        table: the arm as numbers.
        target: poses of the tip, shape (7, N).
        starts: postures to start from, shape (n, N, starts).
        method: a number in METHODS.
        damping: lambda of the damped least squares.
        near: tolerance of the position [m].
        turn: tolerance of the rotation [rad].
        at_most: steps from each start.
        rank: of the arm's Jacobian where it is not singular.

    Returns:
        Postures (n, N), and in six rows: reason, distance, angle, steps, starts, cost.
    """
    n, m = table.shape[0] - 1, 6 if target.shape[0] == 7 else 3
    result, report = np.zeros((n, target.shape[1])), np.zeros((6, target.shape[1]))
    pose, J3, J = np.empty((n + 1, 7)), np.zeros((6, n, 1)), np.empty((m, n))
    A, U, K = np.empty((m, n)), np.empty((m, m)), np.empty((m, m))
    e, y, dq, held = np.empty(m), np.empty(m), np.empty(n), np.empty(n, np.bool_)
    q, trial = np.empty((n, 1)), np.empty((n, 1))
    for k in range(target.shape[1]):
        best, steps, begun = np.inf, 0, 0
        while begun < starts.shape[1]:
            # A start outside the limits is moved onto them.
            for c in range(n):
                q[c, 0] = min(max(starts[k, begun, c], table[c, LOWER]), table[c, UPPER])
            begun += 1
            distance, angle = _miss(table, q, target, k, pose, e)
            cost = distance * distance + angle * angle
            # Marquardt's mu is added to J J^T, so it starts at lambda squared.
            mu, slow, reason, stops = damping * damping, 0, _ITERATIONS, 0
            fresh = True  # J belongs to q
            for _ in range(at_most):
                if distance <= near and angle <= turn:
                    break
                # The Jacobian changes only where a step was accepted.
                if fresh:
                    columns(table, pose, n, point_of(pose, n, np.zeros(3)), J3, 0)
                    for i in range(m):
                        for c in range(n):
                            J[i, c] = J3[i, c, 0]
                    # Joints that a limit holds are taken out, as in an active-set method.
                    stops = _held(table, J, e, q, held)
                if method == _MARQUARDT:
                    _marquardt(J, e, mu, K, y, dq)
                else:
                    step(J, e, method, damping, A, U, dq)
                # Project the step on the joint limits.
                moved = 0.0
                for c in range(n):
                    trial[c, 0] = q[c, 0] + (0.0 if held[c] else dq[c])
                    trial[c, 0] = min(max(trial[c, 0], table[c, LOWER]), table[c, UPPER])
                    moved = max(moved, abs(trial[c, 0] - q[c, 0]))
                steps += 1
                if not moved > _STILL:  # nor where a step is NaN
                    reason = -1
                    break
                # Levenberg-Marquardt accepts only what lowers the error, and adapts its damping.
                missing, angled = _miss(table, trial, target, k, pose, e)
                new = missing * missing + angled * angled
                if method == _MARQUARDT:
                    # Several steps in a row that win less than a tenth end this start.
                    slow = 0 if new < 0.9 * cost else slow + 1
                    if not new < cost:
                        # Back to where the error was, with a shorter step next.
                        _miss(table, q, target, k, pose, e)
                        mu, fresh = 8.0 * mu, False
                    else:
                        mu *= 0.1
                    if slow > _PATIENCE:
                        reason = -1
                    if not new < cost:
                        if reason < 0:
                            break
                        continue
                fresh = True
                for c in range(n):
                    q[c, 0] = trial[c, 0]
                distance, angle, cost = missing, angled, new
                if reason < 0:
                    break
            # Classify the outcome.
            if distance <= near and angle <= turn:
                reason = _SOLVED
            elif reason < 0:
                # No step helps. Why: a joint at its limit, a lost rank, or too little progress.
                reason = _STUCK
                if stops > 0:
                    reason = _LIMIT
                else:
                    decompose(J, A, U)
                    largest, retained = 0.0, 0
                    for i in range(m):
                        largest = max(largest, _length(A, i))
                    for i in range(m):
                        retained += 1 if _length(A, i) > _NEAR * largest else 0
                    if retained < rank:
                        reason = _SINGULAR
            # Of several starts report the one with the smallest error.
            if begun == 1 or cost < best or reason == _SOLVED:
                best = cost
                for c in range(n):
                    result[c, k] = q[c, 0]
                report[0, k], report[1, k], report[2, k], report[5, k] = (
                    reason,
                    distance,
                    angle,
                    cost,
                )
            if reason == _SOLVED:
                break
        report[3, k], report[4, k] = steps, begun
    return result, report


@functools.cache
def kernel() -> Any:
    """Return the compiled loop."""
    starts = types.Array(numba.float64, 3, "C", readonly=True)
    whole, number = numba.int64, numba.float64
    return compiled(
        _solve,
        types.UniTuple(MATRIX, 2)(ROWS, ROWS, starts, whole, number, number, number, whole, whole),
    )


# --- the doors ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class IKResult:
    """What came of it; for N targets every attribute has N along its last axis.

    Attributes:
        q: the best posture found, within the limits, (n,) or (n, N).
        success: whether the tip is there, by forward kinematics at q.
        reason: "solved"; "unreachable": the target is farther from the base than the arm can
            stretch, or nearer than it can fold; "stuck": no step helps, or several steps in a row
            gain too little, though the Jacobian has its full rank, so another start may succeed;
            "singularity": the same, and the Jacobian has lost rank, or nearly; "limit": the same,
            and a joint is held at its limit; "iterations": they ran out. That of the best posture.
        distance, angle: from the tip at q to the target [m, rad].
        iterations: steps of all starts together.
        starts: how many were used.
    """

    q: Array
    success: Any
    reason: Any
    distance: Any
    angle: Any
    iterations: Any
    starts: Any


class Samples:
    """A table of postures `q` (n, M) of a `chain` and their poses, to start from the nearest ones.

    Near is a distance in metres, where a radian counts as a quarter of the arm's reach.
    """

    def __init__(self, chain: Chain, size: int, rng: np.random.Generator | int) -> None:
        """Draw `size` postures uniformly within the limits, and sort their poses."""
        from scipy.spatial import cKDTree

        self.chain = chain
        draws = uniform_starts(chain, count("size", size, 1), np.random.default_rng(rng))
        self.q = np.ascontiguousarray(draws.T)
        reach = chain.reach[1]
        self._scale = 0.5 * reach if np.isfinite(reach) else 1.0  # a quaternion moves half the turn
        poses = tip(chain, self.q)
        # q and -q are one rotation, so each pose is there twice.
        mirrored = np.concatenate([poses[:3], -poses[3:]])
        self._places = cKDTree(poses[:3].T)
        self._poses = cKDTree(self._points(np.concatenate([poses, mirrored], axis=1)))

    def _points(self, poses: Array) -> Array:
        return np.column_stack([poses[:3].T, self._scale * poses[3:].T])

    def nearest(self, target: Array, k: int) -> Array:
        """Return the k stored postures nearest to each of N targets, shape (N, k, n).

        Distance is measured between poses, or positions.

        In a table that is hardly larger than k a posture may come twice, as each rotation does.
        """
        count("k", k, 1, self.q.shape[1])
        if len(target) == 3:
            result = self._places.query(target.T, k)[1]
        else:
            # The mirrored half of the table stands for the same postures.
            result = self._poses.query(self._points(target), k)[1] % self.q.shape[1]
        return np.ascontiguousarray(self.q.T[np.reshape(result, (-1, k))])


def uniform_starts(chain: Chain, size: int, rng: np.random.Generator) -> Array:
    """Return postures sampled uniformly within the limits, shape (size, n).

    A joint without limits gets one turn.

    Raises:
        ValueError: for a slide without limits.
    """
    low, high = chain.lower.copy(), chain.upper.copy()
    for i in np.flatnonzero(~(np.isfinite(low) & np.isfinite(high))).tolist():
        if chain.slides[i]:
            raise invalid(f"(lower[{i}], upper[{i}])", (low[i], high[i]), "finite for a slide")
        low[i] = low[i] if np.isfinite(low[i]) else min(-np.pi, high[i] - 2.0 * np.pi)
        high[i] = high[i] if np.isfinite(high[i]) else max(np.pi, low[i] + 2.0 * np.pi)
    return low + rng.random((size, chain.n)) * (high - low)


@functools.lru_cache(maxsize=64)
def _rank(chain: Chain, rows: int) -> int:
    """Return the generic rank of the Jacobian, the largest of a few random postures."""
    draws = np.random.default_rng(0).normal(size=(chain.n, 5))
    stack = jacobian(chain, draws)[:rows].transpose(2, 0, 1)
    return int(np.linalg.matrix_rank(stack, rtol=1e-9).max())


_CHUNK = 256  # targets whose starts are drawn together


def ik(
    chain: Chain,
    target: ArrayLike,
    start: ArrayLike | Samples | None = None,
    *,
    method: str = "levenberg_marquardt",
    damping: float = 0.1,
    tolerance: tuple[float, float] = (1e-6, 1e-6),
    restarts: int = 60,
    nearest: int = 10,
    iterations: int = 100,
    rng: np.random.Generator | int = 0,
) -> IKResult:
    """Return joint positions that put the tip at a pose, within the limits.

    Args:
        chain: the arm.
        target: poses of the tip, shape (7,) or (7, N); or positions alone, (3,) or (3, N) [m].
        start: tried first: postures of shape (n,) or (n, S), or `Samples`, of which the `nearest`
            are taken; default: none.
        method: one of METHODS.
        damping: lambda; of Levenberg-Marquardt the first one.
        tolerance: distance and angle that count as there [m, rad].
        restarts: uniform draws within the limits that follow.
        nearest: starts from `Samples`.
        iterations: steps from each start, at most.
        rng: who draws, or a seed.

    Returns:
        The first posture that is there, or the best one, and why it is not.

    Raises:
        ValueError: for a target or start of another shape, a quaternion that is not unit, no start
            at all, numbers that are not finite, an unknown method.
    """
    goal = vector("target", target, (7,), (7, None), (3,), (3, None))
    single = goal.ndim == 1
    goal = np.array(goal.reshape(len(goal), -1), order="C")
    if len(goal) == 7:
        goal[3:] = unit_quaternion(goal[3:], "target[3:]")
    number = METHODS.index(one_of("method", method, METHODS))
    positive("damping", damping)
    near, turn = vector("tolerance", tolerance, (2,), low=0.0).tolist()
    count("restarts", restarts)
    count("iterations", iterations, 1)
    rng = np.random.default_rng(rng)
    given = np.empty((0, chain.n))
    if isinstance(start, Samples):
        if start.chain is not chain:
            raise invalid("start", start, "samples of this chain")
    elif start is not None:
        given = np.asarray(vector("start", start, (chain.n,), (chain.n, None)).T)
        given = np.atleast_2d(given)
    if not (isinstance(start, Samples) or len(given) or restarts):
        raise invalid("(start, restarts)", (start, restarts), "a start, or at least one restart")
    rank, parts = _rank(chain, 6 if len(goal) == 7 else 3), []
    for first in range(0, max(1, goal.shape[1]), _CHUNK):
        part = np.ascontiguousarray(goal[:, first : first + _CHUNK])
        size = part.shape[1]
        if isinstance(start, Samples):
            begin = start.nearest(part, min(count("nearest", nearest, 1), start.q.shape[1]))
        else:
            begin = np.broadcast_to(given, (size, *given.shape))
        drawn = begin[:, :0]
        if restarts:
            drawn = uniform_starts(chain, size * restarts, rng).reshape(size, restarts, chain.n)
        # With a start for all and none drawn NumPy would keep the order of the broadcast.
        starts = np.ascontiguousarray(np.concatenate([begin, drawn], axis=1))
        parts.append(
            kernel()(chain.table, part, starts, number, damping, near, turn, iterations, rank)
        )
    q, report = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
    reason = report[0].astype(np.int64)
    # Only a distance that no posture has is a proof that the target cannot be reached.
    low, far = chain.reach
    away = np.hypot.reduce(goal[:3] - chain.placement[:3, chain.path()[:1]], axis=0)
    outside = (away > far + near) | (away < low - near)
    reason[outside & (reason != _SOLVED)] = _UNREACHABLE
    names = np.array(REASONS)[reason]
    result: list[Any] = [q, reason == _SOLVED, names, report[1], report[2]]
    result += [report[3].astype(np.int64), report[4].astype(np.int64)]
    if single:
        result = [q[:, 0], *(value[0].item() for value in result[1:])]
    return IKResult(*result)


# --- what is left to choose -----------------------------------------------------------------------


def elbow_height(chain: Chain, q: ArrayLike, joint: int = 3) -> tuple[float, Array]:
    """Return the height of a joint's frame [m], and its gradient by the joints, shape (n,)."""
    slope = jacobian(chain, vector("q", q, (chain.n,)), joint=joint)[2]
    return float(frames(chain, q)[2, joint]), slope


def mid_range(chain: Chain, q: ArrayLike) -> tuple[float, Array]:
    """Return minus half the sum of squared distances from mid-range, and its gradient.

    Distances are in half ranges.

    Joints without limits, or without a range, do not count.
    """
    (q,) = (vector("q", q, (chain.n,)),)
    ranges = chain.upper - chain.lower
    counts = np.isfinite(ranges) & (ranges > 0.0)
    # Joints that do not count get an infinite half range, so they add nothing to the gradient.
    half = np.where(counts, 0.5 * ranges, np.inf)
    share = np.where(counts, (q - np.nan_to_num(chain.lower)) / half - 1.0, 0.0)
    return float(-0.5 * share @ share), -share / half


def disc_distance(
    chain: Chain, q: ArrayLike, centre: ArrayLike, radius: float
) -> tuple[float, Array]:
    """Return the arm's signed distance from a disc in the x-y plane [m], and its gradient (n,).

    The arm is the lines from joint to joint to tip. The distance is negative where a line cuts the
    disc. The gradient jumps where another line becomes the nearest.
    """
    middle = vector("centre", centre, (2,), unit="m")
    finite("radius", radius, 0.0, unit="m")
    joints, pose = chain.path(), frames(chain, vector("q", q, (chain.n,)))
    points = np.column_stack([pose[:3, joints], tip(chain, q)[:3]])
    lines = np.diff(points, axis=1)
    # Nearest point of each link's segment to the axis of the disc.
    square = np.maximum(np.sum(lines[:2] ** 2, axis=0), 1e-300)
    share = np.clip(np.sum((middle[:, None] - points[:2, :-1]) * lines[:2], axis=0) / square, 0, 1)
    nearest = points[:, :-1] + share * lines
    away = nearest[:2] - middle[:, None]
    distance = np.hypot(*away)
    i = int(np.argmin(distance))
    joint = joints[i]
    # Envelope theorem: for the gradient the nearest point may be taken as fixed to its link.
    local = rotate(conjugate(pose[3:, joint]), nearest[:, i] - pose[:3, joint])
    unit = away[:, i] / max(float(distance[i]), 1e-300)
    return float(distance[i] - radius), unit @ jacobian(chain, q, local, joint=joint)[:2]


def null_space_step(
    chain: Chain, q: ArrayLike, gradient: ArrayLike, length: float, *, rows: int = 6
) -> Array:
    """Return a posture a step farther along a gradient, as far as the task's null space allows.

    The tip moves by c length^2, as the null space turns on the way; one step of `ik` from there
    takes it back.

    Args:
        chain: the arm.
        q: its posture, shape (n,).
        gradient: of an objective, shape (n,).
        length: of the step, Euclidean [rad]; negative to go down. None is made where the gradient
            has no part in the null space.
        rows: that the task has, 6, or 3 for the position alone.
    """
    (q,) = (vector("q", q, (chain.n,)),)
    count("rows", rows, 1, 6)
    # Project the gradient on the null space, and make the step as long as asked.
    slope = null_space(jacobian(chain, q)[:rows]) @ vector("gradient", gradient, (chain.n,))
    size = float(np.linalg.norm(slope))
    # No part of the gradient lies in the null space: the posture stays.
    if size <= 1e-12 * float(np.linalg.norm(gradient)):
        return q.copy()
    return np.asarray(q + finite("length", length) / size * slope)
