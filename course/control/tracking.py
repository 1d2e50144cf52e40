"""The loop around a law: an arm that is measured, commanded and moves until the next sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numba
import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import bounds, count, finite, invalid, one_of, positive, vector
from course.compiled import MATRIX, VECTOR, loop
from course.control.joint import Record
from course.control.laws import Arm, computed_torque, feedforward, gain, like, pd, pd_gravity
from course.kinematics import TwoLink, forward_dynamics
from course.kinematics.dynamics import DOWNWARDS
from course.kinematics.motion import CUBE
from course.kinematics.two_link import TORQUES
from course.kinematics.two_link import acceleration as two_link_acceleration

Array = NDArray[np.float64]

KINDS = ("pd", "pd_gravity", "feedforward", "computed_torque")


@dataclass(frozen=True)
class JointLaw:
    """One of the laws of joints with its model and gains, as `track` takes it.

    Attributes:
        kind: one of `KINDS`.
        model: what the law believes the arm to be.
        kp, kd: gains; those of computed torque are before the inertia.
        preview: for computed torque, the sample time (or 0): see `computed_torque` [s].
        gravity: of a `Chain`, shape (3,) [m/s^2].
    """

    kind: str
    model: Arm
    kp: ArrayLike
    kd: ArrayLike
    preview: float = 0.0
    gravity: Any = DOWNWARDS

    def __post_init__(self) -> None:
        one_of("kind", self.kind, KINDS)
        last = 0.0 if self.kind != "computed_torque" else np.inf
        finite("preview", self.preview, 0.0, last, unit="s")

    def __call__(
        self, q: ArrayLike, v: ArrayLike, q_ref: ArrayLike, v_ref: ArrayLike, a_ref: ArrayLike
    ) -> Array:
        """Return torques, shape of q [N m]."""
        gains, near = (self.kp, self.kd), self.gravity
        if self.kind == "pd":
            return pd(q, v, q_ref, v_ref, *gains)
        if self.kind == "pd_gravity":
            return pd_gravity(self.model, q, v, q_ref, v_ref, *gains, gravity=near)
        if self.kind == "feedforward":
            return feedforward(self.model, q, v, q_ref, v_ref, a_ref, *gains, gravity=near)
        return computed_torque(
            self.model, q, v, q_ref, v_ref, a_ref, *gains, self.preview, gravity=near
        )


@register_jitable
def two_link_torque(arm, i, q1, q2, v1, v2, a1, a2):
    """Return torques of a motion by column i of `TwoLink.column`, as in its module's equations."""
    a, b, d = arm[0, i], arm[1, i], arm[2, i]
    c, s = np.cos(q2), np.sin(q2)
    hanging = arm[10, i] * np.cos(q1 + q2)
    # Equation of motion: inertia, Coriolis and centrifugal torques; damping and gravity follow.
    t1 = (a + 2.0 * b * c) * a1 + (d + b * c) * a2 - b * s * v2 * (2.0 * v1 + v2)
    t2 = (d + b * c) * a1 + d * a2 + b * s * v1 * v1 + arm[4, i] * v2 + hanging
    return t1 + arm[3, i] * v1 + arm[9, i] * np.cos(q1) + hanging, t2


@register_jitable
def _held(body, q, v, h, steps):
    """Return states of two-link arms, columns of `body`, after steps of h under their torques."""
    # Classical Runge-Kutta for all arms at once; the torque is held.
    for _ in range(steps):
        a1 = two_link_acceleration(q, v, body)
        s2 = v + 0.5 * h * a1
        a2 = two_link_acceleration(q + 0.5 * h * v, s2, body)
        s3 = v + 0.5 * h * a2
        a3 = two_link_acceleration(q + 0.5 * h * s2, s3, body)
        s4 = v + h * a3
        a4 = two_link_acceleration(q + h * s3, s4, body)
        q = q + h / 6.0 * (v + 2.0 * s2 + 2.0 * s3 + s4)
        v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return q, v


def _rollouts(arm, plans, dt, substeps, q, v):
    """Every plan (T, 2, K) from the states q[0], v[0] on, into q and v (T + 1, 2, K)."""
    for k in range(plans.shape[0]):
        arm[TORQUES] = plans[k]
        q[k + 1], v[k + 1] = _held(arm, q[k], v[k], dt / substeps, substeps)


