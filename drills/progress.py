"""What a learner has read, attempted and solved: one small file that a person can read.

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


@dataclass
class Reading:
    """What is known of one chapter.

    Attributes:
        opened: when its notebook was last run from the top; ISO 8601, UTC.
        read: numbers of the sections that the learner has marked as read, in order.
        checkpoint: when its checkpoint was passed first.
    """

    opened: str = ""
    read: list[int] = field(default_factory=list)
    checkpoint: str = ""


@dataclass(frozen=True)
class Loaded:
    """The records by exercise and by chapter, and what to tell the learner about the file."""

    records: dict[str, Record] = field(default_factory=dict)
    chapters: dict[int, Reading] = field(default_factory=dict)
    notices: tuple[str, ...] = ()

    def of(self, name: str) -> Record:
        """The record of an exercise, an empty one if there is none."""
        return self.records.get(name, Record())

    def reading(self, number: int) -> Reading:
        """The record of a chapter, an empty one if there is none."""
        return self.chapters.get(number, Reading())


def load(path: Path | None) -> Loaded:
    """The records in the file; a damaged file is put aside and a notice says so.

    Args:
        path: of the file, or None to keep no progress.
    """
    if path is None:
        return Loaded()
    try:
        return _read(path)
    except _Damaged:
        pass
    except ProgressProblem as problem:
        return Loaded(notices=(str(problem),))
    try:
        with _locked(path):
            return _read_or_put_aside(path)
    except ProgressProblem as problem:
        return Loaded(notices=(str(problem),))


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
    return _edited(path, lambda loaded: edit(loaded.records.setdefault(name, Record())))


def change_chapter(path: Path | None, number: int, edit: Callable[[Reading], None]) -> Loaded:
    """The same for the record of a chapter.

    Raises:
        ProgressProblem: if the file can't be written; it is then as it was.
    """
    return _edited(path, lambda loaded: edit(loaded.chapters.setdefault(number, Reading())))


def _edited(path: Path | None, edit: Callable[[Loaded], object]) -> Loaded:
    if path is None:
        loaded = Loaded()
        edit(loaded)
        return loaded
    with _locked(path):
        loaded = _read_or_put_aside(path)
        edit(loaded)
        _write(path, loaded)
    return loaded


def forget(path: Path | None, name: str) -> None:
    """Drop the record of an exercise.

    Raises:
        ProgressProblem: if the file can't be written.
    """
    if path is not None:
        _edited(path, lambda loaded: loaded.records.pop(name, None))


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


def note_read(reading: Reading, numbers: list[int], undo: bool = False) -> None:
    """Mark sections of a chapter as read, or take the marks away."""
    marked = set(reading.read)
    reading.read = sorted(marked - set(numbers) if undo else marked | set(numbers))


def note_checkpoint(reading: Reading, undo: bool = False) -> None:
    """Mark the checkpoint of a chapter as passed, or take that back; the first time counts."""
    reading.checkpoint = "" if undo else reading.checkpoint or timestamp()


def timestamp() -> str:
    """The time now, in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


class _Damaged(Exception):
    """The file is there and is not a progress file."""


def _read(path: Path) -> Loaded:
    try:
        # Opening a named pipe would otherwise wait for somebody to write.
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb") as file:
            regular = stat.S_ISREG(os.fstat(file.fileno()).st_mode)
            data = file.read(_LARGEST + 1) if regular else b""
    except FileNotFoundError:
        return Loaded()
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
    return _loaded(content, path)


def _loaded(content: Any, path: Path) -> Loaded:
    if not isinstance(content, dict) or not isinstance(content.get("schema"), str):
        raise _Damaged
    schema, entries = content["schema"], content.get("exercises")
    chapters = content.get("chapters", {})
    if schema != SCHEMA and schema.startswith("drills-progress/"):
        raise ProgressProblem(
            f"{path} was written by another version of this program ({schema}, here {SCHEMA}), "
            "so it is left alone."
        )
    if schema != SCHEMA or not isinstance(entries, dict) or not isinstance(chapters, dict):
        raise _Damaged
    numbers = all(name.isascii() and name.isdigit() and len(name) < 4 for name in chapters)
    if not numbers or not all(name.isprintable() for name in entries):
        raise _Damaged
    return Loaded(
        {name: _record(entry) for name, entry in entries.items()},
        {int(name): _reading(entry) for name, entry in chapters.items()},
    )


def _reading(entry: Any) -> Reading:
    if not isinstance(entry, dict):
        raise _Damaged
    reading = Reading(**{f.name: entry[f.name] for f in fields(Reading) if f.name in entry})
    texts = (reading.opened, reading.checkpoint)
    sane = (
        all(isinstance(text, str) and text.isprintable() for text in texts)
        and isinstance(reading.read, list)
        and all(type(number) is int and 0 <= number < 1000 for number in reading.read)
    )
    if not sane:
        raise _Damaged
    return reading


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
        return _read(path)
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
    return Loaded(notices=(notice,))


def _write(path: Path, loaded: Loaded) -> None:
    content = {
        "schema": SCHEMA,
        "chapters": {str(n): asdict(one) for n, one in sorted(loaded.chapters.items())},
        "exercises": {name: asdict(one) for name, one in sorted(loaded.records.items())},
    }
    text = json.dumps(content, indent=2, ensure_ascii=False) + "\n"
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
