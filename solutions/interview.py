"""Worked answers of chapter 12, the interview: complete, of the size of an interview."""

from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike


def success_interval(
    solved: ArrayLike, tried: ArrayLike, confidence: float, share: float, half: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Return Wilson's intervals of success rates, and the trials that make one narrow enough.

    Args:
        solved: how many trials worked, shape (n,).
        tried: of how many, (n,).
        confidence: of the two-sided interval, between 0 and 1.
        share: expected success rate.
        half: largest half width of its interval.

    Returns:
        (lower ends (n,), upper ends (n,), least number of trials).
    """
    square = NormalDist().inv_cdf(0.5 + confidence / 2.0) ** 2
    n = np.asarray(tried, dtype=float)
    p = np.asarray(solved, dtype=float) / n
    middle = (p + square / (2.0 * n)) / (1.0 + square / n)
    width = np.sqrt(square * (p * (1.0 - p) / n + square / (4.0 * n**2))) / (1.0 + square / n)

    def too_wide(trials: int) -> bool:
        spread = share * (1.0 - share)
        root = np.sqrt(square * (spread / trials + square / (4.0 * trials**2)))
        return bool(root > half * (1.0 + square / trials))

    high = 1
    while too_wide(high):
        high *= 2
    low = high // 2  # too wide, or no trial at all
    while high - low > 1:
        at = (low + high) // 2
        low, high = (at, high) if too_wide(at) else (low, at)
    return middle - width, middle + width, high


def stopping_distance(
    speeds: ArrayLike,
    reaction: float,
    braking: float,
    slope: float,
    person: float,
    unsure: float,
    sight: float,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return what a mobile robot needs to stop before a person who walks on towards it.

    Args:
        speeds: of the robot, shape (n,) [km/h].
        reaction: time until the brake acts [s].
        braking: deceleration on level ground [m/s^2].
        slope: of the ground, positive downhill [rad].
        person: speed towards the robot [m/s].
        unsure: by how much the scanner may measure too far [m].
        sight: from which the scanner sees the person [m].

    Returns:
        (way to a stand (n,) [m], gap at which the stop has to begin (n,) [m], highest speed at
        which the sight is enough [km/h], 0 for none).
    """
    v = np.asarray(speeds, dtype=float) / 3.6
    slowing = braking - 9.81 * np.sin(slope)
    distance = v * reaction + v**2 / (2.0 * slowing)
    time = reaction + v / slowing
    gap = distance + person * time + unsure
    # sight = v^2 / (2 a) + v (reaction + person / a) + person reaction + unsure, solved for v.
    linear = reaction + person / slowing
    left = sight - person * reaction - unsure
    top = 2.0 * left / (linear + np.sqrt(linear**2 + 2.0 * max(left, 0.0) / slowing))
    return distance, gap, max(3.6 * float(top), 0.0)


def latency_budget(
    edges: ArrayLike,
    runs: ArrayLike,
    periods: ArrayLike,
    sensor: int,
    actuator: int,
    allowed: float,
) -> tuple[float, np.ndarray]:
    """Return the worst latency of a graph of stages, and how much longer each of them may take.

    Args:
        edges: from stage, to stage, shape (m, 2); no loops.
        runs: measured execution times of each stage, (n, k) [s].
        periods: of its clock, (n,) [s]; 0 where it starts when its input arrives.
        sensor: stage where a chain begins.
        actuator: stage where it ends.
        allowed: latency [s].

    Returns:
        (worst latency from sensor to actuator [s], what is left for each stage (n,) [s]).
    """
    cost = np.asarray(runs, dtype=float).max(axis=1) + np.asarray(periods, dtype=float)
    links = np.asarray(edges, dtype=int).tolist()
    ahead, behind = np.full((2, len(cost)), -np.inf)
    ahead[sensor], behind[actuator] = cost[sensor], cost[actuator]
    for _ in range(len(cost)):  # the longest chain has no more edges than that
        for a, b in links:
            ahead[b] = max(ahead[b], ahead[a] + cost[b])
            behind[a] = max(behind[a], behind[b] + cost[a])
    through = ahead + behind - cost
    worst = through[sensor]
    return float(worst), allowed - np.where(np.isfinite(through), through, 0.0)


def truncated_advantages(
    reward: ArrayLike,
    value: ArrayLike,
    starts: ArrayLike,
    ended: ArrayLike,
    final: ArrayLike,
    last: float,
    gamma: float,
    lam: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return generalised advantages of a buffer of episodes, some cut off by a time limit.

    Args:
        reward: of each step, shape (n,).
        value: of the state in which it begins, (n,).
        starts: 1 where a step is the first of its episode, else 0, (n,).
        ended: 1 where the episode terminated with this step, else 0, (n,).
        final: values of the states in which time limits cut episodes off, in their order, (m,).
        last: value of the state that the last step led to.
        gamma: discount.
        lam: lambda, from 0 to 1.

    Returns:
        (advantages (n,), targets of the critic (n,)).
    """
    r, v = np.asarray(reward, dtype=float), np.asarray(value, dtype=float)
    over = np.asarray(ended) != 0
    others = np.append(np.asarray(starts)[1:] != 0, True)  # the next row is another episode's
    ahead = np.append(v[1:], last)
    cut = others[:-1] & ~over[:-1]
    ahead[:-1][cut] = np.asarray(final, dtype=float)
    delta = r + gamma * np.where(over, 0.0, ahead) - v
    advantage, trace = np.empty_like(r), 0.0
    for t in range(len(r) - 1, -1, -1):
        trace = delta[t] + gamma * lam * np.where(others[t], 0.0, trace)
        advantage[t] = trace
    return advantage, advantage + v


def catch_the_slip(
    turns: ArrayLike, rates: ArrayLike, moments: ArrayLike, step: float
) -> np.ndarray:
    """Return what is wrong with each of several implementations of a free body.

    Args:
        turns: attitudes that each gave, body to world, shape (k, n, 3, 3).
        rates: angular velocities that each gave, in the world's axes, (k, n, 3) [rad/s].
        moments: principal moments of each one's body, along its axes, (k, 3) [kg m^2].
        step: time between two samples [s].

    Returns:
        For each 1: an attitude is no rotation; else 2: the rates are not those of the attitudes;
        else 3: the motion is not free; else 0, (k,).
    """
    R, w = np.asarray(turns, dtype=float), np.asarray(rates, dtype=float)
    back = np.swapaxes(R, 2, 3)
    bent = np.abs(back @ R - np.eye(3)).max(axis=(1, 2, 3))
    with np.errstate(invalid="ignore"):
        mirrored = np.abs(np.linalg.det(R) - 1.0).max(axis=1)
    spin = np.gradient(R, step, axis=1, edge_order=2) @ back  # the rates as a matrix
    rate = np.stack([spin[:, :, 2, 1], spin[:, :, 0, 2], spin[:, :, 1, 0]], axis=2)
    late = np.abs(rate - w).max(axis=(1, 2))
    inertia = np.asarray(moments, dtype=float)[:, None]
    momentum = np.einsum("knij,knj->kni", R, inertia * np.einsum("knji,knj->kni", R, w))
    drift = np.linalg.norm(momentum - momentum[:, :1], axis=2).max(axis=1)
    drift = drift / np.linalg.norm(momentum[:, 0], axis=1)
    # "Not within" and not "beyond": a number that is none compares as neither.
    passed = [np.maximum(bent, mirrored) < 1e-4, late < 0.25, drift < 1e-3]
    return np.select([~one for one in passed], [1, 2, 3], 0)


def silent_gate(
    seeds: ArrayLike,
    outcomes: ArrayLike,
    old_seeds: ArrayLike,
    old_outcomes: ArrayLike,
    gate: float,
) -> tuple[float, np.ndarray, int]:
    """Return what a nightly run says of a new version, beside the night before.

    Args:
        seeds: of the scenarios, in the order of the runs; one that comes again is a retry, (n,).
        outcomes: 1 for a success, 0 for a failure, -1 for a run that crashed, (n,).
        old_seeds: of the night before, (m,).
        old_outcomes: of these, (m,).
        gate: success rate that has to be shown.

    Returns:
        (lower end of Wilson's 95 % interval of the success rate, [scenarios that only the new
        version solves, those that only the old one does] (2,), 1 if the gate opens, else 0).
    """

    def first(names: ArrayLike, results: ArrayLike) -> dict[int, bool]:
        table: dict[int, bool] = {}
        for name, result in zip(np.asarray(names), np.asarray(results), strict=True):
            table.setdefault(int(name), bool(result == 1))
        return table

    new, old = first(seeds, outcomes), first(old_seeds, old_outcomes)
    n, square = len(new), 1.959963984540054**2
    p = sum(new.values()) / n
    width = np.sqrt(square * (p * (1.0 - p) / n + square / (4.0 * n**2)))
    low = float((p + square / (2.0 * n) - width) / (1.0 + square / n))
    both = [(new[seed], old[seed]) for seed in new if seed in old]
    tally = np.array([both.count((True, False)), both.count((False, True))])
    return low, tally, int(low >= gate)


def tip_resolution(
    counts: ArrayLike, ratio: ArrayLike, reach: ArrayLike
) -> tuple[np.ndarray, float]:
    """Return how far the tip moves for one encoder count of each joint, and of all together.

    Args:
        counts: per turn of each motor, shape (n,).
        ratio: turns of the motor for one of the joint, (n,).
        reach: distance of the tip from each axis, (n,) [m].

    Returns:
        (motion for one count of each joint (n,) [mm], largest motion for one count of all [mm]).
    """
    angle = 2.0 * np.pi / (np.asarray(counts, dtype=float) * np.asarray(ratio))
    each = 1e3 * angle * np.asarray(reach)
    return each, float(each.sum())
