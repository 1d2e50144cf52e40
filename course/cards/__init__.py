"""Cards of a notebook: a question that is answered before anything is shown, figures to unfold.

    from course.cards import figures, predict, unplaced

    predict("energy_on_a_spring")              # a question of the chapter's file, by its name
    figures(read("chatter"), "MuJoCo Euler")   # the rows that matter; the rest is folded
    unplaced("contact")                        # claims that no notebook shows

A card is HTML and Markdown without a script: a click on an option unfolds whether it is right and
why, also in a saved notebook without a kernel. `course.derivations.markup` documents its elements,
ids and attributes, by which the site and a running notebook remember what was answered. Questions
and vocabulary of a chapter stand in `TOPIC.toml` beside this file, so that a cell doesn't give the
answer away:

    vocabulary = ["inertia tensor", ...]    # each in bold where the chapter defines it
    synonyms = [["moment of inertia", "inertia tensor"], ...]  # a word, and the term it leads to
    checkpoint = ["verlet_frequency", ...]  # claims whose formulas are not on the chapter's page

    [[estimate]]                            # numbers to estimate: see `course.cards.draws`

    [energy_on_a_spring]
    ask = "The question?"
    options = [["one answer", true, "Why it is right, with {claim.figure:.2f}."], ...]

Fields are filled from the figures on record of `course.derivations`; a typed number is refused.
"""

import functools
import re
from dataclasses import dataclass
from pathlib import Path

from course import CHAPTERS
from course.cards.draws import Gate, checkpoint
from course.cards.files import FOLDER, gate, read
from course.check import invalid, one_of
from course.derivations.markup import Answer, Shown, card, figures, folded, tex
from course.interview import LEVELS, filled, questions, typed_numbers

__all__ = [
    "FOLDER",
    "Answer",
    "Gate",
    "Option",
    "Prediction",
    "Shown",
    "card",
    "checkpoint",
    "figures",
    "folded",
    "gate",
    "interview",
    "placed_in",
    "predict",
    "predictions",
    "synonyms",
    "tex",
    "unplaced",
    "vocabulary",
]


@dataclass(frozen=True)
class Option:
    """One answer to a question.

    Attributes:
        label: what the reader clicks on; raw HTML, so without < and >. It may have fields too, but
            a number in only one label tells which answer is right.
        right: whether it is the right one.
        why: Markdown with fields for figures.
    """

    label: str
    right: bool
    why: str


@dataclass(frozen=True)
class Prediction:
    """A question that is answered before anything is shown.

    Attributes:
        name: in its file.
        ask: the question, Markdown with fields for figures.
        options: the answers, one of them right.
    """

    name: str
    ask: str
    options: tuple[Option, ...]

    def __post_init__(self) -> None:
        if not self.ask.rstrip().endswith("?"):
            raise invalid(f"{self.name}: ask", self.ask, "a question")
        if len(self.options) < 2 or sum(option.right for option in self.options) != 1:
            labels = [option.label for option in self.options]
            raise invalid(f"{self.name}: options", labels, "two or more, one of them right")
        for option in self.options:
            if set(option.label) & set("<>"):
                raise invalid(f"{self.name}: label", option.label, "a text without < and >")
            if typed := typed_numbers(option.why):
                raise invalid(f"{self.name}: why", typed, "a field such as {claim.figure:.3g}")


def vocabulary(topic: str) -> list[str]:
    """Return the words of a chapter that an interviewer uses.

    Raises:
        ValueError: for a topic that has no file.
    """
    return list(read(topic)["vocabulary"])


def synonyms(topic: str) -> dict[str, str]:
    """Return other words that a reader may search for, each with the term that explains it.

    Raises:
        ValueError: for a topic that has no file, or a term that is not in its vocabulary.
    """
    return {
        word: one_of(f"synonym of {word}", term, vocabulary(topic))
        for word, term in read(topic).get("synonyms", ())
    }


