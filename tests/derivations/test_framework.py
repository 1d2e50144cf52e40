"""The framework notices what is wrong: on small claims of its own, and on mutated real ones."""

import numpy as np
import pytest

from course import derivations
from course.derivations import Ask, Claim, Verdict, claim, records, settle
from course.derivations.answer import Symbol
from course.derivations.honest import constants, typed_numbers

pytestmark = pytest.mark.smoke


SYMBOLS = {"n": Symbol("number of terms"), "m": Symbol("mass [kg]")}
SAID = ("The first n odd numbers add up to n.", "They add up to n^2: {of_three:.0f} for {terms}.")


def total(terms):
    """The sum that the small claims are about."""
    return sum(2 * i + 1 for i in range(terms))


def only(check, received=SAID[0], corrected=SAID[1], **options):
    """The claim of a check, in a registry of its own."""
    registry: dict[str, Claim] = {}
    claim(received, corrected, registry=registry, **options)(check)
    return registry[check.__name__]


def odd_sum(result):
    terms = result.input("terms", 3)
    result.measure("of_three", total(terms))
    result.statement = "Added."
    result.statement_holds(total(terms) == terms)
    result.correction_holds(total(terms) == terms**2)


def _on_record(item):
    """The item, and the entry that a run of it puts on record."""
    return item, item.entry(settle(item, {}).finding)


def _faults(check, *texts, **options):
    return settle(only(check, *texts, **options), {}).faults


def test_a_true_claim_has_no_fault_and_agrees_with_its_record():
    item, record = _on_record(only(odd_sum))
    outcome = settle(item, record)
    assert outcome.agrees, outcome.disagreements
    assert outcome.finding.verdict is Verdict.FALSE
    assert outcome.corrected == "They add up to n^2: 9 for 3.0."
    assert item.id == "odd_sum" and item.chapter == 0


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"verdict": "holds"}, "verdict on record: 'holds'; found: 'false'"),
        ({"texts": "0123456789abcdef"}, "texts on record"),
        ({"formula": "n^2"}, "formula on record"),
        ({"condition": "it rains"}, "condition on record"),
        ({"inputs": {"terms": 4.0}}, "input terms on record: 4.0; found: 3.0"),
        ({"inputs": {}}, "input terms on record: None"),
        ({"inputs": {"terms": 3.0, "m": 1.0}}, "input m on record: 1.0; found: None"),
        ({"figures": {"of_three": [9.001, 1e-6]}}, "of_three is 9.0, on record is 9.001"),
        ({"figures": {"of_three": [0.0, 1e-6]}}, "of_three is 9.0, on record is 0.0"),
        ({"figures": {"of_three": ["nine", 0.0]}}, 'on record is "nine"'),
        ({"figures": {"of_three": [9.0, 0.1]}}, "the tolerance of of_three"),
        ({"figures": {}}, "of_three is computed, not on record"),
        (
            {"figures": {"of_three": [9.0, 1e-6], "typed": [7.0, 0.0]}},
            "typed is on record but not computed",
        ),
    ],
)
def test_a_wrong_record_is_found(change, expected):
    item, record = _on_record(only(odd_sum))
    assert any(expected in text for text in settle(item, record | change).changes)


def test_a_claim_that_is_not_on_record_is_found():
    assert "not on record" in settle(only(odd_sum)).changes[0]


@pytest.mark.parametrize(
    ("texts", "expected"),
    [
        ((SAID[0], "They add up to n^2: 9.5 for three."), "'9.5' in the corrected"),
        ((SAID[0], "They add up to n^2: {of_four:.0f}."), "cannot be filled: KeyError('of_four')"),
        ((SAID[0], "They add up to n^2: {of_three:q}."), "cannot be filled"),
        ((SAID[0], "They add up to n^2: {."), "cannot be filled"),
    ],
)
def test_a_number_in_the_corrected_sentence_comes_from_a_figure(texts, expected):
    (text,) = _faults(odd_sum, *texts)
    assert expected in text


