"""How a function is judged: by cases, each compared with the worked answer.

`judge_of` makes the judge of an exercise from what is special about it. A judge of behaviour (a
controller, an environment) is written by hand and borrows `repeat_calls` and `coarse`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.reasons import Reason
from drills.values import Mismatch, as_float64, describe, describe_call, identical

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """One call of a function exercise: its arguments, and a word on what is special."""

    args: tuple[Any, ...]
    label: str = "random"


@dataclass(frozen=True)
class Answer:
    """What came back for a case, value by value.

    Attributes:
        case: what was asked.
        got: what came back, as it was.
        call: the call, as `describe_call` writes it.
        parts: the values that came back; none if they are not as many as asked for.
        truth: the right values.
        right: which of the values are right.
    """

    case: Case
    got: Any
    call: str
    parts: tuple[Any, ...]
    truth: tuple[Array, ...]
    right: tuple[bool, ...]


def judge_of(
    cases: Callable[[np.random.Generator], Sequence[Case]],
    tolerance: float | Callable[[Case, tuple[Array, ...]], float],
    why: str,
    *,
    names: Sequence[str] = (),
    nearest: Callable[[Any, Array], Array] = lambda got, truth: truth,
    told: Callable[[Sequence[Answer]], str] = lambda answers: "",
    first: Callable[[Attempt, Case, tuple[Any, ...], str], None] | None = None,
    last: Callable[[Attempt, Sequence[Answer]], None] = lambda attempt, answers: None,
    timed: Callable[[Attempt, Sequence[Case]], None] | None = None,
) -> Callable[[Attempt], None]:
    """The judge of a pure function: every case in random order, some of them twice.

    The worked answer says what is right; names and units of the values are those of the card.

    Args:
        cases: draws the calls.
        tolerance: largest error of a component, one for all or by case and right values.
        why: the reason of the tolerance.
        names: what the feedback calls the values of a function that returns several; the card's
            names when empty.
        nearest: for a value of which several are right, from what came back and the worked
            answer's value: the right one to compare with. Only the first value is asked about.
        told: the slip that the answers show, or "". It sees all of them, wrong and right, also
            where the run was stopped between two.
        first: checks of an answer before its values are compared.
        last: checks after all cases, unless an answer was not of the form asked for.
        timed: what is timed; the first case when None.
    """

    def judge(attempt: Attempt) -> None:
        drawn = cases(attempt.rng)
        answers: list[Answer] = []
        try:
            for index in attempt.rng.permutation(len(drawn)):
                answers.append(answer(attempt, drawn[index]))
        finally:
            with np.errstate(all="ignore"):  # what came back may be as large as it likes
                attempt.shown = told([a for a in answers if a.parts])
        if {check.reason for check in attempt.report.checks} & MALFORMED:
            return
        last(attempt, answers)
        if not attempt.failed:
            repeat_calls(attempt, [(a.case.args, a.got) for a in answers])
        if not attempt.failed:
            (timed or _first_timed)(attempt, drawn)

    def answer(attempt: Attempt, case: Case) -> Answer:
        returns = attempt.card.signatures[0].returns
        call = describe_call(attempt.card.entry, case.args)
        got = attempt.call(*case.args)
        if len(returns) == 1:
            parts, words = (got,), [case.label]
            expected = (attempt.expected(*case.args),)
        else:
            found = attempt.parts(got, [value.name for value in returns], call=call)
            if found is None:
                return Answer(case, got, call, (), (), ())
            parts = found
            words = [f"{case.label}: {name}" for name in names or [v.name for v in returns]]
            expected = attempt.expected(*case.args)
        if first is not None:
            first(attempt, case, parts, call)
        truth = [np.asarray(value, dtype=float) for value in expected]
        truth[0] = nearest(parts[0], truth[0])
        allowed = tolerance(case, tuple(truth)) if callable(tolerance) else tolerance
        right = tuple(
            attempt.compare(word, part, true, tolerance=allowed, unit=v.unit, why=why, call=call)
            for word, part, true, v in zip(words, parts, truth, returns, strict=True)
        )
        return Answer(case, got, call, parts, tuple(truth), right)

    return judge


# A property of numbers that are missing, not finite or of another shape says nothing.
MALFORMED = {
    Reason.NOTHING_RETURNED,
    Reason.WRONG_SHAPE,
    Reason.WRONG_TYPE,
    Reason.NOT_FINITE,
    Reason.INPUTS_CHANGED,
}


def _first_timed(attempt: Attempt, cases: Sequence[Case]) -> None:
    attempt.time_call(*cases[0].args)


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
        attempt.require(
            "same call, same answer",
            identical(before, again),
            sentence="The same call gave another answer the second time.",
            got=describe(again),
            expected=describe(before),
            call=describe_call(attempt.card.entry, args),
            reason=Reason.NOT_DETERMINISTIC,
        )


def off(got: Any, wrong: Any) -> float:
    """The largest error of a value against another, infinite where it is none of that shape."""
    wrong = np.asarray(wrong, dtype=float)
    try:
        return float(np.max(np.abs(as_float64(got, wrong.shape) - wrong)))
    except Mismatch:
        return np.inf


def either_sign(got: Any, truth: Array) -> Array:
    """The value or its negative, whichever is on the side of what came back.

    A quaternion and its negative are one orientation.
    """
    try:
        with np.errstate(all="ignore"):  # what came back may be as large as it likes
            return -truth if as_float64(got, truth.shape) @ truth < 0.0 else truth
    except Mismatch:
        return truth


def coarse(answers: Sequence[Answer]) -> str:
    """The slip of answers of which every wrong value is right but for its digits, or ""."""
    found = {
        _coarse(part, truth)
        for answer in answers
        for part, truth, right in zip(answer.parts, answer.truth, answer.right, strict=True)
        if not right
    } - {None}
    return str(found.pop()) if len(found) == 1 else ""


def _coarse(got: Any, expected: Array) -> str | None:
    """What made a value coarse; "" if something else is wrong with it; None if it can't be told."""
    try:
        values = as_float64(got, expected.shape)
    except Mismatch:
        return ""
    scale, error = max(1.0, float(np.abs(expected).max())), off(values, expected)
    if not values.any():
        return None if error <= 1e-5 * scale else ""
    if error <= 1e-5 * scale and np.array_equal(values, values.astype(np.float32)):
        return "single_precision"
    decimals = next((k for k in range(2, 11) if np.array_equal(values, values.round(k))), None)
    if decimals is None or error > 0.501 * 10.0**-decimals:
        return ""  # more than half a digit: another mistake, in numbers that happen to be short
    return "rounded"
