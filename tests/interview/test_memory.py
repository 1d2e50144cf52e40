"""The memory of the flashcards against the library that schedules them."""

import textwrap
from datetime import UTC, datetime, timedelta

import fsrs
import numpy as np
import pytest
from fsrs.scheduler import DEFAULT_PARAMETERS
from hypothesis import given
from hypothesis import strategies as st

from course.simulations import interview
from course.simulations import pen as draw
from course.simulations.model import Experiment
from tests.budget import examples

RATINGS = st.sampled_from([interview.AGAIN, interview.HARD, interview.GOOD, interview.EASY])


def test_the_weights_are_those_of_the_library() -> None:
    assert tuple(DEFAULT_PARAMETERS) == interview.WEIGHTS


def unrated() -> Experiment:
    """Return the simulation with cards that were never rated."""
    run = Experiment(interview.MODEL)
    run.state["reviews"][:] = 0
    run.controls["speed"] = 1.0
    return run


def test_the_chapter_opens_with_a_question_and_a_timer() -> None:
    run = Experiment(interview.MODEL)
    assert list(run.state["reviews"]) == [1] * 4 and not run.controls["turned"]
    run.advance(12.0)
    assert run.state["answering"] == pytest.approx(12.0) and run.state["time"] == 0.0
    run.press("ArrowLeft")  # revealed: the timer stops
    run.advance(5.0)
    assert run.state["answering"] == pytest.approx(12.0)
    before = run.state["stability"].copy()
    run.press("+")  # rated: used at once, and the next question has the whole time
    assert run.state["reviews"][0] == 2 and run.state["stability"][0] > before[0]
    assert run.state["since"][0] == 0.0 and run.state["answering"] == 0.0
    assert (run.controls["card"], run.controls["turned"]) == (1, 0)
    run.advance(200.0)
    assert run.state["answering"] == interview.ALLOWED


def test_the_opening_picture_moves_within_a_second() -> None:
    """Something that is drawn changes, not only a number below the picture or at an axis."""

    def drawn(run: Experiment) -> list[tuple[int, bytes]]:
        items = [i for i in draw.decode(run.picture()) if i.kind not in (draw.TEXT, draw.READOUT)]
        return [(item.kind, item.points.tobytes()) for item in items]

    run = Experiment(interview.MODEL)
    before = drawn(run)
    run.advance(1.0)
    assert drawn(run) != before


def test_answers_are_forgotten_as_days_pass() -> None:
    run = Experiment(interview.MODEL)
    run.choose("Days pass")
    chances = [interview.recall(run.state["since"], run.state["stability"])]
    for _ in range(2):
        run.advance(0.5)
        chances.append(interview.recall(run.state["since"], run.state["stability"]))
    assert np.all(np.diff(chances, axis=0) < -1e-3)
    assert chances[0].max() > 0.9 > chances[0].min() > 0.5
    run.choose("Asked when due")
    assert run.state["reviews"].sum() == 0


def test_no_side_of_a_card_is_cut() -> None:
    """Each fits on the lines of the card, with one to spare for Reveal."""
    for text in (*interview._FRONT, interview._BACK_OF_GATE, *interview._INSIGHTS):
        assert len(textwrap.wrap(f"{text} Answer aloud.", interview._WIDE)) < interview._ROWS


@examples(60)
@given(st.lists(st.tuples(RATINGS, st.integers(0, 400)), min_size=1, max_size=12))
def test_a_memory_is_that_of_the_library(turns: list[tuple[int, int]]) -> None:
    scheduler = fsrs.Scheduler(learning_steps=(), relearning_steps=(), enable_fuzzing=False)
    card, now = fsrs.Card(1), datetime(2026, 1, 1, tzinfo=UTC)
    run = unrated()
    for rating, days in turns:
        card, _ = scheduler.review_card(card, fsrs.Rating(rating), now)
        interview.rate(run.state, 2, rating)
        assert run.state["stability"][2] == pytest.approx(card.stability, rel=1e-9)
        assert run.state["difficulty"][2] == pytest.approx(card.difficulty, rel=1e-9)
        assert interview.interval(run.state["stability"][2]) == (card.due - now).days
        run.advance(float(days))
        now += timedelta(days=days)
        known = scheduler.get_card_retrievability(card, now)
        assert interview.recall(days, run.state["stability"][2]) == pytest.approx(known, rel=1e-9)


def test_a_card_is_rated_by_mouse_or_key_only_after_it_was_turned() -> None:
    x, y = interview._AT[0] + 0.1, interview._AT[1] + 0.1  # again
    for rating, act in ((1, lambda e: e.grab(x, y)), (4, lambda e: e.press("+"))):
        run = unrated()
        act(run)
        assert run.state["reviews"].sum() == 0
        run.grab(1.0, 3.0)
        act(run)
        assert list(run.state["reviews"]) == [1, 0, 0, 0]
        assert run.state["stability"][0] == interview.WEIGHTS[rating - 1]
        assert (run.controls["card"], run.controls["turned"]) == (1, 0)


def test_waiting_makes_each_review_worth_more() -> None:
    """What the presets say, after 60 days."""
    ends = {}
    for name in ("Asked when due", "Crammed", "Always forgotten"):
        run = Experiment(interview.MODEL)
        run.choose(name)
        run.advance(12.0)
        ends[name] = (int(run.state["reviews"][0]), float(run.state["stability"][0]))
    (few, spaced), (more, crammed), (all_days, lost) = ends.values()
    assert more == all_days == 60 and few < 8 and spaced / few > 5.0 * crammed / more
    assert lost < 1.0 and run.state["difficulty"][0] > 9.9
