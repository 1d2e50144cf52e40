"""Worked answers of chapter 8, from simulation to the real robot: complete, of interview size."""

import numpy as np
from numpy.typing import ArrayLike


def shaped_reward(
    state: ArrayLike,
    following: ArrayLike,
    reward: ArrayLike,
    terminated: ArrayLike,
    truncated: ArrayLike,
    phi: ArrayLike,
    gamma: float,
) -> np.ndarray:
    """Return rewards of logged steps with a potential's difference added.

    Args:
        state, following: where each step begins and leads to, whole numbers (n,).
        reward: of each step, (n,).
        terminated, truncated: whether the episode ended there, or was cut off, (n,).
        phi: potential of each state, (S,).
        gamma: discount.

    Returns:
        Shaped rewards, (n,).
    """
    potential = np.asarray(phi, dtype=float)
    ended = np.asarray(terminated) != 0
    ahead = np.where(ended, 0.0, potential[np.asarray(following)])
    return np.asarray(reward, dtype=float) + gamma * ahead - potential[np.asarray(state)]


def identifiable(
    jacobian: ArrayLike, scale: ArrayLike, sigma: float
) -> tuple[int, np.ndarray, np.ndarray]:
    """Return what a log tells of parameters: rank, hidden directions, and error bars.

    Args:
        jacobian: of the samples by the parameters, shape (n, p).
        scale: size of each parameter, by which its changes are measured, (p,).
        sigma: standard deviation of a sample.

    Returns:
        (rank, projector onto the hidden relative changes (p, p), half-widths of 95 % (p,), -1 for
        a parameter that takes part in a hidden direction).
    """
    size = np.asarray(scale, dtype=float)
    relative = np.asarray(jacobian, dtype=float) * size
    _, values, directions = np.linalg.svd(np.linalg.qr(relative, mode="r"))
    rank = int(np.sum(values > 1e-8 * values[0]))
    observable, hidden = directions[:rank], directions[rank:]
    projector = hidden.T @ hidden
    variance = sigma**2 * np.sum((observable / values[:rank, None]) ** 2, axis=0)
    half = 1.96 * size * np.sqrt(variance)
    return rank, projector, np.where(np.diag(projector) > 1e-8, -1.0, half)


def delay_from_log(sent: ArrayLike, measured: ArrayLike, dt: float, longest: float) -> float:
    """Return how late a measurement follows a command, in parts of a sample too.

    Args:
        sent, measured: one value a sample, (n,); the measurement has a gain and an offset.
        dt: sample time [s].
        longest: delay that is looked for [s].

    Returns:
        The delay [s].
    """
    x, y = np.asarray(sent, dtype=float), np.asarray(measured, dtype=float)
    lags = range(-1, round(longest / dt) + 2)  # one more to both sides, for the parabola

    def match(lag: int) -> float:
        a, b = (x[: x.size - lag], y[lag:]) if lag >= 0 else (x[-lag:], y[:lag])
        a, b = a - np.mean(a), b - np.mean(b)
        return float(a @ b / np.sqrt((a @ a) * (b @ b)))

    matches = [match(lag) for lag in lags]
    at = 1 + int(np.argmax(matches[1:-1]))
    before, best, after = matches[at - 1 : at + 2]
    part = 0.5 * (before - after) / (before - 2.0 * best + after)
    return float(dt * (lags[at] + part))


def output_error(
    q: ArrayLike, tau: ArrayLike, dt: float, start: ArrayLike, guess: ArrayLike
) -> np.ndarray:
    """Return inertia and damping of a joint that minimise the squared error of simulated angles.

    Args:
        q: measured angle at each sample, (n,) [rad].
        tau: torque, held from this sample to the next, (n,) [N m].
        dt: sample time [s].
        start: angle and rate at the first sample [rad, rad/s].
        guess: inertia and damping to start from [kg m^2, N m s/rad].

    Returns:
        Inertia and damping, (2,).
    """
    measured, torque = np.asarray(q, dtype=float), np.asarray(tau, dtype=float)
    first, speed = np.asarray(start, dtype=float)

    def simulate(logs: np.ndarray) -> np.ndarray:
        """Return angles at the samples, exact for a held torque."""
        inertia, damping = np.exp(logs)
        time = inertia / damping
        decay = np.exp(-dt / time)
        powers, final = decay ** np.arange(torque.size), torque / damping
        rate = speed * powers
        rate[1:] += (1.0 - decay) * np.convolve(final, powers)[: torque.size - 1]
        moved = final * dt + (rate - final) * time * (1.0 - decay)
        return np.asarray(first + np.concatenate(([0.0], np.cumsum(moved[:-1]))))

    logs, small = np.log(np.asarray(guess, dtype=float)), 1e-6
    for _ in range(15):
        angles = simulate(logs)
        residual = measured - angles
        changes = small * np.eye(2)
        jacobian = np.array([simulate(logs + change) - angles for change in changes]).T / small
        step = np.linalg.lstsq(jacobian, residual, rcond=None)[0]
        logs = logs + np.clip(step, -0.7, 0.7)
    return np.exp(logs)


