"""The learner's files: where they are, which exercise one answers, and how none is lost."""

from __future__ import annotations

import ast
import contextlib
import glob
import os
import re
import tempfile
import warnings
from pathlib import Path

from drills import cards as catalogue
from drills.cards import Card

ROOT = Path(__file__).resolve().parent.parent
PARSED = 20_000  # characters
NO_PROGRESS = "none"  # as DRILLS_PROGRESS: keep no progress, show none


class Misuse(Exception):
    """The command can't do what it was asked; the message says what to do instead."""

    def __init__(self, message: str, nearest: list[str] | None = None) -> None:
        super().__init__(message)
        self.nearest = nearest or []


def in_tree() -> bool:
    """Return whether this is the project's tree, with its Makefile, and no installed package."""
    return (ROOT / "pyproject.toml").exists()


def set_up(extra: str = "lab") -> str:
    """Return the command that installs what is missing.

    Args:
        extra: group of optional packages in pyproject.toml that holds it; "" for the package alone.
    """
    group = f"[{extra}]" if extra else ""
    return "make setup" if in_tree() else f"pip install 'robotics-simulation-course{group}'"


def folder(chosen: str | None = None) -> Path:
    """Return the folder of the answers.

    Args:
        chosen: on the command line; else DRILLS_WORK, else `work` in the project when the current
            folder is inside it, else `work` in the current folder.
    """
    if chosen or os.environ.get("DRILLS_WORK"):
        return _expanded(chosen or os.environ["DRILLS_WORK"])
    try:
        here = Path.cwd()
    except OSError:
        raise Misuse("The current folder is gone. Change to one that is there.") from None
    inside = in_tree() and here.is_relative_to(ROOT)
    return (ROOT if inside else here) / "work"


def progress_file(work: Path) -> Path | None:
    """Return the progress file: DRILLS_PROGRESS, else in the work folder; None to keep none."""
    report = os.environ.get("DRILLS_PROGRESS")
    if report == NO_PROGRESS:
        return None
    return _expanded(report) if report else work / "progress.json"


def _expanded(place: str) -> Path:
    try:
        return Path(place).expanduser()
    except RuntimeError:
        raise Misuse(f"There is no home folder for {place}.") from None


def answer(work: Path, name: str) -> Path:
    """Return where the answer to an exercise is."""
    return work / f"{name}.py"


def shown(path: Path) -> str:
    """Return the path as a message shows it: from the current folder where it is inside."""
    with contextlib.suppress(ValueError, OSError):
        path = path.absolute().relative_to(Path.cwd())
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(path))


def start_text(card: Card) -> str:
    """Return the starter under a header that says what to do next."""
    facts = f"chapter {card.chapter}, difficulty {card.difficulty} of 5, about {card.minutes} min"
    return (
        f"# {card.name}: {card.title}\n"
        f"# {facts}\n"
        f"#\n"
        f"# The task:  drills show {card.name}\n"
        f"# Check it:  drills check {card.name}\n"
        f"\n" + card.starter()
    )


def is_untouched(path: Path, card: Card) -> bool:
    """Return whether the file holds the starter as `start` wrote it."""
    try:
        return path.read_bytes() == start_text(card).encode()
    except OSError:
        return False


def write_start(path: Path, card: Card, replace: bool) -> Path | None:
    """Write the starter; what was there is kept under a numbered name.

    Args:
        path: of the answer.
        card: of the exercise.
        replace: whether a file that is there may give way.

    Returns:
        The backup, if there was something to keep.

    Raises:
        FileExistsError: there is a file and `replace` is false.
        Misuse: the file can't be written.
    """
    text = start_text(card)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not replace:
            _write_new(path, text)
            return None
        if os.path.lexists(path) and not path.is_file():
            raise Misuse(f"{shown(path)} is not a file, so it is left alone.")
        backup = _back_up(path)
        write_over(path, text)
        return backup
    except FileExistsError:
        if path.parent.is_dir():
            raise
        raise Misuse(f"{shown(path.parent)} is a file; the answers need a folder there.") from None
    except OSError as error:
        raise Misuse(f"{shown(path)} can't be written: {error.strerror}.") from None


def chosen_card(target: str, source: str | None) -> Card:
    """Return the exercise that a file answers.

    The one of its name, else the one whose entry it defines.

    Args:
        target: the file as it was given, "-" for standard input.
        source: its text, None if it can't be read.

    Raises:
        Misuse: no exercise fits, or several do.
    """
    cards = catalogue.cards()
    stem = Path(target).stem
    named = [card for card in cards if card.name == stem]
    if named:
        return named[0]
    defined = top_level_names(source or "")
    fitting = [card for card in cards if card.entry in defined]
    if len(fitting) == 1:
        return fitting[0]
    what = "Standard input" if target == "-" else shown(Path(target))
    say_which = f"Say which one: drills check NAME --file {target}"
    if fitting:
        names = " and ".join(card.name for card in fitting)
        raise Misuse(f"{what} fits several exercises: {names}. {say_which}")
    raise Misuse(f"{what} defines nothing that an exercise asks for. {say_which}")


def top_level_names(source: str) -> set[str]:
    """Return the names that a text binds at its top level.

    For a text that isn't valid Python the names are a guess.
    """
    if len(source) > PARSED:  # the time to parse can grow as the square of the length
        return set(re.findall(r"^(?:def|class)\s+(\w+)", source, re.MULTILINE))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            body = ast.parse(source).body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return set(re.findall(r"^(?:def|class)\s+(\w+)", source, re.MULTILINE))
    result: set[str] = set()
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            result.add(node.name)
        elif isinstance(node, ast.Assign):
            result |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return result


def _write_new(path: Path, text: str) -> None:
    with path.open("x", encoding="utf-8", newline="\n") as file:
        file.write(text)


def write_over(path: Path, text: str) -> None:
    """Replace a file in one go: a reader sees the old one or the new one."""
    _remove_abandoned_parts(path)
    prefix = f".{path.name}.{os.getpid()}."
    handle, part = tempfile.mkstemp(dir=path.parent, prefix=prefix, suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(part, 0o644)
        os.replace(part, path)
    except BaseException:  # an interrupt too leaves nothing half written behind
        with contextlib.suppress(OSError):
            os.unlink(part)
        raise


def _remove_abandoned_parts(path: Path) -> None:
    """Remove the unfinished copies of a file that processes left when they were killed."""
    for part in path.parent.glob(f".{glob.escape(path.name)}.*.part"):
        number = part.name.removeprefix(f".{path.name}.").partition(".")[0]
        if not number.isdecimal() or not _is_running(int(number)):
            with contextlib.suppress(OSError):
                part.unlink()


def _is_running(process: int) -> bool:
    """Return whether a process with this number exists."""
    try:
        os.kill(process, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        pass  # it is another user's
    return True


def _back_up(path: Path) -> Path | None:
    """Copy the file to the first free `NAME.py.bak-N`."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    number = 1
    while True:
        backup = path.with_name(f"{path.name}.bak-{number}")
        try:
            with backup.open("xb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            return backup
        except FileExistsError:
            number += 1
