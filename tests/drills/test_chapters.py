"""The learner's copies of the notebooks: nothing that was written is lost, nothing is half new."""

import copy
import dataclasses
import functools
import http.server
import importlib.machinery
import json
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import pytest
from hypothesis import given
from hypothesis import strategies as st

import course.cards
from course import CHAPTERS, derivations
from drills import agenda, cards, chapters, progress
from drills import notebook as page_home
from drills.chapters import Copy, bring, merge
from drills.progress import Loaded, Reading, Record
from drills.workspace import ROOT, Misuse
from tools import form, notebooks

pytestmark = pytest.mark.smoke


def cell(source: str, kind: str = "code", name: str | None = None) -> dict[str, Any]:
    made: dict[str, Any] = {"cell_type": kind, "id": name or f"id-{source}"[:20]}
    made |= {"metadata": {}, "source": source}
    return made | ({"execution_count": 1, "outputs": []} if kind == "code" else {})


def built(*sources: str) -> list[dict[str, Any]]:
    """The cells of a build: an id changes with the place, as it does in the real one."""
    return [cell(source, name=f"id-{place}-{hash(source)}") for place, source in enumerate(sources)]


def texts(cells: list[dict[str, Any]]) -> list[str]:
    return [one["source"] if not is_note(one) else "NOTE" for one in cells]


def is_note(one: dict[str, Any]) -> bool:
    return "Kept from your copy" in one["source"]


def changed(cells: list[dict[str, Any]], place: int, source: str) -> list[dict[str, Any]]:
    return [{**one, "source": source} if n == place else one for n, one in enumerate(cells)]


# --- Three versions -------------------------------------------------------------------------------


def test_what_was_not_touched_becomes_new() -> None:
    base, new = built("a", "b", "c"), built("a", "B", "x", "c")
    assert merge(base, base, new) == (new, 0)


def test_an_answer_stays_and_the_rest_becomes_new() -> None:
    base, new = built("text", "answer", "end"), built("first", "new text", "answer", "end")
    mine = changed(base, 1, "answer = 42")
    merged, both = merge(base, mine, new)
    assert texts(merged) == ["first", "new text", "answer = 42", "end"] and both == 0
    assert merged[2]["id"] == new[2]["id"]  # so that the version after next finds it as well


def test_an_added_cell_stays_behind_its_neighbour() -> None:
    base, new = built("a", "b", "c"), built("a", "c", "d")
    mine = [cell("top"), base[0], cell("mine"), base[1], cell("more"), base[2], cell("last")]
    assert texts(merge(base, mine, new)[0]) == ["top", "a", "mine", "more", "c", "last", "d"]


def test_a_cell_that_both_changed_is_there_twice_and_said_so() -> None:
    base, new = built("a", "b", "c"), built("a", "b of the course", "c")
    merged, both = merge(base, changed(base, 1, "b of mine"), new)
    assert texts(merged) == ["a", "b of the course", "NOTE", "b of mine", "c"] and both == 1


def test_an_answer_to_a_cell_that_is_gone_stays() -> None:
    base, new = built("a", "b", "c"), built("a", "c")
    merged, both = merge(base, changed(base, 1, "b of mine"), new)
    assert texts(merged) == ["a", "NOTE", "b of mine", "c"] and both == 1


def test_the_same_change_on_both_sides_is_no_conflict() -> None:
    base, new = built("a", "b"), built("a", "better")
    assert texts(merge(base, changed(base, 1, "better"), new)[0]) == ["a", "better"]


def test_a_cell_that_the_learner_removed_stays_away() -> None:
    base, new = built("a", "b", "c"), built("a", "b", "c", "d")
    assert texts(merge(base, [base[0], base[2]], new)[0]) == ["a", "c", "d"]


def test_an_editor_that_gives_new_ids_loses_nothing() -> None:
    base, new = built("a", "b", "c"), built("new", "b", "c", "d")
    mine = [{**one, "id": f"other-{n}"} for n, one in enumerate(changed(base, 1, "mine"))]
    assert texts(merge(base, mine, new)[0]) == ["new", "mine", "c", "d"]


words = st.lists(st.sampled_from("abcdefg"), max_size=7)


