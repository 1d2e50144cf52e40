"""The deck: a card for everything that can be asked back, made of what is there.

    for card in deck((1, 5)):
        print(card.key, sides(card).front)

A deck is a list of names and takes a fraction of a second; what stands on a card is put together
when it is shown. A key ("claim/semi_implicit_limit") stays the same as long as its source is there.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection
from dataclasses import dataclass
from hashlib import blake2b

from course import CHAPTERS
from course.check import one_of
from course.derivations.records import files, load
from drills import cards as catalogue

KINDS = ("drill", "claim", "formula", "question", "exhibit")
VERDICTS = {"t": "holds", "f": "false", "o": "holds only if"}
# What else is accepted for them.
WORDS = {
    **dict.fromkeys(("true", "it is true", "right", "yes", "y", "holds"), "t"),
    **dict.fromkeys(("false", "it is false", "wrong", "no", "n"), "f"),
    **dict.fromkeys(("only if", "only", "true only if", "holds only if", "it depends"), "o"),
}
SEED = 1  # of the world in which an exhibit is measured


@dataclass(frozen=True)
class Entry:
    """A card of the deck.

    Attributes:
        key: its kind and the name of its source: "drill/fk3", "question/contact/coulomb_cone".
        kind: one of `KINDS`.
        chapter: its number.
        file: of a claim or its formula, such as "rigid_body.flight".
        rank: 0 for what a first interview asks: its questions, the claims and formulas that their
            answers quote, the formulas of the checkpoints, the drills. 1 for what later rounds ask,
            2 for the rest.
    """

    key: str
    kind: str
    chapter: int
    file: str = ""
    rank: int = 2

    @property
    def name(self) -> str:
        """The key without the kind."""
        return self.key.partition("/")[2]

    @property
    def number(self) -> int:
        """The key as a number below 2^53, for the scheduler."""
        return int.from_bytes(blake2b(self.key.encode(), digest_size=7).digest(), "big") >> 3


@dataclass(frozen=True)
class Sides:
    """What stands on a card: two texts, Markdown."""

    front: str
    back: str


def deck(chapters: Collection[int] | None = None) -> list[Entry]:
    """Return the cards of these chapters, of all if None: by chapter, then by kind as in `KINDS`.

    Args:
        chapters: their numbers.

    Raises:
        ValueError: for a number that no chapter has.
    """
    for number in chapters or ():
        one_of("chapter", number, [chapter.number for chapter in CHAPTERS])
    return [entry for entry in _all() if chapters is None or entry.chapter in chapters]


@functools.cache
def _all() -> tuple[Entry, ...]:
    from course.interview import museum

    result = [
        Entry(f"drill/{card.name}", "drill", card.chapter, rank=0)
        for card in catalogue.cards()
        if card.drill
    ]
    questions, quoted = _ranks()
    numbers = {chapter.topic: chapter.number for chapter in CHAPTERS}
    for file in files():
        number = numbers[file.partition(".")[0]]
        for id, entry in load(file).items():
            rank = quoted.get(id, 2)
            result.append(Entry(f"claim/{id}", "claim", number, file, rank))
            if entry.get("formula"):
                result.append(Entry(f"formula/{id}", "formula", number, file, rank))
    for (topic, name), rank in questions.items():
        result.append(Entry(f"question/{topic}/{name}", "question", numbers[topic], rank=rank))
    last = CHAPTERS[-1].number
    names = [exhibit.name.replace(" ", "_") for exhibit in museum.EXHIBITS]
    result += [Entry(f"exhibit/{name}", "exhibit", last, rank=1) for name in names]
    return tuple(sorted(result, key=lambda entry: (entry.chapter, KINDS.index(entry.kind))))


def _ranks() -> tuple[dict[tuple[str, str], int], dict[str, int]]:
    """Return the rank of each question, and of each claim that an answer or a checkpoint quotes."""
    from course import cards
    from course.interview import FOLDER, read

    questions, quoted = dict[tuple[str, str], int](), dict[str, int]()
    for topic in (chapter.topic for chapter in CHAPTERS):
        for path in sorted((FOLDER / topic).glob("*.md")):
            question = read(path)
            rank = questions[topic, path.stem] = int(question.level > 1)
            for source, _ in question.fields():
                quoted[source] = min(rank, quoted.get(source, rank))
        quoted |= dict.fromkeys(cards.gate(topic), 0)
    return questions, quoted


def sides(entry: Entry, tex: Callable[[str], str] = str) -> Sides:
    """Return what stands on a card, with the figures on record.

    Args:
        entry: the card.
        tex: sets the sentences of claims; `course.cards.tex` where formulas can be shown.

    Raises:
        ValueError: for a card whose source is gone.
    """
    if entry.kind in ("claim", "formula"):
        return (_claim if entry.kind == "claim" else _formula)(entry, tex)
    return {"drill": _drill, "question": _question, "exhibit": _exhibit}[entry.kind](entry)


def judge(entry: Entry, text: str) -> tuple[bool | None, str]:
    """Return whether the answer is right, and a sentence on it.

    The verdict is None where only the learner can decide; with a sentence, the answer can't be
    read, and the sentence says why.

    Args:
        entry: the card.
        text: for a claim one of `VERDICTS` or `WORDS`, for a formula the formula.
    """
    text = text.strip()
    if entry.kind == "formula" and text:
        _sourced(entry)
        from course.derivations import answer

        result = answer(entry.name, text)
        readable = result.correct or result.counterexample is not None
        return result.correct if readable else None, result.message
    if entry.kind == "claim" and text:
        letter = " ".join(text.lower().strip(".!?").split())
        letter = WORDS.get(letter, letter)
        if letter not in VERDICTS:
            return None, "Type t or true, f or false, o or only if."
        right = VERDICTS[letter] == load(entry.file)[entry.name]["verdict"]
        return right, "Correct." if right else "Wrong."
    return None, ""


def _sourced(entry: Entry) -> None:
    """Import the file of a claim, and no other."""
    import importlib

    importlib.import_module(f"course.derivations.{entry.file}")


def _drill(entry: Entry) -> Sides:
    from drills import task_text

    card = catalogue.card(entry.name)
    work = f"Solve it before you look: `drills start {card.name}`, then `drills check {card.name}`."
    front = f"**{card.title}** ({card.minutes} minutes)\n\n{task_text.task(card)}\n\n{work}"
    return Sides(front, f"{card.insight}\n\n```python\n{card.solution_text()}```")


def _claim(entry: Entry, tex: Callable[[str], str]) -> Sides:
    from course.derivations import Block, recorded

    shown = Block(recorded(entry.name, entry.file))
    claim = shown.outcome.claim
    source = f"\n\n{claim.source}" if claim.source else ""
    return Sides(
        f"Common claim: “{tex(claim.claim)}”",
        f"**{tex(shown.verdict)}** {tex(shown.outcome.corrected)}{source}",
    )


def _formula(entry: Entry, tex: Callable[[str], str]) -> Sides:
    from course.derivations import formula

    _sourced(entry)
    requested = formula(entry.name)
    symbols = [f"* `{name}`: {symbol.meaning}" for name, symbol in requested.symbols.items()]
    return Sides(
        "\n".join([f"{tex(requested.question)}\n", *symbols]),
        f"The formula: `{requested.expression}`",
    )


def _question(entry: Entry) -> Sides:
    from course.derivations.records import figure
    from course.interview import FOLDER, filled, read

    requested = read(FOLDER / f"{entry.name}.md")
    listened = "\n".join(f"* {line}" for line in requested.listened())
    back = filled(f"{requested.minute}\n\nThe interviewer listens for:\n\n{listened}", figure)
    return Sides(f"**{requested.title}** ({requested.minutes} minutes)", back)


def _exhibit(entry: Entry) -> Sides:
    from course.interview import invariants, museum

    (shown,) = (x for x in museum.EXHIBITS if x.name.replace(" ", "_") == entry.name)
    caught = (getattr(invariants, shown.invariant).__doc__ or "").partition("\n")[0]
    wrong, right = (shown.evidence(slip, SEED) for slip in (True, False))
    back = [
        f"`{shown.invariant}`: {caught} The tolerance is {shown.tolerance:g}. The faulty version "
        f"gives {wrong:.2g}, the correct one {right:.2g}.",
        shown.report,
        *([f"Still the case in {shown.live}"] if shown.live else []),
        f"{', '.join(shown.threads)} ({min(shown.years)})",
    ]
    front = f"**{shown.name.capitalize()}.** {shown.finding} Which invariant catches it?"
    return Sides(front, "\n\n".join(back))
