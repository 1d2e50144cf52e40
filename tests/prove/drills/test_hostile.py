"""All hostile and unlucky submissions against the real grader, odd files, odd answers elsewhere.

Each has the verdict that it must get; `hostile_grading` says what is looked at besides.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from click.testing import CliRunner

from drills import cards as catalogue
from drills.cli import cli
from drills.grader import grade
from drills.reasons import Reason
from tests.drills.hostile_grading import (
    KINDS,
    PLAIN,
    Submission,
    a_world,
    check_verdict,
    processes,
    runnable,
)

__all__ = ["a_world"]


@pytest.mark.parametrize("submission", runnable(*KINDS), ids=lambda s: s.name)
def test_verdict(
    submission: Submission, world: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    check_verdict(submission, world, monkeypatch)


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
    report = json.loads(ran.output.strip().splitlines()[-1])
    assert report["reason"] == reason, ran.output
    assert report["verdict"] == ("pass" if reason == "right" else "fail")
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
