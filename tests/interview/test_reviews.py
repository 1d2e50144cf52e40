"""Cards and when they are asked: the schedule, the file, and the command `drills review`."""

import ast
import itertools
import json
import re
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import cards as pages
from course.derivations import formula, records, run
from course.interview import questions
from drills import cards as catalogue
from drills import plain_math
from drills.interview import review, store
from drills.interview.deck import KINDS, VERDICTS, Entry, deck, judge, sides
from drills.plain_math import literal
from drills.session import Session
from drills.task_text import markdown_lines
from drills.terminal import Terminal, to_ascii
from tests.budget import examples
from tests.drills.place import Place, a_place

__all__ = ["a_place"]

NOON = datetime(2026, 5, 4, 12, tzinfo=UTC)
ONE, TWO = Entry("claim/one", "claim", 1), Entry("claim/two", "claim", 1)


# --- The deck -------------------------------------------------------------------------------------


def test_every_source_has_its_card_and_every_card_its_number() -> None:
    result = deck()
    keys = [entry.key for entry in result]
    assert len({entry.number for entry in result}) == len(set(keys)) == len(keys)
    assert max(entry.number for entry in result) < 2**53 and {e.kind for e in result} == set(KINDS)
    drills = {entry.name for entry in result if entry.kind == "drill"}
    assert {"fk3", "rrt", "pid", "randomize"} <= drills
    for topic, number in (("contact", 2), ("role", 0)):
        of_gate = {f"formula/{id}" for id in pages.gate(topic)}
        assert of_gate <= {entry.key for entry in deck([number])}
    assert {entry.chapter for entry in deck([1, 5])} == {1, 5}
    with pytest.raises(ValueError, match=r"chapter must be .*, got 13"):
        deck([13])


@pytest.mark.parametrize("kind", KINDS)
def test_both_sides_of_a_card_are_whole(kind: str) -> None:
    """No field is left open; claims that need their check to run are not among the first ones."""
    for entry in [e for e in deck() if e.kind == kind][:: 40 if kind == "claim" else 5]:
        shown = sides(entry)
        assert shown.front.strip() and shown.back.strip(), entry
        if kind in ("claim", "question"):
            assert not re.search(
                r"\{\w+(\.\w+)?(:[^{}]*)?\}", re.sub(r"\$.*?\$", "", shown.back, flags=re.S)
            )


def test_code_on_a_card_fits_a_terminal_and_is_the_same_program() -> None:
    screen = Terminal()
    screen.width = 80

    def program(text: str) -> str:
        tree = ast.parse(text)
        for node in ast.walk(tree):
            if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
                node.body = node.body[ast.get_docstring(node) is not None :]
        return ast.dump(tree)

    longest = 0
    for card in catalogue.cards()[::3]:
        text = card.solution_text()
        longest = max(longest, *map(len, text.splitlines()))
        shown = markdown_lines(f"```python\n{text}```", screen)
        assert max(map(len, shown)) <= 80
        assert program("\n".join(line[1:] for line in shown)) == program(text), card.name
    assert longest > 80


@pytest.mark.slow
def test_no_card_shows_a_field_that_nothing_fills() -> None:
    """Every card of the deck, as the command shows it."""
    for entry in deck():
        shown = sides(entry)
        text = re.sub(r"\$.*?\$|`[^`]*`", "", f"{shown.front}\n{shown.back}", flags=re.S)
        if entry.kind != "drill":  # whose back is code
            assert not re.search(r"\{\w+([.:][^{}]*)?\}", text), entry.key


def test_a_first_interview_asks_what_its_questions_quote() -> None:
    ranks = {entry.key: entry.rank for entry in deck()}
    assert ranks["question/contact/aabb_by_hand"] == 0 == ranks["claim/aabb_six_numbers"]
    later = next(q for q in questions("contact") if q.level == 3)
    assert ranks[f"question/contact/{later.name}"] == 1
    assert {ranks[f"formula/{id}"] for id in pages.gate("contact")} == {0}
    counts = [list(ranks.values()).count(rank) for rank in range(3)]
    assert min(counts) > 50


