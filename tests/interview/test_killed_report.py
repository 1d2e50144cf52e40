"""Killed while the final report is written or printed: an interview; and a run of the robot.

Nothing is lost or half-written, and the next command says in one sentence what happened.
"""

from __future__ import annotations

import contextlib
import json
import random
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from course.interview import rehearsal
from drills.interview import rehearse
from drills.robot import state, unfinished
from drills.robot.store import Stored
from drills.session import Session
from drills.terminal import Terminal as Screen
from tests.budget import sampled
from tests.drills.place import Place, a_place
from tests.interview.test_killed import PATIENCE, Terminal, whole

__all__ = ["a_place"]

pytestmark = pytest.mark.slow
ENDS = pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM], ids=["kill", "term"])
CODES = {signal.SIGKILL: -9, signal.SIGTERM: 143}
# Seconds after the last line was typed: from before the report to behind its last sentence.
MOMENTS = [random.Random(k).uniform(0.0, 0.18) for k in range(10)]
AT = "2026-01-02T03:04:05+00:00"


def stop_after(terminal: Terminal, seconds: float, end: signal.Signals) -> None:
    """End the command after so long, unless it has ended by itself."""
    moment = time.monotonic() + seconds
    while (remaining := moment - time.monotonic()) > 0:
        terminal.read(min(remaining, 0.01))
    terminal.process.send_signal(end)
    deadline = time.monotonic() + PATIENCE
    while terminal.process.poll() is None and time.monotonic() < deadline:
        terminal.read(0.05)
    code = terminal.process.wait(timeout=PATIENCE)
    assert code in (0, 1, CODES[end]) and "Traceback" not in terminal.text, terminal.text


def finished_questions(place: Place) -> rehearsal.Interview:
    """Store an interview of which one question is marked and only the reply is missing."""
    talk = rehearse.Talk(Session("interview", Screen(), place.work))
    talk.draw(10, 7, frozenset({1}), ("concept",))
    (entry,) = talk.interview.items
    entry.answer, entry.answered = "The answer.\n", True
    entry.marks = ["named"] * len(rehearse.pool()[entry.key].rubric)
    talk.begin()
    return talk.interview


def report_is_whole(place: Place) -> bool:
    """Return whether the report is there; what is there is whole."""
    pages = list(place.work.glob("interview/report-*.md"))
    data = list(place.work.glob("interview/report-*.json"))
    for path in data:
        (item,) = json.loads(path.read_text("utf-8"))["items"]
        assert (item["answer"], item["reply"]) == ("The answer.\n", "The reply.\n")
    for path in pages:
        text = path.read_text("utf-8")
        assert "The reply." in text and text.rstrip().endswith("None.")
    return len(pages) == len(data) == 1


@pytest.mark.prove
@ENDS
def test_a_killed_report_of_an_interview_is_reported_again(place: Place, end: Any) -> None:
    """At random moments behind the last line that is typed."""
    for number, moment in enumerate(sampled(MOMENTS, 3)):
        place.work = place.folder / f"work{number}"
        place.environment["DRILLS_WORK"] = str(place.work)
        place.work.mkdir()
        finished_questions(place)
        terminal = Terminal(place, "interview", "--resume")
        terminal.until("ends your answer")
        terminal.type("The reply.\n.\n")
        terminal.until("Possible follow-ups")
        stop_after(terminal, moment, end)
        past = rehearse.json_store.load(place.work / "interviews.json", rehearse.FORM)[0]
        if not past.open:  # all of it was printed before the interview was closed
            assert report_is_whole(place) and "The report is" in terminal.text
            assert len(past.scores) == 1
            continue
        report_is_whole(place)
        new = place.run("interview", "--kind", "concept", "--chapters", "2", "--seed", "1")
        text = " ".join(new.out.split())
        (one,) = (row for row in past.open.values())
        if one.items[0].done:
            assert "was stopped before its report was complete: nothing is lost" in text
        else:
            assert "You have one unfinished interview" in text
        again = place.json("interview", "--resume", "2", text=".\n" * (not one.items[0].done))
        assert again["items"][0]["reply"] == "The reply.\n" and report_is_whole(place)
        whole(place)
        assert not list(place.work.rglob("*.part"))


