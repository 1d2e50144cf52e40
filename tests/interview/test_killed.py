"""Killed, or ended by Ctrl-C, in every phase of review, interview, debug and check, in a terminal.

Whatever was entered before is there afterwards, no file is half written, nothing looks like a
crash, and the command works again.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import pty
import re
import select
import signal
import sys
import termios
import time
from pathlib import Path
from typing import Any

import pytest

from course.interview import rehearsal, scenarios
from drills import cards as catalogue
from drills.interview import rehearse
from tests.drills.place import ENDLESS, Place, a_place

__all__ = ["a_place"]

pytestmark = pytest.mark.slow
ENDS = pytest.mark.parametrize("end", ["kill", "ctrl-c"])
PATIENCE = 120.0
CONCEPT = ("interview", "--kind", "concept", "--chapters", "1", "--seed", "7")


class Terminal:
    """A command whose controlling terminal is ours: what is typed, and Ctrl-C, reach it as keys."""

    def __init__(self, place: Place, *arguments: str, lines: int = 500) -> None:
        try:
            self.ours, theirs = pty.openpty()
        except OSError as error:
            pytest.skip(f"nothing ran in a terminal: the system gives no pseudo-terminal: {error}")

        def take_terminal() -> None:
            fcntl.ioctl(0, termios.TIOCSCTTY, 0)

        self.process = place.popen(
            *arguments,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            env={"COLUMNS": "80", "LINES": str(lines)},
            start_new_session=True,
            preexec_fn=take_terminal,
        )
        self.name = os.ttyname(theirs)
        os.close(theirs)
        self.text = ""
        self.seen = 0

    def read(self, seconds: float) -> bool:
        """Read what there is; whether more may come."""
        if not select.select([self.ours], [], [], seconds)[0]:
            return True
        try:
            data = os.read(self.ours, 65536)
        except OSError:  # the other side is closed
            return False
        self.text += data.decode("utf-8", "replace")
        return bool(data)

    def until(self, text: str) -> None:
        """Wait for a text behind the one that was waited for before."""
        deadline = time.monotonic() + PATIENCE
        wrapped = re.compile(r"\s+".join(map(re.escape, text.split())))
        while not (match := wrapped.search(self.text, self.seen)):
            more = self.read(1.0)
            assert more and time.monotonic() < deadline, (text, self.text[-2000:])
        self.seen = match.end()

    def type(self, text: str) -> None:
        """Type."""
        os.write(self.ours, text.encode())

    def waiting(self) -> int:
        """Return how many bytes of typed lines the command has not read."""
        handle = os.open(self.name, os.O_RDWR | os.O_NOCTTY)
        try:
            return int.from_bytes(fcntl.ioctl(handle, termios.FIONREAD, bytes(4)), sys.byteorder)
        finally:
            os.close(handle)

    def end(self, how: str) -> None:
        """End it, and see that it ended as it should."""
        if how == "kill":
            self.process.send_signal(signal.SIGKILL)
        else:
            self.type("\x03")
        deadline = time.monotonic() + PATIENCE
        while self.process.poll() is None and time.monotonic() < deadline:
            self.read(0.1)
        while self.read(0.0) and select.select([self.ours], [], [], 0.0)[0]:
            pass
        os.close(self.ours)
        assert self.process.wait(timeout=PATIENCE) == (-9 if how == "kill" else 130), self.text
        assert "Traceback" not in self.text, self.text


def whole(place: Place) -> dict[str, Any]:
    """Every file in the work folder that is JSON, each whole; nothing half-written lies about."""
    result = {}
    for path in place.work.rglob("*"):
        assert ".part" not in path.name and "damaged" not in path.name, path
        if path.suffix == ".json":
            result[path.name] = json.loads(path.read_text("utf-8"))
    return result


# --- Review -------------------------------------------------------------------------------------


@pytest.mark.prove
@ENDS
@pytest.mark.parametrize("phase", ["asked", "answered", "rated"])
def test_a_review_that_ends_keeps_what_was_rated(place: Place, end: str, phase: str) -> None:
    pytest.importorskip("fsrs")
    place.run("review", "--chapters", "2", "--limit", "1", "--seed", "1", text="\n3\n")
    before = whole(place)["reviews.json"]
    assert len(before["log"]) == 1
    terminal = Terminal(place, "review", "--chapters", "1", "--seed", "3", "--limit", "5")
    terminal.until("You can also type skip or quit.")
    if phase != "asked":
        terminal.type("\n")
        terminal.until("How well did you know it?")
    if phase == "rated":
        terminal.type("3\n")
        terminal.until("You can also type skip or quit.")
    terminal.end(end)
    after = whole(place)["reviews.json"]
    rated = 1 + (phase == "rated")
    assert len(after["log"]) == len(after["cards"]) == rated
    assert after["log"][0] == before["log"][0]
    assert before["cards"].items() <= after["cards"].items()
    again = place.json("review", "--chapters", "1", "--limit", "1", text="\n3\n")
    assert len(again["rated"]) == 1 and len(whole(place)["reviews.json"]["log"]) == rated + 1


# --- Interview ----------------------------------------------------------------------------------


def reopened(place: Place) -> rehearsal.Interview:
    """The interview that waits, with the lines that were typed before it ended."""
    from drills.session import Session
    from drills.terminal import Terminal as Screen

    session = Session("interview", Screen(), place.work)
    talk = rehearse.Talk(session)
    talk.resume()
    assert session.notices == []
    return talk.interview


@pytest.mark.prove
@ENDS
@pytest.mark.parametrize("phase", ["asked", "answering", "marking", "replying"])
def test_an_interview_that_ends_goes_on_where_it_was(place: Place, end: str, phase: str) -> None:
    terminal = Terminal(place, *CONCEPT)
    terminal.until("ends your answer")
    (opened,) = whole(place)["interviews.json"]["open"].values()
    spoken = rehearse.pool()[opened["items"][0]["key"]]
    if phase != "asked":
        terminal.type("A first line.\n")
        lines_of(place, "A first line.")
    if phase in ("marking", "replying"):
        terminal.type(".\n")
        terminal.until("How good was that?")
        terminal.until("1.")
        terminal.type("2\n")
        terminal.until("2.")
    if phase == "replying":
        for number in range(2, len(spoken.rubric) + 1):
            terminal.type("1\n")
            terminal.until(f"{number + 1}." if number < len(spoken.rubric) else "min left")
        terminal.until("ends your answer")
        terminal.type("A reply.\n")
        lines_of(place, "A reply.")
    terminal.end(end)
    whole(place)
    entry = reopened(place).items[0]
    assert entry.key == spoken.key and not entry.done
    assert entry.answer == ("" if phase == "asked" else "A first line.\n")
    marks = {"marking": 1, "replying": len(spoken.rubric)}.get(phase, 0)
    assert len(entry.marks) == marks and entry.marks[:1] == ["quantified"][:marks]
    assert entry.reply == ("A reply.\n" if phase == "replying" else "")


def lines_of(place: Place, text: str) -> None:
    """Wait until a line has reached the journal."""
    deadline = time.monotonic() + PATIENCE
    while not any(text in path.read_text("utf-8") for path in place.work.glob("*.lines")):
        assert time.monotonic() < deadline, text
        time.sleep(0.02)


@pytest.mark.prove
@ENDS
def test_questions_of_a_design_are_kept(place: Place, end: str) -> None:
    terminal = Terminal(place, "interview", "--kind", "design", "--minutes", "15", "--seed", "2")
    terminal.until("ends your questions.")
    terminal.type("How many robots and which sensors?\n")
    lines_of(place, "How many robots")
    lines_of(place, '"  *')  # the reply, which is stored after the question
    terminal.end(end)
    whole(place)
    (entry,) = reopened(place).items
    assert entry.clarified.startswith("* How many robots and which sensors?\n  *")


def waiting(place: Place, key: str, part: str) -> None:
    """Leave an interview of one item to go on with."""
    from drills.session import Session
    from drills.terminal import Terminal as Screen

    talk = rehearse.Talk(Session("interview", Screen(), place.work))
    item = rehearsal.Entry(key, part, 12, 10, "An item.")
    talk.interview = rehearsal.Interview("2026-01-02T03:04:05.678+00:00", 4, 15, [item])
    talk.begin()


@pytest.mark.prove
@ENDS
def test_probes_of_a_scenario_are_kept(place: Place, end: str) -> None:
    waiting(place, "scenario/touch", "debugging")
    terminal = Terminal(place, "interview", "--resume")
    terminal.until("the interview continues")
    terminal.until(">")
    terminal.type("probe quarter_gain\n")
    terminal.until("min spent")
    terminal.end(end)
    whole(place)
    (entry,) = reopened(place).items
    assert entry.answer == "probe quarter_gain\n"


@pytest.mark.prove
@ENDS
@pytest.mark.parametrize("phase", ["asked", "grading"])
def test_the_answer_to_a_drill_is_kept(place: Place, end: str, phase: str) -> None:
    waiting(place, "drill/fk3", "coding")
    place.watch_scratch()
    terminal = Terminal(place, "interview", "--resume")
    terminal.until("A blank line grades your answer")
    path = place.work / "interview" / "fk3.py"
    path.write_text(ENDLESS, encoding="utf-8")
    children: set[int] = set()
    if phase == "grading":
        terminal.type("\n")
        children = place.wait_for_answer(terminal.process)
    terminal.end(end)
    whole(place)
    nobody_left(children)
    (entry,) = reopened(place).items
    assert path.read_text("utf-8") == ENDLESS
    assert entry.attempts == [] and entry.answered and not entry.done


# --- Debug --------------------------------------------------------------------------------------


@pytest.mark.prove
@ENDS
@pytest.mark.parametrize("phase", ["begun", "probed"])
def test_debugging_that_ends_keeps_the_probes(place: Place, end: str, phase: str) -> None:
    terminal = Terminal(place, "debug", "touch", "--seed", "5")
    terminal.until("the case stays open")
    if phase == "probed":
        terminal.type("probe quarter_gain\n")
        terminal.until("min spent")
    terminal.end(end)
    causes = [cause.name for cause in scenarios.scenario("touch").causes]
    assert not any(f"The cause is {cause}" in terminal.text for cause in causes)
    bought = ["quarter_gain"] * (phase == "probed")
    stored = whole(place) if place.work.exists() else {}
    assert stored.get("debug.json", {}).get("probes", {}) == ({"touch/5": bought} if bought else {})
    again = place.json("debug", "touch", text="probe integral_off\nquit\n")
    assert [one["probe"] for one in again["findings"]] == [*bought, "integral_off"]
    assert not bought or again["seed"] == 5


def test_an_interrupt_that_comes_with_the_prompt_is_not_lost(place: Place) -> None:
    """Ctrl-S stops the output, so Ctrl-C comes while the prompt is written, before the reading.

    `input` loses it: the signal ends the writing, and nothing looks for signals before the reading.
    """
    terminal = Terminal(place, "debug", "touch", "--seed", "5")
    terminal.until("the case stays open")
    terminal.until(">")
    terminal.type("\x13")  # Ctrl-S
    terminal.type("\n")  # an empty line, which is answered by the next prompt and nothing else
    # Once the line is taken, the process sleeps only in writing the prompt.
    deadline = time.monotonic() + PATIENCE
    while terminal.waiting() or state(terminal.process.pid) != "S":
        assert time.monotonic() < deadline
        time.sleep(0.02)
    terminal.end("ctrl-c")


# --- Check --------------------------------------------------------------------------------------


def nobody_left(children: set[int]) -> None:
    """Wait until none of these processes is left."""
    deadline = time.monotonic() + PATIENCE
    while running := [pid for pid in children if state(pid) not in ("", "Z")]:
        assert time.monotonic() < deadline, running
        time.sleep(0.05)


def state(pid: int) -> str:
    """The state of a process, by /proc; "" if there is none."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    return ""


