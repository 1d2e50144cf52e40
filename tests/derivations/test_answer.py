"""A learner's formula: every equivalent form passes, every wrong one gets a true counter-example,
and no text, however hostile, does anything but get a message."""

import math
import re
import sys
import threading
import time

import hypothesis.strategies as st
import pytest
from hypothesis import given

from course import derivations
from course.derivations import claims
from course.derivations.answer import (
    _CONFIRM_SECONDS,
    Formula,
    Symbol,
    answer_formula,
    parse,
    to_sympy,
)
from tests.budget import examples

ANSWERABLE = [item for item in claims() if item.formula is not None]


def _check(id, text):
    return derivations.answer(id, text)


def test_there_are_enough_to_answer():
    ids = {item.id for item in ANSWERABLE}
    assert len(ids) >= 15
    assert {
        "semi_implicit_limit",
        "explicit_energy_factor",
        "explicit_damped_limit",
        "semi_implicit_damped_limit",
        "rk4_limit",
        "free_fall_energy_error",
        "top_condition",
        "verlet_frequency",
    } <= ids


@pytest.mark.slow
@pytest.mark.parametrize("item", ANSWERABLE, ids=lambda item: item.id)
def test_its_own_formula_is_right(item):
    result = _check(item.id, item.formula.expression)
    assert result.correct and result and result.counterexample is None


@pytest.mark.slow
@pytest.mark.parametrize("item", ANSWERABLE, ids=lambda item: item.id)
def test_it_has_slips_and_rejects_each_by_name(item):
    assert len(item.formula.slips) >= 3
    for slip, explanation in item.formula.slips.items():
        result = _check(item.id, slip)
        assert not result.correct, slip
        assert explanation in result.message, slip


@pytest.mark.slow
@pytest.mark.parametrize("item", ANSWERABLE, ids=lambda item: item.id)
@pytest.mark.parametrize("change", ["1.001*({})", "({}) + 0.001", "-({})", "({})^2", "1/({})"])
def test_small_changes_are_caught_with_true_numbers(item, change):
    text = change.format(item.formula.expression)
    result = _check(item.id, text)
    if item.formula.tolerance and change in ("1.001*({})", "({}) + 0.001"):
        assert result.correct  # a rounded number is admitted there
        return
    assert not result.correct
    outcome = result.counterexample
    # The numbers again, by SymPy and from scratch.
    ours = to_sympy(item.formula)
    at = {symbol: outcome["values"][symbol.name] for symbol in ours.free_symbols}
    expected = float(ours.evalf(30, subs=at))
    changed = {
        "1.001*({})": 1.001 * expected,
        "({}) + 0.001": expected + 0.001,
        "-({})": -expected,
        "({})^2": expected**2,
        "1/({})": 1 / expected,
    }[change]
    assert outcome["ours"] == pytest.approx(expected, rel=1e-12)
    assert outcome["yours"] == pytest.approx(changed, rel=1e-12)
    assert outcome["ours"] != outcome["yours"]


@pytest.mark.parametrize(
    "text",
    [
        "2*sqrt(m/k)",
        "2 sqrt(m/k)",
        "2sqrt(m/k)",
        "2*(m/k)^0.5",
        "2*(m/k)**(1/2)",
        "sqrt(4 m/k)",
        "sqrt(4*m)/sqrt(k)",
        "2/omega",
        "dt < 2/omega",
        "dt <= 2*sqrt(m/k)",
        "h = 2 sqrt(m/k)",
        "2/omega >= dt",
        "dt ≤ 2·√(m/k)",
        "2/ω",
        "2/sqrt(k/m)",
        "exp(log(4*m/k)/2)",
        "2 sqrt(m) sqrt(k) / k",
        "((((2))))*sqrt(((m))/(k))",
        "\t 2 * sqrt( m / k ) \n",
        "-(-2)*sqrt(m/k)",
        "+2*sqrt(m/k)",
        "2*sqrt(m/k)*(sin(m)^2 + cos(m)^2)",
        "abs(-2*sqrt(m/k))",
        "2*m/sqrt(m*k)",
        "2e0*sqrt(m/k)",
    ],
)
def test_equivalent_forms_of_one_limit_pass(text):
    result = _check("semi_implicit_limit", text)
    assert result.correct, result.message


