"""The chapters' notebooks: their sections, and the copies that a learner reads and answers in.

A copy stands in the work folder. It names in its metadata the version of the course's notebook that
it was made from; the cells of that version are kept in the folder `.course` beside it. So a newer
version is brought in by comparing three: what the course had, what the learner made of it, and what
the course has now. A copy is replaced in one go, with the name of its version in it, so that
nothing is ever half new.
"""

from __future__ import annotations

import contextlib
import difflib
import hashlib
import json
import os
import re
import urllib.parse
import urllib.request
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from course import CHAPTERS, Chapter
from drills.workspace import ROOT, Misuse, shown, write_over

HOME = "index"
Cell = dict[str, Any]

# What a chapter takes: reading, a card that is answered, a chart or a simulation that is looked at.
WORDS_A_MINUTE = 150
CARD_MINUTES, CHART_MINUTES = 0.5, 0.75

_SECTION = re.compile(r"^## (\d+) · (.+)$", re.M)
_IMAGE = re.compile(r"!\[[^\]]*\]\([^)]*\)|<img\b[^>]*>")
_CARD = re.compile(r"^\s*(?:\w+\.)?(?:predict|show|answer)\(", re.M)
_CHART = re.compile(r"^\s*(?:simulation|(?:\w+\.)?TradeOff|plt\.show)\(", re.M)
_PICTURE = re.compile(r"!\[[^\]]*\]\((?!attachment:)|<img\b")  # a film belongs to its simulation
_FOLD_OUT = re.compile(r"^(?:\w+\.)?more_claims\(([^()]*)\)", re.M)
_DETAILS = re.compile(r"<details\b(?:(?!<details\b).)*?</details>", re.S)
_FENCE = re.compile(r"^```.*?^```", re.S | re.M)
_MATH = re.compile(r"\$\$.*?\$\$|\$[^$]+\$", re.S)
_TAG = re.compile(r"<[^>]+>")
_TO_PROJECT = re.compile(r"(!?)\[([^\]]*)\]\(\.\./([^)#]+)[^)]*\)")
_UPWARD = re.compile(r"""(\]\(|(?:src|href)=["'])\.\./""")


# --- Sections and reading time --------------------------------------------------------------------


@dataclass(frozen=True)
class Section:
    """A numbered part of a chapter's notebook, and the minutes that reading it takes."""

    number: int
    title: str
    minutes: float

    @property
    def about(self) -> int:
        """The minutes as one says them."""
        return max(round(self.minutes), 1)


def opened(text: str) -> str:
    """Return Markdown without its fold-outs."""
    while _DETAILS.search(text):
        text = _DETAILS.sub("", text)
    return text


def words(text: str) -> int:
    """Return words of Markdown: formulas count one, code blocks, pictures and tags none."""
    plain = _TAG.sub(" ", _MATH.sub(" formula ", _IMAGE.sub(" ", _FENCE.sub(" ", text))))
    return sum(any(c.isalnum() for c in token) for token in plain.split())


def open_minutes(cell_type: str, source: str) -> float:
    """Return how long a cell takes without its fold-outs: words, cards and charts.

    Args:
        cell_type: "markdown", "code" or "raw".
        source: of the cell.
    """
    if cell_type == "markdown":
        text = opened(source)
        return words(text) / WORDS_A_MINUTE + CHART_MINUTES * len(_PICTURE.findall(text))
    if cell_type == "code":
        cards, charts = len(_CARD.findall(source)), len(_CHART.findall(source))
        return CARD_MINUTES * cards + CHART_MINUTES * charts
    return 0.0


def folded_minutes(cell_type: str, source: str) -> float:
    """Return how long the fold-outs of a cell take: their words and the claims in them.

    Args:
        cell_type: "markdown", "code" or "raw".
        source: of the cell.
    """
    if cell_type == "markdown":
        return (words(source) - words(opened(source))) / WORDS_A_MINUTE
    if cell_type == "code":
        ids = [id for call in _FOLD_OUT.findall(source) for id in re.findall(r'"\w+"', call)]
        return CARD_MINUTES * len(ids)
    return 0.0


