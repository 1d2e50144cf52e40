"""The failed case as code: run below the wrong answer, it fails as the feedback says."""

from __future__ import annotations

import contextlib
import io
import math
import sys
import types
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from drills import cards as catalogue
from drills import exercise as exercises
from drills.cards import Card
from drills.case_code import literal
from drills.grade_report import Report
from drills.grader import attempt
from drills.reasons import Reason
from drills.values import identical
from drills.verify import in_this_process
from tests.budget import PROVE, examples, exercise_params
from tests.drills.place import Place, a_place

__all__ = ["a_place"]

EXERCISES = exercise_params("hopper_filter", "solve_stack", step=6)


def run(card: Card, source: str, case: str) -> dict[str, Any]:
    """Run a case below an answer, in a module of its own; return its names and what it printed."""
    module = types.ModuleType("answer")
    saved = {name: sys.modules.get(name) for name in ("submission", "given")}
    sys.modules["submission"] = module
    try:
        with contextlib.redirect_stdout(io.StringIO()) as printed, np.errstate(all="ignore"):
            exec(compile(source, "answer", "exec"), module.__dict__)
            try:
                exec(compile(case, "case", "exec"), module.__dict__)
            except Exception as error:
                module.__dict__["raised"] = error
    finally:
        for name, before in saved.items():
            if before is None:
                sys.modules.pop(name, None)
            else:
                sys.modules[name] = before
    return {**module.__dict__, "printed": printed.getvalue()}


def assert_reproduced(card: Card, report: Report) -> None:
    """Assert that the case fails as reported."""
    assert report.case, report.sentence
    own = report.case.replace(exercises.of(card.name).given or "\0", "")
    assert not [line for line in own.splitlines() if "..." in line and not line.startswith("#")]
    result = run(card, report.source, report.case)
    if report.reason is Reason.RAISED:
        assert report.problem is not None
        assert type(result["raised"]).__name__ == report.problem.type
        return
    (first, *_) = [check for check in report.checks if not check.passed]
    if report.reason is Reason.MISSING_ERROR:
        if "raised" in result:  # another error than the one that was asked for
            assert first.got == type(result["raised"]).__name__
        return
    assert "raised" not in result, (result["raised"], report.case)
    if report.reason is Reason.INPUTS_CHANGED:
        before, after = (line[7:] for line in result["printed"].splitlines()[-2:])
        assert before != after
    elif first.values is not None and "expected" in result:
        truth = np.asarray(first.values[1])
        assert identical(np.asarray(result["expected"], dtype=float), truth)
        if math.isfinite(first.error):
            assert result["error"] == pytest.approx(first.error, rel=1e-6, abs=1e-300)
            assert not result["error"] <= first.tolerance
            assert f"error {result['error']:.3g}" in result["printed"]


@pytest.mark.slow
@pytest.mark.parametrize("name", EXERCISES)
def test_the_case_of_every_slip_fails_below_it(name: str) -> None:
    """The first slip and the last of one exercise in three; all of them in the long tier."""
    card, exercise = catalogue.card(name), exercises.of(name)
    compared = 0
    for slip in exercise.slips if PROVE else (exercise.slips[0], exercise.slips[-1]):
        if slip.ends is not None:  # it never answers: `test_a_case_that_never_ends`
            continue
        report = attempt(
            card, slip.text(card.solution_text()), seed=1000, place=in_this_process
        ).report
        assert not report.passed
        assert_reproduced(card, report)
        compared += "expected = " in report.case
    # A judge written by hand may compare what it computes of the answers, and not these.
    by_hand = ("rrt", "standing_qp", "hopper_filter", "solve_stack")
    if PROVE and card.kind == "function" and name not in by_hand:
        assert compared > 0


@pytest.mark.prove
def test_a_case_that_raises_or_never_ends_is_code_too() -> None:
    card = catalogue.card("fk3")
    raises = "def fk3(lengths, thetas):\n    return 1 / (len(lengths) - 3)\n"
    report = attempt(card, raises, seed=1).report
    assert report.reason is Reason.RAISED
    assert_reproduced(card, report)
    endless = "def fk3(lengths, thetas):\n    while True:\n        pass\n"
    report = attempt(card, endless, seed=1).report
    assert report.reason is Reason.TIMED_OUT
    quick = "def fk3(lengths, thetas):\n    return [lengths, thetas]\n"
    got = run(card, quick, report.case)["got"]
    assert [np.shape(part) for part in got] == [(3,), (3,)]


def test_a_changed_argument_and_a_hidden_state_are_shown() -> None:
    card = catalogue.card("fk3")
    changes = card.solution_text() + (
        "\nright = fk3\n\n\ndef fk3(lengths, thetas):\n    result = right(lengths, thetas)\n"
        "    thetas[0] += 1.0\n    return result\n"
    )
    report = attempt(card, changes, seed=1, place=in_this_process).report
    assert report.reason is Reason.INPUTS_CHANGED
    assert_reproduced(card, report)
    counts = card.solution_text() + (
        "\nright, calls = fk3, []\n\n\ndef fk3(lengths, thetas):\n    calls.append(1)\n"
        "    return right(lengths, thetas) + 1e-13 * len(calls)\n"
    )
    report = attempt(card, counts, seed=1, place=in_this_process).report
    assert report.reason is Reason.NOT_DETERMINISTIC
    assert_reproduced(card, report)


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3),
    max_leaves=8,
)
ARRAYS = arrays.arrays(
    st.sampled_from([np.float64, np.float32, np.int64, np.int32, np.uint8, np.bool_]),
    arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3),
)


@pytest.mark.prove
@examples(100)
@given(PLAIN | ARRAYS)
def test_a_value_as_code_is_the_same_value(value: Any) -> None:
    again = eval(literal(value), {"np": np})
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        assert again.dtype == value.dtype and again.shape == value.shape
        assert np.array_equal(again, value, equal_nan=True)
    else:
        assert identical(again, value)


@pytest.mark.slow
def test_the_command_prints_a_program_that_runs(place: Place) -> None:
    import subprocess

    wrong = "def fk3(lengths, thetas):\n    return [[0.0, 0.0]] * (len(lengths) + 1)\n"
    place.answer(wrong, "fk3")
    done = place.run("check", "fk3", "--seed", "3")
    assert "The case as code: drills check fk3 --seed 3 --case" in done.out
    # A command that does not fit beside these words is on a line of its own, to be copied whole.
    other = place.answer(wrong, "my_answer_to_the_arm_with_three_links")
    far = place.run("check", "fk3", "--file", str(other), "--seed", "3", COLUMNS="80")
    assert "The case as code:\n  drills check fk3 --file " in far.out
    done = place.run("check", "fk3", "--seed", "3", "--case")
    assert done.code == 1 and done.out.startswith("# fk3, seed 3")
    program = place.answer(done.out, "case")
    ran = subprocess.run(
        [sys.executable, str(program)], capture_output=True, text=True, check=True, timeout=120
    )
    assert ran.stdout.startswith("got [[0.0, 0.0]") and ran.stdout.splitlines()[-1].startswith(
        "error "
    )
    data = place.json("check", "fk3", "--seed", "3", "--case")
    assert data["case"] == done.out
    place.answer(catalogue.card("fk3").solution_text(), "fk3")
    assert place.json("check", "fk3", "--seed", "3", "--case")["case"] is None
    assert "RIGHT" in place.run("check", "fk3", "--case").out