@functools.cache
def predictions(topic: str) -> dict[str, Prediction]:
    """Return the questions of a chapter by name.

    Raises:
        ValueError: for a topic that has no file, or a question that is not whole.
    """
    return {
        name: Prediction(name, entry["ask"], tuple(Option(*option) for option in entry["options"]))
        for name, entry in read(topic).items()
        if isinstance(entry, dict)
    }


def predict(name: str) -> Shown:
    """Return the card of a question, to answer before anything is shown.

    Args:
        name: of the question, in the file of any chapter.

    Raises:
        ValueError: for an unknown name.
    """
    from course.derivations.records import figure

    topic, requested = _prediction(name)
    answers = [
        Answer(
            filled(o.label, figure),
            o.right,
            f"**{'Right.' if o.right else 'No.'}** {filled(o.why, figure)}",
        )
        for o in requested.options
    ]
    plain = "\n".join([f"Predict: {name}", *(f"  {answer.label}" for answer in answers)])
    question = f"{filled(requested.ask, figure)} *Click your answer.*"
    at = f"card-{name}"
    return Shown(plain, card(f"{topic}.{name}", "Predict.", question, answers, at=at))


def _prediction(name: str) -> tuple[str, Prediction]:
    """Return a question and the topic in whose file it is.

    Raises:
        ValueError: for an unknown name.
    """
    known: list[str] = []
    for chapter in CHAPTERS:
        if (FOLDER / f"{chapter.topic}.toml").is_file():
            mine = predictions(chapter.topic)
            if name in mine:
                return chapter.topic, mine[name]
            known += mine
    raise invalid("name", name, f"one of {', '.join(known)}")


def interview(topic: str) -> Shown:
    """Return the interview questions of a chapter, by level, with their answers folded.

    Raises:
        ValueError: for a topic without questions.
    """
    from course.derivations.records import figure

    parts, plain = [], []
    for level, name in LEVELS.items():
        requested = questions(topic, level)
        parts += [f"#### {name.capitalize()}", *(q.markdown(figure) for q in requested)]
        plain += [f"{name}: {q.name}" for q in requested]
    return Shown("\n".join(plain), "\n\n".join(parts))


def unplaced(topic: str = "", folder: Path | None = None) -> list[str]:
    """Return the claims that no notebook shows, by file and in the order of writing.

    A claim is placed where a notebook has it as a card (`show`), in a fold-out (`more_claims`), or
    asks for its formula (`answer`, `checkpoint`).

    Args:
        topic: of one chapter; "" for all.
        folder: of the notebooks' sources; default: those of the course.

    Raises:
        ValueError: for a topic without claims, or where there are no sources.
    """
    from course.derivations import claims

    everything = claims()
    known = list(dict.fromkeys(item.file.partition(".")[0] for item in everything))
    if topic and topic not in known:
        raise invalid("topic", topic, f"one of {', '.join(known)}")
    folder = folder or Path(__file__).parents[2] / "notebooks" / "source"
    texts = [path.read_text(encoding="utf-8") for path in sorted(folder.glob("*.py"))]
    if not texts:
        raise invalid("folder", str(folder), "a folder with the notebooks' sources")
    placed = {id for text in texts for id in placed_in(text)}
    placed |= {id for name in known for id in gate(name)}
    selected = (item for item in everything if topic in ("", item.file.partition(".")[0]))
    return [item.id for item in selected if item.id not in placed]


def placed_in(source: str) -> list[str]:
    """Return the claims that a py:percent source places on its page, in order.

    Args:
        source: its text. A checkpoint's claims are in the file of its cards.
    """
    result = []
    for name, call in re.findall(
        r'^(?:\w+\.)?(show|answer|more_claims)(\(\s*"\w+"(?:,\s*"\w+")*)', source, re.M
    ):
        ids = re.findall(r'"(\w+)"', call)
        result += ids if name == "more_claims" else ids[:1]
    return result
