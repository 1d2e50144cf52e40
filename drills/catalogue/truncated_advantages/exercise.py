"""A flat buffer: one episode, ends, time limits, then all of them in any order."""

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return episodes of three to six steps; the first may have begun before the buffer did."""

    def buffer(
        label: str,
        level: str = "core",
        *,
        episodes: int = 5,
        ends: float = 0.5,
        goes_on: bool = True,
        begins: int = 1,
        gamma: float = 0.0,
        lam: float = 0.0,
        least: int = 3,
    ) -> Case:
        lengths = rng.integers(least, 2 * least + 1, episodes)
        starts, ended = np.zeros((2, lengths.sum()), dtype=int)
        starts[np.r_[0, np.cumsum(lengths)[:-1]]] = 1
        starts[0] = begins
        over = rng.random(episodes) < ends
        over[-1] = not goes_on
        ended[np.cumsum(lengths)[over] - 1] = 1
        reward, value = rng.normal(size=(2, len(starts))) + 1.0
        final = rng.normal(size=int(np.sum(~over[:-1]))) + 2.0
        discounts = gamma or rng.uniform(0.8, 0.99), lam or rng.uniform(0.5, 0.97)
        last = float(rng.normal()) + 2.0
        return Case((reward, value, starts, ended, final, last, *discounts), label, level)

    whole = (
        np.array([1, 2, 0, 1]),
        np.array([1, 3, 2, 2]),
        np.array([1, 0, 1, 0]),
        np.array([0, 0, 0, 0]),
        np.array([4]),
        2,
        0.5,
        0.5,
    )
    return [
        buffer("one episode that ends", "simple", episodes=1, goes_on=False),
        buffer("one episode that goes on", "simple", episodes=1),
        buffer("two episodes, the first ends", "simple", episodes=2, ends=1.0),
        *(buffer("ends", ends=1.0) for _ in range(2)),
        *(buffer("time limits", ends=0.0) for _ in range(2)),
        *(buffer("ends and time limits", episodes=9) for _ in range(3)),
        *(buffer("begun before", episodes=6, begins=0, goes_on=False) for _ in range(2)),
        buffer("lambda of 1", "edge", lam=1.0),
        buffer("no discounts", "edge", gamma=1, lam=1),
        buffer("episodes of a step or two", "edge", least=1),
        Case(whole, WHOLE, "edge"),
    ]


def advantages(figure: Any, shown: Shown) -> None:
    """Plot the advantages, and where episodes start."""
    axes = picture.plane(figure, "step", "advantage")
    for (part, _), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(np.asarray(part, dtype=float), marker="o", ms=4, **style)
    for t in np.flatnonzero(np.asarray(shown.args[2])[1:]):
        axes.axvline(t + 0.5, color="0.6", ls="-" if shown.args[3][t] else ":")
    axes.legend()


_OTHERS = "np.append(np.asarray(starts)[1:] != 0, True)"
_OVER = "np.where(over, 0.0, ahead)"
_FINAL = "ahead[:-1][cut] = np.asarray(final, dtype=float)"
_TRACE, _RETURN = "gamma * lam * np.where(others[t], 0.0, trace)", "return advantage, advantage + v"

SLIPS = slips(
    time_limit_taken_for_an_end=(
        _FINAL,
        "ahead[:-1][cut] = 0.0",
        "A time limit is taken for an end: the state that was reached keeps its value, the one in "
        "`final`. Else a reward of one for ever is worth as much as the limit allows.",
    ),
    next_episodes_value=(
        _FINAL,
        "pass",
        "After a time limit the value of the next row is taken: that is where another episode "
        "begins. The state that was reached is in `final`.",
    ),
    finals_backwards=(
        _FINAL,
        "ahead[:-1][cut] = np.asarray(final, dtype=float)[::-1]",
        "The final values are used from the last to the first. The recursion goes backwards, they "
        "are in the order of the rows.",
    ),
    flags_one_late=(
        _OTHERS,
        "np.append(np.asarray(starts)[:-1] != 0, True)",
        _FINAL,
        "ahead[:-1][np.append(np.asarray(starts)[1:], 0)[:-1].astype(bool) & ~over[:-1]] "
        "= np.asarray(final, dtype=float)",
        "The flags are one row off: `starts` marks the first row of an episode, and what has to "
        "stop the trace is the last row of the one before.",
    ),
    trace_across_episodes=(
        _TRACE,
        "gamma * lam * trace",
        "The trace runs on from one episode into the one before.",
    ),
    trace_across_time_limits=(
        _TRACE,
        "gamma * lam * np.where(over[t], 0.0, trace)",
        "The trace stops at ends only: across a time limit the advantages of another episode come "
        "in.",
    ),
    value_behind_an_end=(
        _OVER,
        "ahead",
        "A terminal state's value is counted: nothing comes after an end.",
    ),
    last_behind_an_end=(
        _OVER,
        "np.where(over & (np.arange(len(r)) < len(r) - 1), 0.0, ahead)",
        "The value `last` is also counted where the last row has ended its episode. No state "
        "follows a terminal one, so its value is 0.",
    ),
    value_ahead_not_discounted=(
        "delta = r + gamma * ",
        "delta = r + ",
        "The value of the next state is not discounted: the error is reward + gamma V(next) - V.",
    ),
    nothing_behind_the_buffer=(
        "np.append(v[1:], last)",
        "np.append(v[1:], 0.0)",
        "The buffer's end is taken for the episode's: the state behind the last row is worth "
        "`last`.",
    ),
    last_at_each_time_limit=(
        _FINAL,
        "ahead[:-1][cut] = last",
        "Each time limit is given the value behind the buffer's last row. They have their own, in "
        "`final`.",
    ),
    lambda_left_out=(
        _TRACE,
        _TRACE.replace(" * lam", ""),
        "Lambda is left out: this is the estimate for lambda 1.",
    ),
    discount_left_out_of_the_trace=(
        _TRACE,
        _TRACE.replace("gamma * ", ""),
        "The trace is not discounted: an error l steps ahead weighs (gamma lambda)^l.",
    ),
    targets_without_the_value=(
        _RETURN,
        "return advantage, advantage",
        "The targets are advantages. The critic should learn values: add its own to them.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-10, "sums of some dozens of terms", explain=coarse),
    examples=(
        "truncated_advantages([1, 1, 1], [0, 2, 2], [1, 0, 1], [0, 0, 0], [4], 2, 0.5, 0.5)",
        "truncated_advantages([1, 1, 1], [0, 2, 2], [1, 0, 1], [0, 1, 0], [], 2, 0.5, 0.5)",
    ),
    picture=advantages,
    slips=SLIPS
    + coarse_slips("truncated_advantages", "Advantages are small differences of large values.")
    + value_slips("truncated_advantages", swapped=True),
)
