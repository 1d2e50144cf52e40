"""The form of a card: HTML and Markdown without a script, and plain text elsewhere.

The site and the notebook recognise a card and what was clicked by these classes and attributes:

    <div class="card" id="claim-NAME" data-card="TOPIC.NAME">     a question has the id card-NAME
      <details class="answer" data-answer="True" data-right="no">   one for each answer
      <details class="why">                                         the explanation, once

A compact card, as in "More claims about this", has only the explanation, so it is not scored.
`<details class="more-claims">` holds the compact cards of a fold-out. JupyterLab removes `data-`
attributes from Markdown; there, the id names the card and the place of an answer among the answers
names the answer.
"""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass

from course.check import invalid
from course.derivations.typeset import tex

__all__ = ["WIDTH", "Answer", "Shown", "card", "figures", "folded", "tex"]

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


@dataclass(frozen=True)
class Answer:
    """One answer that a card offers.

    Attributes:
        label: what the reader clicks on, without < and >.
        right: whether it is the right one.
        body: Markdown that the click unfolds.
    """

    label: str
    right: bool
    body: str


def _plain(label: str) -> str:
    """Return a label without the marks of a formula or of emphasis, for an attribute."""
    return re.sub(r"[$*`]", "", label)


def card(
    name: str, head: str, question: str, answers: Sequence[Answer] = (), why: str = "", at: str = ""
) -> str:
    """Return Markdown of a card: a statement or a question, its answers, and the explanation once.

    Args:
        name: of the card in the course, "chapter.name".
        head: what kind of card it is; "" for none.
        question: Markdown.
        answers: what one can click on; none for a compact card.
        why: Markdown of the explanation, folded below the answers.
        at: id of the card's element, which can be linked to.
    """
    lead = f"**{head}** {question}" if head else question
    parts = [f'<div class="card" id="{at}" data-card="{name}" style="{_STYLE}">', lead]
    for answer in answers:
        parts.append(
            f'<details class="answer" data-answer="{html.escape(_plain(answer.label))}" '
            f'data-right="{"yes" if answer.right else "no"}"><summary>{answer.label}</summary>'
            f"\n\n{answer.body}\n\n</details>"
        )
    if why:
        summary = "Explanation" if answers else "True or false?"
        parts.append(f'<details class="why"><summary>{summary}</summary>\n\n{why}\n\n</details>')
    return "\n\n".join([*parts, "</div>"])


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
