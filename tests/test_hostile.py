"""Hostile and unlucky submissions against the real grader, each with the verdict that it must get.

The submissions are in `hostile/`, one file for each kind of trick. A head line says its name, the
reasons that are right for it (several where the machine decides which comes first), and:
`quick`, to be run under a short limit on time, and `+right`, to have the function `right` at hand.

After each, nothing of it may be left: no process, no file in the grader's folder for temporary
files, nothing changed in the repository, the home folder or shared memory, the progress as it was,
and the next right answer is right.
"""

from __future__ import annotations

import dataclasses
import json
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

from drills import exercise as catalogue
from drills import grade as engine
from drills.cli import cli
from drills.grade import Report, grade
from drills.progress import load
from drills.reasons import Reason
from drills.sandbox import Limits, places, tree

HERE = Path(__file__).parent
ROOT = places.HERE
LINUX = sys.platform.startswith("linux")
HOME = pwd.getpwuid(os.getuid()).pw_dir
SHORT = Limits(load=1.0, call=0.5)

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


def read_all() -> list[Submission]:
    """The submissions of all files."""
    found = []
    for path in sorted((HERE / "hostile").glob("*.txt")):
        for part in path.read_text(encoding="utf-8").split("\n#: ")[1:]:
            head, _, text = part.partition("\n")
            name, reasons, marks = [*head.split("|"), ""][:3]
            found.append(
                Submission(
                    f"{path.stem}-{name.strip()}",
                    frozenset(map(Reason, reasons.split())),
                    frozenset(marks.split()),
                    text,
                )
            )
    return found


SUBMISSIONS = read_all()


def processes() -> set[int]:
    """Everything that descends from this process, zombies too."""
    found: set[int] = set()
    pending = [os.getpid()]
    while pending:
        below = [p for p in tree._children(pending.pop()) if tree._status(p)]
        found.update(below)
        pending += below
    return found


def state_of_files() -> dict[str, tuple[int, ...]]:
    """What foreign code could have touched: the repository's files, home, /tmp, shared memory."""
    places_of_files = [ROOT / name for name in ("course", "drills", "solutions", "tests")]
    found: dict[str, tuple[int, ...]] = {}
    for top in places_of_files:
        for folder, names, files in os.walk(top):
            names[:] = [n for n in names if not n.startswith((".", "__pycache__"))]
            for name in files:
                status = os.lstat(os.path.join(folder, name))
                found[os.path.join(folder, name)] = (
                    status.st_mtime_ns,
                    status.st_size,
                    status.st_mode,
                )
    for top in (ROOT, Path(HOME), Path("/"), Path("/tmp"), Path("/var/tmp"), Path("/dev/shm")):
        if top.is_dir():
            for entry in os.scandir(top):
                if not entry.name.startswith(("tmp", "pytest", "drills-", ".", "bash")):
                    found[entry.path] = (entry.stat(follow_symlinks=False).st_mode,)
    return found


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
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


