"""The form of a chapter: what its notebook may ask of a reader before something moves again.

Words, paragraphs and the time they take are counted here (and section by section in
`drills.chapters`), for the tests and for the line of the first screen that says how long the
chapter is. Prose is the text of Markdown cells outside of what
a click unfolds; a formula counts as one word, code and pictures as none.
"""

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from nbformat import NotebookNode

from drills.chapters import folded_minutes, open_minutes, opened, words

BEFORE_FIRST_PICTURE = 120  # words
COLUMNS = 96  # of printed text
PARAGRAPH = 110  # words


@dataclass(frozen=True)
class Limits:
    """What a chapter's page may ask of its reader.

    Attributes:
        prose: least and largest number of words of open prose.
        stretch: words without a picture, a question or a control.
        figures: printed lines with figures in one output.
        claim_cards: claims shown as cards in the open text; fold-outs are free.
        true_share: least share of those claims that are true as they stand.
    """

    prose: tuple[int, int]
    stretch: int
    figures: int
    claim_cards: float
    true_share: float


# Of a chapter in the present form: explain, ask, show. 400 words are about one screen.
LIMITS = Limits(prose=(5000, 8000), stretch=400, figures=6, claim_cards=12, true_share=1 / 3)
# Of the entrance and the exit, chapters 0 and 12: half as much to read, in the same form.
SHORT = replace(LIMITS, prose=(2500, 5000))

_ASKED = re.compile(r"^\s*(predict|show|card|check|answer|checkpoint|interview)\(", re.M)
_CLAIM = re.compile(r'^\s*(?:\w+\.)?show\("(\w+)"\)', re.M)
_MOVED = re.compile(r"^\s*(?:\w+\.)?simulation\(", re.M)
_IMAGE = re.compile(r"!\[[^\]]*\]\([^)]*\)|<img\b[^>]*>")
_FENCE = re.compile(r"^```.*?^```", re.S | re.M)


def paragraphs(text: str) -> list[str]:
    """Return paragraphs of Markdown: blocks, entries of lists, cells of tables."""
    blocks = re.split(r"\n\s*\n|\n(?=\s*(?:[*-]|\d+\.) )|</t[dh]>|</tr>", _FENCE.sub("", text))
    return [cell for block in blocks for cell in (block.split("|") if "|\n" in block else [block])]


def pauses(cell: NotebookNode) -> list[str]:
    """Return what interrupts the reading of a code cell: "question", "simulation", "picture"."""
    result = ["question"] if _ASKED.search(cell.source) else []
    if _MOVED.search(cell.source):
        result.append("simulation")
    kinds = [kind for output in cell.get("outputs", []) for kind in output.get("data", {})]
    return result + (["picture"] if any(kind.startswith("image/") for kind in kinds) else [])


def stretches(cells: Sequence[NotebookNode]) -> Iterator[tuple[int, str]]:
    """Yield the words between one picture, question or control and the next.

    (words, where it ends).
    """
    count = 0
    for cell in cells:
        if cell.cell_type == "markdown":
            pieces = _IMAGE.split(opened(cell.source))
            for place, piece in enumerate(pieces):
                count += words(piece)
                if place < len(pieces) - 1:
                    yield count, "picture"
                    count = 0
        elif cell.cell_type == "code" and (result := pauses(cell)):
            yield count, "+".join(result)
            count = 0
    yield count, "end"


def first_screen(cells: Sequence[NotebookNode]) -> int:
    """Return the words before both a simulation and a question are reached.

    It returns all words if one of the two is missing.
    """
    count, missing = 0, {"question", "simulation"}
    for stretch, kind in stretches(cells):
        count += stretch
        missing -= set(kind.split("+"))
        if not missing:
            break
    return count


def open_words(cells: Sequence[NotebookNode]) -> int:
    """Return words of open prose."""
    return sum(words(opened(cell.source)) for cell in cells if cell.cell_type == "markdown")


def printed(cell: NotebookNode) -> Iterator[str]:
    """Yield the texts that outputs of a cell show as they are.

    They are printed, or in an open block of code. The readouts of a simulation are part of its
    panel, which a reader sees in place of the text that is stored for it.
    """
    for output in cell.get("outputs", []):
        data = output.get("data", {})
        if output.output_type == "stream":
            yield output.text
        elif "text/markdown" in data:
            yield from re.findall(
                r"^```text\n(.*?)^```", opened(data["text/markdown"]), re.S | re.M
            )
        elif set(data) == {"text/plain"} and not _MOVED.search(cell.source):
            yield data["text/plain"]


