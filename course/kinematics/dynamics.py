"""Torques and motion of an arm: M(q) a + bias(q, v) = tau + J^T wrench, in three recursions.

The bias holds Coriolis and centrifugal terms, gravity and the joints' damping; M holds the motors'
armature. `inverse_dynamics` is the recursive Newton-Euler algorithm (Luh, Walker and Paul, 1980),
`mass_matrix` the composite rigid body algorithm and `forward_dynamics` the articulated body
algorithm (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5-7). All work in the links' own
frames, where a joint's axis is z, so that no axis is ever multiplied with.

`acceleration(q, v, params)` makes an arm one more system of chapter 1: every integrator and every
chart of that chapter takes it. None of them is symplectic in angles and rates, whose kinetic energy
depends on q.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import positive, vector
from course.compiled import MATRIX, compiled
from course.kinematics.chain import (
    ARMATURE,
    DAMPING,
    PARENT,
    PLACE,
    SLIDES,
    TEN,
    TURN,
    WIDTH,
    Chain,
)
from course.kinematics.motion import (
    CUBE,
    ROW,
    ROWS,
    add3,
    batch,
    cross3,
    frames,
    place,
    scaled,
    three,
    turned,
)
from course.rigid_body.quaternion import rotate
from course.rigid_body.spatial import DOWNWARDS

Array = NDArray[np.float64]
_SQUARE = (0, 1, 2, 1, 3, 4, 2, 4, 5)  # of six numbers, those that a symmetric matrix consists of

# --- compiled: the parts of a step from link to link ----------------------------------------------


@register_jitable
def _link(table, q, k, E):
    """Rotation (9 numbers) and offset (3) of each link in its parent's frame, into E (n, 12)."""
    for i in range(E.shape[0]):
        row = table[i]
        if row[SLIDES] != 0.0:
            # A slide keeps the rotation of its placement and shifts along its own z axis.
            for r in range(3):
                for c in range(3):
                    E[i, 3 * r + c] = row[TURN + 3 * r + c]
                E[i, 9 + r] = row[PLACE + r] + row[TURN + 3 * r + 2] * q[i, k]
        else:
            # A turning joint multiplies its placement by a rotation about z, which leaves the third
            # column.
            cosine, sine = np.cos(q[i, k]), np.sin(q[i, k])
            for r in range(3):
                x, y = row[TURN + 3 * r], row[TURN + 3 * r + 1]
                E[i, 3 * r] = cosine * x + sine * y
                E[i, 3 * r + 1] = cosine * y - sine * x
                E[i, 3 * r + 2] = row[TURN + 3 * r + 2]
                E[i, 9 + r] = row[PLACE + r]


# E[i, :9], row by row, turns a triple outwards, from the frame of link i into its parent's.


@register_jitable
def _times(A, i, c, v):
    """Return the matrix whose rows begin at A[i, c], times a triple."""
    return (
        A[i, c] * v[0] + A[i, c + 1] * v[1] + A[i, c + 2] * v[2],
        A[i, c + 3] * v[0] + A[i, c + 4] * v[1] + A[i, c + 5] * v[2],
        A[i, c + 6] * v[0] + A[i, c + 7] * v[1] + A[i, c + 8] * v[2],
    )


@register_jitable
def _transposed_times(A, i, c, v):
    return (
        A[i, c] * v[0] + A[i, c + 3] * v[1] + A[i, c + 6] * v[2],
        A[i, c + 1] * v[0] + A[i, c + 4] * v[1] + A[i, c + 7] * v[2],
        A[i, c + 2] * v[0] + A[i, c + 5] * v[1] + A[i, c + 8] * v[2],
    )


@register_jitable
def _outwards(E, i, v):
    return _times(E, i, 0, v)


@register_jitable
def _inwards(E, i, v):
    return _transposed_times(E, i, 0, v)


@register_jitable
def _add(load, i, first, second, factor):
    """Add `factor` times two triples to the six numbers of row i."""
    for c in range(3):
        load[i, c] += factor * first[c]
        load[i, 3 + c] += factor * second[c]


