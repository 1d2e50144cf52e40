"""The engine itself, on small exercises made here: what it records, names and refuses."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from drills import cards as catalogue
from drills import exercise as exercises
from drills import feedback
from drills import grader as engine
from drills.attempt import Attempt
from drills.cards import Quantity, Signature
from drills.case_judge import Answer, Case, coarse, judge_of
from drills.exercise import Slip
from drills.grade_report import Report
from drills.grader import grade
from drills.reasons import Reason
from drills.verify import in_this_process

pytestmark = pytest.mark.slow


ROOT = Path(__file__).resolve().parents[2]
TURN = 2.0 * math.pi
RIGHT = catalogue.card("fk3").solution_text()


def _judged(monkeypatch: pytest.MonkeyPatch, judge: Any, source: str, **changes: Any) -> Report:
    """A submission to fk3, judged by another judge."""
    changed = dataclasses.replace(exercises.of("fk3"), judge=judge, **changes)
    monkeypatch.setattr(exercises, "of", lambda name: changed)
    return grade("fk3", source, seed=3)


def _cases(rng: np.random.Generator) -> list[Case]:
    return [Case((rng.uniform(0.1, 1.0, 3), rng.uniform(-3.0, 3.0, 3))) for _ in range(4)]


_by_value = judge_of(_cases, 1e-9, "rounding")


@pytest.mark.prove
def test_a_seed_replays_the_same_cases_and_no_seed_draws_others() -> None:
    wrong = RIGHT.replace("np.cumsum(thetas)", "thetas")
    one, again, other = (grade("fk3", wrong, seed=s) for s in (5, 5, None))
    assert [check.call for check in one.checks] == [check.call for check in again.checks]
    assert [check.call for check in one.checks] != [check.call for check in other.checks]
    assert grade("fk3", wrong).seed != other.seed


@pytest.mark.parametrize(
    "body",
    [
        "    import os\n    return base + 1e-3 * (os.getpid() % 997)",
        "    import time\n    return base + 1e-12 * (time.time_ns() % 1000)",
        "    return base + 1e-12 * np.random.random()",
        "    return base + 1e-12 * (hash('x') % 1000)",
        "    fk3.n = getattr(fk3, 'n', 0) + 1\n    return base + 1e-12 * fk3.n",
    ],
)
def test_an_answer_that_depends_on_anything_else_is_not_right(body: str) -> None:
    source = RIGHT.replace("def fk3(", "def base_fk3(") + (
        f"\n\ndef fk3(lengths, thetas):\n    base = base_fk3(lengths, thetas)\n{body}\n"
    )
    reason = grade("fk3", source, seed=1).reason
    assert reason in (Reason.NOT_DETERMINISTIC, Reason.WRONG_VALUE)


def test_a_changed_argument_is_noticed() -> None:
    source = RIGHT.replace("def fk3(", "def base_fk3(") + (
        "\n\ndef fk3(lengths, thetas):\n    answer = base_fk3(lengths, thetas)\n"
        "    thetas[0] += 1.0\n    return answer\n"
    )
    assert grade("fk3", source, seed=1).reason is Reason.INPUTS_CHANGED


def test_a_judge_that_stumbles_over_odd_results_gives_a_verdict(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def careless(attempt: Attempt) -> None:
        rows = np.asarray(attempt.call([1.0] * 3, [0.0] * 3), dtype=float)
        attempt.compare("tip", rows[3], [3.0, 0.0], tolerance=1e-9, unit="m", why="w")

    report = _judged(monkeypatch, careless, "def fk3(lengths, thetas):\n    return ['a', {}]\n")
    assert report.reason is Reason.WRONG_TYPE and "could not be judged" in report.sentence


def test_a_faulty_judge_is_not_the_learners_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(attempt: Attempt) -> None:
        raise KeyError("ours")

    with pytest.raises(KeyError, match="ours"):
        _judged(monkeypatch, broken, "def fk3(lengths, thetas):\n    return None\n")


def test_a_judge_that_checks_nothing_is_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(AssertionError, match="checked nothing"):
        _judged(monkeypatch, lambda attempt: None, "def fk3(lengths, thetas):\n    return 1\n")


def test_a_nan_error_never_passes(monkeypatch: pytest.MonkeyPatch) -> None:
    def strange(attempt: Attempt) -> None:
        got = attempt.call([1.0] * 3, [0.0] * 3)
        attempt.compare("x", got, np.full((4, 2), np.nan), tolerance=1e9, unit="m", why="w")

    assert _judged(monkeypatch, strange, RIGHT + "\nX = 0\n").reason is Reason.WRONG_VALUE


def test_what_was_right_as_far_as_it_went_is_no_slip(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slip that differs late must not be named for a submission that only ran out of time."""
    late = RIGHT.replace("def fk3(", "def base(") + (
        "\n\ndef fk3(lengths, thetas):\n    fk3.n = getattr(fk3, 'n', 0) + 1\n"
        "    return base(lengths, thetas) if fk3.n < 3 else {}\n"
    )
    slips = (Slip("late", "Late.", source=late.replace("{}", "np.zeros((4, 2))")),)
    raising = late.replace("else {}", "else 1 / 0")
    report = _judged(monkeypatch, _by_value, raising, slips=slips)
    assert report.reason is Reason.RAISED and report.slip == ""
    assert report.problem
    assert "1 / 0" in report.source.splitlines()[report.problem.frames[-1].line - 1]
    named = _judged(monkeypatch, _by_value, slips[0].source + "\nY = 0\n", slips=slips)
    assert named.slip == "late" and named.diagnosis == "Late."


