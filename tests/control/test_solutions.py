"""The worked answers of chapter 6 against closed forms, SciPy, Pinocchio, MuJoCo and their laws."""

import math
import warnings

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov
from scipy.special import expit, softmax

from course import control, kinematics
from course.control.sampled import delay_limit
from course.oracles.mujoco import chain as mujoco_chain
from course.oracles.pinocchio import Arm
from drills import cards
from solutions import control as solutions
from tests.budget import examples


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


# --- the ultimate gain ----------------------------------------------------------------------------


@examples(20)
@given(numbers(-2.6, 0.8), numbers(0.0, 12.0), numbers(-3.0, -1.0), numbers(-1.5, 1.0))
def test_gain_and_period_are_those_of_the_open_loop(friction, late, power, heavy):
    """The chapter's function looks at the frequency response, the answer at eigenvalues."""
    dt, inertia = 10.0**power, 10.0**heavy
    damping, delay = 10.0**friction * inertia / dt, late * dt
    result = solutions.ultimate_gain(inertia, damping, dt, delay)
    A, B = control.joint_system(inertia, damping)
    np.testing.assert_allclose(result, control.ultimate_gain(A, B, dt, delay), rtol=1e-9)


def test_the_rule_of_half_a_sample_is_near_where_friction_is_small_and_not_elsewhere():
    def deviation(friction, late):
        result = solutions.ultimate_gain(1.0, friction / 0.01, 0.01, late * 0.01)
        return np.abs(np.array(result) / delay_limit(1.0, friction / 0.01, (late + 0.5) * 0.01) - 1)

    assert max(deviation(0.01, late).max() for late in (0.0, 1.0, 5.0)) < 2e-3
    assert deviation(5.0, 0.0).max() > 0.1


@pytest.mark.parametrize("late", [0.0, 0.3, 1.0, 2.7])
def test_a_run_falls_below_the_gain_and_grows_above(late):
    """The joint in parts of a sample, each exact; no matrix of the loop."""
    inertia, damping, dt, parts = 0.3, 1.2, 0.01, 10
    gain, period = solutions.ultimate_gain(inertia, damping, dt, late * dt)
    h, wait, samples = dt / parts, round(late * parts), 3000
    lost = -math.expm1(-damping / inertia * h)

    def run(gain):
        torque, q, v, path = np.zeros((samples + 5) * parts), 1.0, 0.0, []
        for i in range(samples * parts):
            if i % parts == 0:
                path.append(q)
                torque[i + wait : i + wait + parts] = -gain * q
            steady = torque[i] / damping
            q, v = q + steady * h + (v - steady) * lost * inertia / damping, v + (steady - v) * lost
        return np.array(path)

    sizes = [np.abs(run(factor * gain)[-500:]).max() for factor in (0.95, 1.05)]
    assert sizes[0] < 0.2 and sizes[1] > 5.0
    path = run(gain)[-2000:]
    up = np.flatnonzero((path[:-1] < 0.0) & (path[1:] >= 0.0))
    times = up - path[up] / (path[up + 1] - path[up])
    assert np.mean(np.diff(times)) * dt == pytest.approx(period, rel=2e-3)


# --- computed torque ------------------------------------------------------------------------------


@examples(20)
@given(rngs(), st.sampled_from([0.0, 9.81]))
def test_errors_obey_their_equation_in_pinocchio_and_in_mujoco(rng, gravity):
    lengths, masses = rng.uniform(0.1, 1.0, 2), rng.uniform(0.2, 3.0, 2)
    q, v, reference = rng.uniform(-4, 4, 2), 3.0 * rng.normal(size=2), rng.normal(size=(3, 2))
    kp, kd = rng.uniform(10.0, 100.0, 2), rng.uniform(2.0, 20.0, 2)
    tau = solutions.computed_torque(lengths, masses, gravity, q, v, reference, kp, kd)
    expected = reference[2] + kd * (reference[1] - v) + kp * (reference[0] - q)
    arm, down = kinematics.planar(lengths, masses), (0.0, -gravity, 0.0)
    truth = Arm(arm, down).inverse_dynamics(q, v, expected)
    np.testing.assert_allclose(tau, truth, rtol=0, atol=1e-12 * (1.0 + np.abs(truth).max()))
    model = mujoco_chain.model(arm, down)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, v, tau
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(
        data.qacc, expected, rtol=0, atol=1e-9 * (1 + np.abs(expected).max())
    )


# --- LQR ------------------------------------------------------------------------------------------


def weights(rng, n):
    root = rng.normal(size=(n, n))
    return root @ root.T + 0.1 * np.eye(n)


