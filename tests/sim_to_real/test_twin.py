"""MuJoCo's arm: without its extras it is ours, and each extra does what its name says."""

from dataclasses import replace

import numpy as np
import pytest

from course.control import Controller, Gains, joint_system, margins
from course.oracles.mujoco.joint import MotorJoint
from course.oracles.mujoco.twin import PLAIN, Hidden, Twin, judged
from course.sim_to_real import Tasks, driven, nominal, plants, rollouts, tasks, watch

GAINS = (50.0, 3.0, 7.0, 25.0, 2.0, 1.3)
POSED = tasks(6, 5)


def ours(columns: np.ndarray, sent: np.ndarray, finer: int = 1) -> np.ndarray:
    """Angles (2, N, T + 1) of our arm under the same torques."""
    plan = np.repeat(sent.transpose(2, 0, 1), finer, axis=0)
    start = np.concatenate([POSED.start, np.zeros((2, POSED.size))])
    arms = np.repeat(columns, POSED.size, axis=1)
    return driven(arms, plan, start, dt=0.01 / finer).q


def pushed(hidden: Hidden, step: float = 2e-3, integrator: str = "RK4") -> tuple[np.ndarray, ...]:
    """Angles and measurements under the torques that our own arm was sent, and these."""
    sent = watch(nominal(), GAINS, POSED).command
    twin = Twin(hidden, step=step, integrator=integrator, threads=1)
    return *twin.run(lambda k, _: sent[:, :, k], POSED.start, 90)[:2], sent


def test_without_extras_it_is_our_arm_to_the_order_of_its_integrator():
    q, measured, sent = pushed(PLAIN)
    assert np.abs(q - ours(nominal().columns(), sent)).max() < 3e-6
    assert np.array_equal(q, measured)
    errors = [
        np.abs(pushed(PLAIN, step, "implicitfast")[0] - ours(nominal().columns(), sent)).max()
        for step in (2e-3, 1e-3)
    ]
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1)
    again = Twin(PLAIN, integrator="RK4").rollouts(GAINS, POSED)
    assert np.allclose(again.error, rollouts(nominal(), GAINS, POSED).error, atol=1e-5)
    assert np.array_equal(again.reason, judged(q, POSED).reason)


def test_back_emf_is_damping():
    body = nominal().columns()
    body[3:5] += [[0.12], [0.06]]
    q, _, sent = pushed(replace(PLAIN, emf=0.12))
    assert np.abs(q - ours(body, sent)).max() < 1e-5


@pytest.mark.parametrize("samples", [1, 3])
def test_a_late_command_is_the_motion_of_the_one_before(samples):
    plan = np.random.default_rng(2).uniform(-3.0, 3.0, (40, 2, 1)) * [[1.0], [0.5]]
    late = np.concatenate([np.zeros((samples, 2, 1)), plan])[:40]
    start = POSED.start[:, :1]
    q, _, _ = Twin(replace(PLAIN, delay=0.01 * samples)).run(lambda k, _: plan[k], start, 40)
    assert np.array_equal(q, Twin(PLAIN).run(lambda k, _: late[k], start, 40)[0])


def test_the_late_encoder_says_what_was_before():
    q, measured, sent = pushed(replace(PLAIN, sensing=0.004))
    fine = ours(nominal().columns(), sent, 5)
    assert np.abs(measured[:, :, 1:] - fine[:, :, 3::5][:, :, :90]).max() < 1e-5
    assert np.array_equal(measured[:, :, 0], q[:, :, 0])


def test_the_play_is_as_wide_as_it_says():
    twin = Twin(replace(PLAIN, backlash=0.02, armature=0.03))
    push = np.array([[1.0], [0.5]])
    q, rotor, _ = twin.run(lambda k, _: push * np.cos(0.4 * k), POSED.start, 60)
    difference = np.abs(q - rotor).max(axis=(1, 2))
    assert np.all((difference > 0.0099) & (difference < 0.0115))
    both = Twin(replace(PLAIN, backlash=0.02, armature=0.03, encoder="link"))
    q, observed, _ = both.run(lambda k, _: push * np.cos(0.4 * k), POSED.start, 60)
    assert np.array_equal(q, observed)


