"""The form of the chapters: explain, ask, show. What is counted, and that it is kept."""

import re
from collections import Counter
from pathlib import Path

import jupytext
import nbformat
import pytest

import course
from course import CHAPTERS, DIMENSIONS, cards, derivations
from course.derivations import records
from course.site.notebooks import without_kernel
from drills import cards as catalogue
from tools import form, notebooks

BUILT = {
    source.stem: nbformat.read(notebooks.target(source), as_version=4)
    for source in notebooks.sources()
}
CHAPTER = {f"{chapter.number:02d}_{chapter.topic}": chapter.topic for chapter in CHAPTERS}
WRITTEN = sorted(set(BUILT) & set(CHAPTER))
SOURCES = {
    line
    for path in Path(course.__file__).parent.rglob("*.py")
    for line in path.read_text(encoding="utf-8").splitlines()
}
BOXES = {
    "Interview question": "info",
    "Interview tip": "success",
    "Debugging tip": "danger",
    "Key insight": "warning",
}


def limits(name: str) -> form.Limits:
    """Return the limits of a notebook."""
    return form.SHORT if CHAPTER.get(name) in ("role", "interview") else form.LIMITS


def visible_text(name: str) -> list[str]:
    """What a reader of a notebook sees as text, in order: its prose and its cards."""
    texts = []
    for cell in BUILT[name].cells:
        if cell.cell_type == "markdown":
            texts.append(cell.source)
            continue
        for output in cell.get("outputs", []):
            texts.append(output.get("data", {}).get("text/markdown", ""))
    return texts


# --- Every notebook -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(BUILT))
def test_outputs_and_paragraphs_are_short(name: str) -> None:
    assert form.faults(BUILT[name].cells, limits(name)) == []


@pytest.mark.parametrize("name", sorted(BUILT))
def test_no_output_shows_an_unfilled_field(name: str) -> None:
    """A field such as {claim.figure} is filled; code that is listed may have some."""
    for cell in BUILT[name].cells:
        if cell.cell_type == "markdown":
            assert form.unfilled(cell.source) == []
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            kinds = ("text/markdown",) if "text/markdown" in data else ("text/plain", "text/html")
            for text in (output.get("text", ""), *(data.get(kind, "") for kind in kinds)):
                assert form.unfilled(str(text)) == []


@pytest.mark.parametrize("name", sorted(BUILT))
def test_a_function_that_is_shown_is_the_one_that_is_imported(name: str) -> None:
    """Below its first line, which a page may shorten, a listing has the lines of the module."""
    for cell in BUILT[name].cells:
        if "getsource(" not in cell.source:
            continue
        for output in cell.get("outputs", []):
            text = output.get("data", {}).get("text/markdown", "")
            for listing in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
                assert [line for line in listing.splitlines()[1:] if line not in SOURCES] == []


@pytest.mark.parametrize("name", sorted(BUILT))
def test_no_claim_on_a_page_disagrees_with_its_record(name: str) -> None:
    """A page is compared with itself; a card that disagreed when it was built would stay so."""
    assert "DISAGREES" not in nbformat.writes(BUILT[name])


@pytest.mark.parametrize("name", sorted(BUILT))
def test_what_needs_a_kernel_is_not_on_the_site(name: str) -> None:
    for cell in BUILT[name].cells:
        if cell.cell_type == "code" and "remove-input" in cell.metadata.get("tags", ()):
            continue
        if cell.source.startswith("## Where you are"):
            continue  # not on the site
        observed = without_kernel(cell.source) if cell.cell_type == "markdown" else cell.source
        for words in ("run the cell", "run all cells", "change me", "change the text"):
            assert words not in " ".join(observed.lower().split())


def test_every_claim_of_the_course_stands_on_a_page() -> None:
    missing = {chapter: cards.unplaced(chapter.topic) for chapter in CHAPTERS}
    assert [
        f'put more_claims("{id}") into the source of the notebook, then '
        f"python -m tools.notebooks {chapter.number:02d}_{chapter.topic}"
        for chapter, ids in missing.items()
        for id in ids
    ] == []


