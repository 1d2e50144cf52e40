"""What the grader needs of an exercise beyond its card: the judge, the slips, the chart.

`exercise.py` in the folder of an exercise holds `EXERCISE`.
"""

from __future__ import annotations

import importlib
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drills.attempt import Attempt, Place
from drills.cards import card
from drills.grade_report import Shown
from drills.reasons import Reason
from drills.sandbox import Limits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from drills.chart_plan import Charted

# A child's limits leave the reference this many times its own time.
HEADROOM = 20


@dataclass(frozen=True)
class Slip:
    """A plausible wrong answer, and the sentence that tells the learner what they did.

    Attributes:
        name: short id, such as "degrees_for_radians".
        sentence: what went wrong, as shown to the learner.
        edits: pairs (old, new) that turn the worked answer into the slip; each old text stands
            in it exactly once.
        source: the whole wrong answer instead, where an edit does not say it.
        after: text that comes behind the edited one.
        ends: the reason that shows this slip by itself, for one that never answers.
        cause: whether the arguments of the request that ended it can be what ended it.
        generic: recognised by its values or by the exercise's judge, not by comparing results with
            those of its text.
    """

    name: str
    sentence: str
    edits: tuple[tuple[str, str], ...] = ()
    source: str = ""
    after: str = ""
    ends: Reason | None = None
    cause: Callable[[tuple[Any, ...]], bool] = lambda args: True
    generic: bool = False

    def text(self, solution: str) -> str:
        """Return the source of the slip.

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
    """Return slips as a table, by their names.

    Args:
        **table: for each name a text of the worked answer, what stands there instead, perhaps more
            such pairs, and last what the learner is told. A whole wrong answer and what is told
            where an edit does not say it.

    Raises:
        ValueError: for a row of fewer than two or of an even number of texts beyond that.
    """
    made = []
    for name, (*texts, report) in table.items():
        if not texts or (len(texts) > 1 and len(texts) % 2):
            raise ValueError(f"slip {name}: texts must be pairs or one answer, got {len(texts)}")
        if len(texts) == 1:
            made.append(Slip(name, report, source=texts[0]))
        else:
            made.append(Slip(name, report, tuple(zip(texts[::2], texts[1::2], strict=True))))
    return tuple(made)


def coarse_slips(entry: str, shown: str) -> tuple[Slip, ...]:
    """Return the worked answer in single precision and rounded.

    `drills.case_judge.coarse` names these slips.

    Args:
        entry: the function's name.
        shown: what the digits that are gone would have shown, a sentence.
    """
    return (
        _changed(
            "single_precision",
            entry,
            "np.asarray(p, dtype=np.float32) for p in parts",
            "The answer is right to single precision only: somewhere it became float32, of seven "
            f"digits. {shown} Keep float64.",
        ),
        _changed(
            "rounded",
            entry,
            "np.round(p, 6) for p in parts",
            "The answer is rounded to a few decimals. Round when you print, never what you "
            "return: the next computation needs the digits.",
        ),
    )


def value_slips(
    entry: str, *, swapped: bool = False, in_part: bool = True, whole: bool = True
) -> tuple[Slip, ...]:
    """Return mistakes that every function knows, which `drills.case_judge` names by the values.

    Args:
        entry: the function's name.
        swapped: whether its first two results have one shape, so that they can be swapped.
        in_part: whether it returns several values, or an array of several.
        whole: whether one of its cases has integer arguments and results that are not integers.
    """
    result = [
        _changed(
            "whole_numbers",
            entry,
            "np.asarray(p).astype(np.asarray(next(a for a in args if not callable(a))).dtype) "
            "for p in parts",
            "Whole numbers lose the digits behind the point: an array of integers takes no "
            "fractions and says nothing. np.array and np.zeros_like keep the type of what they are "
            "given; write dtype=float.",
        ),
        _changed(
            "results_swapped",
            entry,
            "parts[i] for i in (1, 0, *range(2, len(parts)))",
            "The values are right and come back in another order than the task's.",
        ),
        _changed(
            "one_part_right",
            entry,
            "p + 1e-3 * (i > 0) for i, p in enumerate(parts)"
            ") if len(parts) > 1 else (np.concatenate((parts[0][:-1], parts[0][-1:] + 1e-3)),",
            "One part of the answer is right in every case and another is not: look for the "
            "mistake where only the latter is computed.",
        ),
    ]
    if not in_part:
        result.append(
            _changed(
                "constant_factor",
                entry,
                "0.9 * p for p in parts",
                "Every value is the same multiple of the right one: a factor is missing or one too "
                "many.",
            )
        )
    return tuple(itertools.compress(result, (whole, swapped, in_part, True)))


def _changed(name: str, entry: str, parts: str, explain: str) -> Slip:
    """Return the worked answer whose results, a tuple `parts`, are changed."""
    return Slip(
        name,
        explain,
        ((f"def {entry}(", "def exact("),),
        after=f"""

def {entry}(*args):
    import numpy as np

    answer = exact(*args)
    parts = answer if isinstance(answer, tuple) else (answer,)
    parts = tuple({parts})
    return parts if isinstance(answer, tuple) else parts[0]
""",
        generic=True,
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
        chart: runs or draws the submission beside the worked answer, which is in a child of
            its own, so that their times compare; the submission's curve has style "yours".
        picture: draws a case that failed: what came back beside what is right.
    """

    judge: Callable[[Attempt], None]
    slips: tuple[Slip, ...]
    examples: tuple[str, ...]
    given: str = ""
    limits: Limits | None = None
    replayed: int = 200
    chart: Callable[[Attempt, Place], Charted] | None = None
    picture: Callable[[Figure, Shown], None] | None = None


def of(name: str) -> Exercise:
    """Return the exercise of that name; imports what its judge needs."""
    module = importlib.import_module(f"drills.catalogue.{card(name).name}.exercise")
    result = module.EXERCISE
    assert isinstance(result, Exercise)
    return result


def worked_answer(name: str) -> Callable[..., Any]:
    """Return the worked answer of an exercise, to choose cases by or to draw with."""
    module = card(name).solution.partition(":")[0]
    result: Callable[..., Any] = getattr(importlib.import_module(module), card(name).entry)
    return result