@given(words, words, words, st.data())
def test_nothing_that_the_learner_wrote_is_lost(old, newer, newest, data) -> None:
    """Whatever is edited, added, removed and moved, through two newer versions."""
    base = built(*old)
    mine = copy.deepcopy(base)
    for number in range(data.draw(st.integers(0, 4))):
        mine.insert(data.draw(st.integers(0, len(mine))), cell(f"mine {number}"))
    for place in range(len(mine)):
        if data.draw(st.booleans()):
            mine[place]["source"] += f" edited {place}"
    mine = data.draw(st.permutations(mine))
    written = {one["source"] for one in mine if "mine" in one["source"] or "ed" in one["source"]}
    new = built(*newer)
    merged, _ = merge(base, mine, new)
    last = built(*newest)
    for result in (merged, merge(new, merged, last)[0]):
        assert written <= {one["source"] for one in result}
        assert len({one["id"] for one in result}) == len(result)
    untouched = merge(base, base, new)[0]
    assert texts(untouched) == newer


# --- Files ----------------------------------------------------------------------------------------


def notebook(folder: Path, *sources: str) -> Path:
    """A notebook of the course in `folder/notebooks`."""
    path = folder / "notebooks" / "01_rigid_body.ipynb"
    path.parent.mkdir(parents=True, exist_ok=True)
    cells = built(*sources)
    cells[0] |= {"cell_type": "markdown"}
    del cells[0]["outputs"], cells[0]["execution_count"]
    book = {"cells": cells, "metadata": {}, "nbformat": 4, "nbformat_minor": 5}
    path.write_text(chapters.written(book), encoding="utf-8")
    return path


def answer(path: Path, place: int, text: str) -> None:
    """Edit a cell as JupyterLab does, which keeps what it doesn't know."""
    book = nbformat.read(path, as_version=4)
    book.cells[place].source = text
    nbformat.write(book, path)


def sources(path: Path) -> list[str]:
    book = nbformat.read(path, as_version=4)
    nbformat.validate(book)
    return texts(book.cells)


def closed(path: Path) -> bool:
    return False


def test_a_copy_is_made_kept_and_brought_up_to_date(tmp_path: Path) -> None:
    source, work = notebook(tmp_path, "title", "answer", "end"), tmp_path / "work"
    before = source.read_bytes()
    assert bring(source, work, closed).state == "made"
    copied = work / source.name
    answer(copied, 1, "answer = 42")
    assert bring(source, work, closed) == Copy(copied, "as it was")
    assert source.read_bytes() == before
    notebook(tmp_path, "new title", "answer", "end")
    done = bring(source, work, closed)
    assert done.state == "brought up to date" and "all you wrote is in it" in done.sentence()
    assert sources(copied) == ["new title", "answer = 42", "end"]
    notebook(tmp_path, "new title", "another task", "end")
    assert bring(source, work, closed).preserved == 1
    assert sources(copied) == ["new title", "another task", "NOTE", "answer = 42", "end"]
    assert bring(source, work, closed).state == "as it was"
    assert sorted(one.name for one in work.iterdir()) == [".course", source.name]


def test_what_an_open_page_saves_afterwards_is_not_lost(tmp_path: Path) -> None:
    source, work = notebook(tmp_path, "title", "answer"), tmp_path / "work"
    copied = bring(source, work, closed).path
    page = copied.read_bytes()  # still open in a browser
    notebook(tmp_path, "new title", "answer")
    bring(source, work, closed)
    copied.write_bytes(page)
    answer(copied, 1, "written late")
    assert bring(source, work, closed).state == "brought up to date"
    assert sources(copied) == ["new title", "written late"]


def test_a_copy_that_is_open_is_left_alone(tmp_path: Path) -> None:
    source, work = notebook(tmp_path, "title", "answer"), tmp_path / "work"
    copied = bring(source, work, closed).path
    before = copied.read_bytes()
    assert bring(source, work, lambda path: True).state == "as it was"
    notebook(tmp_path, "new title", "answer")
    done = bring(source, work, lambda path: path == copied)
    assert done.state == "open" and "shut its kernel down" in done.sentence()
    assert copied.read_bytes() == before


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"\xff\xfe", b'{"cells": []}', b'{"cells": [], "metadata": 3}']
)
def test_what_the_course_does_not_know_is_set_aside(tmp_path: Path, content: bytes) -> None:
    source, work = notebook(tmp_path, "title", "answer"), tmp_path / "work"
    work.mkdir()
    for number in (1, 2):
        (work / source.name).write_bytes(content)
        done = bring(source, work, closed)
        aside = work / f"01_rigid_body.preserved-{number}.ipynb"
        assert (done.state, done.aside) == ("set aside", aside)
        assert aside.read_bytes() == content and str(aside) in done.sentence()
        assert sources(work / source.name) == ["title", "answer"]


