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
numbers in words it misses. Of the items of twelve weak answers that were graded by hand, kept with
the tests, it gives nine in ten the same level, and is too kind more often than too strict. So
read the passages, and correct it.
"""

import base64
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import Any

from course import role
from course.check import invalid, one_of
from course.interview import typed_numbers
from course.interview.fields import Figure, filled

FOLDER = Path(__file__).parent
NAMES = ("fleet_simulation", "pick_and_place", "dexterous_hand", "among_people")
LEVELS = ("missing", "named", "quantified", "defended")
WORDS = 1000  # of a model answer: two pages

_MIND = re.compile(
    r"\bchang\w* my mind\b|\bunless\b|\bI(?:'d| would) (?:switch|go back|fall back|drop|give up)\b",
    re.I,
)
# Sentences, from the one with the word on, in which its number and its doubt are looked for.
_NUMBER_WITHIN, _MIND_WITHIN = 2, 6
_AGES = {"least_ms": "least", "mean_ms": "mean", "greatest_ms": "greatest"}


@dataclass(frozen=True)
class Arrow:
    """What flows from one box to another.

    Hz times a second on a clock, or when something arrives (0); ms from what it is made of to its
    arrival.
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

    What it asks for, a regular expression for the words that name it, one for the units of a number
    that quantifies it, and words of the passage that earns it.
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
        title: the wording of the question.
        minutes: for all of it, five of them for `clarify`.
        clarify: questions to ask first, each with the interviewer's reply.
        topics: for each of `clarify`, regular expressions of words in questions about it.
        boxes: name -> (column, row) in the drawing.
        arrows: between them, along a row or a column.
        path: what flows along the chain whose age counts.
        follow_ups, red_flags: the next questions, and answers that end the interview.
        rubric: what an answer is scored by.
        answer: the model answer, Markdown.
    """

    name: str
    title: str
    minutes: int
    clarify: Sequence[str]
    topics: Sequence[Sequence[str]]
    boxes: Mapping[str, Sequence[int]]
    arrows: Sequence[Arrow]
    path: Sequence[str]
    follow_ups: Sequence[str]
    red_flags: Sequence[str]
    rubric: Sequence[Item]
    answer: str

    def __post_init__(self) -> None:
        def held(holds: bool, name: str, value: object, allowed: str) -> None:
            if not holds:
                raise ValueError(f"{self.name}: {name} must be {allowed}, got {value!r}")

        flows = {arrow.what: arrow for arrow in self.arrows}
        for arrow in self.arrows:
            for end in (arrow.start, arrow.end):
                held(end in self.boxes, "the end of an arrow", end, ", ".join(self.boxes))
            one, other = self.boxes[arrow.start], self.boxes[arrow.end]
            along = (one[0] == other[0]) != (one[1] == other[1])
            held(along, "an arrow", arrow.what, "along a row or a column")
        for what in self.path:
            held(what in flows, "path", what, f"one of the arrows {', '.join(flows)}")
        for before, what in pairwise(self.path):
            end = flows[before].end
            held(end == flows[what].start, "path", what, f"an arrow from {end}")
        held(8 <= len(self.rubric) <= 12, "rubric", len(self.rubric), "8 to 12 items")
        held(
            len(self.topics) == len(self.clarify), "topics", len(self.topics), "as many as clarify"
        )
        held(len(self.follow_ups) == 4, "follow_ups", len(self.follow_ups), "4")
        for item in self.rubric:
            result = self.answer.count(item.passage)
            held(result == 1, f"passage of {item.name}", item.passage, "words that it has once")
        held(len(self.answer.split()) <= WORDS, "the answer", "long", f"up to {WORDS} words")
        typed = ", ".join(typed_numbers("\n".join(self.texts())))
        held(not typed, "a typed number", typed, "a field such as {claim.figure:.3g}")

    def texts(self) -> list[str]:
        """Return all texts that a reader sees."""
        requested = [item.asks for item in self.rubric]
        return [self.answer, *self.clarify, *self.follow_ups, *self.red_flags, *requested]

    def filled(self, text: str, figure: Figure) -> str:
        """Return a text of it with the fields filled, those of the drawing too."""
        return filled(text, lambda a, b: self.drawn(b) if a == "drawing" else figure(a, b))

    def drawn(self, name: str) -> float:
        """Return a figure of the diagram.

        It is the path's age, as `mean_ms`, or a figure of an arrow, as `scan.hz`.
        """
        arrows = {arrow.what: arrow for arrow in self.arrows}
        if name in _AGES:
            along = [arrows[what] for what in self.path]
            stages = [role.Stage(a.what, 1e-3 * a.ms, 1 / a.hz if a.hz else None) for a in along]
            return 1e3 * float(getattr(role.age(stages), _AGES[name]))
        what, _, unit = name.rpartition(".")
        if what not in arrows or unit not in ("hz", "ms"):
            raise invalid("drawing", name, f"{', '.join(_AGES)}, or .hz or .ms of an arrow")
        return float(getattr(arrows[what], unit))

    def markdown(self, figure: Figure) -> str:
        """Return the design for a page: everything behind the question is folded away."""
        rubric = "\n".join(f"| {item.asks} | {item.passage} ... |" for item in self.rubric)
        picture = base64.b64encode(svg(self).encode()).decode()
        parts = {
            "Five minutes of questions": "* " + "\n* ".join(self.clarify),
            "A model answer": f'<img alt="What flows, how often and how late" '
            f'src="data:image/svg+xml;base64,{picture}"/>\n\n{self.answer}',
            "What comes next": "* " + "\n* ".join(self.follow_ups),
            "Red flags": "* " + "\n* ".join(self.red_flags),
            "What is listened for": f"| item | where the answer earns it |\n|---|---|\n{rubric}",
        }
        folded = [
            f"<details><summary>{head}</summary>\n\n{self.filled(body, figure)}\n\n</details>"
            for head, body in parts.items()
        ]
        return "\n\n".join([f"**{self.title}**", f"*{self.minutes} minutes*", *folded])


def read(name: str) -> Design:
    """Return the design of a name.

    Raises:
        ValueError: for an unknown name, a head that lacks something, or what `Design` refuses.
    """
    path = FOLDER / f"{one_of('name', name, NAMES)}.md"
    pieces = path.read_text(encoding="utf-8").split("+++\n")
    if len(pieces) != 3 or pieces[0].strip():
        raise invalid(f"lines +++ of {path.name}", len(pieces) - 1, "2, and the head between them")
    head: dict[str, Any] = tomllib.loads(pieces[1])
    keys = Design.__dataclass_fields__.keys() - {"name", "answer"}
    if head.keys() != keys:
        raise invalid(f"the head of {path.name}", sorted(head), ", ".join(sorted(keys)))
    head["arrows"] = [Arrow(**arrow) for arrow in head["arrows"]]
    head["rubric"] = [Item(**item) for item in head["rubric"]]
    return Design(name=name, answer=pieces[2].strip(), **head)


def passages(design: Design, figure: Figure) -> dict[str, str]:
    """Return for each item the paragraph of the model answer that earns it, with its figures."""
    blocks = design.answer.split("\n\n")
    earned = {i.name: next(b for b in blocks if i.passage in b) for i in design.rubric}
    return {name: design.filled(block, figure) for name, block in earned.items()}


def levels(design: Design, text: str) -> dict[str, str]:
    """Return the level of each item in a text, by the words in it.

    It is an aid, with the limits named above.
    """
    result = dict.fromkeys((item.name for item in design.rubric), 0)
    for block in re.split(r"\n\s*\n", text):
        sentences = re.split(r"(?<=[.!?])\s+", block.strip())
        for item in design.rubric:
            # Not "3 m" of "3 m/s": a unit ends where no letter and no fraction follows.
            number = re.compile(rf"\d[\d.,e+-]*\s*(?:[a-z]+ )?(?:{item.units})(?!\w|/\w)", re.I)
            for i, sentence in enumerate(sentences):
                if re.search(item.words, sentence, re.I):
                    figures = number.search(" ".join(sentences[i : i + _NUMBER_WITHIN]))
                    doubt = _MIND.search(" ".join(sentences[i : i + _MIND_WITHIN]))
                    level = 1 if not figures else 2 if not doubt else 3
                    result[item.name] = max(result[item.name], level)
    return {name: LEVELS[level] for name, level in result.items()}


def score(design: Design, answered: Mapping[str, str]) -> float:
    """Return the achieved share of the points, from a level for every item.

    Each item is worth three points.
    """
    return sum(_points(design, answered).values()) / (3 * len(design.rubric))


def weakest(design: Design, answered: Mapping[str, str]) -> Item:
    """Return the item to ask about next: the first of those with the lowest level."""
    return min(design.rubric, key=lambda item: _points(design, answered)[item.name])


def _points(design: Design, answered: Mapping[str, str]) -> dict[str, int]:
    items = [item.name for item in design.rubric]
    if set(answered) != set(items):
        raise invalid("answered", sorted(answered), f"a level for each of {', '.join(items)}")
    return {name: LEVELS.index(one_of(name, answered[name], LEVELS)) for name in items}


def plain(design: Design) -> str:
    """Return the drawing in lines for a terminal: from, what with rate and latency, to."""
    rows = [f"{a.start:>17} --{f' {a.what}, {a} ':-^38}-> {a.end}" for a in design.arrows]
    return "\n".join(rows)


def svg(design: Design) -> str:
    """Return the drawing.

    Boxes on a grid, an arrow on the right of its way, its words beside it.
    """
    middle = {box: (130 + 245 * c, 50 + 115 * r) for box, (c, r) in design.boxes.items()}
    marks = []
    for arrow in design.arrows:
        (x, y), (u, v) = middle[arrow.start], middle[arrow.end]
        a, b = ((z > 0) - (z < 0) for z in (u - x, v - y))
        # From rim to rim of boxes of 120 x 40, and 8 to the side: there may be an arrow back.
        rim = 60 if a else 20
        ends = (x + rim * a - 8 * b, y + rim * b + 8 * a, u - rim * a - 8 * b, v - rim * b + 8 * a)
        marks.append('<path d="M{} {}L{} {}" stroke="#36c" marker-end="url(#tip)"/>'.format(*ends))
        remaining, top = (ends[0] + ends[2]) // 2 - 6 * b, (ends[1] + ends[3]) // 2 + 18 * a
        anchor = ("start", "middle", "end")[b + 1]
        for words, row in ((arrow.what, -2), (arrow, 11)):
            marks.append(
                f'<text x="{remaining}" y="{top + row}" text-anchor="{anchor}">'
                f"{escape(str(words), quote=False)}</text>"
            )
    for box, (x, y) in middle.items():
        marks.append(
            f'<rect x="{x - 60}" y="{y - 20}" width="120" height="40" rx="4" '
            f'fill="#eef" stroke="#333"/><text x="{x}" y="{y + 4}" '
            f'text-anchor="middle">{escape(box, quote=False)}</text>'
        )
    wide, high = (max(axis) for axis in zip(*middle.values(), strict=True))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide + 130} {high + 50}" '
        f'width="{wide + 130}" font-family="sans-serif" font-size="12"><defs><marker id="tip" '
        'viewBox="0 0 8 8" refX="8" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        f'<path d="M0 0L8 4L0 8z" fill="#36c"/></marker></defs>{"".join(marks)}</svg>'
    )
