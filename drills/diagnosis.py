"""Which known mistake explains a wrong answer.

Five sources, in this order: a check or the answers of a function show it by their values; a slip's
own text, asked the same, gives what came back; some parts are right and others never are; the
worked answer with other arguments or with one step changed gives what came back; what all wrong
results have in common is said (`drills.patterns`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import patterns
from drills.attempt import Attempt, Place, Step, request
from drills.exercise import Exercise
from drills.hypotheses import hypothesis, rough
from drills.inprocess import InProcess
from drills.reasons import Reason
from drills.sandbox import Ended, Handle, Raised
from drills.values import Failure, close

# A slip explains a submission when it gives this share of what the submission has wrong, and this
# one of what either of them has wrong: a mistake may spare an edge case, or come with another.
EXPLAINED, SHARED = 0.75, 0.4
ALIKE = 0.5  # the share of both where nothing but integers is alike
EQUAL, COARSEST = 1e-9, 1e-6  # relative to the largest number, or to 1
CAST = "Cannot cast ufunc"  # how NumPy refuses to add floats into an array of integers


def diagnosis(attempt: Attempt, graded: Exercise) -> tuple[str, str]:
    """Return the name of the slip and the sentence for the learner.

    Both are "" where no slip explains the answer.
    """
    report = attempt.report
    sentences = {slip.name: slip.sentence for slip in graded.slips}
    named = next((c.slip for c in report.checks if c.slip and not c.passed), "") or attempt.shown
    # Written into an argument of integers, a result is cut off: the argument is the matter.
    if report.reason is Reason.INPUTS_CHANGED and named == "whole_numbers":
        return "", ""
    if not named and report.reason is Reason.RAISED and report.problem is not None:
        named = "whole_numbers" if CAST in report.problem.message else ""
    if named not in sentences:
        named = matched(attempt, graded)
    if named:
        return named, sentences[named]
    if attempt.factor:
        return "constant_factor", attempt.factor
    if attempt.in_part:
        return "one_part_right", attempt.in_part
    if report.reason is not Reason.WRONG_VALUE:
        return "", ""  # the reason says it: None, a shape, an exception
    for explain in (
        lambda: hypothesis(attempt, graded),
        lambda: patterns.form(attempt),
        lambda: rough(attempt.answers),
        lambda: patterns.division(attempt),
    ):
        name, sentence = explain()
        if name:
            return name, sentence
    return "", ""


def matched(attempt: Attempt, graded: Exercise) -> str:
    """Return the slip that gives most of what the submission got wrong, and wrong alike; or ""."""
    for slip in graded.slips:
        if slip.ends is not None and slip.ends is attempt.report.reason:
            if slip.cause(attempt.learner.last_args):
                return slip.name
    # What is judged coarsely, such as the end of an iteration, is compared as coarsely, but only if
    # no slip fits closely: two slips may end near the same place.
    stated = [check.tolerance for check in attempt.report.checks if check.tolerance > 0.0]
    coarse = min(max(EQUAL, min(stated, default=EQUAL)), COARSEST)
    name = _closest(attempt, graded, EQUAL)
    return name or (_closest(attempt, graded, coarse) if coarse > EQUAL else "")


def _closest(attempt: Attempt, graded: Exercise, relative: float) -> str:
    """Return the slip that gives most of what is wrong, compared to a relative tolerance; or ""."""
    solution, steps = attempt.card.solution_text(), attempt.learner.steps
    right = np.array([same for same, _ in _alike(solution, graded, steps, relative)], dtype=bool)
    if right.all():
        return ""  # what came back was right as far as it went
    best, name = SHARED, ""
    for slip in graded.slips:
        # One that never answers must not be run here.
        if slip.ends is not None or slip.generic:
            continue
        share = _share(right, _alike(slip.text(solution), graded, steps, relative))
        if share > best:
            best, name = share, slip.name
    return name


def _share(right: NDArray[np.bool_], alike: Iterator[tuple[bool, Any]]) -> float:
    """Return how much a slip explains: of what either has wrong, the share that is the same; or 0.

    Args:
        right: which answers of the submission are those of the worked answer.
        alike: whether an answer is that of the slip, and the answer, one after the other.
    """
    spared = (1.0 - EXPLAINED) * np.sum(~right)
    agreed = report = 0
    telling = False
    for is_right, (same, value) in zip(right, alike, strict=True):
        # Where the submission is right and unlike the slip, the slip is wrong.
        report += not (is_right and same)
        agreed += same and not is_right
        telling |= same and not is_right and has_digits(value)
        spared -= not same and not is_right
        if spared < 0:
            return 0.0
    share = agreed / report
    # Two mistakes often share a 1 or a 0, a verdict or a failure: then more must be alike.
    return share if telling or share >= ALIKE else 0.0


def has_digits(value: Any) -> bool:
    """Return whether a number in a result is not an integer, so that it hardly comes by chance."""
    if isinstance(value, dict):
        return any(map(has_digits, value.values()))
    if isinstance(value, list | tuple):
        return any(map(has_digits, value))
    if isinstance(value, float | np.ndarray | np.floating):
        array = np.asarray(value)
        return array.dtype.kind == "f" and bool(np.any(array != np.rint(array)))
    return False


def _alike(
    text: str, graded: Exercise, steps: Sequence[Step], relative: float
) -> Iterator[tuple[bool, Any]]:
    """Yield for each recorded request, whether a text of this project gives the same, and what."""
    for step, result in repeated(InProcess(text, graded.given), steps):
        yield result is step.result or close(step.result, result, relative), step.result


def repeated(place: Place | InProcess, steps: Sequence[Step]) -> Iterator[tuple[Step, Any]]:
    """Make the recorded requests again somewhere else; handles become those of the new place."""
    handles: dict[int, Any] = {}

    def present(value: Any) -> Any:
        return handles.get(id(value), value) if isinstance(value, Handle) else value

    for step in steps:
        args = tuple(map(present, step.args))
        kwargs = {key: present(value) for key, value in step.kwargs.items()}
        result: Any
        try:
            result = request(place, step.kind, step.target, present(step.handle), args, kwargs)
        except Raised as raised:
            result = Failure(raised.type)
        except Ended:
            raise
        except Exception as error:  # our own text of a slip, run in this process
            result = Failure(type(error).__name__)
        if isinstance(step.result, Handle) and not isinstance(result, Failure):
            handles[id(step.result)] = result
            result = step.result
        yield step, result
