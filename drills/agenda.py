"""What to do next, and how much is left: in the order of the chapters, and what is unsolved."""

from __future__ import annotations

from dataclasses import dataclass

from course import CHAPTERS, Chapter
from drills import cards as catalogue
from drills import chapters
from drills.cards import Card
from drills.chapters import Section
from drills.progress import ATTEMPTED, SOLVED, Loaded


@dataclass(frozen=True)
class Standing:
    """Where one chapter stands.

    Attributes:
        chapter: which.
        sections: of its notebook, none where that is not there.
        unread: those that the learner has not marked as read.
        cards: of its exercises and drills, by difficulty.
        unsolved: those of them that are not solved.
        checkpoint: when its checkpoint was passed, "" before.
    """

    chapter: Chapter
    sections: list[Section]
    unread: list[Section]
    cards: list[Card]
    unsolved: list[Card]
    checkpoint: str

    @property
    def reading_minutes(self) -> int:
        """Left to read."""
        return round(sum(section.minutes for section in self.unread))

    @property
    def exercise_minutes(self) -> int:
        """Left to solve: the sum of the cards."""
        return sum(card.minutes for card in self.unsolved)


def standings(loaded: Loaded) -> list[Standing]:
    """Return every chapter that has something to read or to solve, in order."""
    result = []
    for chapter in CHAPTERS:
        cards = [card for card in catalogue.cards() if card.chapter == chapter.number]
        if not (chapter.ready or cards):
            continue
        reading = loaded.reading(chapter.number)
        parts = chapters.sections(chapters.notebook_of(chapter)) if chapter.ready else []
        unread = [part for part in parts if part.number not in reading.read]
        unsolved = [card for card in cards if loaded.of(card.name).state != SOLVED]
        result.append(Standing(chapter, parts, unread, cards, unsolved, reading.checkpoint))
    return result


def to_read(loaded: Loaded, standing: list[Standing]) -> tuple[Chapter, Section] | None:
    """Return where to go on reading: in the chapter that was opened last, else in the first."""
    open_ones = [one for one in standing if one.unread]
    if not open_ones:
        return None
    latest = max(open_ones, key=lambda one: loaded.reading(one.chapter.number).opened)
    return latest.chapter, latest.unread[0]


def to_solve(loaded: Loaded, cards: list[Card]) -> list[Card]:
    """Return the unsolved ones: what was tried last comes first, then in the order of the cards."""
    remaining = [card for card in cards if loaded.of(card.name).state != SOLVED]
    tried = [card for card in remaining if loaded.of(card.name).state == ATTEMPTED]
    if tried:
        last = max(tried, key=lambda card: loaded.of(card.name).last)
        remaining.remove(last)
        remaining.insert(0, last)
    return remaining


def duration(minutes: int) -> str:
    """Return minutes as one says them: "45 min", "2 h 10 min"."""
    hours, rest = divmod(minutes, 60)
    return " ".join([f"{hours} h"] * bool(hours) + [f"{rest} min"] * bool(rest or not hours))
