"""How an answer is judged: by cases, in the order simple, core, edge.

`judge_of` makes the judge of a function, whose cases are compared with the worked answer.
`staged` makes that of a behaviour (a controller, an environment) from stages written by hand.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.grade_report import LEVELS, Shown
from drills.reasons import Reason
from drills.terminal import listed
from drills.values import Mismatch, as_float64, describe, describe_call, identical

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Case:
    """One call of a function exercise: its arguments, a word on what is special, its level."""

    args: tuple[Any, ...]
    label: str = "random"
    level: str = "core"


WHOLE = "whole numbers"  # the label of the case whose arguments are integers


@dataclass(frozen=True)
class Stage:
    """A step of a judge that is written by hand: its level, what it is called, what it does."""

    level: str
    label: str
    run: Callable[[Attempt], object]


def staged(*stages: Stage, timed: Callable[[Attempt], None]) -> Callable[[Attempt], None]:
    """Return the judge that goes through stages in the order of their levels.

    All simple ones are tried; after these a failure ends the run, as what comes later builds on
    what came before. What is right is timed.
    """
    ordered = sorted(stages, key=lambda stage: LEVELS.index(stage.level))

    def judge(attempt: Attempt) -> None:
        attempt.plan([(stage.level, stage.label) for stage in ordered])
        for index, stage in enumerate(ordered):
            # The simple cases all run; a harder one only while nothing has failed.
            if attempt.failed and stage.level != LEVELS[0]:
                return
            with attempt.part(index):
                stage.run(attempt)
        if not attempt.failed:
            timed(attempt)

    return judge


@dataclass(frozen=True)
class Answer:
    """What came back for a case, value by value.

    Attributes:
        case: the call.
        got: what came back, as it was.
        call: the call, as `describe_call` writes it.
        parts: the values that came back; none if their number is wrong.
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
    tolerance: float | Callable[[Case, tuple[Array, ...]], float | Sequence[float]],
    why: str,
    *,
    names: Sequence[str] = (),
    nearest: Callable[[Any, Array], Array] = lambda got, truth: truth,
    explain: Callable[[Sequence[Answer]], str] = lambda answers: "",
    first: Callable[[Attempt, Case, tuple[Any, ...], str], None] | None = None,
    last: Callable[[Attempt, Sequence[Answer]], None] | None = None,
    then: tuple[str, str] = ("core", "many calls in a row"),
    timed: Callable[[Attempt, Sequence[Case]], None] | None = None,
) -> Callable[[Attempt], None]:
    """Return the judge of a pure function: every case, level by level, and some of them twice.

    The worked answer says what is right; names and units of the values are those of the card.

    Args:
        cases: draws the calls.
        tolerance: largest error of a component, one for all or by case and right values; of
            several values then perhaps one for each.
        why: the reason of the tolerance.
        names: what the feedback calls the values of a function that returns several; the card's
            names when empty.
        nearest: for a value of which several are right, from what came back and the worked
            answer's value: the right one to compare with. Only the first value is asked about.
        explain: names the slip that the answers show, or returns "". It sees all of them, wrong and
            right, also where the run was stopped between two.
        first: checks of an answer before its values are compared.
        last: checks after all cases, unless an answer had the wrong form.
        then: level and label of what `last` looks at.
        timed: what is timed; the first case when None.
    """

    def judge(attempt: Attempt) -> None:
        # `sorted` is stable: within a level the cases keep the order in which they were drawn.
        drawn = sorted(cases(attempt.rng), key=lambda case: LEVELS.index(case.level))
        after = [then] if last is not None else []
        attempt.plan([*((case.level, case.label) for case in drawn), *after])
        answers: dict[int, Answer] = {}
        # The cases run in a shuffled order, so that an answer that counts its calls is caught.
        try:
            for index in _shuffled(attempt.rng, drawn):
                with attempt.part(index):
                    answers[index] = answer(attempt, drawn[index])
        # Also after a crash: what came back before it is diagnosed in the order of the plan.
        finally:
            answered = [answers[index] for index in sorted(answers)]
            attempt.report.shown = _simplest_wrong(answered)
            with np.errstate(all="ignore"):  # what came back may be as large as it likes
                readable = [a for a in answered if a.parts]
                attempt.answers, attempt.nearest = readable, nearest
                attempt.shown = explain(readable) or swapped(readable) or whole_numbers(readable)
                attempt.factor = constant_factor(readable)
                attempt.in_part = one_part_right(attempt, readable, names)
        if {check.reason for check in attempt.report.checks} & MALFORMED:
            return
        if last is not None:
            with attempt.part(len(drawn)):
                last(attempt, answered)
        # Calling again shows a hidden state or an unseeded generator.
        if not attempt.failed:
            repeat_calls(attempt, [(a.case.args, a.got) for a in answered])
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
            result = attempt.parts(got, [value.name for value in returns], call=call)
            if result is None:
                return Answer(case, got, call, (), (), ())
            parts = result
            words = [f"{case.label}: {name}" for name in names or [v.name for v in returns]]
            expected = attempt.expected(*case.args)
        if first is not None:
            first(attempt, case, parts, call)
        truth = [np.asarray(value, dtype=float) for value in expected]
        # A result with two right answers, such as +q and -q, is compared with the nearer one.
        truth[0] = nearest(parts[0], truth[0])
        stated = tolerance(case, tuple(truth)) if callable(tolerance) else tolerance
        allowed = np.broadcast_to(stated, len(truth)).tolist()
        right = tuple(
            attempt.compare(word, part, true, tolerance=largest, unit=v.unit, why=why, call=call)
            for word, part, true, v, largest in zip(
                words, parts, truth, returns, allowed, strict=True
            )
        )
        return Answer(case, got, call, parts, tuple(truth), right)

    return judge


