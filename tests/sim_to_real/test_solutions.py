"""The worked answers of chapter 8 against the chapter, SciPy and counted coverage."""

from itertools import product

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space
from scipy.optimize import least_squares
from scipy.signal import cont2discrete
from scipy.stats import loguniform

from course import sim_to_real as chapter
from drills import cards
from solutions import sim_to_real as solutions
from tests.budget import examples


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


# --- shaping --------------------------------------------------------------------------------------


@examples(20)
@given(rngs())
def test_shaped_rewards_are_the_chapters_and_keep_the_best_policy(rng):
    """All steps of a process as a log: what comes back is the shaped process of the chapter."""
    P, ends = rng.dirichlet(np.ones(6), (6, 2)), np.arange(6) >= 4
    P[ends] = np.eye(6)[ends][:, None]
    R = np.where(ends[:, None, None], 0.0, rng.normal(size=(6, 2, 6)))
    process = chapter.Process(P, R, 0.9, ends)
    s, a, k = np.indices(R.shape).reshape(3, -1)[:, np.repeat(~ends, 12)]
    phi = rng.normal(size=6)
    result = solutions.shaped_reward(s, k, R[s, a, k], ends[k], 0 * s, phi, 0.9)
    np.testing.assert_allclose(result, chapter.shaped(process, phi).reward[s, a, k], atol=1e-14)
    new = R.copy()
    new[s, a, k] = result
    q = [chapter.value_iteration(chapter.Process(P, r, 0.9, ends)).q[~ends] for r in (R, new)]
    np.testing.assert_allclose(q[1], q[0] - phi[~ends, None], atol=1e-10)


# --- identification -------------------------------------------------------------------------------


@examples(20)
@given(rngs(), st.integers(0, 2))
def test_what_is_hidden_is_scipys_null_space_and_intervals_cover(rng, hidden):
    """Of 400 fits of a line in four parameters about 95 % lie within each half-width."""
    N = np.linalg.qr(rng.normal(size=(4, 2)))[0][:, :hidden]
    scale, relative = 10.0 ** rng.uniform(-2, 2, 4), rng.normal(size=(30, 4))
    J = relative @ (np.eye(4) - N @ N.T) / scale
    rank, projector, half = solutions.identifiable(J, scale, 0.3)
    basis = null_space(J * scale, rcond=1e-8)
    assert rank == 4 - hidden == 4 - basis.shape[1]
    np.testing.assert_allclose(projector, basis @ basis.T, atol=1e-10)
    if hidden:
        assert (half == -1.0).all()
    else:
        result = np.linalg.lstsq(J, 0.3 * rng.normal(size=(30, 400)), rcond=None)[0]
        covered = np.mean(np.abs(result) < half[:, None])
        assert 0.92 < covered < 0.98


@examples(20)
@given(rngs(), st.floats(0.0, 0.2))
def test_the_delay_is_right_to_a_tenth_of_a_sample(rng, delay):
    rates, phases = rng.uniform(6.0, 30.0, 10), rng.uniform(0.0, 6.28, 10)
    t = 0.01 * np.arange(1200)
    x, y = (np.sin(np.outer(rates, t - late) + phases[:, None]).sum(axis=0) for late in (0, delay))
    y = 5.0 + 0.3 * y + 0.01 * rng.normal(size=t.size)
    assert abs(solutions.delay_from_log(x, y, 0.01, 0.2) - delay) < 7e-4