@pytest.mark.parametrize(
    ("id", "text"),
    [
        ("semi_implicit_damped_limit", "2/(omega*(sqrt(1+zeta^2)+zeta))"),
        ("mujoco_damped_limit", "4*m/(sqrt(c^2+4*k*m)-c)"),
        ("explicit_eigenvalues", "sqrt((1 + omega h)^2 - 2 omega h)"),
        ("verlet_frequency", "acos(1 - (omega h)^2/2)/h"),
        ("implicit_midpoint_limit", "2 atan(h omega/2)"),
        ("rk4_limit", "sqrt(8)/ω"),
        ("rk4_limit", "2√2/ω"),
        ("rk4_limit", "√√64 / omega"),
        ("rk4_limit", "2^1.5/omega"),
        ("explicit_growth_per_second", "exp(h)^(omega^2)"),
        ("principal_axis_is_stable", "omega sqrt((I3-I2)/I1) sqrt((I2-I1)/I3)"),
        ("contact_limit_explicit", "6.32"),
        ("contact_limit_explicit", "dt < 6.3246"),
        ("tunnelling_thickness", "v < w/dt + d/dt"),
        ("free_fall_energy_error", "1/2 m (g h)^2"),
    ],
)
def test_equivalent_forms_of_others_pass(id, text):
    result = _check(id, text)
    assert result.correct, result.message


def _rewritings(tree):
    """Equivalent texts of a tree ("name" | "number" | (op, a, b)), chosen by hypothesis."""
    if isinstance(tree, str):
        return st.sampled_from([tree, f"({tree})", f"1*{tree}", f"(({tree})^2)^0.5", f"-(-{tree})"])
    op, a, b = tree
    left, right = _rewritings(a), _rewritings(b)
    forms = {
        "*": ["({0})*({1})", "({1})*({0})", "({0})({1})", "exp(log({0})+log({1}))"],
        "/": ["({0})/({1})", "({0})*({1})^(-1)", "1/(({1})/({0}))"],
        "+": ["({0})+({1})", "({1})+({0})", "({0})-(-({1}))"],
    }[op]
    return st.tuples(st.sampled_from(forms), left, right).map(lambda t: t[0].format(t[1], t[2]))


_TREES = st.sampled_from(
    [
        ("semi_implicit_limit", ("/", "2", "omega")),
        ("rk4_limit", ("/", "8^0.5", "omega")),
        ("tunnelling_thickness", ("/", ("+", "w", "d"), "dt")),
        ("explicit_damped_limit", ("/", ("*", "2", "zeta"), "omega")),
        ("free_fall_energy_error", ("*", ("*", "m", "g^2"), ("/", "h^2", "2"))),
    ]
)


@examples(40)
@given(_TREES.flatmap(lambda t: st.tuples(st.just(t[0]), _rewritings(t[1]))))
def test_generated_rewritings_pass(case):
    id, text = case
    if len(text) <= 200:
        result = _check(id, text)
        assert result.correct, (text, result.message)


@examples(60)
@given(
    st.floats(0.1, 10).filter(lambda c: abs(c - 2) > 1e-6),
    st.integers(-3, 3),
    st.sampled_from(["m", "k"]),
)
def test_generated_wrong_ones_get_a_true_counterexample(factor, power, name):
    text = f"{factor!r}*sqrt(m/k)*{name}^({power})"
    result = _check("semi_implicit_limit", text)
    assert not result.correct
    values = result.counterexample["values"]
    m, k = values["m"], values["k"]
    assert result.counterexample["ours"] == pytest.approx(2 * math.sqrt(m / k), rel=1e-12)
    yours = factor * math.sqrt(m / k) * values[name] ** power
    assert result.counterexample["yours"] == pytest.approx(yours, rel=1e-12)
    assert result.counterexample["yours"] != result.counterexample["ours"]


def test_a_difference_beyond_double_precision_is_found():
    assert not _check("semi_implicit_limit", "2*sqrt(m/k) + 1e-25").correct


def test_a_difference_in_a_corner_is_found():
    """Right where m > k, wrong elsewhere."""
    assert not _check("semi_implicit_limit", "2*sqrt(m/k) + (abs(m-k) - (m-k))").correct


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("dt > 2/omega", "turn the sign round"),
        ("2/omega < dt", "turn the sign round"),
        ("x < 2/omega", "single name"),
        ("dt < 2/omega < 3", "more than one relation"),
        ("2*sqrt(m/k", "closing bracket"),
        ("2*sqrt(m/k))", "bracket too many"),
        ("2*sqrt m", "in brackets"),
        ("2*sqrt(m/kk)", "'kk' is not a symbol here; the symbols are k, m, omega, pi"),
        ("2*", "it stops"),
        ("1/0", "divides by zero"),
        ("1/(m-m)", "divides by zero"),
        ("log(m-m)", "logarithm of zero"),
        ("sqrt(-m)", "not a real number"),
    ],
)
def test_messages_say_what_is_wrong(text, expected):
    result = _check("semi_implicit_limit", text)
    assert not result.correct
    assert expected in result.message


