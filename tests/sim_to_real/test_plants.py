"""The batch of arms: against chapter 4's arm, chapter 6's exact joint, and energy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import control
from course.control import Actuator, Controller, Encoder, Gains, Joint, run_joint
from course.kinematics import TwoLink
from course.sim_to_real import Plants, Tasks, driven, nominal, plants, real, rollouts, tasks, watch
from tests.budget import examples

HELD = 1e3  # dry friction that no torque here overcomes [N m]
STEADY = (20.0, 5.0, 2.5, 8.0, 2.0, 0.8)


@examples(10)
@given(
    mass=st.floats(0.5, 2.0),
    payload=st.floats(0.0, 1.0),
    viscous=st.floats(0.0, 3.0),
    seed=st.integers(0, 1000),
)
def test_without_dry_friction_it_is_the_two_links_of_chapter_4(mass, payload, viscous, seed):
    rng = np.random.default_rng(seed)
    arm = TwoLink(
        masses=(mass, 0.8 * mass), payload=payload, damping=(0.2 * viscous, 0.2 * viscous)
    )
    start, torques = rng.uniform(-1.0, 1.0, 4), rng.uniform(-2.0, 2.0, (40, 2))
    body = Plants(mass, payload, viscous).columns()
    got = driven(body, torques, start)
    states = [
        control.rollouts(arm, torques[None], 0.01, (start[:2], start[2:]), substeps=n)
        for n in (2, 40)
    ]
    for (q, v), allowed in zip(states, (1e-11, 1e-4), strict=True):  # its own steps, and finer ones
        assert np.abs(got.q[:, 0] - q[:, :, 0].T).max() < allowed
        assert np.abs(got.v[:, 0] - v[:, :, 0].T).max() < 10.0 * allowed


@examples(15)
@given(
    coulomb=st.floats(0.0, 0.6),
    delay=st.floats(0.0, 0.05),
    factor=st.floats(0.3, 1.2),
    kp=st.floats(2.0, 12.0),
    goal=st.floats(-1.0, 1.0),
)
def test_with_the_other_joint_held_it_is_the_exact_joint_of_chapter_6(
    coulomb, delay, factor, kp, goal
):
    """Delay of any length, the limit, the filter, sticking: all of the loop of one joint."""
    body = Plants(delay=delay, torque=factor).columns()
    body[5:7] = [[HELD], [coulomb]]
    gains = Gains(kp, 2.0, 0.8, plants.FILTER, -3.0, 3.0)
    joint = Joint(body[2, 0] / factor, body[4, 0] / factor, coulomb=coulomb / factor)
    truth = run_joint(
        joint, Actuator(delay=delay), Encoder(), gains, 1.2 + goal, 0.01, 0.9, start=(1.2, 0.0, 0.0)
    )
    sent = driven(body, np.stack([0.0 * truth.command, truth.command], 1), (0.4, 1.2, 0, 0))
    assert np.all(sent.q[0] == 0.4)
    assert np.abs(sent.q[1, 0] - truth.q).max() < 1e-7
    assert np.abs(sent.v[1, 0] - truth.v).max() < 1e-5


def test_the_policy_is_chapter_6s_controller_at_each_joint_and_its_commands_replay_the_motion():
    posed, body = tasks(4, 2), real(np.linspace(0.0, 1.0, 4), 0.013)
    run = watch(body, STEADY, posed)
    for joint, (limit, (kp, ki, kd)) in enumerate(
        zip(plants.ARM.torques, np.reshape(STEADY, (2, 3)), strict=True)
    ):
        for e in range(4):
            law = Controller(Gains(kp, ki, kd, plants.FILTER, -limit, limit), plants.DT)
            observed = run.measured[joint, e, :-1].tolist()
            sent = [law.update(float(posed.reference[joint, e]), y) for y in observed]
            assert sent == run.command[joint, e].tolist()
    start = np.concatenate([posed.start, np.zeros((2, 4))])
    again = driven(body.columns(), run.command.transpose(2, 0, 1), start)
    assert np.array_equal(again.q, run.q)


@examples(15)
@given(
    coulomb=st.floats(0.0, 1.0),
    payload=st.floats(0.0, 1.0),
    seed=st.integers(0, 1000),
)
def test_the_work_of_the_motors_is_motion_or_heat(coulomb, payload, seed):
    """Over each sample in which no joint turns back: torque and dry friction are constant then."""
    rng = np.random.default_rng(seed)
    body = Plants(payload=payload, viscous=0.0, coulomb=coulomb).columns()
    arm = TwoLink(payload=payload)
    torques = rng.uniform(-3.0, 3.0, (60, 2))
    run = driven(body, torques, (*rng.uniform(-2.0, 2.0, 2), *rng.uniform(-3.0, 3.0, 2)))
    q, v = run.q[:, 0], run.v[:, 0]
    energy = 0.5 * np.einsum("it,ijt,jt->t", v, arm.mass_matrix(q), v)
    moved = np.diff(q)
    work = np.sum(torques.T * moved, axis=0)
    heat = coulomb * np.abs(moved[0]) + 0.5 * coulomb * np.abs(moved[1])
    plain = np.all(v[:, 1:] * v[:, :-1] > 0.0, axis=0)
    plain &= np.all(np.sign(moved) == np.sign(v[:, 1:]), axis=0)
    assert plain.sum() > 10
    assert np.abs(np.diff(energy) - (work - heat))[plain].max() < 1e-5


@pytest.mark.parametrize(("share", "moves"), [(0.999, False), (1.001, True)])
def test_it_rests_to_the_last_bit_below_its_friction_and_starts_above(share, moves):
    """Both joints, each alone: the other is pushed by as much as keeps it at rest."""
    body = Plants(coulomb=0.4).columns()
    for pushed in ([0.4, 0.0], [0.0, -0.2], [0.4, -0.2]):
        run = driven(body, np.tile(np.multiply(share, pushed), (30, 1)), (0.3, 1.0, 0.0, 0.0))
        assert bool(np.any(run.q[:, 0, -1] != (0.3, 1.0))) == moves


def test_noise_and_offset_are_in_what_is_measured_only():
    rng = np.random.default_rng(4)
    noise = rng.standard_normal((31, 2, 1))
    body = Plants(bias=0.02, noise=0.001).columns()
    run = driven(body, np.zeros((30, 2)), (0.3, 1.0, 0.5, 0.0), noise=noise)
    silent = driven(nominal().columns(), np.zeros((30, 2)), (0.3, 1.0, 0.5, 0.0))
    assert np.array_equal(run.q, silent.q)
    expected = run.q + 0.02 + 0.001 * noise.transpose(1, 2, 0)
    assert np.abs(run.measured - expected).max() < 1e-15


def test_the_outcome_is_what_the_motion_shows():
    posed, body = tasks(200, 3), real(np.linspace(0.0, 1.0, 200), 0.012)
    got = rollouts(body, STEADY, posed)
    run = watch(body, STEADY, posed)
    far = np.hypot(*(plants.tip(run.q) - posed.goal[:, :, None]))
    near = far <= plants.RADIUS
    assert np.array_equal(got.success, near[:, -11:].all(axis=1))
    assert np.allclose(got.inside, 0.01 * near.sum(axis=1), atol=1e-12)
    assert np.allclose(got.error, far[:, -1], atol=1e-12)
    late, other = near[:, -1] & ~got.success, near.any(axis=1)
    reason = np.where(got.success, 0, np.where(late, 1, np.where(other, 2, 3)))
    assert np.array_equal(got.reason, reason)
    assert len(got.reasons()) >= 3


def test_one_stands_for_all_and_sets_of_gains_are_rows():
    posed, sets = tasks(20, 5), np.array([STEADY, np.multiply(STEADY, 0.5)]).T
    body = real(0.3, 0.01)
    both = rollouts(body, sets, posed)
    count = Plants(**{name: np.full(20, getattr(body, name)) for name in plants.FIELDS})
    for k in range(2):
        alone = rollouts(count, sets[:, k], posed)
        assert np.array_equal(both.error[k], alone.error)
        assert both.rate[k] == alone.rate
    picked = rollouts(
        count.take(np.arange(20) == 7), STEADY, Tasks(posed.start[:, 7:8], posed.goal[:, 7:8])
    )
    assert picked.success.shape == (1,)


def test_an_arm_that_diverges_says_so():
    got = rollouts(real(0.0, 0.1), (1e5, 0.0, 0.0, 1e5, 0.0, 0.0), tasks(3, 1))
    wild = rollouts(Plants(mass=1e-6), np.multiply(STEADY, 50.0), tasks(3, 1))
    assert "diverged" in wild.reasons()
    assert np.all(np.isinf(wild.error[wild.reason == 4]))
    assert not got.success.any()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Plants(mass=-1.0), r"mass must be .*, got -1.0"),
        (lambda: Plants(delay=-1e-3), r"delay must be .*, got -0.001"),
        (lambda: Plants(mass=np.ones(3), torque=np.ones(2)), "torque.shape must be"),
        (lambda: real(3.0), r"gap must be .*, got 3.0"),
        (lambda: real(0.0, -0.01), r"delay must be .*, got -0.01"),
        (
            lambda: Tasks(np.zeros((2, 1)), np.array([[2.0], [0.0]])),
            r"goal.* must be .*0.1 to 0.9 m",
        ),
        (lambda: rollouts(nominal(2), STEADY, tasks(3, 0)), r"plants.size must be .*, got 2"),
        (
            lambda: rollouts(nominal(), np.negative(STEADY), tasks(3, 0)),
            r"gains.* must be .*, got -20",
        ),
        (
            lambda: driven(-nominal().columns(), np.zeros((1, 2)), np.zeros(4)),
            r"columns.* must be .*, got -",
        ),
        (lambda: driven(nominal().columns(), np.full((1, 2), np.nan), np.zeros(4)), "torques.*nan"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()
