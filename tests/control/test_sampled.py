"""The loop as a matrix: against polynomials, SciPy, closed forms, a run of it, and MuJoCo."""

import math

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from course.charts.control.pid import LOOP, theoretical_growth
from course.compiled import MATRIX, loop
from course.control import Actuator, Encoder, Gains, Joint, run_joint, sampled
from course.control.sampled import (
    delay_limit,
    growth,
    held,
    joint_system,
    loop_matrix,
    margins,
    pd_limit,
    pid_law,
    stepped,
    ultimate_gain,
)
from course.control.touch import held_mass
from course.drills import ExactJoint
from course.measure import stability
from course.oracles.mujoco.joint import MotorJoint
from tests.budget import examples

JOINT = joint_system(0.5, 0.5)
_squared = loop(sampled.growth_by_squares, numba.float64(MATRIX))


def p_growth(gain, dt, delay, system=JOINT):
    A, B = system
    return growth(loop_matrix(held(A, B, dt, delay), pid_law(gain, dt=dt)))


# --- the hold -------------------------------------------------------------------------------------


@examples(40)
@given(
    inertia=st.floats(0.01, 10.0),
    damping=st.floats(0.0, 20.0),
    dt=st.floats(1e-3, 0.1),
    late=st.floats(0.0, 3.0),
)
def test_a_delay_of_any_length_is_the_exact_joint_switched_in_time(inertia, damping, dt, late):
    plant = held(*joint_system(inertia, damping), dt, late * dt)
    commands = np.random.default_rng(2).normal(size=12)
    x = np.zeros(2)
    whole, part = plant.whole, late - plant.whole
    q, v = 0.0, 0.0
    for k in range(commands.size):
        u = [commands[k - whole - i] if k - whole - i >= 0 else 0.0 for i in (0, 1)]
        x = plant.transition @ x + plant.now * u[0] + plant.before * u[1]
        for length, torque in ((part * dt, u[1]), ((1.0 - part) * dt, u[0])):
            if length > 1e-15:
                joint = ExactJoint(inertia, damping, length)
                joint.reset(q, v)
                joint.step(torque)
                q, v = joint.q, joint.v
    assert x == pytest.approx([q, v], rel=1e-9, abs=1e-9 * (1.0 + abs(q) + abs(v)))


def test_a_lag_and_a_spring_are_scipys_zero_order_hold():
    from scipy.signal import cont2discrete

    A, B = joint_system(0.4, 0.3, 20.0, 0.004)
    ad, bd, *_ = cont2discrete((A, B[:, None], np.eye(3), np.zeros((3, 1))), 0.01)
    plant = held(A, B, 0.01)
    assert plant.transition == pytest.approx(ad, rel=1e-11, abs=1e-13)
    assert plant.now == pytest.approx(bd[:, 0], rel=1e-11, abs=1e-13)
    assert not plant.before.any()


# --- the loop -------------------------------------------------------------------------------------


def characteristic(loop):
    """The closed loop's polynomial in z, from the transfer functions of joint and controller:
    1 + C G = 0 with C = kp + ki dt z / (z - 1) + kd (z - 1) / ((tau + dt) z - tau)."""
    joint = loop.joint()
    (_, reach), (_, decay) = joint.transition
    near, fast = joint.drive
    z, one = Polynomial([0.0, 1.0]), Polynomial([1.0])
    above = near * (z - decay) + reach * fast
    below = (z - 1.0) * (z - decay)
    sums = z - 1.0 if loop.ki > 0.0 else one
    low_pass = (loop.tau + loop.dt) * z - loop.tau
    control = loop.kp * sums * low_pass + loop.kd * (z - 1.0) * sums
    if loop.ki > 0.0:
        control += loop.ki * loop.dt * z * low_pass
    return below * sums * low_pass + above * control


@pytest.mark.parametrize("gain", [0.3, 1.0, 5.0, 22.0])
@pytest.mark.parametrize("ki", [0.0, 25.6])
def test_the_matrix_has_the_roots_of_the_transfer_functions(gain, ki):
    from dataclasses import replace

    loop = replace(LOOP.scaled(gain), ki=gain * ki)
    roots = np.abs(characteristic(loop).roots())
    assert theoretical_growth(loop) == pytest.approx(np.max(roots), rel=1e-9)


