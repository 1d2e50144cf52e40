"""Laws that turn where an arm is and where it should be into torques.

Laws of joints take a `Chain` or a `TwoLink` as their model; `gravity` is asked of a `Chain` only, a
`TwoLink` has its own. Laws of the tip take a `Chain`; a task is some rows of the tip's twist
(0 to 2: velocity, 3 to 5: angular velocity, world axes). All take one arm, states (n,), or N of
them, states (n, N); references are then (n,) for all or (n, N). A gain is a number, one for each
row, or a matrix. The model's joint damping is part of its dynamics.

Sources: Siciliano, Sciavicco, Villani and Oriolo, Robotics (2009), ch. 8-9; Khatib (1987) for the
task inertia; Slotine and Li (1987).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, finite, invalid, positive, vector
from course.control.adaptive import guarded
from course.kinematics import (
    Chain,
    TwoLink,
    inverse_dynamics,
    jacobian,
    jacobian_rate,
    mass_matrix,
    pose_error,
    tip,
)
from course.kinematics import bias as chain_bias
from course.kinematics.dynamics import DOWNWARDS

Array = NDArray[np.float64]
Arm = Chain | TwoLink


# --- laws of joints -------------------------------------------------------------------------------


def pd(
    q: ArrayLike, v: ArrayLike, q_ref: ArrayLike, v_ref: ArrayLike, kp: ArrayLike, kd: ArrayLike
) -> Array:
    """Return kp (q_ref - q) + kd (v_ref - v) [N m], shape of q.

    Raises:
        ValueError: as every law here, for shapes that disagree and numbers that are not finite.
    """
    q = vector("q", q, (None,), (None, None))
    e, rate = like("q_ref", q_ref, q) - q, like("v_ref", v_ref, q) - like("v", v, q)
    return gain("kp", kp, len(q)) @ e + gain("kd", kd, len(q)) @ rate


def pd_gravity(
    chain: Arm,
    q: ArrayLike,
    v: ArrayLike,
    q_ref: ArrayLike,
    v_ref: ArrayLike,
    kp: ArrayLike,
    kd: ArrayLike,
    *,
    gravity: ArrayLike = DOWNWARDS,
) -> Array:
    """Return the torques of `pd` plus gravity compensation.

    At a target at rest it has no steady error if the model of gravity is right and neither a load
    nor dry friction acts.
    """
    here = np.asarray(q, dtype=float)
    zero = np.zeros(here.shape)
    return pd(q, v, q_ref, v_ref, kp, kd) + needed(chain, here, zero, zero, gravity)


def feedforward(
    chain: Arm,
    q: ArrayLike,
    v: ArrayLike,
    q_ref: ArrayLike,
    v_ref: ArrayLike,
    a_ref: ArrayLike,
    kp: ArrayLike,
    kd: ArrayLike,
    *,
    gravity: ArrayLike = DOWNWARDS,
) -> Array:
    """Return `pd`, and the torques of the reference motion, which can be computed beforehand."""
    here = np.asarray(q, dtype=float)
    place, rate = like("q_ref", q_ref, here), like("v_ref", v_ref, here)
    ahead = needed(chain, place, rate, like("a_ref", a_ref, here), gravity)
    return pd(q, v, q_ref, v_ref, kp, kd) + ahead


def computed_torque(
    chain: Arm,
    q: ArrayLike,
    v: ArrayLike,
    q_ref: ArrayLike,
    v_ref: ArrayLike,
    a_ref: ArrayLike,
    kp: ArrayLike,
    kd: ArrayLike,
    dt: float = 0.0,
    *,
    gravity: ArrayLike = DOWNWARDS,
) -> Array:
    """Return M (a_ref + kd e' + kp e) + bias.

    With the right model and no hold, e'' + kd e' + kp e = 0.

    A command that is held for a sample is right at its beginning only, which costs an error of
    first order in the sample time. With `dt` the law works for the middle of the sample: it carries
    the state half a sample on, and wants the reference of that instant. That is second order.

    Args:
        chain: the model.
        q: joint positions, shape (n,) or (n, N).
        v: joint rates, same shape.
        q_ref: reference positions now; with `dt`, half a sample from now.
        v_ref: reference rates at that time.
        a_ref: reference accelerations at that time.
        kp: gain on the position error, before it is multiplied by the inertia [1/s^2].
        kd: gain on the rate error, likewise [1/s].
        dt: sample time, or 0 for no preview [s].
        gravity: for a `Chain`, shape (3,) [m/s^2].

    Returns:
        Torques, shape of q [N m].
    """
    half = 0.5 * finite("dt", dt, 0.0, unit="s")
    q = vector("q", q, (None,), (None, None))
    v, a = like("v", v, q), like("a_ref", a_ref, q)
    if half:
        # Preview: the torque is held for a sample, so it is computed for the state half of it
        # ahead.
        q, v = q + half * v + 0.5 * half**2 * a, v + half * a
    return needed(chain, q, v, a + pd(q, v, q_ref, v_ref, kp, kd), gravity)


def friction_compensation(
    v: ArrayLike, coulomb: ArrayLike, viscous: ArrayLike = 0.0, width: float = 0.01
) -> Array:
    """Return torques against friction: coulomb tanh(v / width) + viscous v, shape of v.

    Hand it the reference's speed: the sign of a measured one chatters at rest. The width [rad/s]
    also keeps the measured speed's gain down, at coulomb / width.
    """
    v = vector("v", v, (None,), (None, None))
    dry, wet = (
        gain(name, value, len(v)) for name, value in (("coulomb", coulomb), ("viscous", viscous))
    )
    return dry @ np.tanh(v / positive("width", width, unit="rad/s")) + wet @ v


class Adaptive:
    """Computed torque without the numbers of the arm: they are learnt while it moves.

    With s = v_ref - v + slope e and the reference velocity w = v_ref + slope e, torques are
    Y(q, v, w', w) estimate + damping s, and the estimate moves by rate Y^T s. The function
    V = s^T M s / 2 + (estimate - true)^T rate^-1 (estimate - true) / 2 then falls by
    s^T (damping + D) s, where D is the arm's own damping (Slotine and Li, 1987).

    That is a proof for continuous time. Sampled, the estimate moves by dt rate Y^T s from values
    that are a sample old, and V falls only while dt rate |Y|^2 is small against the damping, and dt
    is short enough for the damping itself: far from the reference, or with a large rate, the
    estimate runs away and the arm with it. Noise makes an estimate drift that nothing excites.
    `bounds` keep it among arms that are possible (projection; Ioannou and Sun, 1996, section
    3.10).

    Attributes:
        arm: whose lengths and gravity are known; its masses and damping are not looked at.
        estimate: of `TwoLink.parameters`, shape (5,), or (7,) in an upright plane.
    """

    def __init__(
        self,
        arm: TwoLink,
        slope: float,
        damping: ArrayLike,
        rate: ArrayLike,
        dt: float,
        estimate: ArrayLike | None = None,
        bounds: ArrayLike | None = None,
    ) -> None:
        """Create a law that starts from an estimate of the parameters, by default from zeros.

        Args:
            arm: see above.
            slope: decay rate of the tracking error once s is 0, where e' = -slope e [1/s].
            damping: gain of s, number, (2,) or (2, 2) [N m s/rad].
            rate: of adaptation, positive, a number or one for each parameter; in
                the unit of the parameter squared per joule.
            dt: sample time [s]; 0 freezes the estimate.
            estimate: parameters at the start, shape (5,) or (7,).
            bounds: rows lowest and highest estimate, shape (2, 5) or (2, 7); none by default.

        Raises:
            ValueError: for a wrong shape, a gain or rate that is not positive, or bounds that are
                out of order.
        """
        # Inertia and damping take five parameters; gravity adds a first moment of mass a link.
        size = 7 if arm.gravity else 5
        self.arm, self._slope = arm, positive("slope", slope, unit="1/s")
        self._damping = gain("damping", damping, 2)
        self._rate = vector("rate", rate, (), (size,), low=POSITIVE) * np.ones(size)
        self._dt = finite("dt", dt, 0.0, unit="s")
        start = np.zeros(size) if estimate is None else estimate
        self.estimate = np.array(vector("estimate", start, (size,)))
        # Infinite bounds stand for none, so that the projection needs no special case.
        unbounded = np.array([[-np.inf], [np.inf]]) * np.ones(size)
        self._bounds = np.asarray(unbounded if bounds is None else bounds, dtype=float)
        if self._bounds.shape != (2, size) or not (self._bounds[0] <= self._bounds[1]).all():
            raise invalid("bounds", bounds, f"rows of lowest and highest numbers, (2, {size})")

    def parts(
        self, q: ArrayLike, v: ArrayLike, q_ref: ArrayLike, v_ref: ArrayLike, a_ref: ArrayLike
    ) -> tuple[Array, Array, Array]:
        """Return torques (2,), rate of the estimate, and s (2,), at a state; nothing is kept."""
        q = vector("q", q, (2,))
        e = like("q_ref", q_ref, q) - q
        rate = like("v_ref", v_ref, q) - like("v", v, q)
        # Sliding variable s and reference velocity w of Slotine and Li (1987).
        s = rate + self._slope * e
        w = like("v_ref", v_ref, q) + self._slope * e
        Y = self.arm.regressor(q, v, like("a_ref", a_ref, q) + self._slope * rate, w)
        # The parameters enter linearly, so the gradient of the error is the regressor's transpose.
        return Y @ self.estimate + self._damping @ s, self._rate * (Y.T @ s), s

    def __call__(
        self, q: ArrayLike, v: ArrayLike, q_ref: ArrayLike, v_ref: ArrayLike, a_ref: ArrayLike
    ) -> Array:
        """Return the torques for this sample, shape (2,); the estimate then takes its step."""
        tau, change, _ = self.parts(q, v, q_ref, v_ref, a_ref)
        # Euler step of the adaptation, kept within the bounds (projection).
        self.estimate = guarded(self.estimate, change, self._dt, *self._bounds)
        return tau


# --- laws of the tip ------------------------------------------------------------------------------


def impedance(
    chain: Chain,
    q: ArrayLike,
    v: ArrayLike,
    target: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    rate: ArrayLike = 0.0,
    *,
    rows: Sequence[int] = (0, 1, 2),
    gravity: ArrayLike = DOWNWARDS,
) -> Array:
    """Return the torques of a virtual spring and damper from the tip to a target.

    Gravity compensation is added (Hogan, 1985).

    The arm keeps its own inertia, so no force has to be measured.

    Args:
        chain: the model.
        q: joint positions, shape (n,) or (n, N).
        v: joint rates, same shape.
        target: position (3,) or pose (7,) of the tip; with N too [m].
        stiffness: of the task's rows [N/m, N m/rad].
        damping: of the task's rows [N s/m, N m s/rad].
        rate: the target's, a number or one for each row [m/s, rad/s].
        rows: of the twist that are the task.
        gravity: shape (3,) [m/s^2].

    Returns:
        Torques, shape of q [N m].
    """
    J, e, speed = _task(chain, q, v, target, rows)
    K, B = gain("stiffness", stiffness, len(rows)), gain("damping", damping, len(rows))
    # Force in the task space; the transposed Jacobian turns it into joint torques.
    force = K @ e + B @ (like("rate", rate, speed) - speed)
    return _transposed(J, force) + chain_bias(chain, q, np.zeros(np.shape(q)), gravity=gravity)


def admittance(
    x: ArrayLike,
    v: ArrayLike,
    force: ArrayLike,
    mass: float,
    damping: float,
    stiffness: float,
    dt: float,
) -> tuple[Array, Array]:
    """Return one sample of the virtual body mass x'' + damping x' + stiffness x = force.

    What comes out is the reference of a stiff position loop inside, counted from the set-point.

    Args:
        x: position of the virtual body, any one shape [m].
        v: its velocity, same shape [m/s].
        force: measured on the tip, same shape [N].
        mass: of the virtual body [kg].
        damping: of the virtual body [N s/m].
        stiffness: of the virtual body [N/m].
        dt: sample time [s].

    Returns:
        The new x and v.
    """
    x = vector("x", x)
    v, force = like("v", v, x), like("force", force, x)
    m, dt = positive("mass", mass, unit="kg"), positive("dt", dt, unit="s")
    b, k = finite("damping", damping, 0.0), finite("stiffness", stiffness, 0.0)
    # Damping at the end of the sample: stable however light the body is.
    v = (v + dt / m * (force - k * x)) / (1.0 + dt * b / m)
    # Semi-implicit Euler: the position moves with the new velocity.
    return x + dt * v, v


def operational_space(
    chain: Chain,
    q: ArrayLike,
    v: ArrayLike,
    target: ArrayLike,
    rate: ArrayLike,
    acceleration: ArrayLike,
    kp: ArrayLike,
    kd: ArrayLike,
    null: ArrayLike = 0.0,
    *,
    rows: Sequence[int] = (0, 1, 2),
    gravity: ArrayLike = DOWNWARDS,
) -> Array:
    """Make the tip obey e'' + kd e' + kp e = 0; it does not feel what `null` asks of the joints.

    Torques are J^T L (a - J' v) + bias + (I - J^T L J M^-1) null with the task inertia
    L = (J M^-1 J^T)^-1. Another projector than this dynamically consistent one (Khatib, 1987) keeps
    the tip still in statics only.

    Args:
        chain: as for `impedance`.
        q: as for `impedance`.
        v: as for `impedance`.
        target: as for `impedance`.
        rate: the target's velocity, a number or one for each row [m/s, rad/s].
        acceleration: the target's acceleration, likewise.
        kp: gain on the pose error [1/s^2].
        kd: gain on the velocity error [1/s].
        rows: as for `impedance`.
        gravity: as for `impedance`.
        null: torques, a number, (n,) or (n, N) [N m].

    Raises:
        ValueError: also where the tip is so near to a singularity that its inertia in one direction
            is more than a million times that in another.
    """
    return hybrid(
        chain,
        q,
        v,
        target,
        rate,
        acceleration,
        kp,
        kd,
        0.0,
        0.0,
        np.eye(len(rows)),
        np.zeros(len(rows), dtype=bool),
        null,
        rows=rows,
        gravity=gravity,
    )


def hybrid(
    chain: Chain,
    q: ArrayLike,
    v: ArrayLike,
    target: ArrayLike,
    rate: ArrayLike,
    acceleration: ArrayLike,
    kp: ArrayLike,
    kd: ArrayLike,
    force: ArrayLike,
    measured: ArrayLike,
    frame: ArrayLike,
    forced: ArrayLike,
    null: ArrayLike = 0.0,
    *,
    force_gain: float = 0.0,
    force_damping: float = 0.0,
    rows: Sequence[int] = (0, 1, 2),
    gravity: ArrayLike = DOWNWARDS,
) -> Array:
    """Return motion along some axes of a frame, force along the others (Raibert and Craig, 1981).

    The choice is made in the frame of the surface: chosen among the world's axes it pushes along
    the surface and moves into it as soon as the surface is turned. Against a hard surface force is
    exact with `force_gain` 0, and motion along it has no part in it (Khatib, 1987).

    Args:
        chain: as for `impedance`.
        q: as for `impedance`.
        v: as for `impedance`.
        target: as for `operational_space`, in world axes.
        rate: as for `operational_space`, in world axes.
        acceleration: as for `operational_space`, in world axes.
        kp: gain of motion in world axes [1/s^2].
        kd: gain of motion in world axes [1/s].
        null: as for `operational_space`.
        rows: as for `impedance`.
        gravity: as for `impedance`.
        force: desired contact force of the tip on the surface, in the frame's axes, a number or
            (m,) [N].
        measured: measured contact force, likewise [N].
        frame: axes of the surface as columns, an orthogonal matrix, shape (m, m).
        forced: which of them are forced, shape (m,) of booleans.
        force_gain: of force - measured.
        force_damping: against speed along forced axes [N s/m].

    Returns:
        Torques, shape of q [N m].
    """
    m = len(rows)
    R = vector("frame", frame, (m, m))
    # Below, the transpose of the frame serves as its inverse.
    if np.abs(R.T @ R - np.eye(m)).max() > 1e-9:
        raise invalid("frame", R, "a matrix whose columns are at right angles and of length 1")
    chosen = np.asarray(forced)
    if chosen.shape != (m,) or chosen.dtype != bool:
        raise invalid("forced", forced, f"{m} booleans")
    J, e, speed = _task(chain, q, v, target, rows)
    n, q, v = chain.n, np.asarray(q, dtype=float), np.asarray(v, dtype=float)
    # Operational-space inertia (Khatib, 1987): the inverse of J M^-1 J^T.
    M = np.moveaxis(mass_matrix(chain, q).reshape(n, n, -1), 2, 0)
    jac = np.moveaxis(J.reshape(m, n, -1), 2, 0)
    spread = np.linalg.solve(M, jac.transpose(0, 2, 1))  # M^-1 J^T
    mobility = jac @ spread
    # Near a singularity that matrix has no inverse, and forces would grow without bound.
    sizes = np.linalg.eigvalsh(mobility)
    if (sizes[:, 0] < 1e-6 * sizes[:, -1]).any():
        worst = float((sizes[:, 0] / sizes[:, -1]).min())
        raise invalid("q", q, f"one away from singularity (here mobilities are {worst:.1e} apart)")
    # J' v: the acceleration of the tip that the present joint rates cause by themselves.
    drift = _columns(np.asarray(jacobian_rate(chain, q, v))[list(rows)], v)
    desired = like("acceleration", acceleration, e) + gain("kp", kp, m) @ e
    desired = desired + gain("kd", kd, m) @ (like("rate", rate, e) - speed)
    # Selection matrices in the frame of the surface: motion along some axes, force along the
    # others.
    moving = R @ np.diag(~chosen) @ R.T
    # Desired force, proportional correction and damping, still in the axes of the surface.
    push = like("force", force, e)
    push = push + finite("force_gain", force_gain, 0.0) * (push - like("measured", measured, e))
    push = push - finite("force_damping", force_damping, 0.0) * (R.T @ speed)
    push = R @ (chosen.reshape((m,) + (1,) * (e.ndim - 1)) * push)
    free = like("null", null, q).reshape(n, -1).T[:, :, None]
    # What the null torques would do to the tip is taken off what the task asks of it.
    task = (moving @ desired - drift).reshape(m, -1).T[:, :, None] - spread.transpose(
        0, 2, 1
    ) @ free
    # Task inertia times acceleration, plus the contact force directly (Khatib, 1987).
    effort = np.linalg.solve(mobility, task) + push.reshape(m, -1).T[:, :, None]
    tau = (jac.transpose(0, 2, 1) @ effort + free)[:, :, 0].T
    return tau.reshape(q.shape) + chain_bias(chain, q, v, gravity=gravity)


# --- shapes ---------------------------------------------------------------------------------------


def gain(name: str, value: ArrayLike, n: int) -> Array:
    """Return a gain as a matrix (n, n), from a number, one for each row, or a matrix.

    No gain may be negative.
    """
    array = vector(name, value, (), (n,), (n, n))
    if array.ndim < 2:
        return np.diag(np.broadcast_to(vector(name, array, low=0.0), (n,)))
    # Only the symmetric part counts in x^T K x; the tolerance admits rounding.
    if np.linalg.eigvalsh(array + array.T)[0] < -1e-12 * np.abs(array).max():
        raise invalid(name, array, "a matrix that gives no energy, x^T K x >= 0")
    return array


def like(name: str, value: ArrayLike, other: Array) -> Array:
    """Return a number, a row for all or an array of the shape of `other`, as the last."""
    array = vector(name, value, (), other.shape, other.shape[:1])
    if array.ndim == 1 and other.ndim == 2:
        array = array[:, None]
    return np.asarray(np.broadcast_to(array, other.shape))


def needed(
    arm: Arm, q: ArrayLike, v: ArrayLike, a: ArrayLike, gravity: ArrayLike = DOWNWARDS
) -> Array:
    """Return the torques of a motion by either kind of model, shape of q [N m]."""
    if isinstance(arm, TwoLink):
        return arm.inverse_dynamics(q, v, a)
    return inverse_dynamics(arm, q, v, a, gravity=gravity)


def _columns(A: Array, x: Array) -> Array:
    return np.asarray(np.einsum("mn...,n...->m...", A, x))


def _transposed(J: Array, force: Array) -> Array:
    return np.asarray(np.einsum("mn...,m...->n...", J, force))


def _task(
    chain: Chain, q: ArrayLike, v: ArrayLike, target: ArrayLike, rows: Sequence[int]
) -> tuple[Array, Array, Array]:
    """Return rows of the Jacobian, error and rate of the task."""
    chosen = [count(f"rows[{i}]", row, 0, 5) for i, row in enumerate(rows)]
    pose, J = tip(chain, q), jacobian(chain, q)[chosen]
    goal = vector("target", target, (3,), (7,), (3, None), (7, None))
    if len(goal) == 3:
        count("max(rows)", max(chosen, default=-1), 0, 2)
        e = (goal.T - pose[:3].T).T[chosen]
    else:
        e = pose_error(np.broadcast_to(goal.T, pose.T.shape).T, pose)[chosen]
    return J, e, _columns(J, np.asarray(vector("v", v, np.shape(q))))
