"""The integrators of chapter 1: one small function each, for vectors and for rotations alike.

A *system* is positions q that live on a manifold, velocities v that live in its tangent space, and
`acceleration(q, v, params)`, the rates of v. Where q has as many components as v the manifold is a
plain vector space. Where q has one more, its last four components are a unit quaternion and the
last three of v are the angular velocity in the body frame: the layout of MuJoCo's joints. Moving
from q by a small u is then `retract(q, u)`: add, and for the quaternion multiply by exp(u). No
integrator but `rk4_renormalised` ever adds two quaternions.

Axis 0 holds the components: q is (nq,) for one body and (nq, N) for N of them, and every function
here takes both. From Python these are plain NumPy functions that take any callable; `simulate`
compiles the same source for long runs.

Sources: Hairer, Lubich, Wanner, Geometric Numerical Integration (2006), ch. I, IV, VI; for the
Lie-group forms Munthe-Kaas, High order Runge-Kutta methods on manifolds (1999), and Iserles et al.,
Lie-group methods (2000), sec. 2-3.
"""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable
from numpy.typing import NDArray

from course.check import count, invalid, one_of, positive, vector
from course.compiled import MATRIX, VECTOR, acceleration_type, compiled, function_argument
from course.rigid_body.quaternion import cross, derivative, exp, normalise, product

STANDARD_GRAVITY = 9.80665  # m/s^2, by definition (3rd CGPM, 1901)

Array = NDArray[np.float64]
Acceleration = Callable[[Any, Any, Any], Any]
Step = Callable[..., tuple[Any, Any]]


@register_jitable
def retract(q, u):
    """Move from q along the tangent vector u.

    Args:
        q: positions, shape (nq,) or (nq, N).
        u: tangent vector, shape (nv,) or (nv, N); rotations as rotation vectors in the body
            frame [rad].

    Returns:
        q + u for a vector space (nq = nv); with nq = nv + 1 the last four components are
        multiplied by exp(u[-3:]) instead.
    """
    if q.shape[0] == u.shape[0]:
        return q + u
    n = u.shape[0] - 3
    result = np.empty_like(q)
    # A rotation in the body frame multiplies from the right: q becomes q exp(u).
    turned = product(q[n:], exp(u[n:]))
    # Row by row, which for one body is number by number and compiles far faster than slices.
    for i in range(n):
        result[i] = q[i] + u[i]
    for i in range(4):
        result[n + i] = turned[i]
    return result


@register_jitable
def bracket(q, a, b):
    """Return how far two small moves a and b from q fail to commute.

    It compares exp(a) exp(b) with exp(b) exp(a).

    Args:
        q: base point, shape (nq,) or (nq, N); only its size matters.
        a: tangent vector, shape (nv,) or (nv, N).
        b: tangent vector, same shape.

    Returns:
        Zero in a vector space; the cross product of the rotational parts otherwise.
    """
    result = np.zeros_like(a)
    if q.shape[0] != a.shape[0]:
        n = a.shape[0] - 3
        # On SO(3) two moves commute up to the cross product of their rotation vectors.
        both = cross(a[n:], b[n:])
        for i in range(3):
            result[n + i] = both[i]
    return result


@register_jitable
def explicit_euler(q, v, acceleration, dt, params):
    """Return one step with the old velocity and the old acceleration. First order.

    On an oscillator it multiplies the energy by 1 + (omega dt)^2 at every step, so without
    damping it is unstable at any step (Hairer, Lubich, Wanner 2006, sec. I.1).

    Args:
        q: positions, shape (nq,) or (nq, N) [m or rad, or a unit quaternion].
        v: velocities, shape (nv,) or (nv, N) [m/s or rad/s].
        acceleration: function (q, v, params) -> rates of v, shape of v.
        dt: step [s].
        params: handed on to `acceleration`.

    Returns:
        The new (q, v); the inputs are left as they were.
    """
    return retract(q, dt * v), v + dt * acceleration(q, v, params)