def test_a_copy_whose_origin_is_gone_is_set_aside(tmp_path: Path) -> None:
    source, work = notebook(tmp_path, "title", "answer"), tmp_path / "work"
    copied = bring(source, work, closed).path
    answer(copied, 1, "answer = 42")
    for base in (work / ".course").iterdir():
        base.unlink()
    assert bring(source, work, closed).state == "as it was"
    notebook(tmp_path, "new title", "answer")
    done = bring(source, work, closed)
    assert done.aside is not None and sources(done.aside) == ["title", "answer = 42"]


def test_a_save_in_the_last_moment_counts(tmp_path: Path) -> None:
    """The page saves while the newer version is being brought in."""
    source, work = notebook(tmp_path, "title", "answer"), tmp_path / "work"
    copied = bring(source, work, closed).path
    notebook(tmp_path, "new title", "answer")
    requested: list[Path] = []

    def saved_meanwhile(path: Path) -> bool:
        if not requested:
            answer(path, 1, "just saved")
        requested.append(path)
        return False

    assert bring(source, work, saved_meanwhile).state == "brought up to date"
    assert sources(copied) == ["new title", "just saved"] and len(requested) == 2


def test_a_full_disk_leaves_the_old_copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source, work = notebook(tmp_path, "title", "answer"), tmp_path / "work"
    copied = bring(source, work, closed).path
    before = copied.read_bytes()
    notebook(tmp_path, "new title", "answer")

    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(Misuse, match="No space left"):
            bring(source, work, closed)
    assert copied.read_bytes() == before
    assert not [one for one in work.rglob("*") if one.suffix == ".part"]
    assert bring(source, work, closed).state == "brought up to date"


def test_links_lead_to_the_same_place_or_are_titles(tmp_path: Path) -> None:
    text = '![A chart](../docs/a.png) <img src="../docs/b.png"> [next](02_contact.ipynb)'
    source = notebook(tmp_path / "project", text, "answer")
    inside = bring(source, tmp_path / "project" / "work", closed).path
    assert sources(inside)[0] == text
    outside = bring(source, tmp_path / "mine" / "deep", closed).path
    missing = "*A chart (the picture is in the project's tree)*"
    other = text.replace("![A chart](../docs/a.png)", missing).replace(
        "../docs", "../../project/docs"
    )
    assert sources(outside)[0] == other


@pytest.mark.slow
def test_every_picture_of_the_course_is_found_from_a_copy(tmp_path: Path) -> None:
    for source in sorted((ROOT / "notebooks").glob("*.ipynb")):
        copied = bring(source, tmp_path / "work", closed).path
        for one in nbformat.read(copied, as_version=4).cells:
            if one.cell_type == "markdown":
                for link in chapters._UPWARD.finditer(one.source):
                    rest = one.source[link.end() - len("../") :].split(")")[0].split('"')[0]
                    assert (copied.parent / rest).exists(), rest


# --- What is open ---------------------------------------------------------------------------------


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """A Jupyter server with these notebooks open, in `tmp_path`."""
    opened: list[str] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            known = self.path == "/base/api/sessions?token=secret"
            self.send_response(200 if known else 403)
            self.end_headers()
            self.wfile.write(json.dumps([{"path": path} for path in opened]).encode())

        def log_message(self, format: str, *arguments: object) -> None:
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as web:
        threading.Thread(target=web.serve_forever, daemon=True).start()
        runtime = tmp_path / "runtime"
        runtime.mkdir()
        monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(runtime))
        message = {"url": f"http://127.0.0.1:{web.server_port}/base/", "token": "secret"}
        message["root_dir"] = str(tmp_path)
        (runtime / "jpserver-1.json").write_text(json.dumps(message))
        (runtime / "jpserver-2.json").write_text(json.dumps({**message, "url": "http://[::1]:9/"}))
        (runtime / "jpserver-3.json").write_text("half a fi")
        yield opened
        web.shutdown()


def test_an_open_notebook_is_known_from_the_servers(tmp_path: Path, server: list[str]) -> None:
    path = tmp_path / "work" / "01_rigid_body.ipynb"
    assert not chapters.open_in_jupyter(path)
    server += ["work/02_contact.ipynb", "work/01_rigid_body.ipynb"]
    assert chapters.open_in_jupyter(path)
    assert not chapters.open_in_jupyter(tmp_path / "other" / "01_rigid_body.ipynb")


# --- Reading time and what is next ----------------------------------------------------------------


