"""The rehearsed interview: what is drawn, what is asked next, what is kept and reported."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import time
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.derivations.records import figure
from course.interview import designs, rehearsal, scenarios
from course.interview.rehearsal import MARKS, PARTS, WEIGHT, Item
from drills import cards
from drills.interview import deck, rehearse, store
from drills.interview.rehearse import Talk
from drills.session import Session
from drills.terminal import Terminal
from tests.budget import examples
from tests.drills.place import Place, a_place, in_terminal

__all__ = ["a_place"]
BEGAN = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)
CHOSEN = frozenset({1, 4})
MINUTES = 33


def item(name: str, part: str = "concept", minutes: int = 5, **more: Any) -> Item:
    texts: dict[str, Any] = {"rubric": ("a", "b"), "follow_ups": ("c?", "d?"), "answer": "e"}
    return Item(name, part, 1, minutes, f"{name}?", **(texts | more))


# --- What is drawn --------------------------------------------------------------------------------


def test_the_weak_come_as_often_as_is_said() -> None:
    """2 of 8 are weak: the share of draws is binomial about the stated probability."""
    pool, weak, n = [item(str(i)) for i in range(9)], {"0", "1"}, 4000
    expected = 2 * WEIGHT / (2 * WEIGHT + 6)
    hits = sum(rehearsal.draw(pool, PARTS, 45, weak, {"8"}, s)[0].key in weak for s in range(n))
    assert abs(hits / n - expected) < 4 * (expected * (1 - expected) / n) ** 0.5


@examples(60)
@given(
    st.lists(st.tuples(st.sampled_from(PARTS), st.integers(1, 40)), min_size=1, max_size=12),
    st.integers(1, 90),
    st.sets(st.integers(0, 11)),
    st.integers(0, 999),
)
def test_a_draw_fits_and_repeats_nothing_that_was_just_asked(
    made: list[tuple[str, int]], minutes: int, before: set[int], seed: int
) -> None:
    pool = [item(str(i), *one) for i, one in enumerate(made)]
    last = {str(i) for i in before}
    other = [one for one in pool if one.key not in last]
    if not other:
        with pytest.raises(ValueError, match="just asked"):
            rehearsal.draw(pool, PARTS, minutes, (), last, seed)
        return
    drawn = rehearsal.draw(pool, PARTS, minutes, (), last, seed)
    assert not {one.key for one in drawn} & last
    parts = [one.part for one in drawn]
    assert parts == sorted(set(parts), key=PARTS.index)
    least = {p: min(one.minutes for one in other if one.part == p) for p in {o.part for o in other}}
    total = sum(one.minutes for one in drawn)
    assert total <= minutes or (len(drawn) == 1 and total == least[parts[0]])
    assert len(drawn) == len(least) or sum(least.values()) > minutes


# --- What is asked next ---------------------------------------------------------------------------


@examples(60)
@given(st.permutations(range(4)))
def test_the_follow_up_is_on_the_weakest_line(marks: list[int]) -> None:
    lines = ("Halves the step.", "Names friction.", "Logs energy at impacts.", "Ends with a test.")
    requested = (
        "Where is the impact's energy?",
        "And a test of that?",
        "Halving helps?",
        "Frictional?",
    )
    one = item("x", rubric=lines, follow_ups=requested)
    result = rehearsal.follow_up(one, [MARKS[mark] for mark in marks])
    weakest = marks.index(0)
    assert result == (lines[weakest], requested[(2, 3, 0, 1)[weakest]])
    with pytest.raises(ValueError, match="must be 4 of missing"):
        rehearsal.follow_up(one, ["named"])


def test_scenarios_and_designs_are_asked_as_questions_are() -> None:
    """On the cause that was forgotten one is asked, and a design's words suggest its marks."""
    result = {one.key: one for one in rehearsal.spoken(["rigid_body", "interview"])}
    assert {f"scenario/{name}" for name in scenarios.scenario_names()} <= set(result)
    assert {one.part for one in result.values()} == set(PARTS) - {"coding"}
    for one in (one for key, one in result.items() if key.startswith("scenario/")):
        for i, words in enumerate(one.rubric):
            marks = ["missing" if i == j else "named" for j in range(len(one.rubric))]
            assert rehearsal.follow_up(one, marks)[1].endswith(words)
    for name in designs.NAMES:
        one = result[f"design/{name}"]
        suggested = [one.aid(text) for text in (designs.read(name).answer, "")]
        assert [len(marks) for marks in suggested] == [len(one.rubric)] * 2
        assert set(suggested[1]) == {"missing"} and "defended" in suggested[0]
        assert "{" not in one.fill(one.answer, figure)