def _track(kind, model, arm, gains, half, references, dt, substeps, limit, q, v, tau):
    """Run the loop of two links; `q` and `v` (T + 1, 2, N) hold the start, `tau` (T, 2, N) nothing.

    `model` and `arm` are columns (13, N), `gains` kp over kd (4, 2), `references` (T, 6, N).
    """
    h = dt / substeps
    body = arm.copy()
    for k in range(tau.shape[0]):
        for i in range(q.shape[2]):
            r = references[k, :, i]
            q1, q2, v1, v2 = q[k, 0, i], q[k, 1, i], v[k, 0, i], v[k, 1, i]
            # Computed torque previews the state by half a sample.
            if kind == 3:
                q1 += half * v1 + 0.5 * half * half * r[4]
                q2 += half * v2 + 0.5 * half * half * r[5]
                v1, v2 = v1 + half * r[4], v2 + half * r[5]
            e1, e2, d1, d2 = r[0] - q1, r[1] - q2, r[2] - v1, r[3] - v2
            u1 = gains[0, 0] * e1 + gains[0, 1] * e2 + gains[2, 0] * d1 + gains[2, 1] * d2
            u2 = gains[1, 0] * e1 + gains[1, 1] * e2 + gains[3, 0] * d1 + gains[3, 1] * d2
            # Computed torque: the PD output is an acceleration, which inverse dynamics turns into
            # torques.
            if kind == 3:
                u1, u2 = two_link_torque(model, i, q1, q2, v1, v2, r[4] + u1, r[5] + u2)
            # Gravity at the present angles is added, or the torques of the whole reference motion.
            elif kind > 0:
                g1, g2 = two_link_torque(model, i, q1, q2, 0.0, 0.0, 0.0, 0.0)
                if kind == 2:
                    g1, g2 = two_link_torque(model, i, r[0], r[1], r[2], r[3], r[4], r[5])
                u1, u2 = u1 + g1, u2 + g2
            # Saturation of the drive, which the law knows nothing of.
            tau[k, 0, i] = min(max(u1, -limit[0]), limit[0])
            tau[k, 1, i] = min(max(u2, -limit[1]), limit[1])
        body[TORQUES] = tau[k]
        q[k + 1], v[k + 1] = _held(body, q[k], v[k], h, substeps)


_track_loop = loop(
    _track,
    numba.void(
        numba.int64,
        MATRIX,
        MATRIX,
        MATRIX,
        numba.float64,
        CUBE,
        numba.float64,
        numba.int64,
        VECTOR,
        CUBE,
        CUBE,
        CUBE,
    ),
)

_rollouts_loop = loop(_rollouts, numba.void(MATRIX, CUBE, numba.float64, numba.int64, CUBE, CUBE))


def rollouts(
    arm: TwoLink, plans: ArrayLike, dt: float, state: tuple[ArrayLike, ArrayLike], substeps: int = 1
) -> tuple[Array, Array]:
    """Simulate K plans of torques of two links, compiled.

    `mppi` and the other samplers score these rollouts.

    Args:
        arm: as it is believed to be.
        plans: torques, shape (K, T, 2), each held for a sample [N m].
        dt: sample time [s].
        state: (q, v) at the start, shape (2,) each or (2, K).
        substeps: Runge-Kutta steps in a sample.

    Returns:
        q and v, shape (T + 1, 2, K), the first the start; NaN where a plan diverged.
    """
    plans = np.ascontiguousarray(np.transpose(vector("plans", plans, (None, None, 2)), (1, 2, 0)))
    T, _, K = plans.shape
    q, v = np.empty((2, T + 1, 2, K))
    for i, (row, start) in enumerate(zip((q, v), state, strict=True)):
        given = vector(f"state[{i}]", start, (2,), (2, K))
        row[0] = given.reshape(2, -1)
    body = np.repeat(arm.column(), K, axis=1)
    _rollouts_loop(body, plans, positive("dt", dt), count("substeps", substeps, 1), q, v)
    return q, v


