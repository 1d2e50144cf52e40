"""Each prediction against an exact eigenvalue, another way to solve it, or the arm itself."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from course.control.sampled import growth as growth_of
from course.control.sampled import held, joint_system
from course.kinematics.two_link import TwoLink, acceleration
from course.kinematics.two_link import two_link_ik as ik
from course.pipeline import theory
from tests.budget import examples

ARM = TwoLink()
FOLDED, BENT, STRETCHED = (0.3, 2.9), (0.3, 1.4), (0.3, 0.0)


def tip(q):
    (l1, l2), (q1, q2) = ARM.lengths, q
    x, y = l1 * np.cos(q1) + l2 * np.cos(q1 + q2), l1 * np.sin(q1) + l2 * np.sin(q1 + q2)
    return np.array([x, y])


def move(arm, q, v, reference, kp, kd, h, steps):
    """Semi-implicit Euler with PD at every step; the last state and all angles."""
    column, q, v = arm.column(), np.array(q, float)[:, None], np.array(v, float)[:, None]
    observed = np.empty((steps, 2))
    for k in range(steps):
        column[11:] = kp * (np.asarray(reference(k * h))[:, None] - q) - kd * v
        v = v + h * acceleration(q, v, column)
        q = q + h * v
        observed[k] = q[:, 0]
    return q[:, 0], v[:, 0], observed


def lyapunov(A, B):
    from scipy.linalg import solve_discrete_lyapunov

    return solve_discrete_lyapunov(A, np.outer(B, B))


@examples(40)
@given(a=st.floats(0.02, 1.95), b=st.floats(0.0, 3.9), ahead=st.floats(0.0, 5.0))
def test_gain_of_an_alpha_beta_filter(a, b, ahead):
    A = np.array([[1.0 - a, 1.0 - a], [-b, 1.0 - b]])
    radius = np.abs(np.linalg.eigvals(A)).max()
    assume(abs(radius - 1.0) > 1e-3 and b > 1e-3)
    if radius > 1.0:
        with pytest.raises(ValueError, match="2 alpha"):
            theory.filter_gain(a, b)
        return
    C, take = lyapunov(A, np.array([a, b])), np.array([1.0, ahead])
    assert theory.filter_gain(a, b, ahead) == pytest.approx(take @ C @ take, rel=1e-6)


@pytest.mark.parametrize(("kp", "kd"), [(25.0, 8.0), (60.0, 8.0), (25.0, 3.0)])
def test_the_arm_as_a_low_pass_is_its_slow_mode_and_little_else(kp, kd):
    """Exactly, with the inertia that the formula leaves out, for the mode that it serves worst."""
    heaviest = np.linalg.eigvalsh(ARM.mass_matrix(STRETCHED)).max()
    A, B = joint_system(float(heaviest), kd + 0.2, kp)
    plant = held(A, B, 0.1)
    exact = lyapunov(plant.transition, kp * plant.now)[0, 0]
    simple = theory.low_pass(0.1, (kd + 0.2) / kp)
    assert exact == pytest.approx(simple, rel=0.35 if kd == 3.0 else 0.12)
    assert exact < simple if kd == 8.0 else exact > simple


def test_the_lag_of_a_moving_reference_is_first_order_in_its_speed():
    kp, kd, h, deviation = 25.0, 8.0, 0.002, []
    for speed in (0.05, 0.1):
        u, end = np.array([0.6, 0.8]) * speed, np.array([0.45, 0.35])
        path = [end + u * (k * h - 4.0) for k in range(2001)]
        bent = np.array(ik(ARM.lengths, np.array(path).T).q[:, 0])  # all at once
        rates = np.linalg.solve(theory.tip_jacobian(ARM, bent[:, 0]), u)
        q, _, _ = move(
            ARM, bent[:, 0], rates, lambda t, at=bent: at[:, round(t / h)], kp, kd, h, 2001
        )
        result = tip(q) - path[-1]
        deviation.append(float(np.linalg.norm(result - theory.lag(ARM, bent[:, -1], kp, kd, u))))
        assert deviation[-1] < 0.25 * speed * 0.33
        assert np.linalg.norm(result) > 0.25 * speed
    assert deviation[1] / deviation[0] == pytest.approx(4.0, rel=0.25)


def test_a_tilted_table_pulls_the_tip_by_this_much():
    deviation = []
    for angle in (0.002, 0.004):
        arm, q = TwoLink(gravity=9.81 * math.sin(angle)), np.array(BENT)
        rest = q.copy()
        for _ in range(100):  # where spring and gravity are in balance
            rest = q - arm.bias(rest, np.zeros(2)) / 25.0
        result = tip(rest) - tip(q)
        deviation.append(np.linalg.norm(result - theory.sag(arm, q, 25.0)))
        assert deviation[-1] < 0.02 * np.linalg.norm(result)
    assert deviation[1] / deviation[0] == pytest.approx(4.0, rel=0.1)


@examples(20)
@given(
    q2=st.floats(-math.pi, math.pi),
    kp=st.floats(2.0, 200.0),
    kd=st.floats(0.0, 20.0),
    more=st.floats(0.0, 1.0),
)
def test_the_step_limit_is_that_of_the_eigenvalue(q2, kp, kd, more):
    arm, q = TwoLink(damping=(0.2, 0.2 + more)), (0.4, q2)
    limit = theory.step_limit(arm, q, kp, kd)
    assert theory.growth(arm, q, kp, kd, 0.9999 * limit) < 1.0
    assert theory.growth(arm, q, kp, kd, 1.0001 * limit) > 1.0
    m = np.linalg.eigvalsh(np.linalg.inv(arm.mass_matrix(q))).max()
    k, low, high = kp * m, (kd + 0.2) * m, (kd + 0.2 + more) * m
    alone = [(math.sqrt(d * d + 4.0 * k) - d) / k for d in (high, low)]
    assert alone[0] * (1 - 1e-9) <= limit <= alone[1] * (1 + 1e-9)
    assert theory.step_limit(arm, q, kp, kd + 1.0) < limit  # more damping lowers it


@pytest.mark.parametrize("q", [FOLDED, BENT, STRETCHED])
@pytest.mark.parametrize(("kp", "kd"), [(25.0, 8.0), (25.0, 0.0), (100.0, 3.0)])
def test_the_arm_itself_stays_inside_the_limit_and_leaves_outside(q, kp, kd):
    """Outside it need not leave for good: stretched, it is thrown out, folds to where the same step
    is stable, comes back, and is thrown out again."""
    limit, start = theory.step_limit(ARM, q, kp, kd), np.array(q) + (1e-6, -2e-6)
    for share, stays in ((0.99, True), (1.01, False)):
        with np.errstate(over="ignore", invalid="ignore"):
            _, _, observed = move(ARM, start, np.zeros(2), lambda t: q, kp, kd, share * limit, 1500)
        away = np.abs(observed - q).max(axis=1)
        assert (np.nanmax(away) < 2e-5) == stays


def test_a_torque_that_is_held_over_several_steps():
    """Against chapter 6's matrix of one joint, for links that do not know of each other."""
    arm, h, n = TwoLink(), 1e-4, 100
    m = np.linalg.eigvalsh(np.linalg.inv(arm.mass_matrix(BENT)))
    for kp, kd in ((25.0, 0.3), (25.0, 8.0)):
        both = []
        for value in m:
            plant = held(*joint_system(1.0 / value, 0.2), n * h)
            both.append(growth_of(plant.transition - np.outer(plant.now, [kp, kd])))
        assert theory.growth(arm, BENT, kp, kd, h, n) == pytest.approx(max(both), rel=0.01)