@register_jitable
def semi_implicit_euler(q, v, acceleration, dt, params):
    """Return one step: the velocity first, then the position with the new velocity.

    First order; symplectic if the forces come from a potential of q, and masses and step are
    constant. On an undamped oscillator it is stable while omega * dt < 2; at equality the state
    grows linearly (Hairer, Lubich, Wanner 2006, sec. I.1).

    Args, Returns: as for `explicit_euler`.
    """
    # Velocity first; the position then uses the new one. If the acceleration is the slope of a
    # potential of q, this makes the map symplectic; with rotations it depends on v too.
    v = v + dt * acceleration(q, v, params)
    return retract(q, dt * v), v


@register_jitable
def velocity_verlet(q, v, acceleration, dt, params):
    """Return one step of velocity Verlet. Second order.

    Symplectic under the same conditions as `semi_implicit_euler`. A force that depends on the
    velocity enters the second evaluation with the velocity predicted by an Euler step, which keeps
    the second order; stability limit omega * dt < 2 without damping (Swope et al. 1982; Hairer,
    Lubich, Wanner 2006, sec. I.3).

    Args, Returns: as for `explicit_euler`.
    """
    a0 = acceleration(q, v, params)
    # The position moves by its Taylor polynomial of second order.
    q = retract(q, dt * (v + 0.5 * dt * a0))
    # The predicted velocity v + dt a0 keeps second order where the force depends on it.
    a1 = acceleration(q, v + dt * a0, params)
    return q, v + 0.5 * dt * (a0 + a1)


@register_jitable
def explicit_midpoint(q, v, acceleration, dt, params):
    """Return one step with the velocity and acceleration of an Euler half step. Second order.

    Not symplectic: on an undamped oscillator the energy grows by (omega dt)^4 / 4 per step, at
    any step (Runge 1895).

    Args, Returns: as for `explicit_euler`.
    """
    # Runge's midpoint rule: an Euler half step to the middle, then the full step with the rates
    # there.
    half = 0.5 * dt
    v_mid = v + half * acceleration(q, v, params)
    a_mid = acceleration(retract(q, half * v), v_mid, params)
    return retract(q, dt * v_mid), v + dt * a_mid


# Simplified Newton: one Jacobian per step by forward differences, then cheap corrections.
_NEWTON_STEPS = 25
_NEWTON_TOLERANCE = 1e-14
_DIFFERENCE = 1.5e-8  # about the square root of the rounding unit


@register_jitable
def implicit_midpoint(q, v, acceleration, dt, params):
    """Return one step of the implicit midpoint rule.

    Second order, A-stable; for vectors symplectic under the same conditions as
    `semi_implicit_euler`.

    Solves w = v + dt/2 a(q (+) dt/2 w, w) for the mid velocity w by a simplified Newton
    iteration, then q1 = q (+) dt w and v1 = 2 w - v. It keeps quadratic invariants, so the
    kinetic energy of a torque-free body and the size of its angular momentum are kept to
    rounding; the direction of the latter in space is not, only to second order
    (Hairer, Lubich, Wanner 2006, sec. IV.2). The linear system I - dt/2 da/dv - dt^2/4 da/dq is
    eliminated without pivoting: for damped or gyroscopic forces its symmetric part is positive.

    Args: as for `explicit_euler`.

    Returns:
        The new (q, v); NaN where the iteration has not converged in 25 corrections.
    """
    n = v.shape[0]
    half = 0.5 * dt
    # Predictor for the mid velocity: an explicit half step.
    w = v + half * acceleration(q, v, params)
    # The residual is in the mid velocity alone: the mid position follows from it by half a step.
    residual = w - v - half * acceleration(retract(q, half * w), w, params)
    # Newton's matrix of the residual by forward differences, once a step.
    # lower[j, i] and upper parts share one array: column j of the Jacobian in row j.
    jacobian = np.empty((n,) + v.shape)
    for j in range(n):
        moved = w.copy()
        # The difference is relative to the component's size; the 1 covers a component at rest.
        size = _DIFFERENCE * (1.0 + np.max(np.abs(w[j])))
        moved[j] = moved[j] + size
        shifted = moved - v - half * acceleration(retract(q, half * moved), moved, params)
        for i in range(n):
            jacobian[j, i] = (shifted[i] - residual[i]) / size
    # LU factors without pivoting: for a small step the matrix is near the identity.
    for k in range(n):
        for i in range(k + 1, n):
            factor = jacobian[k, i] / jacobian[k, k]
            jacobian[k, i] = factor
            for j in range(k + 1, n):
                jacobian[j, i] = jacobian[j, i] - factor * jacobian[j, k]
    converged = False
    # Simplified Newton iterations: forward and back substitution with the old factors.
    for _ in range(_NEWTON_STEPS):
        correction = residual.copy()
        # L has a unit diagonal, so the forward substitution needs no division.
        for i in range(n):
            for j in range(i):
                correction[i] = correction[i] - jacobian[j, i] * correction[j]
        for back in range(n):
            i = n - 1 - back
            for j in range(i + 1, n):
                correction[i] = correction[i] - jacobian[j, i] * correction[j]
            correction[i] = correction[i] / jacobian[i, i]
        w = w - correction
        # The size of the last correction, relative to the mid velocity, decides.
        if np.max(np.abs(correction)) <= _NEWTON_TOLERANCE * (1.0 + np.max(np.abs(w))):
            converged = True
            break
        residual = w - v - half * acceleration(retract(q, half * w), w, params)
    # Not converged: NaN, so that nobody takes the step for a good one.
    if not converged:
        w = w * np.nan
    # Both come from the mid velocity: v1 = v + 2 (w - v).
    return retract(q, dt * w), 2.0 * w - v


