"""The checkpoint of a chapter: five questions, drawn by a seed from all that the chapter has.

    from course.cards import draws

    draws.draw("contact", seed=1)      # the five questions of draw 1
    draws.checkpoint("contact", ["2", "", "", "", ""], seed=1)    # with answers, graded

Each draw has a formula that the chapter's page does not show, an estimate, another formula, and two
claims with different verdicts. The pools are the chapter's claims
(`course.derivations`) and the tables `[[estimate]]` in its file of cards:

    [[estimate]]
    name = "fall_of_a_mug"
    ask = "How long does a fall of {mug.height_m:g} m take?"
    figure = "mug.time_s"       # the right value, on record
    unit = "s"
    factor = 1.3                # an answer within this factor is right
    rule = "sqrt(2 * {mug.height_m} / 9.81)"    # how to reach it from what the question states

A question has a rank in each draw, a hash of the seed and its key (rendezvous hashing: Thaler and
Ravishankar, 1998), and a draw takes the lowest ranks. So a new question changes only the draws in
which it appears, and `page.js` draws the same questions on the site.
"""

from __future__ import annotations

import functools
import html
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from course.cards.files import gate, read
from course.check import count as checked_count
from course.check import invalid
from course.derivations.markup import Answer, Shown, folded, tex
from course.interview import filled, typed_numbers

if TYPE_CHECKING:
    from course.derivations import Claim

# Part -> questions in a draw, the smallest pools first: no two questions share a claim.
PARTS = {"derive": 1, "estimate": 1, "formula": 1, "claim": 2}
_WORD = 0xFFFFFFFF
# What a learner may type for a verdict; the first letters are enough.
_VERDICTS = {"true": "holds", "false": "false", "only if": "holds only if"}
_HOW = (
    "Type your answers into the list: a formula, a number, and `true`, `false` or `only if` for a "
    "claim. Another `seed` draws other questions."
)
_ON_PAGE = {"holds": "True", "false": "False", "holds only if": "Only under a condition"}


class Gate(Shown):
    """The questions of a checkpoint with their verdicts, and whether it is passed."""

    def __init__(self, text: str, markdown: str, passed: bool) -> None:
        super().__init__(text, markdown)
        self.passed = passed


@dataclass(frozen=True)
class Graded:
    """The verdict on one answer.

    Attributes:
        right: whether it is right.
        text: the verdict with its reason, as plain text.
        markdown: the same as Markdown.
    """

    right: bool
    text: str
    markdown: str


@dataclass(frozen=True)
class Formula:
    """A question for a formula.

    Attributes:
        claim: id of the claim that it belongs to.
        part: "derive" if the chapter's page does not show the formula, else "formula".
    """

    claim: str
    part: str

    @property
    def key(self) -> str:
        """Its name among all questions of the chapter."""
        return f"formula.{self.claim}"

    def ask(self) -> str:
        """Return the question with its symbols, Markdown."""
        from course.derivations import formula

        requested = formula(self.claim)
        symbols = [f"`{name}`: {one.meaning}" for name, one in requested.symbols.items()]
        meaning = f" ({'; '.join(symbols)})" if symbols else ""
        return f"**Formula.** {tex(requested.question, _claim(self.claim).topic)}{meaning}"

    def grade(self, text: str) -> Graded:
        """Return whether a formula as text is right."""
        from course.derivations import answer

        result = answer(self.claim, text)
        return Graded(bool(result), repr(result), result.verdict())

    def answers(self) -> list[Answer]:
        """Return the right formula and the plausible wrong ones, in an order that hides it."""
        from course.derivations import formula

        requested = formula(self.claim)
        topic = _claim(self.claim).topic
        wrong = [
            Answer(_code(slip), False, f"**No.** {tex(why, topic)}")
            for slip, why in requested.slips.items()
        ]
        right = Answer(_code(requested.expression), True, "**Right.**")
        return sorted([right, *wrong], key=lambda answer: rank(0, answer.label))

    def why(self) -> str:
        """Return the explanation, Markdown."""
        return _behind(self.claim)


