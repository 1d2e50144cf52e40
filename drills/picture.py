"""The picture of the first case that failed: what came back beside what is right."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from drills import exercise as exercises
from drills.grade_report import Report

if TYPE_CHECKING:
    from matplotlib.figure import Figure

YOURS: dict[str, Any] = {"color": "tab:red", "lw": 2.0, "label": "yours"}
RIGHT: dict[str, Any] = {"color": "0.35", "lw": 1.2, "ls": "--", "label": "right"}


def figure_of(report: Report) -> Figure | None:
    """Return the drawn case; None where nothing failed, or where nothing can be drawn."""
    shown, painter = report.shown, exercises.of(report.drill).picture
    if report.passed or shown is None or painter is None:
        return None
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    painter(figure, shown)
    figure.suptitle(f"{report.drill}, {shown.label}", fontsize="medium")
    return figure


def write(report: Report, target: Path) -> Path | None:
    """Write the picture into a PNG file, whole or not at all; None where there is none.

    Raises:
        OSError: when the file can't be written.
    """
    try:
        # What came back may be more than an axis can hold.
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            figure = figure_of(report)
            if figure is None:
                return None
            from course.measure.figure import write_picture

            return write_picture(figure, target)
    except (ValueError, OverflowError):
        return None


def plane(figure: Figure, x: str, y: str, *, equal: bool = False) -> Any:
    """Return one pair of axes with a grid; `equal` for lengths on both."""
    axes = figure.add_subplot()
    axes.set(xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    if equal:
        axes.set_aspect("equal", adjustable="datalim")
    return axes


def bodies(figure: Figure, start: Any, got: Any, right: Any) -> None:
    """Draw a body in space: its axes at the start, as they came back, and as they should be."""
    axes = figure.add_subplot(projection="3d")
    styles = ({"color": "0.8", "lw": 1.0, "label": "start"}, YOURS, RIGHT)
    for q, style in zip((start, got, right), styles, strict=True):
        for i, (name, tip) in enumerate(zip("xyz", _axes_of(q), strict=True)):
            axes.plot(
                *np.column_stack((np.zeros(3), tip)),
                **style
                if i == 0
                else {key: value for key, value in style.items() if key != "label"},
            )
            axes.text(*(1.1 * tip), name, color=style["color"], fontsize=8)
    axes.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1), xlabel="x", ylabel="y", zlabel="z")
    axes.set(xticks=(-1, 0, 1), yticks=(-1, 0, 1), zticks=(-1, 0, 1))
    axes.set_box_aspect((1, 1, 1))
    axes.set_title(f"{angle(got, right):.2g} degrees between yours and right", fontsize="medium")
    axes.legend(loc="upper left")


def angle(p: Any, q: Any) -> float:
    """Return the angle between two orientations [degrees], of quaternions of any length."""
    distance = float(np.linalg.norm(_axes_of(p) - _axes_of(q)))
    return math.degrees(2.0 * math.asin(min(distance / math.sqrt(8.0), 1.0)))


def _axes_of(q: Any) -> Any:
    """Return the body's axes in the world, one a row, of a quaternion (w, x, y, z)."""
    q = np.asarray(q, dtype=float)
    size = float(np.linalg.norm(q))
    w, *v = q / size if 0.0 < size < np.inf else np.array([1.0, 0.0, 0.0, 0.0])
    axes = np.eye(3)
    return axes + 2.0 * np.cross(v, np.cross(v, axes) + w * axes)
