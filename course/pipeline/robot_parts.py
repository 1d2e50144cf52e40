"""The parts of a pick-and-place robot, each computed by the compiled code of its chapter.

A function here has the arguments of an exercise, such as `rrt_connect`, and calls the loop of the
chapter that the exercise belongs to. The camera, the clearances and the ticks of a motion are loops
of their own. So 200 tasks of `drills robot` take seconds where no part is the learner's.
`tests/drills/robot/test_compiled.py` compares every function with the worked answer or the NumPy
code that it replaces.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import NDArray

from course import kinematics, perception, planning
from course.compiled import MATRIX, VECTOR, loop
from course.contact.models import pgs_sweep
from course.control import friction_compensation
from course.control import lqr as regulator
from course.control.tracking import two_link_torque
from course.kinematics import TwoLink
from course.kinematics.inverse import METHODS, step
from course.kinematics.two_link import accelerations
from course.perception.cloud import _ransac_loop as ransac_loop
from course.perception.registration import _NO_PARTS, solids
from course.perception.registration import _icp_loop as icp_loop
from course.pipeline.theory import look_limit, look_noise
from course.planning import worlds
from course.rigid_body.integrators import velocity_verlet

Array = NDArray[np.float64]

_INDICES = types.Array(numba.int64, 1, "C")
_FLAGS = types.Array(numba.boolean, 1, "C")
_CUBE = types.Array(numba.float64, 3, "C")
_DAMPED = METHODS.index("damped")
_TOUCH = 1e-9  # m, the gap at which an edge ends


# --- the world ------------------------------------------------------------------------------------


def _render(rays, eye, poses, planes, depth):
    """Lower the depth of each pixel to the nearest body's; poses are rows (x, y, cos, sin, r)."""
    for i in range(rays.shape[1]):
        far = depth[i]
        u, v, w = rays[0, i], rays[1, i], rays[2, i]
        # Where the ray meets the table.
        ground = -eye[2] / w
        x, y = eye[0] + ground * u, eye[1] + ground * v
        for k in range(poses.shape[0]):
            dx, dy = x - poses[k, 0], y - poses[k, 1]
            # Over the height of the body the ray moves sideways: farther away it can't meet it.
            room = poses[k, 4] - planes[k, 0, 3] * math.sqrt(u * u + v * v) / w
            if dx * dx + dy * dy > room * room:
                continue
            c, s = poses[k, 2], poses[k, 3]
            ex, ey = eye[0] - poses[k, 0], eye[1] - poses[k, 1]
            px, py, pz = c * ex + s * ey, c * ey - s * ex, eye[2]
            ax, ay = c * u + s * v, c * v - s * u
            # Clip the ray by each plane: the last entry before the first exit.
            entry, leave = -np.inf, np.inf
            for f in range(planes.shape[1]):
                nx, ny, nz = planes[k, f, 0], planes[k, f, 1], planes[k, f, 2]
                slope = nx * ax + ny * ay + nz * w
                reach = planes[k, f, 3] - (nx * px + ny * py + nz * pz)
                if slope < 0.0:
                    entry = max(entry, reach / slope)
                elif slope > 0.0:
                    leave = min(leave, reach / slope)
            if entry <= leave:
                far = min(far, entry)
        depth[i] = far


render_depths = loop(_render, numba.void(MATRIX, VECTOR, MATRIX, _CUBE, VECTOR))


def _gaps(obstacles, body, q, out):
    for i in range(q.shape[0]):
        out[i] = worlds.arm_gap(obstacles, body, q[i])


_gaps_loop = loop(_gaps, numba.void(MATRIX, MATRIX, MATRIX, VECTOR))


def _discs(rows: Array) -> Array:
    """Return discs (x, y, radius) as obstacles of a `planning.World`."""
    result = np.zeros((len(rows), 5))
    result[:, 0], result[:, 1:4] = worlds.DISC, rows
    return result


def clearance(lengths: tuple[float, float], posts: Array, q: Array) -> Array:
    """Return the clearance between the arm and the nearest post in each posture.

    Args:
        lengths: of the two links [m].
        posts: one a row, x, y and radius [m], shape (k, 3).
        q: joint angles [rad], shape (n, 2) or (2,).

    Returns:
        Clearances, shape (n,) [m]; infinite without posts.
    """
    postures = np.ascontiguousarray(np.atleast_2d(q), dtype=float)
    out = np.empty(len(postures))
    _gaps_loop(_discs(posts), np.array([[length, 0.0] for length in lengths]), postures, out)
    return out


