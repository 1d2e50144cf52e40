"""The form of a card: HTML and Markdown without a script, and plain text elsewhere."""

from __future__ import annotations

from collections.abc import Sequence

from course.cards.formula import tex
from course.check import invalid

__all__ = ["WIDTH", "Shown", "choice", "figures", "folded", "tex"]

WIDTH = 96  # columns of printed text
_STYLE = "border-left:4px solid #3f51b5;padding:4px 0 4px 14px;margin:6px 0"


class Shown:
    """Markdown in a notebook, plain text elsewhere."""

    def __init__(self, text: str, markdown: str) -> None:
        self.text, self.markdown = text, markdown

    def __repr__(self) -> str:
        return self.text

    def _repr_markdown_(self) -> str:
        return self.markdown


def folded(summary: str, body: str) -> str:
    """Return Markdown that a click on its summary unfolds."""
    return f"<details><summary>{summary}</summary>\n\n{body}\n\n</details>"


def choice(head: str, question: str, options: Sequence[tuple[str, str]], more: str = "") -> str:
    """Return Markdown of a question whose options unfold.

    Args:
        head: what kind of card it is.
        question: Markdown.
        options: what one can click on, and what it then says.
        more: Markdown below.
    """
    parts = [f'<div style="{_STYLE}">', f"**{head}** {question}"]
    parts += [folded(label, body) for label, body in options]
    return "\n\n".join([*parts, *(["<br>", more] if more else []), "</div>"])


def figures(text: str, *rows: str, cut: str = "", summary: str = "All figures") -> Shown:
    """Return the lines of a table that matter, with the whole table folded below.

    Args:
        text: the table.
        rows: a line is shown that begins with one of these, in this order.
        cut: head of a column; it and what is right of it are in the whole table only.
        summary: what one clicks on to see all of it.

    Raises:
        ValueError: for a row or a column that is not there.
    """
    lines = text.splitlines()
    if cut not in lines[0]:
        raise invalid("cut", cut, "a word of the table's first line")
    end = lines[0].index(cut) if cut else None
    chosen = []
    for row in rows:
        result = [line[:end].rstrip() for line in lines if line.lstrip().startswith(row.lstrip())]
        if not result:
            raise invalid("rows", row, "the beginning of a line of the table")
        chosen += [line for line in dict.fromkeys(result) if line not in chosen]
    shown = "\n".join(_narrow(chosen))
    whole = folded(summary, f"```text\n{text}\n```")
    return Shown(shown or summary, f"```text\n{shown}\n```\n\n{whole}" if shown else whole)


def _narrow(lines: Sequence[str]) -> list[str]:
    """Return the lines of a table with at most two columns of blanks between its own."""
    wide = max(map(len, lines), default=0)
    blank = [all(line[k : k + 1] in ("", " ") for line in lines) for k in range(wide)]
    selected = [k for k in range(wide) if k < 2 or not all(blank[k - 2 : k + 1])]
    return ["".join(line[k : k + 1] for k in selected) for line in lines]
