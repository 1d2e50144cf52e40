"""One step of an integrator on the oscillator as a 2 x 2 matrix, from the code that steps.

The integrators of chapter 1 are plain functions over arrays, so they also take arrays of SymPy
symbols: the matrices come out of the functions that the simulations run.
"""

import functools
from typing import Any

import numpy as np


@functools.cache
def symbols() -> Any:
    """Return (h, omega, zeta) as positive SymPy symbols."""
    import sympy

    return sympy.symbols("h omega zeta", positive=True)


@functools.cache
def step_matrix(name: str, damped: bool = False) -> Any:
    """Return the matrix A of (x, v) -> A (x, v) for x'' = -omega^2 x - 2 zeta omega x'.

    Args:
        name: name of an integrator of `course.rigid_body`. `implicit_midpoint` iterates on
            numbers and can't be run with symbols: its matrix is the one derived by hand.
        damped: False sets zeta = 0.

    Returns:
        SymPy matrix in the symbols h, omega and zeta.
    """
    import sympy

    from course.rigid_body import oscillator

    h, omega, zeta = symbols()
    zeta = zeta if damped else sympy.Integer(0)
    if name == "implicit_midpoint":
        (a, b), (c, d) = oscillator.step_matrix(name, omega * h, zeta)
        return sympy.Matrix([[a, b / omega], [omega * c, d]]).applyfunc(sympy.cancel)
    step = oscillator.stepper(name, h, zeta, omega)
    columns = [step(np.array(unit, dtype=object)) for unit in sympy.eye(2).tolist()]
    return sympy.Matrix(columns).T.applyfunc(
        lambda entry: sympy.expand(sympy.nsimplify(sympy.expand(entry), rational=True))
    )


def numeric_matrix(name: str, omega_h: float, zeta: float = 0.0) -> np.ndarray:
    """Return the same matrix as numbers, for omega = 1, by running the integrator itself.

    Args:
        name: name of an integrator.
        omega_h: omega times the step.
        zeta: damping ratio.

    Returns:
        Array of shape (2, 2).
    """
    from course.measure import stability
    from course.rigid_body import oscillator

    return stability.amplification(oscillator.stepper(name, omega_h, zeta), 2)


def spectral_radius(name: str, omega_h: float, zeta: float = 0.0) -> float:
    """Return the largest modulus of the eigenvalues of one step."""
    from course.measure import stability

    return stability.spectral_radius(numeric_matrix(name, omega_h, zeta))


def measured_limit(name: str, zeta: float = 0.0, low: float = 0.0, high: float = 8.0) -> float:
    """Return the largest stable omega * h by bisection on the spectral radius, to eleven digits.

    Args:
        name: name of an integrator.
        zeta: damping ratio.
        low: a product at which it is stable, or 0.
        high: a product at which it is not.
    """
    from course.measure import stability

    return stability.limit(
        lambda omega_h: spectral_radius(name, omega_h, zeta) <= 1.0 + 1e-10, low, high, rel=1e-12
    )