def test_with_the_encoder_behind_the_play_the_loop_cycles_in_proportion_to_it():
    """The play is the only length there is; with the encoder on the motor the loop rests."""
    start = POSED.start[:, :1]
    sizes: dict[str, list[float]] = {"link": [], "motor": []}
    gains = [Gains(kp, 0.0, kd, plants.FILTER) for kp, kd in ((50.0, 5.0), (20.0, 1.0))]

    def swing(hidden: Hidden) -> float:
        laws, goal = [Controller(g, 0.01) for g in gains], start[:, 0] + 0.3 * hidden.backlash

        def law(k: int, observed: np.ndarray) -> np.ndarray:
            rows = zip(laws, goal, observed[:, 0], strict=True)
            return np.array([[c.update(float(g), float(y))] for c, g, y in rows])

        q, _, _ = Twin(hidden, threads=1).run(law, start, 300)
        return float(np.ptp(q[1, 0, 200:])) / hidden.backlash

    for encoder, result in sizes.items():
        for gap in (0.004, 0.04):
            result.append(swing(replace(PLAIN, armature=0.03, backlash=gap, encoder=encoder)))
    assert sizes["link"][0] == pytest.approx(sizes["link"][1], rel=0.03)
    assert sizes["link"][0] > 0.5
    assert max(sizes["motor"]) < 1e-3


@pytest.mark.parametrize(("share", "moves"), [(0.95, False), (1.05, True)])
def test_the_bristles_hold_up_to_their_static_friction(share, moves):
    twin = Twin(replace(PLAIN, emf=0.12, coulomb=0.3, static=0.4, bristle=150.0))
    slow = share * np.array([[0.4], [0.2]])
    q, _, _ = twin.run(lambda k, _: slow * min(1.0, k / 100), POSED.start[:, :1], 200)
    assert (np.abs(q[0, 0] - q[0, 0, 0]).max() > 0.02) == moves


def test_logs_and_noise():
    twin = Twin(replace(PLAIN, noise=0.001))
    log = twin.log(np.zeros((400, 2)), [0.3, 1.0], seed=1)
    assert np.std(log.measured - [[0.3], [1.0]]) == pytest.approx(0.001, rel=0.1)
    assert log.dt == pytest.approx(0.01)
    assert log.command.shape == (2, 400)


def test_bad_input_is_named():
    with pytest.raises(ValueError, match=r"backlash must be .*, got -0\.1"):
        Hidden(backlash=-0.1)
    with pytest.raises(ValueError, match=r"encoder must be .*, got 'both'"):
        Hidden(encoder="both")
    with pytest.raises(ValueError, match=r"armature must be .*, got 0"):
        Hidden(armature=0.0)
    with pytest.raises(ValueError, match=r"step must be .*, got 0"):
        Twin(step=0.5)


# --- how late a command may come ------------------------------------------------------------------


def grows(q: np.ndarray) -> bool:
    """Whether what is left of a small step grows towards the end."""
    half = q.size // 2
    return bool(np.ptp(q[half + half // 2 :]) > np.ptp(q[half : half + half // 2]))


@pytest.mark.parametrize("seed", range(4))
def test_the_delay_at_which_joint_2_breaks_is_that_of_chapter_6s_margins(seed):
    """Joint 1 held. Our arm within 0.5 ms to both sides, MuJoCo's own delay within 3 ms."""
    rng = np.random.default_rng(seed)
    kp, kd = rng.uniform(10.0, 30.0), rng.uniform(0.8, 1.6)
    body = nominal().columns()
    inertia, damping = float(body[2, 0]), float(body[4, 0])
    gains = Gains(kp, 0.0, kd, plants.FILTER)
    limit = margins(*joint_system(inertia, damping), gains.law(0.01), 0.01).delay
    body[5] = 1e3
    start = np.array([[0.3], [1.2]])
    posed = Tasks(start, plants.tip(start + [[0.0], [1e-3]]))
    for late, broken in ((limit - 5e-4, False), (limit + 5e-4, True)):
        body[8] = late
        run = watch(body, (0.0, 0.0, 0.0, kp, 0.0, kd), posed)
        assert grows(run.q[1, 0]) == broken
    for steps, broken in ((int(1e3 * limit) - 2, False), (int(1e3 * limit) + 4, True)):
        drive = f'<motor {{}} delay="{(steps - 0.25) * 1e-3}" nsample="{steps + 1}"/>'
        joint, law = MotorJoint(inertia, damping, 0.01, actuator=drive), Controller(gains, 0.01)
        q = [0.0]
        for _ in range(120):
            q.append(joint.step(law.update(1e-3, q[-1])))
        assert grows(np.array(q)) == broken
