"""What is remembered of a learner's robot: `robot.json` in the work folder."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from drills import json_store
from drills.json_store import Damaged

RUNS = 300  # that are stored, the newest


@dataclass
class Stored:
    """The content of the file.

    Attributes:
        graded: by exercise, the hash of the graded file and when it was graded.
        passed: by number of the level, when and how it was passed.
        runs: one entry for each run, the oldest first.
        course: results of the course's parts by level, tasks and seed, so that they run once.
        libraries: the same of the robot with the libraries' parts.
        hidden: the fault of level 6 that waits to be named, and how many in a row were.
    """

    graded: dict[str, dict[str, str]] = field(default_factory=dict)
    passed: dict[str, dict[str, Any]] = field(default_factory=dict)
    runs: list[dict[str, Any]] = field(default_factory=list)
    course: dict[str, dict[str, Any]] = field(default_factory=dict)
    libraries: dict[str, dict[str, Any]] = field(default_factory=dict)
    hidden: dict[str, Any] = field(default_factory=dict)


def _parsed(content: dict[str, Any]) -> Stored:
    stored = Stored()
    for name in ("graded", "passed", "course", "libraries", "hidden"):
        value = content.get(name, {})
        if not isinstance(value, dict):
            raise Damaged
        setattr(stored, name, value)
    runs = content.get("runs", [])
    if not isinstance(runs, list) or not all(isinstance(run, dict) for run in runs):
        raise Damaged
    if not all(
        isinstance(value, dict) for value in (*stored.graded.values(), *stored.passed.values())
    ):
        raise Damaged
    stored.runs = runs
    return stored


def _plain(stored: Stored) -> dict[str, Any]:
    return {
        "graded": stored.graded,
        "passed": stored.passed,
        "runs": stored.runs[-RUNS:],
        "course": stored.course,
        "libraries": stored.libraries,
        "hidden": stored.hidden,
    }


FORM = json_store.Form("drills-robot/1", "robot", Stored, _parsed, _plain)


def path_of(work: Path, progress_file: Path | None) -> Path | None:
    """Return the file; None where no progress is stored."""
    return None if progress_file is None else work / "robot.json"
