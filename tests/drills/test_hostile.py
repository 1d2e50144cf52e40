"""One hostile or unlucky submission for each reason; all of them are in `tests/prove/drills`."""

from __future__ import annotations

import pytest

from drills.reasons import Reason
from tests.budget import sampled
from tests.drills.hostile_grading import KINDS, a_world, check_verdict, read, runnable

__all__ = ["a_world"]

ELSEWHERE = {
    Reason.NOT_ATTEMPTED,  # the starter
    Reason.UNREADABLE,  # files
    Reason.BORROWED_NAME,  # notebooks
    Reason.WRONG_PROPERTY,  # other drills
    Reason.MISSING_ERROR,
}


@pytest.mark.slow
# Every reason is reached by other tests, too; here the answers that reach it are hostile.
@pytest.mark.parametrize("reason", sampled([x for x in Reason if x not in ELSEWHERE], 4))
def test_verdict(reason: Reason, world: dict[str, str], monkeypatch: pytest.MonkeyPatch) -> None:
    submission = next(s for s in runnable(*KINDS) if s.reasons == {reason})
    check_verdict(submission, world, monkeypatch)


def test_there_are_enough_of_them() -> None:
    every = read(*KINDS)
    assert len(every) >= 220
    assert len({s.name for s in every}) == len(every)