# RK4's two forms of sum, as functions so that each is compiled once and not at every place.
@register_jitable
def _along(x, h, rate):
    return x + h * rate


@register_jitable
def _mean(k1, k2, k3, k4):
    return (k1 + 2.0 * (k2 + k3) + k4) / 6.0


@register_jitable
def rk4(q, v, acceleration, dt, params):
    """Return one step of the classical fourth-order method; on rotations its Munthe-Kaas form.

    On rotations the four velocities belong to different orientations and may not simply be
    averaged. Two brackets make up for it, which is all that fourth order needs (Munthe-Kaas and
    Owren, Computations in a free Lie algebra, 1999); in a vector space they are zero. Not
    symplectic; on an undamped oscillator stable while omega * dt <= 2 sqrt(2), where the energy
    shrinks by (omega dt)^6 / 72 per step (Kutta 1901).

    Args, Returns: as for `explicit_euler`.
    """
    half = 0.5 * dt
    a1 = acceleration(q, v, params)
    v2 = _along(v, half, a1)
    a2 = acceleration(retract(q, half * v), v2, params)
    v3 = _along(v, half, a2)
    # The rotation for the third evaluation. Its two angular velocities belong to different
    # orientations, so a cross product (the bracket) corrects it (Munthe-Kaas).
    turn = _along(half * v2, 0.125 * dt * dt, bracket(q, v, v2))
    a3 = acceleration(retract(q, turn), v3, params)
    v4 = _along(v, dt, a3)
    a4 = acceleration(retract(q, dt * v3), v4, params)
    # The rotation of the step: the average of the four angular velocities, and a second correction.
    turn = _along(dt * _mean(v, v2, v3, v4), dt * dt / 12.0, bracket(q, v, v4))
    return retract(q, turn), _along(v, dt, _mean(a1, a2, a3, a4))


@register_jitable
def _coordinate_rate(q, v):
    """Return dq/dt as plain numbers: the quaternion's own rate q * (0, omega) / 2."""
    if q.shape[0] == v.shape[0]:
        return v
    n = v.shape[0] - 3
    result = np.empty_like(q)
    turning = derivative(q[n:], v[n:])
    for i in range(n):
        result[i] = v[i]
    for i in range(4):
        result[n + i] = turning[i]
    return result


@register_jitable
def rk4_renormalised(q, v, acceleration, dt, params):
    """Return RK4 on the four numbers of the quaternion, scaled back to length one after the step.

    The usual shortcut, here to be compared with `rk4`: also fourth order, but its stages leave
    the unit sphere, and the angular error of a steady spin is set by the rescaling.

    Args, Returns: as for `explicit_euler`.
    """
    half = 0.5 * dt
    # The four stages of classical RK4, with the quaternion's four numbers as a plain vector.
    k1 = _coordinate_rate(q, v)
    a1 = acceleration(q, v, params)
    q2 = _along(q, half, k1)
    v2 = _along(v, half, a1)
    k2 = _coordinate_rate(q2, v2)
    a2 = acceleration(q2, v2, params)
    q3 = _along(q, half, k2)
    v3 = _along(v, half, a2)
    k3 = _coordinate_rate(q3, v3)
    a3 = acceleration(q3, v3, params)
    q4 = _along(q, dt, k3)
    v4 = _along(v, dt, a3)
    k4 = _coordinate_rate(q4, v4)
    a4 = acceleration(q4, v4, params)
    q = _along(q, dt, _mean(k1, k2, k3, k4))
    # Renormalise: pull the four numbers back onto the unit sphere.
    if q.shape[0] != v.shape[0]:
        n = v.shape[0] - 3
        unit = normalise(q[n:])
        for i in range(4):
            q[n + i] = unit[i]
    return q, _along(v, dt, _mean(a1, a2, a3, a4))


