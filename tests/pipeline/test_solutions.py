"""The worked answers of chapter 11 against exact enumeration, SciPy, MuJoCo and simulated loops."""

from itertools import permutations

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm, solve_discrete_lyapunov

from course.kinematics import TwoLink, mass_matrix
from drills import cards
from solutions import pipeline as solutions
from tests.budget import examples

# The reaching arm: uniform rods, both joints damped, no gravity. MuJoCo would take the damping
# implicitly, unless told not to.
ARM = """<mujoco><option integrator="Euler" gravity="0 0 0">
<flag eulerdamp="disable" contact="disable"/></option><worldbody>
<body><joint axis="0 0 1" damping=".2"/>
<inertial pos=".25 0 0" mass="1" diaginertia=".01 .0208333333333 .0208333333333"/>
<body pos=".5 0 0"><joint axis="0 0 1" damping=".2"/>
<inertial pos=".2 0 0" mass=".8" diaginertia=".005 .0106666666667 .0106666666667"/>
</body></body></worldbody></mujoco>"""


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


# --- the budget -----------------------------------------------------------------------------------


@examples(20)
@given(rngs(), st.integers(1, 5))
def test_the_budget_is_the_mean_over_all_orders_and_sums(rng, k):
    errors = rng.normal(size=(2**k, 7, 2)) + rng.normal(size=(2**k, 1, 2))
    mean, square = errors.mean(axis=1), (errors**2).sum(axis=2).mean(axis=1)
    orders = list(permutations(range(k)))
    parts, shares = np.zeros((k, 2)), np.zeros(k)
    for order in orders:
        at_fault = 0
        for i in order:
            parts[i] += (mean[at_fault | 1 << i] - mean[at_fault]) / len(orders)
            shares[i] += (square[at_fault | 1 << i] - square[at_fault]) / len(orders)
            at_fault |= 1 << i
    result = solutions.error_budget(errors)
    np.testing.assert_allclose(result[0], parts, atol=1e-12)
    np.testing.assert_allclose(result[1], shares, atol=1e-12)
    np.testing.assert_allclose(result[0].sum(axis=0), mean[-1] - mean[0], atol=1e-12)
    np.testing.assert_allclose(result[1].sum(), square[-1] - square[0], atol=1e-12)
    assert (result[2] == [square[2**k - 1 - 2**i] for i in range(k)]).all()


def test_mending_one_of_two_that_cancel_makes_it_worse():
    e = np.array([[[0.0, 0.0]], [[5.0, 0.0]], [[-3.0, 0.0]], [[2.0, 0.0]]])
    parts, shares, mended = solutions.error_budget(e)
    assert (parts[:, 0] == [5.0, -3.0]).all()
    assert shares.sum() == 4.0 and shares[1] < 0.0 and mended[0] > 4.0 and mended[1] > 4.0


# --- the present ----------------------------------------------------------------------------------


@examples(20)
@given(rngs(), st.integers(1, 6), st.floats(0.0, 5.0))
def test_what_is_carried_forward_is_van_loans_by_scipy(rng, n, noise):
    """State and covariance by the exponential of one matrix, of the newest that has arrived."""
    captured = rng.uniform(0.0, 1.0, n)
    arrived = captured + rng.uniform(0.0, 0.5, n)
    now = float(rng.uniform(arrived.min(), 2.0))
    states, roots = rng.normal(size=(n, 4)), rng.normal(size=(n, 4, 4))
    P = roots @ roots.swapaxes(1, 2)
    newest = max((k for k in range(n) if arrived[k] <= now), key=lambda k: captured[k])
    A, W = np.eye(4, k=2), noise * np.diag([0.0, 0.0, 1.0, 1.0])
    both = expm(np.block([[-A, W], [np.zeros((4, 4)), A.T]]) * (now - captured[newest]))
    F = both[4:, 4:].T
    state, covariance = solutions.to_the_present(states, P, captured, arrived, now, noise)
    np.testing.assert_allclose(state, F @ states[newest], atol=1e-12)
    np.testing.assert_allclose(covariance, F @ P[newest] @ F.T + F @ both[:4, 4:], atol=1e-11)


# --- limits ---------------------------------------------------------------------------------------


