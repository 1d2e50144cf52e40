"""Stability limits: bisection against known ones, on both sides, with two kinds of detector."""

import math
from functools import partial

import numpy as np
import pytest

from course.measure import stability

pytestmark = pytest.mark.smoke


def _shear(x, friction=0.0):
    """A rotation made of two shears, which needs x < 2, and a loss of speed by 2 * friction * x."""

    def step(s):
        v = (1.0 - 2.0 * friction * x) * s[1] - x * s[0]
        return np.array([s[0] + x * v, v])

    return step


def _shear_limit(friction):
    """Where -1 becomes an eigenvalue: 1 + T + D = 0, that is x^2 + 4 f x - 4 = 0."""
    return 2.0 * (math.sqrt(1.0 + friction**2) - friction)


def test_amplification_is_the_matrix_of_a_linear_step():
    matrix = np.random.default_rng(3).normal(size=(4, 4))
    assert stability.amplification(lambda s: matrix @ s, 4) == pytest.approx(matrix, abs=1e-15)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    for factor in (0.5, 1.0, 1.7):
        assert stability.spectral_radius(factor * turn) == pytest.approx(factor, rel=1e-14)
        step = partial(np.matmul, factor * turn)
        assert stability.is_stable_by_matrix(step, 2) is (factor <= 1)


@pytest.mark.parametrize("friction", [0.05, 0.3, 0.7, 1.0, 1.6])
def test_matrix_and_iteration_see_the_same_limit(friction):
    theory = _shear_limit(friction)
    result = stability.limit(
        lambda x: stability.is_stable_by_matrix(_shear(x, friction), 2), 0.01, 10.0
    )
    assert result == pytest.approx(theory, rel=1e-4)
    assert stability.is_stable_by_iteration(_shear(0.995 * theory, friction), 2, steps=1000)
    assert not stability.is_stable_by_iteration(_shear(1.005 * theory, friction), 2, steps=1000)


def test_what_beats_does_not_grow():
    assert stability.is_stable_by_iteration(_shear(1.99), 2)
    assert not stability.is_stable_by_iteration(_shear(2.01), 2)
    spiral = np.array([[1.0, 0.1], [-0.1, 1.0]])
    assert not stability.is_stable_by_iteration(lambda s: spiral @ s, 2)


def test_limit_refuses_a_bracket_without_a_limit():
    def below_one(x):
        return x < 1.0

    assert stability.limit(below_one, 0.0, 8.0, rel=1e-9) == pytest.approx(1.0, rel=1e-8)
    with pytest.raises(ValueError, match=r"low must be a stable"):
        stability.limit(below_one, 2.0, 3.0)
    with pytest.raises(ValueError, match=r"high must be an unstable"):
        stability.limit(below_one, 0.1, 0.5)
    with pytest.raises(ValueError, match="low < high"):
        stability.limit(below_one, 3.0, 2.0)


def test_amplification_refuses_what_is_not_linear():
    with pytest.raises(ValueError, match="linear"):
        stability.amplification(lambda s: s**2, 2)
    with pytest.raises(ValueError, match="linear"):
        stability.amplification(lambda s: s + 1.0, 3)


def test_detectors_see_nan_and_infinity():
    assert stability.grows([1.0, 1.0, math.nan, 1.0])
    assert stability.grows([1.0, 1.0, 1.0, math.inf])
    assert not stability.grows([1.0, 0.2, 3.0, 0.1, 2.0, 3.0])
    assert stability.spectral_radius([[math.nan, 0.0], [0.0, 1.0]]) == math.inf
    assert not stability.is_stable_by_iteration(lambda s: s * math.nan, 1)


def test_map_boundary_follows_theory():
    x, y = np.linspace(0.05, 3.5, 70), np.linspace(0.05, 1.5, 12)
    measured = stability.stability_map(
        lambda a, b: stability.spectral_radius(stability.amplification(_shear(a, b), 2)),
        x,
        y,
    )
    theory = [_shear_limit(friction) for friction in y]
    assert measured.boundary() == pytest.approx(np.array(theory), abs=0.51 * (x[1] - x[0]))


def test_map_without_a_boundary():
    measured = stability.stability_map(lambda a, b: a * b, [1.0, 2.0], [0.1, 0.6, 3.0])
    assert measured.boundary().tolist() == [math.inf, 1.5, 0.0]
    with pytest.raises(ValueError, match="x_values"):
        stability.stability_map(lambda a, b: a, [2.0, 1.0], [0.1, 0.5])


def test_a_map_names_its_quantity():
    """The same map for a gain over its bound: s / (s^2 + lambda^2) is at most 1 / (2 lambda)."""
    s, damping = np.geomspace(1e-3, 1.0, 31), np.geomspace(0.01, 1.0, 9)
    gain = stability.stability_map(
        lambda a, b: 2.0 * b * a / (a * a + b * b), s, damping, quantity="gain over its bound"
    )
    assert gain.within().all() and (gain.boundary() == math.inf).all()
    assert gain.label.startswith("log10(gain over its bound):")
    bare = stability.stability_map(lambda a, b: 1.0 / a, s, damping, 0.0, "gain", "rad/m")
    assert bare.label.startswith("log10(gain [rad/m]):") and not bare.within()[:, :-1].any()
    assert stability.stability_map(lambda a, b: a, s, damping).label.startswith("log10(growth per")
