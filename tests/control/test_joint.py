"""The joint with real parts and its controller: against the drill, SciPy, closed forms, MuJoCo."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from course.control import (
    PID,
    Actuator,
    Controller,
    Encoder,
    Gains,
    Joint,
    closed_loop,
    run_joint,
    step_metrics,
)
from course.control.pid import rates
from course.control.sampled import observer_gains, split_delay
from course.drills import ExactJoint
from course.oracles.mujoco.joint import MotorJoint
from tests.budget import examples

INF = math.inf
NO_GAINS = Gains(0.0)


def pushed(joint, actuator=None, extra=0.0, seconds=1.0, dt=0.01, **more):
    """A run without a controller: only what pushes from outside."""
    return run_joint(
        joint, actuator or Actuator(), Encoder(), NO_GAINS, 0.0, dt, seconds, extra=extra, **more
    )


# --- the controller -------------------------------------------------------------------------------


@examples(30)
@given(
    kp=st.floats(0, 50),
    ki=st.floats(0, 50),
    kd=st.floats(0, 5),
    tau=st.floats(0, 0.1),
    top=st.floats(0.1, 20),
    seed=st.integers(0, 1000),
)
def test_the_compiled_update_gives_the_drills_commands_bit_for_bit(kp, ki, kd, tau, top, seed):
    rng = np.random.default_rng(seed)
    theirs = PID(kp, ki, kd, 0.01, -top, 0.7 * top, tau)
    ours = Controller(Gains(kp, ki, kd, tau, -top, 0.7 * top), 0.01)
    for w, y in rng.normal(size=(60, 2)).tolist():
        assert ours.update(w, y) == theirs.update(w, y)
    assert ours.state[:2].tolist() == [theirs.integral, theirs.rate]
    ours.reset()
    theirs.reset()
    assert ours.update(1.0, 0.3) == theirs.update(1.0, 0.3)


def test_the_compiled_loop_is_the_drills_loop():
    jam = np.arange(1600) < 400
    q, u = closed_loop(
        PID(6.4, 25.6, 0.7, 0.005, -2.0, 2.0, 0.01),
        ExactJoint(0.05, 0.1, 0.005, 0.3),
        np.full(1600, 0.25),
        jam,
    )
    gains = Gains(6.4, 25.6, 0.7, 0.01, -2.0, 2.0)
    run = run_joint(
        Joint(0.05, 0.1, 0.3), Actuator(), Encoder(), gains, 0.25, 0.005, 8.0, blocked=jam
    )
    assert run.q == pytest.approx(q, abs=1e-13)
    assert run.command == pytest.approx(u, abs=1e-12)


def test_set_point_weights_take_the_kick_and_soften_the_step():
    def first(**weights):
        controller = Controller(Gains(2.0, 0.0, 0.5, 0.01, **weights), 0.01)
        controller.update(0.0, 0.0)
        return controller.update(1.0, 0.0)

    assert first() == 2.0
    assert first(weight=0.3) == pytest.approx(0.6)
    assert first(rate_weight=1.0) == pytest.approx(2.0 + 0.5 / 0.02)


def test_new_gains_and_the_change_to_automatic_make_no_bump():
    controller = Controller(Gains(2.0, 3.0, 0.5, 0.02), 0.01)
    for y in np.linspace(0.0, 0.4, 20):
        before = controller.update(1.0, y)
    controller.change(Gains(9.0, 3.0, 0.1, 0.02), 1.0, 0.4)
    # the rate decays by a step of its filter, the integral goes on; there is no other change
    rate = controller.state[1]
    expected = before + 3.0 * 0.6 * 0.01 - 0.1 * (rate * 0.02 / 0.03 - rate)
    assert controller.update(1.0, 0.4) == pytest.approx(expected, abs=1e-12)
    fresh = Controller(Gains(2.0, 3.0, 0.5), 0.01)
    fresh.take_over(0.77, 1.0, 0.4)
    assert fresh.update(1.0, 0.4) == pytest.approx(0.77, abs=1e-12)


def test_the_commands_rate_is_limited_and_windup_knows_it():
    controller = Controller(Gains(100.0, 50.0, slew=20.0, u_max=3.0), 0.01)
    sent = [controller.update(1.0, 0.0) for _ in range(40)]
    assert np.max(np.abs(np.diff([0.0, *sent]))) <= 0.2 + 1e-12
    assert sent[-1] == 3.0 and controller.state[0] == 0.0


@pytest.mark.parametrize("windup", ["conditional", "back-calculation", "none"])
def test_what_a_jam_leaves_in_the_integral(windup):
    gains = Gains(4.0, 6.0, 0.5, 0.01, -2.0, 2.0, windup=windup)
    jam = np.arange(5000) < 1500
    run = run_joint(
        Joint(0.05, 0.2, -0.3), Actuator(), Encoder(), gains, 1.0, 0.002, 10.0, blocked=jam
    )
    past = np.max(run.q) - 1.0
    assert past > 3.0 if windup == "none" else past < 0.1


# --- three estimates of the rate ------------------------------------------------------------------


@pytest.mark.parametrize(("rate", "tau"), [("filtered", 0), ("filtered", 0.02), ("observer", 0.02)])
def test_lag_and_noise_of_a_rate_are_what_theory_says(rate, tau):
    dt, n = 0.001, 100_000
    t = dt * np.arange(4000)
    # under a constant acceleration the estimate is behind by its lag
    lag = t[-1] - rates(0.5 * t**2, dt, rate, tau)[-1]
    alpha, beta = observer_gains(tau, dt)
    if rate == "filtered":
        theory, gain = tau + 0.5 * dt, math.sqrt(2.0 / ((tau + dt) * (2.0 * tau + dt)))
    else:  # Benedict and Bordner, 1962
        theory = dt * (2.0 * alpha - beta) / (2.0 * beta)
        gain = math.sqrt(2.0 * beta**2 / (alpha * (4.0 - 2.0 * alpha - beta))) / dt
    assert lag == pytest.approx(theory, rel=1e-6)
    noise = np.random.default_rng(1).normal(size=n)
    assert np.std(rates(noise, dt, rate, tau)[1000:]) == pytest.approx(gain, rel=0.03)


# --- the parts ------------------------------------------------------------------------------------


def test_lag_delay_limits_and_encoder_are_a_tight_integration():
    joint, drive = Joint(0.05, 0.1, 0.3), Actuator(2.0, 50.0, 0.002, 0.0123)
    dt, gains = 0.005, Gains(6.4, 25.6, 0.7, 0.01)
    run = run_joint(joint, drive, Encoder(12), gains, 0.25, dt, 0.4)
    whole, part = split_delay(drive.delay, dt)
    assert (whole, part) == (2, pytest.approx(0.0023))
    x = np.zeros(3)
    for k in range(run.command.size):
        for length, at in ((part, k - whole - 1), (dt - part, k - whole)):
            u = run.command[at] if at >= 0 else 0.0
            x = solve_ivp(
                lambda _, x, u=u: [x[1], (x[2] + 0.3 - 0.1 * x[1]) / 0.05, (u - x[2]) / 0.002],
                (0.0, length),
                x,
                rtol=1e-10,
                atol=1e-12,
            ).y[:, -1]
        assert [run.q[k + 1], run.v[k + 1], run.torque[k + 1]] == pytest.approx(x, abs=1e-8)
    assert np.max(np.abs(run.command)) <= 2.0
    assert np.max(np.abs(np.diff(run.command))) <= 50.0 * dt + 1e-12
    line = 2.0 * math.pi / 4096
    assert run.measured / line == pytest.approx(np.round(run.measured / line), abs=1e-9)
    assert np.max(np.abs(run.measured - run.q[:-1])) <= 0.5 * line + 1e-12


def test_it_slides_to_a_stop_at_the_instant_of_theory():
    inertia, dry, v = 0.2, 0.3, 1.7
    run = pushed(Joint(inertia, coulomb=dry), start=(0.0, v, 0.0), seconds=3.0, dt=0.1)
    assert run.q[-1] == pytest.approx(0.5 * inertia * v**2 / dry, rel=1e-12)
    assert run.v[-1] == 0.0 and run.q[-1] == run.q[-2]


@examples(40)
@given(
    torque=st.floats(-2, 2),
    coulomb=st.floats(0.0, 1.0),
    more=st.floats(1e-6, 1.0),
    damping=st.floats(0, 1),
)
def test_it_rests_below_the_static_friction_and_leaves_above(torque, coulomb, more, damping):
    run = pushed(Joint(0.2, damping, 0.0, coulomb, coulomb + more), extra=torque, seconds=0.5)
    if abs(torque) <= coulomb + more:
        assert np.all(run.q == 0.0) and np.all(run.v == 0.0)
    else:
        assert run.q[-1] * torque > 0.0


def test_the_current_loop_breaks_it_away_at_the_instant_of_theory():
    # torque 1 (1 - e^(-t / lag)) passes the static 0.6 at lag ln 2.5; then it slides against 0.2
    lag, inertia = 0.05, 0.3
    run = run_joint(
        Joint(inertia, coulomb=0.2, static=0.6),
        Actuator(lag=lag),
        Encoder(1),
        Gains(1.0),
        1.0,
        0.01,
        0.3,
    )
    away = lag * math.log(2.5)
    t = run.times
    later = np.maximum(t - away, 0.0)
    speed = (0.8 * later - 0.4 * lag * (1.0 - np.exp(-later / lag))) / inertia
    assert run.v == pytest.approx(speed, abs=1e-13)


@pytest.mark.parametrize("lag", [0.0, 0.02])
def test_dry_friction_is_what_small_steps_converge_to(lag):
    inertia, damping, coulomb, static = 0.05, 0.1, 0.15, 0.2
    joint, dt = Joint(inertia, damping, 0.0, coulomb, static), 0.02
    push = np.random.default_rng(8).uniform(-0.6, 0.6, 40)
    gains = Gains(3.0, 8.0, 0.2, 0.01)
    run = run_joint(joint, Actuator(lag=lag), Encoder(), gains, 0.2, dt, 0.8, extra=push)
    assert np.sum(run.v == 0.0) > 2 and np.sum(run.v != 0.0) > 20  # it sticks and it slips

    def stepping(steps):
        h, q, v, u, worst = dt / steps, 0.0, 0.0, 0.0, 0.0
        for k, (command, load) in enumerate(zip(run.command.tolist(), push.tolist(), strict=True)):
            for _ in range(steps):
                u = command + (u - command) * math.exp(-h / lag) if lag else command
                force = u + load
                if v == 0.0:
                    sliding = 0.0 if abs(force) <= static else force - math.copysign(coulomb, force)
                    v = h * sliding / inertia
                else:
                    new = v + h * (force - damping * v - math.copysign(coulomb, v)) / inertia
                    v = 0.0 if new * v < 0.0 else new
                q += h * v
            worst = max(worst, abs(q - run.q[k + 1]))
        return worst

    coarse, fine = stepping(200), stepping(2000)
    assert fine < 3e-4 and fine < 0.25 * coarse


def test_mujocos_friction_loss_agrees_where_it_slides():
    ours = pushed(Joint(0.05, 0.1, 0.7, 0.2), seconds=0.5, dt=0.005)
    theirs = MotorJoint(0.05, 0.1, 0.005, 0.7, substeps=50, friction=0.2)
    q = [0.0] + [theirs.step(0.0) for _ in range(100)]
    assert q == pytest.approx(ours.q, abs=2e-3 * np.max(ours.q))


def test_a_rest_error_within_the_friction_stays_and_an_integral_hunts_above_coulomb():
    # P alone may rest anywhere within static / kp
    deviation = 0.9 * 0.3 / 10.0
    stays = run_joint(
        Joint(0.1, 0.0, 0.0, 0.3), Actuator(), Encoder(), Gains(10.0), deviation, 0.001, 1.0
    )
    assert np.all(stays.q == 0.0)
    leaves = run_joint(
        Joint(0.1, 0.0, 0.0, 0.3), Actuator(), Encoder(), Gains(10.0), deviation / 0.8, 0.001, 1.0
    )
    assert leaves.q[-1] > 0.0

    def swing(static):
        joint = Joint(0.05, 0.05, 0.0, 0.1, static)
        run = run_joint(
            joint, Actuator(), Encoder(), Gains(6.4, 25.6, 0.7, 0.005), 0.5, 0.001, 40.0
        )
        return np.ptp(run.q[-15_000:])

    assert swing(0.2) > 5e-3
    assert swing(0.1) < 1e-3


# --- what a step shows ----------------------------------------------------------------------------


@pytest.mark.parametrize("zeta", [0.2, 0.5, 0.8])
def test_the_overshoot_of_a_second_order_step_is_textbooks(zeta):
    kp, inertia = 20.0, 0.5
    kd = 2.0 * zeta * math.sqrt(kp * inertia)
    run = run_joint(
        Joint(inertia), Actuator(), Encoder(), Gains(kp, 0.0, kd, rate="exact"), 1.0, 1e-4, 8.0
    )
    result = step_metrics(run.times, run.q, 1.0)
    assert result.overshoot == pytest.approx(
        math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2)), abs=2e-3
    )
    assert abs(result.error) < 1e-3
    t = run.times[run.times > result.settling]
    assert np.all(np.abs(run.q[-t.size :] - 1.0) <= 0.02)


def test_not_settled_is_an_answer():
    run = run_joint(Joint(0.5), Actuator(), Encoder(), Gains(20.0), 1.0, 1e-3, 3.0)
    assert step_metrics(run.times, run.q, 1.0).settling == INF
    late = np.append(np.zeros(95), np.ones(5))  # there, but only just
    assert step_metrics(np.arange(100.0), late, 1.0).settling == INF
    early = np.append(np.zeros(5), np.ones(95))
    assert step_metrics(np.arange(100.0), early, 1.0).settling == 5.0


# --- bad input ------------------------------------------------------------------------------------

PARTS = (Joint(1.0), Actuator(), Encoder(), Gains(1.0))


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: Joint(-1.0), "inertia"),
        (lambda: Joint(1.0, math.nan), "damping"),
        (lambda: Joint(1.0, coulomb=0.3, static=0.2), "static"),
        (lambda: Actuator(limit=0.0), "limit"),
        (lambda: Actuator(rate=math.nan), "rate"),
        (lambda: Actuator(delay=-1.0), "delay"),
        (lambda: Encoder(bits=-1), "bits"),
        (lambda: Encoder(noise=INF), "noise"),
        (lambda: Gains(math.nan), "kp"),
        (lambda: Gains(1.0, u_min=1.0, u_max=1.0), "u_min"),
        (lambda: Gains(1.0, weight=1.5), "weight"),
        (lambda: Gains(1.0, slew=0.0), "slew"),
        (lambda: Gains(1.0, rate="best"), "rate"),
        (lambda: Gains(1.0, windup="clamp"), "windup"),
        (lambda: Controller(Gains(1.0), 0.0), "dt"),
        (lambda: Controller(Gains(1.0), 0.01).update(math.nan, 0.0), "setpoint"),
        (lambda: run_joint(*PARTS, 1.0, -0.01, 1.0), "dt"),
        (lambda: run_joint(*PARTS, np.ones(99), 0.01, 1.0), "setpoint.shape"),
        (lambda: run_joint(*PARTS, np.ones(101), 0.01, 1.0), "setpoint.shape"),
        (lambda: run_joint(*PARTS, INF, 0.01, 1.0), "setpoint"),
        (lambda: run_joint(*PARTS, 1.0, 0.01, 1.0, start=(0.0, 0.0)), "start.shape"),
        (lambda: step_metrics([0.0, 1.0], [0.0, 1.0, 2.0], 1.0), "q.shape"),
        (lambda: step_metrics([0.0, 1.0], [1.0, 1.0], 1.0), "target"),
        (lambda: step_metrics([], [], 1.0), "at least one sample"),
        (
            lambda: step_metrics([0.0, 0.2, 0.1], [0.0, 0.5, 1.0], 1.0),
            r"times\[2\] must be .*, got 0.1",
        ),
        (lambda: rates([0.0], 0.01, "exact"), "rate"),
    ],
)
def test_wrong_numbers_are_refused(call, word):
    with pytest.raises(ValueError, match=word):
        call()


def test_a_loop_that_diverges_says_so() -> None:
    """A gain far beyond the ultimate one: the angles pass the largest float."""
    joint = Joint(1.0, 0.1)
    calm = run_joint(joint, Actuator(), Encoder(), Gains(10.0, 0.0, 5.0), 0.5, 0.01, 1.0)
    wild = run_joint(joint, Actuator(), Encoder(), Gains(1e9, 0.0, 0.0), 0.5, 0.01, 2.0)
    assert wild.diverged and not calm.diverged
