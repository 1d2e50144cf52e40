"""Every question of an interview: complete, its numbers from claims, nothing typed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from course import CHAPTERS, derivations, interview
from course.derivations import records
from course.interview import designs

TOPICS = sorted(path.name for path in interview.FOLDER.iterdir())
ALL = [(topic, question) for topic in TOPICS for question in interview.questions(topic)]
PLACES = {f"{topic}/{question.name}": question for topic, question in ALL}
BY_NUMBER = {chapter.number: chapter.topic for chapter in CHAPTERS}

SOURCES = Path(__file__).parents[2] / "notebooks" / "source"

HEAD = """+++
title = "What is it?"
chapter = 1
kind = "concept"
level = 1
minutes = 3
probes = "Whether one knows."
follow_ups = ["And then?"]
rubric = ["Something."]
+++
## In a minute
It is {limit.value:.1f} ms.

## In full
By RK4 it is $2\\\\sqrt2/\\\\omega$, see `simulate(0.5)`.
"""


@pytest.mark.parametrize("topic", TOPICS)
def test_a_chapter_has_twelve_questions_at_three_levels(topic: str) -> None:
    mine = interview.questions(topic)
    assert len(mine) >= 12
    assert {question.level for question in mine} == {1, 2, 3}
    assert len({question.kind for question in mine}) >= 3


@pytest.mark.slow
@pytest.mark.parametrize(("topic", "question"), [pytest.param(t, q, id=q.name) for t, q in ALL])
def test_a_question_is_complete_and_its_figures_are_there(topic, question) -> None:
    assert BY_NUMBER[question.chapter] == topic
    assert len(question.follow_ups) >= 2 and len(question.rubric) >= 3
    # Spoken at 150 words a minute, with time to think.
    assert 40 <= len(question.minute.split()) <= 170
    assert len(question.full.split()) > len(question.minute.split())
    # On record: that a check still gives these figures is for the tests of the claims.
    known = {"chart", "estimate", *(item.id for item in derivations.claims())}
    assert {claim for claim, _ in question.fields()} <= known
    text = question.markdown(records.figure)
    assert question.title in text and "{" not in interview._QUIET.sub("", text.replace("\\{", ""))
    assert "| |-" not in text, "a table was wrapped like a paragraph: one row, one line"


# What an answer says that leans on the limits of a standard.
LEANS = re.compile(r"permitted forces?\b|body region|part of the body|performance level")
NUMBER = re.compile(r"\b(?:ISO(?:/TS)?|IEC) \d+(?:-\d+)*(:\d{4})?")


def test_limits_for_safety_are_those_of_standards_with_their_editions() -> None:
    answers = {place: f"{one.minute}\n{one.full}" for place, one in PLACES.items()}
    answers |= {f"design/{name}": designs.read(name).answer for name in designs.NAMES}
    leaning = {place: text for place, text in answers.items() if LEANS.search(text)}
    assert {"control/hurting_people", "design/among_people"} <= leaning.keys()
    for place, text in answers.items():
        numbers = list(NUMBER.finditer(" ".join(text.split())))
        assert all(number[1] for number in numbers), place
        assert numbers or place not in leaning, place


def test_what_ours_did_was_measured_in_a_course() -> None:
    """A candidate says where a figure comes from, and has no project of this name."""
    for place, one in PLACES.items():
        text = " ".join(f"{one.minute} {one.full}".split())
        if re.search(r"\bours (ran|reached|had|took|needed|was|were|made|stayed)\b", text):
            assert re.search(r"\b[Ii]n a course\b", text), place


# The twelve questions that everybody hears, one a chapter, and the drills and scenarios.
ASKED = {
    "F142": "role/bin_picking",
    "F143": "rigid_body/joints_creep",
    "F144": "contact/wine_glass",
    "F145": "platforms/hand_and_transfer",
    "F146": "kinematics/elbow_near_obstacle",
    "F147": "planning/shelf_in_a_tenth",
    "F148": "control/undershoots",
    "F149": "perception/small_and_large",
    "F150": "sim_to_real/ninety_five_and_twenty",
    "F151": "learning/folding_two_ways",
    "F152": "middleware/graph_of_rates",
    "F153": "pipeline/works_nine_of_ten",
    "F251": "interview/three_link_chain",
    "F252": "interview/tree_in_the_plane",
    "F253": "interview/pid_that_lets_go",
    "F254": "interview/randomise_a_model",
    "F255": "interview/explodes_after_a_while",
    "F256": "interview/right_only_in_simulation",
    "F257": "interview/swings_at_touch",
    "F258": "interview/no_way_through",
}


def test_every_row_of_the_list_has_its_question() -> None:
    assert PLACES.keys() >= set(ASKED.values())
    assert [BY_NUMBER[n] for n in range(12)] == [
        place.split("/")[0] for place in list(ASKED.values())[:12]
    ]
    kinds = [PLACES[place].kind for place in list(ASKED.values())[12:]]
    assert kinds == ["coding"] * 4 + ["debugging"] * 4


def test_the_last_question_of_all_is_the_whole_way() -> None:
    assert interview.questions("interview")[-1].name == "six_months"


@pytest.mark.parametrize("number", range(12))
def test_every_chapter_has_its_tip(number: int) -> None:
    # F154 to F165, in the order of the chapters.
    source = SOURCES / f"{number:02d}_{BY_NUMBER[number]}.py"
    assert source.read_text(encoding="utf-8").count("# **Interview tip.** ") == 1


def _written(tmp_path, text: str) -> interview.Question:
    path = tmp_path / "one.md"
    path.write_text(text, encoding="utf-8")
    return interview.read(path)


def test_a_field_is_filled_with_a_figure(tmp_path) -> None:
    question = _written(tmp_path, HEAD)
    text = question.markdown(lambda claim, name: {("limit", "value"): 6.3246}[claim, name])
    assert "It is 6.3 ms." in text
    assert question.fields() == [("limit", "value")]


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (
            "{limit.value:.1f} ms",
            "6.3 ms",
            r"one.md, line 12: 6.3 must be .*, got a number that is typed",
        ),
        (
            "{limit.value:.1f} ms",
            "{limit} ms",
            r"line 12: \{limit\} must be .*, got a field that nothing fills",
        ),
        ("{limit.value:.1f} ms", "{limit.value ms", r"line 12: \{limit.value ms"),
        ("chapter = 1", "chapter = 77", "line 3: chapter must be from 0 to 12, got 77"),
        (
            'rubric = ["Something."]\n',
            "",
            "line 1: the head must have title, chapter.*; rubric is missing",
        ),
        ("probes =", "colour =", "line 7: the head must have title, chapter.*; colour is unknown"),
        ('["And then?"]', '["no_such"]', r"line 8: a follow-up must be a question.*, got no_such"),
        (
            '["Something."]',
            '[{ line = "Something.", follow_up = "chapter" }]',
            r"one.md, line 9: a follow-up must be a key of \[follow_ups\] \(none.*\), got chapter",
        ),
        ('["Something."]', '[{ line = "Something." }]', "line 9: rubric must be texts, or a line"),
        ("level = 1", "level = ", r"line 5: Invalid value \(at line 4"),
        ("sqrt2", "cdot 1.41", r"1.41 must be .*typed"),
        ("Something.", "At 90 percent.", r"90 must be .*typed"),
        ("level = 1", "level = 4", r"level must be 1, 2 or 3.*, got 4"),
        ('"concept"', '"riddle"', r"kind must be .*, got 'riddle'"),
        ("minutes = 3", "minutes = 0", r"minutes must be .*, got 0"),
        ('["Something."]', "[]", "rubric must be"),
        ("## In full", "## At length", r"line 14: parts must be In a m.*; At length is unknown"),
        ("+++\ntitle", "title", "line 9: [+]{3} must be two lines"),
    ],
)
def test_a_faulty_question_is_refused(tmp_path, old: str, new: str, text: str) -> None:
    assert HEAD.count(old) == 1
    with pytest.raises(ValueError, match=text):
        _written(tmp_path, HEAD.replace(old, new))


def test_a_follow_up_may_be_another_question(tmp_path) -> None:
    question = _written(tmp_path, HEAD.replace("And then?", "three_terms"))
    assert question.follow_ups == (PLACES["control/three_terms"].title,)


KEYED = HEAD.replace('follow_ups = ["And then?"]\n', "").replace(
    'rubric = ["Something."]\n',
    """rubric = ["Something.", { line = "The price.", follow_up = "price" }, "More."]