def test_an_untouched_starter_is_recognised_whatever_its_layout() -> None:
    card = catalogue.card("fk3")
    starter = card.starter()
    assert grade("fk3", starter).reason is Reason.NOT_ATTEMPTED
    assert engine.is_starter(card, "# a note\n\n\n" + starter + "\nprint('hello')\n")
    assert not engine.is_starter(card, RIGHT)
    assert not engine.is_starter(card, "(" * 100000)
    assert not engine.is_starter(card, "x = " + "-" * 100000 + "1")


def test_other_code_around_an_untouched_starter_is_named() -> None:
    starter = catalogue.card("fk3").starter()
    report = grade("fk3", starter + "\n\ndef helper(x):\n    return 2 * x\n")
    assert report.reason is Reason.NOT_ATTEMPTED
    assert report.notes == ["fk3 is still the starter's. The other code in the file was not run."]
    assert "was not run" in feedback.html(report, catalogue.card("fk3"))
    for same in (starter, f'"""My notes."""\n# a comment\n{starter}'):
        assert grade("fk3", same).notes == []


@pytest.mark.prove
@pytest.mark.parametrize(
    ("header", "passes"),
    [
        ("(a, b)", True),
        ("(a, b, extra=1)", True),
        ("(*both)", True),
        ("(a, *rest)", True),
        ("(a, b, **more)", True),
        ("(a)", False),
        ("(a, b, c)", False),
        ("(a, *, b)", False),
        ("(a, b, *, c)", False),
        ("()", False),
    ],
)
def test_the_arguments_must_be_those_asked_for(header: str, passes: bool) -> None:
    inner = {"(*both)": "*both", "(a, *rest)": "a, *rest"}.get(header, "a, b")
    source = RIGHT.replace("def fk3(", "def base(") + (
        f"\n\ndef fk3{header}:\n    return base({inner})\n"
    )
    report = grade("fk3", source, seed=1)
    assert (report.reason is Reason.RIGHT) is passes, report.sentence
    if not passes:
        assert report.reason is Reason.WRONG_SIGNATURE


