"""Planning on a constraint manifold: an arm that carries a cup upright (CBiRRT).

The allowed configurations are those whose cup axis u(q) = R(q) a is vertical. That takes away two
of seven degrees of freedom, so they form a surface of five dimensions that a random configuration
never hits. CBiRRT grows two trees on it: each step goes a little towards a random configuration and
is then projected back (`constrain_config`), and the edge between two projected states is straight.

Such a chord leaves the surface. How far is bounded without any sampling: the second derivative of u
with respect to joints i and j is z_i x (z_j x u), which is no longer than 1. So along a chord dq
the second derivative of u is at most (sum |dq_k|)^2. A function that is 0 at both ends and whose
second derivative is at most C stays below C / 8 between them. `chord_tilt` is that bound, and
`constrained_extend` ends before an edge that exceeds the allowed tilt.

The cup itself is no obstacle here.

Sources: Berenson, Srinivasa, Ferguson and Kuffner (2009), Manipulation planning on constraint
manifolds; Berenson, Srinivasa and Kuffner (2011), Task space regions.
"""

from __future__ import annotations

import functools
import math
import time
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, positive, vector
from course.compiled import MATRIX, VECTOR, compiled
from course.kinematics import Chain, tip
from course.kinematics.motion import axis_of, four, place, turned
from course.planning.problem import GOAL_BLOCKED, NO_SAMPLES, SOLVED, START_BLOCKED, Plan, length
from course.planning.worlds import EDGE, World, state_free
from course.rigid_body.quaternion import rotate

Array = NDArray[np.float64]

# The cup stands along the hand's -x: at a shelf the hand points forward with its wide side level.
CUP = (-1.0, 0.0, 0.0)
PROJECTED = 1e-6  # tilt of a projected configuration, at most [rad]
ROUNDS = 30  # of Newton's method; it needs about five
STEP = 0.2  # of an extension before its projection [rad]
TILT = math.radians(1.0)  # of the cup, along edges
PROGRESS = 0.1  # share of a step by which its projection must come nearer to the target
LONGEST = 1000  # states of one extension


# --- the constraint -------------------------------------------------------------------------------


def cup_axis(chain: Chain, q: ArrayLike, axis: ArrayLike = CUP) -> Array:
    """Return the direction of the cup's axis in the world, shape (3,) or (3, N).

    Args:
        chain: the arm; its tool carries the cup.
        q: joint positions, shape (n,) or (n, N) [rad].
        axis: of the cup in the tool's frame, a unit vector, shape (3,).
    """
    pose = tip(chain, q)
    a = vector("axis", axis, (3,))
    return np.asarray(rotate(pose[3:], a if pose.ndim == 1 else np.tile(a[:, None], pose.shape[1])))


def tilt(chain: Chain, q: ArrayLike, axis: ArrayLike = CUP) -> Any:
    """Return the angle of the cup's axis from the vertical, a number or (N,) [rad].

    Arguments and errors as for `cup_axis`.
    """
    u = cup_axis(chain, q, axis)
    return np.arctan2(np.hypot(u[0], u[1]), u[2])


def chord_tilt(a: ArrayLike, b: ArrayLike) -> Any:
    """Return a bound of the tilt along the straight edge between two upright configurations [rad].

    The horizontal part of the axis, the sine of the tilt, is 0 at both ends and its second
    derivative at most the square of the sum of all joint motions, so it is at most an eighth of
    that. True for any arm of turning joints.

    Args:
        a: configuration, shape (n,) or (n, N) [rad].
        b: the other end, likewise.

    Returns:
        A number or (N,); a right angle where the bound says nothing.
    """
    moved = np.sum(np.abs(np.asarray(b, dtype=float) - np.asarray(a, dtype=float)), axis=0)
    return np.arcsin(np.minimum(0.125 * moved**2, 1.0))


