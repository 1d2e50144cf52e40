"""Every claim is settled again; and the framework notices a record that is wrong."""

import json
import subprocess
import sys
from dataclasses import replace
from typing import Any

import pytest

from course import derivations
from course.derivations import Claim, Finding, Formula, Verdict, claim, claims, run, settle
from course.derivations.answer import Symbol

ALL = claims()


@pytest.mark.parametrize("item", ALL, ids=lambda item: item.id)
def test_verdict_and_figures_reproduce(item):
    outcome = run(item.id)
    assert outcome.agrees, "\n".join(outcome.disagreements)


@pytest.mark.parametrize("item", ALL, ids=lambda item: item.id)
def test_record_is_complete(item):
    assert len(item.claim) > 15 and len(item.corrected) > 15
    assert item.claim.strip().rstrip(".") != item.corrected.strip().rstrip(".")
    assert run(item.id).finding.statement


def test_ids_are_unique_and_chapters_covered():
    ids = [item.id for item in ALL]
    assert len(ids) == len(set(ids))
    assert sum(len(claims(number)) for number in {item.chapter for item in ALL}) == len(ALL)
    assert len(claims(1)) >= 60 and len(claims(8)) >= 10


def test_some_claims_fail_and_some_hold():
    verdicts = [item.verdict for item in ALL]
    assert all(verdicts.count(v) >= 5 for v in Verdict)


def _register(**changes):
    """A true record about 2 + 2, with some entries changed."""
    registry: dict[str, Claim] = {}
    record: dict[str, Any] = {
        "verdict": Verdict.FALSE,
        "corrected": "2 + 2 is 4.",
        "figures": {"sum": (4.0, 1e-9)},
    }
    finding: dict[str, Any] = {
        "figures": {"sum": 2 + 2},
        "statement": "Added.",
        "holds": 2 + 2 == 5,
        "corrected": 2 + 2 == 4,
    }
    for name, value in changes.pop("found", {}).items():
        finding[name] = value
    record.update(changes)

    @claim("two_and_two", 99, "2 + 2 is 5.", registry=registry, **record)
    def _check():
        return Finding(**finding)

    return registry["two_and_two"]


def test_a_true_record_agrees():
    assert settle(_register()).agrees


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"verdict": Verdict.HOLDS}, "verdict on record: holds; found: false"),
        ({"verdict": Verdict.CONDITIONAL, "condition": "it rains"}, "found: false"),
        ({"found": {"holds": True}}, "found: holds"),
        ({"found": {"holds_if": True}}, "found: holds only if"),
        ({"found": {"holds": True, "holds_if": False}}, "not under its condition"),
        ({"found": {"corrected": False}}, "corrected statement does not hold"),
        ({"figures": {"sum": (4.001, 1e-6)}}, "sum is 4, on record is 4.001"),
        ({"figures": {"sum": (0.0, 1e-6)}}, "sum is 4, on record is 0"),
        ({"figures": {"sum": ("four", 0)}}, "on record is 'four'"),
        ({"found": {"figures": {"sum": float("nan")}}}, "sum is nan"),
        ({"found": {"figures": {"sum": 4, "more": 1}}}, "more is computed, not on record"),
        (
            {"figures": {"sum": (4, 0), "typed": (7, 0)}},
            "typed is on record but not computed",
        ),
    ],
)
def test_a_wrong_record_is_found(changes, said):
    outcome = settle(_register(**changes))
    assert not outcome.agrees
    assert any(said in text for text in outcome.disagreements)


def test_a_wrong_formula_on_record_is_found():
    import sympy

    x = sympy.Symbol("x", positive=True)
    right = Formula("Double x.", "2*x", {"x": Symbol("any")})
    good = _register(formula=right, found={"formula": x + x})
    assert settle(good).agrees
    assert not settle(replace(good, formula=replace(right, expression="2*x + 0.001"))).agrees
    assert not settle(replace(good, formula=None)).agrees
    assert not settle(_register(formula=right)).agrees


@pytest.mark.parametrize(
    "changes",
    [
        {"corrected": ""},
        {"figures": {}},
        {"condition": "a condition without a conditional verdict"},
        {"verdict": Verdict.CONDITIONAL},
    ],
)
def test_a_record_that_contradicts_itself_is_refused(changes):
    with pytest.raises(ValueError, match="two_and_two"):
        _register(**changes)


