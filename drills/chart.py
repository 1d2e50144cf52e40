"""A submission on its exercise's work-precision chart, beside the worked answer and a library."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drills import exercise as exercises
from drills.attempt import Attempt, Place
from drills.cards import card
from drills.chart_plan import Charted, NoChart, Plan, Run
from drills.grade_report import Report
from drills.grader import start_child

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision


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