def test_no_claim_stands_twice_on_a_page() -> None:
    for name in WRITTEN:
        source = notebooks.FOLDER.joinpath("source", f"{name}.py").read_text(encoding="utf-8")
        folded = [
            id
            for call in re.findall(r"^more_claims\(([^()]*)\)", source, re.M)
            for id in re.findall(r'"(\w+)"', call)
        ]
        open_ = form.claim_cards(BUILT[name].cells)
        assert len(folded) == len(set(folded)) and not set(folded) & set(open_), name


# --- Every chapter --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", WRITTEN)
def test_the_first_screen_moves_and_asks(name: str) -> None:
    cells = BUILT[name].cells
    assert form.first_screen(cells) <= form.BEFORE_FIRST_PICTURE
    assert next(form.stretches(cells))[0] <= form.BEFORE_FIRST_PICTURE
    title = cells[0].source
    counted = re.search(
        r"About (\d+) minutes of reading, cards and charts\. "
        r"The folded parts add (\d+) minutes, the exercises (\d+) minutes\.",
        title.replace("\n", " "),
    )
    assert counted, "what the page says about its time"
    source = notebooks.FOLDER / "source" / f"{name}.py"
    minutes = form.reading(jupytext.read(source, fmt="py:percent").cells)
    shown = [int(n) for n in counted.groups()]
    assert shown[:2] == [minutes["open"], minutes["folded"]], (
        f"The first screen of {name} announces other minutes than its source has now. Run "
        f"`.venv/bin/python -m tools.notebooks {name}`."
    )


@pytest.mark.parametrize("name", WRITTEN)
def test_the_open_prose_is_bounded(name: str) -> None:
    least, longest = limits(name).prose
    words = form.open_words(BUILT[name].cells)
    assert least <= words <= longest, (
        f"{name} has {words} words of open prose, and tools/form.py allows {least} to {longest}. "
        "Cut what repeats, or move it into a fold-out."
    )


@pytest.mark.parametrize("name", WRITTEN)
def test_no_screen_is_without_a_picture_a_question_or_a_control(name: str) -> None:
    longest = limits(name).stretch
    assert [one for one in form.stretches(BUILT[name].cells) if one[0] > longest] == []


@pytest.mark.parametrize("name", WRITTEN)
def test_the_words_of_an_interviewer_are_defined_where_they_first_appear(name: str) -> None:
    vocabulary = cards.vocabulary(CHAPTER[name])
    assert len(vocabulary) >= 15
    texts = [
        re.sub(r'<details class="more-claims">.*', "", t, flags=re.S) for t in visible_text(name)
    ]
    assert form.undefined(texts, vocabulary) == []


@pytest.mark.parametrize("name", WRITTEN)
def test_a_checkpoint_is_not_answered_on_its_page(name: str) -> None:
    source = "\n".join(cell.source for cell in BUILT[name].cells)
    page = "\n".join([source, *visible_text(name)]).replace(" ", "")
    for claim in cards.gate(CHAPTER[name]):
        assert claim not in cards.placed_in(source)
        assert derivations.formula(claim).expression.replace(" ", "") not in page


@pytest.mark.parametrize("name", WRITTEN)
def test_no_answer_to_a_claim_is_right_by_habit(name: str) -> None:
    shown = form.claim_cards(BUILT[name].cells)
    assert len(shown) <= limits(name).claim_cards
    entries = {k: e for file in records.files() for k, e in records.load(file).items()}
    verdicts = Counter(entries[claim]["verdict"] for claim in shown)
    least = limits(name).true_share * len(shown)
    assert len(shown) < 6 or verdicts["holds"] >= least, verdicts
    assert len(shown) < 6 or max(verdicts.values()) <= 0.6 * len(shown), verdicts


@pytest.mark.parametrize("name", WRITTEN)
def test_the_question_comes_before_the_film(name: str) -> None:
    cells = BUILT[name].cells
    films = [place for place, cell in enumerate(cells) if "(attachment:" in cell.source]
    requested = [place for place, cell in enumerate(cells) if "question" in form.pauses(cell)]
    assert not films or requested[0] < films[0]


