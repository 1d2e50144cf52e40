"""Every exercise of a chapter stands in its notebook, and every worked answer stands alone."""

from __future__ import annotations

import ast
import re
import sys
from pathlib import Path

import pytest

from course import CHAPTERS
from drills import cards as catalogue
from drills.grader import is_starter
from tools import notebooks

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
CHAPTERS_READY = [chapter for chapter in CHAPTERS if chapter.ready]


def pasted(card: catalogue.Card) -> str:
    """Return the cells of an exercise as they go into the source of its notebook."""
    return f'# %%\ncard("{card.name}")\n\n\n# %%\n{card.cell()}'


@pytest.mark.parametrize("chapter", CHAPTERS_READY, ids=lambda chapter: chapter.topic)
def test_exercises_stand_in_their_notebook_in_the_order_of_their_places(chapter) -> None:
    source = ROOT / "notebooks" / "source" / f"{Path(chapter.notebook).stem}.py"
    cells = [cell.source.strip() for cell in notebooks.read_source(source).cells]
    mine = [c for c in catalogue.cards() if c.chapter == chapter.number and not c.drill]
    assert [card.place for card in mine] == sorted({card.place for card in mine})
    missing = [card for card in mine if f'card("{card.name}")' not in cells]
    assert not missing, (
        f"{source.name} lacks these cells. Paste them into its section of exercises, in the order "
        "of `place` on the cards, below a heading `### ` with the title of the card:\n\n"
        + "\n".join(map(pasted, missing))
    )
    where = [cells.index(f'card("{card.name}")') for card in mine]
    assert where == sorted(where), f"{source.name}: the order of the cards' `place` differs"
    for card, k in zip(mine, where, strict=True):
        call = f"check({card.entry})"
        starter = cells[k + 1].removesuffix(call)
        problem = f"{source.name}: the cells of {card.name} are not its card, starter and check"
        correct = is_starter(card, starter) and call in (cells[k + 1][-len(call) :], cells[k + 2])
        assert correct, f"{problem}. They should be:\n\n{pasted(card)}"
        assert card.solution == f"solutions.{chapter.topic}:{card.entry}"


WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")


@pytest.mark.parametrize("chapter", CHAPTERS_READY, ids=lambda chapter: chapter.topic)
def test_a_page_that_counts_its_exercises_counts_right(chapter) -> None:
    text = (
        ROOT / "notebooks" / "source" / Path(chapter.notebook).with_suffix(".py").name
    ).read_text()
    mine = [c for c in catalogue.cards() if c.chapter == chapter.number and not c.drill]
    pattern = rf"\b({'|'.join(WORDS)}) (?:graded )?exercises(?P<hunt> and a bug hunt)?"
    for match in re.finditer(pattern, text, re.IGNORECASE):
        assert WORDS.index(match[1].lower()) + bool(match["hunt"]) == len(mine), match[0]


def test_every_chapter_has_an_easy_exercise_and_some_of_the_course_are_the_hardest() -> None:
    levels = {chapter.number: set[int]() for chapter in CHAPTERS_READY}
    for card in catalogue.cards():
        levels[card.chapter].add(card.difficulty)
    assert [number for number, found in levels.items() if 1 not in found] == []
    assert sum(5 in found for found in levels.values()) >= 2


@pytest.mark.parametrize("path", sorted((ROOT / "solutions").glob("*.py")), ids=lambda p: p.stem)
def test_a_worked_answer_needs_numpy_and_the_standard_library_only(path: Path) -> None:
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    names = {a.name for node in nodes if isinstance(node, ast.Import) for a in node.names}
    names |= {str(node.module) for node in nodes if isinstance(node, ast.ImportFrom)}
    tops = {name.partition(".")[0] for name in names}
    assert tops <= {"numpy", "__future__"} | sys.stdlib_module_names
