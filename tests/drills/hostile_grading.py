"""How a hostile submission is graded in the tests, and what is looked at before and after.

The submissions are in `hostile/`, one file for each kind of trick. A head line says its name, the
reasons that are right for it (several where the machine decides which comes first), and:
`quick`, to be run under a short limit on time, and `+right`, to have the function `right` at hand.

After each, nothing of it may be left: no process, no file in the grader's folder for temporary
files, nothing changed in the repository, the home folder or shared memory, the progress as it was,
and the next right answer is right.
"""

from __future__ import annotations

import contextlib
import functools
import os
import pwd
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from drills import grader as engine
from drills.cli import cli
from drills.grade_report import Report
from drills.grader import grade
from drills.progress import load
from drills.reasons import Reason
from drills.sandbox import Child, Limits, readable_paths, tree

HERE = Path(__file__).parent
KINDS = ("ends", "floods", "processes", "forging", "files", "values", "unlucky")
ROOT = readable_paths.HERE
LINUX = sys.platform.startswith("linux")
HOME = pwd.getpwuid(os.getuid()).pw_dir
SHORT = Limits(load=1.0, call=0.5, patience=2)

RIGHT = """
import numpy as np
def right(lengths, thetas):
    directions = np.cumsum(thetas)
    links = np.asarray(lengths)[:, None] * np.column_stack((np.cos(directions), np.sin(directions)))
    return np.vstack((np.zeros(2), np.cumsum(links, axis=0)))
"""
PLAIN = RIGHT + "fk3 = right\n"


@dataclass(frozen=True)
class Submission:
    """One text, and the verdicts it may get."""

    name: str
    reasons: frozenset[Reason]
    marks: frozenset[str]
    text: str


def read(*kinds: str) -> list[Submission]:
    """The submissions of these kinds."""
    result = []
    for path in (HERE / "hostile" / f"{kind}.txt" for kind in kinds):
        for part in path.read_text(encoding="utf-8").split("\n#: ")[1:]:
            head, _, text = part.partition("\n")
            name, reasons, marks = [*head.split("|"), ""][:3]
            result.append(
                Submission(
                    f"{path.stem}-{name.strip()}",
                    frozenset(map(Reason, reasons.split())),
                    frozenset(marks.split()),
                    text,
                )
            )
    return result


@functools.cache
def held() -> bool:
    """Whether the kernel's layers hold a submission on this machine."""
    with Child("def f(): pass", filename="probe", entry="f") as child:
        child.load()
        states = [child.layers.get(name, "off") for name in ("landlock", "seccomp")]
    return not any(state.startswith("off") for state in states)


def runnable(*kinds: str) -> list[Submission]:
    """Those that may run here: some would do harm where nothing but the clock holds them."""
    return read(*(kind for kind in kinds if kind not in ("files", "processes") or held()))


def processes() -> set[int]:
    """Everything that descends from this process, zombies too."""
    result: set[int] = set()
    pending = [os.getpid()]
    while pending:
        below = [p for p in tree._children(pending.pop()) if tree._status(p)]
        result.update(below)
        pending += below
    return result


def state_of_files() -> dict[str, tuple[int, ...]]:
    """What foreign code could have touched: the repository's files, home, /tmp, shared memory."""
    places_of_files = [ROOT / name for name in ("course", "drills", "solutions", "tests")]
    result: dict[str, tuple[int, ...]] = {}
    for top in places_of_files:
        for folder, names, files in os.walk(top):
            names[:] = [n for n in names if not n.startswith((".", "__pycache__"))]
            for name in files:
                status = os.lstat(os.path.join(folder, name))
                result[os.path.join(folder, name)] = (
                    status.st_mtime_ns,
                    status.st_size,
                    status.st_mode,
                )
    for top in (ROOT, Path(HOME), Path("/"), Path("/tmp"), Path("/var/tmp"), Path("/dev/shm")):
        if top.is_dir():
            for entry in os.scandir(top):
                if not entry.name.startswith(("tmp", "pytest", "drills-", ".", "bash")):
                    # Another process may have removed its own file since it was listed.
                    with contextlib.suppress(FileNotFoundError):
                        result[entry.path] = (entry.stat(follow_symlinks=False).st_mode,)
    return result


@pytest.fixture(scope="module", name="world")
def a_world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """A learner's folder with progress in it, and a folder for temporary files of its own."""
    work = tmp_path_factory.mktemp("work")
    temporary = tmp_path_factory.mktemp("temporary")
    before = tempfile.tempdir
    tempfile.tempdir = str(temporary)
    answer = work / "fk3.py"
    answer.write_text(PLAIN)
    ran = CliRunner().invoke(cli, ["check", "fk3", "--work", str(work), "--json"])
    assert ran.exit_code == 0, ran.output
    yield {"PROGRESS": str(work / "progress.json"), "TEMP": str(temporary)}
    tempfile.tempdir = before


def text_of(submission: Submission, world: dict[str, str]) -> str:
    text = submission.text
    for word, value in {
        **world,
        "ROOT": str(ROOT),
        "HOME": HOME,
        "LONG": "    0,\n" * 20_000,
        "PARENTHESES": "(" * 5000,
        "MINUS": "-" * 10_000,
        "SUM": "+1" * 10_000,
        "FIELDS": "{x}" * 200_000,
    }.items():
        text = text.replace(f"@{word}@", value)
    if "+right" in submission.marks:
        future = "from __future__ import annotations\n"
        text = future + RIGHT + text.replace(future, "")
    return text


def differences(before: dict[str, Any], after: dict[str, Any]) -> set[str]:
    return {k for k in before.keys() | after.keys() if before.get(k) != after.get(k)}


def graded(submission: Submission, world: dict[str, str], patch: pytest.MonkeyPatch) -> Report:
    """Grade it, with the world looked at before and after."""
    text = text_of(submission, world)
    suspects: set[str] | None = None
    for _ in range(3):
        files, alive = state_of_files(), processes()
        progress = Path(world["PROGRESS"]).read_bytes()
        start = time.monotonic()
        with patch.context() as within:
            if "quick" in submission.marks:
                within.setattr(engine, "Limits", lambda: SHORT)
            report = grade("fk3", text, seed=11)
        assert time.monotonic() - start < 120, "the grader was held up"
        assert processes() <= alive, "a process is left"
        assert os.listdir(world["TEMP"]) == [], "the scratch folder is left"
        assert Path(world["PROGRESS"]).read_bytes() == progress
        changed = differences(files, state_of_files())
        suspects = changed if suspects is None else suspects & changed
        if not suspects:
            return report
        # Somebody may have saved a file meanwhile. The same change each time is no accident.
    raise AssertionError(f"changed: {sorted(suspects or ())}")


def check_verdict(submission: Submission, world: dict[str, str], patch: pytest.MonkeyPatch) -> None:
    """It gets the verdict that it must get, safely told, and the next right answer is right."""
    report = graded(submission, world, patch)
    assert report.reason in submission.reasons, (report.reason, report.sentence, report.problem)
    assert report.passed == (report.reason is Reason.RIGHT)
    assert report.sentence
    shown = report.sentence + report.output + report.diagnosis
    shown += "".join(c.sentence + c.got + c.call for c in report.checks)
    if report.problem is not None:
        shown += report.problem.type + report.problem.message
    assert all(c.isprintable() or c in "\n\t" for c in shown), "control characters are shown"
    assert len(shown) < 200_000
    if not report.passed:
        after = grade("fk3", PLAIN, seed=12)
        assert after.passed, after.sentence
    assert load(Path(world["PROGRESS"])).of("fk3").state == "solved"