@register_jitable
def _displacement(body, q, axis, pose, J):
    """Return the tilt, write the Jacobian's two rows into J and the missing rotation into row 2.

    The rotation that makes the axis upright is about a horizontal line: two numbers suffice.
    """
    n = q.size
    place(body[: n + 1], q.reshape(n, 1), 0, pose)
    u = turned(four(pose, n, 3), (axis[0], axis[1], axis[2]))
    sine = math.hypot(u[0], u[1])
    angle = math.atan2(sine, u[2])
    # u x z = (u_y, -u_x, 0): the direction about which to turn, times the sine.
    scale = angle / sine if sine > 0.0 else 1.0
    J[2, 0], J[2, 1] = scale * u[1], -scale * u[0]
    for k in range(n):
        z = axis_of(pose, k)
        J[0, k], J[1, k] = z[0], z[1]
    return angle


@register_jitable
def _constrain_config(body, bounds, axis, q, tolerance, pose, J):
    """Project q in place (ConstrainConfig of Berenson et al.); return whether that succeeded."""
    for _ in range(ROUNDS):
        angle = _displacement(body, q, axis, pose, J)
        if angle <= tolerance:
            for k in range(q.size):
                if q[k] < bounds[0, k] or q[k] > bounds[1, k]:
                    return False
            return True
        # The shortest joint motion with this rotation: dq = J' (J J')^-1 e, a system of two rows.
        a = b = d = 0.0
        for k in range(q.size):
            a += J[0, k] * J[0, k]
            b += J[0, k] * J[1, k]
            d += J[1, k] * J[1, k]
        area = a * d - b * b
        if area < 1e-9 * (a + d) ** 2:
            return False  # singular: no joint turns the cup about some horizontal line
        x, y = (d * J[2, 0] - b * J[2, 1]) / area, (a * J[2, 1] - b * J[2, 0]) / area
        for k in range(q.size):
            q[k] += J[0, k] * x + J[1, k] * y
    return False


def _project(body, bounds, axis, q, tolerance):
    return _constrain_config(
        body, bounds, axis, q, tolerance, np.empty((q.size + 1, 7)), np.empty((3, q.size))
    )


def _measure(body, q, axis, J):
    return _displacement(body, q, axis, np.empty((q.size + 1, 7)), J)


def _extend(obstacles, body, bounds, axis, edge, near, target, step, allowed, tolerance, out):
    """Write the states of an extension into rows of `out`; return how many, and the edge checks."""
    n, size, checks = near.size, 0, 0
    pose, J, q = np.empty((n + 1, 7)), np.empty((3, n)), np.empty(n)
    old = near.copy()
    before = math.sqrt(np.sum((target - old) ** 2))
    while size < out.shape[0] and before > 0.0:
        # A step towards the target, then back to the manifold. A tenth of what the bound allows is
        # left for the projection, which makes the step a little longer.
        share = min(1.0, step / before)
        share = min(share, 0.9 * math.sqrt(8.0 * allowed) / np.sum(np.abs(target - old)))
        for k in range(n):
            q[k] = target[k] if share == 1.0 else old[k] + share * (target[k] - old[k])
        if not _constrain_config(body, bounds, axis, q, tolerance, pose, J):
            break
        # The projection may undo the step: go on only while the target comes nearer, by more than a
        # small share of the step. Otherwise the walk creeps to the nearest point of the manifold.
        distance = math.sqrt(np.sum((target - q) ** 2))
        if distance > before * (1.0 - PROGRESS * share):
            break
        # The chord must certainly keep the cup upright, and it must certainly be free.
        moved = np.sum(np.abs(q - old))
        if 0.125 * moved * moved > allowed:
            break
        checks += 1
        if not edge(obstacles, body, old, q):
            break
        out[size], old[:], before = q, q, distance
        size += 1
    return size, checks


@functools.cache
def kernels() -> tuple[Any, Any, Any]:
    """Return the compiled projection, extension and displacement."""
    real = numba.float64
    project = compiled(_project, types.boolean(MATRIX, MATRIX, VECTOR, VECTOR, real))
    pair = types.UniTuple(numba.int64, 2)
    extend = compiled(
        _extend,
        pair(
            *(MATRIX, MATRIX, MATRIX, VECTOR, types.FunctionType(EDGE), VECTOR, VECTOR),
            *(real, real, real, MATRIX),
        ),
    )
    measure = compiled(_measure, real(MATRIX, VECTOR, VECTOR, MATRIX))
    return project, extend, measure


