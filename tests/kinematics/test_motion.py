"""Frames and Jacobians against geometry, differences and each other."""

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import kinematics
from course.kinematics import condition_number, jacobian, null_space, panda, planar, tip
from course.rigid_body.quaternion import from_matrix, rotate, to_euler_zyx
from tests.budget import examples
from tests.kinematics.arms import drawn, states

seeds = st.integers(0, 10_000)


def twist(chain, q, v, point, joint, h=1e-6):
    """The velocity of a point and the spin of its link, by central differences."""
    ends = []
    for t in (h, -h):
        pose = kinematics.frames(chain, q + t * v)[:, joint]
        ends.append((pose[:3] + rotate(pose[3:], point), pose))
    speed = (ends[0][0] - ends[1][0]) / (2 * h)
    turn = kinematics.pose_error(ends[0][1], ends[1][1])[3:]
    return np.concatenate([speed, turn / (2 * h)])


@examples(40)
@given(seeds)
def test_the_jacobian_of_any_point_is_its_twist(seed) -> None:
    chain, rng = drawn(seed), np.random.default_rng(seed)
    q, v = states(chain, rng, 2)
    point, joint = rng.normal(size=3), int(rng.integers(chain.n))
    result = jacobian(chain, q, point, joint=joint) @ v
    np.testing.assert_allclose(result, twist(chain, q, v, point, joint), atol=1e-7 * 30)


@examples(40)
@given(seeds)
def test_its_rate_is_the_difference_of_jacobians(seed) -> None:
    chain, rng = drawn(seed), np.random.default_rng(seed)
    q, v = states(chain, rng, 2)
    point, joint, h = rng.normal(size=3), int(rng.integers(chain.n)), 1e-5
    ahead, behind = (jacobian(chain, q + t * v, point, joint=joint) for t in (h, -h))
    rate = kinematics.jacobian_rate(chain, q, v, point, joint=joint)
    size = 1.0 + np.abs(rate).max() + np.abs(v).max() ** 3 * chain.reach[1]
    assert np.abs(rate - (ahead - behind) / (2 * h)).max() < 1e-7 * size


@pytest.mark.slow
@examples(30)
@given(seeds)
def test_a_batch_is_its_columns(seed) -> None:
    chain, rng = drawn(seed), np.random.default_rng(seed)
    q, v, a = rng.normal(size=(3, chain.n, 4))
    for function, given_ in (
        (kinematics.frames, (q,)),
        (tip, (q,)),
        (jacobian, (q,)),
        (kinematics.analytic_jacobian, (q,)),
        (kinematics.jacobian_rate, (q, v)),
        (kinematics.mass_matrix, (q,)),
        (kinematics.inverse_dynamics, (q, v, a)),
        (kinematics.forward_dynamics, (q, v, a)),
        (kinematics.bias, (q, v)),
        (kinematics.regressor, (q, v, a)),
        (lambda c, q, v: np.array(kinematics.energy(c, q, v)), (q, v)),
    ):
        whole = function(chain, *given_)
        for k in range(4):
            one = function(chain, *(x[:, k] for x in given_))
            # A sum of another length may be added in another order.
            np.testing.assert_allclose(whole[..., k], one, rtol=1e-13, atol=1e-13)


def test_the_flange_of_the_panda_is_where_the_published_table_puts_it() -> None:
    """Against the table multiplied out with 30 digits."""
    rows = [(0, 0.333, 0), (0, 0, -1), (0, 0.316, 1), (0.0825, 0, 1), (-0.0825, 0.384, -1)]
    rows += [(0, 0, 1), (0.088, 0, 1), (0, 0.107, 0)]
    chain, rng = panda(), np.random.default_rng(0)
    for q in (np.zeros(7), *rng.normal(size=(5, 7))):
        with mpmath.workdps(30):
            T = mpmath.eye(4)
            for (a, d, quarter), angle in zip(rows, [*q, 0.0], strict=True):
                ca, sa = (f(quarter * mpmath.pi / 2) for f in (mpmath.cos, mpmath.sin))
                c, s = mpmath.cos(float(angle)), mpmath.sin(float(angle))
                rows_of = (
                    [c, -s, 0, a],
                    [s * ca, c * ca, -sa, -d * sa],
                    [s * sa, c * sa, ca, d * ca],
                )
                T = T * mpmath.matrix([*rows_of, [0, 0, 0, 1]])
            exact = np.array(T.tolist(), dtype=float)
        pose = tip(chain, q)
        np.testing.assert_allclose(pose[:3], exact[:3, 3], atol=1e-15 * 4)
        assert abs(abs(pose[3:] @ from_matrix(exact[:3, :3])) - 1.0) < 1e-15 * 4