def test_reading_time_is_that_of_the_open_text(tmp_path: Path) -> None:
    folded = f"<details><summary>Proof</summary>\n\n{'word ' * 500}\n\n</details>"
    parts = ["# Title\n\n" + "word " * 179, "## 1 · Concept\n\n" + "word " * 178, "show('x')"]
    parts += ["## 2 · Code\n\nwords\n\n" + folded]
    path = notebook(tmp_path, *parts)
    book = json.loads(path.read_text())
    for place in (1, 3):
        book["cells"][place]["cell_type"] = "markdown"
    path.write_text(json.dumps(book))
    first, second = chapters.sections(path)
    assert (first.number, first.title) == (1, "Concept")
    assert first.minutes == pytest.approx(360 / 150 + 0.5)  # words, and a card of 30 s
    assert (second.number, second.minutes, second.about) == (2, pytest.approx(3 / 150), 1)
    assert chapters.sections(tmp_path / "nowhere.ipynb") == []


def test_the_sections_take_the_time_that_the_first_screen_says() -> None:
    for source in notebooks.sources():
        if parts := chapters.sections(notebooks.target(source)):
            whole = sum(part.minutes for part in parts)
            text = form.reading(nbformat.read(notebooks.target(source), 4).cells)["open"]
            assert whole - 1e-9 <= text < whole + 1


def test_what_is_next_follows_the_chapters_and_what_was_tried() -> None:
    every = list(cards.cards())
    assert agenda.to_solve(Loaded(), every) == every
    later, last = every[3], every[-1]
    records = {
        every[0].name: Record("solved"),
        later.name: Record("attempted", last="2026-01-01"),
        last.name: Record("attempted", last="2026-01-02"),
    }
    remaining = agenda.to_solve(Loaded(records), every)
    assert remaining[0] == last
    assert remaining[1:] == [card for card in every[1:] if card != last]


def test_what_is_left_is_the_sum_of_the_cards_and_of_the_unread() -> None:
    one = next(row for row in agenda.standings(Loaded()) if row.sections)
    number = one.chapter.number
    assert one.exercise_minutes == sum(c.minutes for c in cards.cards() if c.chapter == number)
    assert one.reading_minutes == round(sum(part.minutes for part in one.sections))
    solved, read = one.cards[0], one.sections[0]
    loaded = Loaded({solved.name: Record("solved")}, {number: Reading(read=[read.number])})
    after = next(row for row in agenda.standings(loaded) if row.chapter == one.chapter)
    assert after.exercise_minutes == one.exercise_minutes - solved.minutes
    assert after.unread == one.sections[1:]
    where = agenda.to_read(loaded, agenda.standings(loaded))
    assert where == (one.chapter, one.sections[1])
    everything = {
        row.chapter.number: Reading(read=[part.number for part in row.sections])
        for row in agenda.standings(Loaded())
    }
    assert agenda.to_read(Loaded({}, everything), agenda.standings(Loaded({}, everything))) is None


def test_reading_is_kept_beside_the_exercises(tmp_path: Path) -> None:
    file = tmp_path / "progress.json"
    progress.change(file, "fk3", lambda r: progress.note_attempt(r, True, {}))
    progress.change_chapter(file, 1, lambda r: progress.note_read(r, [3, 1, 3]))
    progress.change_chapter(file, 1, progress.note_checkpoint)
    progress.change(file, "rrt", lambda r: progress.note_attempt(r, True, {}))
    loaded = progress.load(file)
    assert loaded.of("fk3").state == "solved" and loaded.reading(1).read == [1, 3]
    passed = loaded.reading(1).checkpoint
    assert passed and loaded.reading(2) == Reading()
    progress.change_chapter(file, 1, lambda r: progress.note_read(r, [1], undo=True))
    progress.forget(file, "fk3")
    loaded = progress.load(file)
    assert (loaded.reading(1).read, loaded.reading(1).checkpoint) == ([3], passed)
    assert list(loaded.records) == ["rrt"]


@pytest.mark.parametrize(
    "entry", ['{"a": {}}', '{"1": 3}', '{"1": {"read": 1}}', '{"1": {"read": ["x"]}}', "[]"]
)
def test_a_damaged_chapter_is_a_damaged_file(tmp_path: Path, entry: str) -> None:
    file = tmp_path / "progress.json"
    head = f'"schema": "{progress.SCHEMA}", "exercises": {{}}'
    file.write_text(f'{{{head}, "chapters": {entry}}}')
    assert "damaged-1" in progress.load(file).notices[0]