@dataclass(frozen=True)
class Integrator:
    """What the course states about one integrator, so that tests can hold it to that.

    Attributes:
        name: name of the step function.
        label: what a reader sees: on a chart, in a menu.
        step: the step function.
        order: theoretical order of accuracy.
        symplectic: whether it preserves phase-space area for forces that depend on q alone.
    """

    name: str
    label: str
    step: Step
    order: int
    symplectic: bool


INTEGRATORS: dict[str, Integrator] = {
    item.name: item
    for item in (
        Integrator("explicit_euler", "explicit Euler", explicit_euler, 1, False),
        Integrator("semi_implicit_euler", "semi-implicit Euler", semi_implicit_euler, 1, True),
        Integrator("velocity_verlet", "velocity Verlet", velocity_verlet, 2, True),
        Integrator("explicit_midpoint", "explicit midpoint", explicit_midpoint, 2, False),
        Integrator("implicit_midpoint", "implicit midpoint", implicit_midpoint, 2, True),
        Integrator("rk4", "RK4", rk4, 4, False),
        Integrator("rk4_renormalised", "RK4, renormalised", rk4_renormalised, 4, False),
    )
}


@dataclass(frozen=True)
class System:
    """A mechanical system that any integrator can step.

    Attributes:
        name: what it is.
        acceleration: function (q, v, params) -> rates of v. To be compiled it must be a
            top-level function in the subset of Python that numba knows.
        params: numbers handed to `acceleration`, shape (k,).
        q0: initial positions, shape (nq,) or (nq, N).
        v0: initial velocities, shape (nv,) or (nv, N).
        energy: function (q, v, params) -> total energy per body [J], or None.
        compile: whether `simulate` may compile `acceleration`.
    """

    name: str
    acceleration: Acceleration
    params: Array
    q0: Array
    v0: Array
    energy: Callable[[Any, Any, Any], Any] | None = None
    compile: bool = True

    def __post_init__(self) -> None:
        for field in ("params", "q0", "v0"):
            value = vector(field, getattr(self, field))
            object.__setattr__(self, field, np.array(value, order="C"))
        # One more position than velocities means a unit quaternion in the last four rows of q.
        nq, nv = self.q0.shape[0], self.v0.shape[0]
        if nq - nv not in (0, 1) or self.q0.shape[1:] != self.v0.shape[1:]:
            raise invalid(
                "(q0.shape, v0.shape)",
                (self.q0.shape, self.v0.shape),
                "nv = nq, or nv = nq - 1 with a unit quaternion in the last four rows of q0",
            )


@dataclass(frozen=True)
class Trajectory:
    """Recorded states.

    Attributes:
        t: times, shape (R,) [s].
        q: positions, shape (R, nq) or (R, nq, N).
        v: velocities, shape (R, nv) or (R, nv, N).
    """

    t: Array
    q: Array
    v: Array


def advance(q, v, step, acceleration, dt, steps, params):
    """Return the state after `steps` steps."""
    for _ in range(steps):
        q, v = step(q, v, acceleration, dt, params)
    return q, v


def advance_recorded(q, v, step, acceleration, dt, records, every, params):
    """Take `records` times `every` steps and record states.

    The states before the first and after each `every` steps are recorded.
    """
    qs = np.empty((records + 1,) + q.shape)
    vs = np.empty((records + 1,) + v.shape)
    # Component by component, which serves one body and a batch and compiles faster than slices.
    for i in range(records + 1):
        for k in range(q.shape[0]):
            qs[i, k] = q[k]
        for k in range(v.shape[0]):
            vs[i, k] = v[k]
        if i < records:
            for _ in range(every):
                q, v = step(q, v, acceleration, dt, params)
    return qs, vs


