"""One step on the oscillator, by hand against the code that runs; and the limits that follow."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.derivations.rigid_body import linear
from course.measure import stability
from course.rigid_body import oscillator
from tests.budget import examples

ZETAS = (0.05, 0.3, 0.7, 1.0, 1.6)
EXPLICIT = tuple(m for m in oscillator.METHODS if m != "implicit_midpoint")


def _growth(method, x, zeta):
    """Largest growth of a step, by the theory."""
    return stability.spectral_radius(oscillator.step_matrix(method, x, zeta))


@pytest.mark.parametrize("method", oscillator.METHODS)
def test_the_step_by_hand_is_the_step_that_runs(method):
    for x, zeta in ((0.3, 0.0), (1.1, 0.4), (2.0, 1.7)):
        measured = stability.amplification(oscillator.stepper(method, x, zeta), 2)
        assert measured == pytest.approx(oscillator.step_matrix(method, x, zeta), abs=1e-12)


@pytest.mark.parametrize("method", EXPLICIT)
def test_the_two_agree_as_polynomials(method):
    import sympy

    h, omega, zeta = linear.symbols()
    scale = sympy.diag(1, omega)  # the hand's acts on (q, v / omega)
    by_hand = scale * sympy.Matrix(oscillator.step_matrix(method, omega * h, zeta)) * scale.inv()
    by_running = linear.step_matrix(method, damped=True)
    assert (by_hand - by_running).applyfunc(sympy.expand) == sympy.zeros(2)


def test_frequency_and_step_enter_as_their_product():
    for method in oscillator.METHODS:
        step = oscillator.stepper(method, 0.02, 0.3, 40.0)
        scaled = np.diag([1.0, 40.0]) @ oscillator.step_matrix(method, 0.8, 0.3)
        assert stability.amplification(step, 2) == pytest.approx(
            scaled @ np.diag([1.0, 1.0 / 40.0]), abs=1e-9
        )


@pytest.mark.parametrize("method", EXPLICIT)
@pytest.mark.parametrize("zeta", ZETAS)
def test_bisection_finds_the_theoretical_limit(method, zeta):
    theory = oscillator.limit(method, zeta)

    def by_matrix(x):
        return stability.is_stable_by_matrix(oscillator.stepper(method, x, zeta), 2)

    assert stability.limit(by_matrix, 0.01, 10.0) == pytest.approx(theory, rel=5e-3)
    assert (
        _growth(method, 0.995 * theory, zeta) <= 1.0 + 1e-12 < _growth(method, 1.005 * theory, zeta)
    )


def test_closed_forms():
    limit = oscillator.limit
    for zeta in (0.0, 0.1, 0.5, 0.9):
        assert limit("explicit_euler", zeta) == pytest.approx(2.0 * zeta)
    for zeta in (1.0, 1.5, 3.0):
        expected = 2.0 / (zeta + math.sqrt(zeta**2 - 1.0))
        assert limit("explicit_euler", zeta) == pytest.approx(expected, rel=1e-6)
    for zeta in (0.0, 0.2, 1.0, 2.0):
        expected = 2.0 * (math.sqrt(1.0 + zeta**2) - zeta)
        assert limit("semi_implicit_euler", zeta) == pytest.approx(expected)
    assert limit("velocity_verlet", 0.0) == pytest.approx(2.0)
    assert limit("rk4", 0.0) == pytest.approx(2.0 * math.sqrt(2.0))
    assert limit("explicit_midpoint", 0.0) == 0.0
    assert limit("implicit_midpoint", 0.3) == math.inf
    # Very overdamped, the stiff eigenvalue is -2 zeta and the real interval of RK4 is 2.785293...
    assert limit("rk4", 100.0) == pytest.approx(2.785293563 / 200.0, rel=1e-4)


@examples(60)
@given(st.sampled_from(EXPLICIT), st.floats(0.01, 3.0), st.floats(0.01, 0.99))
def test_every_step_below_the_limit_is_stable(method, zeta, fraction):
    assert _growth(method, fraction * oscillator.limit(method, zeta), zeta) <= 1.0 + 1e-9


@given(st.floats(0.0, 5.0), st.floats(0.01, 1e4))
def test_implicit_midpoint_never_grows(zeta, x):
    assert _growth("implicit_midpoint", x, zeta) <= 1.0 + 1e-9


def test_implicit_damping_limit():
    def matrix(x, zeta):
        d = 1.0 / (1.0 + 2.0 * zeta * x)
        return [[1.0 - x**2 * d, x * d], [-x * d, d]]

    for zeta in (0.0, 0.4, 1.3):
        limit = oscillator.implicit_damping_limit(zeta)
        assert stability.spectral_radius(matrix(0.999 * limit, zeta)) <= 1.0 + 1e-12
        assert stability.spectral_radius(matrix(1.001 * limit, zeta)) > 1.0


def test_bad_input_is_named():
    with pytest.raises(ValueError, match="'leapfrog'"):
        oscillator.step_matrix("leapfrog", 0.1, 0.0)
    for zeta in (-0.1, math.nan, math.inf):
        with pytest.raises(ValueError, match="zeta must be a non-negative finite number"):
            oscillator.limit("rk4", zeta)
