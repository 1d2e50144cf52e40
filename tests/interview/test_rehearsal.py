"""The rehearsed interview: what is drawn, what is asked next, what is kept and reported."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import time
import tomllib
from collections import Counter
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import CHAPTERS
from course.derivations.records import figure
from course.interview import designs, rehearsal, scenarios
from course.interview.rehearsal import MARKS, PARTS, WEIGHT, Item
from drills import cards
from drills.interview import deck, rehearse, store
from drills.interview.rehearse import Talk
from drills.session import Session
from drills.terminal import Terminal
from tests.budget import examples, sampled
from tests.drills.place import Place, a_place, in_terminal, until

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


@pytest.mark.prove
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
@given(st.lists(st.integers(0, 3), min_size=4, max_size=4), st.integers(0, 9))
def test_the_follow_up_names_the_weakest_line(levels: list[int], seed: int) -> None:
    """One of those marked lowest, with what its mark asks for; after a perfect answer, any."""
    lines = ("Halves the step.", "Names friction.", "Logs energy at impacts.", "Ends with a test.")
    one = item("x", rubric=lines, follow_ups=("And now?", "And then?"))
    marks = [MARKS[level] for level in levels]
    weakest, question = rehearsal.follow_up(one, marks, seed)
    assert (weakest, question) == rehearsal.follow_up(one, marks, seed)
    if min(levels) == 3:
        assert weakest == "" and question in one.follow_ups
    else:
        assert levels[lines.index(weakest)] == min(levels)
        push = rehearsal.PUSH[MARKS[min(levels)]][1]  # no line has a number
        assert question == f"“{weakest}” {push}" and "number" not in question
    with pytest.raises(ValueError, match="must be 4 of missing"):
        rehearsal.follow_up(one, ["named"])


def test_a_number_is_asked_for_where_the_line_has_one() -> None:
    """Of every question, as it is on record: "give a number" comes with a figure or a field."""
    with_number = 0
    for one in rehearsal.spoken([chapter.topic for chapter in CHAPTERS]):
        for at, line in enumerate(one.rubric):
            if line in one.triggers:
                continue
            marks = ["named" if i == at else "defended" for i in range(len(one.rubric))]
            weakest, question = rehearsal.follow_up(one, marks)
            assert weakest == line and line in question
            assert ("Give a number" in question) == any(c.isdigit() or c == "{" for c in line)
            with_number += "Give a number" in question
    assert with_number > 3


@pytest.mark.prove
@pytest.mark.parametrize(
    ("text", "reply"),
    [
        ("How many picks an hour?", "One pick"),
        ("What does a miss cost?", "One pick"),
        ("Is there a fence?", "behind a fence"),
        ("Which gripper?", "parallel jaws"),
        ("What colour is the camera of the neighbours?", ""),
        ("Which budget does the hour of the lawyer have?", ""),
        ("What would that have been?", ""),
        ("xyzzy", ""),
    ],
)
def test_one_word_of_several_gets_no_reply(text: str, reply: str) -> None:
    one = rehearse.pool()["design/pick_and_place"]
    result = rehearsal.reply(one, text)
    assert reply in result and bool(result) == bool(reply)


@pytest.mark.parametrize("name", designs.NAMES)
def test_a_clarifying_question_is_understood_as_candidates_word_it(name: str) -> None:
    """Nine in ten get their reply, and no question gets the reply to another one."""
    path = Path(__file__).with_name("clarifying_questions.toml")
    rows = tomllib.loads(path.read_text(encoding="utf-8"))[name]["questions"]
    one, understood = rehearse.pool()[f"design/{name}"], 0
    for at, question in rows:
        allowed = "" if at < 0 else one.clarify[at].partition("? ")[2]
        result = rehearsal.reply(one, question)
        assert result in ("", allowed), question
        understood += result == allowed
    assert understood >= 0.9 * len(rows)


@pytest.mark.parametrize(
    ("key", "section"), [("design/among_people/short", "3: Design"), ("scenario/late", "5: Debug")]
)
def test_the_section_on_designs_or_scenarios_is_what_to_read_about_them(
    key: str, section: str
) -> None:
    weakest = "A law for each phase: position in transit, a spring at contact."
    entry = rehearsal.Entry(key, "design", 12, 15, "A design.", weakest=weakest)
    assert f"section {section}" in rehearse.to_read(entry)


@pytest.mark.prove
def test_designs_are_drawn_where_designs_are_asked_for(place: Place) -> None:
    """In full where it fits, short else; spoken questions only where no design is left."""
    for minutes, ends in ((45, ""), (15, "/short"), (30, "/short")):
        keys = set()
        for seed in range(8):
            talk = Talk(Session("interview", Terminal(), place.work))
            talk.draw(minutes, seed, rehearse.EVERY, ("design",))
            keys.add(talk.interview.items[0].key)
        assert all(key.startswith("design/") for key in keys) and len(keys) > 1
        assert all(key.endswith("/short") == bool(ends) for key in keys)


@pytest.mark.prove
def test_open_interviews_are_listed_and_resumed_by_number(place: Place) -> None:
    """Each one that is open; beyond five the oldest gets its report, and says so."""
    assert "You have no unfinished interview" in place.run("interview", "--list").out
    printed = []
    for n in range(rehearse.OPEN + 1):
        begun = place.run(
            "interview", "--kind", "concept", "--minutes", "10", text=f"Number {n}.\n"
        )
        printed.append(" ".join(begun.out.split()))
    assert "unfinished" not in printed[0] and "You have one unfinished interview" in printed[1]
    assert "You have 2 unfinished interviews: drills interview --list shows them" in printed[2]
    assert "The oldest one is now closed, and its report is" in printed[-1]
    (report,) = place.work.glob("interview/report-*.md")
    assert "Number 0." in report.read_text("utf-8")
    rows = place.json("interview", "--list")["open"]
    assert [row["number"] for row in rows] == [1, 2, 3, 4, 5]
    assert [row["started"] for row in rows] == sorted((r["started"] for r in rows), reverse=True)
    for number, which in (((), 5), (("1",), 5), (("4",), 2)):
        resumed = place.run("interview", "--resume", *number)
        assert f"Number {which}." in resumed.out and "4 others" in resumed.out
    done = place.run("interview", "--resume", "6")
    assert done.code == 2 and "There is no unfinished interview 6" in done.err


@pytest.mark.slow
def test_a_line_that_the_terminal_cuts_is_said(place: Place) -> None:
    options = ["interview", "--kind", "concept", "--chapters", "1", "--seed", "7"]
    _, out = in_terminal(place, options, "word " * 1000 + "\n.\n", until="How good was that?")
    assert "at most 4,095 bytes of a line" in " ".join(out.split())
    past, _ = rehearse.json_store.load(place.work / "interviews.json", rehearse.FORM)
    (interview,) = past.open.values()
    assert len(interview.items[0].answer) > 4000


def test_the_first_of_topics_with_as_many_words_gets_its_reply() -> None:
    one = item("x", clarify=("A? About a.", "B? About b."), topics=("people", "speed"))
    assert rehearsal.reply(one, "Which speed near people?") == "About b."
    assert rehearsal.reply(one, "Do people limit its speed?") == "About a."
    assert rehearsal.reply(one, "People, at which speed near people?") == "About a."


def test_of_lines_that_are_as_weak_not_always_the_first_is_asked_about() -> None:
    one = item("x", rubric=("a", "b", "c"))
    drawn = {rehearsal.follow_up(one, ["named"] * 3, seed)[0] for seed in range(30)}
    assert drawn == {"a", "b", "c"}


def test_the_weakest_line_is_followed_up_by_the_question_that_it_names() -> None:
    named = {"a": "Which unit?", "c": "Which test?"}
    one = item("x", rubric=("a", "b", "c"), triggers=named)
    for marks, expected in {
        ("missing", "named", "named"): ("a", "“a” Which unit?"),
        ("defended", "quantified", "named"): ("c", "“c” Which test?"),
        # A line that names none is asked about as its mark says.
        ("defended", "missing", "named"): ("b", f"“b” {rehearsal.PUSH['missing'][0]}"),
        # Of lines that are as weak, one that names a follow-up comes first.
        ("quantified", "named", "named"): ("c", "“c” Which test?"),
    }.items():
        for seed in range(20):
            assert rehearsal.follow_up(one, marks, seed) == expected
    weakest, question = rehearsal.follow_up(one, ["defended"] * 3)
    assert weakest == "" and question in one.follow_ups


def test_every_follow_up_that_a_line_names_is_asked_and_shown() -> None:
    """Of all questions: at least forty name one, and each is among the possible ones."""
    topics = [chapter.topic for chapter in CHAPTERS]
    named = {one.key: one for one in rehearsal.spoken(topics) if one.triggers}
    assert sum(key.startswith("question/") for key in named) >= 40
    assert len({one.chapter for one in named.values()}) == len(topics)
    for key, one in named.items():
        for at, line in enumerate(one.rubric):
            if line in one.triggers:
                marks = ["named" if i == at else "quantified" for i in range(len(one.rubric))]
                text = one.triggers[line]
                assert rehearsal.follow_up(one, marks) == (line, f"“{line}” {text}")
                assert not key.startswith("question/") or text in one.follow_ups


def test_scenarios_and_designs_are_asked_as_questions_are() -> None:
    """On the cause that was forgotten one is asked, and a design's words suggest its marks."""
    result = {one.key: one for one in rehearsal.spoken(["rigid_body", "interview"])}
    assert {f"scenario/{name}" for name in scenarios.scenario_names()} <= set(result)
    assert {one.part for one in result.values()} == set(PARTS)
    for one in (one for key, one in result.items() if key.startswith("scenario/")):
        for i, words in enumerate(one.rubric):
            marks = ["missing" if i == j else "named" for j in range(len(one.rubric))]
            assert rehearsal.follow_up(one, marks)[1] == (
                f"“{words}” Which probe distinguishes this cause from the others?"
            )
    for name in designs.NAMES:
        one = result[f"design/{name}"]
        suggested = [one.aid(text) for text in (designs.read(name).answer, "")]
        assert [len(marks) for marks in suggested] == [len(one.rubric)] * 2
        assert set(suggested[1]) == {"missing"} and "defended" in suggested[0]
        assert "{" not in one.fill(one.answer, figure)
        short = result[f"design/{name}/short"]
        assert (short.minutes, one.minutes) == (15, 45) and short.rubric == one.rubric[::2]
        assert len(short.aid(designs.read(name).answer)) == len(short.rubric)
        for text in one.clarify:
            question, _, answer = text.partition("? ")
            assert answer and rehearsal.reply(one, f"{question}?") == answer
        assert rehearsal.reply(one, "xyzzy") == ""


