"""A submission on its exercise's work-precision chart, beside the reference and a library."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from course.measure.work_precision import WorkPrecision
from drills import exercise as exercises
from drills.attempt import Attempt
from drills.cards import card
from drills.grade import start_child
from drills.report import Report


class NoChart(ValueError):
    """The exercise has no chart."""


def chart(name: str, source: str, filename: str = "submission.py", seed: int = 0) -> WorkPrecision:
    """Measure the submission beside the reference and the library, in one run.

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
    asked, charted = card(name), exercises.of(name)
    if charted.chart is None:
        raise NoChart(f"{name} has no chart")
    solution = asked.solution_text()
    with (
        start_child(asked, source, filename) as child,
        start_child(asked, solution, "worked answer") as worked,
    ):
        child.load()
        worked.load()
        attempt = Attempt(asked, child, Report(name, seed, filename, source), charted.given)
        return charted.chart(attempt, worked)


def picture(measured: WorkPrecision, path: str | Path) -> Path:
    """Draw the chart into a PNG file, which is replaced only when the new one is complete."""
    from matplotlib.figure import Figure

    target = Path(path)
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    measured.plot(figure.subplots(1, 2))
    handle, temporary = tempfile.mkstemp(dir=target.parent or ".", suffix=".png")
    os.close(handle)
    try:
        figure.savefig(temporary, dpi=110)
        os.chmod(temporary, 0o644)  # mkstemp's files are private
        os.replace(temporary, target)
    finally:
        Path(temporary).unlink(missing_ok=True)
    return target