@pytest.mark.parametrize("rate", sampled.RATES)
@pytest.mark.parametrize("delay", [0.0, 0.0025, 0.0131])
def test_a_run_of_the_compiled_loop_is_the_power_of_the_matrix(rate, delay):
    gains = Gains(3.0, 2.0, 0.3, tau=0.01, rate=rate)
    law, lag = gains.law(0.005), 0.003
    plant = held(*joint_system(0.05, 0.1, lag=lag), 0.005, delay)
    matrix = loop_matrix(plant, law)
    joint, drive = Joint(0.05, 0.1), Actuator(lag=lag, delay=delay)
    start = (1.0, 0.0, 0.0)
    run = run_joint(joint, drive, Encoder(), gains, 0.0, 0.005, 0.4, start=start)
    state = np.zeros(len(matrix))
    state[0] = 1.0
    if rate != "exact":
        state[-1] = 1.0  # the controller's first measurement makes no rate
    for q, v in zip(run.q, run.v, strict=True):
        assert state[:2] == pytest.approx([q, v], abs=1e-12)
        state = matrix @ state


@pytest.mark.prove
@examples(40)
@given(
    stiffness=st.just(0.0) | st.floats(100.0, 1e6),
    damping=st.floats(0.5, 30.0),
    late=st.floats(0.0, 8.0),
    law=st.tuples(st.floats(0.0, 120.0), st.floats(0.0, 150.0), st.floats(0.0, 40.0)),
)
def test_what_compiled_code_has_instead_of_lapack_and_scipy(stiffness, damping, late, law):
    """The hold by closed form (which loses digits where damping or spring are next to none), growth
    by squares, the response by Gauss."""
    mass, dt = 0.5, 0.002
    plant = held(*joint_system(mass, damping, stiffness), dt, late * dt)
    rest = max(0.0, late - plant.whole) * dt
    closed = held_mass(mass, damping, stiffness, dt, rest)
    for one, other in zip(closed, (plant.transition, plant.now, plant.before), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-13)
    linear = pid_law(*law, dt=dt)
    F = loop_matrix(plant, linear)
    assert _squared(F) == pytest.approx(growth(F), rel=2e-9)
    w = np.array([0.3, 40.0, 0.9 * math.pi / dt])
    z = np.exp(1j * w * dt)[:, None, None]
    fed = plant.now * z[:, 0] ** -plant.whole + plant.before * z[:, 0] ** (-plant.whole - 1)
    x = np.linalg.solve(z * np.eye(2) - plant.transition, fed[:, :, None])
    c = np.linalg.solve(z * np.eye(linear.C.size) - linear.A, linear.B @ x)
    expected = -(linear.C @ c + linear.D @ x)[:, 0]
    # Numbers below 1e-307 have fewer digits.
    response = sampled.open_loop(plant, linear, w)
    np.testing.assert_allclose(response, expected, rtol=1e-8, atol=1e-300)


def test_the_growth_of_nothing_of_a_turn_and_of_what_comes_in_threes():
    assert sampled.growth_by_squares(np.array([[0.0, 1.0], [0.0, 0.0]])) == 0.0
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    assert sampled.growth_by_squares(1.5 * turn) == pytest.approx(1.5, rel=1e-12)
    chain = np.roll(np.eye(3), 1, axis=0)
    assert sampled.growth_by_squares(chain) == pytest.approx(1.0, rel=1e-12)
    assert sampled.growth_by_squares(np.array([[1.0, 1.0], [0.0, 1.0]])) == pytest.approx(1.0)


def test_margins_are_where_the_matrix_stops_decaying():
    law = pid_law(6.4, 25.6, 0.7, dt=0.005, tau=0.01)
    system = joint_system(0.05, 0.1)
    result = margins(*system, law, 0.005)

    def grown(factor=1.0, delay=0.0):
        scaled = pid_law(6.4 * factor, 25.6 * factor, 0.7 * factor, dt=0.005, tau=0.01)
        return growth(loop_matrix(held(*system, 0.005, delay), scaled))

    for limit, low, high in (("gain", 0.999, 1.001), ("lower", 1.001, 0.999)):
        edge = getattr(result, limit)
        assert grown(low * edge) < 1.0 < grown(high * edge)
    assert grown(delay=0.999 * result.delay) < 1.0 < grown(delay=1.001 * result.delay)
    # a lag at the crossing is a delay, but for what the hold does to a part of a sample
    assert 0.5 < result.phase < math.pi / 2


