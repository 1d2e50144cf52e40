"""The worked answers of chapter 9 against torch, finite differences, double sums, closed forms."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from drills import cards
from drills.catalogue.flow_sample.exercise import mixture
from solutions import learning as solutions
from tests.budget import examples


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


# --- gradients ------------------------------------------------------------------------------------


@examples(20)
@given(rngs(), st.integers(1, 4), st.integers(1, 9))
def test_gradients_by_hand_are_those_of_torch(rng, m, n):
    shapes = (3, n), (m, n), (5, 3), (5,), (m, 5), (m,)
    args = [rng.normal(size=shape) for shape in shapes]
    x, target, W1, b1, W2, b2 = (torch.tensor(a, requires_grad=True) for a in args)
    output = W2 @ torch.tanh(W1 @ x + b1[:, None]) + b2[:, None]
    (0.5 * (output - target).square().sum(dim=0).mean()).backward()
    for result, right in zip(solutions.backprop(*args), (W1, b1, W2, b2), strict=True):
        assert right.grad is not None
        np.testing.assert_allclose(result, right.grad, rtol=0, atol=1e-12)


@examples(30)
@given(rngs(), st.integers(1, 10))
def test_the_objective_is_its_six_cases_and_its_gradient_that_of_differences(rng, n):
    new, old = rng.normal(size=(2, n)) * 0.3
    A, eps, ratio = rng.normal(size=n), 0.2, np.exp(new - old)
    result, gradient = solutions.ppo_objective(new, old, A, eps)
    terms = [
        a * {(True, 1): 1 + eps, (False, -1): 1 - eps}.get((a > 0, side), r)
        for a, r, side in zip(A, ratio, (ratio > 1 + eps) * 1 - (ratio < 1 - eps), strict=True)
    ]
    assert result == pytest.approx(np.mean(terms), abs=1e-14)
    near = np.minimum(abs(ratio - 1 - eps), abs(ratio - 1 + eps)) < 1e-4
    h = 1e-6 * np.eye(n)
    up, down = ([solutions.ppo_objective(new + s * d, old, A, eps)[0] for d in h] for s in (1, -1))
    slope = (np.array(up) - down) / 2e-6
    np.testing.assert_allclose(gradient[~near], slope[~near], atol=1e-8)


# --- advantages and rewards -----------------------------------------------------------------------


@examples(30)
@given(rngs(), st.integers(1, 15))
def test_advantages_are_the_double_sum_within_each_episode(rng, T):
    reward, value, following = rng.normal(size=(3, T, 2))
    kind = rng.integers(0, 6, (T, 2))
    ended, cut, gamma, lam = kind == 0, kind == 1, 0.9, 0.7
    result, target = solutions.gae(reward, value, following, ended, cut, gamma, lam)
    for e in range(2):
        delta = reward[:, e] + gamma * ~ended[:, e] * following[:, e] - value[:, e]
        for t in range(T):
            stops = np.flatnonzero((ended | cut)[t:, e])
            last = t + stops[0] if stops.size else T - 1
            right = sum((gamma * lam) ** (s - t) * delta[s] for s in range(t, last + 1))
            assert result[t, e] == pytest.approx(right, abs=1e-12)
    np.testing.assert_allclose(target - value, result, atol=1e-14)
    # With lambda 1 an episode's target is its discounted rewards, and what is behind its last row.
    going = np.vstack((value[1:], following[-1:]))
    whole = solutions.gae(reward, value, going, 0 * ended, 0 * cut, gamma, 1.0)[1]
    powers = gamma ** np.arange(T)
    np.testing.assert_allclose(whole[0], powers @ reward + gamma**T * following[-1], atol=1e-12)


@examples(30)
@given(rngs(), st.integers(2, 12))
def test_all_that_a_run_gets_telescopes(rng, k):
    path, goal = 0.5 * rng.normal(size=(2, k)), 0.5 * rng.normal(size=2)
    reward, steps = solutions.reach_reward(path, goal, 0.5, 0.9)
    away = np.linalg.norm(path.T - goal, axis=1)
    inside = [t for t in range(1, k) if away[t] <= 0.5]
    assert steps == (inside[0] if inside else k - 1) and not reward[steps:].any()
    remaining = 0.9 ** (steps - 1) if inside else -(0.9**steps) * away[-1]
    assert 0.9 ** np.arange(k - 1) @ reward == pytest.approx(away[0] + remaining, abs=1e-12)


# --- imitation ------------------------------------------------------------------------------------


@examples(20)
@given(rngs(), st.integers(0, 6))
def test_a_round_of_dagger_is_the_learners_own_way_and_the_experts_labels(rng, steps):
    A, B, start = rng.normal(size=(2, 2)), rng.normal(size=(2, 1)), rng.normal(size=2)
    states = rng.normal(size=(2, 5))
    labels = np.tanh(states[:1])
    observed, report, K = solutions.dagger_round(
        A, B, lambda x: np.tanh(x[:1]), states, labels, start, steps
    )
    loop = A + B @ (labels @ np.linalg.pinv(states))
    distance = [np.linalg.matrix_power(loop, t) @ start for t in range(steps)]
    right = np.column_stack([states, *distance])
    np.testing.assert_allclose(observed, right, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(report, np.tanh(right[:1]), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(
        (report - K @ observed) @ observed.T, 0.0, atol=1e-7 * np.sum(observed**2)
    )


# --- flows and chunks -----------------------------------------------------------------------------


def test_samples_converge_to_the_closed_form_by_second_order():
    """One mode: noise z ends at centre + width z, exactly."""
    noise, centre = np.random.default_rng(1).normal(size=(2, 50)), np.array([[1.0], [-2.0]])
    field = mixture(centre, 0.3)
    errors = [
        abs(solutions.flow_sample(field, noise, n) - (centre + 0.3 * noise)).max() for n in (32, 64)
    ]
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.3 and errors[1] < 1e-2
    one = noise + field(noise, 0.0)  # a single Euler step gives the mean, whatever the noise
    np.testing.assert_allclose(one, centre + 0.0 * noise, atol=1e-14)


def test_samples_of_two_modes_have_their_shares():
    noise = np.random.default_rng(2).normal(size=(1, 4000))
    result = solutions.flow_sample(mixture([[-1.5, 1.5]], 0.2), noise, 100)[0]
    assert abs(np.mean(result > 0) - 0.5) < 0.03
    assert np.std(result[result > 0]) == pytest.approx(0.2, rel=0.06)


@examples(20)
@given(rngs(), st.integers(1, 12), st.integers(1, 5), st.floats(0.0, 2.0))
def test_chunks_are_those_of_a_queue(rng, T, H, rate):
    chunks, every = rng.normal(size=(T, H, 2)), int(rng.integers(1, H + 1))
    committed, ensembled = solutions.execute_chunks(chunks, every, rate)
    queue: list = []
    for t in range(T):
        if t % every == 0:
            queue = list(chunks[t])
        assert np.array_equal(committed[t], queue.pop(0))
        proposed = [chunks[s][t - s] for s in range(T) if 0 <= t - s < H]
        weights = [np.exp(-rate * i) for i in range(len(proposed))]
        np.testing.assert_allclose(
            ensembled[t], np.average(proposed, axis=0, weights=weights), atol=1e-12
        )


# --- the hunt -------------------------------------------------------------------------------------


def carriages(rng):
    law, known = np.array([-1.5, 0.1]), np.array([40.0, 0.2, 36.0])
    return law, known, rng.uniform(-2, 2, 6), rng.normal(size=(8, 6)), rng.uniform(-3, 3, 40)


@examples(10)
@given(rngs())
def test_a_round_of_training_is_reinforce_by_torch_and_one_episode_a_start(rng):
    law, known, starts, noise, tested = carriages(rng)
    result, statistics, share = solutions.training_round(law, known, starts, noise, tested)
    w, x, places, rewards, chances = torch.tensor(law, requires_grad=True), starts, [], [], []
    for drawn in noise:
        places.append(x)
        observed = np.concatenate(places)
        mean = (40.0 * 0.2 + observed.sum()) / (40 + observed.size)
        squares = 36.0 + 40 * (mean - 0.2) ** 2 + np.sum((observed - mean) ** 2)
        z = (x - mean) / np.sqrt(squares / (40 + observed.size))
        law_now = torch.distributions.Normal(w[0] * torch.tensor(z) + w[1], 0.5)
        action = law_now.mean.detach() + 0.5 * torch.tensor(drawn)
        chances.append(law_now.log_prob(action))
        x = x + 0.1 * np.clip(action.numpy(), -1, 1)
        rewards.append(-abs(x))
    ahead = np.array([np.sum(rewards[t:], axis=0) for t in range(len(rewards))])
    better = torch.tensor(ahead - ahead.mean(axis=1, keepdims=True))
    (torch.stack(chances) * better).mean().backward()
    assert w.grad is not None
    np.testing.assert_allclose(result, law + 0.1 * w.grad.numpy(), rtol=1e-12)
    np.testing.assert_allclose(statistics, (88, mean, squares), atol=1e-11)
    reached = 0
    for x in tested:
        for _ in range(20):
            x += 0.1 * np.clip(result[0] * (x - mean) / np.sqrt(squares / 88) + result[1], -1, 1)
            if abs(x) < 0.1:
                reached += 1
                break
    assert share == reached / 40


def test_the_curve_of_the_hunts_starter_looks_fine():
    names: dict = {}
    exec(cards.card("training_round").starter(), names)
    args = carriages(np.random.default_rng(5))
    flattering, true = (run(*args) for run in (names["training_round"], solutions.training_round))
    assert flattering[2] > 0.95 and true[2] < 0.6
    assert flattering[1][0] > true[1][0] == 88
