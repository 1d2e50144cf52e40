"""Every checkable claim of the course, as a check that runs.

A claim is what one commonly reads or hears, with its verdict, what is true instead, and a function
that settles it by algebra or by measurement. `run` computes its figures afresh and compares them,
and the verdict, with what is on record; so a false claim that suddenly passes, or a figure that
moved, is found. `python -m course.derivations` prints all of them.

    from course import derivations
    derivations.figure("semi_implicit_limit", "limit_ms")    # a number for the text
    derivations.show("semi_implicit_limit")                  # a block for a notebook
    derivations.answer("semi_implicit_limit", "2/omega")     # checks a learner's formula

Checks import what they need (SymPy, MuJoCo, the chapters) when they run: importing this package
costs nothing.
"""

import functools
import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from course.derivations.answer import Answer, Formula, answer_formula, equivalent

__all__ = [
    "CLAIMS",
    "Answer",
    "Block",
    "Claim",
    "Finding",
    "Formula",
    "Outcome",
    "Verdict",
    "answer",
    "claim",
    "claims",
    "figure",
    "run",
    "settle",
    "show",
]


class Verdict(Enum):
    """How a common claim fares."""

    HOLDS = "holds"
    CONDITIONAL = "holds only if"
    FALSE = "false"


@dataclass(frozen=True)
class Finding:
    """What a check found.

    Attributes:
        figures: name -> number, or short text; the name ends in the unit where there is one.
        statement: what was computed or measured, in one or two sentences.
        holds: whether the common claim holds as it is stated.
        corrected: whether the corrected statement holds.
        holds_if: whether the common claim holds where its condition is met; None where the claim
            has no condition.
        formula: the SymPy expression the check derived, where the claim can be answered with a
            formula. It must agree with the formula on record.
    """

    figures: Mapping[str, float | str]
    statement: str
    holds: bool
    corrected: bool
    holds_if: bool | None = None
    formula: Any = None

    def __post_init__(self) -> None:
        plain = {k: v if isinstance(v, str) else float(v) for k, v in self.figures.items()}
        object.__setattr__(self, "figures", plain)

    @property
    def verdict(self) -> Verdict:
        """The verdict that follows from what was found."""
        if self.holds:
            return Verdict.HOLDS
        return Verdict.CONDITIONAL if self.holds_if else Verdict.FALSE


@dataclass(frozen=True)
class Claim:
    """One statement of the course, and the function that settles it.

    Attributes:
        id: short name in snake_case, unique in the course.
        chapter: number of the chapter.
        claim: the statement as it is commonly made.
        verdict: whether it holds, holds only under a condition, or is false.
        corrected: what is true. A claim that holds is repeated there more precisely.
        figures: name -> (value, tolerance). The tolerance is relative, absolute where the value
            is 0; text must agree exactly and has tolerance 0. The check must compute every one.
        check: function without arguments that settles the claim.
        condition: for a conditional verdict, what must be true for the claim to hold.
        formula: what a learner can be asked for, or None.
        source: where the corrected statement can be read up.
    """

    id: str
    chapter: int
    claim: str
    verdict: Verdict
    corrected: str
    figures: Mapping[str, tuple[float | str, float]]
    check: Callable[[], Finding] = field(repr=False)
    condition: str = ""
    formula: Formula | None = None
    source: str = ""

    def __post_init__(self) -> None:
        if not self.id.isidentifier() or self.id != self.id.lower():
            raise ValueError(f"id is {self.id!r}; it must be a name in snake_case")
        if not self.claim or not self.corrected:
            raise ValueError(f"{self.id}: claim and corrected must both have text")
        if (self.verdict is Verdict.CONDITIONAL) != bool(self.condition):
            raise ValueError(
                f"{self.id}: condition is {self.condition!r}; a conditional verdict has one, "
                "the others have none"
            )
        if not self.figures:
            raise ValueError(f"{self.id}: figures is empty; a claim is settled by a figure")