@pytest.mark.slow
def test_a_claim_on_record_reads_as_the_claim_that_is_run() -> None:
    for id in ("reaction_is_age", "same_rate_in_step"):
        (entry,) = (e for e in deck() if e.key == f"claim/{id}")
        assert (whole := run(id)).finding.inputs
        assert whole.corrected in sides(entry).back


def test_a_claim_and_a_formula_are_judged_and_the_rest_is_not() -> None:
    for entry in [e for e in deck() if e.kind == "claim"][::25]:
        verdict = records.load(entry.file)[entry.name]["verdict"]
        right = {"holds": "t", "false": "F", "holds only if": "o"}[verdict]
        text = {letter: judge(entry, letter)[0] for letter in "tFo"}
        assert text == {letter: letter == right for letter in "tFo"}
    for entry in [e for e in deck() if e.kind == "formula"][::25]:
        requested = formula(entry.name)
        assert judge(entry, f"1*({requested.expression})")[0] is True
        assert [judge(entry, slip)[0] for slip in requested.slips] == [False] * len(requested.slips)
    assert judge(ONE, "") == (None, "")
    unread, sentence = judge(ONE, "perhaps")
    assert unread is None and "t or true, f or false" in sentence


@pytest.mark.parametrize(
    ("kind", "text"), [("claim", "talk to me"), ("claim", "of course"), ("formula", "2 ** ) h")]
)
def test_what_cannot_be_read_is_asked_again_and_shows_no_answer(
    kind: str, text: str, place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    entry = one_kind(kind, monkeypatch)
    done = place.run("review", "--limit", "1", text=f"{text}\nquit\n")
    back = " ".join(re.findall(r"\w+", sides(entry).back))
    assert done.code == 0 and back[:40] not in " ".join(re.findall(r"\w+", done.out)), done
    assert (
        "A blank line shows the answer." in " ".join(done.out.split())
        and "rated 0 cards" in done.out
    )
    again = place.json("review", "--limit", "1", text=f"{text}\n\n3\n")
    assert [one["right"] for one in again["rated"]] == [None]


@pytest.mark.parametrize(
    ("text", "letter"), [("True", "t"), ("false.", "f"), (" only  if ", "o"), ("It depends", "o")]
)
def test_a_claim_is_answered_in_words_too(text: str, letter: str) -> None:
    entry = next(e for e in deck() if e.kind == "claim")
    assert judge(entry, text) == judge(entry, letter)
    assert judge(entry, text)[0] is not None


def test_no_sign_of_a_formula_is_lost_in_a_terminal() -> None:
    """Every sign of multiplication of a claim or a formula is on the screen."""
    terminal = Terminal()
    terminal.colour = False
    checked = 0
    for entry in [e for e in deck() if e.kind in ("claim", "formula")]:
        shown, raw = sides(entry, literal), sides(entry)
        text = f"{raw.front}\n\n{raw.back}".replace("**", "").replace("\n* ", "\n")
        if "*" in text:
            written = "\n".join(markdown_lines(f"{shown.front}\n\n{shown.back}", terminal))
            assert written.count("*") == text.count("*"), entry.key
            checked += 1
    assert checked > 100


# --- The schedule ---------------------------------------------------------------------------------


@examples(40)
@given(st.lists(st.sampled_from([*store.RATINGS]), min_size=1, max_size=12))
def test_a_card_is_due_when_nine_in_ten_would_still_know_it(ratings: list[int]) -> None:
    """The published forgetting curve, (1 + (0.9^(-1/w) - 1) t/S)^-w with w = 0.1542."""
    reviews, now = store.Reviews(), NOON
    for rating in ratings:
        reviews, report = store.rate(None, ONE, rating, now, reviews)
        state = reviews.cards[ONE.key]
        after = now
        now = datetime.fromisoformat(state["due"])
        assert report == () and after < now and state["card_id"] == ONE.number
        days = (now - after).total_seconds() / 86400
        # The longest interval of the schedule is a hundred years.
        if state["state"] == 2 and 1 < days < 36500:
            w = 0.1542
            ends = [days - 0.51, days + 0.51]  # due on a whole day
            curve = [(1 + (0.9 ** (-1 / w) - 1) * t / state["stability"]) ** -w for t in ends]
            assert curve[1] <= 0.9 <= curve[0]
        else:
            assert days <= 1 or days == 36500
    assert [one["rating"] for one in reviews.log] == ratings


def test_what_is_due_weak_new_and_gone() -> None:
    reviews = store.Reviews()
    for entry, ratings in ((ONE, (1, 1, 2)), (TWO, (4,))):
        for rating in ratings:
            store.rate(None, entry, rating, NOON, reviews)
    three, cards = Entry("claim/three", "claim", 1), [TWO, ONE]
    assert store.due(cards, reviews, NOON) == []
    assert store.due(cards, reviews, NOON + timedelta(days=1)) == [ONE]
    assert store.due(cards, reviews, NOON + timedelta(days=60)) == [ONE, TWO]
    assert store.weak([*cards, three], reviews) == [ONE]
    assert store.fresh([*cards, three], reviews) == [three]
    assert store.queue([three, *cards], reviews, NOON + timedelta(days=1)) == [ONE, three]
    assert store.missing_cards([TWO], reviews) == [ONE.key]


CARDS = st.lists(
    st.builds(
        Entry,
        st.integers(0, 999).map("claim/{}".format),
        st.just("claim"),
        st.integers(1, 3),
        st.sampled_from(["", "a", "b", "c"]),
        st.integers(0, 2),
    ),
    max_size=30,
    unique_by=lambda entry: entry.key,
)


@examples(60)
@given(CARDS, st.integers(0, 99), st.sets(st.integers(1, 3)))
def test_new_cards_are_shuffled_once(cards: list[Entry], seed: int, opened: set[int]) -> None:
    """A rating takes its card out and moves no other; opened chapters come first, by rank."""
    line = store.sequence(cards, seed, opened)
    assert sorted(line, key=lambda e: e.key) == sorted(cards, key=lambda e: e.key)
    places = [(entry.chapter not in opened, entry.rank) for entry in line]
    assert places == sorted(places)
    reviews, later = store.Reviews(), NOON
    for entry in line:
        assert store.queue(line, reviews, later) == store.fresh(line, reviews)
        assert store.fresh(line, reviews)[0] == entry
        store.rate(None, entry, 4, later, reviews)
    for entry in cards:
        rest = [one for one in cards if one != entry]
        assert store.sequence(rest, seed, opened) == [one for one in line if one != entry]


@examples(60)
@given(CARDS)
def test_no_two_cards_in_a_row_are_of_one_file_while_there_is_another(cards: list[Entry]) -> None:
    line, last = list(cards), None
    while line:
        entry = store.following(line, last)
        assert entry is not None
        if last is not None and last.file and entry.file == last.file:
            assert all(one.file == last.file for one in line)
        line.remove(entry)
        last = entry
    assert store.following([], last) is None


def test_neighbours_of_the_deck_do_not_come_one_after_the_other() -> None:
    """The share of neighbours among 20 new cards is that of a shuffle, not a run of the deck."""
    cards = deck()
    place = {entry.key: at for at, entry in enumerate(cards)}
    near = total = 0
    for seed in range(60):
        line, last = store.sequence(cards, seed), None
        taken: list[int] = []
        for _ in range(20):
            last = store.following(line, last)
            assert last is not None
            line.remove(last)
            taken.append(place[last.key])
        near += sum(abs(a - b) <= 2 for a, b in itertools.pairwise(taken))
        total += len(taken) - 1
    assert near / total < 0.03  # 0.54 when the list was shuffled again after each rating


def test_a_clock_that_ran_backwards_holds_no_card_back() -> None:
    ahead, reviews = NOON + timedelta(days=4000), store.Reviews()
    store.rate(None, ONE, 4, ahead, reviews)
    assert store.due([ONE], reviews, NOON) == [ONE]
    _, report = store.rate(None, ONE, 3, NOON, reviews)
    state = reviews.cards[ONE.key]
    assert "clock was ahead" in report[0] and store.due([ONE], reviews, NOON) == []
    assert NOON < datetime.fromisoformat(state["due"]) < NOON + timedelta(days=100)
    assert [one["rating"] for one in reviews.log] == [4, 3]


@pytest.mark.parametrize("rating", [0, 5, True, 2.0, "3", None])
def test_an_unknown_rating_is_refused_and_nothing_changes(rating: int, tmp_path: Path) -> None:
    path = tmp_path / "reviews.json"
    store.rate(path, ONE, 3, NOON)
    before = path.read_bytes()
    with pytest.raises(ValueError, match=r"rating must be .*1 \(again\)"):
        store.rate(path, ONE, rating, NOON)
    with pytest.raises(ValueError, match="a time with its zone"):
        store.rate(path, ONE, 3, NOON.replace(tzinfo=None))
    assert path.read_bytes() == before


# --- The file -------------------------------------------------------------------------------------


def test_what_was_rated_is_read_again_and_a_lost_source_stays(tmp_path: Path) -> None:
    path = store.beside(tmp_path / "progress.json")
    assert path == tmp_path / "reviews.json" and store.beside(None) is None
    store.rate(path, ONE, 3, NOON)
    after, _ = store.rate(path, TWO, 1, NOON)
    read, report = store.load(path)
    assert read == after and report == () and set(read.cards) == {ONE.key, TWO.key}
    assert store.missing_cards([ONE], read) == [TWO.key]
    assert set(store.rate(path, ONE, 4, NOON)[0].cards) == {ONE.key, TWO.key}


BROKEN = {
    "rating": ("log", 0, "rating", 7),
    "when": ("log", 0, "when", "2026-05-04T12:00:00"),
    "card": ("log", 0, "card", 3),
    "state": ("cards", ONE.key, "state", 4),
    "difficulty": ("cards", ONE.key, "difficulty", float("nan")),
    "due": ("cards", ONE.key, "due", None),
    "step": ("cards", ONE.key, "step", None),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_damaged_file_is_put_aside(what: str, tmp_path: Path) -> None:
    path = tmp_path / "reviews.json"
    store.rate(path, ONE, 3, NOON)
    content = json.loads(path.read_text())
    part, place, name, value = BROKEN[what]
    content[part][place][name] = value
    path.write_text(broken := json.dumps(content))
    reviews, report = store.load(path)
    assert reviews == store.Reviews() and "damaged" in report[0]
    assert (tmp_path / "reviews.json.damaged-1").read_text() == broken


def test_two_terminals_at_once_lose_nothing(tmp_path: Path) -> None:
    """Two processes, started together, that rate the same two cards."""
    path, count = tmp_path / "reviews.json", 15
    program = f"""
import sys
from datetime import UTC, datetime
from pathlib import Path
from drills.interview import store
from drills.interview.deck import Entry
import fsrs
print("ready", flush=True)
sys.stdin.readline()
for turn in range({count}):
    entry = Entry("claim/" + "one two".split()[turn % 2], "claim", 1)
    store.rate(Path({str(path)!r}), entry, int(sys.argv[1]), datetime.now(UTC))
"""
    both = [
        subprocess.Popen(
            [sys.executable, "-c", program, rating],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for rating in "23"
    ]
    for process in both:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
    for process in both:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    assert [process.wait(timeout=300) for process in both] == [0, 0]
    for process in both:
        process.communicate()
    log = store.load(path)[0].log
    assert sorted(one["rating"] for one in log) == [2] * count + [3] * count


# --- The command ----------------------------------------------------------------------------------


def one_kind(kind: str, monkeypatch: pytest.MonkeyPatch, name: str = "") -> Entry:
    """The deck is one card of that kind."""
    entry = next(e for e in deck() if e.kind == kind and name in e.key)
    monkeypatch.setattr(review, "deck", lambda chosen=None: [entry])
    return entry


@pytest.mark.parametrize(("right", "rating"), [(True, 3), (False, 1)])
@pytest.mark.parametrize("kind", ["claim", "formula"])
def test_a_judged_card_is_rated_by_a_blank_line(
    kind: str, right: bool, rating: int, place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    entry = one_kind(kind, monkeypatch)
    if kind == "claim":
        verdict = records.load(entry.file)[entry.name]["verdict"]
        text = next(k for k, v in VERDICTS.items() if (v == verdict) == right)
    else:
        text = formula(entry.name).expression if right else next(iter(formula(entry.name).slips))
    result = place.json("review", "--limit", "1", text=f"{text}\n\n")
    assert [(one["right"], one["rating"]) for one in result["rated"]] == [(right, rating)]
    assert [one["rating"] for one in store.load(place.work / "reviews.json")[0].log] == [rating]
    assert result["new"] == 0 and result["rated"][0]["card"] == entry.key


@pytest.mark.slow
def test_the_grader_rates_a_drill(place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing written, wrong, then right: known, but hard. Wrong and given up: again."""
    one_kind("drill", monkeypatch, "fk3")
    right = catalogue.card("fk3").solution_text()
    starter = place.json("review", text="g\n\n2\n")
    assert [(one["right"], one["rating"]) for one in starter["rated"]] == [(None, 2)]
    path = place.answer("def fk3(lengths, thetas):\n    return 0.0\n", "fk3")
    (place.work / "reviews.json").unlink()
    text = iter(["g", "", "", "g", "g", ""])
    received: list[str] = []

    def listen() -> str:
        received.append(line := next(text))
        if len(received) == 5:
            path.write_text(right, encoding="utf-8")
        return line

    for expected in ((False, 1), (True, 2)):
        session = Session("review", Terminal(True), place.work)
        turn = review.Round(session, listen, lambda: NOON)
        assert turn.run(frozenset([4]), 1, 0) == 0
        assert (turn.rated[0]["right"], turn.rated[0]["rating"]) == expected
        assert turn.rated[0]["due"] < (NOON + timedelta(minutes=20)).isoformat()
        (place.work / "reviews.json").unlink()


def test_cards_of_opened_chapters_come_first(place: Place) -> None:
    def chapters(*options: str) -> set[int]:
        data = place.json("review", "--limit", "8", "--seed", "1", *options, text="\n3\n" * 20)
        return {one["chapter"] for one in data["rated"]}

    assert len(chapters()) > 2
    (place.work / "reviews.json").unlink()
    place.run("read", "5", "1")
    assert chapters() == {5}
    assert 3 in chapters("--chapters", "3,5")  # chapters that are named are wanted alike


@pytest.mark.parametrize(
    ("tex", "text"),
    [
        (r"0\le f\perp\phi\ge0", "0 ≤ f ⊥ φ ≥ 0"),
        (r"\omega h < 2", "ω h < 2"),
        (r"2 \sqrt{D/a}", "2 √(D/a)"),
        (r"\frac{1}{\sqrt{x^2+1}}", "1/(√(x²+1))"),
        (r"\ddot e + K_d\dot e + K_p e", "e'' + K_d e' + K_p e"),
        (r"\lVert f_t\rVert\le\mu f_n", "|f_t| ≤ μ f_n"),
        (r"x = l_1\cos q_1 + s_{\min}", "x = l_1 cos q_1 + s_min"),
        (r"J^\mathsf{T}e + 10^{-6} (2^{1/n} - 1)", "J^T e + 10⁻⁶ (2^(1/n) - 1)"),
    ],
)
def test_a_formula_is_readable_in_a_terminal(tex: str, text: str) -> None:
    assert plain_math.formula(tex) == text
    assert plain_math.readable(f"Say ${tex}$ and `$x$`.").endswith(" and `$x$`.")


@pytest.mark.prove
def test_no_card_or_question_shows_tex_in_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    terminal = Terminal()
    shown = [entry for entry in deck() if entry.kind == "question"]
    formulas = 0
    for entry in shown:
        text = f"{sides(entry).front}\n\n{sides(entry).back}"
        formulas += "$" in text
        lines = markdown_lines(text, terminal)
        code = re.findall(r"`([^`]*)`", text)
        written = to_ascii("\n".join(lines))
        for line in code:
            written = written.replace(line, "")
        assert "$" not in written and "\\" not in written, entry.key
    assert formulas > 20


def test_the_end_of_input_keeps_what_was_said_and_a_wrong_rating_is_asked_again(
    place: Place,
) -> None:
    text = "\nseven\n\n5\n2\nskip\n\n3\n\n"
    done = place.run("review", "--seed", "5", "--chapters", "0,12", text=text)
    assert (
        done.code == 0 and "'seven' is not a rating" in done.out and "rated 2 cards" in done.out
    ), done
    assert "Rate this card. Type 1 again" in done.out  # a blank line has no meaning here
    log = store.load(place.work / "reviews.json")[0].log
    assert [one["rating"] for one in log] == [2, 3] and len({one["card"] for one in log}) == 2
    again = place.json("review", "--seed", "5", "--chapters", "0,12", text="quit\n")
    assert again["rated"] == [] and again["new"] == len(deck([0, 12])) - 2


def test_what_cannot_be_kept_is_said_once_and_the_round_goes_on(place: Place) -> None:
    place.work.mkdir()
    (place.work / "reviews.json").mkdir()
    some = ("review", "--chapters", "0", "--seed", "1")
    result = place.json(*some, "--limit", "2", text="\n3\n\n3\n\n3\n")
    assert len(result["rated"]) == 2 and result["reviews_file"] is None
    (notice,) = result["notices"]
    assert "reviews.json can't be read: is a directory" in notice
    kept_none = place.json(*some, "--limit", "1", text="\n3\n", DRILLS_PROGRESS="none")
    assert kept_none["reviews_file"] is None and len(kept_none["rated"]) == 1


def test_a_source_that_vanished_is_told_and_kept(place: Place) -> None:
    lost = Entry("claim/no_longer_there", "claim", 1)
    store.rate(place.work / "reviews.json", lost, 3, NOON)
    result = place.json("review", "--chapters", "0", "--limit", "1", text="\n3\n\n3\n")
    assert result["gone"] == [lost.key] and "no longer in the course: 1" in result["notices"][0]
    assert lost.key in store.load(place.work / "reviews.json")[0].cards


def test_a_pipe_of_80_columns_in_ascii(place: Place) -> None:
    arguments = ("review", "--seed", "2", "--chapters", "4,12", "--limit", "12")
    done = place.run(*arguments, text="\n3\n" * 30, LC_ALL="C", NO_COLOR="1")
    assert done.code == 0 and "rated 12 cards" in done.out, done
    assert done.out.isascii() and "\x1b" not in done.out
    assert max(map(len, done.out.splitlines())) <= 80


def test_without_fsrs_one_sentence_says_what_is_missing(
    place: Place, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "fsrs", None)
    done = place.run("review", text="\n3\n")
    assert done.code == 3 and done.out == ""
    assert done.err.startswith("The package fsrs is not installed") and "make setup" in done.err


def test_drills_and_its_help_import_nothing_of_it(tmp_path: Path) -> None:
    program = (
        "import sys; from drills.cli import cli\n"
        "for said in ([], ['--help']): cli.main(said, standalone_mode=False)\n"
        "new = ('drills.interview', 'course.interview', 'course.derivations', 'fsrs', 'numpy')\n"
        "print([name for name in sys.modules if name.startswith(new)])"
    )
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert "interview" in done.stdout and done.stdout.splitlines()[-1] == "[]", done.stderr