def _nearest(points, model, index):
    for i in range(points.shape[1]):
        best = np.inf
        for k in range(model.shape[1]):
            x, y = points[0, i] - model[0, k], points[1, i] - model[1, k]
            z = points[2, i] - model[2, k]
            square = x * x + y * y + z * z
            if square < best:
                best, index[i] = square, k


_nearest_loop = loop(_nearest, numba.void(MATRIX, MATRIX, _INDICES))


def nearest(points: Array, model: Array) -> Array:
    """Return the model point nearest to each point, both (3, ...) [m]; shape of the points."""
    index = np.zeros(points.shape[1], np.int64)
    _nearest_loop(np.ascontiguousarray(points), model, index)
    return np.asarray(model[:, index])


def _clear(points, model, faces, crease, out):
    near = np.empty(5)
    for i in range(points.shape[1]):
        near[:] = np.inf
        for k in range(model.shape[1]):
            x, y = points[0, i] - model[0, k], points[1, i] - model[1, k]
            z = points[2, i] - model[2, k]
            near[faces[k]] = min(near[faces[k]], x * x + y * y + z * z)
        # The two nearest faces.
        first, second = np.inf, np.inf
        for square in near:
            if square < first:
                first, second = square, first
            elif square < second:
                second = square
        out[i] = math.sqrt(second) - math.sqrt(first) > crease


_clear_loop = loop(_clear, numba.void(MATRIX, MATRIX, _INDICES, numba.float64, _FLAGS))


def on_a_face(points: Array, model: Array, faces: Array, crease: float) -> NDArray[np.bool_]:
    """Return which points clearly belong to one of the part's five faces.

    Args:
        points: shape (3, n) [m].
        model: points of the part, shape (3, k) [m].
        faces: number of the face of each model point, from 0, shape (k,).
        crease: by how much farther the second nearest face must be [m].
    """
    out = np.zeros(points.shape[1], np.bool_)
    _clear_loop(np.ascontiguousarray(points), model, faces, crease, out)
    return out


# --- control and physics: a whole motion at once --------------------------------------------------


@register_jitable
def _frozen(q, v, params):
    """Return accelerations with the friction and the rates of the tick's start, rows 13 and 14."""
    a1, a2 = accelerations(q[0, 0], q[1, 0], params[13, 0], params[14, 0], params, 0)
    result = np.empty_like(v)
    result[0, 0], result[1, 0] = a1, a2
    return result


@register_jitable
def _law(model, reference, kp, kd, q1, q2, v1, v2):
    """Return computed torques; at a reference at rest they are those that hold the arm."""
    a1 = reference[2, 0] + kd[0] * (reference[1, 0] - v1) + kp[0] * (reference[0, 0] - q1)
    a2 = reference[2, 1] + kd[1] * (reference[1, 1] - v2) + kp[1] * (reference[0, 1] - q2)
    return two_link_torque(model, 0, q1, q2, v1, v2, a1, a2)


@register_jitable
def _friction(friction, joint, v):
    """Return the friction of a joint; rows: dry [N m], viscous [N m s/rad], transition [rad/s]."""
    return friction[0, joint] * math.tanh(v / friction[2, joint]) + friction[1, joint] * v


@register_jitable
def _torques(model, known, reference, gains, q1, q2, v1, v2):
    """Return computed torques and those against the `known` friction at the reference's rates."""
    u1, u2 = _law(model, reference, gains[0], gains[1], q1, q2, v1, v2)
    u1 += _friction(known, 0, reference[1, 0])
    return u1, u2 + _friction(known, 1, reference[1, 1])


def _drive(
    model, known, body, dry, motor, gains, limits, tick, references, noise, state, queue, out
):
    """Play the ticks of a motion; `state` is (q, v) in columns, `queue` torques on their way."""
    q, v = state[:2].copy(), state[2:].copy()
    params = body.copy()
    late = queue.shape[0]
    for i in range(references.shape[0]):
        q1, q2 = q[0, 0] + noise[i, 0], q[1, 0] + noise[i, 1]
        u1, u2 = _torques(model, known, references[i], gains, q1, q2, v[0, 0], v[1, 0])
        u1 = min(max(u1, -limits[0]), limits[0])
        u2 = min(max(u2, -limits[1]), limits[1])
        # The oldest torque of the queue takes effect.
        if late > 0:
            w1, w2 = queue[i % late, 0], queue[i % late, 1]
            queue[i % late, 0], queue[i % late, 1] = u1, u2
            u1, u2 = w1, w2
        # Viscous friction is in the arm's own equations.
        params[11, 0] = motor * u1 - _friction(dry, 0, v[0, 0])
        params[12, 0] = motor * u2 - _friction(dry, 1, v[1, 0])
        params[13, 0], params[14, 0] = v[0, 0], v[1, 0]
        q, v = velocity_verlet(q, v, _frozen, tick, params)
        out[i, 0], out[i, 1] = q[0, 0], q[1, 0]
    state[:2], state[2:] = q, v


drive_arm = loop(
    _drive,
    numba.void(
        MATRIX,
        MATRIX,
        MATRIX,
        MATRIX,
        numba.float64,
        MATRIX,
        VECTOR,
        numba.float64,
        _CUBE,
        MATRIX,
        MATRIX,
        MATRIX,
        MATRIX,
    ),
)


def _command(model, known, gains, references, out):
    for i in range(references.shape[0]):
        r = references[i]
        out[i, 0], out[i, 1] = _torques(model, known, r, gains, r[0, 0], r[0, 1], 0.1, 0.1)


command_arm = loop(_command, numba.void(MATRIX, MATRIX, MATRIX, _CUBE, MATRIX))


def friction_rows(coulomb: Any, viscous: Any, transition: float) -> Array:
    """Return the friction of two joints as `drive_arm` reads it, shape (3, 2)."""
    return np.array((coulomb, viscous, (transition, transition)))


@functools.cache
def arm_column(lengths: Any, masses: Any, damping: Any, payload: float, gravity: float) -> Array:
    """Return an arm as a column for the compiled loops, with two rows for its rates."""
    arm = TwoLink(lengths, masses, damping, payload=payload, gravity=gravity)
    return np.vstack((arm.column(), np.zeros((2, 1))))


# --- the parts, with the arguments of their exercises ---------------------------------------------


@functools.cache
def _camera(shape: tuple[int, int], *numbers: float) -> perception.Camera:
    return perception.Camera(shape[1], shape[0], *numbers)


def back_project(picture: Array, fx: float, fy: float, cx: float, cy: float, unit: float) -> Array:
    """Return the points of a picture with `course.perception.back_project`."""
    camera = _camera(picture.shape, fx, fy, cx, cy)
    return perception.back_project(picture * unit, camera)[0]


def plane_ransac(
    points: Array, triples: Array, tolerance: float, confidence: float
) -> tuple[Array, NDArray[np.intp], int]:
    """Return the plane with most inliers with chapter 7's loop, on the triples given."""
    plane = np.empty(4)
    cloud = np.ascontiguousarray(points)
    tried = ransac_loop(
        cloud, tolerance, np.ascontiguousarray(triples), math.log1p(-confidence), plane
    )
    inner = cloud[:, np.abs(plane[:3] @ cloud + plane[3]) <= tolerance]
    plane = perception.fit_plane(inner)
    near = np.flatnonzero(np.abs(plane[:3] @ cloud + plane[3]) <= tolerance)
    return plane, near, int(tried)


def dbscan(points: Array, eps: float, least: int) -> Array:
    """Return clusters with `course.perception.dbscan`."""
    return np.asarray(perception.dbscan(points, eps, least)[0], dtype=int)


@functools.lru_cache(maxsize=2)
def _model(points: bytes, normals: bytes) -> perception.Cloud:
    rows = (np.frombuffer(values).reshape(3, -1) for values in (points, normals))
    return perception.Cloud.of(*rows)


# Two passes of the loop are a step and a look at what it left. Nothing is too far to be matched.
_GATES, _LIMITS, _MOBILE = np.full(2, np.inf), np.array([0.0, -1.0]), np.ones(6, np.bool_)


def point_to_plane_step(points: Array, model: Array, normals: Array) -> tuple[Array, Array]:
    """Return one step of chapter 7's loop for ICP, as the motion of the points."""
    tree, n = _model(model.tobytes(), normals.tobytes()), points.shape[1]
    R, p = np.eye(3), np.zeros(3)
    room = np.zeros((n, 3)), np.zeros(n), np.zeros(n, np.int64), np.zeros((6, 6)), np.zeros(6)
    icp_loop(
        np.ascontiguousarray(points.T),
        np.zeros(n),
        tree.points,
        tree.normals,
        tree.axes,
        tree.cuts,
        *solids(_NO_PARTS),
        R,
        p,
        _GATES,
        _LIMITS,
        _MOBILE,
        1,
        *room,
    )
    # That is the pose of the model in the frame of the points: the points move the other way.
    return R.T, -R.T @ p