@pytest.mark.prove
@ENDS
def test_a_check_that_ends_counts_nothing_and_loses_nothing(place: Place, end: str) -> None:
    place.answer(catalogue.card("verlet").solution_text())
    assert place.run("check", "verlet").code == 0
    before = whole(place)["progress.json"]
    path = place.answer(ENDLESS, "fk3")
    place.watch_scratch()
    terminal = Terminal(place, "check", "fk3")
    children = place.wait_for_answer(terminal.process)
    terminal.end(end)
    nobody_left(children)
    assert whole(place)["progress.json"]["exercises"] == before["exercises"]
    assert path.read_text("utf-8") == ENDLESS
    assert place.run("check", "verlet").code == 0


# --- Long texts ---------------------------------------------------------------------------------


def test_a_long_text_stops_after_each_screen(place: Place) -> None:
    """No more lines than the screen has come at once, and Ctrl-C works between them."""
    terminal = Terminal(place, "debug", "touch", "--seed", "5", lines=8)
    read = 0
    for _ in range(2):
        terminal.until("-- Enter for more --")
        assert terminal.text[read : terminal.seen].count("\n") <= 9, terminal.text[read:]
        read = terminal.seen
        terminal.type("\n")
    terminal.until("-- Enter for more --")
    # What is typed too early is neither taken for the next answer nor lost without a word.
    terminal.type("probe 1\n")
    terminal.until("was not used: type it again at the next prompt")
    terminal.until("-- Enter for more --")
    terminal.end("ctrl-c")
    assert "Stopped." in terminal.text
