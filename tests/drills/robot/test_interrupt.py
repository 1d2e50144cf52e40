"""Ctrl-C at many moments of `drills robot run`, typed into a real terminal.

It ends with one sentence and exit code 130, blames no part, and changes no file.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from drills import interrupts, workspace
from drills.robot.inside import Robot
from drills.robot.levels import exact_world, level
from drills.robot.parts import PartFailed
from tests.budget import sampled
from tests.drills.place import ROOT, Place, a_place, descendants
from tests.drills.robot.robots import parts_with
from tests.interview.test_killed import Terminal, nobody_left

__all__ = ["a_place"]
BLAMED = ("stopped the robot", "broke a promise", "Look at", "our fault", "Traceback", "ignored")
# A solved exercise of the learner: the robot then plays in child processes.
SLOT = "lqr"


def test_ctrl_c_in_a_trusted_part_is_no_fault_of_the_part() -> None:
    """A part of the course runs in this process, so that the interrupt must come out of it."""
    text = "def lqr(A, B, Q, R):\n    raise KeyboardInterrupt\n"
    with pytest.raises(KeyboardInterrupt):
        Robot(parts_with(lqr=text), level(1), exact_world(), 0, limit=0.0).play(0)
    # In a child process it can only be the learner's own.
    with contextlib.suppress(PartFailed):
        outcome = Robot(parts_with(lqr=text), level(1), exact_world(), 0, limit=3.0).play(0)
        assert outcome["failure"][0] == "lqr"


def in_a_process(body: str) -> tuple[int, str]:
    """Run a program that notes interrupts and gets one once it says that it is ready."""
    program = (
        "import sys, time\nfrom drills import interrupts\ninterrupts.note()\n"
        "def ready():\n    print('ready', flush=True)\n" + body
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=120)
    return process.returncode, out


SWALLOWED = """
class Swallows:
    def __del__(self):
        ready()
        time.sleep(60)

try:
    with interrupts.heeded(ends_process=True):
        Swallows()
        print("went on")
    print("as if nothing had come")
except KeyboardInterrupt:
    print("interrupted")
    sys.exit(130)
"""
TURNED = """
try:
    with interrupts.heeded():
        try:
            ready()
            time.sleep(60)
        except KeyboardInterrupt:
            raise SystemError("initialization failed") from None
except KeyboardInterrupt:
    print("interrupted")
    sys.exit(130)
"""
IGNORED = """
with interrupts.heeded(ends_process=True):
    first = True
    while True:
        try:
            if first:
                first = False
                ready()
            time.sleep(60)
        except KeyboardInterrupt:
            pass
"""


@pytest.mark.parametrize(
    ("body", "message"),
    [(SWALLOWED, "interrupted"), (TURNED, "interrupted"), (IGNORED, "Stopped.")],
    ids=["swallowed", "turned into another error", "ignored for ever"],
)
def test_whatever_happens_to_the_exception_the_block_ends(body: str, message: str) -> None:
    code, out = in_a_process(body)
    assert code == 130, out
    assert message in out and "as if nothing" not in out and "ignored" not in out


def test_an_interrupted_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "robot_call.py"
    path.write_text("old")

    def interrupted(_: int) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        workspace.write_over(path, "new")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def content(folder: Path) -> dict[str, bytes]:
    """Every file below a folder but locks."""
    files = (path for path in folder.rglob("*") if path.is_file() and ".lock" not in path.name)
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def stop_at(place: Place, seconds: float, *arguments: str) -> tuple[str, float]:
    """Type Ctrl-C after so long; return what was written, and how long the end took [s].

    The text is "" if the command ended by itself before.
    """
    before = content(place.work)
    terminal = Terminal(place, "robot", "run", *arguments)
    begun = time.monotonic()
    while (
        remaining := seconds - (time.monotonic() - begun)
    ) > 0 and terminal.process.poll() is None:
        terminal.read(min(remaining, 0.05))
    children = descendants(terminal.process.pid)
    if terminal.process.poll() is not None:
        terminal.process.wait()
        os.close(terminal.ours)
        return "", 0.0
    typed = time.monotonic()
    terminal.type("\x03")
    while terminal.process.poll() is None and time.monotonic() - typed < 120:
        terminal.read(0.02)
    took = time.monotonic() - typed
    while terminal.read(0.0) and select.select([terminal.ours], [], [], 0.0)[0]:
        pass
    os.close(terminal.ours)
    assert terminal.process.returncode == 130, terminal.text
    written = terminal.text.replace("\x1b[0m", "")  # with which a library ends
    assert written.rstrip().endswith("Stopped."), terminal.text
    assert not any(word in terminal.text for word in BLAMED), terminal.text
    nobody_left(children)
    assert content(place.work) == before
    return terminal.text, took


@pytest.mark.slow
@pytest.mark.parametrize(
    "own",
    [pytest.param(False, id="known", marks=pytest.mark.prove), pytest.param(True, id="own")],
)
def test_ctrl_c_at_any_moment_of_a_run(place: Place, own: bool) -> None:
    """At moments that are spread from the first import to the middle of the tasks."""
    place.work.mkdir()
    (place.work / "robot_call.py").write_text("# of an earlier run\n")
    arguments = ["--tasks", "3000", "--no-libraries"]
    if own:
        from drills import cards

        place.answer(cards.card(SLOT).solution_text(), SLOT)
        arguments += ["--part", f"{SLOT}=yours"]
    place.run("robot", "status")  # what it notes of the files is noted before
    moments = sampled([0.4 + 0.9 * k for k in range(6)], 2)
    ended = [stop_at(place, moment, *arguments) for moment in moments]
    assert 3 * sum(bool(text) for text, _ in ended) >= 2 * len(moments)


def test_a_swallowed_interrupt_writes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Once it came, no file of the robot is written."""
    from drills.robot import state, tables

    monkeypatch.setattr(interrupts, "came", lambda: True)
    with pytest.raises(KeyboardInterrupt):
        state.change(None, lambda _: None)  # type: ignore[arg-type]
    part = parts_with(lqr="def lqr(): pass")
    with pytest.raises(KeyboardInterrupt):
        tables.say_call(None, "lqr", "", "x" * 400, part)  # type: ignore[arg-type]
