"""A rehearsed interview: the choice of questions, the follow-ups and the report.

Nothing here prints, waits or reads a clock; the command `drills interview` does.
"""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from course.check import invalid
from course.interview import FOLDER, Figure, designs, filled, questions, scenarios
from course.interview.designs import LEVELS as MARKS

PARTS = ("concept", "debugging", "coding", "design")
WEIGHT = 4  # how many times as likely as another one that is weak or due is drawn
MOST = 2  # items of one chapter in an interview, as long as there are others
FULL = 90  # minutes from which a system design is asked in full
SHORT = 15  # minutes of its short form
WEAK = 2 / 3  # an answer below this share, all lines "quantified", is weak
# What a follow-up asks about a line, by its mark: with a number in the line, and without one.
PUSH = {
    "missing": ("Your answer does not mention it. Answer now.",) * 2,
    "named": (
        "You mentioned it. Give a number with its unit.",
        "You mentioned it. Give the reason and an example.",
    ),
    "quantified": (
        "You gave a number for it. What would change your mind?",
        "You gave a reason for it. What would change your mind?",
    ),
}
_STEM = 4  # letters by which two words are taken for one: "halves", "halving"
# Stems of words that any question may have.
_COMMON = frozenset(
    word[:_STEM]
    for word in (
        "what which when where many much does that this with from have will must should could "
        "would there their they them your about into over some than then want need know make just "
        "like tell please also each ever only very been here were done"
    ).split()
)


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
        clarify: what a candidate may ask first, each with the interviewer's reply.
        topics: for each of `clarify`, words of questions about it, a regular expression.
        triggers: lines of the rubric that name a follow-up, each with its text.
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
    clarify: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    triggers: Mapping[str, str] = field(default_factory=dict)
    fill: Callable[[str, Figure], str] = filled
    aid: Callable[[str], Sequence[str]] = lambda answer: ()


