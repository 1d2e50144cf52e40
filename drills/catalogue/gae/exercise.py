"""Advantages: one step and one episode, then ends and time limits in several environments."""

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return records in which every fourth row is the last of its episode, for either reason."""

    def record(
        label: str,
        level: str = "core",
        *,
        T: int = 12,
        N: int = 3,
        every: int = 4,
        ends: float = 0.5,
        gamma: float = 0.0,
        lam: float = 0.0,
    ) -> Case:
        last = (np.arange(T)[:, None] + np.arange(N)) % every == every - 1
        terminated = last & (rng.uniform(size=(T, N)) < ends)
        reward, value, following = rng.normal(size=(3, T, N)) + 1.0
        following[:-1] = np.where(last[:-1], following[:-1], value[1:])
        flags = terminated.astype(int), (last & ~terminated).astype(int)
        discounts = gamma or rng.uniform(0.8, 0.99), lam or rng.uniform(0.5, 0.97)
        return Case((reward, value, following, *flags, *discounts), label, level)

    whole = (
        np.array([[1], [2], [0]]),
        np.array([[1], [3], [2]]),
        np.array([[3], [4], [5]]),
        np.array([[0], [1], [0]]),
        np.array([[0], [0], [1]]),
        0.5,
        0.5,
    )
    return [
        record("one step", "simple", T=1, N=1),
        record("no end", "simple", N=1, every=99),
        record("no end, three environments", "simple", every=99),
        *(record("ends of an episode", ends=1.0) for _ in range(2)),
        *(record("time limits", ends=0.0) for _ in range(2)),
        *(record("ends and time limits", T=40, N=4) for _ in range(3)),
        record("lambda near 0", "edge", lam=1e-9),
        record("no discounts", "edge", gamma=1, lam=1),
        record("every step is the last", "edge", T=4, every=1),
        Case(whole, WHOLE, "edge"),
    ]


def advantages(figure: Any, shown: Shown) -> None:
    """Plot advantages of the first environment, and where its episodes end."""
    axes = picture.plane(figure, "step", "advantage, first environment")
    for (part, _), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(np.asarray(part)[:, 0], marker="o", ms=4, **style)
    for flags, name, ls in ((shown.args[3], "end", "-"), (shown.args[4], "time limit", ":")):
        for k, t in enumerate(np.flatnonzero(np.asarray(flags)[:, 0])):
            axes.axvline(t + 0.5, color="0.6", ls=ls, label=name if k == 0 else None)
    axes.legend()


_AHEAD, _STOP = "np.where(ended, 0.0, ahead)", "stop, trace, advantage = ended | cut"
_TRACE, _RETURN = "gamma * lam * trace", "return advantage, advantage + v"

SLIPS = slips(
    time_limit_taken_for_an_end=(
        _AHEAD,
        "np.where(ended | cut, 0.0, ahead)",
        "A time limit is treated as a termination, but the state that was reached keeps its "
        "value. Otherwise the critic learns that time is running out in states that do not show "
        "the time.",
    ),
    time_limit_ignored=(
        _STOP,
        "stop, trace, advantage = ended",
        "The sum continues across a time limit, so advantages of another episode enter.",
    ),
    next_episodes_value=(
        _AHEAD,
        "np.where(ended, 0.0, np.vstack((v[1:], ahead[-1:])))",
        "The value of the next row is used for the state after the step. After a time limit the "
        "next row begins another episode; `following` has the value of the state that was reached.",
    ),
    value_behind_an_end=(
        _AHEAD,
        "ahead",
        "The value after a termination is counted, but nothing comes after a termination.",
    ),
    ends_ignored=(
        _STOP,
        "stop, trace, advantage = ended & cut",
        "The sum never stops, so each episode is credited with all later episodes.",
    ),
    lambda_left_out=(
        _TRACE,
        "gamma * trace",
        "Lambda is missing: this is the estimate for lambda = 1.",
    ),
    discount_left_out_of_the_trace=(
        _TRACE,
        "lam * trace",
        "The later errors are not discounted: an error l steps ahead has the weight (gamma "
        "lambda)^l.",
    ),
    targets_without_the_value=(
        _RETURN,
        "return advantage, advantage",
        "The targets are the advantages. The critic learns values, so add its own value to each "
        "advantage.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "sums of some dozens of terms", explain=coarse),
    examples=(
        "gae([[1.0], [1.0]], [[0.0], [2.0]], [[2.0], [4.0]], [[0], [1]], [[0], [0]], 0.5, 0.5)",
        "gae([[1.0], [1.0]], [[0.0], [2.0]], [[2.0], [4.0]], [[0], [0]], [[0], [1]], 0.5, 0.5)",
    ),
    picture=advantages,
    slips=SLIPS
    + coarse_slips("gae", "Advantages are small differences of large values.")
    + value_slips("gae", swapped=True),
)
