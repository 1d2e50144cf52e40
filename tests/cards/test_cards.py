"""Cards: nothing is told before it is asked, and formulas are set as mathematics."""

import re
import tomllib

import pytest

from course import cards, derivations
from course.derivations.typeset import tex
from tools import form

TOPICS = sorted(path.stem for path in cards.FOLDER.glob("*.toml"))


def open_text(markdown: str) -> str:
    """Return what is seen before anything is unfolded."""
    innermost = re.compile(r"<details\b(?:(?!<details\b).)*?</details>", re.S)
    while innermost.search(markdown):
        markdown = innermost.sub("", markdown)
    return markdown


@pytest.mark.parametrize(
    ("text", "set_"),
    [
        ("stable while omega dt < 2.", r"stable while $\omega h \lt 2$."),
        ("rate omega sqrt((I2 - I1) / I3), and", r"rate $\omega \sqrt{(I_2 - I_1) / I_3}$, and"),
        ("short by (omega h)^3 / 12 to", r"short by $(\omega h)^{3} / 12$ to"),
        ("the term omega x (I omega).", r"the term $\omega \times (I \omega )$."),
        ("the term m (c x a_P)", r"the term $m (c \times a_{P})$"),
        ("the term Omega x L", r"the term $\Omega \times L$"),
        ("v^2/2 - omega^2 h x v/2 is", r"$v^{2}/2 - \omega ^{2} h x v/2$ is"),
        ("it adds m*g^2*h^2/2 a step", r"it adds $m\, g^{2}\, h^{2}/2$ a step"),
        ("R^-1 L", "$R^{-1} L$"),
        ("torque J q_d'' of", r"torque $J q_{d}''$ of"),
        ("turns by 2 atan(omega h / 2) per", r"turns by $2 \arctan(\omega h / 2)$ per"),
        ("1 / cos(pitch): 573", r"$1 / \cos(\text{pitch})$: 573"),
        ("a 1 kg ball, 5 m up, I think, at 3 rad/s", None),
        ("forces of 2 N m and 100 kN/m do it", None),
        ("in a grasp of 3 N 768 times", None),
        ("`a_name` of e - f", r"`a_name` of $e - f$"),
        ("a 7-R arm, N dq2 beside", r"a 7-R arm, $N dq_2$ beside"),
        ("6*eps - eps^2 of every eps", r"$6\, \epsilon - \epsilon ^{2}$ of every eps"),
        ("gamma^2*lam*d1, eps T", r"$\gamma ^{2}\, \lambda \, d_1$, eps $T$"),
        ("5 $ and 2 < 3", r"5 \$ and 2 \< 3"),
    ],
)
def test_formulas_are_found_and_units_left_alone(text, set_):
    assert tex(text) == (text if set_ is None else set_)


def test_a_chapter_calls_its_step_by_one_name():
    assert tex("kp < 2 J/dt", "control") == r"kp $\lt 2 J/dt$"
    assert tex("kp < 2 J/dt", "rigid_body") == tex("kp < 2 J/dt") == r"kp $\lt 2 J/h$"


def test_every_corrected_statement_can_be_set():
    for item in derivations.claims():
        result = tex(item.corrected)
        bare = re.sub(r"\\\$", "", result)
        assert bare.count("$") % 2 == 0, item.id
        for formula in re.findall(r"\$([^$]+)\$", bare):
            for left, right in ("()", "{}"):
                assert formula.count(left) == formula.count(right), (item.id, formula)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("id", "right"),
    [
        ("renormalising_repairs", "False"),
        ("top_condition", "Only under a condition"),
        ("quaternion_has_no_lock", "True"),
    ],
)
def test_a_claim_is_asked_before_it_is_settled(id, right):
    block = derivations.show(id)
    outcome = block.outcome
    text = block._repr_markdown_()
    observed = open_text(text)
    assert "**Common claim:**" in observed and outcome.claim.claim[:10] in observed
    for hidden in (outcome.corrected[:20], outcome.finding.statement[:20], "Right."):
        assert hidden in text and hidden not in observed
    answers = re.findall(
        r'<details class="answer" data-answer="(.*?)" data-right="(yes|no)"><summary>\1</summary>'
        r"\n\n\*\*(Right|No)\.\*\*\n\n</details>",
        text,
    )
    assert [answer[0] for answer in answers] == ["True", "False", "Only under a condition"]
    assert [label for label, flag, word in answers if (flag, word) == ("yes", "Right")] == [right]
    assert sum(flag == "no" and word == "No" for _, flag, word in answers) == 2
    for once in (outcome.corrected[:20], block.verdict[:10], "How it was settled"):
        assert text.count(once) == 1
    assert f'<div class="card" id="claim-{id}" data-card="rigid_body.{id}"' in text