@dataclass(frozen=True)
class Outcome:
    """A claim, what its check found now, and where the two disagree.

    Attributes:
        claim: the claim on record.
        finding: what the check found.
        disagreements: one sentence each; empty if all is well.
    """

    claim: Claim
    finding: Finding
    disagreements: tuple[str, ...]

    @property
    def agrees(self) -> bool:
        """Whether the record and the check say the same."""
        return not self.disagreements


# Filled by `claim`; read it through `claims`, which loads the chapters first.
CLAIMS: dict[str, Claim] = {}
# In the order in which the chapters make them.
_MODULES = (
    "rigid_body.rotation",
    "rigid_body.tops",
    "rigid_body.energy",
    "rigid_body.flight",
    "rigid_body.methods",
    "rigid_body.loop",
    "rigid_body.mujoco",
    "rigid_body.time_step",
    "planning",
    "control",
    "sim_to_real.randomisation",
    "sim_to_real.vector_env",
)


def claim(
    id: str,
    chapter: int,
    claim: str,
    *,
    verdict: Verdict,
    corrected: str,
    figures: Mapping[str, tuple[float | str, float]],
    condition: str = "",
    formula: Formula | None = None,
    source: str = "",
    registry: dict[str, Claim] | None = None,
) -> Callable[[Callable[[], Finding]], Callable[[], Finding]]:
    """Decorator that registers a check function as a claim.

    Args:
        id, chapter, claim, verdict, corrected, figures, condition, formula, source: as in `Claim`.
        registry: where to put it; default: the claims of the course.

    Returns:
        A decorator that leaves the function as it is.

    Raises:
        ValueError: for an id that is taken, or a record that contradicts itself.
    """
    target = CLAIMS if registry is None else registry

    def register(check: Callable[[], Finding]) -> Callable[[], Finding]:
        if id in target:
            raise ValueError(f"id is {id!r}, which is taken; ids must be unique")
        target[id] = Claim(
            id, chapter, claim, verdict, corrected, figures, check, condition, formula, source
        )
        return check

    return register


def claims(chapter: int | None = None) -> list[Claim]:
    """All claims, or those of one chapter, in the order in which the chapter makes them.

    Args:
        chapter: number of a chapter, or None for all.

    Raises:
        ValueError: for a chapter that has no claims.
    """
    for module in _MODULES:
        importlib.import_module(f"{__name__}.{module}")
    known = sorted({item.chapter for item in CLAIMS.values()})
    if chapter is None:
        return sorted(CLAIMS.values(), key=lambda item: item.chapter)
    if chapter not in known:
        raise ValueError(f"chapter is {chapter!r}; chapters with claims are {known}")
    return [item for item in CLAIMS.values() if item.chapter == chapter]


def _get(id: str) -> Claim:
    if id not in CLAIMS:
        claims()
    if id not in CLAIMS:
        raise ValueError(f"id is {id!r}; `python -m course.derivations` lists the ids there are")
    return CLAIMS[id]


def _compare_figure(name: str, expected: float | str, tolerance: float, found: float | str) -> str:
    """Why the figure found is not the one on record; empty text if it is."""
    if isinstance(expected, str) or isinstance(found, str):
        return "" if expected == found else f"{name} is {found!r}, on record is {expected!r}"
    allowed = tolerance * abs(expected) if expected else tolerance
    if math.isfinite(found) and abs(found - expected) <= allowed:
        return ""
    if found == expected:  # an infinity that is on record
        return ""
    return f"{name} is {found:.8g}, on record is {expected:.8g} within {tolerance:g}"


