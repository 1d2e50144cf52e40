"""Which known mistake explains a wrong answer.

Three sources, in this order: a check or the answers of a function show it by their values; a
slip's own text, asked the same, gives what came back; some parts are right and others never are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt, Place, Step, request
from drills.exercise import Exercise
from drills.inprocess import InProcess
from drills.reasons import Reason
from drills.sandbox import Ended, Handle, Raised
from drills.values import Failure, close

# A slip explains a submission when it gives this share of what the submission has wrong, and this
# one of what either of them has wrong: a mistake may spare an edge case, or come with another.
EXPLAINED, SHARED = 0.75, 0.4
CAST = "Cannot cast ufunc"  # how NumPy refuses to add floats into an array of integers


def diagnosis(attempt: Attempt, graded: Exercise) -> tuple[str, str]:
    """Return the name of the slip and the sentence for the learner.

    Both are "" where no slip explains the answer.
    """
    report = attempt.report
    sentences = {slip.name: slip.sentence for slip in graded.slips}
    named = next((c.slip for c in report.checks if c.slip and not c.passed), "") or attempt.shown
    if not named and report.reason is Reason.RAISED and report.problem is not None:
        named = "whole_numbers" if CAST in report.problem.message else ""
    if named not in sentences:
        named = matched(attempt, graded)
    if named:
        return named, sentences[named]
    if attempt.factor:
        return "constant_factor", attempt.factor
    return ("one_part_right" if attempt.in_part else ""), attempt.in_part


def matched(attempt: Attempt, graded: Exercise) -> str:
    """Return the slip that gives most of what the submission got wrong, and wrong alike; or ""."""
    for slip in graded.slips:
        if slip.ends is not None and slip.ends is attempt.report.reason:
            if slip.cause(attempt.learner.last_args):
                return slip.name
    solution, steps = attempt.card.solution_text(), attempt.learner.steps
    right = np.array([same for same in _alike(solution, graded, steps)], dtype=bool)
    if right.all():
        return ""  # what came back was right as far as it went
    best, name = SHARED, ""
    for slip in graded.slips:
        # One that never answers must not be run here.
        if slip.ends is not None or slip.generic:
            continue
        share = _share(right, _alike(slip.text(solution), graded, steps))
        if share > best:
            best, name = share, slip.name
    return name


def _share(right: NDArray[np.bool_], alike: Iterator[bool]) -> float:
    """Return how much a slip explains: of what either has wrong, the share that is the same; or 0.

    Args:
        right: which answers of the submission are those of the worked answer.
        alike: whether an answer is that of the slip, one after the other.
    """
    spared = (1.0 - EXPLAINED) * np.sum(~right)
    agreed = report = 0
    for is_right, same in zip(right, alike, strict=True):
        # Where the submission is right and unlike the slip, the slip is wrong.
        report += not (is_right and same)
        agreed += same and not is_right
        spared -= not same and not is_right
        if spared < 0:
            return 0.0
    return agreed / report


def _alike(text: str, graded: Exercise, steps: Sequence[Step]) -> Iterator[bool]:
    """Yield for each recorded request, whether a text of this project gives what came back."""
    for step, result in repeated(InProcess(text, graded.given), steps):
        yield result is step.result or close(step.result, result)


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