def test_a_fold_out_holds_compact_cards_and_costs_no_check(monkeypatch):
    monkeypatch.setattr(derivations, "run", lambda id: pytest.fail(f"{id} was run"))
    ids = ("top_condition", "renormalising_repairs")
    shown = derivations.more_claims(*ids)
    assert repr(shown) == "More claims about this:\n  top_condition\n  renormalising_repairs"
    text = shown.markdown
    assert text.startswith('<details class="more-claims"><summary>More claims about this</summary>')
    assert text.endswith("</details>") and text.count("<details") == text.count("</details>")
    cards_ = text.split('<div class="card"')[1:]
    assert len(cards_) == 2
    for id, card in zip(ids, cards_, strict=True):
        block = derivations.Block(derivations.recorded(id, derivations.CLAIMS[id].file))
        first = card.split("<details")[0]
        assert f'id="claim-{id}" data-card="rigid_body.{id}"' in first
        assert derivations.CLAIMS[id].claim[:12] in first and "It is" not in first
        assert cards.tex(block.verdict) in card and "How it was settled" in card
        assert f"--id {id}" in card and 'class="answer"' not in card


def test_a_fold_out_needs_claims_each_once():
    for ids in ((), ("top_condition", "top_condition"), ("no_such_claim",)):
        with pytest.raises(ValueError, match="id"):
            derivations.more_claims(*ids)


def test_claims_that_no_notebook_shows_are_listed(tmp_path):
    (tmp_path / "01_x.py").write_text(
        '# %%\nshow("top_condition")\n# %%\nmore_claims(\n    "wobble_comes_from_the_term",\n'
        '    "renormalising_repairs",\n)\n# %%\nanswer("semi_implicit_limit", "2*(1/omega)")\n'
        '# show("quaternion_has_no_lock")\n'
    )
    placed = ["top_condition", "wobble_comes_from_the_term", "renormalising_repairs"]
    assert cards.placed_in((tmp_path / "01_x.py").read_text()) == [
        *placed,
        "semi_implicit_limit",
    ]
    missing = cards.unplaced("rigid_body", tmp_path)
    everything = [item.id for item in derivations.claims(1)]
    claims = {*placed, "semi_implicit_limit", *cards.gate("rigid_body")}
    assert missing == [id for id in everything if id not in claims]
    assert "quaternion_has_no_lock" in missing
    with pytest.raises(ValueError, match="topic must be one of"):
        cards.unplaced("cooking")
    with pytest.raises(ValueError, match="sources"):
        cards.unplaced("rigid_body", tmp_path / "none")


@pytest.mark.slow
def test_a_claim_is_short_as_text():
    for id in ("renormalising_repairs", "rk4_costs_four_times", "gyroscopic_term_holds_the_top_up"):
        lines = repr(derivations.show(id)).splitlines()
        verdict = next(n for n, line in enumerate(lines) if line.startswith("Verdict: "))
        assert len(lines) - verdict <= 4
        assert max(map(len, lines)) <= 96


@pytest.mark.slow
def test_a_disagreement_is_not_folded(monkeypatch):
    outcome = derivations.run("top_condition")
    worse = type(outcome)(outcome.claim, outcome.finding, ("it fell",), ())
    block = derivations.Block(worse)
    assert "DISAGREES: it fell" in open_text(block._repr_markdown_())
    assert "DISAGREES: it fell" in repr(block)


@pytest.mark.parametrize("topic", TOPICS)
def test_the_file_of_a_chapter_is_whole(topic):
    assert len(cards.vocabulary(topic)) == len(set(map(str.lower, cards.vocabulary(topic))))
    # Another word is none of the chapter's own terms, and leads to one of them.
    names = set(map(str.lower, cards.vocabulary(topic)))
    assert not names & {word.lower() for word in cards.synonyms(topic)}
    assert {term.lower() for term in cards.synonyms(topic).values()} <= names
    answerable = {item.id for item in derivations.claims() if item.formula}
    assert len(cards.gate(topic)) >= 3 and set(cards.gate(topic)) <= answerable
    labels = []
    for name in cards.predictions(topic):
        shown = cards.predict(name)
        observed = open_text(shown.markdown)
        assert "Right." in shown.markdown and "Right." not in observed and "{" not in observed
        for option in cards.predictions(topic)[name].options:
            assert option.why[:15] not in observed
        rights = [o.right for o in cards.predictions(topic)[name].options]
        labels.append(rights.index(True))
    assert len(set(labels)) > 1, "the right answer always stands at the same place"


# Chapters whose questions are being rewritten; empty when they have landed.
AWAITED: set[str] = set()


@pytest.mark.parametrize("topic", TOPICS)
def test_the_shape_of_the_answers_does_not_give_the_right_one_away(topic):
    """Neither a length that is its own, nor a figure or a formula that only it has."""
    if topic in AWAITED:
        return
    longest = shortest = 0
    claims = cards.predictions(topic)
    for name, question in claims.items():
        labels = {option.label for option in question.options}
        (right,) = (option.label for option in question.options if option.right)
        wrong = labels - {right}
        lengths = [len(label) for label in wrong]
        assert 0.6 * min(lengths) <= len(right) <= 1.5 * max(lengths), (name, right)
        for mark in (r"[$`*_]", r"[0-9{]"):
            bare = {re.sub(r"\$.*?\$", "$", label) for label in wrong}
            if re.search(mark, re.sub(r"\$.*?\$", "$", right)):
                assert any(re.search(mark, label) for label in bare), (name, right)
        longest += len(right) > max(lengths)
        shortest += len(right) < min(lengths)
    assert max(longest, shortest) <= 0.67 * len(claims), (longest, shortest, len(claims))