def test_a_rounded_number_is_told_from_the_exact_one():
    result = _check("rk4_limit", "2.828427/omega")
    assert not result.correct
    assert "yours gives 2.828427, the right one gives 2.8284271." in result.message
    assert "write it exactly" in result.message
    assert "exactly" not in _check("rk4_limit", "2.5/omega").message


HOSTILE = [
    "√" * 150 + "2",
    "",
    "   ",
    "\n",
    "\x00",
    "2*sqrt(m/k)\x00",
    "__import__('os').system('touch pwned')",
    "().__class__.__bases__[0].__subclasses__()",
    "m.__class__",
    "m.real",
    "m.__init__.__globals__",
    "(lambda: 1)()",
    "lambda m: m",
    "[m for m in (1, 2)]",
    "{m: k}",
    "(m := 3)",
    "f'{m}'",
    "'m'*10",
    '"m"',
    "exec('import os')",
    "eval('1')",
    "open('/etc/passwd').read()",
    "compile('1','','eval')",
    "globals()",
    "getattr(m, 'real')",
    "import os",
    "m; k",
    "m if k else m",
    "m and k",
    "not m",
    "m @ k",
    "m // k",
    "m % k",
    "m << k",
    "~m",
    "m, k",
    "m[0]",
    "*m",
    "m == k",
    "m != k",
    "...",
    "9**9**9",
    "9^9^9^9^9^9",
    "2**100000000000",
    "m**m**m**m**m**m**m**m",
    "exp(exp(exp(exp(100))))",
    "exp(-exp(exp(exp(100))))",
    "sin(exp(300))",
    "tan(1e98)^64",
    "1e999999999",
    "1e-999999999",
    "9" * 199,
    "0." + "0" * 150 + "1",
    "(1.0000001)^64^64^64",
    "((" * 95,
    "(" * 90 + "m" + ")" * 90,
    "-" * 199 + "m",
    "sqrt(" * 30 + "m" + ")" * 30,
    "m^" * 90 + "m",
    "nan",
    "inf",
    "NaN*m",
    "1j",
    "0^0",
    "0^(-1)",
    "(-1)^0.5",
    "log(0)",
    "asin(10)*m",
    "oo",
    "zoo",
    "E",
    "I",
    "S",
    "Symbol('m')",
    "Integer(3)",
    "2*sqrt(m/к)",  # the last letter is Cyrillic
    "２*sqrt(m/k)",  # a full-width digit
    "2*ѕqrt(m/k)",
    "m\u202ek",
    "m\u200bk",
    "٢*sqrt(m/k)",
    "\ud800",
    "m" * 1_000_000,
    "(" * 1_000_000,
    "1+" * 500_000 + "1",
    "<" * 1_000_000,
    "dt < __import__('os')",
    "=",
    "<",
    "dt <",
    "< dt",
    "dt = dt",
    "${m}",
    "$(touch pwned)",
    "`touch pwned`",
    "<script>alert(1)</script>",
    "m\\k",
    "m # k",
    "#",
    "%s%s%s%n",
    "2*sqrt(m/k); import os",
    "pi(pi(pi(pi)))",
    "m(k)(m)(k)",
    "sqrt",
    "sqrt()",
    "sqrt(m, k)",
    "()",
]


