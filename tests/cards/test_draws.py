"""The checkpoint: what is drawn by which seed, and how answers of each kind are graded."""

import math
from typing import Any, cast

import pytest

from course import CHAPTERS, cards, derivations
from course.cards import draws
from course.derivations import records
from course.derivations.answer import evaluate
from tools import form

TOPICS = [chapter.topic for chapter in CHAPTERS]
ESTIMATES = [one for topic in TOPICS for one in draws.estimates(topic)]
VERDICTS = {"holds": "true", "false": "false", "holds only if": "only if"}


def right_answer(question: draws.Question) -> str:
    """Return an answer that is right by the record of claims."""
    match question:
        case draws.Formula():
            return derivations.formula(question.claim).expression
        case draws.Estimate():
            claim, _, name = question.figure.partition(".")
            return repr(records.figure(claim, name))
    (file,) = [item.file for item in derivations.claims() if item.id == question.claim]
    return VERDICTS[records.load(file)[question.claim]["verdict"]]


# --- What is drawn --------------------------------------------------------------------------------


@pytest.mark.parametrize("topic", TOPICS)
def test_each_draw_mixes_its_kinds_and_no_claim_comes_twice(topic: str) -> None:
    drawn = [draws.draw(topic, seed) for seed in range(1, 201)]
    hidden = set(cards.gate(topic))
    for questions in drawn:
        first, number, second, *claims = questions
        assert isinstance(first, draws.Formula) and first.claim in hidden
        assert isinstance(number, draws.Estimate) and isinstance(second, draws.Formula)
        one, two = cast(list[draws.Verdict], claims)
        assert isinstance(one, draws.Verdict) and isinstance(two, draws.Verdict)
        assert one.verdict != two.verdict, "whoever always says the same is right once at most"
        assert len({question.claim for question in questions}) == 5
    # Two draws of the same seed agree, and hardly any two seeds draw the same.
    assert draws.draw(topic, 3) == drawn[2]
    assert len({tuple(q.key for q in questions) for questions in drawn}) > 150
    # No corner of the pool is out of reach: most of it came in two hundred draws.
    keys = {question.key for questions in drawn for question in questions}
    whole = {question.key for question in draws.pool(topic)}
    assert keys <= whole and len(keys) > 0.9 * len(whole)


@pytest.mark.parametrize("topic", TOPICS)
def test_the_pool_is_several_times_as_large_as_a_draw(topic: str) -> None:
    keys = [question.key for question in draws.pool(topic)]
    assert len(set(keys)) == len(keys) >= 20
    assert all(key.isascii() for key in keys), "page.js hashes letters, Python bytes"


def test_ranks_are_spread_evenly() -> None:
    """A chi-squared test with 15 degrees of freedom, of ranks in 16 equal ranges."""
    for of in (lambda k: draws.rank(k, "claim.same"), lambda k: draws.rank(1, f"claim.{k}")):
        counts = [0] * 16
        for k in range(4000):
            counts[of(k) >> 28] += 1
        assert sum((n - 250) ** 2 / 250 for n in counts) < 45  # exceeded once in 10,000


