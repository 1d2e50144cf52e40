"""What a learner has attempted and solved: one small file that a person can read.

The file is written to a temporary name and then replaced, under a lock that the system drops when
its holder ends, however it ends. So a reader sees the old file or the new one, and two terminals at
once lose nothing. A file that makes no sense is put aside under another name, never overwritten.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import stat
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

SCHEMA = "drills-progress/1"
NOT_ATTEMPTED, ATTEMPTED, SOLVED = "not_attempted", "attempted", "solved"
STATES = (NOT_ATTEMPTED, ATTEMPTED, SOLVED)

_PATIENCE = 10.0  # s, for another terminal to finish its few milliseconds of work
_LARGEST = 4_000_000  # bytes; a real file has a few thousand


class ProgressProblem(Exception):
    """The progress could not be read or written; the message is a sentence for the learner."""


@dataclass
class Record:
    """What is known of one exercise.

    Attributes:
        state: one of `STATES`.
        attempts: gradings so far; an untouched starter is none.
        first, last, solved: when it was first and last graded, and first right; ISO 8601, UTC.
        hints: how many steps of the hint ladder were asked for.
        gave_up: whether the solution was shown before the first pass.
        best: for each cost that a right answer had, the lowest value, and its unit.
    """

    state: str = NOT_ATTEMPTED
    attempts: int = 0
    first: str = ""
    last: str = ""
    solved: str = ""
    hints: int = 0
    gave_up: bool = False
    best: dict[str, dict[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Loaded:
    """The records by exercise, and what the learner should be told about the file."""

    records: dict[str, Record]
    notices: tuple[str, ...] = ()

    def of(self, name: str) -> Record:
        """The record of an exercise, an empty one if there is none."""
        return self.records.get(name, Record())


def load(path: Path | None) -> Loaded:
    """The records in the file; a damaged file is put aside and a notice says so.

    Args:
        path: of the file, or None to keep no progress.
    """
    if path is None:
        return Loaded({})
    try:
        return Loaded(_read(path))
    except _Damaged:
        pass
    except ProgressProblem as problem:
        return Loaded({}, (str(problem),))
    try:
        with _locked(path):
            return _read_or_put_aside(path)
    except ProgressProblem as problem:
        return Loaded({}, (str(problem),))


def change(path: Path | None, name: str, edit: Callable[[Record], None]) -> Loaded:
    """Read, edit one record and write, under the lock.

    Args:
        path: of the file, or None to keep no progress.
        name: of the exercise.
        edit: changes the record in place.

    Returns:
        The new records, with a notice if a damaged file was put aside.

    Raises:
        ProgressProblem: if the file can't be written; it is then as it was.
    """
    if path is None:
        records = {name: Record()}
        edit(records[name])
        return Loaded(records)
    with _locked(path):
        loaded = _read_or_put_aside(path)
        record = loaded.records.setdefault(name, Record())
        edit(record)
        _write(path, loaded.records)
    return loaded


def forget(path: Path | None, name: str) -> None:
    """Drop the record of an exercise.

    Raises:
        ProgressProblem: if the file can't be written.
    """
    if path is None:
        return
    with _locked(path):
        loaded = _read_or_put_aside(path)
        if loaded.records.pop(name, None) is not None:
            _write(path, loaded.records)


def note_attempt(
    record: Record, passed: bool, costs: dict[str, tuple[float, str]], now: str | None = None
) -> None:
    """Enter one grading into a record.

    Args:
        record: changed in place.
        passed: the verdict.
        costs: of this attempt: value and unit by name; they count only for a right answer.
        now: the time, ISO 8601; the clock's if None.
    """
    now = now or timestamp()
    record.attempts += 1
    record.first = record.first or now
    record.last = now
    if not passed:
        if record.state == NOT_ATTEMPTED:
            record.state = ATTEMPTED
        return
    record.state = SOLVED
    record.solved = record.solved or now
    for what, (value, unit) in costs.items():
        before = record.best.get(what)
        if before is None or before["unit"] != unit or value < before["value"]:
            record.best[what] = {"value": value, "unit": unit}


def timestamp() -> str:
    """The time now, in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


class _Damaged(Exception):
    """The file is there and is not a progress file."""