def visual_gain(gain: float, delay: int) -> tuple[float, float]:
    """Return the limit of a gain and the variance with chapter 11's theory of a late image."""
    limit = look_limit(delay)
    return limit, look_noise(gain, delay) if 0.0 < gain < limit else -1.0


def two_link_ik(lengths: Array, target: Array) -> Array:
    """Return both postures with `course.kinematics.two_link_ik`."""
    result = kinematics.two_link_ik(lengths, target)
    return np.array([result.q[:, 0], result.q[:, 1]])


@functools.cache
def _chain(first: float, second: float) -> kinematics.Chain:
    return TwoLink((first, second)).chain()


def geometric_jacobian(placements: Array, q: Array, tool: Array) -> Array:
    """Return the Jacobian of the tool with `course.kinematics.jacobian`."""
    return kinematics.jacobian(_chain(float(placements[1, 0, 3]), float(tool[0])), q)


def _damped(J, error, damping, dq):
    A, U = np.empty(J.shape), np.empty((J.shape[0], J.shape[0]))
    step(J, error, _DAMPED, damping, A, U, dq)


_damped_loop = loop(_damped, numba.void(MATRIX, VECTOR, numba.float64, VECTOR))


def damped_step(J: Array, error: Array, damping: float) -> Array:
    """Return a damped step with chapter 4's loop."""
    dq = np.empty(J.shape[1])
    _damped_loop(np.ascontiguousarray(J), np.ascontiguousarray(error), damping, dq)
    return dq


def _advance_edge(obstacles, body, a, b):
    # No point of the arm moves farther than the joints carry it.
    speed, reach = 0.0, 0.0
    for i in range(a.size - 1, -1, -1):
        reach += body[i, 0]
        speed += reach * abs(b[i] - a[i])
    share = 0.0
    while True:
        gap = worlds.arm_gap(obstacles, body, a + share * (b - a))
        if gap <= _TOUCH:
            return share
        if gap >= speed * (1.0 - share):
            return 1.0
        share += gap / speed


_edge_loop = loop(_advance_edge, numba.float64(MATRIX, MATRIX, VECTOR, VECTOR))


def edge_check(lengths: Array, discs: Array, a: Array, b: Array) -> float:
    """Return the free share of a motion by conservative advancement over chapter 5's gap."""
    body = np.column_stack((lengths, np.zeros(len(lengths))))
    return float(_edge_loop(_discs(discs), body, a, b))


_BOUNDS = np.array([[-10.0, -10.0], [10.0, 10.0]])  # rad; the samples say where trees grow
_PLANE = functools.cache(lambda: planning.plane(_BOUNDS))


def rrt_connect(
    start: Array, goal: Array, discs: Array, samples: Array, step: float
) -> tuple[Array, Array]:
    """Return a path with `course.planning.plan`, its trees grown towards the samples given."""
    world = replace(_PLANE(), obstacles=_discs(discs))
    solution = planning.plan(
        world, start, goal, method="rrt_connect", budget=len(samples), sampler=samples.T, step=step
    )
    nodes = solution.nodes.shape[1]
    # The nodes of both trees, one tree after the other; each begins at a root.
    roots = np.flatnonzero(solution.parents < 0)
    first = int(roots[1]) if len(roots) > 1 else 1
    sizes = np.array([first, max(nodes - first, 1)])
    return (np.zeros((0, 2)) if solution.path is None else solution.path.T.copy()), sizes


def _cut(path, obstacles, draws, out):
    """Write the shortened path into out and return its number of vertices."""
    n = path.shape[0]
    out[:n] = path
    along, cut = np.zeros(out.shape[0]), np.empty((2, 2))
    for row in range(draws.shape[0]):
        for k in range(1, n):
            along[k] = along[k - 1] + math.hypot(
                out[k, 0] - out[k - 1, 0], out[k, 1] - out[k - 1, 1]
            )
        low, high = min(draws[row, 0], draws[row, 1]), max(draws[row, 0], draws[row, 1])
        low, high = low * along[n - 1], high * along[n - 1]
        i = np.searchsorted(along[:n], low, side="right") - 1
        j = np.searchsorted(along[:n], high, side="right") - 1
        if i == j:
            continue
        for end, edge, place in ((0, i, low), (1, j, high)):
            share = (place - along[edge]) / (along[edge + 1] - along[edge])
            for c in range(2):
                cut[end, c] = out[edge, c] + share * (out[edge + 1, c] - out[edge, c])
        if worlds.segment_free(obstacles, cut[0, 0], cut[0, 1], cut[1, 0], cut[1, 1]):
            # The vertices after the cut move to behind its two ends.
            rest = out[j + 1 : n].copy()
            out[i + 1], out[i + 2] = cut[0], cut[1]
            n = i + 3 + rest.shape[0]
            out[i + 3 : n] = rest
    return n