@examples(60)
@given(rngs(), st.integers(1, 6), st.integers(1, 3))
def test_the_gain_is_scipys(rng, n, m):
    A, B, Q, R = rng.normal(size=(n, n)), rng.normal(size=(n, m)), weights(rng, n), weights(rng, m)
    result, P = solutions.lqr(A, B, Q, R), solve_discrete_are(A, B, Q, R)
    truth = np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    # A plant that is hardly controllable has an all but singular cost: with a condition of 1.5e7,
    # ours is 1.4e-7 off a solution with 60 digits, and SciPy's 6e-10.
    within = 1e-9 + 1e-13 * np.linalg.cond(P)
    np.testing.assert_allclose(result, truth, rtol=0, atol=within * np.abs(truth).max())


@examples(40)
@given(rngs(), st.integers(1, 5), st.integers(1, 3))
def test_no_other_gain_costs_less(rng, n, m):
    """The cost of a gain is a Lyapunov equation: no Riccati equation in it."""
    turn, _ = np.linalg.qr(rng.normal(size=(n, n)))
    A, B, Q, R = 1.1 * turn, rng.normal(size=(n, m)), weights(rng, n), weights(rng, m)
    result = solutions.lqr(A, B, Q, R)

    def cost(K):
        return np.trace(solve_discrete_lyapunov((A - B @ K).T, Q + K.T @ R @ K))

    change = rng.normal(size=result.shape)
    change *= 1e-4 * np.abs(result).max() / np.abs(change).max()
    least, around = cost(result), (cost(result + change) + cost(result - change)) / 2.0
    assert around > least
    # Stationary: what is left of first order is beside the second.
    assert abs(cost(result + change) - cost(result - change)) < 0.1 * (around - least)


def test_closed_forms_of_the_gain_also_where_the_loop_is_slow():
    one = np.ones((1, 1))
    for a, b, q, r in ((1.0, 1.0, 1.0, 1.0), (1.0, 1e-2, 1e-4, 1.0), (0.9999, 1.0, 1e-9, 1.0)):
        # b^2 P^2 + (r (1 - a^2) - q b^2) P - q r = 0.
        half = 0.5 * (r * (1.0 - a * a) - q * b * b)
        root = math.sqrt(half * half + q * r * b * b)
        P = q * r / (half + root) if half > 0 else (root - half) / (b * b)
        result = solutions.lqr(a * one, b * one, q * one, r * one)
        assert result[0, 0] == pytest.approx(a * b * P / (r + b * b * P), rel=1e-9)


# --- hybrid control -------------------------------------------------------------------------------


def surface(rng):
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return frame * np.linalg.det(frame)


@examples(60)
@given(rngs(), st.integers(1, 8))
def test_hybrid_torques_by_the_projector_on_the_normal(rng, n):
    """The same law in vectors of the world, without a frame: along n n' and across it."""
    J, frame, (error, velocity, force, expected) = (
        rng.normal(size=(3, n)),
        surface(rng),
        rng.normal(size=(4, 3)),
    )
    stiffness, damping, gain = rng.uniform(0.5, 3.0, 3)
    normal = frame[:, 1]
    along = np.outer(normal, normal)
    press = normal * expected[1]
    tip = along @ (press + gain * (press - force)) + (np.eye(3) - along) @ (stiffness * error)
    tip = tip - damping * velocity
    result = solutions.hybrid_torque(
        J, frame, np.array([0, 1, 0]), error, velocity, force, expected, [stiffness, damping, gain]
    )
    rates = rng.normal(size=n)
    assert result @ rates == pytest.approx(tip @ (J @ rates), abs=1e-11 * (1 + n))
    np.testing.assert_allclose(result, J.T @ tip, rtol=0, atol=1e-12 * (1.0 + n))


@examples(40)
@given(rngs())
def test_a_world_that_is_turned_leaves_the_torques_as_they_are(rng):
    J, frame, turn = rng.normal(size=(3, 6)), surface(rng), surface(rng)
    error, velocity, force, expected = rng.normal(size=(4, 3))
    forced, gains = rng.integers(0, 2, 3), rng.uniform(0.5, 3.0, 3)
    here, other = (
        solutions.hybrid_torque(
            R @ J, R @ frame, forced, R @ error, R @ velocity, R @ force, expected, gains
        )
        for R in (np.eye(3), turn)
    )
    np.testing.assert_allclose(here, other, rtol=0, atol=1e-12)


# --- identification -------------------------------------------------------------------------------


