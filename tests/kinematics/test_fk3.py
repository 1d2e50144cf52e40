"""Forward kinematics of the three-link arm against MPMath, Pinocchio and geometry."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from course.drills import fk3
from course.oracles.pinocchio import PlanarChain
from tests.budget import examples

lengths = arrays(float, 3, elements=st.floats(0.0, 10.0))
angles = arrays(float, 3, elements=st.floats(-20.0, 20.0))


def exactly(lengths, thetas):
    """The four points from 40 digits, each link turned by the rotations before it."""
    with mpmath.workdps(40):
        points, turn = [mpmath.mpc(0)], mpmath.mpc(1)
        for length, theta in zip(lengths, thetas, strict=True):
            turn *= mpmath.exp(mpmath.mpc(0, float(theta)))
            points.append(points[-1] + float(length) * turn)
        return np.array([[float(p.real), float(p.imag)] for p in points])


@given(lengths, angles)
def test_it_agrees_with_40_digits(lengths, thetas) -> None:
    allowed = 1e-15 * (1.0 + lengths.sum()) * (4.0 + np.abs(thetas).sum())
    assert np.abs(fk3(lengths, thetas) - exactly(lengths, thetas)).max() <= allowed


@examples(50)
@given(lengths, angles)
def test_it_agrees_with_pinocchio(lengths, thetas) -> None:
    allowed = 1e-14 * (1.0 + lengths.sum()) * (1.0 + np.abs(thetas).sum())
    assert np.abs(fk3(lengths, thetas) - PlanarChain(lengths).positions(thetas)).max() <= allowed


@pytest.mark.parametrize(
    ("lengths", "thetas", "named"),
    [
        ([1.0, 1.0], [0.0, 0.0, 0.0], "lengths"),
        ([1.0, 1.0, -1.0], [0.0, 0.0, 0.0], "lengths"),
        ([1.0, 1.0, 1.0], [0.0, math.nan, 0.0], "thetas"),
        ([1.0, 1.0, 1.0], 0.0, "thetas"),
        ([1.0, math.inf, 1.0], [0.0, 0.0, 0.0], "lengths"),
    ],
)
def test_wrong_arguments_are_named(lengths, thetas, named) -> None:
    with pytest.raises(ValueError, match=named):
        fk3(lengths, thetas)


def test_arguments_stay_as_they_were() -> None:
    lengths, thetas = np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.3])
    fk3(lengths, thetas)
    assert lengths.tolist() == [1.0, 2.0, 3.0] and thetas.tolist() == [0.1, 0.2, 0.3]


def test_pinocchio_gives_a_pose_one_knows() -> None:
    chain = PlanarChain([1.0, 2.0])
    expected = [[0, 0], [0, 1], [2, 1]]
    np.testing.assert_allclose(chain.positions([math.pi / 2, -math.pi / 2]), expected, atol=1e-15)
    with pytest.raises(ValueError, match="thetas"):
        chain.positions([0.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="lengths"):
        PlanarChain([1.0, math.nan])
