"""An exercise in words: its task, its examples with their answers, its hints."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from typing import Any

from drills.cards import Card, Hint
from drills.plain_math import readable
from drills.progress import ATTEMPTED, NOT_ATTEMPTED, SOLVED
from drills.terminal import Terminal, wrapped

STATE_WORDS = {NOT_ATTEMPTED: "not attempted", ATTEMPTED: "attempted", SOLVED: "solved"}
STATE_SIGNS = {NOT_ATTEMPTED: "○", ATTEMPTED: "◐", SOLVED: "●"}
_STATE_ASCII = {NOT_ATTEMPTED: "[ ]", ATTEMPTED: "[/]", SOLVED: "[x]"}
_PYTHON = re.compile(r"(```python\n)(.*?)(```)", re.S)
# Code within a line; a cell of a table that holds nothing else needs no marks.
_INLINE = re.compile(r"(?<![`|])(?<!\| )`([^`\n]+)`(?!`)")
_WHOLE = 400  # characters: an example is shown whole, unless its answer is large
_STATE_STYLES = {NOT_ATTEMPTED: "dim", ATTEMPTED: "warn", SOLVED: "good"}


def chapter_title(number: int) -> str:
    """Return the title of a chapter of the course."""
    from course import CHAPTERS

    return next((c.title for c in CHAPTERS if c.number == number), "")


def facts(card: Card) -> str:
    """Return one line: chapter, difficulty, minutes."""
    return (
        f"chapter {card.chapter} ({chapter_title(card.chapter)}), "
        f"difficulty {card.difficulty} of 5, about {card.minutes} minutes"
    )


def sign(state: str, terminal: Terminal) -> str:
    """Return the state as a sign that does not need its colour."""
    signs = STATE_SIGNS if terminal.unicode else _STATE_ASCII
    return terminal.paint(signs[state], _STATE_STYLES[state])


def cut(text: str, width: int) -> str:
    """Return the text, or as much of it as fits."""
    return text if len(text) <= width else text[: max(width - 3, 0)] + "..."


def task(card: Card) -> str:
    """Return the prompt in Markdown, without the title."""
    return card.prompt().split("\n", 1)[1].strip() + "\n"


def examples(card: Card) -> list[tuple[str, str]]:
    """Return the public examples: the call and what the worked answer gives."""
    from drills import exercise as exercises
    from drills.values import describe, without_rounding
    from drills.verify import example_result

    exercise = exercises.of(card.name)
    pairs: list[tuple[str, str]] = []
    for text in exercise.examples:
        result: Any = example_result(card, exercise, text)
        pairs.append((text, describe(without_rounding(result), _WHOLE)))
    return pairs


def markdown_lines(text: str, terminal: Terminal) -> list[str]:
    """Return Markdown as the lines of a terminal.

    Without colour, code within a line keeps its backticks: an argument called `every` is no
    word of the sentence.
    """
    import io

    from rich.console import Console
    from rich.markdown import Markdown

    page = io.StringIO()
    console = Console(
        file=page,
        width=terminal.width,
        force_terminal=terminal.colour,
        color_system="standard" if terminal.colour else None,
        legacy_windows=False,
        emoji=False,
    )
    inside = terminal.width - 2  # code stands between two blank columns
    text = _PYTHON.sub(lambda m: f"{m[1]}{fitted(m[2], inside)}\n{m[3]}", readable(text))
    if not terminal.colour:
        pieces = re.split(r"(```.*?```)", text, flags=re.S)
        pieces[::2] = [_INLINE.sub(r"`` `\1` ``", piece) for piece in pieces[::2]]
        text = "".join(pieces)
    console.print(Markdown(text, hyperlinks=False))
    lines = [line.rstrip() for line in page.getvalue().rstrip("\n").split("\n")]
    return [line for i, line in enumerate(lines) if line or (i and lines[i - 1])]


def fitted(program: str, width: int) -> str:
    """Return a program with lines of at most `width` characters; what it does stays the same.

    A long statement continues behind a backslash, a remark beside it goes above it.
    """
    result: list[str] = []
    quoted = False
    for line in program.splitlines():
        bare = line.lstrip()
        indent = line[: len(line) - len(bare)]
        text = quoted or bare.startswith('"""')
        quoted ^= line.count('"""') % 2 == 1
        if len(line) <= width:
            result.append(line)
        elif bare.startswith("#"):
            result += wrapped(bare[2:], width, f"{indent}# ")
        elif text:
            deeper = "    " * bool(re.match(r"[a-z, ]+: ", bare))  # an entry of a list
            result += wrapped(bare, width, f"{indent}{deeper}", indent)
        else:
            code, _, remark = bare.partition("  # ")
            result += wrapped(remark, width, f"{indent}# ") if remark else []
            line = f"{indent}{code}"
            while len(line) > width:
                line, rest = _broken(line, len(indent) + 8, width)
                result.append(line)
                line = f"{indent}        {rest}"
            result.append(line)
    return "\n".join(result)


