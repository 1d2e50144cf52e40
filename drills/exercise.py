"""What the grader needs of an exercise beyond its card: the judge, the slips, the chart.

`exercise.py` in the folder of an exercise holds `EXERCISE`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
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
        ends: the reason that shows this slip by itself, for one that never answers.
    """

    name: str
    sentence: str
    edits: tuple[tuple[str, str], ...] = ()
    source: str = ""
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
        if text == solution:
            raise ValueError(f"slip {self.name} does not differ from the solution")
        return text


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