def sections(path: Path) -> list[Section]:
    """Return the parts of a notebook; what stands before the first counts for the first.

    Reading time is that of the open text, its cards and its charts.

    Args:
        path: of a notebook; one that is not there has no sections.
    """
    if not path.is_file():
        return []
    titles: list[tuple[int, str]] = []
    minutes = [0.0]
    for cell in _cells(json.loads(path.read_text(encoding="utf-8"))):
        text = cell["source"]
        result = _SECTION.search(text) if cell["cell_type"] == "markdown" else None
        if result:
            if titles:
                minutes.append(0.0)
            titles.append((int(result[1]), result[2].strip()))
        minutes[-1] += open_minutes(cell["cell_type"], text)
    pairs = zip(titles, minutes, strict=False)
    return [Section(number, title, spent) for (number, title), spent in pairs]


def of_number(number: int) -> Chapter:
    """Return the chapter of that number.

    Raises:
        Misuse: there is none, or it is not written yet.
    """
    other = [str(chapter.number) for chapter in CHAPTERS if chapter.ready]
    for chapter in CHAPTERS:
        if chapter.number == number:
            if chapter.ready:
                return chapter
            raise Misuse(
                f"Chapter {number}, {chapter.title}, is still to come. Ready: {', '.join(other)}."
            )
    raise Misuse(f"There is no chapter {number}. Ready: {', '.join(other)}.")


def notebook_of(chapter: Chapter) -> Path:
    """Return the course's own notebook of a chapter, which nobody types into."""
    return ROOT / chapter.notebook


# --- The learner's copies -------------------------------------------------------------------------


@dataclass(frozen=True)
class Copy:
    """What became of a learner's copy.

    Attributes:
        path: of the copy.
        state: "made", "as it was", "brought up to date", "open" (left as it was, as JupyterLab has
            it open), or "set aside" (what was there has another name, and a new copy is made).
        preserved: how many of the learner's cells the course had changed as well; both are there.
        aside: where the learner's file went that could not be brought up to date.
    """

    path: Path
    state: str
    preserved: int = 0
    aside: Path | None = None

    def sentence(self) -> str:
        """Return what the learner should know; "" for a copy that is as it was."""
        name = shown(self.path)
        if self.state == "made":
            return f"{name} is your copy: read it, run it, answer in it."
        if self.state == "open":
            return (
                f"There is a newer version of {name}, but it is open in JupyterLab, so it was left "
                "as it is. Save it, shut its kernel down, and do this again."
            )
        if self.state == "set aside":
            assert self.aside is not None
            return (
                f"{name} could not be brought up to date, as it is not a copy that the course "
                f"knows. It is kept as {shown(self.aside)}, and {name} is a new copy."
            )
        if self.state == "brought up to date":
            both = "; all you wrote is in it"
            if self.preserved:
                both += (
                    f". The course changed {self.preserved} cell{'s' * (self.preserved != 1)} "
                    'that you changed too: look for "Kept from your copy", both versions are there'
                )
            return f"{name} is brought up to date{both}."
        return ""


