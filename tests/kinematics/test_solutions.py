"""The worked answers of chapter 4 against closed forms, Pinocchio, MuJoCo and their laws."""

import math
import warnings
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from course import kinematics
from course.drills import fk3
from course.oracles.mujoco import chain as mujoco_chain
from course.oracles.pinocchio import Arm
from course.rigid_body.quaternion import angle_between, from_euler_zyx, to_matrix
from drills import cards
from drills.grader import attempt
from drills.verify import in_this_process
from solutions import kinematics as solutions
from tests.budget import examples, sampled

NEW = ("two_link_ik", "jacobian", "damped_step", "null_space_step", "rnea_planar", "wrist_ik")


@pytest.fixture(autouse=True)
def _floating_point_is_quiet():
    """No answer may warn, whatever it is given here."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        yield


def numbers(low: float, high: float):
    return st.floats(low, high, allow_nan=False)


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


@pytest.mark.slow
@pytest.mark.parametrize("name", sampled(NEW, 3))
def test_a_wrong_answer_is_drawn(name):
    """The picture of the first case that the starter has wrong."""
    from drills import picture

    card = cards.card(name)
    report = attempt(card, card.starter(), seed=3, place=in_this_process).report
    assert not report.passed
    figure = picture.figure_of(report)
    assert figure is not None and len(figure.axes[0].lines) >= 2


# --- two links ------------------------------------------------------------------------------------


@examples(100)
@given(arrays(float, 2, elements=numbers(0.05, 3.0)), numbers(0.0, 1.0), numbers(-4.0, 4.0))
def test_both_arms_reach_the_target_by_forward_kinematics(lengths, share, angle):
    inner, outer = abs(lengths[0] - lengths[1]), lengths.sum()
    r = inner + share * (outer - inner)
    target = r * np.array([math.cos(angle), math.sin(angle)])
    rows = solutions.two_link_ik(lengths, target)
    for q in rows:
        tip = fk3(np.array([*lengths, 0.0]), np.array([*q, 0.0]))[-1]
        np.testing.assert_allclose(tip, target, rtol=0, atol=1e-12)
    assert 0.0 <= rows[0, 1] <= math.pi and rows[1, 1] == -rows[0, 1]
    course = kinematics.two_link_ik(lengths, target)
    if course.reached:
        deviation = np.exp(1j * rows.T) - np.exp(1j * course.q)
        assert np.abs(deviation).max() < 1e-7


@given(arrays(float, 2, elements=numbers(0.05, 3.0)), numbers(-3.0, 3.0))
def test_targets_out_of_reach_are_refused_and_the_slack_is_not(lengths, angle):
    inner, outer = abs(lengths[0] - lengths[1]), lengths.sum()
    direction = np.array([math.cos(angle), math.sin(angle)])
    for r in (outer + 2e-9, 2.0 * outer, inner - 2e-9, 0.5 * inner - 1e-8):
        if r >= 0.0:
            with pytest.raises(ValueError, match="from the base"):
                solutions.two_link_ik(lengths, r * direction)
    stretched = solutions.two_link_ik(lengths, (outer + 5e-10) * direction)
    assert (stretched[:, 1] == 0.0).all()


# --- the Jacobian ---------------------------------------------------------------------------------


def rows_of(arm):
    """The placements of an arm as the answer takes them, (n, 4, 4)."""
    rows = np.tile(np.eye(4), (arm.n, 1, 1))
    rows[:, :3, 3] = arm.placement[:3].T
    rows[:, :3, :3] = np.moveaxis(to_matrix(arm.placement[3:]), 2, 0)
    return rows


@pytest.mark.slow
@examples(60)
@given(rngs(), st.integers(1, 9))
def test_the_jacobian_is_pinocchios_and_the_chapters(rng, n):
    arm = replace(
        kinematics.random_chain(n, rng), slides=False, tool=[*rng.normal(size=3), 1, 0, 0, 0]
    )
    q = rng.uniform(-9.0, 9.0, n)
    result = solutions.geometric_jacobian(rows_of(arm), q, arm.tool[:3])
    for truth in (Arm(arm).jacobians(q, 0 * q)[0], kinematics.jacobian(arm, q)):
        np.testing.assert_allclose(result, truth, rtol=0, atol=1e-12 * (1.0 + n))


# --- damped and redundant steps -------------------------------------------------------------------


@examples(100)
@given(rngs(), st.integers(1, 6), st.integers(1, 8), numbers(-7.0, 1.0), st.integers(0, 5))
def test_a_damped_step_minimises_and_keeps_its_bound(rng, m, n, power, rank):
    J, error, damping = rng.normal(size=(m, n)), rng.normal(size=m), 10.0**power
    if rank < min(m, n):
        J = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
    step = solutions.damped_step(J, error, damping)
    assert np.linalg.norm(step) <= np.linalg.norm(error) / (2.0 * damping) * (1.0 + 1e-9)
    # The least of |J dq - e|^2 + lambda^2 |dq|^2 by another way: one longer system, by QR.
    longer = np.vstack((J, damping * np.eye(n)))
    truth = np.linalg.lstsq(longer, np.concatenate((error, np.zeros(n))), rcond=0.0)[0]
    allowed = np.linalg.norm(error) / damping * 1e-14 * (100.0 + 30.0 * np.linalg.norm(J) / damping)
    np.testing.assert_allclose(step, truth, rtol=0, atol=allowed)


def test_normal_equations_lose_a_damping_of_1e_minus_7():
    """Why the exercise asks for it: the textbook's formula breaks its own bound there."""
    rng, damping = np.random.default_rng(5), 1e-7
    U, _, Vt = np.linalg.svd(rng.normal(size=(3, 3)))
    J, error = U * np.array([2.0, 1.0, damping]) @ Vt, U[:, 2]
    normal = J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(3), error)
    truth = 0.5 / damping
    assert np.linalg.norm(solutions.damped_step(J, error, damping)) == pytest.approx(truth, 1e-6)
    assert abs(np.linalg.norm(normal) / truth - 1.0) > 1e-4


