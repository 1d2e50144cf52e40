"""What the grader found: checks, costs, the verdict and what explains it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from drills.reasons import SENTENCES, Reason
from drills.sandbox import Frame


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

    @property
    def passed(self) -> bool:
        """Whether it holds."""
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
    """The verdict and everything that explains it."""

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
    output: str = ""
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether the submission is right."""
        return self.reason is Reason.RIGHT

    @property
    def verdict(self) -> str:
        """ "pass" or "fail"."""
        return "pass" if self.passed else "fail"
