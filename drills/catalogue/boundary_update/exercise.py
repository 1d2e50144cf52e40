"""Boundaries of automatic ranges: one range, several, and ends at the calibrated value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips

Array = NDArray[np.float64]
# Successes of 20 whose mean is at no threshold: 10 and 16 would be decided by rounding.
CLEAR = [wins for wins in range(21) if wins not in (10, 16)]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return buffers whose means are above, between, below and at the thresholds."""

    def ranges(
        label: str,
        level: str,
        wins: list[tuple[int, int]],
        *,
        m: int = 20,
        near: float = 1.0,
        shares: tuple[float, float] = (0.5, 0.8),
    ) -> Case:
        n = len(wins)
        centre, step = rng.normal(size=n), rng.uniform(0.1, 0.3, n)
        away = near * rng.uniform(0.5, 1.0, (n, 2)) * [-1.0, 1.0]
        outcomes = np.arange(m) < np.array(wins)[:, :, None]
        outcomes = rng.permuted(outcomes.astype(float), axis=2)
        args = centre[:, None] + away, centre, outcomes, np.array(shares), step
        return Case(args, label, level)

    whole = (
        np.array([[-2, 3], [1, 4]]),
        np.array([0, 2]),
        np.tile([1, 1, 0, 0], (2, 2, 1)),
        np.array([0, 1]),
        np.array([0.5, 1.25]),  # an answer that keeps the integers of the bounds cuts these off
    )
    whole[2][0, 0], whole[2][0, 1], whole[2][1, 1] = 1, 0, 1
    return [
        ranges("both ends pay", "simple", [(19, 18)]),
        ranges("neither", "simple", [(3, 6)]),
        ranges("between", "simple", [(12, 14)]),
        ranges("ends apart", "core", [(19, 4), (2, 17), (13, 19)]),
        *(
            ranges("several", "core", [tuple(rng.choice(CLEAR, 2).tolist()) for _ in range(6)])
            for _ in range(4)
        ),
        ranges("near the calibrated value", "core", [(3, 2), (19, 1), (5, 18)], near=0.1),
        # A mean of sixteenths is exact, however it is summed up.
        ranges("at a threshold", "edge", [(12, 8), (8, 12)], m=16, shares=(0.5, 0.75)),
        ranges("closed", "edge", [(2, 19), (18, 3)], near=0.0),
        ranges("one episode", "edge", [(1, 0), (0, 1)], m=1),
        Case(whole, WHOLE, "edge"),
    ]


_MEAN = "mean = np.mean(np.asarray(outcomes, dtype=float), axis=2)"
_MOVE = "np.where(mean >= upper, 1.0, np.where(mean <= lower, -1.0, 0.0))"
_LOW = "np.minimum(moved[:, 0], middle), np.maximum(moved[:, 1], middle)"

SLIPS = slips(
    one_buffer_for_all=(
        _MEAN,
        _MEAN.replace("axis=2)", "axis=(0, 1, 2), keepdims=True)[..., 0]"),
        "One buffer for all: an end that is too far is carried along by the others.",
    ),
    one_buffer_for_both_ends=(
        _MEAN,
        _MEAN.replace("axis=2)", "axis=(1, 2), keepdims=True)[..., 0]"),
        "Both ends of a range share a buffer: one that is too far is hidden by the other.",
    ),
    only_widens=(
        _MOVE,
        "np.where(mean >= upper, 1.0, 0.0)",
        "The ranges only widen. Where the policy fails an end has to come back.",
    ),
    last_value_for_mean=(
        _MEAN,
        "mean = np.asarray(outcomes, dtype=float)[:, :, -1]",
        "The last episode decides instead of the mean of the buffer: that is a coin.",
    ),
    thresholds_swapped=(
        "lower, upper = np",
        "upper, lower = np",
        "The thresholds are swapped: between them both rules hold.",
    ),
    past_the_calibrated_value=(
        _LOW,
        "moved[:, 0], moved[:, 1]",
        "An end goes past the calibrated value: the range no longer holds the arm that is known.",
    ),
    one_way=(
        "* [-1.0, 1.0]",
        "* [1.0, 1.0]",
        "Both ends move the same way: outward is down for the low end.",
    ),
    turned_round=(
        "* [-1.0, 1.0]",
        "* [1.0, -1.0]",
        "What should widen narrows: outward is down for the low end, up for the high one.",
    ),
    threshold_itself_left_out=(
        "mean >= upper",
        "mean > upper",
        "A mean at the upper threshold counts as enough.",
    ),
    lower_threshold_left_out=(
        "mean <= lower",
        "mean < lower",
        "A mean exactly at the lower threshold leaves the end where it is in your answer. It moves "
        "inward already there.",
    ),
    half_way_back=(
        "np.where(mean <= lower, -1.0, 0.0)",
        "np.where(mean < upper, -1.0, 0.0)",
        "Between the thresholds an end stays; yours comes back.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-12, "a sum of two numbers", explain=coarse),
    examples=(
        "boundary_update([[0.5, 1.5]], [1.0], [[[1, 1, 1, 1], [0, 1, 0, 0]]], [0.5, 0.8], [0.1])",
        "boundary_update([[0.9, 1.1]], [1.0], [[[0, 0], [0, 0]]], [0.5, 0.8], [0.2])",
    ),
    slips=SLIPS
    + coarse_slips("boundary_update", "Small steps then add up to another range.")
    + value_slips("boundary_update", in_part=False),
)
