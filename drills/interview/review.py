"""The command `drills review`: the cards that are due, then new ones; it stores each rating."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any

import click

from drills import cards as catalogue
from drills import commands, json_store, task_text, workspace
from drills.interview import listen, read_line, store
from drills.interview.deck import Entry, deck, judge, sides
from drills.interview.rehearse import EVERY, chapters_of
from drills.interview.store import AGAIN, GOOD, HARD, RATINGS
from drills.plain_math import literal
from drills.progress import Loaded, Reading
from drills.session import RIGHT, Session, body, options

LIMIT = 20
_ASK = {
    "claim": "Type t for true, f for false or o for true only if. A blank line shows the answer.",
    "formula": "Type the formula. A blank line shows it.",
    "drill": "Type g to grade your file in the work folder. A blank line shows the worked answer.",
}
_SHOWN = "Say your answer aloud. A blank line shows the model answer."


class Over(Exception):
    """The learner has typed quit."""


@dataclass
class Round:
    """One round of cards in a terminal or a pipe.

    Attributes:
        session: where it writes, and the work folder.
        read_line: returns the next line that is typed; EOFError at the end.
        clock: the time, aware.
        rated: the ratings, for the JSON.
    """

    session: Session
    read_line: Callable[[], str] = read_line
    clock: Callable[[], datetime] = lambda: datetime.now(UTC)
    rated: list[dict[str, Any]] = field(default_factory=list)

    def run(self, chosen: frozenset[int], limit: int, seed: int) -> int:
        """Ask up to `limit` cards, and report how many are due and new."""
        import fsrs  # noqa: F401  # a missing package is reported before the first card

        session, passed = self.session, set[str]()
        # Chapters that were named are all asked alike; otherwise opened ones come first.
        opened = opened_chapters(session.records()) if chosen == EVERY else ()
        cards = store.sequence(deck(chosen), seed, opened)
        last: Entry | None = None
        self.path = store.beside(session.progress_file)
        self.reviews, report = store.load(self.path)
        self._show_status(report)
        try:
            while len(self.rated) < limit:
                line = store.queue(cards, self.reviews, self.clock())
                entry = store.following([one for one in line if one.key not in passed], last)
                if entry is None:
                    break
                last = entry
                total = min(limit, len(self.rated) + len(line))
                session.say(session.terminal.paint(self._head(entry, total), "head"))
                if not self.ask(entry):
                    passed.add(entry.key)
                session.say()
        except (Over, EOFError):
            session.say()
        except KeyboardInterrupt:
            session.notices.append("Your ratings are stored.")
            raise
        return self._finish(cards, seed)

    def ask(self, entry: Entry) -> bool:
        """Ask one card; return whether it was rated and not passed over."""
        shown = sides(entry, literal)
        self._show(shown.front)
        grades: list[bool] = []
        while True:
            self.session.wrap(_ASK.get(entry.kind, _SHOWN) + " You can also type skip or quit.")
            line = self._line()
            if line == "skip":
                return False
            if entry.kind != "drill" or line.lower() != "g":
                break
            if self._graded(entry, grades):
                break
        while True:
            right, sentence = judge(entry, line)
            if right is not None or not sentence:
                break
            self.session.wrap(f"{sentence} A blank line shows the answer.")
            line = self._line()
            if line == "skip":
                return False
        if grades:
            right = any(grades)
        self.session.wrap(sentence)
        self._show(shown.back)
        known = HARD if False in grades else GOOD
        self.rate(entry, right, None if right is None else known if right else AGAIN)
        return True

    def rate(self, entry: Entry, right: bool | None, intended: int | None) -> None:
        """Read the rating of a card, and store it."""
        words = ", ".join(f"{number} {word}" for number, word in RATINGS.items())
        words += f". A blank line means {RATINGS[intended]}" if intended else ""
        self.session.wrap(f"How well did you know it? {words}.")
        while (line := self._line()) not in map(str, RATINGS) and (line or not intended):
            what = f"{task_text.cut(line, 20)!r} is not a rating." if line else "Rate this card."
            self.session.wrap(f"{what} Type {words}.")
        rating, now = int(line or intended or AGAIN), self.clock()
        try:
            self.reviews, report = store.rate(self.path, entry, rating, now, self.reviews)
        except json_store.Problem as problem:
            report = (str(problem),)
            self.path = None  # one notice is enough; the round continues
            self.reviews, _ = store.rate(None, entry, rating, now, self.reviews)
        self._show_status(report)
        due = self.reviews.cards[entry.key]["due"]
        self.session.say(f"This card comes back in {span(datetime.fromisoformat(due) - now)}.")
        one = {"card": entry.key, "kind": entry.kind, "chapter": entry.chapter, "right": right}
        self.rated.append({**one, "rating": rating, "due": due})

    def _show_status(self, notices: tuple[str, ...]) -> None:
        report = self.session.notices
        report += [one for one in notices if one not in report]

    def _line(self) -> str:
        line = self.read_line().strip()
        if line == "quit":
            raise Over
        return line

    def _show(self, markdown: str) -> None:
        if not self.session.terminal.json:
            for line in task_text.markdown_lines(markdown, self.session.terminal):
                self.session.say(line)

    def _graded(self, entry: Entry, grades: list[bool]) -> bool:
        """Grade the learner's answer to a drill; whether it is right."""
        card = catalogue.card(entry.name)
        path = workspace.answer(self.session.work, card.name)
        if not path.exists() or workspace.is_untouched(path, card):
            self.session.wrap(
                f"You have not written an answer yet. drills start {card.name} creates its file."
            )
            return False
        report = commands.graded(self.session, card, str(path), None)
        commands.report_result(self.session, card, report, str(path))
        grades.append(report.passed)
        return report.passed

    def _head(self, entry: Entry, limit: int) -> str:
        new = "" if entry.key in self.reviews.cards else ", new"
        return f"{len(self.rated) + 1} of {limit}: {entry.kind}, chapter {entry.chapter}{new}"

    def _finish(self, cards: list[Entry], seed: int) -> int:
        session, now = self.session, self.clock()
        if missing := store.missing_cards(deck(), self.reviews):
            session.notices.append(
                f"Cards that you rated and that are no longer in the course: {len(missing)}. Their "
                "ratings stay stored."
            )
        waiting, new = store.due(cards, self.reviews, now), store.fresh(cards, self.reviews)
        counts = [sum(one["rating"] == number for one in self.rated) for number in RATINGS]
        words = [f"{n} {word}" for n, word in zip(counts, RATINGS.values(), strict=True) if n]
        count = len(self.rated)
        session.wrap(
            f"You rated {count} card{'s' * (count != 1)}{': ' * bool(words)}{', '.join(words)}. "
            f"{len(waiting)} {'is' if len(waiting) == 1 else 'are'} due now, and {len(new)} "
            f"{'is' if len(new) == 1 else 'are'} new."
        )
        payload = {
            "seed": seed,
            "rated": self.rated,
            "due": [entry.key for entry in waiting],
            "new": len(new),
            "gone": missing,
            "reviews_file": str(self.path.absolute()) if self.path else None,
        }
        return session.finish(RIGHT, payload)


def opened_chapters(loaded: Loaded) -> set[int]:
    """Return the numbers of the chapters in which something was read, answered or attempted."""
    read = {number for number, reading in loaded.chapters.items() if reading != Reading()}
    return read | {card.chapter for card in catalogue.cards() if loaded.of(card.name).attempts}


def span(time: timedelta) -> str:
    """Return how long, in the unit that one would say: "10 min", "3 days"."""
    minutes = round(time.total_seconds() / 60)
    days = round(minutes / 1440)
    if minutes < 1440:
        return f"{minutes} min" if minutes < 120 else f"{round(minutes / 60)} h"
    return f"{days} day{'s' * (days != 1)}"


@click.command("review")
@click.option("--chapters", metavar="1,5", callback=chapters_of, help="Only these chapters.")
@click.option(
    "--limit", default=LIMIT, show_default=True, type=click.IntRange(1), help="Number of cards."
)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), help="Draw the same new cards again.")
@options
@body
def command(session: Session, chapters: frozenset[int], limit: int, seed: int | None) -> int:
    """Review what you learned: cards that are due, then new ones. You rate yourself."""
    listen()
    return Round(session, session.terminal.paged(read_line)).run(
        chapters, limit, secrets.randbits(32) if seed is None else seed
    )
