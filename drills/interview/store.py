"""How well each card is known: `reviews.json` beside the progress, and the next time it is asked.

When that is comes from the library fsrs (a model of memory; the chance to recall is kept at nine in
ten). The file holds its state of each card and what was rated. `drills.json_store` says how it is
read and written: two terminals at once lose nothing, and a damaged file is moved aside.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from hashlib import blake2b
from pathlib import Path
from typing import Any

from course.check import invalid
from drills import json_store
from drills.interview.deck import Entry
from drills.json_store import Damaged

RATINGS = {1: "again", 2: "hard", 3: "good", 4: "easy"}
AGAIN, HARD, GOOD, EASY = RATINGS
LOGGED = 10_000  # ratings; older ones leave the log, their effect stays in the state


@dataclass
class Reviews:
    """What is kept.

    Attributes:
        cards: the scheduler's state of each card that was rated, by key; `fsrs.Card.to_dict`.
        log: what was rated, in turn: "card", "rating" and "when".
    """

    cards: dict[str, dict[str, Any]] = field(default_factory=dict)
    log: list[dict[str, Any]] = field(default_factory=list)


def beside(progress_file: Path | None) -> Path | None:
    """Return the file of the reviews, None where no progress is kept."""
    return progress_file and progress_file.with_name("reviews.json")


def load(path: Path | None) -> tuple[Reviews, tuple[str, ...]]:
    """Return the reviews in the file, and messages about it; a damaged file is moved aside.

    Args:
        path: of the file, or None to keep none.
    """
    return json_store.load(path, FORM)


def rate(
    path: Path | None, entry: Entry, rating: int, now: datetime, reviews: Reviews | None = None
) -> tuple[Reviews, tuple[str, ...]]:
    """Enter a rating, and when the card is asked next.

    Where the clock stood ahead at the last review, fsrs takes that review for one of today, and
    the card waits from now on.

    Args:
        path: of the file, or None to keep none.
        entry: the card.
        rating: a key of `RATINGS`.
        now: the time, aware.
        reviews: changed in place where there is no file.

    Returns:
        All reviews, and what to tell.

    Raises:
        ValueError: for another rating, or a time without a zone.
        kept.Problem: if the file can't be written; it is then as it was.
        ModuleNotFoundError: fsrs is not installed.
    """
    import fsrs

    if type(rating) is not int or rating not in RATINGS:
        raise invalid("rating", rating, ", ".join(f"{n} ({word})" for n, word in RATINGS.items()))
    if now.tzinfo is None:
        raise invalid("now", now.isoformat(), "a time with its zone")
    now = now.astimezone(UTC)
    scheduler, notices = fsrs.Scheduler(enable_fuzzing=False), []

    def edit(content: Reviews) -> None:
        before: Any = content.cards.get(entry.key)
        card = fsrs.Card.from_dict(before) if before else fsrs.Card(entry.number, due=now)
        if card.last_review and card.last_review > now:
            notices.append(
                f"The clock was ahead when {entry.key} was last rated; this is corrected."
            )
        card, _ = scheduler.review_card(card, fsrs.Rating(rating), now)
        content.cards[entry.key] = dict(card.to_dict())
        content.log.append({"card": entry.key, "rating": rating, "when": now.isoformat()})
        del content.log[:-LOGGED]

    if path is None:
        edit(reviews := reviews or Reviews())
        return reviews, tuple(notices)
    after, report = json_store.change(path, FORM, edit)
    return after, (*report, *notices)


def due(deck: Sequence[Entry], reviews: Reviews, now: datetime) -> list[Entry]:
    """Return the cards that were rated and are to be asked again, what waits longest first.

    A card that was last rated at a time that has not come yet is due too: the clock was wrong.
    """

    def since(entry: Entry) -> datetime | None:
        state = reviews.cards.get(entry.key)
        if state is None:
            return None
        at, last = (datetime.fromisoformat(state[name]) for name in ("due", "last_review"))
        return min(at, now) if at <= now or last > now else None

    waiting = [(at, entry.key, entry) for entry in deck if (at := since(entry))]
    return [entry for *_, entry in sorted(waiting, key=lambda one: one[:2])]


def fresh(deck: Sequence[Entry], reviews: Reviews) -> list[Entry]:
    """Return the cards that were never rated."""
    return [entry for entry in deck if entry.key not in reviews.cards]


def weak(deck: Sequence[Entry], reviews: Reviews) -> list[Entry]:
    """Return the cards last rated "again" or "hard", those most often rated "again" first."""
    last: dict[str, int] = {}
    again: dict[str, int] = {}
    for one in reviews.log:
        last[one["card"]] = one["rating"]
        again[one["card"]] = again.get(one["card"], 0) + (one["rating"] == AGAIN)
    poor = [entry for entry in deck if last.get(entry.key, EASY) <= HARD]
    return sorted(poor, key=lambda entry: -again[entry.key])


def sequence(deck: Sequence[Entry], seed: int, opened: Collection[int] = ()) -> list[Entry]:
    """Return cards in the order in which they are new: shuffled once, whatever is asked meanwhile.

    Cards of opened chapters come first, and of these what is asked most.

    Args:
        deck: the cards.
        seed: of the shuffle.
        opened: numbers of the chapters that the learner has opened.
    """

    def place(entry: Entry) -> tuple[bool, int, bytes]:
        # A hash for each card: the order of the others does not change when a card is taken out.
        drawn = blake2b(f"{seed}/{entry.key}".encode(), digest_size=8).digest()
        return entry.chapter not in opened, entry.rank, drawn

    return sorted(deck, key=place)


def queue(deck: Sequence[Entry], reviews: Reviews, now: datetime) -> list[Entry]:
    """Return what is asked: what is due, then what is new, in the order of the deck."""
    return due(deck, reviews, now) + fresh(deck, reviews)


def following(line: Sequence[Entry], last: Entry | None) -> Entry | None:
    """Return the first card of a queue that is not of the file of claims of the last one.

    Where all are, it is the first card; None if there is none.
    """
    other = (one for one in line if last is None or not one.file or one.file != last.file)
    return next(other, line[0] if line else None)


def missing_cards(deck: Sequence[Entry], reviews: Reviews) -> list[str]:
    """Return keys of cards that were rated and whose source is no longer there; they are kept."""
    other = {entry.key for entry in deck}
    return [key for key in reviews.cards if key not in other]


def _parsed(content: dict[str, Any]) -> Reviews:
    cards, log = content.get("cards"), content.get("log")
    if not isinstance(cards, dict) or not isinstance(log, list):
        raise Damaged
    if not all(key.isprintable() and _is_state(state) for key, state in cards.items()):
        raise Damaged
    if not all(_is_rated(one) for one in log):
        raise Damaged
    return Reviews(cards, log)


def _is_state(state: Any) -> bool:
    def number(name: str, low: float, high: float) -> bool:
        return type(state.get(name)) in (int, float) and low <= state[name] <= high

    return (
        isinstance(state, dict)
        and type(state.get("card_id")) is int
        and type(state.get("state")) is int
        and number("state", 1, 3)
        and (state.get("step") is None if state["state"] == 2 else number("step", 0, 9))
        and number("stability", 1e-9, 1e9)
        and number("difficulty", 1.0, 10.0)
        and all(_is_time(state.get(name)) for name in ("due", "last_review"))
    )


def _is_rated(one: Any) -> bool:
    return (
        isinstance(one, dict)
        and isinstance(one.get("card"), str)
        and one["card"].isprintable()
        and type(one.get("rating")) is int
        and one["rating"] in RATINGS
        and _is_time(one.get("when"))
    )


def _is_time(text: Any) -> bool:
    try:
        return datetime.fromisoformat(text).tzinfo is not None
    except (TypeError, ValueError):
        return False


FORM: json_store.Form[Reviews] = json_store.Form(
    "drills-reviews/1", "reviews", Reviews, _parsed, vars
)