@pytest.mark.slow
def test_the_usual_interview_has_all_that_the_chapter_promises() -> None:
    """A concept, a scenario that runs, coding, a design of 15 minutes; two of a chapter at most."""
    whiteboard = graded = 0
    everything = list(rehearse.pool().values())
    for minutes in (45, 60, 90):
        pool = rehearsal.usual(everything, minutes)
        for seed in range(100):
            drawn = rehearsal.draw(pool, PARTS, minutes, (), (), seed)
            assert tuple(one.part for one in drawn) == PARTS
            assert sum(one.minutes for one in drawn) <= minutes
            assert drawn[1].key.startswith("scenario/")
            assert drawn[3].key.startswith("design/")
            assert drawn[3].key.endswith("/short") == (minutes < 90)
            assert max(Counter(one.chapter for one in drawn).values()) <= 2
            whiteboard += drawn[2].key.startswith("question/")
            graded += drawn[2].key.startswith("drill/")
    assert min(whiteboard, graded) > 20


def test_where_the_chapters_have_none_other_questions_take_the_place() -> None:
    pool = rehearsal.usual(list(rehearse.pool(CHOSEN).values()), 45)
    drawn = rehearsal.draw(pool, PARTS, 45, (), (), 0)
    assert [one.part for one in drawn] == list(PARTS)
    assert {one.chapter for one in drawn} == CHOSEN


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
    """What answers a question: two paragraphs, a mark for each line of the rubric, a reply."""
    marks = [mark] * len(rehearse.pool(CHOSEN)[key].rubric)
    return [f"On {key}.", "", "More.", ".", "5", *marks, "A reply.", "."]


