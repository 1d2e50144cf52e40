"""Explanations that need no slip: each is given to its own mistake, and to nothing else."""

from __future__ import annotations

import ast
import sys

import numpy as np
import pytest

from drills import cards as catalogue
from drills.case_judge import Answer, Case
from drills.grade_report import Report
from drills.hypotheses import COMPUTED, ROUGH, limited, mutants, pairs, rough
from drills.inprocess import InProcess
from tests.budget import sampled
from tests.drills.here import grade_here

GENERIC = COMPUTED | ROUGH
EXACT = COMPUTED | {"nearly_right"}  # which a second mistake contradicts

# The exercise, its arguments, what is returned instead, and what the learner reads.
MISTAKES = [
    (
        "backprop",
        "x, target, W1, b1, W2, b2",
        "_right(x, target, W1, 0.0 * np.asarray(b1), W2, b2)",
        "Every wrong value is right for `b1` of 0",
    ),
    (
        "shaped_reward",
        "state, following, reward, terminated, truncated, phi, gamma",
        "_right(state, following, reward, truncated, terminated, phi, gamma)",
        "`terminated` and `truncated` swapped",
    ),
    ("edge_clearance", "*args", "1.0 - _right(*args)", "the right one taken from 1"),
    ("edge_clearance", "*args", "np.cumsum(_right(*args))", "summed up from the first one on"),
    ("log_uniform", "*args", "np.sqrt(_right(*args))", "the right one under a root"),
    ("log_uniform", "*args", "_right(*args)[::-1]", "the right one in reverse order"),
    ("log_uniform", "low, high, u", "_right(low, high, np.asarray(u) ** 2)", "`u` squared"),
]

# Written in another style than the worked answer, with one step that is wrong.
STEPS = {
    "the radius is added": (
        "edge_clearance",
        """
import numpy as np


def edge_clearance(a, b, discs):
    a, u, result = np.array(a, float), np.array(b, float) - np.array(a, float), []
    for x, y, r in np.array(discs, float).reshape(-1, 3):
        w = np.array([x, y]) - a
        s = min(max(w @ u / (u @ u), 0.0), 1.0) if u @ u > 0.0 else 0.0
        result.append(np.linalg.norm(w - s * u) + r)
    return np.array(result)
""",
        "with one sign turned",
    ),
}


def wrapped(name: str, arguments: str, result: str) -> Report:
    """Grade the worked answer with other arguments, or with a result that is changed."""
    card = catalogue.card(name)
    text = card.solution_text() + (
        f"\n\n_right = {card.entry}\n\n\ndef {card.entry}({arguments}):\n    return {result}\n"
    )
    return grade_here(name, text, seed=11)


@pytest.mark.parametrize(("name", "arguments", "result", "sentence"), MISTAKES)
def test_a_changed_argument_or_result_is_named(
    name: str, arguments: str, result: str, sentence: str
) -> None:
    report = wrapped(name, arguments, result)
    assert report.slip in GENERIC and sentence in report.diagnosis


@pytest.mark.parametrize("what", STEPS)
def test_a_changed_step_is_named_in_any_style(what: str) -> None:
    name, text, sentence = STEPS[what]
    report = grade_here(name, text, seed=11)
    assert report.slip == "step_changed" and sentence in report.diagnosis


@pytest.mark.slow
@pytest.mark.parametrize(("name", "arguments", "result", "sentence"), sampled(MISTAKES, 2))
def test_with_a_second_mistake_it_is_not_named(
    name: str, arguments: str, result: str, sentence: str
) -> None:
    """Both mistakes together give values that no single one gives."""
    both = f"[v * (1.3 + np.sin(np.sum(v))) for v in ({result},)][0]"
    if name == "backprop":
        both = f"[v * (1.3 + np.sin(np.sum(v))) for v in {result}]"
    report = wrapped(name, arguments, both)
    assert not report.passed and report.slip not in EXACT


@pytest.mark.parametrize(
    "name", sampled(["log_uniform", "edge_clearance", "backprop", "impact_time"], 2)
)
def test_a_second_mistake_alone_gets_none_of_them(name: str) -> None:
    result = "(r + 0.3 * np.sin(7.0 * np.asarray(r)) for r in [_right(*args)])"
    if name == "backprop":
        result = "(r + 0.3 * np.sin(7.0 * np.asarray(r)) for r in _right(*args))"
    report = wrapped(name, "*args", f"tuple({result})" if name == "backprop" else f"next({result})")
    assert not report.passed and report.slip not in EXACT


