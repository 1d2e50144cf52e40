"""What a learner has read, attempted and solved: one small file that a person can read.

`drills.json_store` says how it is read and written, so that nothing is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from drills import json_store
from drills.json_store import Damaged

SCHEMA = "drills-progress/1"
NOT_ATTEMPTED, ATTEMPTED, SOLVED = "not_attempted", "attempted", "solved"
STATES = (NOT_ATTEMPTED, ATTEMPTED, SOLVED)


@dataclass
class Record:
    """What is known of one exercise.

    Attributes:
        state: one of `STATES`.
        attempts: gradings so far; an untouched starter is none.
        first, last, solved: when it was first and last graded, and first right; ISO 8601, UTC.
        hints: how many steps of the hint ladder were requested.
        gave_up: whether the solution was shown before the first pass.
        best: for each cost that a right answer had, the lowest value, and its unit.
        found: what the last check said is wrong, "" after a pass.
    """

    state: str = NOT_ATTEMPTED
    attempts: int = 0
    first: str = ""
    last: str = ""
    solved: str = ""
    hints: int = 0
    gave_up: bool = False
    best: dict[str, dict[str, Any]] = field(default_factory=dict)
    found: str = ""


@dataclass
class Reading:
    """What is known of one chapter.

    Attributes:
        opened: when its notebook was last run from the top; ISO 8601, UTC.
        read: numbers of the sections that the learner has marked as read, in order.
        checkpoint: when its checkpoint was passed first.
        tried: state of what is no exercise, by kind and name: "derivation/deep_queue".
        cards: the first answer to a card and whether it was right, by name: "contact.gentle_pull".
    """

    opened: str = ""
    read: list[int] = field(default_factory=list)
    checkpoint: str = ""
    tried: dict[str, str] = field(default_factory=dict)
    cards: dict[str, dict[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Loaded:
    """The records by exercise and by chapter, and what to tell the learner about the file."""

    records: dict[str, Record] = field(default_factory=dict)
    chapters: dict[int, Reading] = field(default_factory=dict)
    notices: tuple[str, ...] = ()

    def of(self, name: str) -> Record:
        """Return the record of an exercise, an empty one if there is none."""
        return self.records.get(name, Record())

    def reading(self, number: int) -> Reading:
        """Return the record of a chapter, an empty one if there is none."""
        return self.chapters.get(number, Reading())


def load(path: Path | None) -> Loaded:
    """Return the records in the file; a damaged file is moved aside and a notice says so.

    Args:
        path: of the file, or None to keep no progress.
    """
    loaded, notices = json_store.load(path, FORM)
    return replace(loaded, notices=notices)


def change(path: Path | None, name: str, edit: Callable[[Record], None]) -> Loaded:
    """Read, edit one record and write, under the lock.

    Args:
        path: of the file, or None to keep no progress.
        name: of the exercise.
        edit: changes the record in place.

    Returns:
        The new records, with a notice if a damaged file was moved aside.

    Raises:
        kept.Problem: if the file can't be written; it is then as it was.
    """
    return _edited(path, lambda loaded: edit(loaded.records.setdefault(name, Record())))


def change_chapter(path: Path | None, number: int, edit: Callable[[Reading], None]) -> Loaded:
    """Change the record of a chapter in place, and store it, as `change` does for an exercise.

    Raises:
        kept.Problem: if the file can't be written; it is then as it was.
    """
    return _edited(path, lambda loaded: edit(loaded.chapters.setdefault(number, Reading())))


def _edited(path: Path | None, edit: Callable[[Loaded], object]) -> Loaded:
    loaded, notices = json_store.change(path, FORM, edit)
    return replace(loaded, notices=notices)


def forget(path: Path | None, name: str) -> None:
    """Drop the record of an exercise.

    Raises:
        kept.Problem: if the file can't be written.
    """
    if path is not None:
        _edited(path, lambda loaded: loaded.records.pop(name, None))


def note_attempt(
    record: Record,
    passed: bool,
    costs: dict[str, tuple[float, str]],
    now: str | None = None,
    diagnosis: str = "",
) -> None:
    """Enter one grading into a record.

    Args:
        record: changed in place.
        passed: the verdict.
        costs: of this attempt: value and unit by name; they count only for a right answer.
        now: the time, ISO 8601; the clock's if None.
        diagnosis: what is wrong, for the next hint.
    """
    record.found = "" if passed else "".join(c if c.isprintable() else " " for c in diagnosis)[:500]
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


def note_tried(reading: Reading, key: str, passed: bool) -> None:
    """Enter an attempt at a derivation, a lab or a design; what is solved stays solved."""
    if passed or reading.tried.get(key) != SOLVED:
        reading.tried[key] = SOLVED if passed else ATTEMPTED


def timestamp() -> str:
    """Return the time now, in UTC, to the second."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def _loaded(content: dict[str, Any]) -> Loaded:
    entries, chapters = content.get("exercises"), content.get("chapters", {})
    if not isinstance(entries, dict) or not isinstance(chapters, dict):
        raise Damaged
    numbers = all(name.isascii() and name.isdigit() and len(name) < 4 for name in chapters)
    if not numbers or not all(name.isprintable() for name in entries):
        raise Damaged
    return Loaded(
        {name: _record(entry) for name, entry in entries.items()},
        {int(name): _reading(entry) for name, entry in chapters.items()},
    )


def _reading(entry: Any) -> Reading:
    if not isinstance(entry, dict):
        raise Damaged
    reading = Reading(**{f.name: entry[f.name] for f in fields(Reading) if f.name in entry})
    texts = (reading.opened, reading.checkpoint)
    sane = (
        all(isinstance(text, str) and text.isprintable() for text in texts)
        and isinstance(reading.read, list)
        and all(type(number) is int and 0 <= number < 1000 for number in reading.read)
        and isinstance(reading.tried, dict)
        and all(key.isprintable() for key in reading.tried)
        and all(state in (ATTEMPTED, SOLVED) for state in reading.tried.values())
        and isinstance(reading.cards, dict)
        and all(name.isprintable() and _is_answer(card) for name, card in reading.cards.items())
    )
    if not sane:
        raise Damaged
    return reading


def _record(entry: Any) -> Record:
    if not isinstance(entry, dict):
        raise Damaged
    record = Record(**{f.name: entry[f.name] for f in fields(Record) if f.name in entry})
    texts = (record.first, record.last, record.solved, record.found)
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
        raise Damaged
    return record


def _is_answer(entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and set(entry) == {"answer", "right"}
        and isinstance(entry["answer"], str)
        and entry["answer"].isprintable()
        and isinstance(entry["right"], bool)
    )


def _is_cost(entry: Any) -> bool:
    return (
        isinstance(entry, dict)
        and type(entry.get("value")) in (int, float)
        and abs(entry["value"]) < 1e300  # no NaN either
        and isinstance(entry.get("unit"), str)
        and entry["unit"].isprintable()
    )


def _plain(loaded: Loaded) -> dict[str, Any]:
    return {
        "chapters": {str(n): asdict(one) for n, one in sorted(loaded.chapters.items())},
        "exercises": {name: asdict(one) for name, one in sorted(loaded.records.items())},
    }


FORM = json_store.Form(SCHEMA, "progress", Loaded, _loaded, _plain)
