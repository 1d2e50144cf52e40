"""What the learner reads, compared with golden files, and the same as HTML and data.

To write the golden files anew after a wanted change, then read each of them:
    WRITE_GOLDEN=1 .venv/bin/pytest tests/drills/test_feedback.py
"""

from __future__ import annotations

import functools
import json
import os
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

from drills import feedback
from drills.cards import card
from drills.grade_report import Check, Report
from drills.grader import grade
from drills.reasons import SENTENCES, Reason
from drills.sandbox import Limits
from tests.budget import sampled

GOLDEN = Path(__file__).parent / "golden"

RIGHT = """\
import numpy as np

def fk3(lengths, thetas):
    angles = np.cumsum(thetas)
    steps = np.column_stack([lengths * np.cos(angles), lengths * np.sin(angles)])
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
"""

CASES = {
    "right": (Reason.RIGHT, RIGHT),
    "wrong_value": (
        Reason.WRONG_VALUE,
        RIGHT.replace("np.cumsum(thetas)", "np.radians(np.cumsum(thetas))"),
    ),
    "wrong_shape": (
        Reason.WRONG_SHAPE,
        RIGHT.replace(
            "np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])", "np.cumsum(steps, axis=0)"
        ),
    ),
    "exception": (
        Reason.RAISED,
        RIGHT.replace("np.column_stack([", "np.column_stack([lengths[3], "),
    ),
    "syntax_error": (Reason.SYNTAX_ERROR, RIGHT.replace("np.cumsum(thetas)", "np.cumsum(thetas")),
    "missing_name": (Reason.MISSING_NAME, RIGHT.replace("def fk3", "def forward")),
    "wrong_signature": (Reason.WRONG_SIGNATURE, RIGHT.replace("(lengths, thetas)", "(arm)", 1)),
    "time_out": (Reason.TIMED_OUT, "def fk3(lengths, thetas):\n    while True:\n        pass\n"),
    "memory": (Reason.OUT_OF_MEMORY, "def fk3(lengths, thetas):\n    return [0.0] * 10**10\n"),
    "printed": (
        Reason.RIGHT,
        RIGHT.replace("    angles", "    print('lengths are', len(lengths))\n    angles", 1),
    ),
    "nothing_returned": (Reason.NOTHING_RETURNED, RIGHT.replace("return ", "points = ")),
    "not_attempted": (Reason.NOT_ATTEMPTED, ""),
}


@functools.cache
def _report(case: str) -> Report:
    reason, source = CASES[case]
    report = grade("fk3", source or card("fk3").starter(), filename="fk3.py", seed=7)
    assert report.reason is reason, (report.reason, report.sentence)
    return report


def _settled(text: str) -> str:
    """Without what a machine changes: times and what depends on the clock."""
    text = re.sub(r"(?<=yours )[\d.e+-]+ [munk]?s|(?<=reference )[\d.e+-]+ [munk]?s", "TIME", text)
    text = re.sub(r"error [\d.e-]+ m,", "error ERROR m,", text)
    text = re.sub(r"and \d+ more lines", "and MANY more lines", text)  # timing calls it often
    return re.sub(r"\([\d.e+-]+ times\)", "(RATIO)", text)


@pytest.mark.slow
@pytest.mark.parametrize("case", sampled(list(CASES), 2))
def test_feedback_is_the_golden_one(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # On a busy machine the clock must not come before the processor time.
    monkeypatch.setattr("drills.grader.Limits", functools.partial(Limits, patience=100.0))
    shown = _settled(feedback.text(_report(case), card("fk3")))
    file = GOLDEN / f"{case}.txt"
    if os.environ.get("WRITE_GOLDEN"):
        file.parent.mkdir(exist_ok=True)
        file.write_text(shown, encoding="utf-8")
    assert shown == file.read_text(encoding="utf-8")


def test_golden_files_are_those_of_the_cases() -> None:
    assert {file.stem for file in GOLDEN.glob("*.txt")} == set(CASES)


class _Text(HTMLParser):
    """Collects tags and text, and that every tag is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: set[str] = set()
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag != "br":
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.slow
@pytest.mark.parametrize("case", ["right", "wrong_value", "exception", "printed", "not_attempted"])
def test_html_is_balanced_and_says_the_same(case: str) -> None:
    report = _report(case)
    page = _Text()
    page.feed(feedback.html(report, card("fk3")))
    assert not page.open
    if report.diagnosis:
        assert report.diagnosis in page.text
    for check, _ in feedback.grouped(report.checks)[:1]:
        assert check.got in page.text and check.expected in page.text


def _hostile_report() -> Report:
    nasty = "\x1b[2J\x1b[32mRIGHT\x1b[0m\r</pre><script>alert(1)</script>\u202egnp $x$ \x00\x07"
    report = Report("fk3", 1, nasty, nasty, Reason.RAISED, nasty, output=nasty * 100)
    report.checks = [Check(nasty, Reason.WRONG_VALUE, nasty, nasty, nasty, nasty)]
    return report


def test_a_submission_cannot_paint_on_the_terminal_or_into_the_page() -> None:
    report = _hostile_report()
    shown = feedback.text(report, card("fk3"))
    assert "\x1b" not in shown and "\r" not in shown and "\x00" not in shown
    assert "\u202e" not in shown
    page = _Text()
    page.feed(feedback.html(report, card("fk3")))
    assert "script" not in page.tags
    assert "\x1b" not in json.dumps(feedback.as_dict(report, card("fk3"))).encode().decode(
        "unicode_escape"
    )


@pytest.mark.parametrize("width", [40, 80, 120])
@pytest.mark.parametrize("case", ["right", "wrong_value", "exception", "syntax_error"])
def test_no_line_is_too_long(case: str, width: int) -> None:
    shown = feedback.text(_report(case), card("fk3"), width=width)
    assert max(map(len, shown.splitlines())) <= width


def test_ascii_is_ascii() -> None:
    feedback.text(_hostile_report(), card("fk3"), unicode=False).encode("ascii")
    feedback.text(_report("right"), card("fk3"), unicode=False).encode("ascii")


def test_every_reason_has_its_sentence() -> None:
    assert set(SENTENCES) == set(Reason)
    assert all(sentence.endswith((".", "?")) for sentence in SENTENCES.values())


def test_data_survives_json() -> None:
    for case in ("right", "wrong_value", "exception"):
        data = feedback.as_dict(_report(case), card("fk3"))
        assert json.loads(json.dumps(data, allow_nan=False)) == data
        assert data["verdict"] == ("pass" if case == "right" else "fail")
