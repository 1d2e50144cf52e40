"""Worked answers of chapter 11, the whole pipeline: complete, of interview size."""

import math
from itertools import combinations

import numpy as np
from numpy.typing import ArrayLike


def error_budget(errors: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return who owns how much of an error, from runs with every set of stages at fault.

    Args:
        errors: at the end of each run [m], shape (2^k, n, 2); in row s stage i is real where bit i
            of s is set, else ideal.

    Returns:
        (signed part of the mean error of each stage (k, 2) [m], its share of the mean squared error
        (k,) [m^2], the mean squared error with that stage alone mended (k,) [m^2]).
    """
    e = np.asarray(errors, dtype=float)
    square = np.mean(np.sum(e**2, axis=2), axis=1)
    values = np.column_stack((np.mean(e, axis=1), square))
    k = len(e).bit_length() - 1
    parts = np.zeros((k, 3))
    for i in range(k):
        for s in range(len(e)):
            if not s >> i & 1:
                weight = 1.0 / (k * math.comb(k - 1, s.bit_count()))
                parts[i] += weight * (values[s | 1 << i] - values[s])
    mended = [square[-1 - (1 << i)] for i in range(k)]
    return parts[:, :2], parts[:, 2], np.array(mended)


def to_the_present(
    states: ArrayLike,
    covariances: ArrayLike,
    captured: ArrayLike,
    arrived: ArrayLike,
    now: float,
    noise: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the newest estimate of a moving target, carried forward to now.

    Args:
        states: (x, y, vx, vy) of each message, shape (n, 4) [m, m/s].
        covariances: of these, (n, 4, 4).
        captured, arrived: stamps of each message, (n,) [s].
        now: when it is needed [s].
        noise: density of the target's unknown acceleration, the same along x and y [m^2/s^3].

    Returns:
        (state (4,), covariance (4, 4)) at that time.
    """
    stamps = np.asarray(captured, dtype=float)
    here = np.flatnonzero(np.asarray(arrived) <= now)
    newest = here[np.argmax(stamps[here])]
    age = now - stamps[newest]
    F = np.eye(4) + age * np.eye(4, k=2)
    growth = noise * np.array([[age**3 / 3.0, age**2 / 2.0], [age**2 / 2.0, age]])
    P = F @ np.asarray(covariances, dtype=float)[newest] @ F.T + np.kron(growth, np.eye(2))
    return F @ np.asarray(states, dtype=float)[newest], P


def step_limit(
    inertia: ArrayLike, elbow: ArrayLike, kp: float, kd: float, damping: float
) -> np.ndarray:
    """Return the largest stable step of a two-link arm that a PD law holds, at each posture.

    Args:
        inertia: a, b, d of the arm's mass matrix [kg m^2].
        elbow: angles of the second joint, (n,) [rad].
        kp, kd: gains of both joints [N m/rad, N m s/rad].
        damping: viscous, of both joints [N m s/rad].

    Returns:
        Below each of these steps [s] semi-implicit Euler is stable, (n,).
    """
    a, b, d = np.asarray(inertia, dtype=float)
    bend = np.cos(np.asarray(elbow, dtype=float))
    M = np.array([[a + 2.0 * b * bend, d + b * bend], [d + b * bend, d + 0.0 * bend]])
    quickest = 1.0 / np.linalg.eigvalsh(np.moveaxis(M, 2, 0))[:, 0]
    stiffness, drag = kp * quickest, (kd + damping) * quickest
    return np.asarray(4.0 / (np.sqrt(drag**2 + 4.0 * stiffness) + drag))


def visual_gain(gain: float, delay: int) -> tuple[float, float]:
    """Return the largest stable gain for feedback from delayed images, and the resulting variance.

    Args:
        gain: part of the error seen that is corrected at each frame.
        delay: age of the picture in frames, a whole number from 0 on.

    Returns:
        (gain below which it settles, variance of the place over that of a picture; -1 where it
        does not settle).
    """
    limit = 2.0 * math.sin(math.pi / (2.0 * (2.0 * delay + 1.0)))
    if not 0.0 < gain < limit:
        return limit, -1.0
    n = delay + 1  # the place now and those that the pictures under way have seen
    A = np.eye(n, k=-1)
    A[0, 0] += 1.0
    A[0, -1] -= gain
    pushed = np.zeros(n * n)
    pushed[0] = gain**2
    covariance = np.linalg.solve(np.eye(n * n) - np.kron(A, A), pushed)
    return limit, float(covariance[0])


def which_stage(
    record: ArrayLike, limits: ArrayLike, errors: ArrayLike, tolerance: float
) -> tuple[int, np.ndarray]:
    """Return the first contract that a failed run broke, and the fewest stages whose fix cures it.

    Args:
        record: what each contract bounds, at each tick, shape (m, n); the upstream one first.
        limits: largest value that each allows, (m,).
        errors: of replays with the same seed, (2^k,) [m]; in entry s stage i is mended where bit i
            of s is set.
        tolerance: largest error of a success [m].

    Returns:
        (number of the contract or -1, 1 for each stage to mend, else 0 (k,)).
    """
    broken = np.asarray(record) > np.asarray(limits)[:, None]
    ticks = np.where(broken.any(axis=1), broken.argmax(axis=1), broken.shape[1])
    contract = int(np.argmin(ticks)) if broken.any() else -1
    left = np.asarray(errors, dtype=float)
    stages = left.size.bit_length() - 1
    cure = np.zeros(stages, dtype=int)
    for size in (1, 2):
        tried = [list(group) for group in combinations(range(stages), size)]
        best = min(tried, key=lambda group: left[sum(1 << i for i in group)])
        if left[sum(1 << i for i in best)] <= tolerance:
            cure[best] = 1
            break
    return contract, cure


def rescale_step(
    rewards: ArrayLike, once: ArrayLike, gamma: float, steps: int, dt: float, new: float
) -> tuple[np.ndarray, float, int]:
    """Return the same task for an agent that steps at another rate.

    Args:
        rewards: terms of the reward, (m,).
        once: 1 for a term that an event pays, 0 for one that every step pays, (m,).
        gamma: discount per step, in (0, 1].
        steps: time limit in steps.
        dt, new: old and new step [s].

    Returns:
        (rewards (m,), discount, time limit in steps), all for the new step.
    """
    part = new / dt
    factor = part
    if gamma < 1.0:
        factor = (1.0 - gamma**part) / (1.0 - gamma)
    scaled = np.asarray(rewards, dtype=float) * np.where(np.asarray(once) != 0, 1.0, factor)
    return scaled, gamma**part, round(steps / part)


def reach_target(
    frames: ArrayLike,
    noise: float,
    calibration: ArrayLike,
    drift: ArrayLike,
    start: ArrayLike,
    ticks: ArrayLike,
) -> np.ndarray:
    """Return where the tip is told to be, for a target on a belt that a camera sees late.

    Args:
        frames: rows (captured, arrived, x, y) in both orders of time, shape (n, 4) [s, m].
        noise: standard deviation of x and of y [mm].
        calibration: [R, t] of the camera in the base, shape (2, 3), t in m.
        drift: velocity of the belt in the base, (2,) [m/s].
        start: where the tip is told to wait, (2,) [m].
        ticks: times of the controller, rising, (m,) [s].

    Returns:
        Reference at each tick in the base, shape (m, 2) [m].
    """
    rows, camera = np.asarray(frames, dtype=float), np.asarray(calibration, dtype=float)
    R, t, belt = camera[:, :2], camera[:, 2], np.asarray(drift, dtype=float)
    seconds, command = 1.0, np.array(start, dtype=float)
    origin = goal = command
    began, reference = -math.inf, np.zeros((len(np.asarray(ticks)), 2))
    for i, now in enumerate(np.asarray(ticks, dtype=float)):
        recent = rows[rows[:, 1] <= now][-5:]
        if len(recent):
            ages = now - recent[:, :1]
            target = np.mean(recent[:, 2:] @ R.T + t + ages * belt, axis=0)
            lost = math.inf
            if began > -math.inf:
                lost = math.dist(target, goal + (now - began - seconds) * belt)
            if lost > 3.0 * 1e-3 * noise:
                origin, began = command, now
                goal = target + seconds * belt
            share = min((now - began) / seconds, 1.0)
            beyond = max(now - began - seconds, 0.0)
            command = origin + share**2 * (3.0 - 2.0 * share) * (goal - origin) + beyond * belt
        reference[i] = command
    return reference


def throughput(stages: ArrayLike, workers: ArrayLike) -> tuple[float, float, int]:
    """Return latency, throughput and bottleneck of a pipeline.

    Args:
        stages: time of each stage for one image, shape (n,) [s].
        workers: images that it can work on at the same time, (n,).

    Returns:
        (latency [s], rate [1/s], number of the stage that sets it).
    """
    times = np.asarray(stages, dtype=float)
    rates = np.asarray(workers) / times
    slowest = int(np.argmin(rates))
    return float(times.sum()), float(rates[slowest]), slowest