_cut_loop = loop(_cut, numba.int64(MATRIX, MATRIX, MATRIX, MATRIX))


def shortcut(path: Array, discs: Array, draws: Array) -> Array:
    """Return a path with its corners cut at the draws given, over chapter 5's edge test."""
    out = np.empty((len(path) + 2 * len(draws), 2))
    n = _cut_loop(np.ascontiguousarray(path), _discs(discs), draws, out)
    return out[:n].copy()


def _arm_torque(lengths: Array, masses: Array, gravity: float) -> Array:
    (l1, l2), (m1, m2) = lengths.tolist(), masses.tolist()
    return arm_column((l1, l2), (m1, m2), (0.0, 0.0), 0.0, gravity)


def computed_torque(
    lengths: Array,
    masses: Array,
    gravity: float,
    q: Array,
    v: Array,
    reference: Array,
    kp: Array,
    kd: Array,
) -> Array:
    """Return computed torques with chapter 6's equations of two links."""
    model, (q1, q2), (v1, v2) = _arm_torque(lengths, masses, gravity), q.tolist(), v.tolist()
    return np.array(_law(model, reference, kp, kd, q1, q2, v1, v2))


def lqr(A: Array, B: Array, Q: Array, R: Array) -> Array:
    """Return the gain of `course.control.lqr`."""
    return regulator(A, B, Q, R).K


def rnea_planar(
    lengths: Array, masses: Array, q: Array, v: Array, a: Array, gravity: float
) -> Array:
    """Return the torques of a motion with chapter 4's equations of two links."""
    model = _arm_torque(lengths, masses, gravity)
    return np.array(two_link_torque(model, 0, *q.tolist(), *v.tolist(), *a.tolist()))


def friction_torque(v: Array, coulomb: Array, viscous: Array, transition: float) -> Array:
    """Return torques against friction with `course.control.friction_compensation`."""
    return friction_compensation(v, coulomb, viscous, transition)


def _slide(position, velocity, gravity, mu, dt, steps):
    """Step a block on a plane with one contact, solved by projected Gauss-Seidel."""
    # Rows: along the normal, then the tangent, scaled by the friction coefficient.
    A, g, w = np.zeros((2, 2)), np.zeros(2), np.zeros(2)
    A[0, 0], A[1, 1] = 1.0, mu * mu
    for _ in range(steps):
        velocity[0] += dt * gravity[0]
        velocity[1] += dt * gravity[1]
        w[0], w[1] = velocity[1] + position[1] / dt, mu * velocity[0]
        g[:] = 0.0
        # The rows do not couple, so that one sweep is exact.
        pgs_sweep(A, g, w, 2, False)
        velocity[1] += g[0]
        velocity[0] += mu * g[1]
        position[0] += dt * velocity[0]
        position[1] += dt * velocity[1]


_slide_loop = loop(
    _slide, numba.void(VECTOR, VECTOR, VECTOR, numba.float64, numba.float64, numba.int64)
)


def contact_step(
    position: Array, velocity: Array, slope: float, mu: float, dt: float, steps: int
) -> tuple[Array, Array]:
    """Return a block on a slope after some steps, its contact solved by chapter 2's sweep."""
    x, v = position.copy(), velocity.copy()
    gravity = 9.81 * np.array([math.sin(slope), -math.cos(slope)])
    _slide_loop(x, v, gravity, mu, dt, steps)
    return x, v


# By the name of the exercise. `to_the_present` and `trapezoid` have no loop of any length: for them
# the worked answers serve. `verlet` is in `drive_arm`.
FUNCTIONS: dict[str, Callable[..., Any]] = {
    "back_project": back_project,
    "plane_ransac": plane_ransac,
    "dbscan": dbscan,
    "rigid_fit": perception.rigid_fit,
    "point_to_plane_step": point_to_plane_step,
    "visual_gain": visual_gain,
    "two_link_ik": two_link_ik,
    "jacobian": geometric_jacobian,
    "damped_step": damped_step,
    "edge_check": edge_check,
    "rrt_connect": rrt_connect,
    "shortcut": shortcut,
    "computed_torque": computed_torque,
    "lqr": lqr,
    "rnea_planar": rnea_planar,
    "friction_torque": friction_torque,
    "contact_step": contact_step,
}
