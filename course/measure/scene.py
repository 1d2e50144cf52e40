"""A scene: the smallest model that answers a question to the accuracy the question needs.

A scene states its question and tolerance, and for every effect the error of leaving it out,
measured against a model that has it. Two ways to be wrong follow: something is left out that
matters (the scene models too little), or something is kept that does not (it models too much).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from course.check import invalid, positive


@dataclass(frozen=True)
class Tolerance:
    """How accurate the answer must be, and why that is enough."""

    value: float
    unit: str
    why: str

    def __post_init__(self) -> None:
        positive("value", self.value)
        if not self.why.strip():
            raise invalid("why", self.why, "a sentence that says where the tolerance comes from")


@dataclass
class _Item:
    what: str
    error: Callable[[], float] | float
    unit: str
    saves: float = math.nan
    against: str = ""
    _measured: float | None = field(default=None, init=False, repr=False)

    def measured(self) -> float:
        """Return the error in the scene's answer; measured once, then remembered."""
        # Measuring may run a simulation: it is done once, when somebody asks.
        if self._measured is None:
            value = float(self.error() if callable(self.error) else self.error)
            if not (value >= 0.0):  # also NaN: a measurement that failed is no measurement
                raise invalid(f"error of {self.what!r}", value, "a non-negative number")
            self._measured = value
        return self._measured


class LeftOut(_Item):
    """An effect the scene does without.

    Attributes:
        what: the effect.
        error: callable (or number): the change in the answer when a model that has the effect is
            asked the same question; not negative, in `unit`.
        unit: the tolerance's unit.
        saves: cost of the model with it over the cost of the scene (2 means twice as expensive).
        against: which model has it, for the table.
    """


class Modelled(_Item):
    """An effect the scene has.

    Attributes:
        what: the effect.
        error: callable (or number): the change in the answer when the effect is dropped.
        unit: the tolerance's unit.
        saves: cost of the scene over the cost without it.
        against: how the error was found, for the table.
    """


@dataclass
class Scene:
    """A question, the tolerance of its answer, and what the model has and lacks.

    Attributes:
        question: one sentence that ends in a question mark.
        tolerance: of the answer.
        degrees_of_freedom: the names of those modelled.
        modelled: effects in the model, with the error of dropping each.
        left_out: effects left out, with the error of doing so.
    """

    question: str
    tolerance: Tolerance
    degrees_of_freedom: Sequence[str]
    modelled: Sequence[Modelled] = ()
    left_out: Sequence[LeftOut] = ()

    def __post_init__(self) -> None:
        if not self.question.strip().endswith("?"):
            raise invalid("question", self.question, "a sentence that ends in a question mark")
        if not self.degrees_of_freedom:
            raise invalid("degrees_of_freedom", self.degrees_of_freedom, "at least one name")
        # Errors are compared with the tolerance, so they have to be in its unit.
        for item in (*self.modelled, *self.left_out):
            if item.unit != self.tolerance.unit:
                raise invalid(
                    f"unit of {item.what!r}", item.unit, f"the tolerance's, {self.tolerance.unit!r}"
                )

    def check(self) -> list[str]:
        """Return the faults of the scene's model; an empty list when it fits its question.

        Returns:
            "models too little: ..." for each effect left out whose error is not below the tolerance
            and for the sum of all left out, which may pass it though no single one does;
            "models too much: ..." for each effect in the model that could go: without it, and with
            what is left out already, the answer would still be within the tolerance.
        """
        value, unit = self.tolerance.value, self.tolerance.unit
        result = []
        # Triangle inequality: to first order the sum bounds what all omissions do together.
        total = sum(item.measured() for item in self.left_out)
        for item in self.left_out:
            if item.measured() >= value:
                result.append(
                    f"models too little: leaving out {item.what} costs {item.measured():.3g} "
                    f"{unit}, the tolerance is {value:g} {unit}"
                )
        # Only if no single omission is to blame is the sum reported.
        if not result and total >= value:
            result.append(
                f"models too little: everything left out together may cost {total:.3g} {unit}, "
                f"the tolerance is {value:g} {unit}"
            )
        for retained in self.modelled:
            # Occam's razor with numbers: what could be dropped within the tolerance is superfluous.
            if retained.measured() + total < value:
                result.append(
                    f"models too much: without {retained.what} the answer is off by "
                    f"{retained.measured():.3g} {unit}, still within {value:g} {unit}"
                )
        return result

    def rows(self) -> list[tuple[str, str, float, float, str]]:
        """Return (effect, "modelled" or "left out", error, saves, against) for each effect."""
        groups: list[tuple[str, Sequence[_Item]]] = [
            ("modelled", self.modelled),
            ("left out", self.left_out),
        ]
        return [(i.what, g, i.measured(), i.saves, i.against) for g, items in groups for i in items]

    def table(self) -> str:
        """Return the scene as text."""
        t = self.tolerance
        lines = [
            self.question,
            f"tolerance {t.value:g} {t.unit}: {t.why}",
            f"degrees of freedom: {len(self.degrees_of_freedom)} "
            f"({', '.join(self.degrees_of_freedom)})",
            f"{'effect':<28} {'':<9} {f'error [{t.unit}]':>12} {'saves':>7}  measured against",
        ]
        for what, group, error, saves, against in self.rows():
            lines.append(f"{what:<28} {group:<9} {error:>12.3g} {_ratio(saves):>7}  {against}")
        return "\n".join([*lines, *(self.check() or ["the scene fits its question"])])

    def _repr_markdown_(self) -> str:
        t = self.tolerance
        lines = [
            f"**{self.question}**",
            "",
            f"Tolerance {t.value:g} {t.unit}: {t.why}",
            "",
            f"{len(self.degrees_of_freedom)} degrees of freedom: "
            f"{', '.join(self.degrees_of_freedom)}",
            "",
            f"| effect | | error without it [{t.unit}] | saves | measured against |",
            "|---|---|---:|---:|---|",
        ]
        for what, group, error, saves, against in self.rows():
            lines.append(f"| {what} | {group} | {error:.3g} | {_ratio(saves)} | {against} |")
        lines.append("")
        return "\n".join([*lines, *(self.check() or ["The scene fits its question."])])

    def _repr_mimebundle_(self, **_: Any) -> dict[str, str]:
        return {"text/plain": self.table(), "text/markdown": self._repr_markdown_()}


def _ratio(saves: float) -> str:
    return "-" if math.isnan(saves) else f"{saves:.3g}x"