def answers(errors: list[float], labels: list[str]) -> list[Answer]:
    """Return answers of one number near 2, with a relative error each."""
    return [
        Answer(Case((), label), 2.0 + 2.0 * e, "", (2.0 + 2.0 * e,), (np.array(2.0),), (e == 0.0,))
        for e, label in zip(errors, labels, strict=True)
    ]


def test_an_approximation_is_called_one() -> None:
    name, sentence = rough(answers([0.0, 1e-3, 4e-3, -2e-3], ["a", "b", "c", "d"]))
    assert name == "nearly_right" and "0.4 %" in sentence
    assert rough(answers([0.0, 1e-3, 0.5, -2e-3], ["a", "b", "c", "d"])) == ("", "")


def test_cases_that_have_a_label_of_their_own_are_named() -> None:
    name, sentence = rough(answers([0.0, 0.0, 0.5, 0.0], ["a", "a", "no motion", "b"]))
    assert name == "some_cases_only" and '"no motion"' in sentence
    assert rough(answers([0.0, 0.0, 0.5, 0.0], ["a", "b", "b", "c"])) == ("", "")


def test_cases_that_alone_are_right_are_named() -> None:
    name, sentence = rough(
        answers([0.3, 0.0, 0.5, 0.4, 0.0], ["a", "no motion", "a", "b", "no motion"])
    )
    assert name == "some_cases_only" and sentence.startswith('Right in the case "no motion" and')
    assert rough(answers([0.3, 0.0, 0.5, 0.0], ["a", "b", "b", "a"])) == ("", "")


@pytest.mark.parametrize(
    ("old", "new", "phrase"),
    [
        ("r + g * a - b", "r + g * (a - b)", "if a factor of one term is a factor of the next"),
        ("r + (a - b) * g", "r + (a - g * b)", "if a factor of a whole sum is a factor of one"),
        ("max((r, a, b))", "max((r, b))", "if one entry of a list is left out"),
    ],
)
def test_brackets_and_entries_are_changed(old: str, new: str, phrase: str) -> None:
    text = "def f(r, g, a, b):\n    return {}\n"
    expected = ast.unparse(ast.parse(text.format(new)))
    messages = {changed: message for message, changed, _ in mutants(text.format(old))}
    assert phrase in messages[expected]


def test_the_same_is_changed_in_two_places() -> None:
    text = "def f(a, b):\n    return np.cos(a) + np.cos(b) * np.cos(a - b)\n"
    messages = {changed: message for message, changed, _ in pairs(text)}
    expected = "def f(a, b):\n    return np.sin(a) + np.sin(b) * np.cos(a - b)"
    assert messages[expected] == "with a sine in place of a cosine in two places"
    assert text.strip() not in messages


def test_components_in_another_order_are_named() -> None:
    report = wrapped(
        "orientation", "q, omega, dt", "_right(np.roll(np.asarray(q, float), 1), omega, dt)"
    )
    assert "for `q` with its components in the order 3, 0, 1, 2" in report.diagnosis


def test_a_value_that_is_all_but_right_is_not_called_reordered() -> None:
    """The right result in its own order is as close to these values as any explanation can be."""
    assert wrapped("fk3", "*args", "_right(*args) + 1e-9").slip not in COMPUTED


def test_a_changed_text_is_stopped() -> None:
    place = InProcess("def f(n):\n    while True:\n        n += 1\n")
    with pytest.raises(Exception) as caught:
        limited(place, "f", [0], lines=1000)
    assert type(caught.value).__name__ == "_TooLong" and sys.gettrace() is None


def test_a_changed_text_makes_no_large_arrays() -> None:
    """No line limit stops the algebra of a matrix of a thousand rows."""
    text = "import numpy as np\n\n\ndef f(n):\n    return np.linalg.eigvals(np.eye(n)).size\n"
    place = InProcess(text)
    assert limited(place, "f", [100]) == 100
    with pytest.raises(Exception) as caught:
        limited(place, "f", [5000])
    assert type(caught.value).__name__ == "_TooLong"


@pytest.mark.prove
def test_every_changed_step_is_another_text() -> None:
    counts: dict[str, int] = {}
    for card in catalogue.cards():
        text = ast.unparse(ast.parse(card.solution_text()))
        for phrase, changed, _ in mutants(text):
            counts[phrase] = counts.get(phrase, 0) + (changed != text)
    assert sum(counts.values()) > 1000 and len(counts) > 20 and all(counts.values())
