"""The interview: questions, one file each, with the answers that one would give.

A question is a Markdown file in `questions/TOPIC/`: what is known of it in a head of TOML between
two lines of `+++`, then a part `## In a minute` and a part `## In full`. Numbers are not typed: a
field such as `{claim.figure:.3g}` is filled when it is shown (`course.interview.fields`), so the
answer moves with the measurement.

The follow-ups are a list of texts. In a table instead, each has a key, by which a line of the
rubric names the follow-up that it triggers:

    rubric = ["A line.", { line = "Another line.", follow_up = "price" }]
    [follow_ups]
    price = "What does it cost?"
    test = "How do you test it?"

The chapter's algorithms, and the functions of their steps:

- Score intervals of a success rate (Wilson, 1927): `estimates.wilson_low`, `wilson_high`; the
  trials that a width, a gate or a comparison takes are `trials_for_width`, `trials_for_gate` and
  `trials_each`.
- Diagnosis by elimination: `scenarios.ruled_out` compares a probe with the range of each cause,
  `evidence` goes through the probes, `model_path` chooses them greedily.
- Metamorphic tests (Chen, Cheung and Yiu, 1998): `invariants.shift_error`, `mirror_error`,
  `turn_error` and the others need no right answer.
- Convergence as a test (Roache, 1998): `invariants.refined_ratio`.

Examples:
    >>> from course import interview
    >>> len(interview.questions("contact")) >= 12
    True
"""

import re
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from course import CHAPTERS
from course.interview.fields import FIELD, Figure
from course.interview.fields import filled as filled

FOLDER = Path(__file__).parent / "questions"
KINDS = ("concept", "debugging", "design", "estimate", "coding", "behavioural")
LEVELS = {1: "screen", 2: "senior", 3: "staff"}
PARTS = ("In a minute", "In full")

_CODE = re.compile(r"```.*?```|`[^`]*`", re.S)
_QUIET = re.compile(r"```.*?```|`[^`]*`|\{[^{}]*\}", re.S)
_MATH = re.compile(r"\$[^$]*\$", re.S)
# The number and edition of a standard are its name, such as ISO 10218-2:2025.
_STANDARD = re.compile(r"\b(?:ISO|IEC)(?:/T[SR])? \d+(?:-\d+)?:\d{4}\b")


@dataclass(frozen=True)
class Question:
    """One question of an interview.

    Attributes:
        name: of its file.
        title: the wording of the question.
        chapter: number of the chapter it belongs to.
        kind: one of `KINDS`.
        level: 1 to 3, a key of `LEVELS`.
        minutes: how long the conversation about it takes.
        probes: what the interviewer wants to find out.
        follow_ups: the next questions; in the file also the name of another question.
        rubric: the content of an answer, from the weakest to the best.
        minute, full: the answers, Markdown with fields that are not filled yet.
        triggers: the lines of the rubric that name a follow-up, each with its text.
    """

    name: str
    title: str
    chapter: int
    kind: str
    level: int
    minutes: int
    probes: str
    follow_ups: tuple[str, ...]
    rubric: tuple[str, ...]
    minute: str
    full: str
    triggers: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        def refuse(name: str, allowed: str) -> None:
            raise ValueError(f"{self.name}: {name} must be {allowed}, got {getattr(self, name)!r}")

        if not self.title.rstrip().endswith(("?", ".")):
            refuse("title", "a question or a request")
        if self.kind not in KINDS:
            refuse("kind", f"one of {', '.join(KINDS)}")
        if self.level not in LEVELS:
            refuse("level", "1, 2 or 3")
        if not any(self.chapter == chapter.number for chapter in CHAPTERS):
            refuse("chapter", f"from 0 to {max(chapter.number for chapter in CHAPTERS)}")
        if self.minutes < 1:
            refuse("minutes", "a positive number")
        for name in ("probes", "follow_ups", "rubric", "minute", "full"):
            if not getattr(self, name):
                refuse(name, "a text that is not empty")
        for text, result in (
            ("a number that is typed", typed_numbers(self._texts())),
            ("a field that nothing fills", unfilled(self._texts())),
        ):
            if result:
                raise ValueError(
                    f"{self.name}: {', '.join(result)} must be a field such as "
                    f"{{claim.figure:.3g}}, got {text}"
                )

    def fields(self) -> list[tuple[str, str]]:
        """Return what the texts quote, as (claim, name), ("estimate", name) or ("chart", steps)."""
        return [(m[1], m[2]) for m in FIELD.finditer(self._texts())]

    def _texts(self) -> str:
        return "\n".join((self.minute, self.full, *self.follow_ups, *self.rubric))

    def markdown(self, figure: Figure) -> str:
        """Return the question with its answers folded away, for a notebook or a page.

        Args:
            figure: (claim, name) -> the figure; `course.derivations.figure`.
        """

        def folded(head: str, body: str) -> str:
            return f"<details><summary>{head}</summary>\n\n{filled(body, figure)}\n\n</details>\n"

        lines = [f"<br>\n\n**{self.title}**\n", f"*{self.minutes} minutes*\n"]
        lines += [folded(*pair) for pair in zip(PARTS, (self.minute, self.full), strict=True)]
        lines.append(folded("What comes next", _listed(self.follow_ups)))
        listened = f"{self.probes}\n\n{_listed(self.listened())}"
        lines.append(folded("What is listened for", listened))
        return "\n".join(lines)

    def listened(self) -> tuple[str, ...]:
        """Return the lines of the rubric, each with the follow-up that it triggers."""
        named = {line: f" *Follow-up: {text}*" for line, text in self.triggers.items()}
        return tuple(line + named.get(line, "") for line in self.rubric)