@pytest.mark.parametrize(
    ("text", "typed"),
    [
        ("Below {limit_ms:.2f} ms, which is 2 sqrt(m/k) or u^4/24 with 2 m g h.", []),
        ("RK4 in 2-D with a 2 x 2 matrix, float32, ISO 10218, 1/22 of it, x^12.", []),
        ("It is 6.32 ms.", ["6.32 ms"]),
        ("A gain of .5 and 41 % more.", [".5", "41 %"]),
        ("3 m of rope, 9 degrees, 2 kN/m, 4 percent", ["3 m", "9 degrees", "2 kN/m", "4 percent"]),
        ("After 400 steps, 1,000 draws, 1e-6 and 10^-6.", ["400", "1,000", "1e-6", "10"]),
    ],
)
def test_which_numbers_count_as_typed(text, typed):
    assert typed_numbers(text) == typed


# --- constants --------------------------------------------------------------------------------

SQUARE = (SAID[0], "They add up to n^2.")


def _yes(whatever):
    return True


def _by_another(result):
    result.correction_holds(True)


@pytest.fixture
def written(tmp_path):
    """Writes a small claim with some of its lines changed; returns what is wrong with it."""

    def write(**changes):
        lines = {
            "first": "pass",
            "figure": 'result.measure("of_three", total(3))',
            "heard": "result.statement_holds(total(3) == 3)",
            "corrected": "result.correction_holds(total(3) == 9)",
        } | changes
        body = "".join(f"    {line}\n" for line in lines.values())
        path = tmp_path / "small.py"
        path.write_text(f'def small(result):\n    result.statement = "Added."\n{body}')
        names = dict(globals())
        exec(compile(path.read_text(), path, "exec"), names)
        return settle(only(names["small"], *SQUARE), {})

    return write


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"corrected": "result.correction_holds(True)"}, "a fact is constant, not computed: True"),
        ({"corrected": "result.correction_holds(total(3) == 9, 9 == 9)"}, "not computed: 9 == 9"),
        (
            {"corrected": "result.correction_holds(total(3) == 10 or True)"},
            "total(3) == 10 or True",
        ),
        (
            {"corrected": "result.correction_holds(bool(total(3) == total(3)))"},
            "bool(total(3) == total(3))",
        ),
        (
            {
                "first": "fine = [2 + 2 == 4, bool(np.all(np.array([True])))]",
                "corrected": "result.correction_holds(all(fine))",
            },
            "a fact is constant, not computed: all(fine)",
        ),
        (
            {"first": "sure = lambda: True", "corrected": "result.correction_holds(sure())"},
            "a fact is constant, not computed: sure()",
        ),
        ({"corrected": "result.correction_holds(_yes(2 + 2))"}, "not computed: _yes(2 + 2)"),
        ({"heard": "result.statement_holds(False)"}, "a verdict is constant, not computed: False"),
        ({"figure": 'result.measure("of_three", 9)'}, "a figure is typed, not computed"),
        (
            {
                "heard": "result.statement_holds(total(3) == 3, only_if='n is 1', "
                "inside=[total(1) == 1] * 8, outside=np.zeros(8, bool))"
            },
            "not computed: np.zeros(8, bool)",
        ),
        ({"first": 'result.input("terms", 4)'}, "is not used; what is given must go in"),
        ({"first": "_by_another(result)"}, "result is handed on"),
    ],
)
def test_a_constant_is_refused(change, expected, written):
    (text,) = written(**change).faults
    assert expected in text


def test_the_small_claim_is_sound_before_it_is_changed(written):
    assert written().faults == ()


def computed_everywhere(result):
    """Ways in which honest checks are written."""
    import math

    from course.rigid_body import integrators

    def of(terms):
        return total(terms)

    def odd(terms):
        if total(terms) % 2:
            return True
        return False

    sums = []
    for terms in range(1, 5):
        sums.append(of(terms))
    table = {n: of(n) for n in (1, 2)}
    good = True
    good &= sums[-1] == 16
    first, *others = sums
    result.measure("of_three", (largest := max(table.values())))
    result.statement = "Added."
    result.statement_holds(any(s == n for n, s in enumerate(sums, 2)))
    result.correction_holds(
        good,
        odd(3),
        first == 1,
        others[0] == 4,
        largest == 4,
        math.gcd(sums[0], 2) == 1,
        "rk4" in integrators.INTEGRATORS,
        all(map(bool, sums)),
        np.linalg.norm(sums) > 1,
    )


def test_what_is_computed_is_not_called_constant():
    assert constants(computed_everywhere) == []
    assert not _faults(computed_everywhere, *SQUARE)


# --- conditions -------------------------------------------------------------------------------


