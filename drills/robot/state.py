"""What the commands of the robot share: what is stored, who holds the slots, and the bar."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from drills import interrupts, json_store
from drills.json_store import Problem
from drills.robot import store, unfinished
from drills.robot.holders import Holder, holders
from drills.robot.levels import LEVELS
from drills.robot.slots import STAGES, YOURS, Part, stage_of
from drills.robot.store import Stored
from drills.session import Session
from drills.terminal import bar

TASKS = 200
HIDDEN = 6  # the level with a hidden fault
SLOW = 1.0  # s, the longest silence before a line says what takes so long


def load(session: Session) -> tuple[Stored, dict[str, Holder]]:
    """Return what is stored and who holds the slots; say how a run ended that was killed."""
    path = store.path_of(session.work, session.progress_file)
    stored, notices = json_store.load(path, store.FORM)
    session.notices += notices
    unfinished.report(session, stored)
    before = {name: dict(row) for name, row in stored.graded.items()}
    held = holders(session.work, session.records(), stored)
    if stored.graded != before:

        def remember(new: Stored) -> None:
            new.graded = stored.graded

        change(session, remember)
    return stored, held


def change(session: Session, edit: Callable[[Stored], object]) -> None:
    """Edit what is stored; a notice says where that is not possible."""
    interrupts.check()
    path = store.path_of(session.work, session.progress_file)
    try:
        _, notices = json_store.change(path, store.FORM, edit)
        session.notices += notices
    except Problem as problem:
        session.notices.append(str(problem))


def next_level(stored: Stored) -> int:
    """Return the first level that is not passed."""
    return next((one.number for one in LEVELS if str(one.number) not in stored.passed), HIDDEN)


def stages_without(parts: list[Part]) -> list[str]:
    """Return the stages in which no part is the learner's."""
    own = {stage_of(part.slot) for part in parts if part.holder == YOURS}
    return [stage for stage in STAGES if stage not in own]


def progress_bar(session: Session, robot: str) -> Any:
    """Return what draws the bar, where somebody is watching."""
    if session.terminal.json or sys.stderr is None or not sys.stderr.isatty():
        return None

    def draw(done: int, of: int) -> None:
        end = "\r" + " " * 60 + "\r" if done == of else ""
        text = bar(done, of, 30)
        text = text if session.terminal.unicode else text.replace("█", "#").replace("░", ".")
        sys.stderr.write(f"\r  {robot:<12} {text} {done}/{of}{end}")
        sys.stderr.flush()

    return draw


@contextmanager
def announcing(session: Session) -> Iterator[None]:
    """Write one line to standard error if what is inside takes longer than a second."""

    def announce() -> None:
        if not session.terminal.json and sys.stderr is not None:
            text = "Loading the compiled parts. The first run compiles them, in about 30 s ..."
            sys.stderr.write(f"  {text}\n")
            sys.stderr.flush()

    timer = threading.Timer(SLOW, announce)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def compile_known(session: Session) -> None:
    """Load the compiled parts; only an installation's first run has to compile them."""
    with announcing(session), interrupts.heeded(ends_process=True):
        from drills.robot import compiled

        compiled.warm()
