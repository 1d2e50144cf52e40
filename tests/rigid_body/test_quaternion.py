"""Rotations against mpmath at 50 digits, SciPy, MuJoCo, finite differences and the group's laws."""

import math
import warnings

import mpmath
import mujoco
import numba
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from course.compiled import VECTOR, compiled
from course.rigid_body import quaternion as quat
from tests.budget import examples

mpmath.mp.dps = 50

EDGE_ANGLES = [
    0.0,
    1e-200,
    1e-160,
    1e-12,
    1e-9,
    1e-8,
    1e-4,
    0.5,
    math.pi / 2,
    3.0,
    math.pi - 1e-4,
    math.pi - 1e-8,
    math.pi - 1e-12,
    math.pi,
]
AXES = [
    (1.0, 0.0, 0.0),
    (0.0, -1.0, 0.0),
    (0.0, 0.0, 1.0),
    (0.6, 0.0, -0.8),
    (-1 / 3, 2 / 3, 2 / 3),
]


# A busy machine is no defect of the code: no example has a deadline.
unhurried = examples(100)


@pytest.fixture(autouse=True)
def _floating_point_is_quiet():
    """No function may warn, whatever it is given here."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def norm(values) -> float:
    return float(np.linalg.norm(values))


def _reals(limit):
    """Numbers up to `limit`; those whose squares would underflow are made 0."""
    return st.floats(-limit, limit).map(lambda x: x if abs(x) > 1e-100 else 0.0)


component = _reals(1.0)


@st.composite
def directions(draw, size):
    values = np.array(draw(st.tuples(*[component] * size)))
    length = norm(values)
    assume(length > 0.05)
    return values / length


quaternions = directions(4)
axes = directions(3)
vectors = st.tuples(*[_reals(10.0)] * 3).map(np.array)
# Angles spread evenly and, as often, over all sizes down to 1e-12 from 0 and 1e-8 from pi.
angles = st.one_of(
    st.floats(0.0, math.pi),
    st.floats(-12.0, 0.0).map(lambda e: 10.0**e),
    st.floats(-8.0, 0.0).map(lambda e: math.pi - 10.0**e),
    st.sampled_from(EDGE_ANGLES),
)


# ---- 50-digit references, written from the definitions ----


def exact_exp(u):
    x, y, z = (mpmath.mpf(float(c)) for c in u)
    angle = mpmath.sqrt(x * x + y * y + z * z)
    scale = mpmath.sin(angle / 2) / angle if angle else mpmath.mpf(1) / 2
    return [mpmath.cos(angle / 2), scale * x, scale * y, scale * z]


def exact_log(q):
    """The shorter of the two rotation vectors of q."""
    w, *v = (mpmath.mpf(float(c)) for c in q)
    sine = mpmath.sqrt(sum(c * c for c in v))
    if w < 0:
        w, v = -w, [-c for c in v]
    scale = 2 * mpmath.atan2(sine, w) / sine if sine else mpmath.mpf(2)
    return [scale * c for c in v]


def exact_product(p, q):
    """From the multiplication table i j = k, j k = i, k i = j."""
    table = {(1, 2): 3, (2, 3): 1, (3, 1): 2}
    result = [mpmath.mpf(0)] * 4
    for i in range(4):
        for j in range(4):
            term = mpmath.mpf(p[i]) * mpmath.mpf(q[j])
            if i == 0 or j == 0:
                result[i + j] += term
            elif i == j:
                result[0] -= term
            elif (i, j) in table:
                result[table[i, j]] += term
            else:
                result[table[j, i]] -= term
    return result


def error(values, exact):
    return max(abs(float(mpmath.mpf(float(a)) - b)) for a, b in zip(values, exact, strict=True))


def assert_same_rotation(p, q, tolerance):
    """Equal up to the sign of the whole quaternion."""
    assert min(np.abs(p - q).max(), np.abs(p + q).max()) <= tolerance


# ---- the group ----


@given(quaternions, quaternions, quaternions)
@unhurried
def test_product_is_associative_with_identity_and_inverse(p, q, r):
    left = quat.product(quat.product(p, q), r)
    right = quat.product(p, quat.product(q, r))
    np.testing.assert_allclose(left, right, rtol=0, atol=2e-15)
    one = quat.identity()
    np.testing.assert_array_equal(quat.product(one, q), q)
    np.testing.assert_array_equal(quat.product(q, one), q)
    np.testing.assert_allclose(quat.product(q, quat.conjugate(q)), one, rtol=0, atol=1e-15)
    np.testing.assert_allclose(quat.product(quat.conjugate(q), q), one, rtol=0, atol=1e-15)


@given(quaternions, quaternions)
@unhurried
def test_product_follows_the_multiplication_table(p, q):
    assert error(quat.product(p, q), exact_product(p, q)) <= 1e-15


@given(quaternions, vectors, vectors)
@unhurried
def test_rotate_keeps_lengths_angles_and_handedness(q, a, b):
    ra, rb = quat.rotate(q, a), quat.rotate(q, b)
    assert norm(ra) == pytest.approx(norm(a), rel=3e-15, abs=1e-300)
    scale = norm(a) * norm(b)
    assert ra @ rb == pytest.approx(a @ b, rel=0, abs=5e-15 * scale + 1e-300)
    np.testing.assert_allclose(
        quat.cross(ra, rb), quat.rotate(q, quat.cross(a, b)), rtol=0, atol=1e-14 * scale + 1e-300
    )
    back = quat.rotate(quat.conjugate(q), ra)
    np.testing.assert_allclose(back, a, rtol=0, atol=1e-14 * norm(a) + 1e-300)


@given(quaternions, vectors)
@unhurried
def test_rotate_is_the_sandwich_product(q, v):
    pure = np.array([0.0, *v])
    sandwich = quat.product(quat.product(q, pure), quat.conjugate(q))
    assert abs(sandwich[0]) <= 1e-14
    np.testing.assert_allclose(quat.rotate(q, v), sandwich[1:], rtol=0, atol=2e-14)


def test_quarter_turn_about_z_turns_body_x_into_world_y():
    q = np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
    x = np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(quat.rotate(q, x), [0.0, 1.0, 0.0], rtol=0, atol=3e-16)
    np.testing.assert_allclose(quat.to_matrix(q) @ x, [0.0, 1.0, 0.0], rtol=0, atol=3e-16)


@given(vectors, vectors)
@unhurried
def test_cross_is_numpys(a, b):
    np.testing.assert_array_equal(quat.cross(a, b), np.cross(a, b))


# ---- exp and log ----


@pytest.mark.parametrize("angle", EDGE_ANGLES)
@pytest.mark.parametrize("axis", AXES)
def test_exp_and_log_at_the_edges(angle, axis):
    check_exp_and_log(np.array(axis) * angle)


@pytest.mark.slow
@given(axes, angles)
@examples(300)
def test_exp_and_log_are_exact_to_1e_14(axis, angle):
    check_exp_and_log(axis * angle)


def check_exp_and_log(u):
    q = quat.exp(u)
    exact = exact_exp(u)
    assert error(q, exact) <= 1e-15
    # The vector part also to relative accuracy: a tiny angle keeps its digits.
    size = float(mpmath.sqrt(sum(c * c for c in exact[1:])))
    assert error(q[1:], exact[1:]) <= 1e-15 * size
    # log of the very numbers it is given.
    reference = exact_log(q)
    size = float(mpmath.sqrt(sum(c * c for c in reference)))
    if q[0] != 0.0:
        assert error(quat.log(q), reference) <= 1e-14 * size
    assert norm(quat.log(q)) <= math.pi * (1.0 + 1e-15)
    np.testing.assert_array_equal(quat.log(-q), quat.log(q))
    # and back: near half a turn the rounding of q may choose the other end of the axis.
    back, length = quat.log(q), norm(u)
    gap = norm(back - u)
    if length > math.pi - 4e-16:
        gap = min(gap, norm(back + u))
    assert gap <= 1e-14 * length


@given(quaternions)
@unhurried
def test_exp_undoes_log(q):
    assert_same_rotation(quat.exp(quat.log(q)), q, 1e-15)


@given(axes, st.floats(math.pi, 3 * math.pi))
@unhurried
def test_exp_beyond_half_a_turn(axis, angle):
    assert error(quat.exp(axis * angle), exact_exp(axis * angle)) <= 2e-15


@given(st.floats(0.9, 1.0), st.floats(0.9, 1.0), st.floats(0.9, 1.1))
@unhurried
def test_exp_where_the_series_end(x, y, z):
    u = np.array([x, -y, z])
    assert error(quat.exp(u), exact_exp(u)) <= 5e-16


def test_log_of_half_turns_does_not_depend_on_the_sign():
    for values in ([0, 1, 0, 0], [0, 0, -1, 0], [0, 0, 0, -1], [-0.0, -0.6, 0, 0.8]):
        q = np.array(values, dtype=float)
        u = quat.log(q)
        assert norm(u) == pytest.approx(math.pi, rel=1e-15)
        np.testing.assert_array_equal(quat.log(-q), u)
        assert u[np.flatnonzero(u)[0]] > 0.0


def test_zero_vector_and_identity():
    np.testing.assert_array_equal(quat.exp(np.zeros(3)), quat.identity())
    np.testing.assert_array_equal(quat.log(quat.identity()), np.zeros(3))
    np.testing.assert_array_equal(quat.log(-quat.identity()), np.zeros(3))
    np.testing.assert_array_equal(quat.exp(np.zeros((3, 2))), np.eye(4, 2)[:, [0, 0]])


@given(quaternions)
@unhurried
def test_double_cover(q):
    np.testing.assert_array_equal(quat.to_matrix(-q), quat.to_matrix(q))
    np.testing.assert_array_equal(quat.log(-q), quat.log(q))
    np.testing.assert_array_equal(quat.to_euler_zyx(-q), quat.to_euler_zyx(q))
    assert quat.angle_between(q, -q) == 0.0
    v = np.array([1.0, -2.0, 0.5])
    np.testing.assert_array_equal(quat.rotate(-q, v), quat.rotate(q, v))


# ---- the angle between two rotations ----


@pytest.mark.slow
@given(quaternions, axes, angles, st.sampled_from([1.0, -1.0]))
@examples(200)
def test_angle_between_against_50_digits(p, axis, angle, sign):
    q = sign * quat.product(p, quat.exp(axis * angle))
    relative = exact_product(p * [1, -1, -1, -1], q)
    sine = mpmath.sqrt(sum(c * c for c in relative[1:]))
    exact = float(2 * mpmath.atan2(sine, abs(relative[0])))
    # Relative accuracy, down to where p and q differ in their last bits only.
    assert quat.angle_between(p, q) == pytest.approx(exact, rel=1e-14, abs=5e-31)
    assert quat.angle_between(q, p) == pytest.approx(exact, rel=1e-14, abs=5e-31)
    # And the angle that was meant: the rounding of p and q allows no more.
    assert exact == pytest.approx(angle, rel=0, abs=2e-15)


@pytest.mark.parametrize("angle", [1e-200, 1e-120, 1e-12, 1e-8, 1.0, math.pi])
def test_angle_from_the_identity_keeps_its_digits(angle):
    q = quat.exp(np.array([0.0, angle, 0.0]))
    tolerance = 1e-15 if angle > 1e-140 else 1.0  # the squares underflow
    assert quat.angle_between(quat.identity(), q) == pytest.approx(angle, rel=tolerance)


# ---- matrices ----


@given(quaternions, quaternions, vectors)
@unhurried
def test_matrices_are_rotations_and_compose(p, q, v):
    P, Q = quat.to_matrix(p), quat.to_matrix(q)
    np.testing.assert_allclose(Q.T @ Q, np.eye(3), rtol=0, atol=2e-15)
    assert np.linalg.det(Q) == pytest.approx(1.0, rel=0, abs=2e-15)
    np.testing.assert_allclose(quat.to_matrix(quat.product(p, q)), P @ Q, rtol=0, atol=3e-15)
    np.testing.assert_allclose(Q @ v, quat.rotate(q, v), rtol=0, atol=3e-14)
    assert_same_rotation(quat.from_matrix(Q), q, 2e-15)
    assert quat.from_matrix(Q)[0] >= 0.0


@pytest.mark.parametrize("angle", EDGE_ANGLES)
@pytest.mark.parametrize("axis", [*AXES, (0.0, math.sqrt(0.5), -math.sqrt(0.5)), (0.5, 0.5, -0.7)])
def test_from_matrix_at_the_edges(axis, angle):
    u = np.array(axis) / norm(axis) * angle
    q = quat.exp(u)
    back = quat.from_matrix(quat.to_matrix(q))
    assert_same_rotation(back, q, 1e-15)


def test_from_matrix_of_exact_half_turns():
    for diagonal, q in (
        ((1, -1, -1), (0, 1, 0, 0)),
        ((-1, 1, -1), (0, 0, 1, 0)),
        ((-1, -1, 1), (0, 0, 0, 1)),
        ((1, 1, 1), (1, 0, 0, 0)),
    ):
        np.testing.assert_array_equal(quat.from_matrix(np.diag(diagonal).astype(float)), q)
    # Ties between candidates, two (quarter turns) and four: they must not cancel.
    for quarter in ([1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]):
        half = math.sqrt(0.5) * np.array([1.0, *quarter])
        R = np.rint(quat.to_matrix(half))
        np.testing.assert_allclose(quat.from_matrix(R), half, rtol=0, atol=2e-16)
    for signs in np.ndindex(2, 2, 2):
        tied = np.array([0.5, *(0.5 - np.array(signs))])
        np.testing.assert_array_equal(quat.from_matrix(quat.to_matrix(tied)), tied)


# ---- Euler angles ----

yaws = st.floats(-3.14, 3.14)


@given(yaws, st.floats(-1.57, 1.57), yaws)
@unhurried
def test_euler_round_trip(yaw, pitch, roll):
    q = quat.from_euler_zyx(yaw, pitch, roll)
    back = quat.to_euler_zyx(q)
    tolerance = 4e-15 / math.cos(pitch)  # yaw and roll separately are conditioned like this
    np.testing.assert_allclose(back, [yaw, pitch, roll], rtol=0, atol=tolerance)
    assert back[1] == pytest.approx(pitch, rel=0, abs=2e-15)
    reference = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat(scalar_first=True)
    assert_same_rotation(q, reference, 1e-15)


@given(quaternions)
@unhurried
def test_euler_angles_describe_the_rotation(q):
    yaw, pitch, roll = quat.to_euler_zyx(q)
    assert_same_rotation(quat.from_euler_zyx(yaw, pitch, roll), q, 3e-15)
    assert abs(yaw) <= math.pi and abs(roll) <= math.pi
    assert abs(pitch) <= math.pi / 2 * (1 + 1e-15)


@given(yaws, yaws, st.sampled_from([1.0, -1.0]))
@unhurried
def test_at_a_vertical_pitch_roll_is_zero_and_nothing_is_lost(yaw, roll, side):
    q = quat.from_euler_zyx(yaw, side * math.pi / 2, roll)
    angles = quat.to_euler_zyx(q)
    assert angles[2] == 0.0
    assert angles[1] == pytest.approx(side * math.pi / 2, rel=0, abs=1e-15)
    expected = yaw - side * roll
    assert math.remainder(angles[0] - expected, 2 * math.pi) == pytest.approx(0.0, abs=4e-15)
    assert_same_rotation(quat.from_euler_zyx(*angles), q, 2e-15)


@given(st.floats(-16.0, -1.0), yaws, yaws, st.sampled_from([1.0, -1.0]))
@unhurried
def test_near_a_vertical_pitch_the_rotation_survives(exponent, yaw, roll, side):
    q = quat.from_euler_zyx(yaw, side * (math.pi / 2 - 10.0**exponent), roll)
    assert_same_rotation(quat.from_euler_zyx(*quat.to_euler_zyx(q)), q, 2e-14)


@given(yaws, st.floats(-1.57, 1.57), yaws, vectors)
@unhurried
def test_rate_matrix_against_finite_differences(yaw, pitch, roll, rates):
    h = 1e-5
    start = np.array([yaw, pitch, roll])
    before = quat.from_euler_zyx(*(start - h * rates))
    after = quat.from_euler_zyx(*(start + h * rates))
    omega = quat.log(quat.product(quat.conjugate(before), after)) / (2 * h)
    # Central differences: the error is of the size h^2 |rates|^3.
    tolerance = 2e-10 + h**2 * norm(rates) ** 3
    E = quat.euler_zyx_rate_matrix(pitch, roll)
    np.testing.assert_allclose(E @ rates, omega, rtol=0, atol=tolerance)
    assert np.linalg.det(E) == pytest.approx(-math.cos(pitch), rel=0, abs=1e-15)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("roll", [0.0, 0.7, -2.0])
def test_rate_matrix_loses_one_rank_at_a_vertical_pitch(side, roll):
    E = quat.euler_zyx_rate_matrix(side * math.pi / 2, roll)
    assert np.linalg.matrix_rank(E, tol=1e-12) == 2
    singular = np.linalg.svd(E, compute_uv=False)
    np.testing.assert_allclose(singular, [math.sqrt(2), 1, 0], rtol=0, atol=1e-15)
    assert np.linalg.matrix_rank(quat.euler_zyx_rate_matrix(side * 1.5, roll), tol=1e-12) == 3
    # On the way there the smallest one falls in proportion to the cosine, by 1 / sqrt(2).
    for distance in (0.1, 1e-3, 1e-5):
        E = quat.euler_zyx_rate_matrix(side * (math.pi / 2 - distance), roll)
        smallest = np.linalg.svd(E, compute_uv=False)[2]
        expected = math.cos(math.pi / 2 - distance) / math.sqrt(2)
        assert smallest == pytest.approx(expected, rel=distance**2 + 1e-10)


# ---- the derivative of exp ----


@pytest.mark.slow
@given(axes, st.floats(1e-6, 5.0), vectors)
@unhurried
def test_dexp_inverse_against_finite_differences(axis, angle, w):
    """Move u at the rate it returns: exp(u) must turn with w."""
    u = axis * angle
    rate = quat.dexp_inverse(u, w)
    h = 1e-6
    before, after = quat.exp(u - h * rate), quat.exp(u + h * rate)
    omega = quat.log(quat.product(quat.conjugate(before), after)) / (2 * h)
    np.testing.assert_allclose(omega, w, rtol=0, atol=1e-8 * (1.0 + norm(rate)))


@pytest.mark.prove
@given(axes, st.one_of(st.floats(0.0, 6.2), st.floats(-12, 0).map(lambda e: 10.0**e)), vectors)
@unhurried
def test_dexp_inverse_against_50_digits(axis, angle, w):
    u = axis * angle
    exact_u = mpmath.matrix(u.tolist())
    a = mpmath.norm(exact_u)
    hat = mpmath.matrix([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])
    # The inverse of the series sum (-hat)^k / (k + 1)!, not the closed form of the code.
    series, term = mpmath.eye(3), mpmath.eye(3)
    for k in range(1, 80):
        term = term * (-hat) / (k + 1)
        series += term
    exact = mpmath.lu_solve(series, mpmath.matrix(w.tolist()))
    # Towards a full turn c has a pole: the rounding of |u| counts (2 pi / distance) squared.
    condition = 1.0 + 8.0 / (2 * math.pi - float(a)) ** 2
    scale = 2e-15 * (norm(w) + 1e-290) * condition
    assert error(quat.dexp_inverse(u, w), list(exact)) <= scale


def test_dexp_inverse_at_zero_is_the_identity():
    w = np.array([0.3, -2.0, 5.0])
    np.testing.assert_array_equal(quat.dexp_inverse(np.zeros(3), w), w)
    # The second-order coefficient is 1/12.
    u = np.array([1e-3, 0.0, 0.0])
    rate = quat.dexp_inverse(u, np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(rate, [0.0, 1.0 - 1e-6 / 12, 0.5e-3], rtol=0, atol=1e-14)


# ---- drift, and what happens without renormalisation ----


def _multiply(q, p, count):
    for _ in range(int(count)):
        q = quat.product(q, p)
    return q


@pytest.mark.slow
def test_a_million_products_drift_from_unit_length_by_rounding_only():
    count = 1_000_000
    multiply = compiled(_multiply, VECTOR(VECTOR, VECTOR, numba.float64))
    steady, wandering = [], []
    for seed in range(4):
        axis = np.random.default_rng(seed).normal(size=3)
        p = quat.exp((1 + seed) * 1e-3 * axis / norm(axis))
        q = multiply(quat.identity(), p, count)
        drift = norm(q) - 1.0
        assert 0.0 < abs(drift) < 1e-9
        assert norm(quat.normalise(q)) == pytest.approx(1.0, rel=0, abs=3e-16)
        # Rounding made the factor itself not quite unit; its length comes in at every product.
        length = mpmath.sqrt(sum(mpmath.mpf(float(c)) ** 2 for c in p))
        steady.append(float(length**count - 1))
        wandering.append(drift - steady[-1])
    print("steady drift of |q|:", steady, "and the walk of the rounding on it:", wandering)
    # The steady part dominates; what is left is of the size of a random walk, sqrt(count) * eps.
    assert max(np.abs(steady)) > 1e-12
    assert 0.0 < max(np.abs(wandering)) < 10 * math.sqrt(count) * np.finfo(float).eps


@given(quaternions, vectors)
@unhurried
def test_derivative_is_the_product_and_the_slope_of_the_exact_turn(q, omega):
    rate = quat.derivative(q, omega)
    pure = np.array([0.0, *omega])
    np.testing.assert_allclose(rate, 0.5 * quat.product(q, pure), rtol=0, atol=1e-14)
    assert q @ rate == pytest.approx(0.0, abs=1e-14)
    h = 1e-5
    after = quat.product(q, quat.exp(h * omega))
    before = quat.product(q, quat.exp(-h * omega))
    tolerance = 1e-10 + h**2 * norm(omega) ** 3
    np.testing.assert_allclose(rate, (after - before) / (2 * h), rtol=0, atol=tolerance)


@given(axes, st.floats(0.1, 20.0), st.floats(1e-3, 0.05))
@examples(20)
def test_added_quaternions_grow_as_the_closed_form_says(axis, speed, h):
    omega, q, steps = axis * speed, quat.identity(), 200
    for _ in range(steps):
        q = q + h * quat.derivative(q, omega)
    growth = (1.0 + (0.5 * h * speed) ** 2) ** (steps / 2)
    assert norm(q) == pytest.approx(growth, rel=1e-13)
    # And the angle lags: each step turns by 2 atan(h w / 2), not by h w.
    turned = quat.exp(axis * 2 * math.atan(0.5 * h * speed) * steps)
    np.testing.assert_allclose(quat.normalise(q), turned, rtol=0, atol=2e-13)


# ---- other people's code as truth ----


@given(quaternions, quaternions, vectors)
@unhurried
def test_against_scipy(p, q, v):
    P, Q = (Rotation.from_quat(r, scalar_first=True) for r in (p, q))
    np.testing.assert_allclose(quat.rotate(q, v), Q.apply(v), rtol=0, atol=2e-14)
    composed = (P * Q).as_quat(scalar_first=True)
    np.testing.assert_allclose(quat.product(p, q), composed, rtol=0, atol=1e-15)
    np.testing.assert_allclose(quat.to_matrix(q), Q.as_matrix(), rtol=0, atol=1e-15)
    assert_same_rotation(quat.from_matrix(Q.as_matrix()), q, 2e-15)
    if abs(q[0]) > 1e-12:
        np.testing.assert_allclose(quat.log(q), Q.as_rotvec(), rtol=0, atol=3e-15)


@given(quaternions, quaternions, vectors, axes, st.floats(-3.0, 3.0))
@unhurried
def test_against_mujoco(p, q, v, axis, angle):
    four, three, nine = np.empty(4), np.empty(3), np.empty(9)
    mujoco.mju_mulQuat(four, p, q)
    np.testing.assert_allclose(quat.product(p, q), four, rtol=0, atol=1e-15)
    mujoco.mju_rotVecQuat(three, v, q)
    np.testing.assert_allclose(quat.rotate(q, v), three, rtol=0, atol=2e-14)
    mujoco.mju_quat2Mat(nine, q)
    np.testing.assert_allclose(quat.to_matrix(q), nine.reshape(3, 3), rtol=0, atol=1e-15)
    mujoco.mju_axisAngle2Quat(four, axis, angle)
    np.testing.assert_allclose(quat.exp(axis * angle), four, rtol=0, atol=1e-15)
    # MuJoCo takes the angular velocity in the world frame here.
    mujoco.mju_derivQuat(four, q, quat.rotate(q, v))
    np.testing.assert_allclose(quat.derivative(q, v), four, rtol=0, atol=2e-14)


# ---- batches, and compiled code ----


def random_vectors(n):
    rng = np.random.default_rng(7)
    u = rng.normal(size=(3, n))
    u[:, 0] = 0.0
    u[:, 1] = [math.pi, 0.0, 0.0]
    return u, rng.normal(size=(3, n))


def test_a_batch_is_its_columns():
    n = 6
    u, v = random_vectors(n)
    p, q = quat.exp(u), quat.exp(v)
    q[:, 2] = quat.from_euler_zyx(0.3, math.pi / 2, 0.1)
    pitch, roll = u[0], v[0]
    cases = [
        (quat.product, (p, q)),
        (quat.conjugate, (q,)),
        (quat.rotate, (q, v)),
        (quat.normalise, (3.0 * q,)),
        (quat.exp, (u,)),
        (quat.log, (p,)),
        (quat.angle_between, (p, q)),
        (quat.to_matrix, (q,)),
        (quat.from_matrix, (quat.to_matrix(p),)),
        (quat.from_euler_zyx, (v[0], v[1], v[2])),
        (quat.to_euler_zyx, (q,)),
        (quat.euler_zyx_rate_matrix, (pitch, roll)),
        (quat.derivative, (q, v)),
        (quat.dexp_inverse, (u, v)),
        (quat.cross, (u, v)),
    ]
    for function, arguments in cases:
        copies = [a.copy() for a in arguments]
        together = function(*arguments)
        assert np.all(np.isfinite(together)), function.__name__
        assert together.shape[-1] == n
        for i in range(n):
            alone = function(*[a[..., i].copy() for a in arguments])
            np.testing.assert_allclose(
                together[..., i], alone, rtol=0, atol=1e-15, err_msg=function.__name__
            )
        for before, after in zip(copies, arguments, strict=True):
            np.testing.assert_array_equal(before, after)


def test_one_rotation_with_many_vectors_and_the_other_way_round():
    u, v = random_vectors(5)
    q, batch = quat.exp(v[:, 0]), quat.exp(u)
    np.testing.assert_allclose(quat.rotate(q, u), quat.to_matrix(q) @ u, rtol=0, atol=2e-15)
    count = np.repeat(q[:, None], 5, axis=1)
    np.testing.assert_array_equal(quat.product(q, batch), quat.product(count, batch))
    np.testing.assert_array_equal(quat.product(batch, q), quat.product(batch, count))


# ---- values from outside ----


def test_unit_quaternion_returns_a_checked_copy():
    given_values = [0, 1, 0, 0]
    q = quat.unit_quaternion(given_values)
    assert q.dtype == np.float64 and q.flags.c_contiguous
    batch = np.eye(4)
    checked = quat.unit_quaternion(batch.T)
    checked[0, 0] = 5.0
    assert batch[0, 0] == 1.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0, 0.0, 0.0], r"start.shape must be \(4,\) or \(4, N\).*, got \(3,\)"),
        (np.ones((2, 4)), r"start.shape must be .*, got \(2, 4\)"),
        (np.ones((4, 1, 1)), r"start.shape must be .*, got \(4, 1, 1\)"),
        ([1.0, math.nan, 0.0, 0.0], r"start\[1\] must be a finite number.*, got nan"),
        ([1.0, 0.0, 0.0, math.inf], r"start\[3\] must be .*, got inf"),
        ([0.0, 0.0, 0.0, 0.0], r"must be a length of 1 within 1e-06 \(here 0\)"),
        ([1.0, 0.01, 0.0, 0.0], r"start must be .*\(here 1\.00005"),
        (
            np.array([[1.0, 1.0], [0, 1], [0, 0], [0, 0]]),
            r"start\[:, 1\] must be .*, got \[1\.0, 1\.0, 0\.0, 0\.0\]",
        ),
        ("north", r"start must be an array of real numbers.*, got 'north'"),
        ([1j, 0, 0, 0], r"real numbers"),
    ],
)
def test_unit_quaternion_refuses(values, message):
    with pytest.raises(ValueError, match=message):
        quat.unit_quaternion(values, "start")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.eye(4), r"matrix.shape must be \(3, 3\) or \(3, 3, N\).*, got \(4, 4\)"),
        (np.diag([1.0, 1.0, math.nan]), r"matrix\[2, 2\] must be .*, got nan"),
        (np.diag([1.0, 1.0, -1.0]), r"determinant of 1 \(here -1\)"),
        (np.diag([1.0, 1.0, 1.1]), r"orthonormal within 1e-06 \(here 0\.21\)"),
        (np.stack([np.eye(3), 2 * np.eye(3)], axis=-1), r"matrix\[:, :, 1\] must be"),
    ],
)
def test_rotation_matrix_refuses(values, message):
    with pytest.raises(ValueError, match=message):
        quat.rotation_matrix(values)


def test_rotation_matrix_accepts_one_and_many():
    u, _ = random_vectors(5)
    R = quat.to_matrix(quat.exp(u))
    np.testing.assert_array_equal(quat.rotation_matrix(R), R)
    np.testing.assert_array_equal(quat.rotation_matrix(R[:, :, 3].tolist()), R[:, :, 3])


def test_all_names_are_there():
    assert sorted(quat.__all__) == list(quat.__all__)
    for name in quat.__all__:
        assert getattr(quat, name).__doc__
