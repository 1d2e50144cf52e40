"""Age of a chain: clocks only, then starts on arrival between them."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return chains of one to six stages, on clocks and on arrival."""

    def chain(label: str, clocks: str, level: str = "core") -> Case:
        """Return a letter a stage: c for a clock, a for on arrival."""
        periods = rng.uniform(0.01, 0.2, len(clocks)) * [letter == "c" for letter in clocks]
        return Case((rng.uniform(0.001, 0.009, len(clocks)), periods), label, level)

    return [
        chain("one clock", "c", "simple"),
        chain("two clocks", "cc", "simple"),
        *(chain("clocks only", "c" * n) for n in (3, 4, 6)),
        *(chain("all on arrival", "c" + "a" * n) for n in (1, 2, 4)),
        *(chain("mixed", text) for text in ("cac", "cca", "caca", "cacca", "caacac")),
        Case((np.array([1, 2, 1]), np.array([4, 9, 0])), WHOLE, "edge"),
        Case((np.array([0.045, 0.06, 0.0002]), np.array([1 / 30, 0.1, 0.001])), "a robot", "edge"),
    ]


def spans(figure: Any, shown: Shown) -> None:
    """Plot from the least to the greatest, the mean between: yours above, right below."""
    axes = picture.plane(figure, "age [s]", "")
    for y, values, style in (
        (1, shown.got[0], picture.YOURS),
        (0, shown.expected[0], picture.RIGHT),
    ):
        axes.plot(values, np.full(3, y), "o", **style | {"ls": "-"})
    axes.set(yticks=(0, 1), yticklabels=("right", "yours"), ylim=(-1, 2))


_OWN = "interval = T[i]"
_READ = "if i + 1 == len(C) or T[i + 1] > 0.0:"
_WAITS = "waits += interval"
_END = "np.array([least, least + waits / 2.0, least + waits])"

SLIPS = slips(
    executions_only=(
        _END,
        "np.array([least, least, least])",
        "That is the sum of the executions only, the least age. Clocks make information wait.",
    ),
    hold_forgotten=(
        _READ,
        "if i + 1 < len(C) and T[i + 1] > 0.0:",
        "The command is not held: it stays in force until the next one comes, and gets older.",
    ),
    consumers_period=(
        _READ,
        "if True:",
        _WAITS,
        "waits += T[i + 1] if i + 1 < len(C) else 0.0",
        "The reader's period is taken for its wait, and nothing for the hold. How old the newest "
        "value is depends on how often it is made: the producer's period.",
    ),
    both_ends_doubled=(
        "C.sum(), 0.0, 0.0",
        "C.sum(), T[0], 0.0",
        "The sensor's period counts twice: once for the event that waits for a capture, once for "
        "the result that waits for its reader. Age begins at the capture.",
    ),
    waits_on_arrival=(
        _READ,
        "if True:",
        "A stage that starts on arrival is made to wait as if it had a clock.",
    ),
    interval_not_carried=(
        _OWN,
        _OWN + "\n        else:\n            interval = 0.0",
        "A stage on arrival is taken to deliver all the time. It delivers as often as its input.",
    ),
    whole_period_in_the_mean=(
        _END,
        "np.array([least, least + waits, least + waits])",
        "The mean wait is given as a whole interval. It is spread evenly from 0: half of it.",
    ),
    greatest_is_the_mean=(
        _END,
        "np.array([least, least + waits / 2.0, least + waits / 2.0])",
        "The greatest age is given half an interval a wait: that is the mean.",
    ),
    periods_only=(
        _END,
        "np.array([0.0, waits / 2.0, waits])",
        "Only the waits are counted. The executions come on top, in all three.",
    ),
    waits_once_for_all=(
        _WAITS,
        "waits = max(waits, interval)",
        "Only the longest wait is counted. Each clock in the chain adds one.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: 1e-9 * float(truth[0].max()),
        "sums of a few numbers: rounding",
        explain=coarse,
    ),
    examples=(
        "chain_age([0.01], [0.1])",
        "chain_age([0.01, 0.02], [0.1, 0.05])",
        "chain_age([0.01, 0.02], [0.1, 0])",
    ),
    picture=spans,
    slips=SLIPS
    + coarse_slips("chain_age", "A microsecond is much in a loop at 1 kHz.")
    + value_slips("chain_age"),
)