def test_a_slip_is_named_from_all_answers_also_when_the_run_is_stopped(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """`told` sees right and wrong answers; an exception between two does not hide the slip."""
    observed: list[int] = []

    def message(answers: Sequence[Answer]) -> str:
        observed.append(len(answers))
        return "half" if any(not all(answer.right) for answer in answers) else ""

    judge = judge_of(_cases, 1e-9, "rounding", explain=message)
    source = RIGHT.replace("def fk3(", "def base(") + (
        "\n\ndef fk3(lengths, thetas):\n    fk3.n = getattr(fk3, 'n', 0) + 1\n"
        "    return base(lengths, thetas) / min(fk3.n, 2)\n"
    )
    slips = (Slip("half", "Half.", source="def fk3(lengths, thetas):\n    return 1\n"),)
    report = _judged(monkeypatch, judge, source, slips=slips)
    assert report.reason is Reason.WRONG_VALUE and report.slip == "half"
    raising = source.replace("min(fk3.n, 2)", "(2 if fk3.n < 4 else [].pop())")
    stopped = _judged(monkeypatch, judge, raising, slips=slips)
    assert stopped.reason is Reason.RAISED and stopped.slip == "half"
    assert observed[0] == 4 and observed[-1] == 3


@pytest.mark.parametrize(
    ("short", "named"),
    [
        (lambda x: x.astype(np.float32), "single_precision"),
        (lambda x: x.round(5), "rounded"),
        (lambda x: (x + 2e-5).round(5), ""),  # wrong by more than what rounding loses
        (lambda x: x + 1e-7, ""),
        (lambda x: np.zeros_like(x), ""),
        (lambda x: x.tolist()[:-1], ""),
    ],
)
def test_an_answer_that_lost_its_digits_is_told_from_a_wrong_one(short: Any, named: str) -> None:
    truth = np.random.default_rng(2).uniform(-2.0, 2.0, (4, 2))

    def answer(got: Any, right: bool) -> Answer:
        return Answer(Case(()), got, "", (got,), (truth,), (right,))

    assert coarse([answer(truth, True), answer(short(truth), False)]) == named
    assert coarse([answer(short(truth), True)]) == ""


def wrap_angle(angle: float) -> float:
    """The worked answer of the example in CONTRIBUTING.md."""
    return (angle + math.pi) % TURN - math.pi


def test_the_example_of_contributing_is_an_exercise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its judge passes the worked answer; each of its slips is caught and named."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    exec(text.partition("```python\n")[2].partition("```")[0], names)
    made = names["EXERCISE"]
    angle = Quantity("angle", "number", "rad", "an angle")
    card = dataclasses.replace(
        catalogue.card("fk3"),
        entry="wrap_angle",
        signatures=(Signature("wrap_angle(angle)", (angle,), (angle,)),),
        solution="tests.drills.test_grade:wrap_angle",
    )
    monkeypatch.setattr(exercises, "of", lambda name: made)
    solution = card.solution_text()

    def graded(text: str) -> Report:
        return engine.attempt(card, text, seed=3, place=in_this_process).report

    assert graded(solution).passed
    assert len(made.slips) == 3
    for slip in made.slips:
        assert graded(slip.text(solution)).slip == slip.name


def test_of_warnings_only_those_of_the_case_that_is_told_are_shown() -> None:
    head = "import warnings\n\nimport numpy as np\n\n\ndef fk3(lengths, thetas):\n"
    body = (
        "    print('mine')\n    if lengths[0] == 0.0:\n        np.array([1.0, 2.0]) / lengths[0]\n"
        "    if lengths[0] == 1.0 == lengths[2]:\n        np.nanmean(np.array([np.nan]))\n"
        "    return np.ones((4, 2))\n"
    )
    output = grade("fk3", head + body, seed=3).output
    assert "RuntimeWarning: Mean of empty slice" in output and "/" not in output
    assert "divide by zero" not in output and output.count("mine") > 10


OWN_MODULE = "An answer can't use the course's own modules"


@pytest.mark.parametrize(
    "head",
    [
        "from course.drills import fk3",
        "import course.learning",
        "from solutions.perception import dbscan",
        # As it is for an installed package: the file is found and can't be opened.
        "import importlib.util as u\n"
        f"s = u.spec_from_file_location('course', {str(ROOT / 'course' / '__init__.py')!r})\n"
        "s.loader.exec_module(u.module_from_spec(s))",
    ],
    ids=["a function", "a module", "solutions", "installed"],
)
def test_an_import_of_the_course_is_explained(head: str) -> None:
    report = grade("fk3", f"{RIGHT}\n\n{head}\n", seed=1)
    assert report.reason is Reason.RAISED
    assert report.sentence.startswith(OWN_MODULE)


def test_the_import_of_an_unknown_module_is_shown_as_it_is() -> None:
    report = grade("fk3", f"{RIGHT}\n\nimport coursework\n", seed=1)
    assert report.sentence == "fk3 raised ModuleNotFoundError."
    report = grade("fk3", RIGHT.replace("return", "raise KeyError('course')\n    return"), seed=1)
    assert report.sentence == "fk3 raised KeyError."


def test_a_busy_machine_does_not_lengthen_the_time_of_a_call():
    """Most requests are delayed by thousands of times what a call takes; the figure stays."""
    requests = itertools.count()
    costs: list[dict[str, float]] = []

    def yours(n: int) -> float:
        delay = 5e-3 if next(requests) % 3 else 0.0
        return 2e-4 + 1e-6 * n + delay  # trip, calls, other processes

    record: Any = SimpleNamespace(cost=lambda what, unit, **times: costs.append(times))
    Attempt.time(record, "time per call", yours, lambda n: 1e-6 * n)
    assert costs[0]["yours"] == pytest.approx(1e-6, rel=0.01)
    assert costs[0]["reference"] == pytest.approx(1e-6, rel=0.01)
