"""A rehearsed interview: what is drawn, what is asked next, and what the report says.

Nothing here speaks, waits or looks at a clock; the command `drills interview` does.
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

from course.check import invalid
from course.interview import FOLDER, Figure, designs, filled, questions, scenarios
from course.interview.designs import LEVELS as MARKS

PARTS = ("concept", "debugging", "coding", "design")
WEIGHT = 4  # how many times as likely as another one that is weak or due is drawn
WEAK = 2 / 3  # an answer below this share, all lines "quantified", is weak
_STEM = 4  # letters by which two words are taken for one: "halves", "halving"


@dataclass(frozen=True)
class Item:
    """Something to be asked.

    Attributes:
        key: its kind and name, as "question/contact/coulomb_cone".
        part: of an interview, one of `PARTS`.
        chapter: its number.
        minutes: that it takes.
        title: the wording of the question; its first line is its name.
        rubric: what is listened for.
        follow_ups: possible next questions.
        answer: Markdown of the model answer.
        fill: (text, figure) -> the text with its fields filled.
        aid: an answer -> the marks that its words suggest, none where nothing can tell.
    """

    key: str
    part: str
    chapter: int
    minutes: int
    title: str
    rubric: tuple[str, ...]
    follow_ups: tuple[str, ...]
    answer: str
    fill: Callable[[str, Figure], str] = filled
    aid: Callable[[str], Sequence[str]] = lambda answer: ()


@dataclass
class Entry:
    """What became of one item; each step is entered when it is over, an answer line by line.

    Attributes:
        key, part, chapter, minutes, title: of the item.
        seconds: spent on it.
        answer, answered: the answer so far, and whether it is complete.
        marks: of `MARKS`, one for each line of the rubric.
        weakest, asked, reply: the line marked lowest, the follow-up on it, and the reply.
        attempts: verdict and sentence of each grading of a drill.
        score: the share of all marks.
        read: what to read.
        done: whether the item is over.
    """

    key: str
    part: str
    chapter: int
    minutes: int
    title: str
    seconds: float = 0.0
    answer: str = ""
    answered: bool = False
    marks: list[str] = field(default_factory=list)
    weakest: str = ""
    asked: str = ""
    reply: str = ""
    attempts: list[dict[str, str]] = field(default_factory=list)
    score: float = 0.0
    read: str = ""
    done: bool = False


@dataclass
class Interview:
    """One interview.

    Attributes:
        started: ISO 8601, UTC; its name.
        seed, minutes: of the draw.
        items: the questions, in order.
        over: the title of the question that was open when the time ran out, or "".
        cards_due: keys of the cards that were due at its end.
    """

    started: str
    seed: int
    minutes: int
    items: list[Entry]
    over: str = ""
    cards_due: list[str] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Time spent."""
        return sum(entry.seconds for entry in self.items)


def spoken(topics: Sequence[str]) -> list[Item]:
    """Return the questions of chapters; with those of the last one the scenarios and the designs.

    A concept part may also be an estimate or something for the whiteboard.
    """
    result = []
    for topic in topics:
        for q in questions(topic) if (FOLDER / topic).is_dir() else ():
            part = q.kind if q.kind in ("debugging", "design") else "concept"
            key, answer = f"question/{topic}/{q.name}", f"{q.minute}\n\n{q.full}"
            rest = (q.minutes, q.title, q.rubric, q.follow_ups, answer)
            result.append(Item(key, part, q.chapter, *rest))
    if "interview" in topics:
        result += [_scenario(scenarios.scenario(name)) for name in scenarios.scenario_names()]
        result += [_design(designs.read(name)) for name in designs.NAMES]
    return result


def _scenario(one: scenarios.Scenario) -> Item:
    """Return said aloud: the causes that one would think of, and how one would tell each."""
    causes = tuple(cause.words for cause in one.causes)
    probes = "\n".join(f"* {probe.what} ({probe.minutes} minutes)" for probe in one.probes)
    answer = f"What can be tried:\n\n{probes}\n\n`drills debug {one.name}` runs it."
    report = tuple(f"What would you try to tell this from the others? {words}" for words in causes)
    title = f"{one.title}.\n{one.prompt}"
    return Item(f"scenario/{one.name}", "debugging", 12, 10, title, causes, report, answer)


def _design(one: designs.Design) -> Item:
    def aid(answer: str) -> list[str]:
        return list(designs.levels(one, answer).values())

    requested, flags = (
        "\n".join(f"* {line}" for line in lines) for lines in (one.clarify, one.red_flags)
    )
    answer = f"Ask first:\n\n{requested}\n\n```text\n{designs.plain(one)}\n```\n\n{one.answer}"
    rest = (tuple(item.asks for item in one.rubric), tuple(one.follow_ups))
    answer += f"\n\nRed flags:\n\n{flags}"
    key = f"design/{one.name}"
    return Item(key, "design", 12, one.minutes, one.title, *rest, answer, one.filled, aid)


