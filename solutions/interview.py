"""Worked answers of chapter 12, the interview: complete, of the size of an interview."""

from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike


def success_interval(
    solved: ArrayLike, tried: ArrayLike, confidence: float, share: float, half: float
) -> tuple[np.ndarray, np.ndarray, int]:
    """Wilson's intervals of success rates, and the trials that make one narrow enough.

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
    speeds: ArrayLike, reaction: float, braking: float, slope: float, person: float,
    unsure: float, sight: float,
) -> tuple[np.ndarray, np.ndarray, float]:  # fmt: skip
    """What a mobile robot needs to stop before a person who walks on towards it.

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
    way = v * reaction + v**2 / (2.0 * slowing)
    time = reaction + v / slowing
    gap = way + person * time + unsure
    # sight = v^2 / (2 a) + v (reaction + person / a) + person reaction + unsure, solved for v.
    linear = reaction + person / slowing
    left = sight - person * reaction - unsure
    top = 2.0 * left / (linear + np.sqrt(linear**2 + 2.0 * max(left, 0.0) / slowing))
    return way, gap, max(3.6 * float(top), 0.0)
