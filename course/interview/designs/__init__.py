"""Four system designs: asked, answered, drawn, and scored item by item.

A design is a file here in the form of a question: a head of TOML between two lines of `+++`, then
the model answer. Its numbers are fields, as `course.interview.fields` fills them, and besides
`{drawing.mean_ms:.0f}`: the drawing's arrows have rates and latencies, and `path` names those whose
age chapter 0 works out.

    from course.interview import designs
    design = designs.read("pick_and_place")
    found = designs.levels(design, text)             # item -> missing, named, quantified, defended
    designs.score(design, found), designs.weakest(design, found)

`levels` is an aid for grading oneself and no judge. It looks for words, for a number with a unit
beside them, and for a sentence that says what would change one's mind. It does not know whether the
number is right, a no from a yes, or a reason from a phrase; synonyms that a file does not name and
numbers in words it misses. Read the passages, and correct it.
"""

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

from course import role
from course.check import one_of, refused
from course.interview import typed_numbers
from course.interview.fields import Figure, filled

FOLDER = Path(__file__).parent
LEVELS = ("missing", "named", "quantified", "defended")
WORDS, ITEMS, FOLLOW_UPS = 900, range(8, 13), 4

_MIND = re.compile(
    r"\bchang\w* my mind\b|\bunless\b|\bI(?:'d| would) (?:switch|go back|drop|give up)\b", re.I
)
# Sentences behind the one with the word: in which its number, and in which its doubt is looked for.
_NUMBER_WITHIN, _MIND_WITHIN = 3, 6
_AGES = {"least_ms": "least", "mean_ms": "mean", "greatest_ms": "greatest"}


@dataclass(frozen=True)
class Arrow:
    """What flows from one box of the drawing to another.

    Attributes:
        start, end: names of boxes.
        what: flows.
        hz: how often it is sent on a clock; 0 where it is sent when something arrives.
        ms: from what it is made of to its arrival [ms].
    """

    start: str
    end: str
    what: str
    ms: float
    hz: float = 0.0

    def __str__(self) -> str:
        late = f"{1e-3 * self.ms:g} s" if self.ms >= 1000.0 else f"{self.ms:g} ms"
        return f"{self.hz:g} Hz, {late}" if self.hz else late


@dataclass(frozen=True)
class Item:
    """One line of a rubric.

    Attributes:
        name: of the item.
        asks: what is listened for.
        words: a regular expression; what it finds, names the item.
        units: one that stands behind the number that makes it quantified.
        passage: words of the model answer, in the paragraph that earns the item.
    """

    name: str
    asks: str
    words: str
    units: str
    passage: str


