"""One step of an integrator on the oscillator as a 2 x 2 matrix, derived from the code that steps.

The integrators of chapter 1 are plain functions over arrays, so they also take arrays of SymPy
symbols: the matrix below comes out of the function that the simulations run. `implicit_midpoint`
iterates in floating point, so its matrix is solved from its defining equations.
"""

import functools
from typing import Any

import numpy as np


@functools.cache
def symbols() -> Any:
    """(h, omega, zeta) as positive SymPy symbols."""
    import sympy

    return sympy.symbols("h omega zeta", positive=True)


@functools.cache
def step_matrix(name: str, damped: bool = False) -> Any:
    """Matrix A of (x, v) -> A (x, v) for x'' = -omega^2 x - 2 zeta omega x'.

    Args:
        name: name of an integrator of `course.rigid_body`.
        damped: False sets zeta = 0.

    Returns:
        SymPy matrix in the symbols h, omega and zeta.
    """
    import sympy

    from course.rigid_body.integrators import INTEGRATORS
    from course.rigid_body.problems import oscillator_acceleration

    h, omega, zeta = symbols()
    rates = sympy.Matrix([[0, 1], [-(omega**2), -2 * zeta * omega if damped else 0]])
    if name == "implicit_midpoint":
        half = h * rates / 2
        return ((sympy.eye(2) - half).inv() * (sympy.eye(2) + half)).applyfunc(sympy.cancel)
    params = (omega, zeta if damped else sympy.Integer(0))
    columns = []
    for x, v in ((1, 0), (0, 1)):
        q, w = INTEGRATORS[name].step(
            np.array([sympy.Integer(x)], dtype=object),
            np.array([sympy.Integer(v)], dtype=object),
            oscillator_acceleration,
            h,
            params,
        )
        columns.append(
            [sympy.expand(sympy.nsimplify(sympy.expand(c[0]), rational=True)) for c in (q, w)]
        )
    return sympy.Matrix(columns).T


def numeric_matrix(name: str, omega_h: float, zeta: float = 0.0) -> np.ndarray:
    """The same matrix as numbers, for omega = 1, by running the integrator itself.

    Args:
        name: name of an integrator.
        omega_h: omega times the step.
        zeta: damping ratio.

    Returns:
        Array of shape (2, 2).
    """
    from course.rigid_body.integrators import INTEGRATORS
    from course.rigid_body.problems import oscillator_acceleration

    step = INTEGRATORS[name].step
    params = np.array([1.0, zeta])
    columns = [
        np.concatenate(step(np.array([x]), np.array([v]), oscillator_acceleration, omega_h, params))
        for x, v in ((1.0, 0.0), (0.0, 1.0))
    ]
    return np.array(columns).T


def spectral_radius(name: str, omega_h: float, zeta: float = 0.0) -> float:
    """Largest modulus of the eigenvalues of one step."""
    return float(np.abs(np.linalg.eigvals(numeric_matrix(name, omega_h, zeta))).max())


def measured_limit(name: str, zeta: float = 0.0, low: float = 0.0, high: float = 8.0) -> float:
    """Largest stable omega * h by bisection on the spectral radius, to nine digits.

    Args:
        name: name of an integrator.
        zeta: damping ratio.
        low: a product at which it is stable, or 0.
        high: a product at which it is not.
    """
    for _ in range(40):
        middle = 0.5 * (low + high)
        if spectral_radius(name, middle, zeta) <= 1.0 + 1e-10:
            low = middle
        else:
            high = middle
    return low