def test_without_a_common_word_the_place_decides() -> None:
    one = item("x", rubric=("one", "two", "three", "four"), follow_ups=("A?", "B?"))
    requested = [
        rehearsal.follow_up(one, ["defended"] * i + ["missing"] + ["named"] * (3 - i))[1]
        for i in range(4)
    ]
    assert requested == ["A?", "A?", "B?", "B?"]


# --- A whole interview ----------------------------------------------------------------------------


def talk_of(place: Place, text: list[Any], minutes: int, parts: tuple[str, ...], seed: int) -> Talk:
    """An interview on two chapters in which 100 s pass from look to look at the clock.

    Args:
        said: lines; a function is called when its turn has come.
    """
    looks = iter(range(0, 10**6, 100))

    def listen() -> str:
        if not text:
            raise EOFError
        line = text.pop(0)
        return (line() and "") if callable(line) else line

    session = Session("interview", Terminal(), place.work)
    talk = Talk(session, listen, lambda: BEGAN + timedelta(seconds=next(looks)))
    talk.draw(minutes, seed, CHOSEN, parts)
    return talk


def lines(key: str, mark: str) -> list[Any]:
    """What answers a question: two lines, a mark for each line of the rubric, a reply."""
    marks = [mark] * len(rehearse.pool(CHOSEN)[key].rubric)
    return [f"On {key}.", "More.", ".", "5", *marks, "A reply.", ""]