def settle(claim: Claim) -> Outcome:
    """Run the check of a claim and compare what it found with the record.

    Args:
        claim: the claim.

    Returns:
        The outcome, with one sentence for each disagreement.
    """
    finding = claim.check()
    wrong = []
    if finding.verdict is not claim.verdict:
        wrong.append(f"verdict on record: {claim.verdict.value}; found: {finding.verdict.value}")
    if not finding.corrected:
        wrong.append("the corrected statement does not hold")
    if finding.holds and finding.holds_if is False:
        wrong.append("found to hold in general and yet not under its condition")
    for name in sorted(set(claim.figures) ^ set(finding.figures)):
        where = "on record but not computed" if name in claim.figures else "computed, not on record"
        wrong.append(f"{name} is {where}")
    for name, (value, tolerance) in claim.figures.items():
        if name in finding.figures:
            reason = _compare_figure(name, value, tolerance, finding.figures[name])
            if reason:
                wrong.append(reason)
    if (claim.formula is None) != (finding.formula is None):
        wrong.append("the record and the check must both have a formula, or neither")
    elif claim.formula is not None and not equivalent(claim.formula, finding.formula):
        wrong.append(f"derived {finding.formula}, on record is {claim.formula.expression}")
    return Outcome(claim, finding, tuple(wrong))


@functools.cache
def run(id: str) -> Outcome:
    """Settle the claim with this id; computed once per process.

    Args:
        id: id of a claim.

    Raises:
        ValueError: for an unknown id.
    """
    return settle(_get(id))


def figure(id: str, name: str) -> float | str:
    """A figure of a claim, computed by its check.

    Args:
        id: id of a claim.
        name: name of the figure.

    Returns:
        The number, or the text.

    Raises:
        ValueError: for an unknown id or name.
    """
    figures = run(id).finding.figures
    if name not in figures:
        raise ValueError(f"name is {name!r}; figures of {id} are {', '.join(figures)}")
    return figures[name]


def figure_text(value: float | str) -> str:
    """A figure as it is printed: text as it is, numbers with five digits."""
    return value if isinstance(value, str) else f"{value:.5g}"


@dataclass(frozen=True)
class Block:
    """A claim and its figures, as a short block of text for a notebook."""

    outcome: Outcome

    def lines(self) -> list[tuple[str, str]]:
        """The parts of the block, as pairs of heading and text."""
        claim, finding = self.outcome.claim, self.outcome.finding
        verdict = claim.verdict.value
        if claim.condition:
            verdict = f"{verdict} {claim.condition}"
        figures = ", ".join(f"{k} = {figure_text(v)}" for k, v in finding.figures.items())
        parts = [
            ("One hears", claim.claim),
            ("Verdict", verdict),
            ("True is", claim.corrected),
            ("Measured", finding.statement),
            ("Figures", figures),
        ]
        if claim.source:
            parts.append(("Source", claim.source))
        parts += [("DISAGREES", text) for text in self.outcome.disagreements]
        return parts

    def __repr__(self) -> str:
        return "\n".join(f"{head}: {text}" for head, text in self.lines())

    def _repr_markdown_(self) -> str:
        return "\n".join(f"> **{head}:** {text}  " for head, text in self.lines())


def show(id: str) -> Block:
    """The claim with this id as a block for a notebook, with figures computed now.

    Args:
        id: id of a claim.

    Raises:
        ValueError: for an unknown id.
    """
    return Block(run(id))


def answer(id: str, text: str) -> Answer:
    """Check a learner's formula against the claim's.

    Any equivalent form is right: `2*sqrt(m/k)`, `2 sqrt(m/k)`, `dt < 2/omega`, `(4 m/k)^0.5`. A
    wrong one gets numbers at which the two differ. The text is read by a small parser that knows
    numbers, the claim's symbols and a few functions, and nothing else; no code is run.

    Args:
        id: id of a claim that has a formula.
        text: the learner's formula.

    Returns:
        Whether it is right, a message, and a counter-example if it is wrong.

    Raises:
        ValueError: for an unknown id, one without a formula, or a text that is not a str.
    """
    formula = _get(id).formula
    if formula is None:
        answerable = ", ".join(item.id for item in claims() if item.formula)
        raise ValueError(f"id is {id!r}, which asks for no formula; these do: {answerable}")
    return answer_formula(formula, text)
