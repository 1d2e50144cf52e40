"""What goes into a child and what comes out of it: limits, descriptions, and the ways to end."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from drills.reasons import Reason


@dataclass(frozen=True)
class Limits:
    """What a child may use.

    Time is the child's processor time, all threads together, as the parent sees it, so that a busy
    machine fails nobody. What sleeps uses none: the wall clock ends it, `patience` times later.
    Where the system doesn't tell the processor time of another process, all is wall clock.
    """

    load: float = 5.0  # s, processor, to execute the submission's top level, its imports included
    call: float = 2.0  # s, processor, each call
    total: float = 20.0  # s, processor, all loading and calls together
    patience: float = 10.0  # by the wall clock, each of the three may take this many times as long
    memory: int = 1 << 30  # bytes resident
    output: int = 1 << 20  # bytes printed in all
    disk: int = 16 << 20  # bytes in the scratch folder in all, and in each file


DEFAULT = Limits()


@dataclass(frozen=True)
class Frame:
    """One level of a traceback, in the submission's file."""

    line: int
    function: str


@dataclass(frozen=True)
class Parameter:
    """A parameter of the graded function, as `inspect` names its kind (lower case)."""

    name: str
    kind: str
    has_default: bool


@dataclass(frozen=True)
class Loaded:
    """The graded name: its parameters (None if `inspect` can't tell) and what it is."""

    parameters: tuple[Parameter, ...] | None
    callable: bool
    is_class: bool


@dataclass(frozen=True)
class Foreign:
    """Stands where a value was whose type does not travel."""

    type_name: str


class Handle:
    """An object that stays in the child."""

    def __init__(self, child: Any, number: int) -> None:
        self._child, self._number = child, number

    def __repr__(self) -> str:
        return f"Handle({self._number})"

    def __del__(self) -> None:
        self._child._dropped.append(self._number)


class Raised(Exception):
    """The submission raised an exception; the child lives on."""

    def __init__(
        self, kind: str, message: str, frames: list[Frame], kinds: tuple[str, ...] = ()
    ) -> None:
        super().__init__(f"{kind}: {message}")
        self.type, self.message, self.frames = kind, message, frames
        self.kinds = kinds  # the built-in exceptions that it is one of


class Ended(Exception):
    """The child is gone."""

    def __init__(self, reason: Reason, sentence: str) -> None:
        super().__init__(sentence)
        self.reason, self.sentence = reason, sentence


class SyntaxProblem(Exception):
    """The submission is not valid Python. Line and column count from 1; 0 where unknown."""

    def __init__(self, line: int, column: int, text: str, message: str) -> None:
        super().__init__(f"line {line}: {message}")
        self.line, self.column, self.text, self.message = line, column, text, message


class MissingName(Exception):
    """The submission does not define a name; `defined` are the public names that it defines."""

    def __init__(self, entry: str, defined: list[str]) -> None:
        super().__init__(f"{entry} is not defined")
        self.entry, self.defined = entry, defined


class StartFailed(RuntimeError):
    """The child did not start, or the drill's own module failed: not the learner's fault."""