@dataclass(frozen=True)
class Verdict:
    """A question whether a claim is true, false, or true only under a condition.

    Attributes:
        claim: its id.
        verdict: as it is on record: "holds", "false" or "holds only if".
    """

    claim: str
    verdict: str
    part: str = "claim"

    @property
    def key(self) -> str:
        """Its name among all questions of the chapter."""
        return f"claim.{self.claim}"

    def ask(self) -> str:
        """Return the claim as it is commonly made, Markdown."""
        return f"**Claim.** “{tex(_claim(self.claim).claim, _claim(self.claim).topic)}”"

    def grade(self, text: str) -> Graded:
        """Return whether a verdict is right: `true`, `false` or `only if`."""
        typed = "only" if "only" in text.lower() else text.lower()
        matching = [verdict for word, verdict in _VERDICTS.items() if word.startswith(typed)]
        if len(matching) != 1:
            message = f"Not graded: {text!r} is none of `true`, `false`, `only if`."
            return Graded(False, message, message)
        right = matching[0] == self.verdict
        head = "Right." if right else "Not right."
        plain = f"{head} The verdict is: {self.verdict}."
        return Graded(right, plain, f"**{head}** {self.why()}")

    def answers(self) -> list[Answer]:
        """Return the three verdicts, one of them right."""
        return [
            Answer(
                label,
                verdict == self.verdict,
                "**Right.**" if verdict == self.verdict else "**No.**",
            )
            for verdict, label in _ON_PAGE.items()
        ]

    def why(self) -> str:
        """Return the explanation, Markdown."""
        return _explanation(self.claim)


@dataclass(frozen=True)
class Estimate:
    """A number to estimate.

    Attributes:
        name: in the chapter's file.
        question: Markdown with fields for figures.
        figure: the right value, "claim.figure".
        unit: of the value; "" for none.
        factor: an answer within this factor is right.
        rule: how to reach the value, arithmetic with fields for figures.
    """

    name: str
    question: str
    figure: str
    unit: str
    factor: float
    rule: str
    part: str = "estimate"

    def __post_init__(self) -> None:
        if not self.question.rstrip().endswith("?"):
            raise invalid(f"{self.name}: ask", self.question, "a question")
        if not 1.0 < self.factor <= 3.0:
            raise invalid(f"{self.name}: factor", self.factor, "above 1 and at most 3")
        if typed := typed_numbers(self.question):
            raise invalid(f"{self.name}: ask", typed, "a field such as {claim.figure:.3g}")

    @property
    def key(self) -> str:
        """Its name among all questions of the chapter."""
        return f"estimate.{self.name}"

    @property
    def claim(self) -> str:
        """Id of the claim whose figure is asked for."""
        return self.figure.partition(".")[0]

    def value(self) -> float:
        """Return the right value, from the record of claims."""
        from course.derivations.records import figure

        claim, _, name = self.figure.partition(".")
        return float(figure(claim, name))

    def ask(self) -> str:
        """Return the question, its unit and how exact an answer must be, Markdown."""
        from course.derivations.records import figure

        unit = f"in {self.unit}, " if self.unit else ""
        exact = f"({unit}within a factor of {self.factor:g})"
        return f"**Estimate.** {filled(self.question, figure)} {exact}"

    def grade(self, text: str) -> Graded:
        """Return whether a number, or arithmetic such as `2*sqrt(1/100)`, is near enough."""
        from course.derivations.answer import evaluate

        try:
            number = evaluate(text.removesuffix(self.unit).strip() or text)
        except ValueError as problem:
            message = f"Not graded: {problem}."
            return Graded(False, message, message.replace("`", "'"))
        value = self.value()
        right = number / value > 0 and abs(math.log(number / value)) <= math.log(self.factor)
        head = "Right." if right else "Not right."
        return Graded(right, f"{head} {self._plain()}", f"**{head}** {self.why()}")

    def rule_text(self) -> str:
        """Return the arithmetic that leads to the value, with its figures."""
        from course.derivations.records import figure

        return filled(self.rule, figure)

    def _plain(self) -> str:
        return f"The value is {self.value():.3g} {self.unit}".rstrip() + f"; {self.rule_text()}."

    def why(self) -> str:
        """Return the value, the arithmetic that leads to it, and the claim, Markdown."""
        value = f"{self.value():.3g} {self.unit}".rstrip()
        rule = f"The value on record is {value}. By hand: `{self.rule_text()}`."
        return f"{rule}\n\n{folded('The claim behind it', _behind(self.claim))}"