@examples(20)
@given(rngs())
def test_the_step_limit_is_where_an_eigenvalue_of_the_step_is_minus_one(rng):
    """The matrix of a whole step of both joints: within the circle below the limit, not above."""
    arm = TwoLink(tuple(rng.uniform(0.3, 0.6, 2)), tuple(rng.uniform(0.5, 1.5, 2)), payload=0.2)
    inertia, elbow = arm.parameters[:3], rng.uniform(-3.0, 3.0, 4)
    kp, kd, damping = rng.uniform([5.0, 0.0, 0.0], [60.0, 10.0, 1.0])
    limits = solutions.step_limit(inertia, elbow, kp, kd, damping)
    for q2, limit in zip(elbow, limits, strict=True):
        M, one = mass_matrix(arm.chain(), np.array([0.3, q2])), np.eye(2)
        for part in (0.999, 1.001):
            h = part * limit
            K, D = h * kp * np.linalg.inv(M), h * (kd + damping) * np.linalg.inv(M)
            step = np.block([[one - h * K, h * (one - D)], [-K, one - D]])
            assert (np.abs(np.linalg.eigvals(step)).max() <= 1.0 + 1e-12) == (part < 1.0)


@examples(4)
@given(rngs())
def test_mujoco_is_stable_below_the_limit_and_not_above(rng):
    """Its Euler step, with the damping taken from the old rate, about a posture at rest."""
    arm, q = TwoLink(), np.array([0.3, rng.uniform(0.0, 2.5)])
    kp, kd = rng.uniform([15.0, 2.0], [40.0, 9.0])
    limit = float(solutions.step_limit(arm.parameters[:3], q[1:], kp, kd, arm.damping[0])[0])
    model = mujoco.MjModel.from_xml_string(ARM)
    data = mujoco.MjData(model)
    for part in (0.99, 1.01):
        model.opt.timestep = part * limit
        mujoco.mj_resetData(model, data)
        data.qpos[:] = q + 1e-9 * rng.normal(size=2)
        for _ in range(4000):
            data.qfrc_applied[:] = kp * (q - data.qpos) - kd * data.qvel
            mujoco.mj_step(model, data)
            if np.abs(data.qpos - q).max() > 1e-4:
                break
        assert (np.abs(data.qpos - q).max() < 1e-8) == (part < 1.0)


@examples(20)
@given(st.integers(0, 8), st.floats(0.1, 0.97))
def test_the_gain_is_scipys_and_the_poles_leave_the_circle_at_the_limit(delay, part):
    limit, _ = solutions.visual_gain(0.1, delay)
    for gain, settles in ((0.999 * limit, True), (1.001 * limit, False)):
        poles = np.roots([1.0, -1.0, *[0.0] * (delay - 1), gain] if delay else [1.0, gain - 1.0])
        assert (np.abs(poles).max() < 1.0) == settles
        assert (solutions.visual_gain(gain, delay)[1] > 0.0) == settles
    gain = part * limit
    A, b = np.eye(delay + 1, k=-1), np.zeros((delay + 1, 1))
    A[0, 0], b[0] = A[0, 0] + 1.0, gain
    A[0, -1] -= gain
    P = solve_discrete_lyapunov(A, b @ b.T)
    result = solutions.visual_gain(gain, delay)[1]
    np.testing.assert_allclose(result, P[0, 0], rtol=1e-9)
    if not delay:
        np.testing.assert_allclose(result, gain / (2.0 - gain), rtol=1e-12)


# --- whose fault ----------------------------------------------------------------------------------


@examples(100)
@given(rngs(), st.integers(1, 4), st.integers(2, 5))
def test_the_diagnosis_is_the_one_of_trying_everything(rng, rows, k):
    record, limits = rng.integers(0, 12, (rows, 6)), np.full(rows, 10)
    errors = rng.permutation(2**k) / 2**k
    contract, stages = solutions.which_stage(record, limits, errors, 0.3)
    breaches = sorted((tick, row) for row, tick in np.argwhere(record > 10).tolist())
    assert contract == (breaches[0][1] if breaches else -1)
    fewest = min((s.bit_count() for s in range(1, 2**k) if errors[s] <= 0.3), default=9)
    among = [s for s in range(1, 2**k) if s.bit_count() == fewest]
    cure = min(among, key=lambda s: errors[s]) if fewest <= 2 else 0
    assert stages.tolist() == [cure >> i & 1 for i in range(k)]


# --- another step ---------------------------------------------------------------------------------


def worth(price: float, prize: float, gamma: float, n: int) -> float:
    """Of a goal that is n steps away, each of which has its price: summed term by term."""
    return sum(price * gamma**t for t in range(n)) + gamma**n * prize


