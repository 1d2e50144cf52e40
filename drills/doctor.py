"""What this machine offers the grader: which protections hold, and what the course finds."""

from __future__ import annotations

import importlib
import os
import platform
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from course.libraries import import_error
from drills import progress, workspace

# What the drills are compared with: import name, name of the distribution, who needs it, and the
# extra that installs it ("": it comes with the package itself). A test compares pyproject.toml.
LIBRARIES = (
    ("numpy", "numpy", "everything", ""),
    ("numba", "numba", "the course's compiled loops", ""),
    ("scipy", "scipy", "tight references", ""),
    ("matplotlib", "matplotlib", "drills chart", ""),
    ("mujoco", "mujoco", "drills on contact, control and randomisation", ""),
    ("pinocchio", "pin", "the comparison of fk3", "oracles"),
    ("ompl", "ompl", "the comparison of rrt", "oracles"),
    ("gymnasium", "gymnasium", "the comparison of vector_env", ""),
)
Row = dict[str, Any]


def examine(work: Path, progress_file: Path | None) -> dict[str, list[Row]]:
    """Return what was found, by topic.

    Each row has a name, whether it is all right, and a detail.
    """
    return {
        "grader": [_python(), _catalogue(), _process()],
        "protections": _protections(),
        "your files": [_work(work), _progress(progress_file)],
        "libraries": [_library(*library) for library in LIBRARIES],
    }


def _row(name: str, ok: bool, detail: str) -> Row:
    return {"name": name, "ok": ok, "detail": detail}


def _python() -> Row:
    system = f"{platform.system()} {platform.release()} on {platform.machine()}"
    return _row("Python", sys.version_info >= (3, 11), f"{platform.python_version()}, {system}")


def _catalogue() -> Row:
    from drills import cards

    try:
        count = len(cards.cards())
    except (OSError, ValueError, TypeError, KeyError) as error:
        return _row("catalogue", False, f"an exercise can't be read: {error}")
    return _row("catalogue", count > 0, f"{count} exercises")


def _process() -> Row:
    """Return whether a submission can be run at all."""
    from drills.sandbox import Child, Ended, Raised, StartFailed

    text = "def answer():\n    return 42.0\n"
    try:
        with Child(text, filename="probe", entry="answer") as child:
            child.load()
            message = child.call("answer")
    except (StartFailed, Ended, Raised, OSError) as error:
        return _row("a submission runs", False, str(error))
    return _row("a submission runs", message == 42.0, "in a process of its own")


def _protections() -> list[Row]:
    from drills.sandbox import protections

    return [_row(result.name, result.active, result.detail) for result in protections()]


def _work(work: Path) -> Row:
    place = str(work.absolute())
    if work.is_dir():
        ok = os.access(work, os.W_OK | os.X_OK)
        return _row("answers", ok, place if ok else f"{place} can't be written")
    parent = next((folder for folder in work.absolute().parents if folder.exists()), Path("/"))
    ok = parent.is_dir() and os.access(parent, os.W_OK | os.X_OK) and not os.path.lexists(work)
    return _row("answers", ok, f"{place}, made by drills start" if ok else f"{place}: no folder")


def _progress(file: Path | None) -> Row:
    if file is None:
        return _row("progress", False, f"not kept (DRILLS_PROGRESS={workspace.NO_PROGRESS})")
    loaded = progress.load(file)
    count = len(loaded.records)
    detail = f"{file.absolute()}, {count} exercise{'s' * (count != 1)}"
    return _row("progress", not loaded.notices, " ".join((detail, *loaded.notices)))


def _library(module: str, distribution: str, use: str, extra: str) -> Row:
    install = workspace.set_up(extra)
    try:
        importlib.import_module(module)
    except ModuleNotFoundError:
        return _row(module, False, f"not installed; needed for {use}: {install}")
    except ImportError as error:
        return _row(module, False, str(import_error(module, install, error)))
    try:
        version = metadata.version(distribution)
    except metadata.PackageNotFoundError:
        version = "of unknown version"
    return _row(module, True, f"{version}, for {use}")
