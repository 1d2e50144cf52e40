"""What the chart of an exercise compares, and what comes out: the types of `drills.chart`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Union

from drills.attempt import Place

if TYPE_CHECKING:
    from course.measure.figure import Panel
    from course.measure.work_precision import WorkPrecision

Run = Callable[[float], tuple[Any, float]]


class NoChart(ValueError):
    """The exercise has no chart."""


@dataclass(frozen=True)
class Plan:
    """What a chart compares, prepared so far that only what is timed is left.

    A run takes a setting and gives an answer and what it cost in counts.

    Attributes:
        settings: mostly step sizes; a larger one means less work.
        ask: the run of an answer, from the place where it is and the setting.
        truth: the right answer.
        check: the same from a second source.
        ours: runs beside it, by name.
        libraries: runs of other libraries, by name.
        own_settings: of the runs that have others.
        error: of an answer against the truth; None for the largest component.
    """

    settings: Sequence[float]
    ask: Callable[[Place, float], tuple[Any, float]]
    truth: Any
    check: Any
    ours: Mapping[str, Run] = field(default_factory=dict)
    libraries: Mapping[str, Run] = field(default_factory=dict)
    own_settings: Mapping[str, Sequence[float]] = field(default_factory=dict)
    error: Callable[[Any, Any], float] | None = None


@dataclass(frozen=True)
class Drawing:
    """What is shown of an exercise in which speed buys no accuracy: pictures, and their notes."""

    drawn: Sequence[Panel]

    def panels(self) -> Sequence[Panel]:
        """Return what is drawn."""
        return self.drawn

    def table(self) -> str:
        """Return what is said."""
        from course.measure.figure import text

        return text(self.drawn)


Charted = Union["WorkPrecision", Drawing]