@dataclass
class Entry:
    """What became of one item; each step is entered when it is over, an answer line by line.

    Attributes:
        key, part, chapter, minutes, title: of the item.
        task: the wording of the question below its title, "" where the title is all of it.
        seconds: spent on it.
        answer, answered: the answer so far, and whether it is complete.
        clarified: what the candidate asked first, each with the reply.
        rubric, marks: the lines of the rubric, and of `MARKS` one for each.
        weakest, asked, reply: the line marked lowest, the follow-up on it, and the reply.
        model: the model answer, once it was shown.
        attempts: verdict and sentence of each grading of a drill.
        code: the answer to a drill, as it was at its end.
        score: the share of all marks.
        read: what to read.
        done: whether the item is over.
    """

    key: str
    part: str
    chapter: int
    minutes: int
    title: str
    task: str = ""
    seconds: float = 0.0
    answer: str = ""
    answered: bool = False
    clarified: str = ""
    rubric: list[str] = field(default_factory=list)
    marks: list[str] = field(default_factory=list)
    weakest: str = ""
    asked: str = ""
    reply: str = ""
    model: str = ""
    attempts: list[dict[str, str]] = field(default_factory=list)
    code: str = ""
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

    A concept part may also be an estimate; what is written on a whiteboard belongs to coding.
    """
    result = []
    for topic in topics:
        for q in questions(topic) if (FOLDER / topic).is_dir() else ():
            part = q.kind if q.kind in PARTS else "concept"
            key, answer = f"question/{topic}/{q.name}", f"{q.minute}\n\n{q.full}"
            rest = (q.minutes, q.title, q.rubric, q.follow_ups, answer)
            result.append(Item(key, part, q.chapter, *rest, triggers=q.triggers))
    if "interview" in topics:
        result += [_scenario(scenarios.scenario(name)) for name in scenarios.scenario_names()]
        for name in designs.NAMES:
            result += [_design(designs.read(name)), _design(designs.read(name), SHORT)]
    return result


def _scenario(one: scenarios.Scenario) -> Item:
    """Return said aloud: the causes that one would think of, and how one would tell each."""
    causes = tuple(cause.words for cause in one.causes)
    probes = "\n".join(f"* {probe.what} ({probe.minutes} minutes)" for probe in one.probes)
    answer = f"Probes to run:\n\n{probes}\n\n`drills debug {one.name}` runs the scenario."
    question = "Which probe distinguishes this cause from the others?"
    report = tuple(f"{question} {words}" for words in causes)
    title = f"{one.title}.\n{one.prompt}"
    key = f"scenario/{one.name}"
    named = dict.fromkeys(causes, question)
    return Item(key, "debugging", 12, 10, title, causes, report, answer, triggers=named)


def _design(one: designs.Design, minutes: int = 0) -> Item:
    """Return a design in full, or its form of `minutes` minutes, which has every second line."""
    chosen = slice(None, None, 2 if minutes else 1)

    def aid(answer: str) -> list[str]:
        return list(designs.levels(one, answer).values())[chosen]

    flags = "\n".join(f"* {line}" for line in one.red_flags)
    answer = f"```text\n{designs.plain(one)}\n```\n\n{one.answer}\n\nRed flags:\n\n{flags}"
    title = one.title
    if minutes:
        title += (
            f"\nYou have {minutes} minutes: three for your questions and the rest for your answer. "
            "Concentrate on the decisions that matter, support them with numbers, and omit details."
        )
    return Item(
        key=f"design/{one.name}" + "/short" * bool(minutes),
        part="design",
        chapter=12,
        minutes=minutes or one.minutes,
        title=title,
        rubric=tuple(item.asks for item in one.rubric)[chosen],
        follow_ups=tuple(one.follow_ups),
        answer=answer,
        clarify=tuple(one.clarify),
        topics=tuple("|".join(alternatives) for alternatives in one.topics),
        fill=one.filled,
        aid=aid,
    )


def usual(
    pool: Sequence[Item], minutes: int, parts: Sequence[str] = PARTS, last: Collection[str] = ()
) -> list[Item]:
    """Return what an interview of these parts is drawn from.

    The design is a system design: in full from `FULL` minutes on, or if it is all that is asked and
    fits; else in its short form. The bug is a scenario that runs, unless it was asked for by its
    kind. Where the chosen chapters have none, or all were just asked, it is any question of that
    part.

    Args:
        pool: what there is.
        minutes: for all together.
        parts: of `PARTS`, that are asked.
        last: keys of the last interview's questions.
    """
    full = [i.minutes for i in pool if i.key.startswith("design/") and i.key.count("/") == 1]
    alone = list(parts) == ["design"] and minutes >= max(full, default=FULL)
    ends = "" if minutes >= FULL or alone else "/short"

    def fits(item: Item) -> bool:
        kind, _, name = item.key.partition("/")
        if item.part == "debugging":
            return kind == "scenario"
        return kind == "design" and name.endswith(ends) and name.count("/") == bool(ends)

    result = []
    for part in PARTS:
        items = [item for item in pool if item.part == part]
        ready = ("debugging", "design") if set(parts) == set(PARTS) else ("design",)
        chosen = [i for i in items if fits(i) and i.key not in last] if part in ready else items
        result += chosen or items
    return result


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
    even the shortest of each part fit together, the part whose shortest is longest is left out. No
    chapter has more than `MOST` items, as long as there are others.

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
    chosen: dict[str, Item] = {}
    # The part with the fewest chapters first: the others make room for it.
    for part in sorted(least, key=lambda part: len({i.chapter for i in other[part]})):
        others = [least[p] for p in least if p != part and p not in chosen]
        room = minutes - sum(others) - sum(item.minutes for item in chosen.values())
        fit = [item for item in other[part] if item.minutes <= max(room, least[part])]
        count = Counter(item.chapter for item in chosen.values())
        fit = [item for item in fit if count[item.chapter] < MOST] or fit
        weights = [WEIGHT if item.key in weak else 1 for item in fit]
        (chosen[part],) = rng.choices(fit, weights)
    return [chosen[part] for part in least]


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


def follow_up(item: Item, marks: Sequence[str], seed: int = 0) -> tuple[str, str]:
    """Return the line of the rubric that was marked lowest, and the follow-up on it.

    It is the follow-up that the line triggers, or else what its mark asks for; both name the line.
    Of several that were marked as low, one is drawn, first of those that trigger one; where all
    were defended there is no weak line, "", and one of the follow-ups of the question is drawn.
    """
    if len(marks) != len(item.rubric) or not set(marks) <= set(MARKS):
        raise invalid("marks", list(marks), f"{len(item.rubric)} of {', '.join(MARKS)}")
    rng = random.Random(f"{seed}/{item.key}")
    levels = [MARKS.index(mark) for mark in marks]
    if min(levels) == len(MARKS) - 1:
        return "", rng.choice(item.follow_ups)
    lowest = [at for at, level in enumerate(levels) if level == min(levels)]
    weakest = rng.choice([at for at in lowest if item.rubric[at] in item.triggers] or lowest)
    line = item.rubric[weakest]
    question = item.triggers.get(line, PUSH[marks[weakest]][not _has_number(line)])
    return line, f"“{line}” {question}"


def _has_number(line: str) -> bool:
    """Return whether a line of a rubric asks for a number: it has one, or a field for one."""
    return re.search(r"\d|\{", line) is not None


def reply(item: Item, question: str) -> str:
    """Return what the interviewer replies to a clarifying question; "" if nothing fits it.

    A reply fits a question that uses words of its topic; of several topics, the one with the most
    words, and of those the one that is named first. Where no topic fits, the reply and its question
    must share two words with what was asked. One word is no reason: "Which colour have the parts?"
    is not about how they change.
    """
    texts = [re.sub(r"\{.*?\}", "", text) for text in item.clarify]  # a field's name is no word
    replies = [text.partition("? ")[2] for text in item.clarify]
    for text, whole in zip(texts, replies, strict=True):
        if text.lower().startswith(question.lower().strip(" ?") + "?"):
            return whole
    used = [[m.start() for m in re.finditer(topic, question, re.I)] for topic in item.topics]
    if any(used):
        return replies[min(range(len(used)), key=lambda at: (-len(used[at]), *used[at][:1]))]
    requested = _stems(question) - _COMMON
    result = nearest(" ".join(requested), texts)
    if result is None or len(requested & _stems(texts[result])) < 2:
        return ""
    return replies[result]


def markdown(interview: Interview) -> str:
    """Return the report as a page: marks, answers, model answers, and what to review."""
    lines = [f"# Interview of {interview.started[:16].replace('T', ', ')}\n"]
    lines.append(f"{interview.seconds / 60:.0f} of {interview.minutes} minutes.\n")
    if interview.over:
        lines.append(f"The planned time ended during this question: {interview.over}\n")
    lines.append(
        "| part | chapter | minutes | planned | score | question |\n|---|---|---|---|---|---|"
    )
    for one in interview.items:
        spent = f"{one.seconds / 60:.0f} | {one.minutes} | {one.score:.0%}"
        lines.append(f"| {one.part} | {one.chapter} | {spent} | {one.title} |")
    for one in interview.items:
        lines.append(f"\n## {one.title}\n")
        if one.task:
            lines.append(f"### The task\n\n{one.task}\n")
        if one.clarified:
            lines.append(f"### Your questions\n\n{one.clarified}")
        if one.answer:
            written = _fenced(one.answer) if one.part == "coding" else one.answer
            lines.append(f"### Your answer\n\n{written}")
        if one.marks:
            lines.append("### Your marks\n\n| mark | line |\n|---|---|")
            rows = zip(one.marks, one.rubric, strict=False)
            lines += [f"| {mark} | {line.replace('|', '/')} |" for mark, line in rows]
            lines.append("")
        if one.code:
            lines.append(f"### Your code\n\n{_fenced(one.code, 'python')}")
        if one.attempts:
            tried = [f"* {attempt['verdict']}: {attempt['sentence']}" for attempt in one.attempts]
            lines += ["### Your attempts\n", *tried, ""]
        if one.asked:
            lines.append(f"### The follow-up\n\n**{one.asked}**\n\n{one.reply}")
        if one.model:
            lines.append(f"### The model answer\n\n{one.model}\n")
    lines.append("\n## What to review\n")
    weak = [one for one in interview.items if one.score < WEAK]
    lines += [f"* {sentence(f'Read {one.read}')}" for one in weak if one.read]
    if chapters := sorted({one.chapter for one in weak}):
        lines.append(f"* `drills review --chapters {','.join(map(str, chapters))}`")
    due = [f"* {key}" for key in interview.cards_due] or ["None."]
    return "\n".join([*lines, "\n## Cards now due\n", *due, ""])


def sentence(text: str) -> str:
    """Return a text with a full stop, unless it ends with a mark of its own."""
    return text if text.endswith((".", "?", "!")) else f"{text}."


def form(entry: Entry) -> str:
    """Return the kind of an item in words, with what there is to do."""
    kind = entry.key.partition("/")[0]
    named = {"scenario": "debugging with probes", "design": "system design", "drill": "graded code"}
    return named.get(kind, "code at a whiteboard" if entry.part == "coding" else entry.part)


def _fenced(text: str, language: str = "text") -> str:
    """Return a text as a block of code in Markdown."""
    fence = "```" + "`" * max(map(len, re.findall("`{3,}", text)), default=0)
    return f"{fence}{language}\n{text.rstrip()}\n{fence}\n"
