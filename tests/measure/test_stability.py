"""Stability limits: bisection against theory, on both sides, with two kinds of detector."""

import math

import matplotlib
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from course.measure import stability

matplotlib.use("Agg")


def _step(method, x, zeta):
    """The course's methods on q'' = -q - 2 zeta q', written out by hand with step x."""

    def acceleration(q, v):
        return -q - 2.0 * zeta * v

    def rate(s):
        return np.array([s[1], acceleration(s[0], s[1])])

    def explicit_euler(s):
        return s + x * rate(s)

    def semi_implicit_euler(s):
        v = s[1] + x * acceleration(s[0], s[1])
        return np.array([s[0] + x * v, v])

    def velocity_verlet(s):
        a0 = acceleration(s[0], s[1])
        q1 = s[0] + x * s[1] + 0.5 * x**2 * a0
        a1 = acceleration(q1, s[1] + x * a0)
        return np.array([q1, s[1] + 0.5 * x * (a0 + a1)])

    def explicit_midpoint(s):
        return s + x * rate(s + 0.5 * x * rate(s))

    def implicit_midpoint(s):
        half = 0.5 * x * np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]])
        return np.linalg.solve(np.eye(2) - half, (np.eye(2) + half) @ s)

    def rk4(s):
        k1 = rate(s)
        k2 = rate(s + 0.5 * x * k1)
        k3 = rate(s + 0.5 * x * k2)
        k4 = rate(s + x * k3)
        return s + x / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)

    return locals()[method]


ZETAS = (0.05, 0.3, 0.7, 1.0, 1.6)
EXPLICIT = tuple(m for m in stability.OSCILLATOR_METHODS if m != "implicit_midpoint")


@pytest.mark.parametrize("method", stability.OSCILLATOR_METHODS)
def test_step_matrix_is_the_step(method):
    for x, zeta in ((0.3, 0.0), (1.1, 0.4), (2.0, 1.7)):
        measured = stability.amplification(_step(method, x, zeta), 2)
        assert measured == pytest.approx(stability.step_matrix(method, x, zeta), abs=1e-12)


@pytest.mark.parametrize("method", EXPLICIT)
@pytest.mark.parametrize("zeta", ZETAS)
def test_bisection_finds_the_theoretical_limit(method, zeta):
    theory = stability.theoretical_limit(method, zeta)

    def by_matrix(x):
        return stability.is_stable_by_matrix(_step(method, x, zeta), 2)

    assert stability.limit(by_matrix, 0.01, 10.0) == pytest.approx(theory, rel=5e-3)
    inside = stability.spectral_radius(stability.step_matrix(method, 0.995 * theory, zeta))
    outside = stability.spectral_radius(stability.step_matrix(method, 1.005 * theory, zeta))
    assert inside <= 1.0 + 1e-12 < outside
    # Watched as a black box: works just inside, fails just outside. Slow growth needs a long watch.
    steps = int(np.clip(1.0 / (outside - 1.0), 1000, 50_000))
    for factor, stable in ((0.995, True), (1.005, False)):
        step = _step(method, factor * theory, zeta)
        assert stability.is_stable_by_iteration(step, 2, steps=steps) is stable


def test_closed_forms():
    limit = stability.theoretical_limit
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


@settings(deadline=None, max_examples=60)
@given(
    st.sampled_from(EXPLICIT),
    st.floats(0.01, 3.0),
    st.floats(0.01, 0.99),
)
def test_every_step_below_the_limit_is_stable(method, zeta, fraction):
    x = fraction * stability.theoretical_limit(method, zeta)
    assert stability.spectral_radius(stability.step_matrix(method, x, zeta)) <= 1.0 + 1e-9


@given(st.floats(0.0, 5.0), st.floats(0.01, 1e4))
def test_implicit_midpoint_never_grows(zeta, x):
    radius = stability.spectral_radius(stability.step_matrix("implicit_midpoint", x, zeta))
    assert radius <= 1.0 + 1e-9


def test_undamped_symplectic_euler_beats_but_does_not_grow():
    assert stability.is_stable_by_iteration(_step("semi_implicit_euler", 1.99, 0.0), 2)
    assert not stability.is_stable_by_iteration(_step("semi_implicit_euler", 2.01, 0.0), 2)
    assert not stability.is_stable_by_iteration(_step("explicit_euler", 0.1, 0.0), 2)


def test_implicit_damping_limit():
    def matrix(x, zeta):
        d = 1.0 / (1.0 + 2.0 * zeta * x)
        return [[1.0 - x**2 * d, x * d], [-x * d, d]]

    for zeta in (0.0, 0.4, 1.3):
        limit = stability.implicit_damping_limit(zeta)
        assert stability.spectral_radius(matrix(0.999 * limit, zeta)) <= 1.0 + 1e-12
        assert stability.spectral_radius(matrix(1.001 * limit, zeta)) > 1.0


def test_limit_refuses_a_bracket_without_a_limit():
    def below_one(x):
        return x < 1.0

    assert stability.limit(below_one, 0.0, 8.0, rel=1e-9) == pytest.approx(1.0, rel=1e-8)
    with pytest.raises(ValueError, match=r"low is .*, allowed is a stable"):
        stability.limit(below_one, 2.0, 3.0)
    with pytest.raises(ValueError, match=r"high is .*, allowed is an unstable"):
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
        lambda a, b: stability.spectral_radius(
            stability.amplification(_step("semi_implicit_euler", a, b), 2)
        ),
        x,
        y,
    )
    theory = [stability.theoretical_limit("semi_implicit_euler", zeta) for zeta in y]
    assert measured.boundary() == pytest.approx(np.array(theory), abs=0.51 * (x[1] - x[0]))
    import matplotlib.pyplot as plt

    figure, ax = plt.subplots()
    measured.plot(ax, {"theory": (theory, y)}, title="semi-implicit Euler")
    assert ax.get_legend_handles_labels()[1] == ["measured", "theory"]
    figure.canvas.draw()
    plt.close(figure)


def test_map_without_a_boundary():
    measured = stability.stability_map(lambda a, b: a * b, [1.0, 2.0], [0.1, 0.6, 3.0])
    assert measured.boundary().tolist() == [math.inf, 1.5, 0.0]
    with pytest.raises(ValueError, match="x_values"):
        stability.stability_map(lambda a, b: a, [2.0, 1.0], [0.1, 0.5])
