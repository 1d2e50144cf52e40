"""Worked answers of chapter 9, robot learning: complete, of interview size."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike


def backprop(
    x: ArrayLike, target: ArrayLike, W1: ArrayLike, b1: ArrayLike, W2: ArrayLike, b2: ArrayLike
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return gradients of a net of two layers, tanh after the first, by hand.

    Args:
        x, target: a batch of inputs (d, n), and of what should come out (m, n).
        W1, b1, W2, b2: weights and biases, (h, d), (h,), (m, h), (m,).

    Returns:
        Gradients by W1, b1, W2, b2 of the mean over the batch of half the squared error.
    """
    inputs, desired, W, V = (np.asarray(a, dtype=float) for a in (x, target, W1, W2))
    hidden = np.tanh(W @ inputs + np.asarray(b1, dtype=float)[:, None])
    output = V @ hidden + np.asarray(b2, dtype=float)[:, None]
    error = (output - desired) / inputs.shape[1]
    back = (V.T @ error) * (1.0 - hidden**2)
    return back @ inputs.T, back.sum(axis=1), error @ hidden.T, error.sum(axis=1)


def gae(
    reward: ArrayLike,
    value: ArrayLike,
    following: ArrayLike,
    terminated: ArrayLike,
    truncated: ArrayLike,
    gamma: float,
    lam: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return advantages by GAE for T steps of N environments, and the critic's targets.

    Args:
        reward: of each step, (T, N).
        value, following: values of the states where it begins and where it led, (T, N).
        terminated, truncated: whether the episode ended there, or was cut off, (T, N).
        gamma, lam: discounts of rewards and of the trace.

    Returns:
        (advantages, targets), each (T, N).
    """
    r, v, ahead = (np.asarray(a, dtype=float) for a in (reward, value, following))
    ended, cut = np.asarray(terminated) != 0, np.asarray(truncated) != 0
    delta = r + gamma * np.where(ended, 0.0, ahead) - v
    stop, trace, advantage = ended | cut, np.zeros(v.shape[1:]), np.zeros(v.shape)
    for t in reversed(range(len(v))):
        trace = delta[t] + np.where(stop[t], 0.0, gamma * lam * trace)
        advantage[t] = trace
    return advantage, advantage + v


def ppo_objective(
    new: ArrayLike, old: ArrayLike, advantage: ArrayLike, clip: float
) -> tuple[float, np.ndarray]:
    """Return PPO's clipped objective, which is to be maximised, and its gradient by `new`.

    Args:
        new, old: log-probabilities of the actions taken, now and when they were taken, (n,).
        advantage: of these actions, (n,).
        clip: how far the ratio may be from 1, between 0 and 1.

    Returns:
        (mean over the batch, its gradient by `new` (n,)).
    """
    A = np.asarray(advantage, dtype=float)
    ratio = np.exp(np.asarray(new, dtype=float) - np.asarray(old, dtype=float))
    plain, clipped = ratio * A, np.clip(ratio, 1.0 - clip, 1.0 + clip) * A
    gradient = np.where(plain <= clipped, plain, 0.0) / A.size
    return float(np.mean(np.minimum(plain, clipped))), gradient


def dagger_round(
    A: ArrayLike,
    B: ArrayLike,
    expert: Callable[[np.ndarray], np.ndarray],
    states: ArrayLike,
    labels: ArrayLike,
    start: ArrayLike,
    steps: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return one round of DAgger, with a linear learner u = K x fitted by least squares.

    Args:
        A, B: of the plant x' = A x + B u, (n, n) and (n, m).
        expert: what it does in a state, (n,) -> (m,).
        states, labels: the data so far, (n, k) and (m, k).
        start: where the round begins, (n,).
        steps: how many actions it takes.

    Returns:
        (states, labels, the new K): the data first as they were, then what the round adds.
    """
    plant, push = np.asarray(A, dtype=float), np.asarray(B, dtype=float)

    def fit(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.lstsq(x.T, u.T, rcond=None)[0].T)

    visited, labelled = np.asarray(states, dtype=float), np.asarray(labels, dtype=float)
    K, x = fit(visited, labelled), np.asarray(start, dtype=float)
    for _ in range(steps):
        visited, labelled = np.column_stack((visited, x)), np.column_stack((labelled, expert(x)))
        x = plant @ x + push @ (K @ x)
    return visited, labelled, fit(visited, labelled)


def flow_sample(
    field: Callable[[np.ndarray, float], np.ndarray], noise: ArrayLike, steps: int
) -> np.ndarray:
    """Return samples of a flow policy: from noise at time 0 to actions at time 1, by Heun's method.

    Args:
        field: velocity (x, t) -> (d, n) of samples x (d, n) at time t.
        noise: where they start, (d, n).
        steps: equal ones, each with two evaluations.

    Returns:
        The samples at time 1, (d, n).
    """
    x, h = np.array(noise, dtype=float), 1.0 / steps
    for k in range(steps):
        t = k * h
        slope = field(x, t)
        x = x + 0.5 * h * (slope + field(x + h * slope, t + h))
    return x


def execute_chunks(chunks: ArrayLike, every: int, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the executed actions of a chunk policy: committed, and with temporal ensembling.

    Args:
        chunks: what is proposed at step t for step t + j, (T, H, m).
        every: steps from one new chunk to the next when committing, 1 to H.
        rate: of the weights exp(-rate i) of the ensemble, i = 0 for the oldest chunk.

    Returns:
        (committed actions, ensembled actions), each (T, m).
    """
    plans = np.asarray(chunks, dtype=float)
    T, H, m = plans.shape
    steps, ensembled = np.arange(T), np.zeros((T, m))
    began = steps // every * every
    for t in steps:
        made = np.arange(max(0, t - H + 1), t + 1)
        weights = np.exp(-rate * np.arange(made.size))
        ensembled[t] = weights @ plans[made, t - made] / weights.sum()
    return plans[began, steps - began], ensembled


def reach_reward(
    path: ArrayLike, goal: ArrayLike, radius: float, gamma: float
) -> tuple[np.ndarray, int]:
    """Return a run's rewards: 1 for reaching the disc, plus shaping by the potential -distance.

    Args:
        path: positions before, between and after T steps, (2, T + 1) [m].
        goal: centre of the disc (2,) [m].
        radius: of the disc [m].
        gamma: discount.

    Returns:
        (reward of each step (T,), 0 after the end; steps until the end).
    """
    away = np.asarray(path, dtype=float) - np.asarray(goal, dtype=float)[:, None]
    phi = -np.hypot(away[0], away[1])
    inside = -phi[1:] <= radius
    steps = int(np.argmax(inside)) + 1 if inside.any() else inside.size
    ahead = np.where(inside, 0.0, phi[1:])
    reward = inside + gamma * ahead - phi[:-1]
    reward[steps:] = 0.0
    return reward, steps


def training_round(
    weights: ArrayLike,
    statistics: ArrayLike,
    starts: ArrayLike,
    noise: ArrayLike,
    tested: ArrayLike,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return one round of training a carriage to go to 0, and the point of its learning curve.

    Args:
        weights: (slope, offset) of the policy's mean over the normalised place.
        statistics: count, mean and sum of squared deviations of the places seen, (3,).
        starts: where training begins, (n,) [m].
        noise: standard normal, one row a step, (T, n).
        tested: where the test begins, (k,) [m].

    Returns:
        (new weights, new statistics, share of the test that reaches 0 to 0.1 m).
    """
    dt, limit, sigma, rate = 0.1, 20, 0.5, 0.1
    w, known = np.array(weights, dtype=float), np.array(statistics, dtype=float)

    def learn(x: np.ndarray) -> None:
        count, mean, squares = known
        new = mean + np.sum(x - mean) / (count + x.size)
        known[:] = count + x.size, new, squares + np.sum((x - mean) * (x - new))

    def normalised(x: np.ndarray) -> np.ndarray:
        return np.asarray((x - known[1]) / np.sqrt(known[2] / known[0]))

    def score() -> float:
        x = np.array(tested, dtype=float)
        reached = np.zeros(x.size, dtype=bool)
        for _ in range(limit):
            x = x + dt * np.clip(w[0] * normalised(x) + w[1], -1.0, 1.0)
            reached |= np.abs(x) < 0.1
        return float(np.mean(reached))

    x, slopes, rewards = np.array(starts, dtype=float), [], []
    for drawn in np.asarray(noise, dtype=float):
        learn(x)
        z = normalised(x)
        mean = w[0] * z + w[1]
        action = mean + sigma * drawn
        x = x + dt * np.clip(action, -1.0, 1.0)
        slopes.append((action - mean) / sigma**2 * np.array([z, np.ones(x.size)]))
        rewards.append(-np.abs(x))
    ahead = np.cumsum(rewards[::-1], axis=0)[::-1]
    better = ahead - np.mean(ahead, axis=1, keepdims=True)
    w += rate * np.mean(np.array(slopes) * better[:, None], axis=(0, 2))
    return w, known, score()
