"""Grading in this process, at a tenth of the price: for texts of these tests, which are ours."""

from __future__ import annotations

from drills import cards
from drills.grade_report import Report
from drills.grader import attempt
from drills.verify import in_this_process


def grade_here(name: str, source: str, seed: int) -> Report:
    """What the grader finds when the text runs here and not in a child."""
    return attempt(cards.card(name), source, seed=seed, place=in_this_process).report