@pytest.mark.prove
@pytest.mark.parametrize(("kp", "kd"), [(25.0, 0.0), (25.0, 0.5), (25.0, 8.0)])
def test_each_mode_overshoots_and_rings_as_said(kp, kd):
    result = theory.modes(ARM, BENT, kp, kd)
    values, shapes = np.linalg.eigh(np.linalg.inv(ARM.mass_matrix(BENT)))
    for i in range(2):
        h = 0.002 / result.omega[i]
        steps = min(int(1.1 * result.ring[i] / h), 30_000)
        away = 1e-5 * shapes[:, i]
        _, _, observed = move(ARM, np.array(BENT) + away, (0, 0), lambda t: BENT, kp, kd, h, steps)
        along = (observed - BENT) @ shapes[:, i] / 1e-5
        assert max(0.0, -along.min()) == pytest.approx(result.overshoot[i], abs=0.01)
        late = np.abs(along[int(result.ring[i] / h) :])
        if late.size:
            assert late.max() < 0.03
        assert np.abs(along[: int(0.7 * result.ring[i] / h)][-500:]).max() > 0.03 or late.size == 0
    assert np.allclose(result.zeta, 0.5 * (kd + 0.2) * np.sqrt(values / kp))


@examples(20)
@given(frames=st.integers(0, 5), share=st.floats(0.02, 0.95))
def test_noise_that_look_and_move_lets_through(frames, share):
    """The summed squares of the answer to one wrong picture."""
    gain = share * theory.look_limit(frames)
    past, total = [0.0] * frames + [gain], 0.0
    while len(past) < 100 or max(map(abs, past[-frames - 1 :])) > 1e-9:
        total += past[-1] ** 2
        past.append(past[-1] - gain * past[-1 - frames])
    assert theory.look_noise(gain, frames) == pytest.approx(total, rel=1e-6)
    if frames == 0:
        assert total == pytest.approx(gain / (2.0 - gain))
    elif frames == 1:
        assert total == pytest.approx(gain * (1.0 + gain) / ((1.0 - gain) * (2.0 + gain)))


def test_share_of_plans_that_touch_a_disc_seen_in_the_wrong_place():
    from scipy.stats import ncx2

    sigma, radius, gap = 0.01, 0.12, np.array([0.005, 0.01, 0.02])
    exact = ncx2.cdf((radius / sigma) ** 2, 2, ((radius + gap) / sigma) ** 2)
    wall = theory.collision_share(gap, sigma**2 * np.eye(2), (0.6, 0.8))
    assert np.all(exact < wall)
    assert np.all(wall < 1.35 * exact)
    far = ncx2.cdf((100 * radius / sigma) ** 2, 2, ((100 * radius + gap) / sigma) ** 2)
    assert np.allclose(far, wall, rtol=0.005)
    narrow = theory.collision_share(gap, np.diag([sigma**2, 0.0]), (0.6, 0.8))
    assert np.all(narrow < wall)


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: theory.look_noise(2.0, 0), "below 2"),
        (lambda: theory.look_noise(1.01, 1), "below 1"),
        (lambda: theory.modes(TwoLink(damping=(0.1, 0.2)), BENT, 25.0, 1.0), "damping"),
        (lambda: theory.collision_share(0.01, np.zeros((2, 2)), (1.0, 0.0)), "across the gap"),
        (lambda: theory.step_limit(ARM, BENT, 0.0, 1.0), "kp"),
        (lambda: theory.look_limit(-1), "frames"),
    ],
)
def test_bad_input_is_refused(call, match):
    with pytest.raises(ValueError, match=match):
        call()
