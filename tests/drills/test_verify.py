"""Every exercise proved: its worked answer and starter in the sandbox, all else in this process.

The proof is shown to be able to fail.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from drills import cards as catalogue
from drills import exercise as exercises
from drills import verify
from drills.cards import Quantity
from drills.exercise import Slip
from drills.sandbox import Limits
from drills.verify import Effort
from tests.budget import exercise_params

pytestmark = pytest.mark.slow


# The long tier takes all exercises, and 50 seeds in the sandbox. That every worked answer passes
# and every slip fails is tested for all of them in `test_rounding.py` and `test_case_code.py`.
EFFORT = Effort(seeds=1, slip_seeds=1, place=verify.in_this_process)
EXERCISES = exercise_params(
    "hopper_filter",
    "standing_qp",
    "randomize",
    "solve_stack",
    "bounce",
    "rrt",
    "catch_the_slip",
    "certify_edge",
    "tumble",
    "rrt_star",
    "rrt_connect",
    "vector_env",
    "compare_engines",
    "plane_ransac",
    step=40,
)


@pytest.mark.parametrize("name", EXERCISES)
def test_exercise_is_proved(name: str) -> None:
    findings = verify.findings_of(name, EFFORT)
    assert [f"{f.what}: {f.detail}" for f in findings if not f.passed] == []
    assert len(findings) >= 11


def _failed(monkeypatch: pytest.MonkeyPatch, card: Any = None, exercise: Any = None) -> set[str]:
    """What is not proved of fk3 after a change to its card or its exercise."""
    real_card, real_exercise = catalogue.card("fk3"), exercises.of("fk3")
    changed_card = dataclasses.replace(real_card, **(card or {}))
    changed = dataclasses.replace(real_exercise, **(exercise or {}))
    monkeypatch.setattr(catalogue, "card", lambda name: changed_card)
    monkeypatch.setattr(exercises, "of", lambda name: changed)
    return {
        f.what
        for f in verify.findings_of("fk3", dataclasses.replace(EFFORT, seeds=1))
        if not f.passed
    }


@pytest.mark.prove
def test_nothing_fails_without_a_change(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _failed(monkeypatch) == set()


@pytest.mark.prove
def test_an_empty_hint_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    hints = tuple(dataclasses.replace(h, text=" ") for h in catalogue.card("fk3").hints)
    assert _failed(monkeypatch, card={"hints": hints}) == {"three hints, none empty"}


@pytest.mark.prove
def test_a_unit_or_shape_that_is_not_stated_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    signature = catalogue.card("fk3").signatures[0]
    wrong = tuple(dataclasses.replace(q, shape="(2,)") for q in signature.arguments)
    changed = (dataclasses.replace(signature, arguments=wrong),)
    unproved = _failed(monkeypatch, card={"signatures": changed})
    assert "the arguments have the stated shapes" in unproved


@pytest.mark.prove
def test_a_slip_that_passes_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    solution = catalogue.card("fk3").solution_text()
    harmless = Slip("harmless", "Nothing.", source=solution + "\nX = 1\n")
    slips = (*exercises.of("fk3").slips, harmless)
    assert _failed(monkeypatch, exercise={"slips": slips}) == {"slip harmless is caught and named"}


def test_a_slip_of_integers_that_passes_says_which_case_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    text = catalogue.card("fk3").solution_text() + "\nX = 1\n"
    changed = dataclasses.replace(
        exercises.of("fk3"), slips=(Slip("whole_numbers", "S.", source=text),)
    )
    monkeypatch.setattr(exercises, "of", lambda name: changed)
    details = [f.detail for f in verify.findings_of("fk3", EFFORT) if "whole_numbers" in f.what]
    assert (
        len(details) == 1
        and "whose arguments are integers needs results that are not" in details[0]
    )


def test_too_few_slips_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    slips = exercises.of("fk3").slips[:3]
    assert "at least four slips" in _failed(monkeypatch, exercise={"slips": slips})


def test_a_judge_that_is_too_strict_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def strict(attempt: Any) -> None:
        answer = attempt.call([1.0, 1.0, 1.0], [0.0, 0.0, 0.0])
        attempt.compare("x", answer, np.ones((4, 2)), tolerance=1e-9, unit="m", why="w")

    assert "the worked answer passes 1 seeds" in _failed(monkeypatch, exercise={"judge": strict})


def test_a_judge_that_accepts_the_starter_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def lenient(attempt: Any) -> None:
        attempt.require("x", bool(attempt.call([1.0] * 3, [0.0] * 3) is not None), sentence="s")

    assert "the starter runs and fails" in _failed(monkeypatch, exercise={"judge": lenient})


@pytest.mark.prove
def test_a_starter_that_raises_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its body may use what the module of the worked answer imports, and no other name."""
    unproved = _failed(monkeypatch, card={"start": "return FACTOR * np.ones((4, 2))"})
    assert unproved == {"the starter runs and fails"}


@pytest.mark.parametrize(
    ("shape", "value", "fits"),
    [
        ("(3,)", np.zeros(3), True),
        ("(3,)", [1.0, 2.0, 3.0], True),
        ("(3,)", np.zeros(4), False),
        ("(n, 2)", np.zeros((7, 2)), True),
        ("(n, n)", np.zeros((7, 2)), False),
        ("number", 1.0, True),
        ("number", np.zeros(3), False),
    ],
)
def test_shapes(shape: str, value: Any, fits: bool) -> None:
    assert verify.shape_matches(Quantity("q", shape, "m", ""), value, {}) is fits


def test_limits_of_the_drills_are_sane() -> None:
    for card in catalogue.cards():
        limits = exercises.of(card.name).limits or Limits()
        assert limits.call <= limits.total <= 120
        assert limits.memory <= 4 << 30