@pytest.mark.parametrize("submission", SUBMISSIONS, ids=lambda s: s.name)
def test_verdict(
    submission: Submission, world: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    report = graded(submission, world, monkeypatch)
    assert report.reason in submission.reasons, (report.reason, report.sentence, report.problem)
    assert report.passed == (report.reason is Reason.RIGHT)
    assert report.sentence
    shown = report.sentence + report.output + report.diagnosis
    shown += "".join(c.sentence + c.got + c.call for c in report.checks)
    if report.problem is not None:
        shown += report.problem.type + report.problem.message
    assert all(c.isprintable() or c in "\n\t" for c in shown), "control characters are shown"
    assert len(shown) < 200_000
    after = grade("fk3", PLAIN, seed=12)
    assert after.passed, after.sentence
    assert load(Path(world["PROGRESS"])).of("fk3").state == "solved"


def test_there_are_enough_of_them() -> None:
    assert len(SUBMISSIONS) >= 110
    assert len({s.name for s in SUBMISSIONS}) == len(SUBMISSIONS)
    wanted = set(Reason) - {
        Reason.NOT_ATTEMPTED,  # the starter
        Reason.UNREADABLE,  # files, below
        Reason.BORROWED_NAME,  # notebooks
        Reason.WRONG_PROPERTY,  # other drills
        Reason.MISSING_ERROR,
    }
    assert wanted <= set().union(*(s.reasons for s in SUBMISSIONS))


# Files, through the command


def prepared(kind: str, folder: Path) -> Path:
    path = folder / "answer.py"
    source = PLAIN.encode()
    contents = {
        "byte_order_mark": b"\xef\xbb\xbf" + source,
        "windows_lines": source.replace(b"\n", b"\r\n"),
        "old_mac_lines": source.replace(b"\n", b"\r"),
        "no_last_line_end": source.rstrip(),
        "utf16": PLAIN.encode("utf-16"),
        "utf16_without_mark": PLAIN.encode("utf-16-le"),
        "latin1": source + "# Länge\n".encode("latin-1"),
        "latin1_declared": b"# -*- coding: latin-1 -*-\n" + source,
        "nul": source + b"\0",
        "empty": b"",
        "two_megabytes": source + b"#" * 2_000_000,
        "nearly_a_megabyte": source + b"#" * 900_000,
        "not_text": bytes(range(256)) * 10,
    }
    if kind in contents:
        path.write_bytes(contents[kind])
    elif kind == "link":
        (folder / "real.py").write_bytes(source)
        path.symlink_to("real.py")
    elif kind == "link_to_secret":
        path.symlink_to("/etc/shadow")
    elif kind == "circle":
        path.symlink_to(path)
    elif kind == "dangling":
        path.symlink_to("nowhere.py")
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "device":
        return Path("/dev/zero")
    return path


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("byte_order_mark", "right"),
        ("windows_lines", "right"),
        ("old_mac_lines", "right"),
        ("no_last_line_end", "right"),
        ("nearly_a_megabyte", "right"),
        ("utf16", "unreadable"),
        ("utf16_without_mark", "unreadable"),
        ("latin1", "unreadable"),
        ("latin1_declared", "unreadable"),
        ("nul", "unreadable"),
        ("not_text", "unreadable"),
        ("empty", "missing_name"),
        ("two_megabytes", "unreadable"),
        ("link", "unreadable"),
        ("link_to_secret", "unreadable"),
        ("circle", "unreadable"),
        ("dangling", "unreadable"),
        ("pipe", "unreadable"),
        ("folder", "unreadable"),
        ("device", "unreadable"),
    ],
)
def test_file(kind: str, reason: str, world: dict[str, str], tmp_path: Path) -> None:
    path = prepared(kind, tmp_path)
    ran = CliRunner().invoke(
        cli, ["check", "fk3", "--file", str(path), "--json", "--work", str(tmp_path / "work")]
    )
    told = json.loads(ran.output.strip().splitlines()[-1])
    assert told["reason"] == reason, ran.output
    assert told["verdict"] == ("pass" if reason == "right" else "fail")
    assert ran.exit_code == (0 if reason == "right" else 1)


# Every other drill

ODD = {
    "nothing": "return None",
    "not a number": "return float('nan')",
    "a lie": "return type('Sly', (float,), {'__eq__': lambda a, b: True})(0)",
    "leaves": "import os; os._exit(0)",
}


@pytest.mark.parametrize("odd", ODD)
@pytest.mark.parametrize("name", [card.name for card in catalogue.cards()])
def test_odd_answers_to_every_drill(name: str, odd: str, world: dict[str, str]) -> None:
    card = catalogue.card(name)
    body = ODD[odd]
    source = f"def {card.entry}(*args, **kwargs):\n    {body}\n"
    if card.kind == "class":
        source = f"class {card.entry}:\n    def __init__(self, *args, **kwargs): pass\n"
        source += "    def __getattr__(self, name):\n        return lambda *a, **k: self.odd()\n"
        source += f"    def odd(self):\n        {body}\n"
    alive = processes()
    report = grade(name, source, seed=5)
    assert not report.passed
    assert report.sentence
    assert odd != "leaves" or report.reason is Reason.EXITED, report.sentence
    assert processes() <= alive
    assert os.listdir(world["TEMP"]) == []


def test_limits_of_the_drills_are_sane() -> None:
    for card in catalogue.cards():
        limits = catalogue.exercise(card.name).limits or Limits()
        assert dataclasses.replace(limits, total=20) == limits or limits.total <= 120
        assert limits.memory <= 4 << 30