def _read(path: Path) -> dict[str, Record]:
    try:
        # Opening a named pipe would otherwise wait for somebody to write.
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            regular = stat.S_ISREG(os.fstat(file.fileno()).st_mode)
            data = file.read(_LARGEST + 1) if regular else b""
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise ProgressProblem(f"Your progress in {path} can't be read: {_why(error)}.") from None
    if not regular:
        raise ProgressProblem(f"Your progress in {path} can't be read: it is not a file.")
    if len(data) > _LARGEST:
        raise _Damaged
    try:
        content = json.loads(data.decode("utf-8"))
    except (ValueError, RecursionError):
        raise _Damaged from None
    return _records(content, path)


def _records(content: Any, path: Path) -> dict[str, Record]:
    if not isinstance(content, dict) or not isinstance(content.get("schema"), str):
        raise _Damaged
    schema, entries = content["schema"], content.get("exercises")
    if schema != SCHEMA and schema.startswith("drills-progress/"):
        raise ProgressProblem(
            f"{path} was written by another version of this program ({schema}, here {SCHEMA}), "
            "so it is left alone."
        )
    if schema != SCHEMA or not isinstance(entries, dict):
        raise _Damaged
    if not all(name.isprintable() for name in entries):
        raise _Damaged
    return {name: _record(entry) for name, entry in entries.items()}


def _record(entry: Any) -> Record:
    if not isinstance(entry, dict):
        raise _Damaged
    record = Record(**{f.name: entry[f.name] for f in fields(Record) if f.name in entry})
    texts = (record.first, record.last, record.solved)
    sane = (
        record.state in STATES
        and all(
            type(count) is int and 0 <= count < 1 << 53 for count in (record.attempts, record.hints)
        )
        and all(isinstance(text, str) and text.isprintable() for text in texts)
        and isinstance(record.gave_up, bool)
        and isinstance(record.best, dict)
        and all(name.isprintable() and _is_cost(cost) for name, cost in record.best.items())
    )
    if not sane:
        raise _Damaged
    return record


def _is_cost(entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and type(entry.get("value")) in (int, float)
        and abs(entry["value"]) < 1e300  # no NaN either
        and isinstance(entry.get("unit"), str)
        and entry["unit"].isprintable()
    )


def _read_or_put_aside(path: Path) -> Loaded:
    """Under the lock: the records, or none after a damaged file was given another name."""
    try:
        return Loaded(_read(path))
    except _Damaged:
        pass
    number = 1
    while os.path.lexists(aside := path.with_name(f"{path.name}.damaged-{number}")):
        number += 1
    try:
        os.rename(path, aside)
    except OSError as error:
        raise ProgressProblem(
            f"Your progress in {path} is damaged and can't be put aside: {_why(error)}."
        ) from None
    notice = f"Your progress file was damaged. It is kept as {aside}; a new one starts now."
    return Loaded({}, (notice,))


def _write(path: Path, records: dict[str, Record]) -> None:
    entries = {name: asdict(records[name]) for name in sorted(records)}
    text = json.dumps({"schema": SCHEMA, "exercises": entries}, indent=2, ensure_ascii=False) + "\n"
    # A link is followed, so that the file it leads to is replaced and not the link.
    target = Path(os.path.realpath(path))
    part = target.with_name(f".{target.name}.part")
    try:
        # Only the holder of the lock writes: a part that is there was left by a killed process.
        with contextlib.suppress(FileNotFoundError):
            part.unlink()
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0)
        with os.fdopen(os.open(part, flags, 0o644), "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, target)
        _sync_folder(target.parent)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink()
        raise ProgressProblem(f"Your progress in {path} can't be written: {_why(error)}.") from None


def _sync_folder(folder: Path) -> None:
    """Make the new name last through a power cut, where the file system can."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextlib.contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold the lock beside the file; the system drops it when this process ends."""
    import fcntl

    lock = path.with_name(f".{path.name}.lock")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise ProgressProblem(f"Your progress in {path} can't be written: {_why(error)}.") from None
    try:
        deadline = time.monotonic() + _PATIENCE
        while True:
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except OSError as error:
                if error.errno in (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS):
                    break  # a file system without locks: replacing is still atomic
                if error.errno not in (errno.EAGAIN, errno.EACCES, errno.EINTR):
                    raise ProgressProblem(
                        f"Your progress in {path} can't be locked: {_why(error)}."
                    ) from None
            if time.monotonic() > deadline:
                raise ProgressProblem(
                    f"Another process has held the lock {lock} for {_PATIENCE:.0f} s, "
                    "so this was not recorded."
                )
            time.sleep(0.01)
        yield
    finally:
        os.close(handle)


def _why(error: OSError) -> str:
    return (error.strerror or type(error).__name__).lower()
