"""Hostile submissions against the real grader: ends, floods, other processes, forged answers.

Each has the verdict that it must get; `hostile_grading` says what is looked at besides.
"""

from __future__ import annotations

import pytest

from tests.drills.hostile_grading import Submission, a_world, check_verdict, runnable

SUBMISSIONS = runnable("ends", "floods", "processes", "forging")
__all__ = ["a_world"]


@pytest.mark.parametrize("submission", SUBMISSIONS, ids=lambda s: s.name)
def test_verdict(
    submission: Submission, world: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    check_verdict(submission, world, monkeypatch)
