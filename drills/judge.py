"""How a function is judged: by cases, each compared with the worked answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from drills.attempt import Attempt
from drills.reasons import Reason
from drills.values import describe, describe_call, identical


@dataclass(frozen=True)
class Case:
    """One call of a function exercise: its arguments, and a word on what is special."""

    args: tuple[Any, ...]
    label: str = "random"


def judge_function(
    attempt: Attempt,
    cases: Sequence[Case],
    *,
    tolerance: float | Callable[[Case], float],
    unit: str,
    why: str,
    repeated: int = 3,
) -> None:
    """Judge a pure function: every case in random order, some of them twice.

    Args:
        attempt: the grading.
        cases: the calls; the worked answer says what is right.
        tolerance: largest error of a component, one for all or by case.
        unit: of the result.
        why: the reason of the tolerance.
        repeated: how many calls are made again at the end and must give the same bits.
    """
    order = attempt.rng.permutation(len(cases))
    first: list[tuple[Case, Any]] = []
    for index in order:
        case = cases[index]
        got = attempt.call(*case.args)
        first.append((case, got))
        allowed = tolerance(case) if callable(tolerance) else tolerance
        attempt.compare(
            case.label,
            got,
            attempt.expected(*case.args),
            tolerance=allowed,
            unit=unit,
            why=why,
            call=describe_call(attempt.card.entry, case.args),
        )
    if attempt.failed:
        return
    repeat_calls(attempt, [(case.args, got) for case, got in first], repeated)
    if not attempt.failed:
        attempt.time_call(*cases[-1].args)


def repeat_calls(
    attempt: Attempt, first: Sequence[tuple[tuple[Any, ...], Any]], repeated: int = 3
) -> None:
    """Make some of the calls again: the bits must be the same.

    Args:
        attempt: the grading, of a function.
        first: arguments and answer of each call.
        repeated: how many are made again.
    """
    for i in attempt.rng.choice(len(first), size=min(repeated, len(first)), replace=False):
        args, before = first[i]
        again = attempt.call(*args)
        same = identical(before, again)
        attempt.require(
            "same call, same answer",
            same,
            sentence="The same call gave another answer the second time.",
            got=describe(again),
            expected=describe(before),
            call=describe_call(attempt.card.entry, args),
            reason=Reason.NOT_DETERMINISTIC,
        )