def _shuffled(rng: np.random.Generator, cases: Sequence[Case]) -> list[int]:
    """Return the cases level by level.

    Within one in random order, so that none can be counted on.
    """
    order = rng.permutation(len(cases)).tolist()
    return sorted(order, key=lambda index: LEVELS.index(cases[index].level))


def _simplest_wrong(answers: Sequence[Answer]) -> Shown | None:
    """Return what a picture can be drawn of.

    The first case that is wrong and has the form asked for.
    """
    for a in answers:
        if a.parts and not all(a.right):
            if all(
                largest_error(part, truth) < np.inf
                for part, truth in zip(a.parts, a.truth, strict=True)
            ):
                return Shown(a.case.label, a.case.args, a.parts, a.truth)
    return None


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


def largest_error(got: Any, wrong: Any) -> float:
    """Return the largest error of one value against another.

    # Not convertible counts as infinitely wrong, so that no caller needs a second test.
    It is infinite for values of different shapes.
    """
    wrong = np.asarray(wrong, dtype=float)
    try:
        return float(np.max(np.abs(as_float64(got, wrong.shape) - wrong), initial=0.0))
    except Mismatch:
        return np.inf


def either_sign(got: Any, truth: Array) -> Array:
    """Return the value or its negative, whichever is on the side of what came back.

    A quaternion and its negative are one orientation.
    """
    try:
        with np.errstate(all="ignore"):  # what came back may be as large as it likes
            return -truth if as_float64(got, truth.shape) @ truth < 0.0 else truth
    except Mismatch:
        return truth


def swapped(answers: Sequence[Answer]) -> str:
    """Return the slip of answers whose values are right in another order, or ""."""
    if not answers or len(answers[0].truth) < 2:
        return ""
    for order in itertools.permutations(range(len(answers[0].truth))):
        if order == tuple(sorted(order)):
            continue
        errors = [
            largest_error(a.parts[i], a.truth[j])
            / (1.0 + float(np.max(np.abs(a.truth[j]), initial=0.0)))
            for a in answers
            for i, j in enumerate(order)
        ]
        if max(errors) <= 1e-9:
            return "results_swapped"
    return ""


def constant_factor(answers: Sequence[Answer]) -> str:
    """Return a sentence on values that are all the same multiple of the right ones, or ""."""
    if len(answers) < 3:
        return ""
    pairs = [pair for a in answers for pair in zip(a.parts, a.truth, strict=True)]
    try:
        got = np.concatenate([as_float64(part, truth.shape).ravel() for part, truth in pairs])
    except Mismatch:
        return ""
    truth = np.concatenate([one.ravel() for _, one in pairs])
    # Components near zero have no meaningful ratio and are left out of the median.
    moving = np.abs(truth) > 1e-9 * np.max(np.abs(truth), initial=0.0)
    # The median is not thrown off by a few values that are wrong for another reason.
    factor = float(np.median(got[moving] / truth[moving])) if moving.any() else 0.0
    near = np.abs(got - factor * truth) <= 1e-7 * np.abs(truth) + 1e-12
    if abs(factor) < 1e-9 or abs(factor - 1.0) < 1e-6 or not near.all():
        return ""
    return (
        f"Every value is {factor:.4g} times the right one, in every case: the method is right, and "
        "a factor is missing or one too many."
    )


def _long_rows_right(answers: Sequence[Answer]) -> tuple[Any, list[str]] | None:
    """Return which rows of matrices with different numbers of columns are right, case by case."""
    shapes = {a.truth[0].shape[:-1] for a in answers}
    if len(answers) < 3 or len(shapes) > 1 or len(shape := shapes.pop()) != 1 or shape[0] < 2:
        return None
    errors = [np.abs(as_float64(a.parts[0], a.truth[0].shape) - a.truth[0]) for a in answers]
    pairs = zip(errors, answers, strict=True)
    right = np.array([(e <= 1e-9 * (1.0 + np.abs(a.truth[0]))).all(axis=1) for e, a in pairs])
    moving = np.ptp(np.concatenate([a.truth[0] for a in answers], axis=1), axis=1) > 0.0
    retained = np.flatnonzero(moving)
    return right[:, retained], [f"row {i}" for i in retained]