def _broken(line: str, low: int, width: int) -> tuple[str, str]:
    """Return a line of code that ends in a backslash, and what follows it.

    It ends behind a comma if there is one in its second half, else behind an opening bracket or
    before an operator. Where there is nothing but a string, the string becomes two.
    """
    outside, start, quote, escaped = [], 0, "", False
    for at, char in enumerate(line[: width - 2]):
        if char in "\"'" and quote in ("", char) and not escaped:
            start, quote = (start, "") if quote else (at, char)
        escaped = char == "\\" and not escaped
        if at >= low and not quote:
            outside.append(at)
    commas = [at + 1 for at in outside if line.startswith(", ", at) and at >= width // 2]
    spaces = [at for at in outside if line[at] == " "]
    brackets = [at + 1 for at in outside if line[at] in "([{" and at > width // 2]
    for choice in (commas, spaces, brackets):
        if choice:
            return f"{line[: choice[-1]].rstrip()} \\", line[choice[-1] :].lstrip()
    inside = line[: width - 3]
    fields = inside.rfind("{") if inside.rfind("{") > inside.rfind("}") else len(inside)
    at = inside.rfind(" ", low, fields) + 1
    if not quote or at <= start:
        at = line.find(" ", low)
        return (f"{line[:at]} \\", line[at + 1 :]) if at > 0 and not quote else (line, "")
    letters = re.search(r"[A-Za-z]*$", line[:start])
    prefix = letters[0] if letters else ""
    return f"{line[:at]}{quote} \\", f"{prefix}{quote}{line[at:]}"


def say_examples(card: Card, terminal: Terminal) -> None:
    """Write the examples."""
    pairs = examples(card)
    if not pairs:
        return
    terminal.say()
    terminal.say(terminal.paint("Examples" if len(pairs) > 1 else "Example", "head"))
    for call, result in pairs:
        wide = terminal.width
        lines = textwrap.wrap(call, wide, initial_indent="  >>> ", subsequent_indent="  ... ")
        lines += textwrap.wrap(result, wide, initial_indent="  ", subsequent_indent="  ")
        for line in lines:
            terminal.say(line)


def ladder(hints: Sequence[Hint], diagnosis: str) -> list[Hint]:
    """Return hints in the order in which they are given.

    The one that is about what the last check found comes first; else they are in their own order,
    each more telling than the one before.

    Args:
        hints: of an exercise.
        diagnosis: what the last check said is wrong, or "".
    """

    def words(text: str) -> set[str]:
        return set(re.findall(r"[a-z]{5,}|\beps\b", text.lower()))

    scores = [len(words(diagnosis) & words(f"{hint.symptom} {hint.text}")) for hint in hints]
    best = max(scores, default=0)
    # One word in common, or as many with two hints, says nothing.
    if best < 2 or scores.count(best) > 1:
        return list(hints)
    first = hints[scores.index(best)]
    return [first, *(hint for hint in hints if hint is not first)]


def say_hint(number: int, of: int, hint: Hint, terminal: Terminal) -> None:
    """Write one step of the ladder."""
    head = terminal.paint(f"Hint {number} of {of}", "head")
    terminal.wrap(f"{head}  {hint.symptom}", "  ", "")
    terminal.wrap(hint.text, "  ")
