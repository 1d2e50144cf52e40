"""What the grader found: checks, costs, the verdict and what explains it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from drills.reasons import SENTENCES, Reason
from drills.sandbox import Frame

# In this order an exercise asks, and a learner is told: the simplest failure first.
LEVELS = ("simple", "core", "edge")


@dataclass(frozen=True)
class Part:
    """One of the cases of an exercise: its level, one of `LEVELS`, and what it is called."""

    level: str
    label: str


@dataclass(frozen=True)
class Shown:
    """A case that failed, for the picture of it: what was asked, what came back, what is right."""

    label: str
    args: tuple[Any, ...]
    got: Any
    expected: Any


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        name: what, in a few words.
        reason: `Reason.RIGHT`, or why it fails.
        sentence: what is wrong, or what holds.
        call, got, expected: the call, what came back and what is right, as short texts.
        error, tolerance: the measured error and what is allowed, in `unit`; NaN where there is
            none.
        why: why the tolerance is what it is.
        slip: the slip that this failure shows, or "".
        part: the case that it belongs to, an index into `Report.parts`; -1 for none.
        values: what was compared: the value that came back, and the right one; None if nothing was.
        requests: how many requests had been made when it was recorded.
    """

    name: str
    reason: Reason
    sentence: str = ""
    call: str = ""
    got: str = ""
    expected: str = ""
    error: float = math.nan
    tolerance: float = math.nan
    unit: str = ""
    why: str = ""
    slip: str = ""
    part: int = -1
    values: tuple[Any, Any] | None = field(default=None, compare=False, repr=False)
    requests: int = field(default=0, compare=False, repr=False)

    @property
    def passed(self) -> bool:
        """True if the check holds."""
        return self.reason is Reason.RIGHT


@dataclass(frozen=True)
class Cost:
    """What the submission spent beside the reference: seconds per call, or a count."""

    what: str
    unit: str
    yours: float
    reference: float


@dataclass(frozen=True)
class Problem:
    """An exception or a syntax error in the submission: message, and the lines of their file."""

    type: str
    message: str
    frames: tuple[Frame, ...] = ()
    line: int = 0
    column: int = 0


@dataclass
class Report:
    """The verdict and everything that explains it.

    `parts` are all cases of the exercise in the order of `LEVELS`; `begun` and `ended` hold the
    indices of those that were asked, and of those whose questions were all answered. `case` is the
    first failure as a program (`drills.case_code`), or "".
    """

    drill: str
    seed: int
    filename: str
    source: str
    reason: Reason = Reason.RIGHT
    sentence: str = SENTENCES[Reason.RIGHT]
    checks: list[Check] = field(default_factory=list)
    slip: str = ""
    diagnosis: str = ""
    call: str = ""
    problem: Problem | None = None
    costs: list[Cost] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    begun: set[int] = field(default_factory=set)
    ended: set[int] = field(default_factory=set)
    shown: Shown | None = None
    case: str = ""
    output: str = ""
    seconds: float = 0.0

    def sort(self) -> None:
        """Bring the checks into the order of the levels, and within one into that of its cases."""
        places = {i: (LEVELS.index(part.level), i) for i, part in enumerate(self.parts)}
        self.checks.sort(key=lambda check: places.get(check.part, (len(LEVELS), 0)))

    def tally(self) -> list[tuple[str, int, int]]:
        """Return for each level that was begun how many cases hold, and how many were run."""
        failed = {check.part for check in self.checks if not check.passed}
        rows: list[tuple[str, int, int]] = []
        for level in LEVELS:
            requested = {i for i in self.begun if self.parts[i].level == level}
            if requested:
                rows.append((level, len((requested & self.ended) - failed), len(requested)))
        return rows

    @property
    def unreached(self) -> int:
        """How many cases were not asked."""
        return len(self.parts) - len(self.begun)

    @property
    def passed(self) -> bool:
        """True if the submission is right."""
        return self.reason is Reason.RIGHT

    @property
    def verdict(self) -> str:
        """The word in the report, "pass" or "fail"."""
        return "pass" if self.passed else "fail"