def whole_numbers(answers: Sequence[Answer]) -> str:
    """Return the slip of answers in which an array of integers cut the digits off, or ""."""
    wrong = [a for a in answers if not all(a.right)]
    # Wrong only where the arguments are integers: an array took their type and truncated.
    if wrong and all(a.case.label == WHOLE for a in wrong) and len(answers) > len(wrong):
        return "whole_numbers"
    pairs = [
        pair
        for a in wrong
        for *pair, right in zip(a.parts, a.truth, a.right, strict=True)
        if not right
    ]
    values = [
        as_float64(got, truth.shape) for got, truth in pairs if largest_error(got, truth) < 1.0
    ]
    cut = len(values) == len(pairs) and all(np.array_equal(v, np.trunc(v)) for v in values)
    # Nothing but zeros was not cut off: it was never computed.
    return "whole_numbers" if cut and any(v.any() for v in values) else ""


def one_part_right(attempt: Attempt, answers: Sequence[Answer], names: Sequence[str]) -> str:
    """Return a sentence on parts that are right in every case where others are not, or ""."""
    if len(answers) < 3:
        return ""
    if len(answers[0].truth) > 1:
        text = list(names) or [v.name for v in attempt.card.signatures[0].returns]
        table = np.array([a.right for a in answers])
    else:
        result = _rows_right(answers)
        if result is None:
            return ""
        table, text = result
    good = [bool(column.all()) for column in table.T]
    bad = [bool(column.mean() < 0.7) for column in table.T]
    some = [not all_right for all_right in good]
    right, wrong, at_times = (list(itertools.compress(text, mask)) for mask in (good, bad, some))
    if not right or not at_times:
        return ""
    always = f"Right in every case: {listed(right, 'and')}."
    # Where parts are mostly wrong, they are named, and not what is wrong now and then beside them.
    if wrong:
        hint = "Look for the mistake where only the latter is computed."
        return f"{always} Wrong: {listed(wrong, 'and')}. {hint}"
    count = int((~table.all(axis=1)).sum())
    return (
        f"{always} Wrong in {count} of {len(answers)} cases: {listed(at_times, 'and')}. Look for "
        "what these cases have and the others don't, where only the latter is computed."
    )


def _rows_right(answers: Sequence[Answer]) -> tuple[Any, list[str]] | None:
    """Return which rows (or components) of a single array are right, case by case."""
    shapes = {a.truth[0].shape for a in answers}
    if any(largest_error(a.parts[0], a.truth[0]) == np.inf for a in answers):
        return None
    if len(shapes) > 1:  # as many rows, such as x, y and z, of more columns or fewer
        return _long_rows_right([a for a in answers if a.truth[0].size])
    if not (shape := shapes.pop()) or shape[0] < 2:
        return None
    # Rows first, then columns: the first axis along which the answers separate is reported.
    for axis in range(len(shape)):
        others = tuple(i for i in range(len(shape)) if i != axis)
        truths = np.array([a.truth[0] for a in answers])
        errors = np.array([np.abs(as_float64(a.parts[0], shape) - a.truth[0]) for a in answers])
        scale = 1.0 + np.abs(truths)
        right = np.asarray((errors <= 1e-9 * scale).all(axis=tuple(i + 1 for i in others)))
        # What is the same in all cases, such as a base at the origin, is right by itself.
        moving = np.ptp(truths, axis=0).max(axis=others) > 0.0
        if (right.all(axis=0) & moving).any() and not right.all():
            word = "component" if len(shape) == 1 else ("row", "column")[axis]
            retained = np.flatnonzero(moving)
            return right[:, retained], [f"{word} {i}" for i in retained]
    return None


def coarse(answers: Sequence[Answer]) -> str:
    """Return the slip of answers of which every wrong value is right but for its digits, or ""."""
    wrong = [
        _coarse(part, truth)
        for answer in answers
        for part, truth, right in zip(answer.parts, answer.truth, answer.right, strict=True)
        if not right
    ]
    # A number such as 1.0 is short in both ways; those that are not tell which it was.
    for slip in ("single_precision", "rounded"):
        if all(slip in possible for possible in wrong) and any(len(p) == 1 for p in wrong):
            return slip
    return ""


def _coarse(got: Any, expected: Array) -> frozenset[str]:
    """Return what may have made a value coarse: nothing if something else is wrong."""
    both = frozenset({"single_precision", "rounded"})
    try:
        values = as_float64(got, expected.shape)
    except Mismatch:
        return frozenset()
    # Relative to the largest component: float32 has about 7 digits, 1e-5 leaves room for sums.
    scale, error = max(1.0, float(np.abs(expected).max())), largest_error(values, expected)
    if not values.any():
        return both if error <= 1e-5 * scale else frozenset()
    single = error <= 1e-5 * scale and np.array_equal(values, values.astype(np.float32))
    decimals = next((k for k in range(2, 11) if np.array_equal(values, values.round(k))), None)
    # More than half a digit: another mistake, in numbers that happen to be short.
    rounded = decimals is not None and error <= 0.501 * 10.0**-decimals
    found = {"single_precision": single, "rounded": rounded}
    return frozenset(slip for slip, fits in found.items() if fits)