def track(
    chain: Arm,
    law: Callable[..., Array],
    reference: Any,
    dt: float,
    seconds: float,
    substeps: int = 1,
    state: tuple[ArrayLike, ArrayLike] | None = None,
    *,
    limit: ArrayLike = np.inf,
    gravity: ArrayLike = DOWNWARDS,
) -> Record:
    """Simulate an arm under a sampled law: measure, command, hold.

    Between samples a fourth-order Runge-Kutta method integrates.

    Two links under a `JointLaw` with a two-link model run compiled; everything else calls the law
    from Python. A run that diverges ends in NaN.

    Args:
        chain: the arm as it is, whatever the law believes.
        law: `law(q, v, q_ref, v_ref, a_ref) -> tau`. Where it has an attribute `preview`, a time,
            references are those half of that later.
        reference: `reference(times) -> (q_ref, v_ref, a_ref)`, each (n, T), or these three arrays,
            T being the number of samples. With an attribute `duration` it must last for the run.
        dt: sample time [s].
        seconds: length of the run [s]; T = seconds / dt.
        substeps: steps of the integrator in a sample.
        state: (q, v) at the start, shape (n,) or (n, N); default: the reference's first.
        limit: of the torques, a number or shape (n,); infinite for none [N m].
        gravity: for a `Chain`, shape (3,) [m/s^2].

    Returns:
        A `Record`, arrays (n, T + 1) or (n, N, T + 1); the run ends in q[..., -1], v[..., -1].

    Raises:
        ValueError: for a reference that is longer or shorter than the run, and other bad input.
    """
    dt = positive("dt", dt, unit="s")
    T = count("round(seconds / dt)", round(positive("seconds", seconds, unit="s") / dt), 1)
    count("substeps", substeps, 1)
    n = 2 if isinstance(chain, TwoLink) else chain.n
    largest = bounds("limit", limit, n)
    if not (largest > 0.0).all():
        raise invalid("limit", limit, "positive numbers [N m]")
    # A held command acts half a sample late on average: the reference is read that much ahead.
    times, half = np.linspace(0.0, T * dt, T + 1), 0.5 * float(getattr(law, "preview", 0.0))
    if callable(reference):
        lasts = float(getattr(reference, "duration", times[-1]))
        if abs(lasts - times[-1]) > 0.5 * dt:
            raise invalid("reference.duration", lasts, f"the length of the run, {times[-1]:g} s")
        now = _motions(reference(times[:-1]), n, T)
        desired = _motions(reference(times[:-1] + half), n, T)
    else:
        now = desired = _motions(reference, n, T)
    start = (now[0][:, 0], now[1][:, 0]) if state is None else state
    first = vector("state[0]", start[0], (n,), (n, None))
    single, size = first.ndim == 1, first.size // n
    q, v = np.full((2, T + 1, n, size), np.nan)
    tau = np.full((T, n, size), np.nan)
    q[0], v[0] = first.reshape(n, -1), like("state[1]", start[1], first).reshape(n, -1)
    rows = np.concatenate(desired).T[:, :, None]
    model = getattr(law, "model", None)
    # The compiled path: everything that the law needs is handed over as numbers.
    if isinstance(chain, TwoLink) and isinstance(law, JointLaw) and isinstance(model, TwoLink):
        gains = np.concatenate([gain("kp", law.kp, 2), gain("kd", law.kd, 2)])
        arms = [np.repeat(arm.column(), size, axis=1) for arm in (model, chain)]
        number, kind = np.repeat(rows, size, axis=2), KINDS.index(law.kind)
        _track_loop(kind, *arms, gains, half, number, dt, substeps, largest, q, v, tau)
    else:
        if isinstance(chain, TwoLink):
            body = np.repeat(chain.column(), size, axis=1)
        for k in range(T):
            # The arm has diverged: what follows stays NaN, as it was initialised.
            if not (np.isfinite(q[k]).all() and np.isfinite(v[k]).all()):
                break
            shape = (n,) if single else (n, size)
            motion = (np.broadcast_to(rows[k, i : i + n], (n, size)) for i in (0, n, 2 * n))
            given = law(
                q[k].reshape(shape), v[k].reshape(shape), *(x.reshape(shape) for x in motion)
            )
            tau[k] = np.clip(np.reshape(given, (n, size)).T, -largest, largest).T
            if isinstance(chain, TwoLink):
                _rollouts_loop(body, tau[k : k + 1], dt, substeps, q[k : k + 2], v[k : k + 2])
                continue
            with np.errstate(over="ignore", invalid="ignore"):  # NaN says that it diverged
                q[k + 1], v[k + 1] = _runge_kutta(
                    partial(forward_dynamics, chain, gravity=gravity),
                    q[k],
                    v[k],
                    tau[k],
                    dt / substeps,
                    substeps,
                )
    whole = [np.moveaxis(x[:, :, 0] if single else x, 0, -1) for x in (q, v, tau)]
    # The torque at the last instant is that of the last command.
    torque = np.concatenate([whole[2], whole[2][..., -1:]], axis=-1)
    return Record(times, whole[0], whole[1], torque, whole[2], whole[0][..., :-1], now[0])


def _motions(reference: Any, n: int, T: int) -> list[Array]:
    named = zip(("q_ref", "v_ref", "a_ref"), reference, strict=True)
    return [vector(name, value, (n, T)) for name, value in named]


def _runge_kutta(
    move: Callable[..., Array], q: Array, v: Array, tau: Array, h: float, steps: int
) -> tuple[Array, Array]:
    # Classical Runge-Kutta method for q' = v, v' = move(q, v, tau), with the torque held.
    for _ in range(steps):
        a1 = move(q, v, tau)
        s2 = v + 0.5 * h * a1
        a2 = move(q + 0.5 * h * v, s2, tau)
        s3 = v + 0.5 * h * a2
        a3 = move(q + 0.5 * h * s2, s3, tau)
        s4 = v + h * a3
        a4 = move(q + h * s3, s4, tau)
        q = q + h / 6.0 * (v + 2.0 * s2 + 2.0 * s3 + s4)
        v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return q, v