@examples(40)
@given(seeds)
def test_the_null_space_is_a_projector_that_leaves_the_tip_still(seed) -> None:
    rng = np.random.default_rng(seed)
    J = jacobian(panda(), rng.normal(size=7))
    P = null_space(J)
    np.testing.assert_allclose(P @ P, P, atol=1e-12)
    np.testing.assert_allclose(P, P.T, atol=1e-13)
    assert np.abs(J @ P).max() < 1e-9 and abs(np.trace(P) - 1.0) < 1e-12
    stack = np.stack([J, 2.0 * J], axis=2)
    np.testing.assert_allclose(null_space(stack)[:, :, 1], P, atol=1e-12)


def test_at_a_singularity_the_null_space_has_grown() -> None:
    J = jacobian(planar([1.0, 0.7]), [0.4, 0.0])[:2]
    assert np.trace(null_space(J)) == pytest.approx(1.0)
    assert np.trace(null_space(jacobian(planar([1.0, 0.7]), [0.4, 1e-6])[:2])) < 1e-9


@examples(50)
@given(st.floats(-3, 3), st.floats(-3, 3))
def test_manipulability_of_two_links_is_the_area_of_their_parallelogram(q1, q2) -> None:
    J = jacobian(planar([1.0, 0.7]), [q1, q2])[:2]
    assert abs(kinematics.manipulability(J) - 0.7 * abs(np.sin(q2))) < 1e-14


def test_the_condition_number_is_infinite_where_the_rank_is_lost() -> None:
    """Rounding leaves a smallest singular value of 1e-17, which is not a number of 6e16."""
    arm = panda()
    straight = jacobian(arm, np.zeros(7))
    assert np.linalg.matrix_rank(straight) == 5
    assert condition_number(straight, 1.0) == np.inf
    near = jacobian(arm, np.array([0.0, 1e-6, 0.0, -1e-6, 0.0, 1e-6, 0.0]))
    assert np.linalg.matrix_rank(near) == 6 and 1e3 < condition_number(near, 1.0) < np.inf
    both = condition_number(np.stack([straight, near], axis=2), 1.0)
    assert both[0] == np.inf and both[1] == pytest.approx(condition_number(near, 1.0), rel=1e-6)


def test_metres_and_millimetres_give_other_condition_numbers() -> None:
    """The same posture: which rows were divided by what has to be said."""
    q = np.array([0.3, -0.5, 0.2, -1.8, 0.4, 1.6, 0.7])
    J = jacobian(panda(), q)
    metres, millimetres = condition_number(J, 1.0), condition_number(J, 1e-3)
    assert 30.0 < millimetres / metres < 1000.0
    best = min(condition_number(J, length) for length in np.geomspace(0.01, 10.0, 200))
    assert best < metres
    assert condition_number(np.diag([2.0, 2, 2, 1, 1, 1]), 2.0) == pytest.approx(1.0)
    lost = np.zeros((6, 2))
    lost[0, 0] = 1.0
    assert condition_number(lost, 1.0) == np.inf


def test_euler_rates_lock_where_the_arm_does_not() -> None:
    """Towards a pitch of 90 degrees they grow without bound; the geometric Jacobian stays."""
    chain, rng, h = panda(), np.random.default_rng(1), 1e-6

    def angles(q):
        pose = tip(chain, q)
        return np.concatenate([pose[:3], to_euler_zyx(pose[3:])])

    q = rng.normal(size=7)
    slopes = [(angles(q + h * e) - angles(q - h * e)) / (2 * h) for e in np.eye(7)]
    np.testing.assert_allclose(
        kinematics.analytic_jacobian(chain, q), np.array(slopes).T, atol=1e-7
    )
    goal = np.zeros(7)
    for lean, least in ((1e-2, 50.0), (1e-4, 5e3)):
        goal[:3], half = (0.4, 0.1, 0.5), 0.5 * (0.5 * np.pi - lean)
        goal[3:] = np.cos(half), 0.0, np.sin(half), 0.0
        other = kinematics.ik(chain, goal)
        assert other.success
        locked = condition_number(kinematics.analytic_jacobian(chain, other.q), 1.0)
        assert locked > least and condition_number(jacobian(chain, other.q), 1.0) < 200.0


def test_the_reach_bounds_every_posture() -> None:
    for seed in range(0, 40, 2):
        chain, rng = drawn(seed), np.random.default_rng(seed)
        near, far = chain.reach
        q = kinematics.uniform_starts(chain, 200, rng).T
        away = np.linalg.norm(tip(chain, q)[:3] - chain.placement[:3, :1], axis=0)
        assert np.all((near - 1e-12 <= away) & (away <= far + 1e-12))
    assert planar([1.0, 0.3, 0.2]).reach == pytest.approx((0.5, 1.5))