@pytest.mark.parametrize("name", WRITTEN)
def test_a_chapter_has_all_its_questions_and_key_insights(name: str) -> None:
    source = "\n".join(cell.source for cell in BUILT[name].cells)
    requested = re.findall(r'^\s*predict\("(\w+)"\)', source, re.M)
    assert sorted(requested) == sorted(cards.predictions(CHAPTER[name]))
    assert f'interview("{CHAPTER[name]}")' in source and "checkpoint(" in source
    assert "**Key insight.**" in source


@pytest.mark.parametrize("name", WRITTEN)
def test_exercises_are_listed_in_the_order_of_their_notebook(name: str) -> None:
    source = "\n".join(cell.source for cell in BUILT[name].cells)
    requested = re.findall(r'^card\("(\w+)"\)', source, re.M)
    listed = [one.name for one in catalogue.cards() if one.name in requested]
    assert requested == listed, "`place` in card.toml is the exercise's place in the notebook"


@pytest.mark.parametrize("name", WRITTEN)
def test_a_chapter_has_its_five_sides_and_its_neighbours(name: str) -> None:
    texts = [cell.source for cell in BUILT[name].cells if cell.cell_type == "markdown"]
    heads = re.findall(r"^## \d+ · (\w+):? ?", "\n".join(texts), re.M)
    assert {side.capitalize() for side in DIMENSIONS} <= set(heads)
    place, linked = WRITTEN.index(name), re.findall(r"\]\(([\w.]+)\)", texts[-1])
    before, behind = WRITTEN[max(place - 1, 0) : place], WRITTEN[place + 1 : place + 2]
    assert linked == [f"{stem}.ipynb" for stem in (*before, "index", *behind)]


@pytest.mark.parametrize("name", sorted(BUILT))
def test_a_box_is_one_of_four_and_says_which(name: str) -> None:
    text = "\n".join(cell.source for cell in BUILT[name].cells if cell.cell_type == "markdown")
    boxes = re.findall(r'<div class="alert alert-block alert-(\w+)">\s*\*\*([\w ]+)\.\*\*', text)
    assert len(boxes) == text.count('class="alert')
    assert [(colour, BOXES.get(title)) for colour, title in boxes] == [(c, c) for c, _ in boxes]


# --- What is counted ------------------------------------------------------------------------------


def markdown(text: str):
    return nbformat.v4.new_markdown_cell(text)


def code(source: str, *outputs):
    return nbformat.v4.new_code_cell(source, outputs=list(outputs))


def output(**data):
    bundle = {kind.replace("_", "/"): value for kind, value in data.items()}
    return nbformat.v4.new_output("display_data", data=bundle)


def stream(text: str):
    return nbformat.v4.new_output("stream", name="stdout", text=text)


PICTURE = code("plot()", output(image_png="x"))


def test_words_are_those_one_reads() -> None:
    text = (
        "Two words, $a = b$ and *one* more.\n\n![alt text](x.png)\n```python\nx = 1\n```\n<b>6</b>"
    )
    assert form.words(text) == 7
    hidden = "Seen <details><summary>Why</summary>a <details>b</details> c</details> too"
    assert form.opened(hidden).split() == ["Seen", "too"]
    assert form.open_words([markdown(hidden), code("not prose")]) == 2


def test_a_long_paragraph_is_a_fault_also_in_a_fold_out() -> None:
    long = "word " * 111
    for text in (long, f"<details>\n\n{long}\n\n</details>", f"* short\n* {long}"):
        assert len(form.faults([markdown(text)])) == 1
    short = "word " * 110
    assert form.faults([markdown(f"{short}\n\n{short}"), markdown(f"* {short}\n* {short}")]) == []
    table = f"| {short} | {short} |\n|---|---|\n"
    assert form.faults([markdown(table)]) == []


def test_a_formula_that_a_line_break_makes_a_list_is_a_fault() -> None:
    for text in ("a gap $a\n- b$ of", "so $x\n+ 1 > 0$, then $c$", "$c$ and $a\n> b$"):
        assert len(form.faults([markdown(text)])) == 1
    for text in ("a gap\n$a - b$ of", "for 5 \\$\n- and $b$", "$a$ and\n- a list $b$", "$$a\n$$"):
        assert form.faults([markdown(text)]) == []


