"""A submission on its exercise's work-precision chart, beside the reference and a library."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from course.measure.work_precision import WorkPrecision
from drills import exercise as catalogue
from drills.grade import Attempt, Report, start_child

YOURS = "yours"


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
    card, exercise = catalogue.card(name), catalogue.exercise(name)
    if exercise.chart is None:
        raise NoChart(f"{name} has no chart")
    with start_child(card, source, filename) as child:
        child.load()
        attempt = Attempt(card, exercise, child, Report(name, seed, filename, source))
        return exercise.chart(attempt)


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