[follow_ups]
price = "What does it cost?"
other = "three_terms"
""",
)


def test_a_line_of_the_rubric_may_name_its_follow_up(tmp_path) -> None:
    question = _written(tmp_path, KEYED)
    title = PLACES["control/three_terms"].title
    assert question.rubric == ("Something.", "The price.", "More.")
    assert question.follow_ups == ("What does it cost?", title)
    assert question.triggers == {"The price.": "What does it cost?"}
    assert _written(tmp_path, HEAD).triggers == {}
    text = question.markdown(lambda claim, name: 1.0)
    assert "\n* Something.\n* The price. *Follow-up: What does it cost?*\n* More.\n" in text
    assert f"\n* What does it cost?\n* {title}\n" in text
    other = KEYED.replace('follow_up = "price"', 'follow_up = "other"')
    assert _written(tmp_path, other).triggers == {"The price.": title}


def test_a_line_that_names_no_follow_up_of_the_question_is_refused(tmp_path) -> None:
    expected = (
        r"one.md, line 8: a follow-up must be a key of \[follow_ups\] \(price, other\), got prise"
    )
    with pytest.raises(ValueError, match=expected):
        _written(tmp_path, KEYED.replace('follow_up = "price"', 'follow_up = "prise"'))
    expected = r"one.md, line 12: a follow-up must be a question or the name of one, got no_such"
    with pytest.raises(ValueError, match=expected):
        _written(tmp_path, KEYED.replace('"three_terms"', '"no_such"'))


def test_a_topic_without_questions_is_refused() -> None:
    with pytest.raises(ValueError, match=r"topic must be .*, got 'alchemy'"):
        interview.questions("alchemy")