@dataclass(frozen=True)
class Design:
    """A design; texts have fields that are not filled yet.

    Attributes:
        name: of its file.
        title: the question, as it is asked.
        minutes: for all of it, five of them for `clarify`.
        clarify: what to ask first, each with what the interviewer says.
        boxes: name -> (column, row) in the drawing.
        arrows: between them.
        path: what flows along the chain whose age counts.
        follow_ups, red_flags: what is asked next, and what ends the talk.
        rubric: what an answer is scored by.
        answer: the model answer, Markdown.
    """

    name: str
    title: str
    minutes: int
    clarify: tuple[str, ...]
    boxes: Mapping[str, tuple[int, int]]
    arrows: tuple[Arrow, ...]
    path: tuple[str, ...]
    follow_ups: tuple[str, ...]
    red_flags: tuple[str, ...]
    rubric: tuple[Item, ...]
    answer: str

    def __post_init__(self) -> None:
        def refuse(name: str, value: object, allowed: str) -> None:
            raise ValueError(f"{self.name}: {name} is {value!r}, allowed is {allowed}")

        flows = [arrow.what for arrow in self.arrows]
        for arrow in self.arrows:
            ends = (arrow.start, arrow.end)
            for end in set(ends) - self.boxes.keys():
                refuse("the end of an arrow", end, ", ".join(self.boxes))
            if sum(p == q for p, q in zip(*(self.boxes[b] for b in ends), strict=True)) != 1:
                refuse("an arrow", arrow.what, "along a row or a column")
        for what in self.path:
            if flows.count(what) != 1:
                refuse("path", what, f"one of the arrows {', '.join(flows)}")
        along = [self.arrows[flows.index(what)] for what in self.path]
        for one, other in pairwise(along):
            if one.end != other.start:
                refuse("path", other.what, f"an arrow from {one.end}")
        if len(self.rubric) not in ITEMS:
            refuse("rubric", len(self.rubric), f"{ITEMS.start} to {ITEMS.stop - 1} items")
        if len(self.follow_ups) != FOLLOW_UPS or not self.red_flags or not self.clarify:
            refuse("follow_ups", len(self.follow_ups), f"{FOLLOW_UPS}, and red flags and clarify")
        for item in self.rubric:
            if self.answer.count(item.passage) != 1:
                refuse(f"passage of {item.name}", item.passage, "words that the answer has once")
        if len(self.answer.split()) > WORDS:
            refuse("the answer", len(self.answer.split()), f"up to {WORDS} words")
        if typed := typed_numbers("\n".join(self.texts())):
            refuse("a typed number", ", ".join(typed), "a field such as {claim.figure:.3g}")

    def texts(self) -> tuple[str, ...]:
        """All texts that a reader sees."""
        asked = tuple(item.asks for item in self.rubric)
        return (self.answer, *self.clarify, *self.follow_ups, *self.red_flags, *asked)

    def filled(self, text: str, figure: Figure) -> str:
        """A text of it with the fields filled, those of the drawing too."""

        def value(source: str, name: str) -> float | str:
            return self.drawn(name) if source == "drawing" else figure(source, name)

        return filled(text, value)

    def drawn(self, name: str) -> float:
        """A figure of the drawing: the path's age, as `mean_ms`, or of an arrow, as `scan.hz`."""
        arrows = {arrow.what: arrow for arrow in self.arrows}
        if name in _AGES:
            along = [arrows[what] for what in self.path]
            stages = [role.Stage(a.what, 1e-3 * a.ms, 1 / a.hz if a.hz else None) for a in along]
            return 1e3 * float(getattr(role.age(stages), _AGES[name]))
        what, _, unit = name.rpartition(".")
        if what not in arrows or unit not in ("hz", "ms"):
            raise refused("drawing", name, f"{', '.join(_AGES)}, or .hz or .ms of an arrow")
        return float(getattr(arrows[what], unit))

    def markdown(self, figure: Figure) -> str:
        """The design for a page: everything behind the question is folded away."""

        def folded(head: str, body: str) -> str:
            text = self.filled(body, figure)
            return f"<details><summary>{head}</summary>\n\n{text}\n\n</details>\n"

        def listed(entries: tuple[str, ...]) -> str:
            return "\n".join(f"* {entry}" for entry in entries)

        rubric = "\n".join(f"| {item.asks} | {item.passage} ... |" for item in self.rubric)
        parts = {
            "Five minutes of questions": listed(self.clarify),
            "A model answer": f"{svg(self)}\n\n{self.answer}",
            "What comes next": listed(self.follow_ups),
            "Red flags": listed(self.red_flags),
            "What is listened for": f"| item | where the answer earns it |\n|---|---|\n{rubric}",
        }
        head = f"**{self.title}**\n\n*{self.minutes} minutes*\n"
        return "\n".join([head, *(folded(*part) for part in parts.items())])


def names() -> list[str]:
    """The designs, in the order in which they are asked."""
    return ["fleet_simulation", "pick_and_place", "dexterous_hand", "among_people"]


def read(name: str) -> Design:
    """The design of a name.

    Raises:
        ValueError: for an unknown name, a head that lacks something, or what `Design` refuses.
    """
    path = FOLDER / f"{one_of('name', name, names())}.md"
    pieces = path.read_text(encoding="utf-8").split("+++\n")
    if len(pieces) != 3 or pieces[0].strip():
        raise refused(f"{path.name}: lines +++", len(pieces) - 1, "a head in two")
    head: dict[str, Any] = tomllib.loads(pieces[1])
    keys = {"title", "minutes", "clarify", "boxes", "arrows", "path", "follow_ups", "red_flags"}
    if head.keys() != keys | {"rubric"}:
        raise refused(f"{path.name}: head", sorted(head), ", ".join(sorted(keys | {"rubric"})))
    texts = {key: tuple(head[key]) for key in ("clarify", "path", "follow_ups", "red_flags")}
    return Design(
        name=name,
        title=head["title"],
        minutes=head["minutes"],
        boxes={box: (at[0], at[1]) for box, at in head["boxes"].items()},
        arrows=tuple(Arrow(**arrow) for arrow in head["arrows"]),
        rubric=tuple(Item(**item) for item in head["rubric"]),
        answer=pieces[2].strip(),
        **texts,
    )