def pool_rubric(key: str) -> tuple[str, ...]:
    return rehearse.pool()[key].rubric


@pytest.mark.prove
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
    remaining = [len(message) - len(lines(keys[0], "3")), len(lines(keys[3], "2")) + len(code), 0]
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
            assert (one["answer"], one["reply"]) == (f"On {one['key']}.\n\nMore.\n", "A reply.\n")
            assert one["answer"] in page and one["asked"] in page
            # Its model answer was shown once: when all of its lines had been said.
            answer = pool[one["key"]].fill(pool[one["key"]].answer, figure)
            assert [at for at, text in shown if answer in text] == [remaining.pop(0)]
    for one in (one for one in pool.values() if one.part == "coding"):
        entry = rehearsal.Entry(one.key, "coding", one.chapter, 1, "", weakest=one.rubric[0])
        assert re.search(r"section \d+: (?!Exercises|Interview)", rehearse.to_read(entry))
    assert [one["verdict"] for one in items[2]["attempts"]] == ["fail", "pass"]
    assert items[2]["code"] == right and right.rstrip() in page
    assert place.record("fk3")["state"] == "solved" and place.record("fk3")["attempts"] == 2
    spent = np.cumsum([one["seconds"] for one in items])
    assert spent[0] < MINUTES * 60 < spent[-1] == result["seconds"]
    assert result["over"] == items[int(np.argmax(spent > MINUTES * 60))]["title"]
    assert out.count("minutes are over.") == 1

    past = rehearse.json_store.load(talk.file, rehearse.FORM)[0]
    assert past.open == {} and past.last == keys and past.scores[keys[1]] == 0
    again = talk_of(place, [], MINUTES, PARTS, seed)
    assert not {one.key for one in again.interview.items} & set(keys)


