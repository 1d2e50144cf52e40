"""Wrong answers as people write them: each is refused, and 95 % are told why.

`natural.toml` holds the answers and the explanations of each that are true.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from drills import cards
from drills.cards import Card
from drills.grade_report import Report
from drills.grader import attempt, start_child
from drills.hypotheses import COMPUTED, ROUGH
from drills.verify import in_this_process

SHARE = 0.95
HEAD = "import math\n\nimport numpy as np\n\n\n"
ENDLESS = "a loop until the end"  # a text that must not run in this process


@dataclass(frozen=True)
class Wrong:
    """A wrong answer: what is wrong, its text, the names and reasons that explain it."""

    what: str
    text: str
    explanations: frozenset[str]

    def explained(self, report: Report) -> bool:
        """Whether a true explanation was given."""
        return bool({report.slip, str(report.reason)} & self.explanations)


def edited(text: str, pairs: Sequence[str]) -> str:
    """Return a text after its edits: an old text, what replaces it, the next old one, ...

    Raises:
        ValueError: when an old text is missing.
    """
    for old, new in zip(pairs[::2], pairs[1::2], strict=True):
        if old not in text:
            raise ValueError(f"the answer has no {old!r} any more: edit the rows of the exercise")
        text = text.replace(old, new)
    return text


def answers(card: Card) -> list[Wrong]:
    """Return the wrong answers to an exercise; none where nobody has written any yet."""
    table = tomllib.loads(Path(__file__).with_name("natural.toml").read_text(encoding="utf-8"))
    rows = table.get(card.name, {})
    result = []
    for what, report, changed in rows.get("filled", []):
        text = rows["template"].format(**rows["usual"] | changed)
        result.append((what, report, HEAD + text))
    for what, report, *pairs in rows.get("edited", []):
        own = rows.get("own")
        base = HEAD + own if own else card.solution_text()
        result.append((what, report, edited(base, pairs)))
    result += [(what, report, HEAD + text) for what, report, text in rows.get("whole", [])]
    return [Wrong(what, text, frozenset(report.split())) for what, report, text in result]


@pytest.fixture(scope="module")
def reports() -> dict[str, list[tuple[Wrong, Report]]]:
    """What the grader says of every answer."""

    def graded(card: Card, wrong: Wrong) -> Report:
        place = start_child if wrong.what == ENDLESS else in_this_process
        return attempt(card, wrong.text, seed=11, place=place).report

    return {
        card.name: [(wrong, graded(card, wrong)) for wrong in answers(card)]
        for card in cards.cards()
    }


def test_no_wrong_answer_passes(reports: dict[str, list[tuple[Wrong, Report]]]) -> None:
    passed = [(n, w.what) for n, rows in reports.items() for w, report in rows if report.passed]
    assert passed == []


def test_own_right_answers_pass() -> None:
    table = tomllib.loads(Path(__file__).with_name("natural.toml").read_text(encoding="utf-8"))
    right = [(name, "own", rows["own"]) for name, rows in table.items() if "own" in rows]
    right += [(name, *row) for name, rows in table.items() for row in rows.get("right", [])]
    failed = [
        (name, style, report.sentence)
        for name, style, text in right
        if not (
            report := attempt(cards.card(name), HEAD + text, seed=11, place=in_this_process).report
        ).passed
    ]
    assert failed == []


def test_nineteen_of_twenty_are_explained(reports: dict[str, list[tuple[Wrong, Report]]]) -> None:
    rows = [(name, *row) for name, result in reports.items() for row in result]
    bare = [(n, w.what, report.sentence) for n, w, report in rows if not w.explained(report)]
    assert len(rows) >= 840 and len(bare) <= (1.0 - SHARE) * len(rows), bare


def test_no_false_reason_is_given(reports: dict[str, list[tuple[Wrong, Report]]]) -> None:
    false = [
        (name, wrong.what, report.slip)
        for name, rows in reports.items()
        for wrong, report in rows
        # An explanation by the values themselves is true of them whatever the mistake is.
        if report.slip and report.slip not in COMPUTED | ROUGH and not wrong.explained(report)
    ]
    assert false == []
