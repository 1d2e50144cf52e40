"""A loop that is on time, one that is late, and one that overruns; ends exactly on the grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return loops at 1 kHz and others, whose work takes a stated part of the period."""

    def loop(
        label: str,
        level: str = "core",
        *,
        part: float = 0.3,
        late: float = 0.1,
        long: float = 0.0,
        n: int = 30,
        step: int = 1,
    ) -> Case:
        period = 1000 * int(rng.choice([250, 1000, 2000, 5000]))
        start = int(rng.integers(0, 10**12))
        lateness = (period * rng.uniform(0.0, late, n)).astype(int) // step * step
        work = (period * part * rng.uniform(0.5, 1.5, n)).astype(int) // step * step
        if long:
            overruns = rng.choice(n - 2, 3, replace=False)
            work[overruns] = (period * (long + rng.uniform(0.1, 2.8, 3))).astype(int)
        return Case((start, period, lateness, work), label, level)

    def exact() -> Case:
        """Return cycles that end at a time of the grid, and a nanosecond to each side of it."""
        period, turns = 1_000_000, rng.integers(1, 4, 24)
        late = rng.integers(0, 200_000, 24)
        return Case(
            (500, period, late, turns * period - late + np.tile([0, -1, 1], 8)),
            "ends on the grid",
            "edge",
        )

    return [
        loop("work alone", "simple", late=1e-9),
        loop("late and working", "simple"),
        *(loop("a long cycle", long=1.0) for _ in range(3)),
        *(loop("very late", late=1.5) for _ in range(2)),
        loop("hardly fits", part=0.65, late=0.3),
        loop("always too long", part=1.6),
        loop("many periods", long=20.0),
        exact(),
        loop("one cycle", "edge", n=1),
        Case((0, 5, np.array([0, 1, 0]), np.array([12, 4, 1])), WHOLE, "edge"),
    ]


def against_grid(figure: Any, shown: Shown) -> None:
    """Plot how far what was asked for is from a loop that is never late, in periods."""
    start, period = shown.args[:2]
    axes = picture.plane(figure, "cycle", "asked for, less cycle times period [periods]")
    for (requested, _), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        turns = (np.asarray(requested, dtype=float) - start) / period
        axes.plot(turns - np.arange(len(turns)), "o", **style | {"ls": "-"})
    axes.legend()


_ASKED = "requested[i] = start + turn * period"
_DONE = "done = requested[i] + lateness[i] + works[i]"
_LATER = "later = max(turn + 1, -((start - done) // period))"
_SKIPPED = "skipped[i] = later - turn - 1"

SLIPS = slips(
    drift=(
        _ASKED,
        "requested[i] = start if i == 0 else done + period",
        _SKIPPED,
        "skipped[i] = 0",
        "The loop sleeps for a period after its work, so every cycle takes a period plus its work "
        "and lateness. Sleep until a time on the grid.",
    ),
    drift_from_waking=(
        _ASKED,
        "requested[i] = start if i == 0 else requested[i - 1] + lateness[i - 1] + period",
        _SKIPPED,
        "skipped[i] = 0",
        "The next time counts from when the cycle really began, so every lateness moves all later "
        "cycles.",
    ),
    bursts=(
        _LATER,
        "later = turn + 1",
        "No period is ever skipped: after a long cycle the loop runs without a pause until it has "
        "caught up.",
    ),
    lost_phase=(
        _ASKED,
        "requested[i] = start if i == 0 else max(requested[i - 1] + period, done)",
        "After an overrun the loop continues at once, off its grid. So its phase relative to "
        "other loops is lost.",
    ),
    lost_phase_and_a_period=(
        _ASKED,
        "requested[i] = start if i == 0 else (requested[i - 1] + period if "
        "done <= requested[i - 1] + period else done + period)",
        "After an overrun a new grid starts at the current time. Only whole periods may be "
        "skipped.",
    ),
    always_one_skipped=(
        _LATER,
        "later = turn + 1 + (done > requested[i] + period)",
        "Exactly one period is skipped for an overrun, however long it was.",
    ),
    just_now_is_too_late=(
        _LATER,
        "later = max(turn + 1, (done - start) // period + 1)",
        "A grid time that equals the current time is skipped. It has not passed.",
    ),
    lateness_forgotten=(
        _DONE,
        "done = requested[i] + works[i]",
        "The cycle is assumed to begin at its requested time. It ends later by its lateness, "
        "which may cost a period.",
    ),
    work_forgotten=(
        _DONE,
        "done = requested[i] + lateness[i]",
        "Passed times are determined at the beginning of the cycle. They must be determined at "
        "its end, after the work.",
    ),
    nearest=(
        _LATER,
        "later = max(turn + 1, round((done - start) / period))",
        "The nearest grid time is requested, and it may have passed.",
    ),
    one_skipped_too_many=(
        _SKIPPED,
        "skipped[i] = later - turn",
        "The step to the next period is counted as skipped.",
    ),
    skipped_in_all=(
        _SKIPPED,
        "skipped[i] = later - 1 - i",
        "The skipped periods are added up. Return those right after each cycle.",
    ),
    skipped_before=(
        "return requested, skipped",
        "return requested, np.roll(skipped, 1)",
        "The skipped periods stand with the cycle after them. They belong to the one that was too "
        "long.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "whole numbers"),
    examples=(
        "wake_ups(0, 10, [1, 1, 1], [3, 3, 3])",
        "wake_ups(100, 10, [0, 0, 0, 0], [4, 25, 4, 4])",
    ),
    picture=against_grid,
    slips=SLIPS + value_slips("wake_ups", swapped=True, whole=False),
)