def _turning(world: World) -> None:
    if world.kind != "capsule arm":
        raise invalid("world.kind", world.kind, "'capsule arm'")


def constrain_config(
    world: World, q: ArrayLike, axis: ArrayLike = CUP, tolerance: float = PROJECTED
) -> Array | None:
    """Project a configuration onto those with an upright cup (Berenson et al., 2009).

    Newton's method with the pseudo-inverse: every round turns the cup upright by the shortest joint
    motion, to first order.

    Args:
        world: of `capsule_arm`; only the arm and its limits are used.
        q: joint positions, shape (n,) [rad].
        axis: of the cup in the tool's frame, shape (3,).
        tolerance: of the result's tilt [rad].

    Returns:
        The configuration, shape (n,), or None where the method does not converge, meets a
        singularity or ends outside of the joint limits.

    Raises:
        ValueError: for another world, shape or a tolerance that is not positive.
    """
    _turning(world)
    result = np.array(vector("q", q, (world.dim,)))
    a = np.ascontiguousarray(vector("axis", axis, (3,)))
    close = positive("tolerance", tolerance, unit="rad")
    done = kernels()[0](world.body, world.bounds, a, result, close)
    return result if done else None


def constrained_extend(
    world: World,
    near: ArrayLike,
    target: ArrayLike,
    *,
    axis: ArrayLike = CUP,
    step: float = STEP,
    allowed: float = TILT,
    tolerance: float = PROJECTED,
) -> tuple[Array, int]:
    """Walk along the manifold towards a configuration, each step projected (Berenson et al., 2009).

    Args:
        world: of `capsule_arm`; its edge check proves each chord free.
        near: an upright configuration, shape (n,) [rad].
        target: any configuration, shape (n,) [rad].
        axis: of the cup in the tool's frame, shape (3,).
        step: before the projection, Euclidean [rad].
        allowed: tilt along a chord, by the bound of `chord_tilt`, at most a right angle [rad].
        tolerance: of the states' tilt [rad].

    Returns:
        The new states as rows, shape (k, n), the last one the target's copy if it was reached; and
        how many edges were checked.

    Raises:
        ValueError: for another world, shape, or numbers out of range.
    """
    _turning(world)
    shape = (world.dim,)
    begin, aim = (
        np.ascontiguousarray(vector(*p, shape)) for p in (("near", near), ("target", target))
    )
    a = np.ascontiguousarray(vector("axis", axis, (3,)))
    limit = _sine(allowed)
    out = np.empty((LONGEST, world.dim))
    size, checks = kernels()[1](
        *(world.obstacles, world.body, world.bounds, a, world.kernels[1], begin, aim),
        *(positive("step", step, unit="rad"), limit, positive("tolerance", tolerance), out),
    )
    return out[:size].copy(), int(checks)


def _sine(allowed: float) -> float:
    """Return the sine of the tilt that is allowed; at a right angle the bound rejects nothing."""
    angle = finite("allowed", allowed, 0.0, 0.5 * math.pi, unit="rad")
    return math.sin(angle) if angle < 0.5 * math.pi else math.inf


# --- the planner ----------------------------------------------------------------------------------


class _Tree:
    """States on the manifold as rows, each with the number of its parent."""

    def __init__(self, root: Array) -> None:
        self.rows = np.empty((256, root.size))
        self.parents = [-1]
        self.rows[0] = root

    def nearest(self, q: Array) -> int:
        rows = self.rows[: len(self.parents)]
        return int(np.argmin(np.sum((rows - q) ** 2, axis=1)))

    def add(self, parent: int, states: Array) -> int:
        """Add a chain of states behind a node and return the number of the last one."""
        while len(self.parents) + len(states) > len(self.rows):
            self.rows = np.concatenate((self.rows, np.empty_like(self.rows)))
        for q in states:
            self.rows[len(self.parents)] = q
            self.parents.append(parent)
            parent = len(self.parents) - 1
        return parent

    def branch(self, node: int) -> list[Array]:
        """Return the states from the root to a node."""
        rows = []
        while node >= 0:
            rows.append(self.rows[node])
            node = self.parents[node]
        return rows[::-1]