def passages(design: Design, figure: Figure) -> dict[str, str]:
    """For each item the paragraph of the model answer that earns it, with its figures."""
    found = {}
    for item in design.rubric:
        block = next(b for b in design.answer.split("\n\n") if item.passage in b)
        found[item.name] = design.filled(block, figure)
    return found


def levels(design: Design, text: str) -> dict[str, str]:
    """The level of each item in a text, by the words in it; an aid, with the limits named above."""
    found = dict.fromkeys((item.name for item in design.rubric), 0)
    for block in re.split(r"\n\s*\n", text):
        sentences = re.split(r"(?<=[.!?])\s+", block.strip())
        for item in design.rubric:
            for i in range(len(sentences)):
                if not re.search(item.words, sentences[i], re.I):
                    continue
                near = " ".join(sentences[i : i + _NUMBER_WITHIN])
                level = 1 + bool(re.search(rf"\d[\d.,e+-]*\s*(?:{item.units})(?!\w)", near, re.I))
                level += level == 2 and bool(
                    _MIND.search(" ".join(sentences[i : i + _MIND_WITHIN]))
                )
                found[item.name] = max(found[item.name], level)
    return {name: LEVELS[level] for name, level in found.items()}


def score(design: Design, answered: Mapping[str, str]) -> float:
    """The share of all that could be earned: a step of a level is one point.

    Args:
        answered: the level of every item, one of `LEVELS`.
    """
    return sum(_points(design, answered).values()) / (3 * len(design.rubric))


def weakest(design: Design, answered: Mapping[str, str]) -> Item:
    """The item to ask about next: the first of those with the lowest level."""
    points = _points(design, answered)
    return min(design.rubric, key=lambda item: points[item.name])


def _points(design: Design, answered: Mapping[str, str]) -> dict[str, int]:
    items = [item.name for item in design.rubric]
    if set(answered) != set(items):
        raise refused("answered", sorted(answered), f"a level for each of {', '.join(items)}")
    return {name: LEVELS.index(one_of(name, answered[name], LEVELS)) for name in items}


def plain(design: Design) -> str:
    """The drawing in lines for a terminal: from, what with rate and latency, to."""
    wide = max(len(arrow.start) for arrow in design.arrows)
    rows = [f"{a.start:>{wide}} --{f' {a.what}, {a} ':-^44}-> {a.end}" for a in design.arrows]
    return "\n".join(rows)


def svg(design: Design) -> str:
    """The drawing: boxes on a grid, an arrow on the right of its way, its words beside it."""
    middle = {box: (70 + 245 * c, 50 + 115 * r) for box, (c, r) in design.boxes.items()}
    marks = []
    for arrow in design.arrows:
        (x, y), (u, v) = middle[arrow.start], middle[arrow.end]
        far = math.hypot(u - x, v - y)
        along, aside = ((u - x) / far, (v - y) / far), ((y - v) / far, (u - x) / far)
        # To the rim of a box of 120 x 40, and 8 to the side: there may be an arrow back.
        rim = 60 if y == v else 20
        x1, y1 = (p + rim * a + 8 * s for p, a, s in zip((x, y), along, aside, strict=True))
        x2, y2 = (p - rim * a + 8 * s for p, a, s in zip((u, v), along, aside, strict=True))
        at = (0.5 * (x1 + x2) + 6 * aside[0], 0.5 * (y1 + y2) + 18 * aside[1])
        anchor = {-1: "end", 0: "middle", 1: "start"}[round(aside[0])]
        marks.append(f'<path d="M{x1:.0f} {y1:.0f}L{x2:.0f} {y2:.0f}" stroke="#36c" '
                     'marker-end="url(#tip)"/>')  # fmt: skip
        marks += [f'<text x="{at[0]:.0f}" y="{at[1] + row:.0f}" text-anchor="{anchor}">'
                  f"{escape(words)}</text>"
                  for words, row in ((arrow.what, -2), (str(arrow), 11))]  # fmt: skip
    for box, (x, y) in middle.items():
        marks.append(f'<rect x="{x - 60}" y="{y - 20}" width="120" height="40" rx="4" '
                     f'fill="#eef" stroke="#333"/><text x="{x}" y="{y + 4}" '
                     f'text-anchor="middle">{escape(box)}</text>')  # fmt: skip
    wide, high = (max(axis) for axis in zip(*middle.values(), strict=True))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide + 70} {high + 50}" '
        f'width="{wide + 70}" font-family="sans-serif" font-size="12"><defs><marker id="tip" '
        'viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        f'<path d="M0 0L8 4L0 8z" fill="#36c"/></marker></defs>{"".join(marks)}</svg>'
    )
