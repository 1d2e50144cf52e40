"""Every exercise proved with many seeds, every eighth in the sandbox, as `drills verify` does it.

A proof in this process costs a tenth of one whose texts run in children. What it says holds for
these as well, since every text of every exercise is graded in both ways and gets the same feedback.
"""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import pytest

from drills import cards as catalogue
from drills import exercise as exercises
from drills import verify
from drills.grade_report import Report
from drills.grader import attempt, start_child
from drills.verify import Effort
from tests.budget import exercise_topics

EXERCISES = [
    pytest.param(name, id=name, marks=pytest.mark.topic(topic))
    for name, topic in exercise_topics().items()
]


@pytest.mark.parametrize("name", EXERCISES[::8])
def test_exercise_is_proved_in_the_sandbox(name: str) -> None:
    findings = verify.findings_of(name)
    assert [f"{f.what}: {f.detail}" for f in findings if not f.passed] == []
    assert len(findings) >= 12


def feedback(report: Report) -> list[Any]:
    """What a learner is told, but for the clock and the last digits: libraries may round otherwise
    in a process whose environment is another."""
    checks = [(c.name, c.reason, c.slip, c.call, c.unit, c.why) for c in report.checks]
    costs = [(cost.what, cost.unit) for cost in report.costs]
    sentence = re.sub(r"[\d.]+(e-?\d+)?", "#", report.sentence)
    verdict = [report.reason, sentence, report.slip, report.diagnosis, report.call]
    return [*verdict, report.problem, checks, costs]


@pytest.mark.parametrize("name", EXERCISES)
def test_grading_in_this_process_gives_what_the_sandbox_gives(name: str) -> None:
    card, exercise = catalogue.card(name), exercises.of(name)
    solution = card.solution_text()
    texts = {slip.name: slip.text(solution) for slip in exercise.slips if not slip.ends}
    for label, text in {"worked": solution, "starter": card.starter(), **texts}.items():
        sandboxed, here = (
            attempt(card, text, seed=77, place=place).report
            for place in (start_child, verify.in_this_process)
        )
        assert feedback(sandboxed) == feedback(here), label


def test_a_tight_limit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    real = exercises.of("fk3")
    monkeypatch.setattr(
        exercises, "of", lambda name: dataclasses.replace(real, slips=real.slips[:4])
    )

    def failed() -> set[str]:
        return {f.what for f in verify.findings_of("fk3", Effort(2, 1)) if not f.passed}

    assert failed() == set()
    monkeypatch.setattr(verify, "HEADROOM", 10**6)  # no limit leaves as much
    assert failed() == {"the limits leave it 1000000 times its own time"}


@pytest.mark.parametrize("name", EXERCISES)
def test_fifty_seeds_pass_and_every_slip_is_named_with_twenty(name: str) -> None:
    findings = verify.findings_of(name, Effort(50, 20, verify.in_this_process))
    assert [f"{f.what}: {f.detail}" for f in findings if not f.passed] == []
    assert len(findings) >= 12


@pytest.mark.parametrize("seed", [100, 112, 133, 719625752])
def test_a_planner_that_never_checks_the_bounds_is_refused(seed: int) -> None:
    """With these seeds the point out of bounds lay in a disc, and was refused for that."""
    card = catalogue.card("rrt")
    slip = next(slip for slip in exercises.of("rrt").slips if slip.name == "bounds_unchecked")
    text = slip.text(card.solution_text())
    report = attempt(card, text, seed=seed, place=verify.in_this_process).report
    assert (report.verdict, report.slip) == ("fail", "bounds_unchecked")


def test_an_answer_that_compiles_with_numba_is_told_so() -> None:
    card = catalogue.card("fk3")
    text = card.solution_text().replace("def fk3(", "def plain(") + COMPILED
    report = attempt(card, text, seed=5).report
    assert report.passed and "Numba compiled" in report.notes[0]


COMPILED = """
from numba import njit


@njit
def positions(lengths, thetas):
    points, angle = np.zeros((4, 2)), 0.0
    for i in range(3):
        angle += thetas[i]
        points[i + 1, 0] = points[i, 0] + lengths[i] * np.cos(angle)
        points[i + 1, 1] = points[i, 1] + lengths[i] * np.sin(angle)
    return points


def fk3(lengths, thetas):
    return positions(np.asarray(lengths, dtype=float), np.asarray(thetas, dtype=float))
"""
