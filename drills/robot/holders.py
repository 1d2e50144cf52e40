"""Who holds each slot: yours once its exercise is solved, else the course's."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from drills import cards as catalogue
from drills import progress, workspace
from drills.progress import SOLVED
from drills.robot import libraries
from drills.robot.parts import load_part
from drills.robot.slots import COURSE, FUNCTIONS, NAMED, NAMES, SLOTS, STAGES, YOURS, Part
from drills.robot.store import Stored
from drills.workspace import Misuse


class Holder(NamedTuple):
    """Who holds a slot.

    Attributes:
        part: what fills it.
        digest: of its text, 8 letters.
        state: of the exercise, as in `drills.progress`.
        changed: whether the file has changed since it was graded.
        missing: whether the exercise is solved and its file is gone.
        wrong: what the last grading found wrong in the answer, "" if it was right.
    """

    part: Part
    digest: str
    state: str
    changed: bool = False
    missing: bool = False
    wrong: str = ""


def digest_of(text: str) -> str:
    """Return a short hash of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def course_part(name: str) -> Part:
    """Return the course's part for a slot: the worked answer of its exercise."""
    card = catalogue.card(name)
    return Part(name, COURSE, card.solution_text(), card.entry, f"{name}.py")


def course_function(name: str) -> Callable[..., Any]:
    """Return the function that the course's part for a slot defines."""
    return load_part(course_part(name))


def library_part(name: str) -> Part:
    """Return the part of the first installed library for a slot, the course's where there is none.

    Args:
        name: of the slot.
    """
    for library in libraries.offers(name):
        part = libraries.part(name, library)
        if part is not None and libraries.installed(library):
            return part
    return course_part(name)


def own_part(work: Path, name: str) -> Part | None:
    """Return the learner's part for a slot, or None where there is no file that can be read."""
    from drills.sandbox.submission import Unreadable, read_submission

    path = workspace.answer(work, name)
    if not path.exists():
        return None
    try:
        source = read_submission(str(path))
    except Unreadable as error:
        raise Misuse(error.sentence) from None
    return Part(name, YOURS, source, catalogue.card(name).entry, workspace.shown(path))


def holders(work: Path, loaded: progress.Loaded, stored: Stored) -> dict[str, Holder]:
    """Return who holds each slot by default, and remember the files that were graded."""
    result = {}
    for name in NAMES:
        record = loaded.of(name)
        own = own_part(work, name) if record.state == SOLVED else None
        part = own or course_part(name)
        digest = digest_of(part.source)
        changed = False
        if own is not None:
            # The first file after a grading counts as the graded one.
            known = stored.graded.get(name, {})
            grading = f"{record.last} {record.attempts}"  # two gradings may share a second
            if known.get("at") != grading:
                stored.graded[name] = {"hash": digest, "at": grading}
            else:
                changed = known.get("hash") != digest
        missing = record.state == SOLVED and own is None
        wrong = "" if own is None else record.found
        result[name] = Holder(part, digest, record.state, changed, missing, wrong)
    return result


def chosen(
    work: Path,
    defaults: dict[str, Holder],
    choices: Sequence[str],
    own: Sequence[str],
    notices: list[str] | None = None,
) -> list[Part]:
    """Return the parts of a run.

    Args:
        work: folder of the answers.
        defaults: who holds each slot otherwise.
        choices: "SLOT=HOLDER" or "STAGE=HOLDER", where the holder is "yours", "course" or a
            library.
        own: "FUNCTION=FILE": a function of `records.Stages` that a file defines.
        notices: receives a sentence for each library that is not installed.

    Raises:
        Misuse: for a slot, a holder or a file that does not exist.
    """
    parts = {name: holder.part for name, holder in defaults.items()}
    for choice in choices:
        where, _, holder = choice.partition("=")
        names = [slot.name for slot in SLOTS if where in (slot.name, slot.stage)]
        if not names:
            near = _near(where, [*STAGES, *NAMES])
            raise Misuse(
                f"There is no slot or stage {where!r}. {near}drills robot status lists them."
            )
        for name in names:
            if holder in libraries.offers(name) and not libraries.installed(holder):
                instead = "your part" if parts[name].holder == YOURS else "the course's part"
                package = libraries.PACKAGES.get(holder, holder)
                if notices is not None:
                    notices.append(
                        f"{holder} is not installed, so {instead} stays in {name}. "
                        f"pip install {package}"
                    )
                continue
            parts[name] = _part(work, name, holder, whole=where in STAGES, default=parts[name])
    result = list(parts.values())
    for choice in own:
        function, _, file = choice.partition("=")
        if function not in FUNCTIONS:
            raise Misuse(
                f"There is no function {function!r}. A file may replace one of: "
                f"{', '.join(FUNCTIONS)}."
            )
        path = Path(file)
        if not path.is_file():
            raise Misuse(f"There is no file {file}.")
        text = path.read_text(encoding="utf-8")
        result.append(Part(function, YOURS, text, function, workspace.shown(path)))
    return result


def _part(work: Path, name: str, holder: str, whole: bool, default: Part) -> Part:
    if holder == COURSE:
        return course_part(name)
    if holder == YOURS:
        own = own_part(work, name)
        if own is None and whole:
            return default  # of a stage, those that there are
        if own is None:
            raise Misuse(f"You have no {name} yet. drills start {name} begins.")
        return own
    part = libraries.part(name, holder)
    if part is None and whole:
        return default
    if part is None:
        offers = libraries.offers(name)
        also = f", {', '.join(offers)}" if offers else ""
        raise Misuse(f"Slot {name} can be held by: yours, course{also}. Not by {holder!r}.")
    return part


def _near(word: str, known: list[str]) -> str:
    import difflib

    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f"Did you mean {close[0]}? " if close else ""


def stage_holders(parts: list[Part]) -> dict[str, str]:
    """Return who holds the slots of each stage, as "3 yours, 2 course"."""
    result = {}
    for stage in STAGES:
        count: dict[str, int] = {}
        for part in parts:
            if part.slot in NAMED and NAMED[part.slot].stage == stage:
                count[part.holder] = count.get(part.holder, 0) + 1
        result[stage] = ", ".join(f"{n} {holder}" for holder, n in count.items())
    return result
