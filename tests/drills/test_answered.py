"""What is answered on the cards of a notebook is kept, and only where progress is kept."""

import json
from pathlib import Path

import pytest

from course import cards, derivations
from drills import answered, notebook, progress
from drills.progress import Reading


def test_every_card_of_the_course_is_known_by_its_id_and_has_one_right_answer() -> None:
    known = answered._answers()
    for claim in derivations.claims():
        number, name, options = known[f"claim-{claim.id}"]
        assert (number, name) == (claim.chapter, f"{claim.file.partition('.')[0]}.{claim.id}")
        assert sum(right for _, right in options) == 1
    for name, card in cards.predictions("contact").items():
        assert known[f"card-{name}"][2] == tuple((o.label, o.right) for o in card.options)


def test_the_right_answer_is_the_one_that_the_card_calls_right() -> None:
    """Read independently in the card's HTML, in the order of its answers."""
    for id in ("top_condition", "renormalising_repairs", "quaternion_has_no_lock"):
        text = derivations.show(id)._repr_markdown_()
        flags = [part[:3] == "yes" for part in text.split('data-right="')[1:]]
        for place, flag in enumerate(flags):
            reading = Reading()
            answered.note(reading, f"claim-{id}", place)
            assert reading.cards[f"rigid_body.{id}"]["right"] is flag


def test_the_first_answer_counts() -> None:
    reading = Reading()
    assert answered.score(reading) == ""
    answered.note(reading, "claim-renormalising_repairs", 0)
    answered.note(reading, "claim-renormalising_repairs", 1)
    answered.note(reading, "claim-top_condition", 2)
    assert reading.cards == {
        "rigid_body.renormalising_repairs": {"answer": "True", "right": False},
        "rigid_body.top_condition": {"answer": "Only under a condition", "right": True},
    }
    assert answered.score(reading) == "Cards: 1 of 2 answered right at the first try."
    assert answered.given(reading) == {"claim-renormalising_repairs": 0, "claim-top_condition": 2}


@pytest.mark.parametrize(("card", "answer"), [("claim-none", 0), ("claim-top_condition", 3)])
def test_an_unknown_card_or_answer_is_refused(card: str, answer: int) -> None:
    with pytest.raises(ValueError, match="card and answer"):
        answered.note(Reading(), card, answer)


def test_badges_hear_the_page_and_keep_the_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "progress.json"
    monkeypatch.setenv("DRILLS_PROGRESS", str(file))
    badges = notebook.badges(1)
    assert isinstance(badges, notebook.Badges)
    data = badges._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in data and "Cards:" not in data["text/html"]
    listener = answered.Listener(badges._reading, badges._store)
    listener._on_message(listener, {"card": "claim-top_condition", "answer": 0}, [])
    listener._on_message(listener, {"card": "claim-quaternion_has_no_lock", "answer": 0}, [])
    listener._on_message(listener, {"card": "of somebody else", "answer": 0}, [])
    listener._on_message(listener, "nonsense", [])
    assert listener.score == "Cards: 1 of 2 answered right at the first try."
    stored = json.loads(file.read_text())["chapters"]["1"]["cards"]
    assert stored["rigid_body.top_condition"] == {"answer": "True", "right": False}
    assert "1 of 2 answered right" in notebook.badges(1)._repr_mimebundle_()["text/html"]
    assert progress.load(file).reading(1).cards == stored


def test_nothing_is_heard_or_shown_where_no_progress_is_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DRILLS_PROGRESS", "none")
    data = notebook.badges(1)._repr_mimebundle_()
    assert set(data) == {"text/plain", "text/html"} and "Cards:" not in data["text/plain"]


def test_a_damaged_answer_puts_the_file_aside(tmp_path: Path) -> None:
    file = tmp_path / "progress.json"
    wrong = {"rigid_body.x": {"answer": "True", "right": "yes"}}
    content = {"schema": progress.SCHEMA, "exercises": {}, "chapters": {"1": {"cards": wrong}}}
    file.write_text(json.dumps(content))
    loaded = progress.load(file)
    assert loaded.notices and loaded.reading(1).cards == {}