@examples(6)
@given(rngs(), numbers(0.0, 1e-4))
def test_the_inertia_comes_out_of_a_log_of_mujoco(rng, noise):
    """The joint is MuJoCo's, with its own friction and gravity, in steps of a fiftieth sample."""
    inertia, friction, weight = rng.uniform([0.1, 0.0, 0.0], [1.0, 2.0, 6.0])
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{2e-3 / 10}" integrator="RK4" gravity="0 -10 0"/><worldbody>'
        f'<body><joint axis="0 0 1" damping="{friction}"/><inertial pos="{weight / 10} 0 0" '
        f'mass="1" diaginertia="9 9 {inertia}"/></body></worldbody></mujoco>'
    )
    data, dt, count = mujoco.MjData(model), 2e-3, 1200
    truth = inertia + (weight / 10) ** 2
    t = dt * np.arange(count)
    tau = truth * (12.0 * np.sin(2.5 * t + 1.0) + 12.0 * np.sin(6.0 * t) + 9.0 * np.sin(13.0 * t))
    tau = tau + 0.7 * weight
    data.qpos[0], data.qvel[0] = rng.uniform([-0.8, -2.0], [0.8, 2.0])
    q = np.zeros(count)
    for i in range(count):
        q[i], data.qfrc_applied[0] = data.qpos[0], tau[i]
        mujoco.mj_step(model, data, 10)
    result = solutions.inertia_from_log(q + noise * rng.normal(size=count), tau, dt)
    assert result == pytest.approx(truth, rel=2e-4)


# --- MPPI -----------------------------------------------------------------------------------------


@examples(60)
@given(rngs(), st.integers(1, 20), st.floats(-1e6, 1e6), st.floats(1e-3, 1e3))
def test_weights_are_the_softmax_and_only_differences_of_costs_count(rng, k, base, temperature):
    plan, noise, costs = rng.normal(size=(5, 2)), rng.normal(size=(k, 5, 2)), rng.uniform(0, 9, k)
    limits = -rng.uniform(0.5, 2.0, 2), rng.uniform(0.5, 2.0, 2)
    result, effective = solutions.mppi_step(plan, noise, costs, temperature, *limits)
    share = softmax(-costs / temperature)
    truth = np.einsum("k,kij->ij", share, np.clip(plan + noise, *limits))
    np.testing.assert_allclose(result, truth, rtol=0, atol=1e-12)
    assert effective == pytest.approx(1.0 / np.sum(share**2), rel=1e-10)
    assert 1.0 - 1e-12 <= effective <= k * (1.0 + 1e-12)
    assert (result >= limits[0] - 1e-12).all() and (result <= limits[1] + 1e-12).all()
    # Costs that are shifted are rounded: by so much of a temperature the weights may differ.
    moved, _ = solutions.mppi_step(plan, noise, costs + base, temperature, *limits)
    np.testing.assert_allclose(moved, result, rtol=0, atol=1e-14 * abs(base) / temperature + 1e-12)


@examples(30)
@given(rngs(), st.integers(1, 6), st.sampled_from([np.nan, np.inf]))
def test_rollouts_that_failed_might_as_well_not_be_there(rng, k, failure):
    plan, noise, costs = rng.normal(size=(4, 1)), rng.normal(size=(k + 3, 4, 1)), np.zeros(k + 3)
    costs[:k], costs[k:] = rng.normal(size=k), failure
    args = 0.7, np.array([-1.0]), np.array([1.0])
    result = solutions.mppi_step(plan, noise, costs, *args)
    alone = solutions.mppi_step(plan, noise[:k], costs[:k], *args)
    np.testing.assert_allclose(result[0], alone[0], rtol=0, atol=1e-15)
    assert result[1] == pytest.approx(alone[1], rel=1e-14)
    stays, nothing = solutions.mppi_step(plan, noise, np.full(k + 3, failure), *args)
    assert nothing == 0.0
    np.testing.assert_array_equal(stays, np.clip(plan, -1.0, 1.0))


# --- the hunt -------------------------------------------------------------------------------------


def response(function, pole, load, far, dt, t):
    """The angle's error after a time, from the target away by `far` at first."""
    q, _, _ = function(0.4, 0.4 + far, pole, load, dt, round(t / dt))
    return 0.4 + far - q