# --- The home page --------------------------------------------------------------------------------


def test_a_chapter_to_come_is_named_with_those_that_are_ready(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, *others = CHAPTERS
    planned = dataclasses.replace(first, ready=False)
    monkeypatch.setattr(chapters, "CHAPTERS", (planned, *others))
    with pytest.raises(
        Misuse, match=rf"{first.title}, is still to come\. Ready: {others[0].number},"
    ):
        chapters.of_number(first.number)
    assert chapters.of_number(others[0].number) is others[0]


@pytest.fixture
def progress_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    file = tmp_path / "progress.json"
    monkeypatch.setenv("DRILLS_PROGRESS", str(file))
    return file


def test_the_home_page_says_where_to_go_on_and_what_is_left(progress_file: Path) -> None:
    page = page_home.home()._repr_mimebundle_()["text/markdown"]
    standing = agenda.standings(Loaded())
    one = next(row for row in standing if row.sections)
    part, number = one.sections[0], one.chapter.number
    link = one.chapter.notebook.removeprefix("notebooks/")
    assert f"[chapter {number}, section {part.number}: {part.title}]({link})" in page
    assert f"`{cards.cards()[0].name}`" in page and "○" * len(one.cards) in page
    other = sum(row.exercise_minutes for row in standing if row.sections)
    assert f"{agenda.duration(other)} to solve" in page
    progress.change(progress_file, one.cards[0].name, lambda r: progress.note_attempt(r, True, {}))
    progress.change_chapter(progress_file, number, lambda r: progress.note_read(r, [part.number]))
    topic = one.chapter.topic
    right: dict[str, Any] = {
        name: derivations.formula(name).expression for name in course.cards.gate(topic)
    }
    assert not page_home.checkpoint(topic, **right | {next(iter(right)): "1"}).passed
    assert not progress.load(progress_file).reading(number).checkpoint
    assert page_home.checkpoint(topic, **right).passed
    page = page_home.home()._repr_mimebundle_()["text/markdown"]
    assert f"section {one.sections[1].number}: {one.sections[1].title}]" in page
    assert "●" in page and f"| 1 of {len(one.sections)} sections |" in page
    row = next(line for line in page.splitlines() if line.startswith(f"| {number} |"))
    assert "passed on" in row and agenda.duration(one.exercise_minutes) not in row
    assert "](" not in repr(page_home.home())


def test_the_chapter_that_was_opened_last_goes_on(progress_file: Path) -> None:
    first, second = [row for row in agenda.standings(Loaded()) if row.sections][:2]
    page_home.badges(number := second.chapter.number)
    loaded = progress.load(progress_file)
    assert loaded.reading(number).opened and not loaded.records
    where = agenda.to_read(loaded, [first, second])
    assert where is not None and where[0].number == number


@pytest.mark.slow
def test_a_click_marks_a_section_as_read(progress_file: Path) -> None:
    shown = page_home.ticks()
    assert isinstance(shown, page_home.Ticks)
    number = next(chapter.number for chapter in CHAPTERS if chapter.ready)
    parts = chapters.sections(chapters.notebook_of(chapters.of_number(number)))
    assert list(shown.boxes) == [part.number for part in parts]
    before = shown.status.value
    shown.boxes[2].value = True
    assert progress.load(progress_file).reading(number).read == [2]
    assert f"{len(parts) - 1} of {len(parts)} sections left" in shown.status.value != before
    again = page_home.ticks(number)
    assert isinstance(again, page_home.Ticks) and again.boxes[2].value
    again.boxes[2].value = False
    assert progress.load(progress_file).reading(number).read == []
    bundle = shown._repr_mimebundle_()
    assert "application/vnd.jupyter.widget-view+json" in bundle
    assert bundle["text/plain"].startswith(f"The sections of chapter {number}")
    for chapter in CHAPTERS:
        if chapter.ready:
            parts = chapters.sections(chapters.notebook_of(chapter))
            note = functools.partial(progress.note_read, numbers=[part.number for part in parts])
            progress.change_chapter(progress_file, chapter.number, note)
    assert repr(page_home.ticks()) == "Every section is read."


def test_an_answer_beside_a_notebook_hides_no_module() -> None:
    """A kernel looks for modules in its notebook's folder first."""
    outside = [path for path in sys.path if path and not Path(path).is_relative_to(ROOT / "work")]
    for name in cards.names():
        assert importlib.machinery.PathFinder.find_spec(name, outside) is None, name
        assert name not in sys.stdlib_module_names