def cbirrt(
    world: World,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    axis: ArrayLike = CUP,
    step: float = STEP,
    allowed: float = TILT,
    tolerance: float = PROJECTED,
    samples: int = 2000,
    rng: np.random.Generator | int = 0,
) -> Plan:
    """Plan with two trees on the manifold of the upright cup (CBiRRT, Berenson et al., 2009).

    Args:
        world: of `capsule_arm`.
        start: upright configuration, shape (n,) [rad].
        goal: likewise.
        axis: of the cup in the tool's frame, shape (3,).
        step: of an extension before its projection [rad].
        allowed: tilt that the bound of `chord_tilt` must prove along every edge; pi / 2 switches
            the proof off [rad].
        tolerance: of the states' tilt [rad].
        samples: targets at most.
        rng: random numbers, or a seed.

    Returns:
        The plan. Its path's states are upright within `tolerance`, and the straight edges between
        them are proved free and tilted by less than `allowed` + `tolerance`.

    Raises:
        ValueError: for wrong shapes or numbers, or a start or goal that is not upright.
    """
    _turning(world)
    begun = time.perf_counter()
    a = np.ascontiguousarray(vector("axis", axis, (3,)))
    upright = positive("tolerance", tolerance, unit="rad")
    limit, pace = _sine(allowed), positive("step", step, unit="rad")
    most = count("samples", samples, 1)
    generator = rng if isinstance(rng, np.random.Generator) else np.random.default_rng(rng)
    project, extend, _ = kernels()
    ends = []
    for name, value in (("start", start), ("goal", goal)):
        q = np.array(vector(name, value, (world.dim,)))
        # An upright state is its own projection: nothing moves.
        if (
            not project(world.body, world.bounds, a, (moved := q.copy()), upright)
            or (moved != q).any()
        ):
            raise invalid(name, q, f"within the limits, its cup tilted by at most {upright:g} rad")
        ends.append(q)
    out, edge = np.empty((LONGEST, world.dim)), world.kernels[1]
    trees, checks, number = [_Tree(q) for q in ends], 0, 0

    def answer(status: str, path: Array | None = None) -> Plan:
        nodes = np.vstack([t.rows[: len(t.parents)] for t in trees]).T
        shift = len(trees[0].parents)
        parents = trees[0].parents + [p if p < 0 else p + shift for p in trees[1].parents]
        return Plan(
            status,
            "cbirrt",
            path=path,
            cost=math.inf if path is None else length(path),
            samples=number,
            state_checks=2,
            edge_checks=checks,
            seconds=time.perf_counter() - begun,
            nodes=nodes,
            parents=np.array(parents),
        )

    for q, status in zip(ends, (START_BLOCKED, GOAL_BLOCKED), strict=True):
        if not state_free(world, q):
            return answer(status)

    def grow(tree: _Tree, target: Array) -> int:
        nonlocal checks
        near = tree.nearest(target)
        size, tried = extend(
            *(world.obstacles, world.body, world.bounds, a, edge, tree.rows[near].copy(), target),
            *(pace, limit, upright, out),
        )
        checks += tried
        return tree.add(near, out[:size])

    # The first target is the other root: the straight way costs nothing to try.
    turn, target = 0, ends[1]
    for _ in range(most):
        number += 1
        one, other = trees[turn], trees[1 - turn]
        reached = grow(one, target)
        q = one.rows[reached].copy()
        met = grow(other, q)
        if np.array_equal(other.rows[met], q):
            halves = one.branch(reached), other.branch(met)
            first, second = halves if turn == 0 else halves[::-1]
            return answer(SOLVED, np.array(first + second[::-1][1:]).T)
        turn, target = 1 - turn, np.asarray(generator.uniform(*world.bounds))
    return answer(NO_SAMPLES)


def warm() -> None:
    """Compile, or load from the cache, the projection and the extension."""
    kernels()