@register_jitable
def _symmetric(row, c, v):
    """Return a symmetric matrix, six numbers from column c on, times a triple."""
    return (
        row[c] * v[0] + row[c + 1] * v[1] + row[c + 2] * v[2],
        row[c + 1] * v[0] + row[c + 3] * v[1] + row[c + 4] * v[2],
        row[c + 2] * v[0] + row[c + 4] * v[1] + row[c + 5] * v[2],
    )


@register_jitable
def _pull(table, q, k, pose, wrench):
    """Return the wrench at the tip as force and moment on the last link, at its frame's origin."""
    last = table.shape[0] - 2
    place(table, q, k, pose)
    # The conjugate but for its sign, which a rotation does not feel: from the world into the link.
    back = -pose[last, 3], pose[last, 4], pose[last, 5], pose[last, 6]
    force = wrench[0, k], wrench[1, k], wrench[2, k]
    arm = scaled(three(pose, last + 1, 0), three(pose, last, 0), -1.0)
    moment = add3((wrench[3, k], wrench[4, k], wrench[5, k]), cross3(arm, force))
    return turned(back, force), turned(back, moment)


# --- compiled: the three algorithms ---------------------------------------------------------------


def _rnea(table, q, v, a, wrench, gravity):
    """Return torques (n, N) of motions; `wrench` is (6, N), or (6, 0) for none."""
    n, count = q.shape
    tau, E = np.empty((n, count)), np.empty((n, 12))
    move, load = np.empty((n, 9)), np.empty((n, 6))  # spin, its rate, acceleration; force, moment
    pose = np.empty((n + 1, 7))
    for k in range(count):
        _link(table, q, k, E)
        # Forward pass: velocity and acceleration of each link from its parent's.
        for i in range(n):
            row = table[i]
            parent, shift = int(row[PARENT]), three(E, i, 9)
            # The base accelerates upwards instead of every link being pulled down.
            w, alpha = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
            acc = (-gravity[0], -gravity[1], -gravity[2])
            if parent >= 0:
                w, alpha = three(move, parent, 0), three(move, parent, 3)
                # Acceleration of a point of the parent: Euler and centripetal terms.
                swing = add3(cross3(alpha, shift), cross3(w, cross3(w, shift)))
                acc = add3(three(move, parent, 6), swing)
            w, alpha, acc = _inwards(E, i, w), _inwards(E, i, alpha), _inwards(E, i, acc)
            # The joint's own motion, with the Coriolis term of a slide in a turning frame.
            if row[SLIDES] != 0.0:
                fast = 2.0 * v[i, k]
                acc = acc[0] + fast * w[1], acc[1] - fast * w[0], acc[2] + a[i, k]
            else:
                alpha = alpha[0] + w[1] * v[i, k], alpha[1] - w[0] * v[i, k], alpha[2] + a[i, k]
                w = w[0], w[1], w[2] + v[i, k]
            move[i, 0], move[i, 1], move[i, 2] = w
            move[i, 3], move[i, 4], move[i, 5] = alpha
            move[i, 6], move[i, 7], move[i, 8] = acc
            # Newton and Euler about the link's frame, not about its centre of mass.
            h = three(table, i, TEN + 1)
            force = add3(cross3(alpha, h), cross3(w, cross3(w, h)))
            load[i, 0], load[i, 1], load[i, 2] = scaled(force, acc, row[TEN])
            turning = cross3(w, _symmetric(row, TEN + 4, w))
            turning = add3(turning, add3(_symmetric(row, TEN + 4, alpha), cross3(h, acc)))
            load[i, 3], load[i, 4], load[i, 5] = turning
        if wrench.shape[1] > 0:
            force, moment = _pull(table, q, k, pose, wrench)
            _add(load, n - 1, force, moment, -1.0)
        # Backward pass: forces from the tip to the base, each projected on its joint's axis.
        for back in range(n):
            i = n - 1 - back
            row = table[i]
            # The motor bears the component along its z axis; the bearings take the rest.
            felt = load[i, 2] if row[SLIDES] != 0.0 else load[i, 5]
            tau[i, k] = felt + row[ARMATURE] * a[i, k] + row[DAMPING] * v[i, k]
            parent = int(row[PARENT])
            if parent >= 0:
                force = _outwards(E, i, three(load, i, 0))
                moment = add3(_outwards(E, i, three(load, i, 3)), cross3(three(E, i, 9), force))
                _add(load, parent, force, moment, 1.0)
    return tau


