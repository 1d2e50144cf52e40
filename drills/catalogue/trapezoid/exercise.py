"""Trapezoid timing: values, and before them whether a limit is exceeded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Case, coarse, judge_of, largest_error
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return one joint, long and short ways; then several, of which each may be the slowest."""

    def line(
        label: str, n: int, size: float = 2.0, level: str = "core", fast: float = 1.0, idle: int = 0
    ) -> Case:
        """Return ways of up to `size`.

        `fast` scales the speeds, so that full speed is reached or not.
        """
        move = size * rng.uniform(0.3, 1.0, n) * rng.choice([-1.0, 1.0], n)
        move[:idle] = 0.0
        speed, acceleration = fast * rng.uniform(0.5, 2.0, n), rng.uniform(2.0, 9.0, n)
        start = rng.uniform(-1.0, 1.0, n)
        longest = float(np.max(np.abs(move) / speed) + np.max(speed / acceleration)) + 0.1
        times = np.concatenate(([0.0], rng.uniform(0.0, longest, 16), [1.1 * longest]))
        return Case((start, start + move, speed, acceleration, times), label, level)

    some = line("", 3).args
    return [
        line("one joint, a long way", 1, 6.0, "simple"),
        line("one joint, a short way", 1, 0.05, "simple"),
        line("two joints, a long way", 2, 6.0, "simple"),
        *(line("several joints, long ways", n, 5.0) for n in (2, 3, 6, 7)),
        *(line("several joints, short ways", n, 0.1) for n in (2, 4, 7)),
        *(line("several joints", n) for n in (3, 4, 6)),
        line("never at full speed", 3, fast=20.0),
        line("slow joints", 3, fast=0.05),
        line("a joint that stays", 3, 4.0, idle=1),
        line("one joint of six moves", 6, idle=5),
        Case((*some[:4], np.array([-1.0, -0.1, 0.2, 99.0])), "before and after", "edge"),
        Case((some[0], some[0].copy(), *some[2:]), "nothing to do", "edge"),
        Case((*some[:4], np.zeros(0)), "no time", "edge"),
        Case(
            (
                np.array([0, 1]),
                np.array([3, -4]),
                np.array([1, 2]),
                np.array([2, 3]),
                np.array([0, 1, 2, 5]),
            ),
            WHOLE,
            "edge",
        ),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return 1e-9, of values above 1 as much of them."""
    return [1e-9 * max(1.0, float(np.max(np.abs(value), initial=0.0))) for value in truth]


def held(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check whether a joint is too fast: said before the values."""
    speed = np.asarray(case.args[2], dtype=float)[:, None]
    if largest_error(parts[2], np.zeros((len(speed), len(case.args[4])))) == np.inf:
        return  # the comparison of the values says what is wrong with it
    largest = float(np.max(np.abs(parts[2]) / speed, initial=0.0))
    attempt.require(
        f"{case.label}: speeds",
        largest <= 1.0 + 1e-9,
        sentence=f"A joint goes at {largest:.4g} times its largest speed.",
        got=f"{largest:.6g}",
        expected="at most 1",
        call=call,
    )


def rates(figure: Any, shown: Shown) -> None:
    """Plot the rates of all joints over time."""
    axes, times = picture.plane(figure, "time [s]", "rate [rad/s]"), np.asarray(shown.args[4])
    order = np.argsort(times)
    for (_, _, rate), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        for i, row in enumerate(np.asarray(rate)):
            axes.plot(times[order], row[order], **style | ({} if i == 0 else {"label": None}))
    axes.legend()


_V, _A = "float(np.min(speed / size))", "float(np.min(acceleration / size))"
_SHORT = """    if v * ramp > 1.0:  # half way, before it is at full speed
        ramp = 1.0 / math.sqrt(a)
        v = a * ramp
"""
_DURATION = "duration = ramp + 1.0 / v"
_LAST = "1.0 - 0.5 * a * left**2"

SLIPS = slips(
    fastest_joint=(
        _V,
        _V.replace("min(", "max("),
        _A,
        _A.replace("min(", "max("),
        "The joint with the most slack sets the pace. It has to be the joint with the least: "
        "take the smallest of limit / |move|.",
    ),
    one_joint_for_both=(
        _A,
        "float((acceleration / size)[np.argmin(speed / size)])",
        "The acceleration limit is taken from the joint that limits the speed. Another joint "
        "may limit the acceleration, so take the two minima separately.",
    ),
    each_joint_alone=(
        _V,
        "(speed / size)[:, None]",
        _A,
        "(acceleration / size)[:, None]",
        _SHORT,
        "    v = a * (ramp := np.minimum(ramp, 1.0 / np.sqrt(a)))\n",
        "return duration,",
        "return float(np.max(duration)),",
        "Each joint is timed on its own, and the arm leaves the line. One share s moves all "
        "joints.",
    ),
    limits_as_they_are=(
        _V,
        "float(np.min(speed))",
        _A,
        "float(np.min(acceleration))",
        "The limits are not divided by the distances of their joints. s runs from 0 to 1, and a "
        "joint moves at |move| times the rate of s.",
    ),
    no_triangle=(
        "if v * ramp > 1.0:",
        "if False:",
        "A short motion has no stretch at full speed: the two ramps meet in the middle.",
    ),
    speed_kept_when_short=(
        "        v = a * ramp\n",
        "",
        "In a short motion full speed is never reached. Its peak is the acceleration times the "
        "ramp.",
    ),
    ramps_forgotten=(
        _DURATION,
        "duration = max(1.0 / v, 2.0 * ramp)",
        "The duration is that of a motion at full speed. The two ramps together add the time of "
        "one ramp.",
    ),
    ramps_on_top=(
        _DURATION,
        "duration = 2.0 * ramp + 1.0 / v",
        "The ramps also cover a part of the line, so the stretch at full speed is shorter by that.",
    ),
    end_not_mirrored=(
        _LAST,
        "0.5 * a * left**2",
        "The last ramp ends at the start. It is the first ramp mirrored: 1 - a (duration - t)^2 "
        "/ 2.",
    ),
    runs_on=(
        "t = np.clip(times, 0.0, duration)",
        "t = np.asarray(times)",
        "Before and after the motion the arm rests. Clip the times to the motion.",
    ),
    rate_of_the_share=(
        "move[:, None] * rate",
        "0.0 * move[:, None] + rate",
        "You return the rate of s. The rate of a joint is its move times the rate of s.",
    ),
    speed_over_the_longest_move=(
        "float(np.min(speed / size))",
        "float(np.min(np.asarray(speed, dtype=float)[move != 0.0]) / size.max())",
        "The smallest speed limit is divided by the longest move. They may belong to different "
        "joints: divide each joint's limit by its own move, and take the smallest result.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "a dozen operations: rounding", first=held, explain=coarse),
    examples=(
        "trapezoid([0], [3], [1], [2], [0, 0.5, 1, 5])",
        "trapezoid([0, 0], [0.1, -0.2], [1, 1], [5, 5], [0.1, 0.2])",
        "trapezoid([0, 1], [2, 1], [1, 1], [2, 2], [1])",
    ),
    picture=rates,
    slips=SLIPS
    + coarse_slips("trapezoid", "The path then no longer is the one that was checked.")
    + value_slips("trapezoid"),
)
