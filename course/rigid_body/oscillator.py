"""One step of a method on the damped oscillator x'' = -omega^2 x - 2 zeta omega x'.

It stands here twice, and the tests compare the two: `step_matrix` is derived by hand, from which
the limits follow; `stepper` runs the integrator itself. One step is a matrix whose entries are
polynomials in omega dt (fractions for an implicit method). It is stable while both eigenvalues lie
in the closed unit disc, and a double one inside it. For trace T and determinant D the disc means
|T| <= 1 + D and D <= 1 (Jury's criterion for a 2 x 2 matrix), so each limit is the smallest root of
three polynomials.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.polynomial import Polynomial

from course.check import finite, one_of
from course.rigid_body.integrators import (
    INTEGRATORS,
    Array,
    explicit_euler,
    explicit_midpoint,
    implicit_midpoint,
    rk4,
    semi_implicit_euler,
    velocity_verlet,
)
from course.rigid_body.problems import oscillator_acceleration

METHODS = (
    "explicit_euler",
    "semi_implicit_euler",
    "velocity_verlet",
    "explicit_midpoint",
    "implicit_midpoint",
    "rk4",
)


@register_jitable
def step_under(number, q, v, acceleration, dt, params):
    """Advance a system by one step of METHODS[number].

    Compiled code can't look a method up by name.

    Args:
        number: of the method.
        q: positions, shape (nq,) or (nq, N).
        v: velocities, shape (nv,) or (nv, N).
        acceleration: function (q, v, params) -> rates of v, shape of v.
        dt: step [s].
        params: handed on to `acceleration`.

    Returns:
        The new (q, v).
    """
    if number == 0:
        return explicit_euler(q, v, acceleration, dt, params)
    if number == 1:
        return semi_implicit_euler(q, v, acceleration, dt, params)
    if number == 2:
        return velocity_verlet(q, v, acceleration, dt, params)
    if number == 3:
        return explicit_midpoint(q, v, acceleration, dt, params)
    if number == 4:
        return implicit_midpoint(q, v, acceleration, dt, params)
    return rk4(q, v, acceleration, dt, params)


@register_jitable
def step_of(number, q, v, dt, params):
    """Advance the oscillator by one step of METHODS[number].

    Args:
        number: of the method.
        q: position, shape (1,) or (1, N).
        v: velocity, same shape.
        dt: step [s].
        params: omega [rad/s] and zeta.

    Returns:
        The new (q, v).
    """
    return step_under(number, q, v, oscillator_acceleration, dt, params)


# Runge-Kutta with as many stages as its order: the exponential series, cut off there.
_DEGREES = {"explicit_euler": 1, "explicit_midpoint": 2, "rk4": 4}


def stepper(
    method: str, dt: Any, zeta: Any = 0.0, omega: Any = 1.0
) -> Callable[[np.ndarray], np.ndarray]:
    """Return one step by running the integrator, as (x, x') -> (x, x').

    Args:
        method: name of an integrator.
        dt: step [s].
        zeta: damping ratio.
        omega: undamped angular frequency [rad/s]. SymPy symbols will do for all three, with
            states of symbols; but not for `implicit_midpoint`, which iterates on numbers.
    """
    step, params = INTEGRATORS[method].step, np.array([omega, zeta])

    def linear(state: np.ndarray) -> np.ndarray:
        q, v = step(state[:1], state[1:], oscillator_acceleration, dt, params)
        return np.concatenate([q, v])

    return linear


def _entries(method: str, x: Any, zeta: Any) -> tuple[Any, ...]:
    """Return the entries (a, b, c, d) of one step's matrix on (q, v / omega).

    x = omega dt and zeta may be in any arithmetic.
    """
    if method == "semi_implicit_euler":
        # v1 = v + x (-q - 2 zeta v), q1 = q + x v1
        c, d = -x, 1 - 2 * zeta * x
        return 1 + x * c, x * d, c, d
    if method == "velocity_verlet":
        # a0 = -q - 2 zeta v; q1 = q + x v + x^2 a0 / 2; a1 at q1 and at the predicted v + x a0
        a, b = 1 - x**2 / 2, x - zeta * x**2
        a1_q = -a + 2 * zeta * x
        a1_v = -b - 2 * zeta * (1 - 2 * zeta * x)
        return a, b, x * (a1_q - 1) / 2, 1 + x * (a1_v - 2 * zeta) / 2
    if method == "implicit_midpoint":
        # (I - x G / 2)^-1 (I + x G / 2) with the generator G = [[0, 1], [-1, -2 zeta]]
        quarter = x**2 / 4
        common = 1 + zeta * x + quarter
        turn = x / common
        return (1 + zeta * x - quarter) / common, turn, -turn, (1 - zeta * x - quarter) / common
    # Runge-Kutta with as many stages as its order: partial sums of exp(x G).
    total: tuple[Any, ...] = (1, 0, 0, 1)
    term = total
    for k in range(1, _DEGREES[method] + 1):
        # The next term of the exponential series: x G / k times the last one.
        a, b, c, d = (x * entry / k for entry in term)
        term = (c, d, -a - 2 * zeta * c, -b - 2 * zeta * d)
        total = tuple(old + new for old, new in zip(total, term, strict=True))
    return total


def step_matrix(method: str, omega_dt: Any, zeta: Any) -> Array:
    """Return one step of a method, derived by hand, as a matrix acting on (q, v / omega).

    Args:
        method: one of `METHODS`.
        omega_dt: natural frequency times step; a SymPy symbol will do.
        zeta: damping ratio; likewise.

    Returns:
        Shape (2, 2); of SymPy expressions where symbols came in.
    """
    _check(method)
    return np.array(_entries(method, omega_dt, zeta)).reshape(2, 2)


def limit(method: str, zeta: float) -> float:
    """Return the largest stable omega dt of a method.

    Closed forms among them: explicit Euler 2 zeta, or 2 / (zeta + sqrt(zeta^2 - 1)) when
    overdamped; semi-implicit Euler with the damper explicit 2 (sqrt(1 + zeta^2) - zeta); velocity
    Verlet, undamped, 2; RK4, undamped, 2 sqrt(2); implicit midpoint none.

    Args:
        method: one of `METHODS`; velocity Verlet with the velocity predicted by an Euler step
            where the force needs it.
        zeta: damping ratio, not negative.

    Returns:
        The limit; 0 where no step is stable, infinity where every step is.
    """
    _check(method, zeta)
    # The implicit midpoint rule is A-stable.
    if method == "implicit_midpoint":
        return math.inf
    a, b, c, d = _entries(method, Polynomial([0.0, 1.0]), zeta)
    # Jury's conditions: both eigenvalues lie inside the unit circle while all three are positive.
    trace, determinant = a + d, a * d - b * c
    conditions = (1.0 - determinant, 1.0 + determinant + trace, 1.0 + determinant - trace)
    return min(_first_negative(condition) for condition in conditions)


def implicit_damping_limit(zeta: float) -> float:
    """Return semi-implicit Euler with the damper taken implicitly: 2 (sqrt(1 + zeta^2) + zeta).

    v1 = (v - x q) / (1 + 2 zeta x), q1 = q + x v1 has D = 1 / (1 + 2 zeta x) and
    T = 1 + (1 - x^2) D, and 1 + T + D >= 0 gives x^2 - 4 zeta x - 4 <= 0.
    """
    _check("semi_implicit_euler", zeta)
    return 2.0 * (math.sqrt(1.0 + zeta**2) + zeta)


def _check(method: str, zeta: float = 0.0) -> None:
    one_of("method", method, METHODS)
    finite("zeta", zeta, 0.0)


def _first_negative(condition: Polynomial) -> float:
    """Return the smallest x >= 0 above which a polynomial is negative; infinity if never."""
    scale = float(np.max(np.abs(condition.coef)))
    if scale == 0.0:
        return math.inf
    # What cancels in theory leaves rounding behind, which would make roots near zero.
    coefficients = np.where(np.abs(condition.coef) > 1e-14 * scale, condition.coef, 0.0)
    lowest = int(np.flatnonzero(coefficients)[0])
    # The lowest power that is present decides the sign just above zero.
    if coefficients[lowest] < 0.0:
        return 0.0
    # Dividing by that power of x takes away the roots at zero.
    reduced = Polynomial(coefficients[lowest:]).trim()
    roots = reduced.roots()
    real = np.sort(roots.real[np.abs(roots.imag) <= 1e-7 * np.abs(roots)])
    for root in real[real > 0.0]:
        # A touching root does not change the sign; only a crossing is the limit.
        if reduced(root * (1.0 + 1e-5)) < 0.0:
            return float(root)
    return math.inf