@pytest.mark.slow
def test_a_whole_interview(
    place: Place, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """All that was said is in the report; a drill is graded for real; time is over once."""
    pool = rehearse.pool(CHOSEN)

    def drawn(seed: int) -> list[str]:
        every = list(pool.values())
        return [one.key for one in rehearsal.draw(every, PARTS, MINUTES, (), (), seed)]

    seed = next(seed for seed in range(999) if drawn(seed)[2] == "drill/fk3")
    keys, path = drawn(seed), place.work / "interview" / "fk3.py"
    right = cards.card("fk3").solution_text()
    code = [
        lambda: path.read_text(),  # the starter as it is, which is no attempt
        lambda: path.write_text("def fk3(lengths, thetas):\n    return thetas\n"),
        lambda: path.write_text(right),
    ]
    message = [*lines(keys[0], "3"), *lines(keys[1], "0"), *code, *lines(keys[3], "2")]
    left = [len(message) - len(lines(keys[0], "3")), len(lines(keys[3], "2")) + len(code), 0]
    talk, shown = talk_of(place, message, MINUTES, PARTS, seed), []
    monkeypatch.setattr(talk, "show", lambda text: shown.append((len(message), text)))
    assert talk.run() == 0 and message == []
    (report,) = place.work.glob("interview/report-*.json")
    result, page = (report.with_suffix(end).read_text("utf-8") for end in (".json", ".md"))
    result, out = json.loads(result), capsys.readouterr().out

    items = result["items"]
    assert [one["key"] for one in items] == keys and [one["part"] for one in items] == list(PARTS)
    assert [one["score"] for one in items] == pytest.approx([1, 0, 1 / 2, 2 / 3])
    for one in items:
        assert one["done"] and one["title"] in page and one["seconds"] > 0
        assert bool(one["read"]) == (one["score"] < 0.6) and one["read"] in page
        if one["part"] != "coding":
            assert (one["answer"], one["reply"]) == (f"On {one['key']}.\nMore.\n", "A reply.\n")
            assert one["answer"] in page and one["asked"] in page
            # Its model answer was shown once: when all of its lines had been said.
            answer = pool[one["key"]].fill(pool[one["key"]].answer, figure)
            assert [at for at, text in shown if answer in text] == [left.pop(0)]
    for one in (one for one in pool.values() if one.part == "coding"):
        entry = rehearsal.Entry(one.key, "coding", one.chapter, 1, "", weakest=one.rubric[0])
        assert re.search(r"section \d+: (?!Exercises|Interview)", rehearse.to_read(entry))
    assert [one["verdict"] for one in items[2]["attempts"]] == ["fail", "pass"]
    assert place.record("fk3")["state"] == "solved" and place.record("fk3")["attempts"] == 2
    spent = np.cumsum([one["seconds"] for one in items])
    assert spent[0] < MINUTES * 60 < spent[-1] == result["seconds"]
    assert result["over"] == items[int(np.argmax(spent > MINUTES * 60))]["title"]
    assert out.count("The time is over") == 1

    past = rehearse.json_store.load(talk.file, rehearse.FORM)[0]
    assert past.open == {} and past.last == keys and past.scores[keys[1]] == 0
    again = talk_of(place, [], MINUTES, PARTS, seed)
    assert not {one.key for one in again.interview.items} & set(keys)


@pytest.mark.slow
def test_what_was_weak_is_drawn_for(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer marked low and a drill that is tried and unsolved are weak, a good answer not."""
    for mark, seed in (("0", 1), ("3", 2)):
        talk = talk_of(place, [], 15, ("concept",), seed)
        key = talk.interview.items[0].key
        talk.read_line = iter(lines(key, mark)).__next__
        talk.run()
    place.answer("def fk3(lengths, thetas):\n    return thetas\n", "fk3")
    place.run("check", "fk3")
    card = next(card for card in deck.deck((1,)) if card.kind == "question")
    reviews = talk.file and talk.file.with_name("reviews.json")
    store.rate(reviews, card, 1, BEGAN - timedelta(days=1))
    weak: list[set[str]] = []

    def draw(pool: list[Item], parts: Any, minutes: int, keys: set[str], *rest: Any) -> list[Item]:
        weak.append(keys)
        return []

    monkeypatch.setattr(rehearsal, "draw", draw)
    talk = talk_of(place, [], 15, ("concept",), 3)
    scores = rehearse.json_store.load(talk.file, rehearse.FORM)[0].scores
    assert sorted(scores.values()) == [0, 1]
    assert weak == [{"drill/fk3", card.key, *(key for key, score in scores.items() if score == 0)}]
    assert talk.run() == 0 and talk.interview.cards_due == [card.key]


def test_what_was_asked_in_one_that_is_not_over_is_not_asked_again(place: Place) -> None:
    talk, again = (talk_of(place, ["One line."], 15, ("concept",), 1) for _ in range(2))
    with pytest.raises(EOFError):
        talk.run()
    assert again.interview.items[0].key == talk.interview.items[0].key
    third = talk_of(place, [], 15, ("concept",), 1)
    assert third.interview.items[0].key != talk.interview.items[0].key
    retained = rehearse.json_store.load(talk.file, rehearse.FORM)[0].open.popitem()[1]
    assert retained.seconds == 200  # one look for the line, one at the end
    assert "One is not over" in third.session.notices[0]


# --- Ended from outside, a pipe, a terminal -------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGHUP, signal.SIGINT, None])
def test_what_was_said_is_kept_however_it_ends(place: Place, end: signal.Signals | None) -> None:
    options = ("--kind", "concept", "--chapters", "1", "--seed", "7")
    process = place.popen("interview", *options, stdin=subprocess.PIPE)
    assert process.stdin is not None
    process.stdin.write(b"One line.\nA second \xff one.\n")
    process.stdin.flush()
    file, patience = place.work / "interviews.json", time.monotonic() + 120
    while not (file.exists() and "A second" in file.read_text("utf-8")):
        assert time.monotonic() < patience and process.poll() is None
        time.sleep(0.05)
    if end:
        process.send_signal(end)
    code = (
        process.wait(timeout=120) if end else (process.communicate(timeout=120), process.poll())[1]
    )
    assert code == {signal.SIGKILL: -9, signal.SIGHUP: 129}.get(end or signal.SIGINT, 130)
    key = json.loads(file.read_text("utf-8"))["open"].popitem()[1]["items"][0]["key"]
    rest = "\n".join(["A third.", *lines(key, "2")[2:], ""])
    result = place.json("interview", "--resume", text=rest)
    assert result["items"][0]["answer"] == "One line.\nA second \ufffd one.\nA third.\n"
    assert result["items"][0]["marks"] == ["quantified"] * (len(lines(key, "2")) - 6)
    assert "No interview is waiting" in place.json("interview", "--resume")["error"]["message"]


def test_a_pipe_of_80_columns_in_ascii(place: Place) -> None:
    arguments = ("interview", "--kind", "debugging", "--chapters", "3", "--seed", "1")
    message = "\n".join([".", *"1111111111"[:6], ""])
    done = place.run(*arguments, text=message, LC_ALL="C", NO_COLOR="1")
    assert done.code == 130 and "--resume goes on" in done.err
    done = place.run("interview", "--resume", text="1\n1\n1\n.\n", LC_ALL="C", NO_COLOR="1")
    assert done.code == 0, done
    assert done.out.isascii() and "\x1b" not in done.out
    assert max(map(len, done.out.splitlines())) <= 80
    assert place.run("interview", "--chapters", "1,99").code == 2


@pytest.mark.slow
def test_an_editor_takes_the_answer(place: Place) -> None:
    editor = place.folder / "editor"
    editor.write_text('#!/bin/sh\necho "From the editor." >> "$1"\n')
    editor.chmod(0o755)
    options = ["interview", "--kind", "concept", "--chapters", "1", "--seed", "7"]
    code, out = in_terminal(place, options, "\n" + "2\n" * 9 + ".\n", EDITOR=str(editor))
    assert code == 0, out
    (report,) = place.work.glob("interview/report-*.json")
    assert json.loads(report.read_text("utf-8"))["items"][0]["answer"] == "From the editor.\n"
    assert sorted(p.suffix for p in report.parent.iterdir()) == [".json", ".md"]


def test_a_damaged_file_is_put_aside(place: Place) -> None:
    place.work.mkdir()
    damaged = '{"schema": "drills-interviews/1", "open": {"x": {"items": [1]}}}'
    (place.work / "interviews.json").write_text(damaged)
    result = place.json("interview", "--resume")
    assert "damaged" in result["notices"][0] and "No interview" in result["error"]["message"]
    assert (place.work / "interviews.json.damaged-1").read_text() == damaged


@pytest.mark.slow
def test_a_reader_who_has_gone_ends_the_questions(place: Place) -> None:
    """Blank lines without end, of which each is refused: nobody sees it."""
    process = place.popen("interview", "--kind", "concept", "--seed", "7", stdin=subprocess.PIPE)
    assert process.stdin is not None and process.stdout is not None
    feeder = subprocess.Popen(["yes", ""], stdout=process.stdin)
    try:
        process.stdin.close()
        assert process.stdout.readline()
        process.stdout.close()
        assert process.wait(timeout=240) == 130
    finally:
        feeder.kill()
        process.kill()
        feeder.wait()