@pytest.mark.parametrize("pole", [2.0, 5.0])
def test_three_poles_come_out_as_the_step_goes_to_zero(pole):
    """Error e(t) of e''' + 3 p e'' + 3 p^2 e' + p^3 e = 0, by a load or by a new target."""
    for t in (0.5 / pole, 2.0 / pole, 6.0 / pole):
        s = pole * t
        pushed = -3.0 / 0.5 * 0.5 * t * t * math.exp(-s)
        moved = 0.3 * math.exp(-s) * (1.0 + s - s * s)  # from e(0), e' = 0, e'' = -kp e(0)
        for load, far, truth in ((3.0, 0.0, pushed), (0.0, 0.3, moved)):
            deviation = [
                abs(response(solutions.hold_joint, pole, load, far, dt, t) - truth)
                for dt in (2e-3 / pole, 1e-3 / pole)
            ]
            assert deviation[1] < 2e-3 * (abs(far) + abs(load) / pole**2)
            assert deviation[0] / deviation[1] == pytest.approx(2.0, rel=0.3) or deviation[1] < 1e-5


def test_the_starter_of_the_hunt_holds_every_load_with_other_poles():
    """The bug is silent: the error goes to zero and the integral is right. kp acts as kp + ki."""
    names: dict = {}
    exec(cards.card("hold_joint").starter(), names)
    wrong, pole, load, dt = names["hold_joint"], 4.0, 3.0, 2e-3
    q, v, total = wrong(0.3, 0.3, pole, load, dt, round(60.0 / dt))
    assert abs(q - 0.3) < 1e-9 and abs(v) < 1e-9
    assert total == pytest.approx(-load / 0.5 / pole**3, rel=1e-6)
    slow = max(np.roots([1.0, 3 * pole, 3 * pole**2 + pole**3, pole**3]).real)
    late = [response(wrong, pole, load, 0.0, dt, t) for t in (6.0, 8.0)]
    assert math.log(late[1] / late[0]) / 2.0 == pytest.approx(slow, rel=1e-2)
    assert slow > -0.3 * pole


@pytest.mark.parametrize("seed", range(5))
def test_pd_gains_place_the_poles(seed):
    """The closed loop's eigenvalues have the frequency and the damping ratio."""
    rng = np.random.default_rng(seed)
    inertia, friction = rng.uniform(0.1, 5.0, 4), rng.uniform(0.0, 3.0, 4)
    frequency, ratio = rng.uniform(0.5, 10.0, 4), rng.uniform(0.2, 0.95, 4)
    gains = solutions.pd_gains(inertia, friction, frequency, ratio)
    for J, c, f, zeta, kp, kd in zip(inertia, friction, frequency, ratio, *gains, strict=True):
        pole = np.linalg.eigvals(np.array([[0.0, 1.0], [-kp / J, -(kd + c) / J]]))[0]
        assert abs(pole) == pytest.approx(2.0 * math.pi * f)
        assert -pole.real / abs(pole) == pytest.approx(zeta)


@pytest.mark.parametrize("seed", range(5))
def test_friction_torque_is_scipy_s_logistic_function_and_the_course_s_law(seed):
    """tanh(x) = 2 expit(2 x) - 1."""
    rng = np.random.default_rng(seed)
    coulomb, viscous = rng.uniform(0.0, 3.0, (2, 6))
    width = rng.uniform(0.01, 0.5)
    for scale in (0.1, 1.0, 1e4):
        v = scale * width * rng.normal(size=6)
        expected = coulomb * (2.0 * expit(2.0 * v / width) - 1.0) + viscous * v
        result = solutions.friction_torque(v, coulomb, viscous, width)
        np.testing.assert_allclose(result, expected, atol=1e-12 * (1.0 + np.abs(expected).max()))
        law = control.friction_compensation(v, coulomb, viscous, width)
        np.testing.assert_allclose(result, law, rtol=1e-13, atol=1e-15)
    abrupt = solutions.friction_torque([2, 0, -2], [1, 1, 1], [0, 5, 2], 0)
    np.testing.assert_array_equal(abrupt, [1.0, 0.0, -5.0])


def test_friction_torque_takes_the_friction_out_of_a_joint():
    """A joint with it, pushed by it, turns at a constant rate; without it, it slows down."""
    dt, inertia, friction = 1e-3, 0.5, (np.array([2.0]), np.array([0.7]), 0.05)
    for start in (1.5, 0.03, -0.8):
        free, braked = np.array([start]), np.array([start])
        for _ in range(200):
            law = friction[0] * np.tanh(free / friction[2]) + friction[1] * free
            free = free + dt / inertia * (solutions.friction_torque(free, *friction) - law)
            law = friction[0] * np.tanh(braked / friction[2]) + friction[1] * braked
            braked = braked - dt / inertia * law
        assert free[0] == pytest.approx(start, rel=1e-12)
        assert abs(braked[0]) < 0.6 * abs(start)