@pytest.mark.prove
@pytest.mark.parametrize("phase", ["write_report", "show_report", "store"])
def test_each_step_of_the_end_of_an_interview_can_be_the_last(
    place: Place, monkeypatch: pytest.MonkeyPatch, phase: str
) -> None:
    """Stopped before a step of the end: the next start says so, and the report comes again."""
    place.work.mkdir()
    interview = finished_questions(place)
    talk = rehearse.Talk(Session("interview", Screen(), place.work), iter(["R.", "."]).__next__)
    talk.resume()
    step = getattr(talk, phase)

    def stopped(*arguments: Any) -> Any:
        if phase != "store" or arguments[0].__name__ == "close":
            raise SystemExit(143)
        return step(*arguments)

    monkeypatch.setattr(talk, phase, stopped)
    with pytest.raises(SystemExit):
        talk.run()
    assert talk.interview.started == interview.started
    new = place.run("interview", "--kind", "concept", "--chapters", "2", "--seed", "1")
    text = " ".join(new.out.split())
    assert text.count("was stopped before its report was complete: nothing is lost") == 1
    listed = " ".join(place.run("interview", "--list").out.split())
    assert "1 of 1 question done. Next: the report" in listed
    again = place.run("interview", "--resume", "2")
    assert again.code == 0 and "here it is" in " ".join(again.out.split())
    assert "Your scores" in again.out
    stored = rehearse.json_store.load(place.work / "interviews.json", rehearse.FORM)[0]
    assert interview.started not in stored.open and len(stored.scores) == 1


# --- The robot ------------------------------------------------------------------------------------


def noted_run(place: Place, number: int, error: BaseException | None) -> None:
    """Note a run that ends with an error, or without one."""
    with contextlib.suppress(BaseException), unfinished.noted(session_of(place), number, 20, AT):
        if error is not None:
            raise error


def session_of(place: Place) -> Session:
    place.work.mkdir(exist_ok=True)
    return Session("robot", Screen(), place.work)


@pytest.mark.parametrize("stored", [False, True])
def test_a_run_of_the_robot_that_was_ended_from_outside_is_told_once(
    place: Place, stored: bool
) -> None:
    if stored:

        def edit(new: Stored) -> None:
            new.runs.append({"level": 2, "at": AT})

        state.change(session_of(place), edit)
    noted_run(place, 2, SystemExit(143))
    text = " ".join(place.run("robot").out.split())
    how = "its report was complete; its result is stored, and drills robot history shows it."
    lost = "all of its tasks were played, so nothing of it is stored."
    assert f"Your last run (level 2, 20 tasks) was stopped before {how if stored else lost}" in text
    assert "Your last run" not in place.run("robot").out
    noted_run(place, 6, SystemExit(143))
    notices = place.json("robot")["notices"]
    assert len(notices) == 1 and "before its log was written" in notices[0]


def test_a_run_that_ended_by_itself_or_by_ctrl_c_is_not_told(place: Place) -> None:
    for error in (None, KeyboardInterrupt(), ValueError()):
        noted_run(place, 2, error)
        assert "Your last run" not in place.run("robot").out


def test_a_run_that_still_plays_is_not_told(place: Place) -> None:
    with unfinished.noted(session_of(place), 2, 20, AT):
        assert "Your last run" not in place.run("robot").out
        noted_run(place, 3, SystemExit(143))  # in another terminal: one note, of the first run
    assert "Your last run" not in place.run("robot").out


def test_an_unfinished_copy_of_a_killed_process_is_removed(tmp_path: Path) -> None:
    from drills import workspace

    path = tmp_path / "report.md"
    (tmp_path / ".report.md.999999999.abc.part").write_text("half")
    (tmp_path / ".report.md.1.abc.part").write_text("of a process that runs")
    (tmp_path / ".other.md.999999999.abc.part").write_text("of another file")
    workspace.write_over(path, "new")
    names = {one.name for one in tmp_path.iterdir()}
    assert names == {"report.md", ".report.md.1.abc.part", ".other.md.999999999.abc.part"}