def _crba(table, q):
    """Return mass matrices (n, n, N)."""
    n, count = q.shape
    M, E, body = np.zeros((n, n, count)), np.empty((n, 12)), np.empty((n, 10))
    for k in range(count):
        _link(table, q, k, E)
        # Each composite body starts as the link alone.
        for i in range(n):
            for c in range(10):
                body[i, c] = table[i, TEN + c]
        # From the tip to the base: the composite body of a link is itself and all that it carries.
        for back in range(n):
            i = n - 1 - back
            # Force and moment of that body for a unit acceleration of joint i, in the link's frame.
            m, h = body[i, 0], three(body, i, 1)
            if table[i, SLIDES] != 0.0:
                force, moment = (0.0, 0.0, m), (h[1], -h[0], 0.0)
                M[i, i, k] = m + table[i, ARMATURE]
            else:
                force, moment = (-h[1], h[0], 0.0), (body[i, 6], body[i, 8], body[i, 9])
                M[i, i, k] = body[i, 9] + table[i, ARMATURE]
            # What a unit acceleration of joint i asks of the joints before it.
            j, parent = i, int(table[i, PARENT])
            while parent >= 0:
                force = _outwards(E, j, force)
                moment = add3(_outwards(E, j, moment), cross3(three(E, j, 9), force))
                felt = force[2] if table[parent, SLIDES] != 0.0 else moment[2]
                M[i, parent, k] = felt
                M[parent, i, k] = felt
                j, parent = parent, int(table[parent, PARENT])
            parent = int(table[i, PARENT])
            if parent >= 0:
                _merge(body, E, i, parent)
    return M