def faults(cells: Sequence[NotebookNode], limits: Limits = LIMITS) -> list[str]:
    """Return where the outputs and paragraphs of a notebook are too long, one sentence each."""
    result = []
    for number, cell in enumerate(cells):
        if cell.cell_type == "markdown":
            # Markdown takes such a line for an entry of a list, which tears the formula.
            formulas = re.split(r"(?<!\\)\$", _FENCE.sub("", cell.source).replace("$$", ""))[1::2]
            result += [
                f"cell {number}: a line of the formula {formula!r} begins like a list"
                for formula in formulas
                if re.search(r"\n[-+*>] ", formula)
            ]
            # A row that goes on in the next line loses its last columns to a row of their own.
            lines = _FENCE.sub("", cell.source).splitlines()
            result += [
                f"cell {number}: a row of a table is broken after {row[-40:]!r}"
                for above, row in itertools.pairwise(lines)
                if above.startswith("|") and row.startswith("|") and not row.rstrip().endswith("|")
            ]
            for paragraph in paragraphs(cell.source):
                if (count := words(paragraph)) > PARAGRAPH:
                    result.append(
                        f"cell {number}: {count} words in a paragraph: {paragraph[:60]!r}"
                    )
            continue
        for text in printed(cell) if cell.cell_type == "code" else ():
            lines = text.splitlines()
            wide = max(map(len, lines), default=0)
            if wide > COLUMNS:
                result.append(f"cell {number}: prints {wide} columns")
            rows = sum(any(c.isdigit() for c in line) for line in lines)
            if rows > limits.figures:
                result.append(f"cell {number}: prints {rows} lines of figures")
    return result


def claim_cards(cells: Sequence[NotebookNode]) -> list[str]:
    """Return the claims that a chapter shows as cards in its open text."""
    return [id for cell in cells if cell.cell_type == "code" for id in _CLAIM.findall(cell.source)]


def undefined(texts: Sequence[str], vocabulary: Sequence[str]) -> list[str]:
    """Return the terms that a chapter does not define where they first appear, one sentence each.

    Args:
        texts: Markdown in the order of reading; headings do not count.
        vocabulary: the terms; each is set in bold where it first appears, and defined there.
    """
    body = "\n\n".join(re.sub(r"^#+ .*$", "", text, flags=re.M) for text in texts)
    bold = [match.span() for match in re.finditer(r"\*\*[^*\n]+\*\*", body)]
    result = []
    for term in vocabulary:
        pattern = r"(?<!\w)" + r"[\s-]+".join(map(re.escape, re.split(r"[\s-]+", term)))
        first = re.search(pattern + r"(?:s|es)?(?!\w)", body, re.I)
        if first is None:
            result.append(f"{term} does not appear")
        elif not any(start <= first.start() and first.end() <= end for start, end in bold):
            around = " ".join(body[max(first.start() - 40, 0) : first.end() + 20].split())
            result.append(f"{term} is not defined where it first appears: ...{around}...")
    return result


def unfilled(text: str) -> list[str]:
    """Return the fields of a text that nobody filled, such as {claim.figure:.2f} or {minutes}.

    Args:
        text: what a page shows; code and formulas in it may have braces of their own.
    """
    prose = re.sub(r"```.*?```|`[^`]*`|\$\$.*?\$\$|\$[^$]*\$", " ", text, flags=re.S)
    return re.findall(r"\{[A-Za-z_][\w. ]*(?::[^{}\s]*)?\}", prose)


def reading(cells: Sequence[NotebookNode]) -> dict[str, int]:
    """Return how long a chapter takes, in minutes.

    Args:
        cells: of its source.

    Returns:
        "open": to read what is open, to answer its cards and to look at its charts; "folded": to
        read what is collapsed, claims included.
    """
    kinds = {"open": open_minutes, "folded": folded_minutes}
    return {
        name: math.ceil(round(sum(minutes(cell.cell_type, cell.source) for cell in cells), 6))
        for name, minutes in kinds.items()
    }
