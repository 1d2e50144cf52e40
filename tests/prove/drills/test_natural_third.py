"""A third set of answers as people write them: what a stranger's answers to forty exercises get."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from drills import cards
from drills.grade_report import Report
from drills.grader import attempt
from drills.reasons import Reason
from drills.verify import in_this_process
from tests.prove.drills.test_natural import HEAD

SHARE = 0.95
ANSWERS = tomllib.loads(Path(__file__).with_name("natural_third.toml").read_text(encoding="utf-8"))


def report_of(name: str, text: str) -> Report:
    """What the grader says of an answer."""
    return attempt(cards.card(name), HEAD + text, seed=11, place=in_this_process).report


def test_forty_exercises_have_two_right_answers_and_eight_wrong_ones() -> None:
    assert len(ANSWERS) == 40
    assert {(len(rows["right"]), len(rows["whole"])) for rows in ANSWERS.values()} == {(2, 8)}


@pytest.mark.parametrize("name", ANSWERS)
def test_right_answers_pass_in_any_style(name: str) -> None:
    reports = {style: report_of(name, text) for style, text in ANSWERS[name]["right"]}
    assert {style: one.sentence for style, one in reports.items() if not one.passed} == {}
    assert [one.diagnosis for one in reports.values() if one.diagnosis] == []


def test_wrong_answers_fail_and_nineteen_of_twenty_get_more_than_numbers() -> None:
    reports = {
        (name, what): report_of(name, text)
        for name, rows in ANSWERS.items()
        for what, text in rows["whole"]
    }
    assert [one for one, report in reports.items() if report.passed] == []
    bare = [
        one
        for one, report in reports.items()
        if not report.slip and report.reason == Reason.WRONG_VALUE
    ]
    print(f"explained: {len(reports) - len(bare)} of {len(reports)}")
    assert len(bare) <= (1.0 - SHARE) * len(reports), bare