def test_a_claim_s_answers_differ_in_nothing_but_one_word():
    text = derivations.show("top_condition")._repr_markdown_()
    bodies = re.findall(r'<details class="answer"[^>]*><summary>.*?</summary>\n\n(.*?)\n\n</', text)
    assert sorted(bodies) == ["**No.**", "**No.**", "**Right.**"]


def test_a_question_and_a_claim_have_different_names():
    """So that a page can remember a card by its name."""
    claims = {name for topic in TOPICS for name in cards.predictions(topic)}
    assert len(claims) == sum(len(cards.predictions(topic)) for topic in TOPICS)
    assert not claims & {claim.id for claim in derivations.claims()}


@pytest.mark.slow
@pytest.mark.parametrize("topic", TOPICS)
def test_no_card_shows_an_unfilled_field(topic):
    shown = [cards.predict(name) for name in cards.predictions(topic)]
    shown += [cards.interview(topic), cards.checkpoint(topic)]
    texts = [card.markdown for card in shown] + [repr(card) for card in shown]
    for claim in derivations.claims():
        if claim.file.partition(".")[0] == topic:
            texts.append(derivations.more_claims(claim.id).markdown)
    assert [form.unfilled(text) for text in texts if form.unfilled(text)] == []


def test_fields_are_filled_wherever_a_question_has_them(monkeypatch):
    slope = "{beyond_the_clip.slope:.0f}"
    options = (cards.Option(f"by {slope}", True, f"{slope}"), cards.Option("not", False, "no"))
    requested = {"one": cards.Prediction("one", f"Is it {slope}?", options)}
    monkeypatch.setattr(cards, "predictions", lambda topic: requested)
    shown = cards.predict("one")
    assert repr(shown) == "Predict: one\n  by -1\n  not"
    for text in ("Is it -1?", 'data-answer="by -1"', "<summary>by -1</summary>", "**Right.** -1"):
        assert text in shown.markdown


@pytest.mark.parametrize(
    ("entry", "named"),
    [
        ('ask = "It moves."\noptions = [["a", true, "b"], ["c", false, "d"]]', "ask"),
        ('ask = "Which?"\noptions = [["a", true, "b"]]', "options"),
        ('ask = "Which?"\noptions = [["a", true, "b"], ["c", true, "d"]]', "options"),
        ('ask = "Which?"\noptions = [["a < b", true, "b"], ["c", false, "d"]]', "label"),
        ('ask = "Which?"\noptions = [["a", true, "by 3.1 m"], ["c", false, "d"]]', "why"),
    ],
)
def test_a_question_that_is_not_whole_is_refused(entry, named):
    options = tomllib.loads(entry)
    with pytest.raises(ValueError, match=named):
        cards.Prediction(
            "one", options["ask"], tuple(cards.Option(*option) for option in options["options"])
        )


def test_bad_names_are_refused():
    for call, named in (
        (lambda: cards.predict("nothing"), "nothing"),
        (lambda: cards.vocabulary("nothing"), "nothing"),
        (lambda: cards.figures("a 1\nb 2", "c"), "'c'"),
        (lambda: cards.checkpoint("rigid_body", nothing="1"), "nothing"),
        (lambda: derivations.records.figure("nothing", "x"), "nothing"),
        (lambda: derivations.records.figure("top_condition", "x"), "critical_rad_per_s"),
    ):
        with pytest.raises(ValueError, match=named):
            call()


def test_a_table_is_as_narrow_as_its_figures_and_shows_its_head_once():
    head = "who          one   two\n"
    table = f"{head}row 1        1.5   2.5\n{head}row 2        3.5   4.5"
    shown = repr(cards.figures(table, "who", "row 2"))
    assert shown == "who    one  two\nrow 2  3.5  4.5"


def test_figures_show_the_rows_that_matter():
    table = "head 0\nrow one 1\nrow two 2\nrow three 3"
    shown = cards.figures(table, "head", "row two")
    assert repr(shown) == "head 0\nrow two 2"
    assert "row three" in shown.markdown and "row three" not in open_text(shown.markdown)
    assert "row two 2" in open_text(shown.markdown)


def test_the_interview_has_every_question_by_level():
    shown = cards.interview("rigid_body")
    text = shown.markdown
    assert text.index("#### Screen") < text.index("#### Senior") < text.index("#### Staff")
    assert text.count("In a minute") == len(repr(shown).splitlines()) >= 10
    assert not re.search(r"\{\w+\.\w+", text)


def test_a_column_can_be_left_to_the_whole_table():
    shown = cards.figures("name  one  two\nrow   111  222", "name", "row", cut="two")
    assert repr(shown) == "name  one\nrow   111" and "222" in shown.markdown
    with pytest.raises(ValueError, match="three"):
        cards.figures("name  one  two", "name", cut="three")