@examples(80)
@given(rngs(), st.integers(1, 6), st.integers(0, 3))
def test_a_null_space_step_solves_the_task_and_is_the_nearest_that_does(rng, m, spare):
    n = m + spare
    U, _, Vt = np.linalg.svd(rng.normal(size=(m, n)), full_matrices=False)
    J = U * rng.uniform(0.3, 2.0, m) @ Vt
    dx, wish, weights = rng.normal(size=m), rng.normal(size=n), rng.uniform(0.1, 10.0, n)
    step = solutions.null_space_step(J, dx, wish, weights)
    np.testing.assert_allclose(J @ step, dx, rtol=0, atol=1e-12 * (1.0 + n))
    # Stationary under J dq = dx: W (dq - wish) is a combination of the rows of J (Lagrange).
    pull = weights * (step - wish)
    np.testing.assert_allclose(kinematics.null_space(J) @ pull, 0.0, rtol=0, atol=1e-11)


# --- inverse dynamics -----------------------------------------------------------------------------


@pytest.mark.slow
@examples(25)
@given(rngs(), st.integers(1, 8), st.sampled_from([0.0, 9.81]))
def test_torques_are_those_of_pinocchio_and_mujoco(rng, n, gravity):
    lengths, masses = rng.uniform(0.1, 1.0, n), rng.uniform(0.2, 3.0, n)
    q, v, a = rng.uniform(-4, 4, n), 3.0 * rng.normal(size=n), 5.0 * rng.normal(size=n)
    result = solutions.rnea_planar(lengths, masses, q, v, a, gravity)
    arm, down = kinematics.planar(lengths, masses), (0.0, -gravity, 0.0)
    model = mujoco_chain.model(arm, down)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
    mujoco.mj_inverse(model, data)
    for truth, digits in (
        (Arm(arm, down).inverse_dynamics(q, v, a), 1e-12),
        (data.qfrc_inverse, 1e-10),
        (kinematics.inverse_dynamics(arm, q, v, a, gravity=down), 1e-12),
    ):
        np.testing.assert_allclose(result, truth, rtol=0, atol=digits * (1.0 + np.abs(truth).max()))


# --- the wrist ------------------------------------------------------------------------------------


@examples(25)
@given(rngs(), st.sampled_from([1.0, -1.0]), st.integers(-2, 2))
def test_the_wrist_goes_the_short_way_to_the_nearest_answer(rng, sign, turns):
    """The goal is known: the closed form of Euler angles has it, whatever the sign says."""
    goal = np.array([rng.uniform(-1.5, 1.5) + 2.0 * math.pi * turns, *rng.uniform(-0.7, 0.7, 2)])
    start = goal + rng.uniform(-0.9, 0.9, 3)
    target = sign * from_euler_zyx(*goal)
    result = solutions.wrist_ik(start, target, 0.05, 60)
    np.testing.assert_allclose(result, goal, rtol=0, atol=1e-8)


def test_the_starter_of_the_hunt_arrives_and_has_gone_round():
    """The bug is silent: the hand is right, a joint is a full turn away."""
    names: dict = {}
    exec(cards.card("wrist_ik").starter(), names)
    start, goal = np.array([0.2, 0.3, -0.2]), np.array([0.7, -0.3, 0.4])
    for sign in (1.0, -1.0):
        target = sign * from_euler_zyx(*goal)
        result = names["wrist_ik"](start, target, 0.05, 60)
        assert angle_between(from_euler_zyx(*result), target) < 1e-6
        assert (np.abs(result - goal).max() < 1e-6) == (sign > 0)