@register_jitable
def _merge(body, E, i, parent):
    """Add the rigid body i, seen from its parent's frame, to that of the parent."""
    p, m = three(E, i, 9), body[i, 0]
    h = _outwards(E, i, three(body, i, 1))
    # E I E^T: the columns of I outwards, then the rows of what comes out.
    x = _outwards(E, i, (body[i, 4], body[i, 5], body[i, 6]))
    y = _outwards(E, i, (body[i, 5], body[i, 7], body[i, 8]))
    z = _outwards(E, i, (body[i, 6], body[i, 8], body[i, 9]))
    first = _outwards(E, i, (x[0], y[0], z[0]))
    second = _outwards(E, i, (x[1], y[1], z[1]))
    third = _outwards(E, i, (x[2], y[2], z[2]))
    # Steiner between two points neither of which is the centre of mass.
    square = 2.0 * (p[0] * h[0] + p[1] * h[1] + p[2] * h[2])
    square += m * (p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
    # The composite rigid body: masses and first moments add, the second moments about one point
    # too.
    body[parent, 0] += m
    for c in range(3):
        body[parent, 1 + c] += h[c] + m * p[c]
    body[parent, 4] += first[0] + square - 2.0 * p[0] * h[0] - m * p[0] * p[0]
    body[parent, 5] += first[1] - p[0] * h[1] - h[0] * p[1] - m * p[0] * p[1]
    body[parent, 6] += first[2] - p[0] * h[2] - h[0] * p[2] - m * p[0] * p[2]
    body[parent, 7] += second[1] + square - 2.0 * p[1] * h[1] - m * p[1] * p[1]
    body[parent, 8] += second[2] - p[1] * h[2] - h[1] * p[2] - m * p[1] * p[2]
    body[parent, 9] += third[2] + square - 2.0 * p[2] * h[2] - m * p[2] * p[2]


@register_jitable
def _articulate(X, E, i, parent, Y):
    """Add the articulated inertia i, seen from its parent's frame, to that of the parent.

    Its blocks I, H, M (9 numbers each) say moment = I alpha + H acc, force = H^T alpha + M acc;
    Y (3, 9) is room for them.
    """
    # E A E^T block by block: the columns outwards, then the rows.
    for b in range(3):
        for c in range(3):
            column = X[i, 9 * b + c], X[i, 9 * b + 3 + c], X[i, 9 * b + 6 + c]
            Y[b, c], Y[b, 3 + c], Y[b, 6 + c] = _outwards(E, i, column)
        for r in range(0, 9, 3):
            Y[b, r], Y[b, r + 1], Y[b, r + 2] = _outwards(E, i, three(Y, b, r))
    p = three(E, i, 9)
    # H [p], with the row r of H: row x p. Then H + [p] M, and I - H [p] + [p] (H + [p] M)^T.
    for r in range(0, 9, 3):
        Y[0, r], Y[0, r + 1], Y[0, r + 2] = scaled(three(Y, 0, r), cross3(three(Y, 1, r), p), -1.0)
    for c in range(3):
        column = cross3(p, (Y[2, c], Y[2, 3 + c], Y[2, 6 + c]))
        for r in range(3):
            Y[1, 3 * r + c] += column[r]
    for c in range(3):
        column = cross3(p, three(Y, 1, 3 * c))
        for r in range(3):
            Y[0, 3 * r + c] += column[r]
    for b in range(3):
        for c in range(9):
            X[parent, 9 * b + c] += Y[b, c]


@register_jitable
def _aba(table, q, v, tau, wrench, gravity):
    """Return accelerations (n, N).

    `tau` is (n, N) or (n, 1), `wrench` (6, N), or (6, 0) for none.
    """
    n, count = q.shape
    result, E, pose = np.empty((n, count)), np.empty((n, 12)), np.empty((n + 1, 7))
    X, Y = np.empty((n, 27)), np.empty((3, 9))
    move = np.empty((n, 6))  # spin and velocity, later their rates
    extra, load = np.empty((n, 6)), np.empty((n, 6))  # accelerations by speed; moment and force
    U, D, u = np.empty((n, 6)), np.empty(n), np.empty(n)
    for k in range(count):
        # First pass: velocities, velocity-dependent accelerations, bias forces (Featherstone, 2008,
        # table 7.1).
        _link(table, q, k, E)
        for i in range(n):
            row, rate = table[i], v[i, k]
            parent = int(row[PARENT])
            w, s = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
            if parent >= 0:
                w = three(move, parent, 0)
                s = _inwards(E, i, add3(three(move, parent, 3), cross3(w, three(E, i, 9))))
                w = _inwards(E, i, w)
            # Velocity-product acceleration v x S q' of the joint (Featherstone's c).
            extra[i] = 0.0
            if row[SLIDES] != 0.0:
                s = s[0], s[1], s[2] + rate
                extra[i, 3], extra[i, 4] = rate * w[1], -rate * w[0]
            else:
                w = w[0], w[1], w[2] + rate
                extra[i, 0], extra[i, 1] = rate * w[1], -rate * w[0]
                extra[i, 3], extra[i, 4] = rate * s[1], -rate * s[0]
            move[i, 0], move[i, 1], move[i, 2] = w
            move[i, 3], move[i, 4], move[i, 5] = s
            # Spatial momentum I v of the link, and the bias force v x* I v.
            m, h = row[TEN], three(table, i, TEN + 1)
            momentum = scaled(cross3(w, h), s, m)
            spin = add3(_symmetric(row, TEN + 4, w), cross3(h, s))
            load[i, 0], load[i, 1], load[i, 2] = add3(cross3(w, spin), cross3(s, momentum))
            load[i, 3], load[i, 4], load[i, 5] = cross3(w, momentum)
            # Rigid inertia: blocks I, [h] and m times the identity.
            for c in range(9):
                X[i, c], X[i, 9 + c] = row[TEN + 4 + _SQUARE[c]], 0.0
                X[i, 18 + c] = m if c % 4 == 0 else 0.0
            X[i, 10], X[i, 11], X[i, 12] = -h[2], h[1], h[2]
            X[i, 14], X[i, 15], X[i, 16] = -h[0], -h[1], h[0]
        if wrench.shape[1] > 0:
            force, moment = _pull(table, q, k, pose, wrench)
            _add(load, n - 1, moment, force, -1.0)
        # Second pass, from the tip: articulated inertia and bias force of each link.
        for back in range(n):
            i = n - 1 - back
            row, parent = table[i], int(table[i, PARENT])
            slides = row[SLIDES] != 0.0
            # U = I S, D = S^T U plus the rotor, and what torque is left for the acceleration.
            for c in range(3):
                U[i, c] = X[i, 11 + 3 * c] if slides else X[i, 2 + 3 * c]
                U[i, 3 + c] = X[i, 20 + 3 * c] if slides else X[i, 15 + c]
            felt = 5 if slides else 2
            D[i] = U[i, felt] + row[ARMATURE]
            push = tau[i, k if tau.shape[1] > 1 else 0]
            u[i] = push - row[DAMPING] * v[i, k] - load[i, felt]
            if parent < 0:
                continue
            # The joint gives way: take its direction out of the inertia that the parent feels.
            for r in range(3):
                for c in range(3):
                    X[i, 3 * r + c] -= U[i, r] * U[i, c] / D[i]
                    X[i, 9 + 3 * r + c] -= U[i, r] * U[i, 3 + c] / D[i]
                    X[i, 18 + 3 * r + c] -= U[i, 3 + r] * U[i, 3 + c] / D[i]
            # Bias force for the parent, p + I^a c + U u / D (Featherstone, 2008, table 7.1).
            turning, moving = three(extra, i, 0), three(extra, i, 3)
            moment = add3(_times(X, i, 0, turning), _times(X, i, 9, moving))
            force = add3(_transposed_times(X, i, 9, turning), _times(X, i, 18, moving))
            held = u[i] / D[i]
            for c in range(6):
                load[i, c] += U[i, c] * held
            force = _outwards(E, i, add3(force, three(load, i, 3)))
            moment = _outwards(E, i, add3(moment, three(load, i, 0)))
            moment = add3(moment, cross3(three(E, i, 9), force))
            _add(load, parent, moment, force, 1.0)
            _articulate(X, E, i, parent, Y)
        # Third pass, from the base: joint accelerations.
        for i in range(n):
            parent = int(table[i, PARENT])
            # The base accelerates upwards, so gravity enters once, at the root.
            alpha, acc = (0.0, 0.0, 0.0), (-gravity[0], -gravity[1], -gravity[2])
            if parent >= 0:
                alpha = three(move, parent, 0)
                acc = add3(three(move, parent, 3), cross3(alpha, three(E, i, 9)))
            alpha = add3(_inwards(E, i, alpha), three(extra, i, 0))
            acc = add3(_inwards(E, i, acc), three(extra, i, 3))
            # The joint's equation: q'' = (u - U^T a) / D, with a the acceleration without q''.
            rate = u[i]
            for c in range(3):
                rate -= U[i, c] * alpha[c] + U[i, 3 + c] * acc[c]
            result[i, k] = rate / D[i]
            move[i, 0], move[i, 1], move[i, 2] = alpha
            move[i, 3], move[i, 4], move[i, 5] = acc
            move[i, 5 if table[i, SLIDES] != 0.0 else 2] += result[i, k]
    return result


def acceleration(q, v, params):
    """Return joint accelerations, for the integrators of chapter 1; shape of v [rad/s^2 or m/s^2].

    Args:
        q: joint positions, shape (n,) or (n, N).
        v: joint rates, same shape.
        params: what `pack` returns.
    """
    n = q.shape[0]
    table = params[3 + n :].reshape(n + 1, WIDTH)
    tau = params[3 : 3 + n].reshape(n, 1)
    count = q.size // n
    result = _aba(
        table, q.reshape(n, count), v.reshape(n, count), tau, np.empty((6, 0)), params[:3]
    )
    return result.reshape(q.shape)


@functools.cache
def kernels() -> tuple[Any, Any, Any]:
    """Return the compiled functions: inverse dynamics, mass matrix, forward dynamics."""
    return (
        compiled(_rnea, MATRIX(ROWS, ROWS, ROWS, ROWS, ROWS, ROW)),
        compiled(_crba, CUBE(ROWS, ROWS)),
        compiled(_aba, MATRIX(ROWS, ROWS, ROWS, ROWS, ROWS, ROW)),
    )


# --- the doors ------------------------------------------------------------------------------------

_NONE, _DOWN = np.empty((6, 0)), np.array(DOWNWARDS)


def _outside(wrench: ArrayLike | None, gravity: ArrayLike, count: int) -> tuple[Array, Array]:
    down = _DOWN
    if gravity is not DOWNWARDS:
        down = np.ascontiguousarray(vector("gravity", gravity, (3,), unit="m/s^2"))
    if wrench is None:
        return _NONE, down
    array = vector("wrench", wrench, (6,), (6, count))
    return np.ascontiguousarray(np.broadcast_to(array.reshape(6, -1), (6, count))), down


def inverse_dynamics(
    chain: Chain,
    q: ArrayLike,
    v: ArrayLike,
    a: ArrayLike,
    wrench: ArrayLike | None = None,
    *,
    gravity: ArrayLike = DOWNWARDS,
) -> Array:
    """Return the torques that a motion needs: M a + bias - J^T wrench (recursive Newton-Euler).

    A call costs several times its loop: hand over many states at once.

    Args:
        chain: the arm.
        q: joint positions, shape (n,) or (n, N).
        v: joint rates, same shape.
        a: joint accelerations, same shape.
        wrench: what pulls at the tip, force over torque in world axes, (6,) or (6, N) [N, N m].
        gravity: in the world, shape (3,) [m/s^2].

    Returns:
        Shape of q [N m, or N for a slide].

    Raises:
        ValueError: for shapes that disagree or numbers that are not finite.
    """
    single, (q, v, a) = batch(chain, q=q, v=v, a=a)
    tau = kernels()[0](chain.table, q, v, a, *_outside(wrench, gravity, q.shape[1]))
    return tau[:, 0] if single else tau


def bias(
    chain: Chain,
    q: ArrayLike,
    v: ArrayLike,
    wrench: ArrayLike | None = None,
    *,
    gravity: ArrayLike = DOWNWARDS,
) -> Array:
    """Return the torques of that motion without acceleration; gravity alone where v is 0 too."""
    return inverse_dynamics(chain, q, v, np.zeros(np.shape(q)), wrench, gravity=gravity)


def mass_matrix(chain: Chain, q: ArrayLike) -> Array:
    """Return M(q), armature included, shape (n, n) or (n, n, N) (composite rigid bodies)."""
    single, (q,) = batch(chain, q=q)
    M = kernels()[1](chain.table, q)
    return M[:, :, 0] if single else M


def forward_dynamics(
    chain: Chain,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    wrench: ArrayLike | None = None,
    *,
    gravity: ArrayLike = DOWNWARDS,
) -> Array:
    """Return the joint accelerations under torques, by the articulated-body algorithm.

    Arguments are those of `inverse_dynamics`, with torques for accelerations.
    """
    single, (q, v, tau) = batch(chain, q=q, v=v, tau=tau)
    a = kernels()[2](chain.table, q, v, tau, *_outside(wrench, gravity, q.shape[1]))
    return a[:, 0] if single else a


def pack(chain: Chain, tau: ArrayLike = 0.0, gravity: ArrayLike = DOWNWARDS) -> Array:
    """Return what `acceleration` reads.

    Gravity (3,), constant torques, one or (n,), the chain's table.
    """
    torques = np.broadcast_to(vector("tau", tau, (), (chain.n,)), (chain.n,))
    down = vector("gravity", gravity, (3,), unit="m/s^2")
    return np.concatenate([down, torques, chain.table.ravel()])


def energy(
    chain: Chain, q: ArrayLike, v: ArrayLike, *, gravity: ArrayLike = DOWNWARDS
) -> tuple[Any, Any, Any]:
    """Return kinetic energy, potential energy and their sum [J], each of shape (N,).

    The potential energy is 0 at the world's origin.
    """
    single, (q, v) = batch(chain, q=q, v=v)
    down = vector("gravity", gravity, (3,), unit="m/s^2")
    pose = frames(chain, q).reshape(7, -1)
    centre = np.repeat(chain.centre, q.shape[1], axis=1)
    place = (pose[:3] + rotate(pose[3:], centre)).reshape(3, chain.n, -1)
    # Potential energy of each link at its centre of mass.
    potential = -np.einsum("i,ijk,j->k", down, place, chain.mass)
    kinetic = 0.5 * np.einsum("ik,ijk,jk->k", v, mass_matrix(chain, q), v)
    total = kinetic + potential
    return (kinetic[0], potential[0], total[0]) if single else (kinetic, potential, total)


def inertial_parameters(chain: Chain) -> Array:
    """Return the ten numbers of each link one after the other, shape (10 n,) [kg, kg m, kg m^2].

    Mass, first moment and inertia (xx, xy, xz, yy, yz, zz) about the joint's origin, in its frame.
    """
    return chain.table[:-1, TEN:ARMATURE].flatten()


def regressor(
    chain: Chain, q: ArrayLike, v: ArrayLike, a: ArrayLike, *, gravity: ArrayLike = DOWNWARDS
) -> Array:
    """Return Y with torque = Y @ inertial_parameters(chain) + armature a + damping v.

    Newton-Euler is linear in the ten numbers, so the column of one of them is the torque of a chain
    that has a 1 there and zeros elsewhere: the chain's own do not enter. Shape (n, 10 n) or
    (n, 10 n, N); arguments as for `inverse_dynamics`.
    """
    single, (q, v, a) = batch(chain, q=q, v=v, a=a)
    # The torque is linear in the inertial parameters: one unit parameter at a time gives a column.
    outside = _outside(None, gravity, q.shape[1])
    bare = chain.table.copy()
    bare[:, TEN : DAMPING + 1] = 0.0
    Y = np.empty((chain.n, 10 * chain.n, q.shape[1]))
    for i in range(chain.n):
        for c in range(10):
            bare[i, TEN + c] = 1.0
            Y[:, 10 * i + c] = kernels()[0](bare, q, v, a, *outside)
            bare[i, TEN + c] = 0.0
    return Y[:, :, 0] if single else Y


def linearise(
    chain: Chain,
    q: ArrayLike,
    v: ArrayLike,
    tau: ArrayLike,
    *,
    gravity: ArrayLike = DOWNWARDS,
    step: float = 6e-6,
) -> tuple[Array, Array]:
    """Return A and B of the small motion about a state: d/dt (dq, dv) = A (dq, dv) + B dtau.

    Central differences of `forward_dynamics` at q, v, tau, shape (n,), all in one batch. The
    default step [rad, m, rad/s, ..., N m], the cube root of the rounding unit, leaves about 1e-10
    of the largest entry. A is (2 n, 2 n), B is (2 n, n).
    """
    n = chain.n
    point = np.concatenate([vector(s, x, (n,)) for s, x in (("q", q), ("v", v), ("tau", tau))])
    # Central differences of the forward dynamics, all points in one batch.
    moves = positive("step", step) * np.eye(3 * n)
    ahead, behind = point[:, None] + moves, point[:, None] - moves
    both = np.concatenate([ahead, behind], axis=1)
    a = forward_dynamics(chain, both[:n], both[n : 2 * n], both[2 * n :], gravity=gravity)
    # The difference as it was rounded, not as it was meant.
    slope = (a[:, : 3 * n] - a[:, 3 * n :]) / np.diag(ahead - behind)
    A, B = np.zeros((2 * n, 2 * n)), np.zeros((2 * n, n))
    # The upper half of A says that dq changes at the rate dv.
    A[:n, n:] = np.eye(n)
    A[n:], B[n:] = slope[:, : 2 * n], slope[:, 2 * n :]
    return A, B