def _only_if(text, inside, outside, more="", holds="total(3) == 3"):
    return {
        "heard": f"result.statement_holds({holds}, only_if={text!r}, inside=[{inside}], "
        f"outside=[{outside}]{more})"
    }


def test_a_condition_that_is_right(written):
    inside, outside = (f"total(n) < 81 for n in range({n}, {n + 8})" for n in (1, 9))
    outcome = written(**_only_if("n is smaller than {of_three:.0f}", inside, outside))
    assert outcome.faults == ()
    assert outcome.finding.verdict is Verdict.CONDITIONAL
    assert outcome.condition == "n is smaller than 9"


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (
            _only_if(
                "n is small",
                "total(n) < 81 for n in range(2, 10)",
                "total(n) < 81 for n in range(10, 18)",
            ),
            "the condition is not enough: 1 of 8 draws in it fail",
        ),
        (
            _only_if(
                "n is small",
                "total(n) < 810 for n in range(1, 9)",
                "total(n) < 810 for n in range(9, 17)",
            ),
            "the condition is not needed: all 8 draws outside it hold",
        ),
        (
            _only_if("n is below 1.5", "total(1) == 1", "total(2) == 2", ", cases=True"),
            "'1.5' in the condition is typed",
        ),
        (
            _only_if("n is 1", "total(1) == 1", "total(2) == 2", ", cases=True", "total(3) == 9"),
            "yet the claim holds in general",
        ),
        (_only_if("", "total(1) == 1", "total(2) == 2"), "draws were given without a condition"),
    ],
)
def test_a_false_condition_is_found(change, expected, written):
    (text,) = written(**change).faults
    assert expected in text


def test_a_condition_needs_draws(written):
    first, second = written(**_only_if("n is 1", "total(1) == 1", "total(2) == 2")).faults
    assert first == "1 draws inside the condition; at least 8"
    assert second == "1 draws outside the condition; at least 8"


# --- facts, asks, names -------------------------------------------------------------------------


def empty(result):
    assert result.figures == {}


def test_a_correction_that_does_not_hold_is_found(written):
    (text,) = written(corrected="result.correction_holds(total(3) == 9, total(4) == 15)").faults
    assert "fact 2 of 2 is false" in text


def test_a_check_that_finds_nothing_is_found():
    text = "\n".join(_faults(empty))
    for missing in (
        "result.statement_holds",
        "result.correction_holds",
        "no figure",
        "no statement",
    ):
        assert missing in text


@pytest.mark.parametrize("fact", [1, 0.5, "yes", None, np.array([True, True]), [True]])
def test_a_fact_is_a_bool(fact):
    result = derivations.Result("odd_sum")
    with pytest.raises(ValueError, match="a fact is a bool"):
        result.correction_holds(fact)
    with pytest.raises(ValueError, match="a fact is a bool"):
        result.statement_holds(fact)


def asks(result):
    import sympy

    n, i = sympy.symbols("n i", positive=True, integer=True)
    result.formula = sympy.simplify(sympy.summation(2 * i - 1, (i, 1, n)))
    result.measure("of_three", result.formula.subs(n, 3))
    result.statement = "Summed."
    result.statement_holds(result.formula == n)
    result.correction_holds(result.formula == n**2)


ASK = ("The sum?", "s = n^2", {"n": "That is their number.", "2*n": "No.", "n^3": "No."})


def test_the_formula_asked_for_is_the_one_derived():
    assert not _faults(asks, SAID[0], "They add up to {formula}.", ask=ASK)
    assert settle(only(asks, SAID[0], "To {formula}.", ask=ASK), {}).corrected == "To n^2."
    (text,) = _faults(asks, *SAID[:1], "To {formula}.", ask=(ASK[0], "n^2 + n/1000", ASK[2]))
    assert "derived n**2, asked for is n^2 + n/1000" in text
    assert "both have a formula" in _faults(asks, SAID[0], "To n^2.")[0]


def test_an_ask_reads_its_left_side_and_its_symbols():
    formula = Ask("?", "dt < 2*n", {}, tolerance=0.1, also={"twice": "2*n"}).formula(SYMBOLS)
    assert (formula.left_sides, formula.relation, formula.expression) == (("h", "dt"), "<", "2*n")
    assert set(formula.symbols) == {"n"} and formula.tolerance == 0.1
    assert Ask("?", "phi, angle = m", {}).formula(SYMBOLS).left_sides == ("phi", "angle")
    assert Ask("?", "m", {"n": "?"}).formula(SYMBOLS).left_sides == ()
    with pytest.raises(ValueError, match=r"odd_sum: expression must be .*, got 'dt < 2\*x'"):
        only(odd_sum, ask=("?", "dt < 2*x", {}))


