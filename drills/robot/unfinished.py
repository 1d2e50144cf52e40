"""A note of the run that is under way, so that the next command can say how it ended.

The running command holds a lock on the note. The system drops the lock when the command ends,
however it ends, so a note without a lock belongs to a run that was killed.
"""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from drills import workspace
from drills.robot import store
from drills.robot.levels import LEVELS
from drills.robot.store import Stored
from drills.session import Session

HIDDEN = LEVELS[-1].number  # the level whose result is a log


def path_of(session: Session) -> Path | None:
    """Return the file of the note; None where no progress is stored."""
    path = store.path_of(session.work, session.progress_file)
    return path and path.with_name(".robot-run.lock")


@contextlib.contextmanager
def noted(session: Session, number: int, tasks: int, started: str) -> Iterator[None]:
    """Note a run for as long as it lasts; the note stays if the process is ended from outside.

    Args:
        session: of the command.
        number: of the level.
        tasks: n.
        started: when it started, as the stored run has it.
    """
    handle = _locked(path_of(session), os.O_CREAT)
    if handle is None:  # nothing is stored, or another terminal plays
        yield
        return
    try:
        row = {"level": number, "tasks": tasks, "at": started}
        os.ftruncate(handle, 0)
        os.pwrite(handle, json.dumps(row).encode(), 0)
        try:
            yield
        except SystemExit:  # SIGTERM or SIGHUP: nobody has been told how the run ended
            raise
        except BaseException:
            os.ftruncate(handle, 0)
            raise
        os.ftruncate(handle, 0)
    finally:
        os.close(handle)


def report(session: Session, stored: Stored) -> None:
    """Say in one sentence how a run ended that was killed; it is said once."""
    handle = _locked(path_of(session), 0)
    if handle is None:
        return
    try:
        with contextlib.suppress(ValueError, KeyError, TypeError):
            row = json.loads(os.pread(handle, 4096, 0))
            text = _sentence(session, stored, row, os.fstat(handle).st_mtime)
            session.wrap(text)
            session.notices += [text] * session.terminal.json
        os.ftruncate(handle, 0)
    finally:
        os.close(handle)


def _sentence(session: Session, stored: Stored, row: dict[str, Any], started: float) -> str:
    number, tasks = int(row["level"]), int(row["tasks"])
    lead = f"Your last run (level {number}, {tasks} tasks) was stopped before"
    if number == HIDDEN:
        log = session.work / "robot_log.csv"
        if log.is_file() and log.stat().st_mtime >= started:
            return f"{lead} its report was complete; its log is in {workspace.shown(log)}."
        return f"{lead} its log was written: drills robot run --level {HIDDEN} plays it again."
    if any(run.get("at") == row["at"] and run.get("level") == number for run in stored.runs):
        return (
            f"{lead} its report was complete; its result is stored, and drills robot history "
            "shows it."
        )
    return f"{lead} all of its tasks were played, so nothing of it is stored."


def _locked(path: Path | None, flags: int) -> int | None:
    """Open the note and lock it; None if it is not there or another process holds it."""
    if path is None:
        return None
    import fcntl

    try:
        if flags & os.O_CREAT:
            path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(path, os.O_RDWR | os.O_CLOEXEC | flags, 0o644)
    except OSError:
        return None
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle
