"""Ages out of a log: in order first, then with messages that overtake one another."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return logs of a camera; what perception takes is constant, then spread beyond the period."""

    def log(
        label: str,
        spread: float,
        level: str = "core",
        n: int = 12,
        shuffle: bool = False,
        early: float = 0.1,
    ) -> Case:
        captured = 0.033 * np.arange(n) + rng.uniform(0, 0.02)
        published = captured + 0.06 + spread * rng.random(n)
        order = rng.permutation(n) if shuffle else np.arange(n)
        times = rng.uniform(published.min() - early, captured.max() + 0.4, 24)
        return Case((captured[order], published[order], times), label, level)

    return [
        log("constant delay", 0.0, "simple", 4, early=0.0),
        log("a little jitter", 0.02, "simple", early=0.0),
        *(log("some jitter", 0.03) for _ in range(2)),
        *(log("messages overtake one another", 0.2) for _ in range(4)),
        *(log("in any order", 0.1, shuffle=True) for _ in range(3)),
        Case(
            (np.array([0.0, 0.1]), np.array([0.05, 0.15]), np.array([0.05, 0.15, 0.1])),
            "at the moment of arrival",
            "edge",
        ),
        Case(
            (np.array([0.0, 0.1]), np.array([0.05, 0.15]), np.array([0.01, -1.0])),
            "too early",
            "edge",
        ),
        Case((np.zeros(0), np.zeros(0), np.array([1.0])), "an empty log", "edge"),
        Case(
            (np.array([0, 2, 5]), np.array([4, 7, 6]), np.array([3, 5, 6, 8])),
            "whole seconds",
            "edge",
        ),
    ]


def over_time(figure: Any, shown: Shown) -> None:
    """Plot the ages over the time of reading."""
    axes, order = picture.plane(figure, "time [s]", "age [s]"), np.argsort(shown.args[2])
    for values, style in ((shown.got[0], picture.YOURS), (shown.expected[0], picture.RIGHT)):
        axes.plot(np.asarray(shown.args[2])[order], np.asarray(values)[order], ".-", **style)
    axes.legend()


_AGE = "now - captured[here].max()"
_HERE = "here = published <= now"
_LAST = "captured[here][np.argmax(published[here])]"

SLIPS = slips(
    from_publishing=(
        _AGE,
        "now - published[here].max()",
        "The age is counted from the time of publishing. A message is as old as the measurement in "
        "it: what perception took belongs to the age.",
    ),
    last_arrived=(
        _AGE,
        f"now - {_LAST}",
        "The message that arrived last is taken for the newest. One that was overtaken arrives "
        "late and holds older information.",
    ),
    last_in_the_list=(
        _AGE,
        "now - captured[here][-1]",
        "The last entry of the list is taken for the newest; the log is in no order.",
    ),
    from_the_future=(
        _HERE,
        "here = captured <= now",
        "Measurements count from their capture on. Nobody has them before they arrive.",
    ),
    strictly_before=(
        _HERE,
        "here = published < now",
        "A message that arrives at the moment of reading is left out.",
    ),
    oldest=(
        _AGE,
        "now - captured[here].min()",
        "The oldest message is taken, as from a queue that nobody empties.",
    ),
    zero_before=(
        "np.full(len(times), -1.0)",
        "np.zeros(len(times))",
        "Before the first message the age is given as 0, as fresh as can be. It is -1.",
    ),
    delay_of_the_message=(
        _AGE,
        f"published[here].max() - {_LAST}",
        "That is how long the message took. It goes on getting older until it is read.",
    ),
    sign=(
        _AGE,
        "captured[here].max() - now",
        "The ages are negative: time of reading minus time of capture.",
    ),
    age_at_its_arrival=(
        _AGE,
        "(published - captured)[here][np.argmax(captured[here])]",
        "That is the age that the newest information had when it arrived. It gets older until it "
        "is read: subtract the capture from the time of reading.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "one difference: rounding", explain=coarse),
    examples=(
        "log_age([0, 1], [0.5, 1.5], [0.2, 0.5, 1.4, 2])",
        "log_age([0, 1], [3, 2], [2.5, 3.5])",
    ),
    picture=over_time,
    slips=SLIPS
    + coarse_slips("log_age", "Times of a log are large numbers with small differences.")
    + value_slips("log_age", in_part=False, whole=False),
)