@pytest.mark.prove
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


def test_what_was_asked_in_one_that_is_not_over_is_not_asked_again(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    talk, again = (talk_of(place, ["One line."], 15, ("concept",), 1) for _ in range(2))
    with pytest.raises(EOFError):
        talk.run()
    assert again.interview.items[0].key == talk.interview.items[0].key
    third = talk_of(place, [], 15, ("concept",), 1)
    assert third.interview.items[0].key != talk.interview.items[0].key
    retained = rehearse.json_store.load(talk.file, rehearse.FORM)[0].open.popitem()[1]
    assert retained.seconds == 200  # one look for the line, one at the end
    assert "You have one unfinished interview" in capsys.readouterr().out


# --- What is typed --------------------------------------------------------------------------------


def test_a_pasted_text_is_one_answer_and_none_of_its_lines_is_a_mark(place: Place) -> None:
    """Blank lines, a dot, and what was typed ahead behind it."""
    pasted = ["", "First.", "", "Second.", ".", "2", "1", "", "Third."]
    marks, reply = ["3"] * 20, ["."]
    remaining = [*pasted]

    def listen() -> str:
        if remaining:
            return remaining.pop(0)
        return marks.pop(0) if len(talk.interview.items[0].marks) < count else reply.pop(0)

    talk = talk_of(place, [], 15, ("concept",), 1)
    count = len(pool_rubric(talk.interview.items[0].key))
    talk.read_line, talk.waiting = listen, lambda: bool(remaining)
    assert talk.run() == 0
    entry = talk.interview.items[0]
    assert entry.answer == "First.\n\nSecond.\n2\n1\n\nThird.\n"
    assert entry.marks == ["defended"] * count


@pytest.mark.prove
def test_what_is_pasted_into_a_terminal_stays_together(place: Place) -> None:
    options = ["interview", "--kind", "concept", "--chapters", "1", "--seed", "7"]
    pasted = "One.\n\nTwo.\n.\n2\nThree.\n"
    _, out = in_terminal(place, options, pasted, until="How good was that?")
    assert "How good was that?" in out
    past, _ = rehearse.json_store.load(place.work / "interviews.json", rehearse.FORM)
    (interview,) = past.open.values()
    (entry,) = interview.items
    assert entry.answer == "One.\n\nTwo.\n2\nThree.\n" and entry.marks == []


@pytest.mark.prove
def test_an_answer_of_ten_megabytes_is_refused_and_nothing_else_is_lost(place: Place) -> None:
    first = talk_of(place, [], 15, ("concept",), 1)
    key = first.interview.items[0].key
    first.read_line = iter(lines(key, "2")).__next__
    first.run()
    before = rehearse.json_store.load(first.file, rehearse.FORM)[0].scores
    huge = ["A line.", *["x" * 10_000] * 1000, "y" * 10_000_000, ".", "1"]
    talk = talk_of(place, huge, 15, ("concept",), 2)
    with pytest.raises(EOFError):
        talk.run()
    past, notices = rehearse.json_store.load(talk.file, rehearse.FORM)
    assert notices == () and past.scores == before and len(before) == 1
    (opened,) = past.open.values()
    assert opened.items[0].answer.startswith("A line.\nxxx") and opened.items[0].marks == ["named"]
    assert len(opened.items[0].answer) < rehearse.LONGEST
    assert not list(place.work.glob("*.damaged*"))
    assert talk.file is not None and talk.file.stat().st_size < 200_000


def test_a_file_too_large_to_be_read_again_is_not_written(tmp_path: Any) -> None:
    path = tmp_path / "interviews.json"
    store_of = rehearse.json_store
    store_of.change(path, rehearse.FORM, lambda past: past.last.append("a"))
    before = path.read_bytes()
    with pytest.raises(store_of.Problem, match="would be larger than 4 MB"):
        store_of.change(path, rehearse.FORM, lambda past: past.last.append("b" * 5_000_000))
    assert path.read_bytes() == before


def test_a_long_answer_is_not_written_as_a_whole_for_every_line(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[int] = []
    whole = rehearse.json_store.change

    def counted(*arguments: Any) -> Any:
        written.append(1)
        return whole(*arguments)

    monkeypatch.setattr(rehearse.json_store, "change", counted)
    for count in (10, 400):
        written.clear()
        text = [*[f"Line {i}." for i in range(count)]]
        talk = talk_of(place, text, 15, ("concept",), 1)
        with pytest.raises(EOFError):
            talk.run()
        assert len(written) == 2  # the draw, and the end
        (entry,) = talk.interview.items
        assert entry.answer.count("\n") == count


def test_lines_of_the_journal_are_taken_once(place: Place) -> None:
    """Killed between two lines, or between the file and the removal of its journal."""
    talk = talk_of(place, ["One.", "Two."], 15, ("concept",), 1)
    talk.begin()
    (entry,) = talk.interview.items
    for line in ("One.", "Two."):
        talk.add(entry, "answer", line)
    assert talk.journal is not None
    rows = talk.journal.read_text("utf-8")
    for cut in (rows, rows + rows, rows + '{"key": "x'):
        talk.journal.write_text(cut, encoding="utf-8")
        again = talk_of(place, [], 15, ("concept",), 2)
        again.resume()
        assert again.interview.items[0].answer == "One.\nTwo.\n"
        assert again.interview.items[0].seconds == entry.seconds > 0


def test_control_characters_are_made_visible(place: Place) -> None:
    talk = talk_of(place, ["\x1b[2Jgone\u202e", ".", "0"], 15, ("concept",), 1)
    with pytest.raises(EOFError):
        talk.run()
    assert talk.interview.items[0].answer == "\\x1b[2Jgone\\x202e\n"


def test_a_design_is_clarified_before_it_is_answered(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    talk = talk_of(place, [], 15, ("design",), 1)
    key = "design/fleet_simulation/short"
    item_ = rehearse.pool()[key]
    rehearsed = rehearsal.Entry(key, "design", 12, 15, item_.title)
    talk.interview.items = [rehearsed]
    text = ["How many robots and which sensors?", "xyzzy?", ".", "An answer.", "."]
    talk.read_line = iter([*text, *["1"] * len(item_.rubric), "A reply.", "."]).__next__
    assert talk.run() == 0
    assert "a scanner of" in rehearsed.clarified and "no answer to that" in rehearsed.clarified
    assert rehearsed.answer == "An answer.\n"
    out = capsys.readouterr().out
    assert out.index("First ask what you need") < out.index("ends your answer")


@pytest.mark.prove
def test_a_scenario_runs_in_the_interview_and_goes_on_after_a_stop(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    talk = talk_of(place, [], 15, ("debugging",), 1)
    entry = rehearsal.Entry("scenario/touch", "debugging", 12, 10, "It hammers.")
    talk.interview.items = [entry]
    talk.read_line = iter(["program", "probe quarter_gain", "conclude x y"]).__next__
    with pytest.raises((EOFError, StopIteration, RuntimeError)):
        talk.run()
    again = talk_of(place, [], 15, ("debugging",), 1)
    again.resume()
    capsys.readouterr()
    case = scenarios.drawn("touch", again.interview.seed % 1000)
    cause = scenarios._cause(case)
    path = scenarios.model_path("touch")
    one = scenarios.scenario("touch")
    rest = [*(f"probe {name}" for name in path), f"conclude {cause} {one.cause(cause).repair}"]
    again.read_line = iter(rest).__next__
    assert again.run() == 0
    (done,) = again.interview.items
    assert done.score == 1 and done.attempts[0]["verdict"] == "pass"
    assert done.answer.startswith("program\nprobe quarter_gain\nconclude x y\nprobe ")
    # What was found is there again, and the program is not printed once more.
    shown = capsys.readouterr().out
    assert "Results so far:" in shown and "class Machine" not in shown
    (page,) = place.work.glob("interview/report-*.md")
    assert "quarter_gain" in page.read_text("utf-8")


def test_the_report_has_marks_answers_model_answers_and_what_to_review() -> None:
    weak = rehearsal.Entry("a", "concept", 1, 5, "A?", answer="My answer.", rubric=["One", "Two"])
    weak.marks, weak.score, weak.read, weak.model = ["missing", "named"], 1 / 6, "chapter 1", "So."
    weak.asked, weak.reply = "One You have not said this.", "My reply."
    weak.code, weak.task = "def f(x):\n    return x\n", "The task in full."
    good = rehearsal.Entry("b", "design", 12, 15, "B?", score=1.0, clarified="* Who? *They.*")
    page = rehearsal.markdown(rehearsal.Interview("2026-01-02T03:04:05", 1, 45, [weak, good]))
    for text in (
        "```python\ndef f(x):\n    return x\n```",
        "| missing | One |",
        "| named | Two |",
        "My answer.",
        "My reply.",
        "So.",
        "Who?",
    ):
        assert text in page
    assert page.index("The task in full.") < page.index("My answer.")
    assert "* Read chapter 1." in page and "`drills review --chapters 1`" in page


def test_the_report_shows_code_of_the_whiteboard_as_code_and_ends_sentences_once() -> None:
    entry = rehearsal.Entry("question/a/b", "coding", 1, 5, "Write it.")
    entry.answer, entry.read = "for i in a:\n    # one\n    b *= i\n", "chapter 1, section 3: Why?"
    page = rehearsal.markdown(rehearsal.Interview("2026-01-02T03:04:05", 1, 45, [entry]))
    assert f"```text\n{entry.answer}```" in page
    assert "* Read chapter 1, section 3: Why?\n" in page
    assert rehearsal.sentence("Read it") == "Read it."


def test_the_report_has_the_task_of_a_scenario(place: Place) -> None:
    talk = talk_of(place, [], 15, ("debugging",), 1)
    talk.interview.items = [rehearsal.Entry("scenario/touch", "debugging", 12, 10, "It hammers.")]
    talk.read_line = iter(["quit"]).__next__
    assert talk.run() == 0
    (page,) = place.work.glob("interview/report-*.md")
    assert scenarios.scenario("touch").prompt in page.read_text("utf-8")


def test_an_interview_begins_with_what_comes(place: Place) -> None:
    out = " ".join(place.run("interview", "--seed", "7").out.split())
    (interview,) = json.loads((place.work / "interviews.json").read_text())["open"].values()
    items = interview["items"]
    planned = sum(one["minutes"] for one in items)
    announced = f"{len(items)} questions, planned for {planned} of your 45 minutes:"
    assert out.index(announced) < out.index("45 min left")
    names = {"concept": "concept", "debugging": "debugging with probes", "design": "system design"}
    for one in items:
        coding = "graded code" if one["key"].startswith("drill/") else "code at a whiteboard"
        assert f"{names.get(one['part'], coding)} ({one['minutes']} min)" in out


@pytest.mark.slow
def test_a_terminal_asks_for_each_mark(place: Place) -> None:
    options = ["interview", "--kind", "design", "--minutes", "15", "--seed", "7"]
    _, out = in_terminal(place, options, ".\nAn answer.\n.\n", until="mark 0-3:")
    assert out.index("How good was that?") < out.index("mark 0-3:")


@pytest.mark.slow
def test_an_interview_asks_and_reports_the_follow_up_that_the_weakest_line_names(
    place: Place, capsys: pytest.CaptureFixture[str]
) -> None:
    key = "question/rigid_body/largest_step"
    one = rehearse.pool(CHOSEN)[key]
    at = next(at for at, line in enumerate(one.rubric) if line in one.triggers)
    marks = ["1" if i == at else "3" for i in range(len(one.rubric))]
    expected = f"“{one.rubric[at]}” {one.triggers[one.rubric[at]]}"
    talk = talk_of(place, ["My answer.", ".", *marks, "A reply.", "."], 15, ("concept",), 1)
    talk.interview.items = [rehearsal.Entry(key, one.part, one.chapter, one.minutes, one.title)]
    talk.run()
    entry = talk.interview.items[0]
    assert (entry.weakest, entry.asked) == (one.rubric[at], expected)
    shown = " ".join(capsys.readouterr().out.split())
    page = rehearsal.markdown(talk.interview)
    assert expected in shown and f"**{expected}**\n\nA reply." in page


# --- Ended from outside, a pipe, a terminal -------------------------------------------------------


@pytest.mark.prove
def test_a_kill_before_the_first_line_keeps_the_draw(place: Place) -> None:
    process = place.popen("interview", "--seed", "7", stdin=subprocess.PIPE)
    until(process, "ends your answer")
    process.kill()
    process.wait(timeout=120)
    content = json.loads((place.work / "interviews.json").read_text("utf-8"))
    (opened,) = content["open"].values()
    again = talk_of(place, [], 15, ("concept",), 1)
    again.resume()
    assert [one["key"] for one in opened["items"]] == [e.key for e in again.interview.items]
    assert len(opened["items"]) == 4 and opened["seed"] == 7


@pytest.mark.slow
@pytest.mark.parametrize("end", sampled([signal.SIGKILL, signal.SIGHUP, signal.SIGINT, None], 2))
def test_what_was_said_is_kept_however_it_ends(place: Place, end: signal.Signals | None) -> None:
    options = ("--kind", "concept", "--chapters", "1", "--seed", "7")
    process = place.popen("interview", *options, stdin=subprocess.PIPE)
    assert process.stdin is not None
    process.stdin.write(b"One line.\nA second \xff one.\n")
    process.stdin.flush()
    file, patience = place.work / "interviews.json", time.monotonic() + 120
    while not any("A second" in path.read_text("utf-8") for path in place.work.glob("*.lines")):
        assert time.monotonic() < patience and process.poll() is None
        time.sleep(0.05)
    if end:
        process.send_signal(end)
    code = (
        process.wait(timeout=120) if end else (process.communicate(timeout=120), process.poll())[1]
    )
    assert code == {signal.SIGKILL: -9, signal.SIGHUP: 129}.get(end or signal.SIGINT, 130)
    key = json.loads(file.read_text("utf-8"))["open"].popitem()[1]["items"][0]["key"]
    rest = "\n".join(["A third.", *lines(key, "2")[3:], ""])
    result = place.json("interview", "--resume", text=rest)
    assert result["items"][0]["answer"] == "One line.\nA second \ufffd one.\nA third.\n"
    assert result["items"][0]["marks"] == ["quantified"] * len(pool_rubric(key))
    assert not list(place.work.glob("*.lines"))
    assert (
        "You have no unfinished interview"
        in place.json("interview", "--resume")["error"]["message"]
    )


def test_a_pipe_of_80_columns_in_ascii(place: Place) -> None:
    arguments = ("interview", "--kind", "debugging", "--chapters", "3", "--seed", "1")
    message = "\n".join([".", *"1111111111"[:6], ""])
    done = place.run(*arguments, text=message, LC_ALL="C", NO_COLOR="1")
    assert done.code == 130 and "--resume continues" in " ".join(done.err.split())
    done = place.run("interview", "--resume", text="1\n1\n1\n.\n", LC_ALL="C", NO_COLOR="1")
    assert done.code == 0, done
    assert done.out.isascii() and "\x1b" not in done.out
    assert max(map(len, done.out.splitlines())) <= 80
    assert place.run("interview", "--chapters", "1,99").code == 2


def test_a_narrow_terminal_cuts_no_line(place: Place) -> None:
    """Of 40 columns; only the name of the report's file can't be broken."""
    options = ("interview", "--kind", "concept", "--chapters", "1", "--seed", "7")
    done = place.run(*options, text="An answer.\n.\n" + "1\n" * 4 + ".\n", COLUMNS="40")
    lines = [line for line in done.out.splitlines() if "report-" not in line]
    assert "How good was that?" in done.out and "defended: you also" in done.out
    assert [line for line in lines if len(line) > 40] == []


@pytest.mark.prove
def test_an_editor_takes_the_answer(place: Place) -> None:
    editor = place.folder / "editor"
    editor.write_text('#!/bin/sh\necho "From the editor." >> "$1"\n')
    editor.chmod(0o755)
    options = ["interview", "--kind", "concept", "--chapters", "1", "--seed", "7"]
    code, out = in_terminal(place, options, "e\n" + "2\n" * 9 + ".\n", EDITOR=str(editor))
    assert code == 0, out
    (report,) = place.work.glob("interview/report-*.json")
    assert json.loads(report.read_text("utf-8"))["items"][0]["answer"] == "From the editor.\n"
    assert sorted(p.suffix for p in report.parent.iterdir()) == [".json", ".md"]


def test_a_damaged_file_is_put_aside(place: Place) -> None:
    place.work.mkdir()
    damaged = '{"schema": "drills-interviews/1", "open": {"x": {"items": [1]}}}'
    (place.work / "interviews.json").write_text(damaged)
    result = place.json("interview", "--resume")
    assert (
        "damaged" in result["notices"][0]
        and "no unfinished interview" in result["error"]["message"]
    )
    assert (place.work / "interviews.json.damaged-1").read_text() == damaged


@pytest.mark.prove
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