def test_a_row_of_a_table_on_two_lines_is_a_fault() -> None:
    head = "| cause | fix |\n|---|---|\n"
    assert len(form.faults([markdown(f"{head}| threads | sort\nthe pairs |\n")])) == 1
    for text in (f"{head}| threads | sort the pairs |\n", "of $a$ given\n|b| or\nc"):
        assert form.faults([markdown(text)]) == []


def test_a_wide_or_long_output_is_a_fault() -> None:
    rows = "".join(f"row {n}\n" for n in range(7))
    folded = f"<details><summary>all</summary>\n\n```text\n{rows}\n```\n\n</details>"
    for cell in (
        code("", stream("x" * 97)),
        code("", stream(rows)),
        code("", output(text_plain=rows)),
        code("", output(text_plain="", text_markdown=f"```text\n{rows}```")),
    ):
        assert len(form.faults([cell])) == 1
    for cell in (
        code("", stream("x" * 96)),
        code("", stream("no figures\n" * 13)),
        code("", stream(rows[: rows.rindex("row")])),
        code("", output(text_plain=rows, image_png="x")),
        code("", output(text_plain="", text_markdown=folded)),
        code('simulation("x")', output(text_plain=rows)),  # the text that stands for its panel
    ):
        assert form.faults([cell]) == []


def test_a_screen_ends_with_a_picture_a_question_or_a_control() -> None:
    text = markdown("word " * 200)
    for pause in (PICTURE, code('show("x")'), code("simulation()"), markdown("![a](b.png)")):
        assert max(form.stretches([text, pause, text]))[0] == 200
    for empty in (code("print(1)", stream("1")), markdown("<details>![a](b.png)</details>")):
        assert max(form.stretches([text, empty, text]))[0] == 400


def test_the_first_screen_needs_a_simulation_and_a_question() -> None:
    text = markdown("word " * 50)
    ask, move = code('predict("x")'), code("simulation()")
    assert form.first_screen([text, ask, move, text]) == 50
    assert form.first_screen([text, ask, text, move, text]) == 100
    assert form.first_screen([text, ask, text, PICTURE, text]) == 150


def test_a_term_is_defined_where_it_first_appears() -> None:
    term = ["gimbal lock"]
    assert form.undefined(["# Gimbal lock\n\nThis is **gimbal lock**.", "gimbal lock"], term) == []
    assert form.undefined(["A **Gimbal-lock** is"], term) == []
    for texts in (["gimbal lock", "**gimbal lock**"], ["**gimbal**"], ["**gimbal locking**"]):
        assert len(form.undefined(texts, term)) == 1


def test_the_time_is_that_of_the_text_the_cards_and_the_charts() -> None:
    cells = [
        markdown("word " * 300 + "<details>" + "word " * 150 + "</details>"),
        code('predict("x")\n\nshow("y")'),
        code("simulation()"),
        markdown("![chart](../docs/charts/x.png) ![film](attachment:x.png)"),
        code('more_claims(\n    "a",\n    "b",\n)'),
    ]
    # 2 min of words, two cards of 30 s, two charts of 45 s; folded: 1 min of words, two claims.
    assert form.reading(cells) == {"open": 2 + 1 + 2, "folded": 1 + 1}
    assert form.reading(cells[:2]) == {"open": 3, "folded": 1}
    assert form.open_minutes("code", "simulation()") == 0.75
    assert form.open_minutes("code", 'x = 1\nshow("y")') == 0.5


def test_a_field_that_nobody_filled_is_found() -> None:
    for text in ("by {claim.figure:.2f} m", "{minutes}", "about {open minutes} min", "{x_y}"):
        assert len(form.unfilled(text)) == 1
    for text in (r"$\frac{a}{b}$", "`{x}`", "```\n{x}\n```", "$$x_{max}$$", "{'a': 1}", "{1, 2}"):
        assert form.unfilled(text) == []


def test_claims_in_the_open_text_are_counted_and_those_in_fold_outs_are_not() -> None:
    cells = [code('show("a")'), code('more_claims("b", "c")'), code('derivations.show("d")')]
    assert form.claim_cards(cells) == ["a", "d"]