@pytest.mark.parametrize("name", ["of three", "formula", "of_three", "terms"])
def test_a_figure_has_a_name_of_its_own(name):
    result = derivations.Result("odd_sum")
    result.measure("of_three", 9)
    result.input("terms", 3)
    with pytest.raises(ValueError, match=rf"name must be .*, got '{name}'"):
        result.measure(name, 1)


@pytest.mark.parametrize("tolerance", [-1e-6, 0.6, float("nan")])
def test_a_tolerance_leaves_something_to_say(tolerance):
    with pytest.raises(ValueError, match="must be from 0 to"):
        derivations.Result("odd_sum").measure("of_three", 9, tolerance)


def test_a_claim_has_one_verdict():
    result = derivations.Result("odd_sum")
    result.statement_holds(total(3) == 9)
    with pytest.raises(ValueError, match="one verdict"):
        result.statement_holds(total(3) == 9)


def test_draws_are_the_same_at_every_run():
    first, second = (derivations.Result("odd_sum").rng.uniform(size=3) for _ in range(2))
    assert np.array_equal(first, second)
    assert not np.array_equal(first, derivations.Result("another").rng.uniform(size=3))


def test_a_claim_stands_in_the_file_of_a_chapter():
    with pytest.raises(ValueError, match="no chapter's"):
        claim(*SAID)(odd_sum)
    with pytest.raises(ValueError, match="must both have text"):
        only(odd_sum, "", "x")


# --- the record -------------------------------------------------------------------------------


def test_a_record_is_read_as_it_was_written(tmp_path, monkeypatch):
    monkeypatch.setattr(records, "FOLDER", tmp_path)
    long = 'A "long" text with a back\\slash, {a_field:.2f}, which goes on for many words. ' * 3
    entry = {
        "verdict": "false",
        "condition": " ".join(long.split()) + " x^2 \\ 3",
        "texts": "0123456789abcdef",
        "inputs": {"n": 3.0, "method": 'the "sweeping" one'},
        "figures": {
            "a": [1.0, 1e-6],
            "b": [float("inf"), 0.1],
            "c": [2e-300, 0.5],
            "d": ["three", 0.0],
            "e": [0.1234567890123456, 1e-12],
        },
    }
    records.save("odd.sums", {"two": entry, "one": entry})
    assert records.load("odd.sums") == {"one": entry, "two": entry}
    assert list(records.load("odd.sums")) == ["one", "two"]
    assert max(map(len, (tmp_path / "odd.sums.toml").read_text().splitlines())) <= 100
    records.load.cache_clear()


def test_a_figure_that_agrees_keeps_the_digits_on_record():
    _, record = _on_record(only(odd_sum))
    old = record | {"figures": {"of_three": [9.0000001, 1e-6]}}
    assert records.merged(old, record)["figures"] == {"of_three": [9.0000001, 1e-6]}
    old = record | {"figures": {"of_three": [9.1, 1e-6]}}
    assert records.merged(old, record)["figures"] == {"of_three": [9.0, 1e-6]}


def test_a_figure_that_agrees_is_shown_with_the_digits_on_record():
    """So a card reads the same on every CPU, as long as the check agrees with the record there."""
    item, record = _on_record(only(odd_sum, corrected="They add up to n^2: {of_three:.2f}."))
    near = settle(item, record | {"figures": {"of_three": [9.04, 1e-6]}})
    assert near.changes and near.corrected == "They add up to n^2: 9.00."
    assert "of_three = 9\n" in f"{derivations.Block(near)!r}\n"

    def wide(result):
        odd_sum(result)
        result.tolerances["of_three"] = 0.01

    item = only(wide, corrected="They add up to n^2: {of_three:.2f}.")
    record = item.entry(settle(item, {}).finding) | {"figures": {"of_three": [9.04, 0.01]}}
    outcome = settle(item, record)
    assert not outcome.changes and outcome.corrected == "They add up to n^2: 9.04."
    assert "of_three = 9.04\n" in f"{derivations.Block(outcome)!r}\n"
    assert outcome.finding.figures == {"of_three": 9.0}