Question = Formula | Verdict | Estimate


def _claim(id: str) -> Claim:
    from course.derivations import CLAIMS, claims

    claims()  # imports the files that declare them
    return CLAIMS[id]


def _code(expression: str) -> str:
    return f"<code>{html.escape(expression)}</code>"


def _explanation(id: str) -> str:
    """Return the verdict of a claim and what is true, from the record; Markdown."""
    from course.derivations import Block, recorded

    block = Block(recorded(id, _claim(id).file))
    topic = block.outcome.claim.topic
    return f"{tex(block.verdict, topic)} {tex(block.outcome.corrected, topic)}"


def _behind(id: str) -> str:
    """Return the claim that a formula or a figure belongs to, and its explanation; Markdown."""
    return f"It belongs to the claim “{tex(_claim(id).claim, _claim(id).topic)}” {_explanation(id)}"


def rank(seed: int, key: str) -> int:
    """Return the rank of a question in a draw; the lowest are drawn.

    The hash is FNV-1a with the finaliser of MurmurHash3, on 32 bits, as in `page.js`.

    Args:
        seed: of the draw.
        key: of the question, in ASCII.
    """
    h = 0x811C9DC5
    for byte in f"{seed}/{key}".encode():
        h = (h ^ byte) * 0x01000193 & _WORD
    h = (h ^ h >> 16) * 0x85EBCA6B & _WORD
    h = (h ^ h >> 13) * 0xC2B2AE35 & _WORD
    return h ^ h >> 16


def estimates(topic: str) -> list[Estimate]:
    """Return the estimates of a chapter.

    Raises:
        ValueError: for a topic that has no file, or an entry that is not whole.
    """
    return [
        Estimate(one["name"], one["ask"], one["figure"], one["unit"], one["factor"], one["rule"])
        for one in read(topic).get("estimate", [])
    ]


@functools.cache
def pool(topic: str) -> tuple[Question, ...]:
    """Return all questions from which the checkpoint of a chapter is drawn.

    Raises:
        ValueError: for a topic that has no file.
    """
    from course.derivations import claims, records

    hidden = gate(topic)
    mine = [item for item in claims() if item.file.partition(".")[0] == topic]
    verdicts = {item.file: records.load(item.file) for item in mine}
    formulas = [
        Formula(item.id, "derive" if item.id in hidden else "formula")
        for item in mine
        if item.formula is not None
    ]
    judged = [Verdict(item.id, verdicts[item.file][item.id]["verdict"]) for item in mine]
    return (*formulas, *judged, *estimates(topic))


def draw(topic: str, seed: int) -> list[Question]:
    """Return the five questions of a draw, no two of them about the same claim.

    Args:
        topic: of the chapter.
        seed: number of the draw, 1 or more.

    Returns:
        A formula that is not on the chapter's page, an estimate, another formula, and two claims
        with different verdicts.

    Raises:
        ValueError: for a topic without questions, or a seed that is not a positive integer.
    """
    checked_count("seed", seed, 1)
    ranked = sorted(pool(topic), key=lambda question: (rank(seed, question.key), question.key))
    drawn: list[Question] = []
    for part, count in PARTS.items():
        for _ in range(count):
            claims = {question.claim for question in drawn}
            # With two different verdicts no habit is right more than once.
            verdicts = {q.verdict for q in drawn if isinstance(q, Verdict)}
            drawn += [
                question
                for question in ranked
                if part in (question.part, "formula" if isinstance(question, Formula) else "")
                and question.claim not in claims
                and (not isinstance(question, Verdict) or question.verdict not in verdicts)
            ][:1]
    return drawn