def test_an_id_that_is_taken_is_refused():
    with pytest.raises(ValueError, match="must be unique"):

        @claim(
            "semi_implicit_limit",
            2,
            "Something else.",
            verdict=Verdict.FALSE,
            corrected="Something.",
            figures={"a": (1, 0)},
        )
        def _check():
            return Finding({"a": 1}, "", False, True)


def test_figure_is_computed_once_per_process():
    calls = []
    registry = derivations.CLAIMS

    @claim(
        "counted_once",
        98,
        "A check runs every time it is asked.",
        verdict=Verdict.FALSE,
        corrected="It runs once per process.",
        figures={"one": (1, 0)},
    )
    def _check():
        calls.append(1)
        return Finding({"one": 1}, "Counted.", False, True)

    try:
        assert derivations.figure("counted_once", "one") == 1
        assert derivations.figure("counted_once", "one") == 1
        assert len(calls) == 1
    finally:
        del registry["counted_once"]


def test_figure_and_show():
    limit = derivations.figure("semi_implicit_limit", "limit_ms")
    assert limit == pytest.approx(2000 / 100_000**0.5, rel=1e-9)
    block = derivations.show("semi_implicit_limit")
    assert "6.3246" in repr(block) and "6.3246" in block._repr_markdown_()
    assert "0x" not in repr(block)


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: derivations.figure("no_such_claim", "x"), "no_such_claim"),
        (lambda: derivations.figure("semi_implicit_limit", "nothing"), "limit_ms"),
        (lambda: derivations.claims(77), "77"),
        (lambda: derivations.show("no_such_claim"), "no_such_claim"),
        (lambda: derivations.answer("planar_state", "6"), "semi_implicit_limit"),
    ],
)
def test_bad_input_is_named(call, named):
    with pytest.raises(ValueError, match=named):
        call()


def test_importing_is_light():
    code = (
        "import sys, course.derivations as d; d.claims();"
        "heavy = {'sympy', 'mujoco', 'scipy', 'matplotlib', 'torch'} & set(sys.modules);"
        "print(sorted(heavy))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "[]", result.stdout + result.stderr


def _command(*arguments):
    return subprocess.run(
        [sys.executable, "-m", "course.derivations", *arguments],
        capture_output=True,
        text=True,
        env={"COLUMNS": "80", "PATH": "/usr/bin:/bin", "HOME": "/nonexistent", "LANG": "C.UTF-8"},
    )


def test_command_prints_a_table_of_80_columns():
    result = _command("--id", "semi_implicit_limit")
    assert result.returncode == 0, result.stdout + result.stderr
    assert "semi_implicit_limit" in result.stdout and "limit_ms = 6.3246" in result.stdout
    assert max(len(line) for line in result.stdout.splitlines()) <= 80


def test_command_prints_json():
    result = _command("1", "--id", "determinant_one_is_stable", "--json")
    (data,) = json.loads(result.stdout)
    assert data["verdict"] == "holds only if" and data["condition"]
    assert data["figures"]["outer_at_2_1"] == pytest.approx(-1.877328, rel=1e-6)
    assert data["disagreements"] == []


def test_command_exits_with_1_when_something_disagrees():
    code = (
        "import sys; from course import derivations as d; from dataclasses import replace;"
        "d.claims(); i = 'determinant_one_is_stable';"
        "d.CLAIMS[i] = replace(d.CLAIMS[i], verdict=d.Verdict.HOLDS, condition='');"
        "from course.derivations.__main__ import main;"
        "main(['--id', i])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 1
    assert "DISAGREES" in result.stdout


def test_a_check_that_breaks_is_reported_not_raised():
    code = (
        "from course import derivations as d; from dataclasses import replace;"
        "d.claims(); i = 'determinant_one_is_stable';"
        "d.CLAIMS[i] = replace(d.CLAIMS[i], check=lambda: 1 / 0);"
        "from course.derivations.__main__ import main;"
        "main(['--id', i])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 1
    assert "ZeroDivisionError" in result.stdout


@pytest.mark.parametrize("arguments", [("77",), ("--id", "no_such_claim")])
def test_command_refuses_what_is_not_there(arguments):
    result = _command(*arguments)
    assert result.returncode == 2
    assert arguments[-1] in result.stderr