@examples(20)
@given(rngs(), st.sampled_from((2, 5, 10)), st.one_of(st.just(1.0), st.floats(0.8, 0.999)))
def test_every_way_keeps_its_return_at_another_step(rng, ratio, gamma):
    price, prize = -rng.uniform(0.1, 1.0), rng.uniform(5.0, 20.0)
    terms, g, steps = solutions.rescale_step([price, prize], [0, 1], gamma, 60, 0.01, 0.01 / ratio)
    assert steps == 60 * ratio
    for n in range(12):
        same = worth(terms[0], terms[1], g, n * ratio)
        np.testing.assert_allclose(same, worth(price, prize, gamma, n), rtol=1e-9, atol=1e-9)


def test_what_is_not_rescaled_changes_what_is_best():
    """The large goal far away, against giving up at once: reward or discount kept turn it over."""
    (price, prize), gamma, steps = (-0.1, 9.0), 0.98, 60
    terms, g, limit = solutions.rescale_step([price, prize], [0, 1], gamma, steps, 0.01, 0.001)
    assert worth(price, prize, gamma, 50) > 0.0 and worth(terms[0], prize, g, 500) > 0.0
    assert worth(price, prize, g, 500) < 0.0  # reward kept
    assert worth(terms[0], prize, gamma, 500) < 0.0  # discount kept
    assert steps < 500 <= limit  # in the steps of before it would not be reached


# --- the hunt -------------------------------------------------------------------------------------


def a_day(turn: float, speed: float, push: float) -> tuple:
    """A part below a camera, one that sees exactly, and where it is at each tick."""
    c, s, ticks = np.cos(turn), np.sin(turn), 0.02 * np.arange(200)
    R, t, belt = np.array([[c, -s], [s, c]]), np.array([0.1, -0.2]), np.array([speed, -speed])

    def place(time):
        pushed = np.where(time[:, None] > 0.65, [push, push], 0.0)
        return [0.3, 0.2] + time[:, None] * belt + pushed

    captured = 0.1 * np.arange(35)
    camera = np.linalg.solve(R, (place(captured) - t).T).T
    frames = np.column_stack((captured, captured + 0.07, camera))
    args = frames, 1.0, np.column_stack((R, t)), belt, np.zeros(2), ticks
    return args, place(ticks)


@examples(20)
@given(st.floats(-3.0, 3.0), st.floats(-0.1, 0.1), st.floats(0.0, 0.2))
def test_the_reach_ends_on_the_part_and_never_jumps(turn, speed, push):
    args, truth = a_day(turn, speed, push)
    result = solutions.reach_target(*args)
    np.testing.assert_allclose(result[150:], truth[150:], atol=3.1e-3)
    fastest = 1.5 * (np.linalg.norm(truth, axis=1).max() + 0.4) * 0.02
    assert np.linalg.norm(np.diff(result, axis=0), axis=1).max() < fastest


def test_the_starter_of_the_hunt_succeeds_on_a_quiet_day_and_only_then():
    names: dict = {}
    exec(cards.card("reach_target").starter(), names)

    def missed(*day: float) -> float:
        args, truth = a_day(*day)
        return float(np.linalg.norm(names["reach_target"](*args)[-1] - truth[-1]))

    assert missed(0.0, 0.0, 0.0) < 1e-9 and missed(np.pi, 0.0, 0.0) < 1e-9
    assert min(missed(0.5, 0.0, 0.0), missed(0.0, 0.3, 0.0), missed(0.0, 0.0, 0.1)) > 0.02


def test_throughput_is_what_comes_out_of_a_simulated_pipeline():
    """Images one after the other, each by the worker of a stage that is free first."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        stages, workers = rng.uniform(0.01, 0.2, 4), rng.integers(1, 5, 4)
        latency, rate, slowest = solutions.throughput(stages, workers)
        free = [np.zeros(k) for k in workers]
        out = []
        for _image in range(4000):
            at = 0.0
            for time, idle in zip(stages, free, strict=True):
                worker = int(np.argmin(idle))
                at = max(at, idle[worker]) + time
                idle[worker] = at
            out.append(at)
        assert out[0] == pytest.approx(latency)
        assert 2000 / (out[-1] - out[1999]) == pytest.approx(rate, rel=1e-2)
        faster = stages.copy()
        faster[slowest] *= 0.99
        assert solutions.throughput(faster, workers)[1] > rate