@examples(6)
@given(rngs())
def test_the_output_error_is_least_by_scipy_too(rng):
    truth, q, v = rng.uniform([0.1, 0.3], [0.4, 1.0]), rng.normal(), rng.normal()
    tau = rng.normal(size=60).repeat(2)

    def simulated(parameters):
        drag, gain = parameters[1] / parameters[0], 1.0 / parameters[0]
        A, B = np.array([[0.0, 1.0], [0.0, -drag]]), np.array([[0.0], [gain]])
        A, B, *_ = cont2discrete((A, B, np.eye(2), 0.0 * B), 0.02)
        x, angles = np.array([q, v]), []
        for u in tau:
            angles.append(x[0])
            x = A @ x + B[:, 0] * u
        return np.array(angles)

    measured = simulated(truth) + 1e-3 * rng.normal(size=tau.size)
    best = least_squares(lambda p: simulated(p) - measured, truth, xtol=1e-13, ftol=1e-13)
    result = solutions.output_error(measured, tau, 0.02, (q, v), 1.7 * truth)
    np.testing.assert_allclose(result, best.x, rtol=2e-6)


# --- randomisation --------------------------------------------------------------------------------


@examples(50)
@given(rngs())
def test_ends_move_out_in_or_not_and_never_past_the_middle(rng):
    bounds, outcomes = np.tile([-0.05, 1.0], (3, 1)), rng.integers(0, 2, (3, 2, 5))
    result = solutions.boundary_update(bounds, np.zeros(3), outcomes, (0.4, 0.6), np.full(3, 0.1))
    for i, side in np.ndindex(3, 2):
        wins = outcomes[i, side].sum()
        outward = 0.1 * ((wins >= 3) - float(wins <= 2)) * (2 * side - 1)
        moved = bounds[i, side] + outward
        assert result[i, side] == (max(moved, 0.0) if side else min(moved, 0.0))


# --- the hunt -------------------------------------------------------------------------------------


@examples(10)
@given(rngs())
def test_a_cart_of_the_hunt_is_the_linear_system_with_a_queue(rng):
    """State (x, v, commands that wait) by a matrix, for carts that stay within 1 m."""
    gains = rng.uniform([2.0, 3.0], [4.0, 5.0], (3, 2))
    draws = np.column_stack((rng.uniform(0.8, 2.0, 5), rng.uniform(0, 1, 5), rng.integers(0, 5, 5)))
    costs = np.zeros((3, 5))
    for (k, (kp, kd)), (i, (mass, damping, delay)) in product(enumerate(gains), enumerate(draws)):
        z, n = np.zeros(int(delay) + 3), int(delay)
        z[0] = 1.0
        for _ in range(100):
            z[2:] = np.append(z[3:], -kp * z[0] - kd * z[1])
            z[1] += 0.02 * (z[-1 - n] - damping * z[1]) / mass
            z[0] += 0.02 * z[1]
            costs[k, i] += 0.02 * z[0] ** 2
    result, best, tested = solutions.tune_randomised(gains, draws, 3)
    np.testing.assert_allclose(result, costs[:, :3].mean(axis=1), rtol=1e-12)
    assert best == result.argmin() and np.isclose(tested, costs[best, 3:].mean(), rtol=1e-12)


def test_the_starter_of_the_hunt_agrees_with_itself_whatever_is_drawn():
    names: dict = {}
    exec(cards.card("tune_randomised").starter(), names)
    gains, draws = [[8.0, 3.0], [12.0, 5.0]], np.array([[1.0, 0.2, 0.0], [2.0, 1.0, 8.0]])
    result = [names["tune_randomised"](gains, carts, 1) for carts in (draws, draws[::-1])]
    assert all(np.array_equal(a, b) for a, b in zip(*result, strict=True))
    costs, best, tested = solutions.tune_randomised(gains, draws, 1)
    assert costs[best] == result[0][2] and tested > 1.5 * result[0][2]


def test_log_uniform_draws_are_those_of_scipy():
    low, high = np.array([0.1, 2.0]), np.array([10.0, 300.0])
    u = np.random.default_rng(0).uniform(0.0, 1.0, (50, 2))
    assert np.allclose(solutions.log_uniform(low, high, u), loguniform(low, high).ppf(u))
    # Half the nominal value is as likely as twice.
    value = solutions.log_uniform([0.1], [10.0], (np.arange(10000)[:, None] + 0.5) / 10000)
    assert np.mean(value < 0.5) == np.mean(value > 2.0)