def tune_randomised(
    gains: ArrayLike, draws: ArrayLike, trained: int
) -> tuple[np.ndarray, int, float]:
    """Return the gains that are best on randomised carts, and what they cost on carts not seen.

    Args:
        gains: rows (kp, kd) to choose from, shape (K, 2) [N/m, N s/m].
        draws: rows (mass, damping, delay in samples) of carts, shape (n, 3).
        trained: how many of them, from the first on, are for choosing.

    Returns:
        (mean cost of each row of gains (K,), the best row, its mean cost on the other carts).
    """
    dt, steps = 0.02, 100
    nominal = {"mass": 1.0, "damping": 0.2, "delay": 0.0}
    cart = dict(nominal)

    def rollout(kp: float, kd: float) -> float:
        x, v, cost = 1.0, 0.0, 0.0
        waiting = [0.0] * int(cart["delay"])
        for _ in range(steps):
            waiting.append(-kp * x - kd * v)
            force = waiting.pop(0)
            v += dt * (force - cart["damping"] * v) / cart["mass"]
            x += dt * v
            cost += dt * min(x * x, 1.0)
        return cost

    def mean_cost(kp: float, kd: float, carts: np.ndarray) -> float:
        costs = []
        for mass, damping, delay in carts:
            cart.update(mass=mass, damping=damping, delay=delay)
            costs.append(rollout(kp, kd))
            cart.update(nominal)
        return float(np.mean(costs))

    rows, carts = np.asarray(gains, dtype=float), np.asarray(draws, dtype=float)
    costs = np.array([mean_cost(kp, kd, carts[:trained]) for kp, kd in rows])
    best = int(np.argmin(costs))
    kp, kd = rows[best]
    return costs, best, mean_cost(kp, kd, carts[trained:])


def boundary_update(
    bounds: ArrayLike,
    centre: ArrayLike,
    outcomes: ArrayLike,
    thresholds: ArrayLike,
    step: ArrayLike,
) -> np.ndarray:
    """Return both ends of each range after their buffers are full.

    Args:
        bounds: low and high end of each range, shape (n, 2).
        centre: calibrated values, (n,).
        outcomes: success (1) or not (0) of the episodes on each end, shape (n, 2, m).
        thresholds: shares of success, (lower, upper).
        step: by which an end moves, (n,).

    Returns:
        New ends, (n, 2).
    """
    lower, upper = np.asarray(thresholds, dtype=float)
    ends, middle = np.asarray(bounds, dtype=float), np.asarray(centre, dtype=float)
    mean = np.mean(np.asarray(outcomes, dtype=float), axis=2)
    move = np.where(mean >= upper, 1.0, np.where(mean <= lower, -1.0, 0.0))
    moved = ends + move * np.asarray(step, dtype=float)[:, None] * [-1.0, 1.0]
    low, high = np.minimum(moved[:, 0], middle), np.maximum(moved[:, 1], middle)
    return np.column_stack((low, high))


def log_uniform(low: ArrayLike, high: ArrayLike, u: ArrayLike) -> np.ndarray:
    """Return log-uniform parameters from uniform numbers.

    Args:
        low, high: ends of each range, shape (n,), above 0.
        u: uniform numbers between 0 and 1, (m, n).

    Returns:
        Parameters of each episode, shape (m, n).
    """
    start, end = np.log(np.asarray(low, dtype=float)), np.log(np.asarray(high, dtype=float))
    share = np.asarray(u, dtype=float)
    return np.exp(start + share * (end - start))
