"""What wrong results share: each sentence is true of all of them, and right results get none."""

from __future__ import annotations

import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from drills import patterns
from drills.case_judge import Answer, Case
from tests.budget import examples

Array = NDArray[np.float64]
Result = Callable[..., Any]
NAMES = ("q", "v", "dt", "m", "n")
TOLERANCE = 1e-9


def right(q: Array, v: Array, dt: float, m: float, n: int) -> Array:
    return q + dt * v / m


def attempt(
    wrong: Result, truth: Result = right, seed: int = 0, cases: int = 14, size: int | None = None
) -> Any:
    """Return what the patterns see of a run: arguments, results, and which of them are right."""
    rng, answers = np.random.default_rng(seed), []
    for k in range(cases):
        length = size or 3 + k % 3
        args = (rng.normal(size=length), rng.normal(size=length), rng.uniform(0.1, 0.9))
        args = (*args, rng.uniform(0.9, 1.5) + 1.2 * (k // 2 % 2), k)
        got, expected = np.asarray(wrong(*args)), np.asarray(truth(*args), dtype=float)
        same = got.shape == expected.shape and bool(np.all(np.abs(got - expected) <= TOLERANCE))
        answers.append(Answer(Case(args), got, "", (got,), (expected,), (same,)))
    values = {
        "arguments": [SimpleNamespace(name=name) for name in NAMES],
        "returns": [SimpleNamespace(name="q_new")],
    }
    card = SimpleNamespace(signatures=[SimpleNamespace(**values)])
    return SimpleNamespace(answers=answers, card=card)


# What is returned instead, and what the learner reads.
FORMS: list[tuple[Result, str]] = [
    (lambda q, v, dt, m, n: q, "the result is `q` and nothing else"),
    (lambda q, v, dt, m, n: dt * v / m, "the right one minus `q`"),
    (lambda q, v, dt, m, n: q + dt * v / m + 0.5 * dt**2 * q, "plus `0.5*dt**2*q`"),
    (lambda q, v, dt, m, n: q + dt * v / m + 0.25, "the right one plus 0.25"),
    (lambda q, v, dt, m, n: m**2 * right(q, v, dt, m, n), "the right one times `m**2`"),
    (lambda q, v, dt, m, n: right(q, v, dt, m, n) / np.linalg.norm(q), "times `1/norm(q)`"),
    (lambda q, v, dt, m, n: right(q, v, dt, m, n) * (1 + np.sin(n)), "is a multiple of the right"),
    (lambda q, v, dt, m, n: np.zeros_like(q), "nothing but zeros"),
    (lambda q, v, dt, m, n: np.abs(right(q, v, dt, m, n)), "only signs are wrong"),
    (lambda q, v, dt, m, n: right(q, v, dt, m, n) + 2 * np.pi * np.rint(q), "multiples of 2 pi"),
    (lambda q, v, dt, m, n: np.sort(right(q, v, dt, m, n)), "in another order"),
    (lambda q, v, dt, m, n: np.r_[right(q, v, dt, m, n)[:-1], n], "only in the last number"),
    (lambda q, v, dt, m, n: np.r_[n, right(q, v, dt, m, n)[1:]], "only in the first number"),
    (lambda q, v, dt, m, n: np.r_[q[:1] * n, right(q, v, dt, m, n)[1:-1], n], "first and the last"),
]


@pytest.mark.parametrize(("wrong", "sentence"), FORMS)
def test_each_form_is_named(wrong: Result, sentence: str) -> None:
    name, message = patterns.form(attempt(wrong))
    assert name in patterns.NAMES and sentence in message, message


def test_a_length_that_is_right_is_named() -> None:
    turned = attempt(lambda *args: np.roll(right(*args), 1) * [1.0, -1.0, 1.0], size=3)
    assert patterns.form(turned)[0] == "length_right"


def test_a_result_that_never_changes_is_named() -> None:
    name, message = patterns.form(attempt(lambda *a: 0.5, lambda q, v, dt, m, n: dt * m))
    assert name == "same_everywhere" and "(0.5)" in message


def test_a_small_error_is_no_turn() -> None:
    small = attempt(lambda q, *args: right(q, *args) + 1e-7 * np.sin(9.0 * q))
    assert patterns.form(small) == ("", "")


def bent(q: Array, *args: Any) -> Array:
    """Return errors without a form or a side."""
    return right(q, *args) + 0.1 * np.sin(7.0 * q)


DIVISIONS: list[tuple[Result, str]] = [
    (lambda *a: bent(*a) if a[3] > 1.8 else right(*a), "in every case with `m` of"),
    (lambda *a: bent(*a) if a[4] > 6 else right(*a), "with `n` of 7 or more"),
    (lambda *a: bent(*a) if len(a[0]) == 3 else right(*a), "the length of `q` of 3 or less"),
    (lambda *a: np.where(a[0] < 0, bent(*a), right(*a)), "in every place with `q` below 0"),
    (lambda *a: np.maximum(right(*a), 0.0), "in every place with a right value below 0"),
    (lambda *a: right(*a) + np.exp(a[1]), "is too large"),
]


@pytest.mark.parametrize(("wrong", "sentence"), DIVISIONS)
def test_what_divides_wrong_from_right_is_named(wrong: Result, sentence: str) -> None:
    name, message = patterns.division(attempt(wrong, cases=30))
    assert name in patterns.NAMES and sentence in message, message


def test_a_feature_of_zero_divides() -> None:
    nonzero, zeros = np.array([0.5, -1.0, 2.0]), np.zeros(4)
    message = patterns._divides(nonzero, zeros, "The result", "`v`")
    assert message == "The result is right in every case with `v` of 0, and wrong in all others."
    message = patterns._divides(zeros, nonzero, "The result", "`v`")
    assert message == "The result is wrong in every case with `v` of 0, and right in all others."
    assert patterns._divides(nonzero, -nonzero, "The result", "`v`") is None


def test_verdicts_that_are_wrong_on_one_side_are_named() -> None:
    def verdict(q: Array, v: Array, dt: float, m: float, n: int) -> float:
        return float(np.sin(9.0 * m + n) > 0.0)

    def wide(q: Array, v: Array, dt: float, m: float, n: int) -> float:
        return float(np.sin(9.0 * m + n) > -0.7)

    name, message = patterns.division(attempt(wide, verdict, cases=30))
    assert name == "one_sided" and "1 where 0 is right" in message and "too wide" in message


def test_few_cases_and_errors_without_a_pattern_get_no_sentence() -> None:
    assert patterns.form(attempt(FORMS[0][0], cases=2)) == ("", "")
    assert patterns.form(attempt(bent)) == ("", "") == patterns.division(attempt(bent))


def holds(name: str, message: str, run: Any) -> bool:
    """Return whether a sentence is true, from its words and the results alone."""
    rows = [a for a in run.answers if not all(a.right)]
    for a in rows:
        got, truth, error = a.got, a.truth[0], a.got - a.truth[0]
        known = dict(zip(NAMES, a.case.args, strict=True)) | {"result": truth, "len": len}
        known |= {"norm": np.linalg.norm, "sum": np.sum, "sqrt": np.sqrt}
        if name in ("term_of_arguments", "factor_of_arguments"):
            match = re.search(r"(minus|plus|times|is) (?:`([^`]+)`|([\d.e+-]*\d))", message)
            assert match is not None
            word, code, number = match.groups()
            value = eval(code or number, known)
            expected = {"minus": truth - value, "plus": truth + value, "times": truth * value}
            if not np.allclose(got, expected.get(word, value), rtol=1e-4, atol=1e-6):
                return False
        elif name == "common_factor":
            if np.linalg.matrix_rank(np.array([got, truth]), tol=1e-6) > 1:
                return False
        elif name == "signs_only":
            if not np.allclose(np.abs(got), np.abs(truth)):
                return False
        elif name == "whole_turns":
            word = re.search(r"multiples of (\S+(?: pi)?) and", message)
            assert word is not None
            turn = {"2 pi": 2 * np.pi, "pi": np.pi, "pi/2": np.pi / 2, "360": 360.0}[word[1]]
            count = error[np.abs(error) > 1e-9] / turn
            if not np.allclose(count, np.rint(count)) or not np.rint(count).all():
                return False
        elif name == "other_order":
            if not np.allclose(sorted(got), sorted(truth)):
                return False
        elif name == "one_place_wrong":
            ok = np.abs(error) < 1e-8
            ends = {"the first number": ok[1:], "the last number": ok[:-1]}
            ends["the first and the last number"] = ok[1:-1]
            place = next(p for p in reversed(ends) if p in message)
            beside = {"the first number": ok[:1], "the last number": ok[-1:]}
            beside["the first and the last number"] = ok[[0, -1]]
            if not (ends[place] if "only in" in message else beside[place]).all():
                return False
        elif name == "one_sided":
            far = error * np.sign(truth)
            signs = {"too large": error, "too small": -error, "too far": far, "too close": -far}
            word = next(w for w in signs if w in message)
            if not np.all(signs[word][np.abs(error) > 1e-8] > 0.0):
                return False
    return bool(rows)


def divided(message: str, run: Any) -> bool:
    """Return whether the condition in a sentence is one, of the cases or of the numbers."""
    match = re.search(
        r"every (case|place) with (.*?) (of|below|above) (\S+)( or more| or less|)", message
    )
    if match is None:
        return " with " not in message
    number, feature, word, limit, side = match.groups()
    wrong, right_ = list[float](), list[float]()
    for a in run.answers:
        known = dict(zip(NAMES, a.case.args, strict=True))
        code = re.sub(r"^the length of `(\w+)`$", r"len(\1)", feature)
        code = re.sub(r"^the (smallest|largest) number in `(\w+)`$", r"\1(\2)", code)
        code = re.sub(r"^the norm of `(\w+)`$", r"norm(\1)", code).strip("`")
        code = code.replace("a right value", "truth")
        known |= {"truth": a.truth[0], "smallest": np.min, "largest": np.max, "len": len}
        values = np.ravel(eval(code, known | {"norm": np.linalg.norm}))
        differs = np.abs(a.got - a.truth[0]) > 1e-8
        missed = np.array([not all(a.right)]) if number == "case" else differs
        wrong += values[missed].tolist()
        right_ += values[~missed].tolist()
    bound = float(limit.rstrip(",."))
    below = word == "below" or side == " or less"
    if word == "of" and not side:
        inside, outside = (right_, wrong) if "is right in every" in message else (wrong, right_)
        return set(inside) == {bound} and bound not in outside
    slack = 1e-3 * abs(bound)
    if below:
        return max(wrong) <= bound + slack and min(right_) >= max(wrong)
    return min(wrong) >= bound - slack and max(right_) <= min(wrong)


PIECES: list[Result] = [
    lambda q, v, dt, m, n: q,
    lambda q, v, dt, m, n: dt * v,
    lambda q, v, dt, m, n: v / m,
    lambda q, v, dt, m, n: 0.5 * dt**2 * v,
    lambda q, v, dt, m, n: np.abs(q),
    lambda q, v, dt, m, n: q * v,
    lambda q, v, dt, m, n: np.ones_like(q),
    lambda q, v, dt, m, n: np.full_like(q, m),
]


@examples(60)
@given(
    st.lists(st.sampled_from([-2.0, -1.0, 0.0, 0.0, 0.0, 0.5, 1.0]), min_size=8, max_size=8),
    st.sampled_from(
        ["all", "first", "last", "some cases", "negative", "sorted", "absolute", "tiny", "turns"]
    ),
    st.integers(0, 99),
)
def test_whatever_is_said_is_true(weights: list[float], where: str, seed: int) -> None:
    """Terms with any weights, added everywhere or in one place, and results changed as a whole."""

    def wrong(*args: Any) -> Array:
        truth = right(*args)
        added = sum(w * piece(*args) for w, piece in zip(weights, PIECES, strict=True)) + truth
        at = np.arange(len(truth))
        if where == "tiny":
            return truth + 1e-8 * np.sin(added + 9.0 * truth)
        if where == "turns":
            return truth + 2.0 * np.pi * np.rint(added)
        if where in ("sorted", "absolute"):
            return np.sort(added) if where == "sorted" else np.abs(added)
        changed = {
            "all": at >= 0,
            "first": at == 0,
            "last": at == at[-1],
            "some cases": np.full(len(at), args[3] > 1.8),
            "negative": truth < 0.0,
        }[where]
        return np.where(changed, added, truth)

    run = attempt(wrong, seed=seed)
    if all(all(a.right) for a in run.answers):
        assert patterns.form(run) == ("", "") == patterns.division(run)
        return
    for name, message in (patterns.form(run), patterns.division(run)):
        assert name == "" or (holds(name, message, run) and divided(message, run)), (name, message)


@examples(100)
@given(st.integers(0, 999), st.floats(0.0, 1e-10))
def test_right_results_get_no_sentence(seed: int, error: float) -> None:
    run = attempt(lambda *args: right(*args) + error * np.sin(args[0]), seed=seed)
    assert patterns.form(run) == ("", "") == patterns.division(run)