def checkpoint(
    topic: str, answers: Sequence[str] | None = None, seed: int = 1, **formulas: str
) -> Gate:
    """Return the checkpoint of a chapter: five questions drawn by a seed, graded.

    Args:
        topic: of the chapter.
        answers: one text for each question, in order; "" is open. A formula as text; `true`,
            `false` or `only if` for a claim; a number for an estimate.
        seed: number of the draw; another one draws other questions.
        **formulas: instead of answers, a formula for each of the three claims that the chapter's
            file names, as in notebooks from before there were draws.

    Returns:
        The questions with what is right and what is not; passed when all are right.

    Raises:
        ValueError: for a topic without a checkpoint, answers that are not as many texts as
            questions, a name that is not in the file, or both kinds of answers.
    """
    if formulas:
        if answers is not None:
            raise invalid("formulas", list(formulas), "left out where answers are a list")
        questions: list[Question] = [Formula(name, "derive") for name in gate(topic)]
        names = [question.claim for question in questions]
        for name, text in formulas.items():
            if name not in names:
                raise invalid("answers", name, f"one of {', '.join(names)}")
            if not isinstance(text, str):
                raise invalid(name, text, "a formula as text")
        return _graded(questions, [formulas.get(name, "") for name in names])
    questions = draw(topic, seed)
    texts = [""] * len(questions) if answers is None else answers
    if isinstance(texts, str) or not all(isinstance(text, str) for text in texts):
        raise invalid("answers", answers, "a list of texts")
    if len(texts) != len(questions):
        raise invalid("answers", answers, f"{len(questions)} texts, one for each question")
    return _graded(questions, texts, seed)


def _graded(questions: Sequence[Question], texts: Sequence[str], seed: int = 0) -> Gate:
    lines, plain, right = [], [], 0
    for number, (question, text) in enumerate(zip(questions, texts, strict=True), 1):
        graded = question.grade(text.strip()) if text.strip() else None
        right += graded is not None and graded.right
        state = "Open." if graded is None else graded.markdown
        # Indented, so that a fold-out in the verdict stays a part of its entry.
        body = f"{question.ask()}  \n{state}".replace("\n", "\n   ")
        lines.append(f"{number}. {body}")
        reported = "open" if graded is None else graded.text
        plain.append(f"{number} {question.key if graded else question.part}: {reported}")
    passed = right == len(questions)
    state = "passed" if passed else "open"
    name = f"Draw {seed}" if seed else "Formulas"
    verdict = f"{name}: {right} of {len(questions)} right, checkpoint {state}"
    lines += [f"**{verdict}.** {_HOW}" if seed else f"**{verdict}.**"]
    return Gate("\n".join([*plain, verdict]), "\n\n".join(lines), passed)


def offered(topic: str) -> str:
    """Return the pool of a chapter for the site, where `page.js` draws from it; Markdown.

    Without that script the page shows draw 1. The elements and attributes are:

        <div class="course-checkpoint" data-topic="TOPIC">
          <div class="checkpoint-question" data-key="claim.NAME" data-part="claim"
              data-claim="NAME" data-verdict="false">      an estimate has data-value, data-factor
            <details class="answer" data-answer="True" data-right="no">    none for an estimate
            <details class="why">

    Raises:
        ValueError: for a topic without questions.
    """
    first = {question.key for question in draw(topic, 1)}
    parts = [f'<div class="course-checkpoint" data-topic="{topic}">']
    for question in pool(topic):
        given = {"key": question.key, "part": question.part, "claim": question.claim}
        answers: list[Answer] = []
        match question:
            case Verdict():
                given["verdict"] = question.verdict
                answers = question.answers()
            case Formula():
                answers = question.answers()
            case Estimate():
                given |= {"value": repr(question.value()), "factor": f"{question.factor:g}"}
                given["unit"] = question.unit
        attributes = " ".join(f'data-{key}="{html.escape(text)}"' for key, text in given.items())
        hidden = "" if question.key in first else " hidden"
        parts += [f'<div class="checkpoint-question" {attributes}{hidden}>', question.ask()]
        for answer in answers:
            label = html.escape(html.unescape(re.sub(r"<[^>]*>", "", answer.label)))
            parts.append(
                f'<details class="answer" data-answer="{label}" '
                f'data-right="{"yes" if answer.right else "no"}"><summary>{answer.label}</summary>'
                f"\n\n{answer.body}\n\n</details>"
            )
        summary = "Explanation" if answers else "The value and how to reach it"
        why = f"<summary>{summary}</summary>\n\n{question.why()}\n\n</details>"
        parts += [f'<details class="why">{why}', "</div>"]
    return "\n\n".join([*parts, "</div>"])