def test_phase_and_gain_margin_are_scipys_frequency_response():
    from scipy.signal import freqz

    dt, kp, kd = 0.002, 4.0, 0.5
    law = pid_law(kp, 0.0, kd, dt=dt, rate="exact")
    joint = ExactJoint(0.5, 0.5, dt)
    (_, reach), (_, decay) = joint.transition
    near, fast = joint.drive
    above = [0.0, kp * near + kd * fast, kp * (reach * fast - near * decay) - kd * fast]
    result = margins(*JOINT, law, dt)
    w, value = freqz(above, [1.0, -1.0 - decay, decay], np.linspace(1e-5, math.pi, 100_001))
    at = np.argmin(np.abs(np.abs(value) - 1.0))
    assert result.phase == pytest.approx(math.pi + np.angle(value[at]), abs=2e-2)
    assert result.delay == pytest.approx(result.phase / (w[at] / dt), rel=0.01)
    assert result.gain == pytest.approx(1.0 / abs(value[-1]), rel=1e-9)  # it goes at half the rate


def test_an_unstable_loop_has_no_margins_and_a_slack_one_any():
    assert margins(*JOINT, pid_law(2000.0, dt=0.001), 0.001) == sampled.Margins(0, 0, 0, 0)
    spring = joint_system(1.0, 5.0, 100.0)
    assert margins(*spring, pid_law(0.01, dt=0.01), 0.01).delay == math.inf