def _step_type(array: types.Array) -> Any:
    pair = types.UniTuple(array, 2)
    return pair(array, array, acceleration_type(array), numba.float64, VECTOR)


@functools.cache
def compiled_parts(acceleration: Acceleration, integrator: str, ndim: int) -> tuple[Any, Any, Any]:
    """Return what a compiled run is made of.

    Args:
        acceleration: a plain top-level function.
        integrator: a name in INTEGRATORS.
        ndim: 1 for one body, 2 for a batch.

    Returns:
        (run, step, acceleration), all compiled for states of that dimension; run is
        `advance_recorded` for one body and `advance` for a batch, whose states one seldom wants to
        keep.
    """
    array = VECTOR if ndim == 1 else MATRIX
    step_type = _step_type(array)
    # One explicit signature per dimension; step and acceleration come in as typed function
    # arguments.
    first = (array, array, types.FunctionType(step_type), acceleration_type(array), numba.float64)
    if ndim == 1:
        run = compiled(
            advance_recorded, types.UniTuple(MATRIX, 2)(*first, numba.int64, numba.int64, VECTOR)
        )
    else:
        run = compiled(advance, types.UniTuple(array, 2)(*first, numba.int64, VECTOR))
    return (
        run,
        function_argument(compiled(INTEGRATORS[integrator].step, step_type)),
        function_argument(compiled(acceleration, acceleration_type(array).signature)),
    )


def simulate(
    system: System,
    integrator: str | Step,
    dt: float,
    steps: int,
    every: int | None = None,
) -> Trajectory:
    """Take `steps` steps of `dt` from the system's initial state.

    Args:
        system: what to integrate.
        integrator: a name in INTEGRATORS, or a step function of your own
            (q, v, acceleration, dt, params) -> (q, v), which then runs as plain Python.
        dt: step [s], positive.
        steps: number of steps.
        every: steps between recorded states; default: only the first and the last.

    Returns:
        The recorded states. A run that blows up goes on to infinity or NaN; nothing is clamped.

    Raises:
        ValueError: for an unknown integrator, or dt, steps or every out of range.
    """
    if isinstance(integrator, str):
        one_of("integrator", integrator, INTEGRATORS)
    positive("dt", dt, unit="s")
    count("steps", steps, 1)
    every = steps if every is None else count("every", every, 1)
    if steps % every:
        raise invalid("every", every, f"a divisor of steps = {steps}")
    records = steps // every
    # Only a single body is compiled here: `spatial.advance_bodies` is for batches.
    use_compiled = isinstance(integrator, str) and system.compile and system.q0.ndim == 1
    with np.errstate(over="ignore", invalid="ignore"):
        if use_compiled:
            run, step, acceleration = compiled_parts(system.acceleration, str(integrator), 1)
        else:
            run, acceleration = advance_recorded, system.acceleration
            step = INTEGRATORS[integrator].step if isinstance(integrator, str) else integrator
        # A copy of the start: a step of the reader's may work in place.
        q0, v0 = system.q0.copy(), system.v0.copy()
        q, v = run(q0, v0, step, acceleration, dt, records, every, system.params)
    times = dt * every * np.arange(records + 1, dtype=np.float64)
    return Trajectory(times, q, v)


def evaluations_per_step(
    system: System, integrator: str | Step, dt: float, steps: int = 20
) -> float:
    """Return the mean number of force evaluations a step takes, counted on a short plain run.

    Args:
        system: what to integrate.
        integrator: a name in INTEGRATORS or a step function.
        dt: step [s].
        steps: length of the counting run.

    Returns:
        Evaluations of `acceleration` per step; not a whole number for implicit methods.
    """
    calls = 0

    # Counted in plain Python, since a compiled run could not call the counter.
    def counting(q: Any, v: Any, params: Any) -> Any:
        nonlocal calls
        calls += 1
        return system.acceleration(q, v, params)

    step = INTEGRATORS[integrator].step if isinstance(integrator, str) else integrator
    q, v = system.q0.copy(), system.v0.copy()
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(steps):
            q, v = step(q, v, counting, dt, system.params)
    return calls / steps
