"""Which known mistake explains a wrong answer.

Three sources, in this order: a check or the answers of a function show it by their values; a
slip's own text, asked the same, gives what came back; some parts are right and others never are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from drills.attempt import Attempt, Place, Step, request
from drills.exercise import Exercise
from drills.inprocess import InProcess
from drills.sandbox import Ended, Handle, Raised
from drills.values import Failure, close

# Of the answers that either the submission or the slip has wrong, this share must be the same.
SHARE = 0.75
CAST = "Cannot cast ufunc"  # how NumPy refuses to add floats into an array of integers


def diagnosis(attempt: Attempt, graded: Exercise) -> tuple[str, str]:
    """The name of the slip and the sentence for the learner, both "" where nothing explains it."""
    report = attempt.report
    sentences = {slip.name: slip.sentence for slip in graded.slips}
    named = next((c.slip for c in report.checks if c.slip and not c.passed), "") or attempt.shown
    if not named and report.problem is not None and CAST in report.problem.message:
        named = "whole_numbers"
    named = named or matched(attempt, graded)
    if named:
        return named, sentences[named]
    return ("one_part_right" if attempt.in_part else ""), attempt.in_part


def matched(attempt: Attempt, graded: Exercise) -> str:
    """The slip that gives most of what the submission got wrong, and wrong alike; or ""."""
    for slip in graded.slips:
        if slip.ends is not None and slip.ends is attempt.report.reason:
            if slip.cause(attempt.learner.last_args):
                return slip.name
    solution, steps = attempt.card.solution_text(), attempt.learner.steps
    if not steps:
        return ""
    right = _alike(solution, graded, steps)
    if right.all():
        return ""  # what came back was right as far as it went
    best, name = 0.0, ""
    for slip in graded.slips:
        # One that never answers must not be run here.
        if slip.ends is not None or slip.generic:
            continue
        share = _share(right, _alike(slip.text(solution), graded, steps))
        if share > best:
            best, name = share, slip.name
    return name if best >= SHARE else ""


def _share(right: Any, same: Any) -> float:
    """Of the answers that one of the two has wrong, the share in which they agree.

    Args:
        right: which answers of the submission are those of the worked answer.
        same: which are those of the slip.
    """
    # Where the submission is right and unlike the slip, the slip is wrong.
    told = ~(right & same)
    return float(np.mean(same[told])) if (told & same).any() else 0.0


def _alike(text: str, graded: Exercise, steps: Sequence[Step]) -> Any:
    """For each recorded request, whether a text of this project gives what came back."""
    local = InProcess(text, graded.given)
    found = {id(step): True for step in steps}
    for step, result in repeated(local, steps):
        found[id(step)] = close(step.result, result)
    return np.array(list(found.values()))


def repeated(place: Place | InProcess, steps: Sequence[Step]) -> Iterator[tuple[Step, Any]]:
    """Make the recorded requests again somewhere else; handles become those of the new place."""
    handles: dict[int, Any] = {}

    def there(value: Any) -> Any:
        return handles.get(id(value), value) if isinstance(value, Handle) else value

    for step in steps:
        args = tuple(map(there, step.args))
        kwargs = {key: there(value) for key, value in step.kwargs.items()}
        result: Any
        try:
            result = request(place, step.kind, step.target, there(step.handle), args, kwargs)
        except Raised as raised:
            result = Failure(raised.type)
        except Ended:
            raise
        except Exception as error:  # our own text of a slip, run in this process
            result = Failure(type(error).__name__)
        if isinstance(step.result, Handle) and not isinstance(result, Failure):
            handles[id(step.result)] = result
            continue
        yield step, result