@pytest.mark.slow
@pytest.mark.parametrize("text", HOSTILE, ids=range(len(HOSTILE)))
def test_hostile_text_gets_a_message_and_nothing_else(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _check("semi_implicit_limit", "2*m")  # mpmath is loaded before the modules are counted
    modules, threads = set(sys.modules), threading.active_count()
    start = time.process_time()
    result = _check("semi_implicit_limit", text)
    # A bound against hanging, not a speed: these take milliseconds.
    assert time.process_time() - start < 10
    assert not result.correct
    assert 10 < len(result.message) < 500
    assert result.message.encode("utf-8", "strict")
    assert list(tmp_path.iterdir()) == []
    assert set(sys.modules) == modules
    assert threading.active_count() == threads


def test_there_are_enough_hostile_texts():
    assert len(set(HOSTILE)) >= 30


@examples(300)
@given(st.text(alphabet="mk2.()+-*/^<=esqrtxp09 _,[]'\"", max_size=60))
def test_any_text_gets_an_answer(text):
    result = _check("semi_implicit_limit", text)
    assert isinstance(result.correct, bool) and result.message


@examples(100)
@given(st.text(max_size=250))
def test_any_unicode_gets_an_answer(text):
    assert _check("semi_implicit_limit", text).message


@pytest.mark.parametrize("value", [None, 2, b"2*sqrt(m/k)", ["2"]])
def test_what_is_not_text_is_refused(value):
    with pytest.raises(ValueError, match="must be a str"):
        _check("semi_implicit_limit", value)


@pytest.mark.prove
def test_a_slow_proof_is_given_up_and_the_alarm_restored():
    import signal

    before = signal.getsignal(signal.SIGVTALRM)
    text = "2*sqrt(m/k)*" + "*".join(f"(sin({i}*m)^2+cos({i}*m)^2)" for i in range(1, 8))
    start = time.process_time()
    assert _check("semi_implicit_limit", text[:200]).correct
    assert time.process_time() - start < 20
    assert signal.getsignal(signal.SIGVTALRM) is before
    assert signal.getitimer(signal.ITIMER_VIRTUAL) == (0.0, 0.0)


@pytest.mark.prove
def test_a_proof_is_given_up_after_processor_time_not_after_time_that_passes(monkeypatch):
    """Else what a notebook prints would depend on how busy the machine is."""
    import sympy

    simplify = sympy.simplify

    def stalled(expression):
        time.sleep(1.5 * _CONFIRM_SECONDS)
        return simplify(expression)

    monkeypatch.setattr(sympy, "simplify", stalled)
    assert "SymPy proves" in _check("semi_implicit_limit", "2*sqrt(m/k)").message

    def endless(_expression):
        while True:
            pass

    monkeypatch.setattr(sympy, "simplify", endless)
    assert "checked at 45 points" in _check("semi_implicit_limit", "2*sqrt(m/k)").message


def test_it_works_in_a_thread():
    results = []
    thread = threading.Thread(
        target=lambda: results.append(_check("semi_implicit_limit", "2/omega"))
    )
    thread.start()
    thread.join(60)
    assert results[0].correct


def test_how_it_looks_in_a_notebook():
    wrong = _check("semi_implicit_limit", "2*sqrt(k/m)")
    assert repr(wrong).startswith("not right: With m = ")
    assert "stiffer spring" in repr(wrong) and "0x" not in repr(wrong)
    hostile = _check("semi_implicit_limit", "2*`<b>`")
    # What was typed stands in a code span, which it cannot leave, and nowhere else.
    text = hostile._repr_markdown_()
    assert text.count("`") == 4 and "`2*'<b>'`" in text
    assert "<b>" not in re.sub(r"`[^`]*`", "", text)


def test_parse_reads_as_the_field_writes():
    names = frozenset({"m", "g", "h"})
    assert parse("1/2 m", names) == ("*", ("/", ("number", "1"), ("number", "2")), ("name", "m"))
    assert parse("-m^2", names) == ("neg", ("^", ("name", "m"), ("number", "2")))
    assert parse("m^g^h", names) == ("^", ("name", "m"), ("^", ("name", "g"), ("name", "h")))
    with pytest.raises(ValueError, match="text is not a formula"):
        parse("mgh", names)


def test_a_symbol_may_carry_the_name_of_a_function():
    formula = Formula("x", "exp + 1", {"exp": Symbol("a number")})
    assert answer_formula(formula, "1 + exp").correct
    assert not answer_formula(formula, "1 - exp").correct


def test_an_answer_stands_on_a_page_without_its_cell() -> None:
    """The site shows no cell, so the answer repeats the question and the formula, once each."""
    wrong = derivations.answer("semi_implicit_limit", "sqrt(m/k)")
    question = derivations.formula("semi_implicit_limit").question
    text = wrong._repr_markdown_()
    assert text.startswith("Asked: ") and question[:20] in text and "**Not right.**" in text
    assert text.count("Your answer: `sqrt(m/k)`") == text.count("Asked:") == 1
    unread = derivations.answer("semi_implicit_limit", "`<b>`")._repr_markdown_()
    assert unread.count("Asked:") == 1 and "Your answer: `'<b>'`" in unread
    assert "Your answer" not in wrong.verdict() and "Asked:" not in wrong.verdict()