def test_a_new_question_changes_only_the_draws_that_it_is_in(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before = [draws.draw("contact", seed) for seed in range(1, 101)]
    whole = draws.pool("contact")
    example = draws.estimates("contact")[0]
    added = draws.Estimate("added", "How many?", example.figure, "", 1.5, "1")
    monkeypatch.setattr(draws, "pool", lambda topic: (added, *whole))
    after = [draws.draw("contact", seed) for seed in range(1, 101)]
    changed = [k for k, (old, new) in enumerate(zip(before, after, strict=True)) if old != new]
    assert all(added in after[k] for k in changed) and 5 < len(changed) < 40


# --- How answers are graded -----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("topic", TOPICS)
def test_a_checkpoint_is_passed_when_all_five_are_right(topic: str) -> None:
    for seed in (1, 2):
        questions = draws.draw(topic, seed)
        right = [right_answer(question) for question in questions]
        assert cards.checkpoint(topic, right, seed).passed
        for k in range(len(right)):
            missing = cards.checkpoint(topic, [*right[:k], "", *right[k + 1 :]], seed)
            assert not missing.passed and "4 of 5 right, checkpoint open" in repr(missing)


@pytest.mark.slow
@pytest.mark.parametrize("topic", TOPICS)
def test_every_question_of_the_pool_accepts_its_answer_and_no_other(topic: str) -> None:
    for question in draws.pool(topic):
        assert question.grade(right_answer(question)).right, question.key
        match question:
            case draws.Formula():
                wrong = list(derivations.formula(question.claim).slips)[:1]
            case draws.Verdict():
                wrong = [text for text in VERDICTS.values() if text != right_answer(question)]
            case draws.Estimate():
                value, factor = question.value(), question.factor
                wrong = [repr(1.01 * factor * value), repr(value / factor / 1.01), repr(-value)]
                assert question.grade(repr(0.99 * factor * value)).right
                assert question.grade(repr(value / factor / 0.99)).right
        assert not any(question.grade(text).right for text in wrong), question.key


@pytest.mark.parametrize("topic", TOPICS)
def test_an_open_checkpoint_gives_nothing_away(topic: str) -> None:
    for seed in (1, 2, 3):
        blank = cards.checkpoint(topic, seed=seed)
        assert "0 of 5 right" in repr(blank) and not blank.passed
        for question in draws.draw(topic, seed):
            if isinstance(question, draws.Formula):
                assert derivations.formula(question.claim).expression not in blank.markdown
            assert question.claim not in repr(blank), "the names of some claims give them away"


@pytest.mark.parametrize("one", ESTIMATES, ids=lambda one: one.name)
def test_an_estimate_can_be_made_from_what_is_asked(one: draws.Estimate) -> None:
    """The figure was measured or simulated by a claim; the rule is arithmetic by hand."""
    by_hand = evaluate(one.rule_text())
    assert abs(math.log(by_hand / one.value())) < 0.5 * math.log(one.factor)
    assert "{" not in one.ask() and not cards.draws.typed_numbers(one.question)


def test_what_may_be_typed() -> None:
    (one,) = [one for one in ESTIMATES if one.name == "soft_spring_step"]  # 200 ms
    for text in ("200", "200 ms", "2e2", "1000*2*sqrt(1/100)", "180ms", "230.0"):
        assert one.grade(text).right, text
    for text in ("0", "-200", "245", "160 ms"):
        assert one.grade(text).text.startswith("Not right."), text
    for text in ("200 s", "about 200", "1,000", "nan", "1/0", "log(0)", "sqrt(-1)", "ms"):
        assert one.grade(text).text.startswith("Not graded"), text
    claim = draws.Verdict("semi_implicit_free_fall", "holds only if")
    for text in ("only if", "Only", "o", "only under a condition", "true only if"):
        assert claim.grade(text).right, text
    for text in ("true", "T", "false", "f"):
        assert claim.grade(text).text.startswith("Not right."), text
    assert claim.grade("perhaps").text.startswith("Not graded")


def test_three_formulas_by_name_still_count() -> None:
    """A notebook that a learner has worked in names the formulas of the chapter's file."""
    right: dict[str, Any] = {
        name: derivations.formula(name).expression for name in cards.gate("rigid_body")
    }
    assert cards.checkpoint("rigid_body", **right).passed
    for name in right:
        open_ = cards.checkpoint("rigid_body", **(right | {name: "omega"}))
        assert "2 of 3 right, checkpoint open" in repr(open_)
        assert "not right" in repr(open_) and "**Not right.**" in open_.markdown
        number: dict[str, Any] = {name: 3}
        with pytest.raises(ValueError, match=f"{name} must be a formula as text, got 3"):
            cards.checkpoint("rigid_body", **number)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"topic": "nothing"}, "topic"),
        ({"seed": 0}, "seed"),
        ({"seed": True}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"answers": ["", ""]}, "5 texts"),
        ({"answers": "no list"}, "a list of texts"),
        ({"answers": ["", "", "", "", 3]}, "a list of texts"),
        ({"answers": [""] * 5, "mujoco_creeps": ""}, "formulas"),
        ({"no_such_formula": "1"}, "no_such_formula"),
    ],
)
def test_bad_input_is_named(arguments: dict[str, Any], named: str) -> None:
    given: dict[str, Any] = {"topic": "contact", **arguments}
    with pytest.raises(ValueError, match=named):
        cards.checkpoint(**given)


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"question": "It is long."}, "ask"),
        ({"question": "How long are 3 m?"}, "ask"),
        ({"factor": 1.0}, "factor"),
        ({"factor": 10.0}, "factor"),
    ],
)
def test_an_estimate_that_is_not_whole_is_refused(changed: dict[str, Any], named: str) -> None:
    good: dict[str, Any] = {
        "name": "one",
        "question": "How long?",
        "figure": "a.b",
        "unit": "m",
        "factor": 2.0,
    }
    draws.Estimate(**good, rule="1")
    wrong: dict[str, Any] = {**good, "rule": "1", **changed}
    with pytest.raises(ValueError, match=f"one: {named}"):
        draws.Estimate(**wrong)


# --- The pool of the site -------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("topic", TOPICS)
def test_without_a_script_the_site_shows_the_first_draw(topic: str) -> None:
    made = draws.offered(topic)
    heads = [line for line in made.splitlines() if 'class="checkpoint-question"' in line]
    assert len(heads) == len(draws.pool(topic))
    visible = [line for line in heads if not line.endswith(" hidden>")]
    for question in draws.draw(topic, 1):
        assert sum(f'data-key="{question.key}"' in line for line in visible) == 1
    assert len(visible) == 5
    for block in made.split('<div class="checkpoint-question"')[1:]:
        right = block.count('data-right="yes"')
        assert right == (0 if 'data-part="estimate"' in block else 1)
    assert form.unfilled(made) == []
