"""An exercise in words: its task, its examples with their answers, its hints."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence
from typing import Any

from drills.cards import Card, Hint
from drills.plain_math import readable
from drills.progress import ATTEMPTED, NOT_ATTEMPTED, SOLVED
from drills.terminal import Terminal

STATE_WORDS = {NOT_ATTEMPTED: "not attempted", ATTEMPTED: "attempted", SOLVED: "solved"}
STATE_SIGNS = {NOT_ATTEMPTED: "○", ATTEMPTED: "◐", SOLVED: "●"}
_STATE_ASCII = {NOT_ATTEMPTED: "[ ]", ATTEMPTED: "[/]", SOLVED: "[x]"}
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
    """Return Markdown as the lines of a terminal."""
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
    console.print(Markdown(readable(text), hyperlinks=False))
    lines = [line.rstrip() for line in page.getvalue().rstrip("\n").split("\n")]
    return [line for i, line in enumerate(lines) if line or (i and lines[i - 1])]


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