# --- limits with a closed form --------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0.0, 0.0005, 0.001, 0.0037, 0.02, 0.1])
def test_a_hold_is_half_a_sample_of_delay(delay):
    dt = 0.001
    gain, period = ultimate_gain(*JOINT, dt, delay)
    assert p_growth(0.9999 * gain, dt, delay) < 1.0 < p_growth(1.0001 * gain, dt, delay)
    theory = delay_limit(0.5, 0.5, delay + 0.5 * dt)
    assert (gain, period) == pytest.approx(theory, rel=1e-4)
    # and in the loop that runs, delay and all
    for factor in (0.97, 1.03):
        n = round(60 * period / dt)
        run = run_joint(
            Joint(0.5, 0.5),
            Actuator(delay=delay),
            Encoder(),
            Gains(factor * gain),
            0.0,
            dt,
            n * dt,
            start=(1e-3, 0.0, 0.0),
        )
        first, last = (np.max(np.abs(part)) for part in (run.q[: n // 20], run.q[-(n // 20) :]))
        rate = np.log(last / first) / (0.95 * n)
        assert rate == pytest.approx(np.log(p_growth(factor * gain, dt, delay)), rel=0.2)


def test_no_gain_holds_a_joint_without_friction():
    with pytest.raises(ValueError, match="that P holds up to some gain"):
        ultimate_gain(*joint_system(0.5), 0.001)
    with pytest.raises(ValueError, match=r"A.shape must be .*, got \(1, 1\)"):
        ultimate_gain([[-1.0]], [1.0], 0.001)  # of first order: it has no q and v
    assert p_growth(1.0, 0.001, 0.0, joint_system(0.5)) > 1.0


TIPS = {"exact": 4.0, "difference": 4.0 * (math.sqrt(2.0) - 1.0) ** 2, "late": 0.25}


@pytest.mark.parametrize("kind", TIPS)
def test_the_triangles_of_pd(kind):
    inertia, dt = 0.3, 0.004
    unit, delay = inertia / dt**2, dt if kind == "late" else 0.0
    rate = "filtered" if kind == "difference" else "exact"
    plant = held(*joint_system(inertia), dt, delay)

    def grown(kp, kd):
        return growth(loop_matrix(plant, pid_law(kp, 0.0, kd, dt=dt, rate=rate)))

    best = 0.0
    for c in np.random.default_rng(4).uniform(0.01, 1.99, 100):
        kd = c * unit * dt
        limit = pd_limit(kd, inertia, dt, kind)
        best = max(best, limit / unit)
        if limit > 0.0:
            assert grown(limit * (1.0 - 1e-7), kd) <= 1.0 + 1e-10
            assert grown(limit * (1.0 + 1e-6), kd) > 1.0
        assert grown(limit + 0.01 * unit, kd) > 1.0
    assert 0.95 * TIPS[kind] < best <= TIPS[kind]
    top = {"exact": 2.0, "difference": 2.0 * (math.sqrt(2.0) - 1.0), "late": 0.625}[kind]
    at = pd_limit((top - 1e-9) * unit * dt, inertia, dt, kind) / unit
    assert at == pytest.approx(TIPS[kind], abs=1e-8)
    assert pd_limit(2.1 * unit * dt, inertia, dt, kind) == 0.0 or kind == "exact"


# --- what a simulator's steps make of it ----------------------------------------------------------


@pytest.mark.parametrize(("steps", "expected"), [(10, 1111.0), (1, 2_000_000.0)])
def test_a_simulator_has_a_shorter_hold(steps, expected):
    dt = 0.001
    limit = stability.limit(
        lambda k: (
            growth(loop_matrix(stepped(0.5, 0.5, dt, steps), pid_law(k, dt=dt))) <= 1.0 + 1e-12
        ),
        1.0,
        1e8,
        1e-9,
    )
    assert limit == pytest.approx(expected, rel=1e-3)
    if steps > 1:  # the hold is (dt - h) / 2
        theory = delay_limit(0.5, 0.5, 0.5 * (dt - dt / steps))[0]
        assert limit == pytest.approx(theory, rel=1e-3)
    assert ultimate_gain(*JOINT, dt)[0] == pytest.approx(1000.0, rel=1e-3)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
@pytest.mark.parametrize("steps", [1, 7])
def test_mujocos_loop_is_that_matrix(integrator, steps):
    dt, kp, kd = 0.004, 30.0, 0.5
    joint = MotorJoint(0.05, 0.1, dt, substeps=steps, integrator=integrator)

    def step(state):
        joint.reset(state[0], state[1])
        joint.step(-kp * state[0] - kd * state[1])
        return np.array([joint.q, joint.v])

    theory = loop_matrix(stepped(0.05, 0.1, dt, steps), pid_law(kp, 0, kd, dt=dt, rate="exact"))
    assert stability.amplification(step, 2) == pytest.approx(theory, rel=1e-9, abs=1e-12)


# --- bad input ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: joint_system(0.0), "inertia"),
        (lambda: joint_system(1.0, -1.0), "damping"),
        (lambda: joint_system(1.0, lag=math.nan), "lag"),
        (lambda: held(*JOINT, 0.0), "dt"),
        (lambda: held(*JOINT, 0.01, -0.001), "delay"),
        (lambda: held(np.eye(2), np.ones(3), 0.01), "B.shape"),
        (lambda: pid_law(1.0, dt=0.01, rate="best"), "rate"),
        (lambda: pid_law(1.0, dt=0.01, tau=-1.0), "tau"),
        (lambda: pid_law(1.0, dt=-0.01), "dt"),
        (lambda: pid_law(math.nan, dt=0.01), "kp"),
        (lambda: held(np.ones((2, 3)), np.ones(2), 0.01), "A.shape"),
        (lambda: stepped(1.0, math.nan, 0.01, 1), "damping"),
        (lambda: sampled.passive_stiffness(1.0, 0.01, -1.0), "delay"),
        (lambda: delay_limit(1.0, 0.0, 0.1), "damping"),
        (lambda: pd_limit(-1.0, 1.0, 0.01), "kd"),
        (lambda: stepped(1.0, 0.0, 0.01, 0), "steps"),
        (lambda: sampled.force_limit(1.0, 0.0, 0.01), "wall"),
        (
            lambda: margins(*JOINT, pid_law(1.0, dt=1e-3), 1e-2),
            r"dt of the law must be .*, got 0.001",
        ),
        (lambda: loop_matrix(held(*JOINT, 1e-2), pid_law(1.0, dt=1e-3)), "dt of the law"),
    ],
)
def test_wrong_numbers_are_refused(call, word):
    with pytest.raises(ValueError, match=word):
        call()
