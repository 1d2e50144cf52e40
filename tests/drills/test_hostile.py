"""Hostile submissions against the real grader: ends, floods, other processes, forged answers.

Each has the verdict that it must get; `hostile_grading` says what is looked at besides.
"""

from __future__ import annotations

import pytest

from drills.reasons import Reason
from tests.drills.hostile_grading import Submission, a_world, check_verdict, read, runnable

SUBMISSIONS = runnable("ends", "floods", "processes", "forging")
__all__ = ["a_world"]


@pytest.mark.parametrize("submission", SUBMISSIONS, ids=lambda s: s.name)
def test_verdict(
    submission: Submission, world: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    check_verdict(submission, world, monkeypatch)


def test_there_are_enough_of_them() -> None:
    every = read("ends", "floods", "processes", "forging", "files", "values", "unlucky")
    assert len(every) >= 220
    assert len({s.name for s in every}) == len(every)
    elsewhere = {
        Reason.NOT_ATTEMPTED,  # the starter
        Reason.UNREADABLE,  # files
        Reason.BORROWED_NAME,  # notebooks
        Reason.WRONG_PROPERTY,  # other drills
        Reason.MISSING_ERROR,
    }
    assert set(Reason) - elsewhere <= frozenset().union(*(s.reasons for s in every))
