"""Absolute orientation where rows are NaN, have no weight, or lie on one line."""

import numpy as np
import pytest

from course.perception import rigid
from course.rigid_body.quaternion import exp, to_matrix

# As plain Python, where a wrong index raises, and as it is compiled.
BOTH = pytest.mark.parametrize("rotation", [rigid.rotation, rigid._rotation_loop])


def pairs(n=6):
    """Return rows a, their partners b, weights and the motion (R, p) between them."""
    rng = np.random.default_rng(3)
    a, w = rng.standard_normal((n, 3)), rng.uniform(0.5, 2.0, n)
    R, p = to_matrix(exp(rng.standard_normal(3))), rng.standard_normal(3)
    return a, a @ R.T + p, w, R, p


def fitted(rotation, a, b, w):
    """Return whether the motion is determined, R and p; what is not filled in stays infinite."""
    R, p = np.full((3, 3), np.inf), np.full(3, np.inf)
    return bool(rotation(a, b, w, R, p)), R, p


@BOTH
def test_a_row_of_weight_zero_has_no_influence_whatever_is_in_it(rotation):
    a, b, w, R, p = pairs()
    w[1], w[4] = 0.0, 0.0
    a[1], b[4] = np.nan, np.inf
    determined, turn, shift = fitted(rotation, a, b, w)
    assert determined
    assert np.abs(turn - R).max() < 1e-14 and np.abs(shift - p).max() < 1e-14


@BOTH
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("where", ["a", "b", "w"])
def test_a_nan_determines_nothing(rotation, where, value):
    a, b, w, _, _ = pairs()
    {"a": a[2], "b": b[2], "w": w}[where][1] = value
    with np.errstate(invalid="ignore"):
        determined, R, p = fitted(rotation, a, b, w)
    assert not determined and np.isinf(R).all() and np.isinf(p).all()


@BOTH
@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_weights_determine_nothing(rotation, count):
    a, b, w, _, _ = pairs()
    w[count:] = 0.0
    determined, R, p = fitted(rotation, a, b, w)
    assert not determined and np.isinf(R).all() and np.isinf(p).all()


@BOTH
@pytest.mark.parametrize(("width", "determined"), [(0.0, False), (1e-5, False), (1e-4, True)])
def test_a_line_is_less_than_3e_5_of_its_length_wide(rotation, width, determined):
    """Around the limit, far from it on both sides; the turn about the line is then known."""
    x = np.linspace(-1.0, 1.0, 9)
    a = np.column_stack((x, width * np.cos(7.0 * x), 0.0 * x)) / np.sqrt(2.0)
    R, p = to_matrix(exp(np.array([0.3, -0.8, 0.5]))), np.array([0.1, 0.2, 0.3])
    result = fitted(rotation, a, a @ R.T + p, np.ones(9))
    assert result[0] is determined
    if determined:
        assert np.abs(result[1] - R).max() < 1e-10
