"""What the grader needs of an exercise beyond its card: the judge, the slips, the chart.

`exercise.py` in the folder of an exercise holds `EXERCISE`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from drills.attempt import Attempt, Place
from drills.cards import card
from drills.reasons import Reason
from drills.sandbox import Limits

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision

# A child's limits leave the reference this many times its own time.
HEADROOM = 20


@dataclass(frozen=True)
class Slip:
    """A plausible wrong answer, and the sentence that tells the learner what they did.

    Attributes:
        name: short id, such as "degrees_for_radians".
        sentence: what went wrong, said to the learner.
        edits: pairs (old, new) that turn the worked answer into the slip; each old text stands
            in it exactly once.
        source: the whole wrong answer instead, where an edit does not say it.
        after: text that comes behind the edited one.
        ends: the reason that shows this slip by itself, for one that never answers.
    """

    name: str
    sentence: str
    edits: tuple[tuple[str, str], ...] = ()
    source: str = ""
    after: str = ""
    ends: Reason | None = None

    def text(self, solution: str) -> str:
        """The source of the slip.

        Raises:
            ValueError: when an edit doesn't fit the solution.
        """
        if self.source:
            return self.source
        text = solution
        for old, new in self.edits:
            if text.count(old) != 1:
                raise ValueError(
                    f"slip {self.name}: {old!r} stands {text.count(old)} times in the solution"
                )
            text = text.replace(old, new)
        text += self.after
        if text == solution:
            raise ValueError(f"slip {self.name} does not differ from the solution")
        return text


def slips(**table: Sequence[str]) -> tuple[Slip, ...]:
    """Slips as a table, by their names.

    Args:
        **table: for each name a text of the worked answer, what stands there instead, perhaps more
            such pairs, and last what the learner is told. A whole wrong answer and what is told
            where an edit does not say it.

    Raises:
        ValueError: for a row of fewer than two or of an even number of texts beyond that.
    """
    made = []
    for name, (*texts, told) in table.items():
        if not texts or (len(texts) > 1 and len(texts) % 2):
            raise ValueError(f"slip {name}: texts must be pairs or one answer, got {len(texts)}")
        if len(texts) == 1:
            made.append(Slip(name, told, source=texts[0]))
        else:
            made.append(Slip(name, told, tuple(zip(texts[::2], texts[1::2], strict=True))))
    return tuple(made)


def coarse_slips(entry: str, shown: str) -> tuple[Slip, ...]:
    """The worked answer in single precision and rounded, which `drills.judge.coarse` names.

    Args:
        entry: the function's name.
        shown: what the digits that are gone would have shown, a sentence.
    """
    return tuple(
        Slip(
            name,
            told,
            ((f"def {entry}(", "def exact("),),
            after=f"""

def {entry}(*args):
    import numpy as np

    answer = exact(*args)
    parts = answer if isinstance(answer, tuple) else (answer,)
    short = tuple({short} for part in parts)
    return short if isinstance(answer, tuple) else short[0]
""",
        )
        for name, short, told in (
            (
                "single_precision",
                "np.asarray(part, dtype=np.float32)",
                "The answer is right to single precision only: somewhere it became float32, of "
                f"seven digits. {shown} Keep float64.",
            ),
            (
                "rounded",
                "np.round(part, 6)",
                "The answer is rounded to a few decimals. Round when you print, never what you "
                "return: the next computation needs the digits.",
            ),
        )
    )


@dataclass(frozen=True)
class Exercise:
    """What the grader needs beyond the card.

    Attributes:
        judge: asks the submission and records checks on the `Attempt`; runs in the parent.
        slips: at least four.
        examples: public calls, shown with their answers: texts such as "fk3([1, 1, 1], [0, 0, 0])".
        given: source of the module that the child gets as `given`, or "".
        limits: the child's limits; None for the usual ones.
        replayed: how many calls are repeated in a second process to check determinism.
        chart: runs the submission beside a library and the worked answer, which is in a child of
            its own, so that their times compare; the submission's curve has style "yours".
    """

    judge: Callable[[Attempt], None]
    slips: tuple[Slip, ...]
    examples: tuple[str, ...]
    given: str = ""
    limits: Limits | None = None
    replayed: int = 200
    chart: Callable[[Attempt, Place], WorkPrecision] | None = None


def of(name: str) -> Exercise:
    """The exercise of that name; imports what its judge needs."""
    module = importlib.import_module(f"drills.catalogue.{card(name).name}.exercise")
    found = module.EXERCISE
    assert isinstance(found, Exercise)
    return found