def bring(source: Path, work: Path, is_open: Callable[[Path], bool] | None = None) -> Copy:
    """Make the learner's copy of a notebook, or bring a newer version into it.

    Args:
        source: the course's notebook.
        work: the learner's folder.
        is_open: tells whether a copy is being worked in; asks the running servers if None.

    Raises:
        Misuse: the notebook is not there, or the copy can't be read or written.
    """
    path = work / source.name
    try:
        new = json.loads(source.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise Misuse(
            f"{shown(source)} is not there; the notebooks come with the project."
        ) from None
    _point_links(new, work, source)
    version = _version(new)
    try:
        while True:  # until nobody wrote to the copy between reading and replacing it
            before = path.read_bytes() if path.exists() else None
            book, copy = _updated(path, before, new, version, is_open or open_in_jupyter)
            if book is None:
                return copy
            _keep_base(work, source.stem, version, new)
            book.setdefault("metadata", {})["course"] = {"version": version}
            if copy.state == "set aside":
                copy = Copy(path, copy.state, aside=_set_aside(path))
                before = None
            if (path.read_bytes() if path.exists() else None) == before:
                write_over(path, written(book))
                return copy
    except OSError as error:
        raise Misuse(f"{shown(path)} can't be written: {error.strerror}.") from None


def _updated(
    path: Path,
    before: bytes | None,
    new: dict[str, Any],
    version: str,
    is_open: Callable[[Path], bool],
) -> tuple[dict[str, Any] | None, Copy]:
    """Return the notebook to write, None to leave what is there, and what becomes of the copy."""
    if before is None:
        return new, Copy(path, "made")
    try:
        mine = json.loads(before)
        cells, had = _cells(mine), mine["metadata"]["course"]["version"]
        if had == version:
            return None, Copy(path, "as it was")
        base = json.loads(_base(path.parent, path.stem, had).read_text(encoding="utf-8"))
    except (ValueError, KeyError, TypeError, AttributeError, FileNotFoundError):
        base = None
    if is_open(path):
        return None, Copy(path, "open")
    if base is None:
        return new, Copy(path, "set aside")
    merged, retained = merge(base, cells, _cells(new))
    return {**new, "cells": merged}, Copy(path, "brought up to date", retained)


def merge(
    base: Sequence[Cell], mine: Sequence[Cell], new: Sequence[Cell]
) -> tuple[list[Cell], int]:
    """Bring a newer version into a copy; whatever the learner wrote is in the result.

    Cells of the learner's are recognised by their id, else by their text; those of the two versions
    by their text, as an id of the build changes with the cell's place.

    Args:
        base: the cells that the copy was made from.
        mine: the cells of the copy.
        new: the cells of the newer version.

    Returns:
        The cells, and how many were changed on both sides: there the new cell is followed by a note
        and the learner's.
    """
    same, near = _followed(base, new)
    origins = _origins(base, mine)
    placed: dict[int, Cell] = {}
    after: dict[int, list[Cell]] = {}
    place, both = -1, 0
    for cell, origin in zip(mine, origins, strict=True):
        if origin is None:
            after.setdefault(place, []).append(cell)
            continue
        place = same.get(origin, near[origin])
        if _key(cell) == _key(base[origin]):
            continue
        if origin in same:
            placed[place] = {**cell, "id": new[place]["id"]}
        elif place < 0 or _key(cell) != _key(new[place]):
            both += 1
            after.setdefault(place, []).extend((_note(cell), cell))
    removed = {new_index for index, new_index in same.items() if index not in origins}
    result = list(after.get(-1, ()))
    for index, cell in enumerate(new):
        result += [] if index in removed else [placed.get(index, cell)]
        result += after.get(index, ())
    return _with_own_ids(result), both


def _followed(base: Sequence[Cell], new: Sequence[Cell]) -> tuple[dict[int, int], dict[int, int]]:
    """Return where the unchanged cells of the base went, and after which cell the others were."""
    before, now = [_key(cell) for cell in base], [_key(cell) for cell in new]
    matcher = difflib.SequenceMatcher(None, before, now, autojunk=False)
    same: dict[int, int] = {}
    near: dict[int, int] = {}
    for kind, start, stop, present, end in matcher.get_opcodes():
        for index in range(start, stop):
            near[index] = min(present + index - start, end - 1)
            if kind == "equal":
                same[index] = near[index]
    return same, near


def _origins(base: Sequence[Cell], mine: Sequence[Cell]) -> list[int | None]:
    """Return for each cell of the copy the base cell that it is or was.

    An added cell has None.
    """
    by_id = {cell["id"]: index for index, cell in enumerate(base)}
    result: list[int | None] = [by_id.pop(cell.get("id"), None) for cell in mine]
    remaining: dict[tuple[str, str], list[int]] = {}
    for index in sorted(by_id.values()):
        remaining.setdefault(_key(base[index]), []).append(index)
    for place, cell in enumerate(mine):
        if result[place] is None and (indices := remaining.get(_key(cell))):
            result[place] = indices.pop(0)
    return result


def _note(cell: Cell) -> Cell:
    text = (
        "> **Kept from your copy.** The course has changed this place. What you had written "
        "follows; above it is what the course has now."
    )
    name = hashlib.sha256(f"{text}{cell['source']}".encode()).hexdigest()[:12]
    return {"cell_type": "markdown", "id": name, "metadata": {}, "source": text}


def _with_own_ids(cells: list[Cell]) -> list[Cell]:
    """Return the cells, each with an id that no other has."""
    used: set[str] = set()
    for place, cell in enumerate(cells):
        name, number = cell.get("id") or f"cell-{place}", 1
        while name in used:
            name, number = f"{name[:50]}-{number}", number + 1
        used.add(name)
        cells[place] = {**cell, "id": name}
    return cells


def written(book: dict[str, Any]) -> str:
    """Return a notebook as its file holds it."""
    return json.dumps(book, ensure_ascii=False, indent=1, sort_keys=True) + "\n"


def _cells(book: dict[str, Any]) -> list[Cell]:
    """Return the cells, the source of each as one text."""
    return [{**cell, "source": "".join(cell["source"])} for cell in book["cells"]]


def _key(cell: Cell) -> tuple[str, str]:
    return cell["cell_type"], cell["source"].rstrip()


def _version(book: dict[str, Any]) -> str:
    return hashlib.sha256(written(book).encode()).hexdigest()[:16]


def _base(work: Path, stem: str, version: str) -> Path:
    return work / ".course" / f"{stem}-{version}.json"


def _keep_base(work: Path, stem: str, version: str, book: dict[str, Any]) -> None:
    path = _base(work, stem, version)
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        names = ("id", "cell_type", "source")
        cells = [{name: cell[name] for name in names} for cell in _cells(book)]
        write_over(path, json.dumps(cells, ensure_ascii=False) + "\n")


def _set_aside(path: Path) -> Path:
    number = 1
    while os.path.lexists(aside := path.with_name(f"{path.stem}.preserved-{number}{path.suffix}")):
        number += 1
    os.rename(path, aside)
    return aside


def _point_links(book: dict[str, Any], work: Path, source: Path) -> None:
    """Let links up from the notebooks' folder lead to the same place, or be a title without one."""
    project = source.resolve().parent.parent
    up = os.path.relpath(project, work.resolve()).replace(os.sep, "/")

    def named(result: re.Match[str]) -> str:
        title = f"*{result[2]} (the picture is in the project's tree)*" if result[1] else result[2]
        return result[0] if (project / result[3]).exists() else title

    for cell in book["cells"]:
        if cell["cell_type"] == "markdown" and up != "..":
            text = "".join(cell["source"])
            text = _TO_PROJECT.sub(named, text)
            cell["source"] = _UPWARD.sub(lambda result: f"{result[1]}{up}/", text)


# --- What is open, what is shown ------------------------------------------------------------------


def open_in_jupyter(path: Path) -> bool:
    """Return whether a Jupyter server of this user has a kernel at work for the notebook."""
    return any(os.path.realpath(path) == os.path.realpath(one) for one in _at_work())


def _at_work() -> list[Path]:
    try:
        from jupyter_core.paths import jupyter_runtime_dir
    except ModuleNotFoundError:  # no Jupyter here, so nothing is open in it
        return []
    result: list[Path] = []
    for file in Path(jupyter_runtime_dir()).glob("jpserver-*.json"):
        # A server that is gone, or does not answer, has nothing open.
        with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
            server = json.loads(file.read_text(encoding="utf-8"))
            query = urllib.parse.urlencode({"token": server["token"]})
            address = f"{server['url']}api/sessions?{query}"
            with urllib.request.urlopen(address, timeout=2.0) as answer:
                sessions = json.load(answer)
            result += [Path(server["root_dir"], session["path"]) for session in sessions]
    return result


def name_kernel(path: Path, metadata: dict[str, Any]) -> bool:
    """Write the kernel and its language into a copy, as JupyterLab does when the kernel starts.

    JupyterLab would else change the notebook by opening it, and mark it as not saved.

    Args:
        path: of a copy.
        metadata: the notebook's entries "kernelspec" and "language_info".

    Returns:
        Whether the file was changed.
    """
    book = json.loads(path.read_text(encoding="utf-8"))
    if book["metadata"] == book["metadata"] | metadata:
        return False
    book["metadata"].update(metadata)
    write_over(path, written(book))
    return True


def show_in(path: Path, tag: str, data: dict[str, Any]) -> bool:
    """Put an output into the cell with that tag, as if the cell had just been run.

    Args:
        path: of a copy.
        tag: of a code cell.
        data: the output by its MIME type.

    Returns:
        Whether the file was changed.
    """
    text = path.read_text(encoding="utf-8")
    book = json.loads(text)
    for cell in book["cells"]:
        if tag in cell["metadata"].get("tags", ()) and cell["cell_type"] == "code":
            count = cell.get("execution_count")
            cell["outputs"] = [
                {
                    "output_type": "execute_result",
                    "execution_count": count,
                    "metadata": {},
                    "data": data,
                }
            ]
    new = written(book)
    if new != text:
        write_over(path, new)
    return new != text
