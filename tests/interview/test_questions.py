"""Every question of an interview: complete, its numbers from claims, nothing typed."""

from __future__ import annotations

import pytest

from course import CHAPTERS, derivations, interview

TOPICS = sorted(path.name for path in interview.FOLDER.iterdir())
ALL = [(topic, question) for topic in TOPICS for question in interview.questions(topic)]
BY_NUMBER = {chapter.number: chapter.topic for chapter in CHAPTERS}

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
def test_a_chapter_has_ten_questions_at_three_levels(topic: str) -> None:
    mine = interview.questions(topic)
    assert len(mine) >= 10
    assert {question.level for question in mine} == {1, 2, 3}
    assert len({question.kind for question in mine}) >= 3


@pytest.mark.parametrize(
    ("topic", "question"),
    [pytest.param(t, q, id=q.name) for t, q in ALL],
)
def test_a_question_is_complete_and_its_figures_are_there(topic, question) -> None:
    assert BY_NUMBER[question.chapter] == topic
    assert len(question.follow_ups) >= 2 and len(question.rubric) >= 3
    # Spoken at 150 words a minute, with time to think.
    assert 40 <= len(question.minute.split()) <= 170
    assert len(question.full.split()) > len(question.minute.split())
    known = {item.id: item for item in derivations.claims()}
    for claim, name in question.fields():
        assert claim in known, claim
        assert name in derivations.run(claim).finding.figures, (claim, name)
    text = question.markdown(derivations.figure)
    assert question.title in text and "{" not in interview._QUIET.sub("", text.replace("\\{", ""))


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
    ("old", "new", "said"),
    [
        ("{limit.value:.1f} ms", "6.3 ms", "6.3 is typed"),
        ("sqrt2", "cdot 1.41", "1.41 is typed"),
        ("Something.", "At 90 percent.", "90 is typed"),
        ("level = 1", "level = 4", "level is 4, allowed is 1, 2 or 3"),
        ('"concept"', '"riddle"', "kind is 'riddle'"),
        ("minutes = 3", "minutes = 0", "minutes is 0"),
        ('["Something."]', "[]", "rubric is"),
        ("## In full", "## At length", "allowed is"),
        ("+++\ntitle", "title", "lines"),
    ],
)
def test_a_faulty_question_is_refused(tmp_path, old: str, new: str, said: str) -> None:
    assert HEAD.count(old) == 1
    with pytest.raises(ValueError, match=said):
        _written(tmp_path, HEAD.replace(old, new))


def test_a_topic_without_questions_is_refused() -> None:
    with pytest.raises(ValueError, match="topic is 'alchemy'"):
        interview.questions("alchemy")
