"""A submission on its exercise's work-precision chart, beside the worked answer and a library."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

from drills import exercise as exercises
from drills.attempt import Attempt, Place
from drills.cards import card
from drills.grade_report import Report
from drills.grader import start_child

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


def chart_of(
    question: str,
    planned: Callable[[Attempt], Plan],
    *,
    tolerance: float,
    error_unit: str,
    failed_above: float = math.inf,
    unit: str = "force evaluations",
    repeats: int = 3,
    converges: bool = True,
) -> Callable[[Attempt, Place], WorkPrecision]:
    """Return the chart of an exercise.

    Both answers through a pipe, other methods and libraries beside.

    Args:
        question: the title.
        planned: prepares what is compared.
        tolerance: error that the question allows.
        error_unit: of the error.
        failed_above: error of an answer that is none.
        unit: of the counts.
        repeats: how often each is run.
        converges: whether the error has an order in the setting.
    """

    def chart(attempt: Attempt, answer: Place) -> WorkPrecision:
        from course.measure.work_precision import Method, Result, max_norm, measure

        plan = planned(attempt)

        def method(name: str, run: Run, style: str) -> Method:
            settings = plan.own_settings.get(name, plan.settings)
            return Method(name, lambda s: Result(*run(s)), settings, style, unit)

        def requested(place: Place) -> Run:
            return lambda setting: plan.ask(place, setting)

        return measure(
            [
                method("yours", requested(attempt.learner.child), "yours"),
                method("worked answer", requested(answer), "ours"),
                *(method(name, run, "ours") for name, run in plan.ours.items()),
                *(method(name, run, "oracle") for name, run in plan.libraries.items()),
            ],
            plan.truth,
            plan.error or max_norm,
            reference_check=plan.check,
            tolerance=tolerance,
            failed_above=failed_above,
            repeats=repeats,
            question=question,
            error_unit=error_unit,
            converges=converges,
        )

    return chart


def angle_between(answer: Any, truth: Any) -> float:
    """Return angle between two orientations [rad], infinite where the answer is no orientation."""
    import numpy as np

    from course.rigid_body import quaternion

    length = np.linalg.norm(answer)
    if not np.isfinite(length) or length == 0.0:
        return float("inf")
    return float(quaternion.angle_between(answer / length, truth))


Charted = Union["WorkPrecision", Drawing]


def chart(name: str, source: str, filename: str = "submission.py", seed: int = 0) -> Charted:
    """Measure, or draw, the submission beside the reference and the library, in one run.

    Args:
        name: of the exercise.
        source: the submission's text.
        filename: how messages call it.
        seed: of what is drawn.

    Raises:
        UnknownExercise, NoChart: for a name without an exercise or a chart.
        Raised, Ended, SyntaxProblem, MissingName: when the submission can't be run
            (see `drills.sandbox`).
    """
    requested, charted = card(name), exercises.of(name)
    if charted.chart is None:
        raise NoChart(f"{name} has no chart")
    solution = requested.solution_text()
    with (
        start_child(requested, source, filename) as child,
        start_child(requested, solution, "worked answer") as answer,
    ):
        child.load()
        answer.load()
        attempt = Attempt(requested, child, Report(name, seed, filename, source), charted.given)
        return charted.chart(attempt, answer)


def picture(measured: Charted, path: str | Path) -> Path:
    """Draw the chart into a PNG file, which is replaced only when the new one is complete."""
    from matplotlib.figure import Figure

    from course.measure.figure import draw, write_picture

    figure = Figure(layout="constrained")
    return write_picture(draw(measured.panels(), figure=figure), path)