def _listed(entries: tuple[str, ...]) -> str:
    return "\n".join(f"* {entry}" for entry in entries)


def typed_numbers(text: str) -> list[str]:
    """Return the numbers that a text types where it should quote a figure.

    A digit that belongs to a name (RK4, SO(3), ISO 13855:2024), to code or to a formula is no
    number; a decimal point in a formula is.
    """
    plain = _STANDARD.sub(" ", _QUIET.sub(" ", text))
    decimals = [d for math in _MATH.findall(plain) for d in re.findall(r"\d+\.\d+", math)]
    words = re.sub(r"[A-Za-z]+\(?\d+\)?", " ", _MATH.sub(" ", plain))
    return decimals + re.findall(r"\d[\d.,]*", words)


def unfilled(text: str) -> list[str]:
    """Return what stands in braces outside of code and formulas and is no field."""
    plain = _MATH.sub(" ", _CODE.sub(" ", text)).replace("\\{", "")
    return [part for part in re.findall(r"\{[^{}\n]*\}?", plain) if not FIELD.fullmatch(part)]


def read(path: Path) -> Question:
    """Return the question of a file.

    Raises:
        ValueError: for a head or a part that is missing, or what `Question` refuses; it names the
            file and the line.
    """
    text = path.read_text(encoding="utf-8")
    try:
        return _read(path, text)
    except ValueError as problem:
        message = str(problem).removeprefix(f"{path.stem}: ")
        raise ValueError(f"{path.name}, line {line_of(text, message)}: {message}") from None


def line_of(text: str, message: str) -> int:
    """Return the line of a file that a refusal is about, by the key or the words it begins with."""
    if report := re.search(r"\(at line (\d+), column", message):  # of TOML, counted without the +++
        return int(report[1]) + 1
    named = re.search(r"; (.+) is (?:unknown|missing)$|^a follow-up must be .*, got (.+)$", message)
    what = next(filter(None, named.groups())) if named else re.split(r", | must ", message)[0]
    word = re.escape(what)
    result: list[int] = []
    for pattern in (
        rf'follow_up\s*=\s*"{word}"',
        rf"^(?:{word}\s*=|## {word}$)",
        f'"{word}"',
        word,
    ):
        result += [i for i, row in enumerate(text.splitlines(), 1) if re.search(pattern, row)]
    return result[0] if result else 1


def _follow_up_text(entry: str) -> str:
    """Return a follow-up in words, where it is the name of another question."""
    if re.search(r"\s", entry):
        return entry
    for path in FOLDER.glob(f"*/{entry}.md"):
        return str(tomllib.loads(path.read_text(encoding="utf-8").split("+++\n")[1])["title"])
    raise ValueError(f"a follow-up must be a question or the name of one, got {entry}")


def _follow_ups(head: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a head that is about follow-ups, each by its text instead of its key."""
    named = head["follow_ups"] if isinstance(head["follow_ups"], dict) else {}
    texts = {key: _follow_up_text(entry) for key, entry in named.items()}
    rubric: list[str] = []
    triggers: dict[str, str] = {}
    for entry in head["rubric"]:
        if isinstance(entry, str):
            rubric.append(entry)
            continue
        if not isinstance(entry, dict) or entry.keys() != {"line", "follow_up"}:
            raise ValueError(f"rubric must be texts, or a line with its follow_up, got {entry}")
        key = entry["follow_up"]
        if key not in texts:
            known = ", ".join(texts) or "none: the follow-ups are a list"
            raise ValueError(f"a follow-up must be a key of [follow_ups] ({known}), got {key}")
        rubric.append(entry["line"])
        triggers[entry["line"]] = texts[key]
    listed = tuple(texts.values()) if named else tuple(map(_follow_up_text, head["follow_ups"]))
    return {"rubric": tuple(rubric), "follow_ups": listed, "triggers": triggers}


def _read(path: Path, text: str) -> Question:
    pieces = text.split("+++\n")
    if len(pieces) != 3 or pieces[0].strip():
        raise ValueError(
            f"+++ must be two lines, with the head between them, got {len(pieces) - 1}"
        )
    head = tomllib.loads(pieces[1])
    parts = re.split(r"^## (.+)\n", pieces[2], flags=re.M)[1:]
    named = dict(zip(parts[::2], parts[1::2], strict=True))
    for part in (*(set(named) - set(PARTS)), *(set(PARTS) - set(named))):
        problem = "unknown" if part in named else "missing"
        raise ValueError(f"parts must be {', '.join(PARTS)}; {part} is {problem}")
    derived = ("name", "minute", "full", "triggers")
    desired = [f for f in Question.__dataclass_fields__ if f not in derived]
    for key in (*(head.keys() - set(desired)), *(set(desired) - head.keys())):
        problem = "unknown" if key in head else "missing"
        raise ValueError(f"the head must have {', '.join(desired)}; {key} is {problem}")
    minute, full = (named[part].strip() for part in PARTS)
    return Question(name=path.stem, minute=minute, full=full, **head | _follow_ups(head))


def questions(topic: str, level: int | None = None) -> list[Question]:
    """Return the questions of a chapter, by level and name.

    Args:
        topic: of the chapter, such as "rigid_body".
        level: only those of one level.

    Raises:
        ValueError: for a topic without questions.
    """
    result = [read(path) for path in (FOLDER / topic).glob("*.md")]
    if not result:
        other = sorted(path.name for path in FOLDER.iterdir())
        raise ValueError(f"topic must be one of {', '.join(other)}, got {topic!r}")
    chosen = [q for q in result if level in (None, q.level)]
    return sorted(chosen, key=lambda q: (q.level, q.name))
