"""Response times: two tasks, then sets near what the processor can do, with blocking and ties."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return sets of tasks that use a stated part of the processor."""

    def tasks(
        label: str,
        level: str = "core",
        *,
        n: int = 5,
        load: float = 0.85,
        held: float = 0,
        early: float = 1.0,
        by_rate: bool = True,
        round_to: int = 1,
    ) -> Case:
        periods = np.rint(10.0 ** rng.uniform(3.0, 4.3, n) / round_to).astype(int) * round_to
        if by_rate:
            periods.sort()
        parts = load * rng.dirichlet(np.full(n, 2.0))
        executions = np.maximum(np.rint(parts * periods / round_to), 1.0).astype(int) * round_to
        deadlines = np.maximum((early * periods).astype(int), executions)
        blocking = np.rint(held * periods.min() * rng.uniform(0.5, 1.0, n)).astype(int)
        blocking[-1] = 0  # nobody is less important
        return Case((executions, periods, deadlines, blocking), label, level)

    ties = np.array([2, 2, 4]), np.array([4, 8, 16]), np.array([4, 8, 16]), np.array([0, 0, 0])
    over = np.array([3, 3, 3, 1]), np.array([5, 8, 12, 100]), np.array([5, 8, 12, 100])
    early = np.array([2, 3, 1]), np.array([10, 20, 100]), np.array([10, 4, 100])
    return [
        tasks("one task", "simple", n=1),
        tasks("two, hardly busy", "simple", n=2, load=0.4),
        tasks("three", "simple", n=3, load=0.6),
        *(tasks("busy") for _ in range(3)),
        *(tasks("nearly full", load=0.97) for _ in range(2)),
        *(tasks("a shared resource", load=0.7, held=0.3) for _ in range(3)),
        *(tasks("early deadlines", early=0.6) for _ in range(2)),
        *(tasks("not by rate", by_rate=False, load=0.6) for _ in range(2)),
        *(tasks("round numbers", round_to=500, load=0.8) for _ in range(2)),
        Case(ties, "a release at the end", "edge"),
        Case((*over, np.zeros(4, int)), "too much", "edge"),
        Case((*early, np.zeros(3, int)), "only the middle one is late", "edge"),
        tasks("ten tasks", "edge", n=10, held=0.05),
        Case(
            (np.array([1, 2]), np.array([3, 6]), np.array([3, 6]), np.array([2, 0])), WHOLE, "edge"
        ),
    ]


def bars(figure: Any, shown: Shown) -> None:
    """Plot each task's response, and the deadline above it."""
    axes = picture.plane(figure, "task", "response time [us]")
    axes.plot(np.asarray(shown.args[2]), "_", color="0.5", ms=14, label="deadline")
    for (values,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(np.asarray(values, dtype=float), "o", **style | {"ls": "-"})
    axes.legend()


_RELEASES = "releases = -(-before // T[:i])"
_SUM = "response = C[i] + B[i] + releases @ C[:i]"
_WHILE = "while before < response <= D[i]:"
_MET = "        if response <= D[i]:\n            times[i] = response\n"

SLIPS = slips(
    floor_for_ceiling=(
        _RELEASES,
        "releases = before // T[:i]",
        "Releases are rounded down. Each of the other tasks is also released at the start of the "
        "window: round up.",
    ),
    one_release_too_many=(
        _RELEASES,
        "releases = before // T[:i] + 1",
        "A release exactly at the end of the task is counted. It comes too late to delay the "
        "task: use ceil, not floor plus one.",
    ),
    own_task_left_out=(
        _SUM,
        "response = B[i] + releases @ C[:i]",
        "The task's own execution time is missing: this is how long it waits, not when it ends.",
    ),
    lower_priorities_counted=(
        _RELEASES,
        "releases = np.where(np.arange(len(C)) == i, 0, -(-before // T))",
        _SUM,
        "response = C[i] + B[i] + releases @ C",
        "The less important tasks are counted. They are interrupted, so only their blocking "
        "counts.",
    ),
    utilisation_test_only=(
        _MET,
        """        n = i + 1
        if np.sum(C[:n] / T[:n]) <= n * (2.0 ** (1.0 / n) - 1.0):
            times[i] = response
""",
        "A task is rejected because the utilization is above n (2^(1/n) - 1). That bound is "
        "sufficient and not necessary: above it, compute the response time.",
    ),
    full_processor_test=(
        _MET,
        """        if np.sum(C[: i + 1] / T[: i + 1]) <= 1.0:
            times[i] = min(response, D[i])
""",
        "A utilization below 1 is taken as sufficient. With fixed priorities a deadline may still "
        "be missed: compare the response time.",
    ),
    not_repeated=(
        _WHILE,
        "for before in (C[i] + B[i],):",
        "There is only one iteration. The more important tasks are released again while the "
        "window grows: repeat until it does not change.",
    ),
    all_once=(
        _RELEASES,
        "releases = np.ones(i, dtype=int)",
        "Each of the other tasks is counted once. A fast one is released several times while a "
        "slow one waits.",
    ),
    blocking_forgotten=(
        _SUM,
        "response = C[i] + releases @ C[:i]",
        "C[i] + B[i]\n",
        "C[i]\n",
        "The blocking is missing: a less important task that holds a lock can make this one wait.",
    ),
    blocking_at_every_release=(
        _SUM,
        "response = C[i] + B[i] + releases @ (C[:i] + B[:i])",
        "The blocking of the other tasks is added. Only this task's own entry counts, once.",
    ),
    deadline_is_the_period=(
        "np.asarray(x, dtype=int) for x in (executions, periods, deadlines,",
        "np.asarray(x, dtype=int) for x in (executions, periods, periods,",
        "The period is used as the deadline, which may be earlier.",
    ),
    strictly_before=(
        "if response <= D[i]:",
        "if response < D[i]:",
        "A task that ends exactly at its deadline has met it.",
    ),
    miss_not_told=(
        "        if response <= D[i]:\n            times[i]",
        "        times[i]",
        "A task that misses its deadline gets the value at which the iteration stopped. It must "
        "get -1.",
    ),
    sorted_by_rate=(
        "    times = np.full(len(C), -1)",
        "    order = np.argsort(T, kind='stable')\n"
        "    C, T, D, B = C[order], T[order], D[order], B[order]\n    times = np.full(len(C), -1)",
        "return times",
        "return times[np.argsort(order)]",
        "The tasks are sorted by their periods. The order of the arguments is the order of "
        "importance, even if it is not rate-monotonic.",
    ),
    stops_at_a_miss=(
        _MET,
        _MET + "        else:\n            break\n",
        "The tasks below one that misses its deadline get no result. They still need theirs.",
    ),
    all_blocking_added=(
        "    times = np.full(len(C), -1)\n",
        "    B = np.cumsum(B[::-1])[::-1]\n    times = np.full(len(C), -1)\n",
        "The blocking of all less important tasks is added. Each entry already is the most that "
        "they can block this task: take only its own.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-9, "whole numbers"),
    examples=(
        "response_times([1, 2, 3], [4, 6, 12], [4, 6, 12], [0, 0, 0])",
        "response_times([1, 2, 3], [4, 6, 12], [4, 6, 9], [1, 1, 0])",
    ),
    picture=bars,
    slips=SLIPS + value_slips("response_times", in_part=False, whole=False),
)