def draw(
    pool: Sequence[Item],
    parts: Sequence[str],
    minutes: int,
    weak: Collection[str],
    last: Collection[str],
    seed: int,
) -> list[Item]:
    """Draw one item for each part that the minutes allow.

    Of those that fit, one that is weak or due is `WEIGHT` times as likely as another one: with m
    of them among n, one of them comes with probability m WEIGHT / (m WEIGHT + n - m). While not
    even the shortest of each part fit together, the part whose shortest is longest is left out.

    Args:
        pool: what there is.
        parts: of `PARTS`.
        minutes: for all together.
        weak: keys of what is weak or due.
        last: keys of the last interview's questions, which are not repeated.
        seed: of the draw.

    Raises:
        ValueError: if nothing is left to ask.
    """
    rng = random.Random(seed)
    other = {part: [i for i in pool if i.part == part and i.key not in last] for part in parts}
    least = {part: min(i.minutes for i in items) for part, items in other.items() if items}
    while len(least) > 1 and sum(least.values()) > minutes:
        del least[max(least, key=lambda part: least[part])]
    if not least:
        raise invalid("parts", list(parts), "some for which there is more than what was just asked")
    chosen: list[Item] = []
    for part in least:
        others = [least[p] for p in list(least)[len(chosen) + 1 :]]
        room = minutes - sum(others) - sum(item.minutes for item in chosen)
        fit = [item for item in other[part] if item.minutes <= max(room, least[part])]
        weights = [WEIGHT if item.key in weak else 1 for item in fit]
        chosen += rng.choices(fit, weights)
    return chosen


def nearest(text: str, others: Sequence[str]) -> int | None:
    """Return which of the others shares most with a text; None if none shares a word.

    A word counts the more, the fewer of the others have it.
    """
    stems = [_stems(other) for other in others]
    score = [sum(1.0 / sum(w in s for s in stems) for w in _stems(text) & own) for own in stems]
    best = max(score, default=0.0)
    return score.index(best) if best > 0.0 else None


def _stems(text: str) -> set[str]:
    return {word[:_STEM] for word in re.findall(r"[a-z]{4,}", text.lower())}


def share(marks: Sequence[str]) -> float:
    """Return the share of all that could be earned."""
    return sum(map(MARKS.index, marks)) / ((len(MARKS) - 1) * len(marks))


def follow_up(item: Item, marks: Sequence[str]) -> tuple[str, str]:
    """Return the line of the rubric that was marked lowest, and the follow-up that it triggers.

    It is the one nearest to that line in its words; where none is, the one at its place.
    """
    if len(marks) != len(item.rubric) or not set(marks) <= set(MARKS):
        raise invalid("marks", list(marks), f"{len(item.rubric)} of {', '.join(MARKS)}")
    levels = [MARKS.index(mark) for mark in marks]
    weakest = levels.index(min(levels))
    result = nearest(item.rubric[weakest], item.follow_ups)
    place = weakest * len(item.follow_ups) // len(item.rubric)
    return item.rubric[weakest], item.follow_ups[place if result is None else result]


def markdown(interview: Interview) -> str:
    """Return the report as a page."""
    lines = [f"# Interview of {interview.started[:16].replace('T', ', ')}\n"]
    lines.append(f"{interview.seconds / 60:.0f} of {interview.minutes} minutes.\n")
    if interview.over:
        lines.append(f"The time was over during: {interview.over}\n")
    lines.append(
        "| part | chapter | minutes | planned | marks | asked |\n|---|---|---|---|---|---|"
    )
    for one in interview.items:
        spent = f"{one.seconds / 60:.0f} | {one.minutes} | {one.score:.0%}"
        lines.append(f"| {one.part} | {one.chapter} | {spent} | {one.title} |")
    for one in interview.items:
        lines.append(f"\n## {one.title}\n\n{one.answer}")
        if one.asked:
            lines.append(f"Weakest: {one.weakest}\n\n**{one.asked}**\n\n{one.reply}")
        lines += [f"* {attempt['verdict']}: {attempt['sentence']}" for attempt in one.attempts]
        lines += [f"\nRead {one.read}."] * bool(one.read)
    due = [f"* {key}" for key in interview.cards_due] or ["None."]
    return "\n".join([*lines, "\n## Cards now due\n", *due, ""])
