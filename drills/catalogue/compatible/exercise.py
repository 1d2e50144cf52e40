"""Which policies fail: pairs that differ in one, in both directions, then in everything."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown

TIMES = (0.01, 0.05, 0.1, 0.5, 2.0)
VALUES = ((0, 1), (0, 1, 2, 3), TIMES, (0, 1, 2), TIMES, (0, 1), (0, 1))
NAMES = ("reliability", "durability", "deadline", "liveliness", "lease", "order", "ownership")


def cases(rng: np.random.Generator) -> list[Case]:
    """Return pairs of profiles: one policy at a time, without times, then all drawn."""

    def drawn() -> list[float]:
        return [float(rng.choice(values)) for values in VALUES]

    def empty(profile: list[float], place: int) -> list[float]:
        return [*profile[:place], 0.0, *profile[place + 1 :]]

    def pair(label: str, a: list[float], b: list[float], level: str = "core") -> Case:
        return Case((np.array(a), np.array(b)), label, level)

    same, result = drawn(), []
    for i, name in enumerate(NAMES):
        low, high = drawn(), []
        low[i], other = sorted(rng.choice(VALUES[i], 2, replace=False).tolist())
        high = [*low[:i], other, *low[i + 1 :]]
        result += [pair(f"{name} lower", low, high), pair(f"{name} higher", high, low)]
    for i in (2, 4):
        with_time = drawn()
        result += [
            pair(f"no {NAMES[i]} offered", empty(with_time, i), with_time),
            pair(f"no {NAMES[i]} requested", with_time, empty(with_time, i)),
        ]
    bare = empty(empty(drawn(), 2), 4)
    return [
        pair("the same", same, same, "simple"),
        *result,
        *(pair("all drawn", drawn(), drawn()) for _ in range(8)),
        pair("no times at all", bare, bare, "edge"),
        Case((np.array([0, 1, 0, 2, 3, 1, 0]), np.array([1, 0, 2, 1, 2, 1, 1])), WHOLE, "edge"),
    ]


def flags(figure: Any, shown: Shown) -> None:
    """Plot what fails, policy by policy."""
    axes = picture.plane(figure, "policy", "fails")
    for (failing,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(np.asarray(failing, dtype=float), "o", **style | {"ls": "-"})
    axes.set_xticks(range(6), ("reliability", "durability", "deadline", "lively", "order", "owner"))
    axes.legend()


_RANK = "less, more = offer < wish, offer > wish"
_LIVELY = "lively = less[3] or more[4]"
_UNLIKE = "unlike = offer[6] != wish[6]"
_NONE = "for profile in (offer, wish):"
_RETURN = "return np.array([less[0]"

SLIPS = slips(
    symmetric=(
        _RANK,
        "less = more = offer != wish",
        "Every difference is treated as incompatible. Only one direction fails: a writer may "
        "offer more than the reader requests.",
    ),
    reader_and_writer_swapped=(
        _RANK,
        "less, more = wish < offer, wish > offer",
        "Offered and requested are swapped: a best-effort writer is accepted for a reliable "
        "reader, and a reliable writer is rejected for a best-effort reader.",
    ),
    deadline_reversed=(
        "more[2]",
        "less[2]",
        "more[4]",
        "less[4]",
        "Deadline and lease are ranked like the others. A shorter time is the stronger promise.",
    ),
    deadline_alone_reversed=(
        "more[2]",
        "less[2]",
        "The deadline is compared in the wrong direction. The writer promises a message at least "
        "that often, so it fails if its time is longer than the reader's.",
    ),
    lease_reversed=(
        "more[4]",
        "less[4]",
        "The lease is compared in the wrong direction: a writer may prove that it is alive more "
        "often than requested.",
    ),
    none_taken_as_zero=(
        _NONE,
        "for profile in ():",
        "A time of 0 is compared as a number. It means none, so it is the longest of all: a "
        "writer without a deadline fails every requested one.",
    ),
    none_offered_passes=(
        _NONE,
        "for profile in (wish,):",
        "A writer without a deadline is accepted for a reader that requests one.",
    ),
    none_requested_fails=(
        _NONE,
        "for profile in (offer,):",
        "A reader without a deadline rejects every writer that has one.",
    ),
    lease_forgotten=(
        _LIVELY,
        "lively = less[3]",
        "The lease is not compared. Liveliness is a kind and a time, and either of them can fail.",
    ),
    kind_forgotten=(
        _LIVELY,
        "lively = more[4]",
        "Only the lease is compared. Liveliness also fails if its kind ranks below the requested "
        "one.",
    ),
    both_must_fail=(
        _LIVELY,
        "lively = less[3] and more[4]",
        "Liveliness is accepted unless kind and lease both fail. One failure is enough.",
    ),
    equal_fails=(
        _RANK,
        "less, more = offer < wish, offer >= wish",
        "Equal times are rejected. A writer that offers exactly what is requested is compatible.",
    ),
    ownership_ranked=(
        _UNLIKE,
        "unlike = less[6]",
        "Ownership is ranked here. It has no ranking: both ends must be equal.",
    ),
    ownership_ignored=(
        _UNLIKE,
        "unlike = False",
        "Ownership never fails here. It must be equal at both ends.",
    ),
    ones_for_what_fits=(
        _RETURN,
        "return 1 - np.array([less[0]",
        "The answer is 1 for policies that are compatible. It must be 1 for those that fail.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "zeros and ones"),
    examples=(
        "compatible([1, 0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0])",
        "compatible([0, 0, 0.1, 0, 0, 0, 0], [1, 1, 0.05, 0, 0, 0, 0])",
    ),
    picture=flags,
    slips=SLIPS + value_slips("compatible", whole=False),
)
