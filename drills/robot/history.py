"""Your robot's versions over time: success and cycle time of each, compared with the course's."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from drills.robot import report


def versions(runs: list[dict[str, Any]], number: int) -> list[dict[str, Any]]:
    """Return the runs of a level in the order of time, one for each robot: its last one."""
    last: dict[str, dict[str, Any]] = {}
    for run in runs:
        if (
            run.get("level") == number
            and run.get("twin", False) is False
            and isinstance(run.get("robot"), str)
        ):
            last.pop(run["robot"], None)
            last[run["robot"]] = run
    return list(last.values())


def rows(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return of each run: when, hash, success with its interval, cycle time and own parts.

    A run that can't be read is skipped.
    """
    result = []
    for run in runs:
        try:
            summary = report.restored(run)
            own = sum(holder == "yours" for holder, _ in run["parts"].values())
        except (KeyError, TypeError, ValueError):
            continue
        low, middle, high = summary.quartiles()
        result.append(
            {
                "at": str(run.get("at", "")),
                "robot": str(run["robot"]),
                "own": own,
                "tasks": summary.tasks,
                "success": summary.rate,
                "low": summary.low,
                "high": summary.high,
                "cycle": None if math.isnan(middle) else middle,
                "quartiles": None if math.isnan(middle) else [low, high],
            }
        )
    return result


def draw(listed: list[dict[str, Any]], course: report.Summary | None, path: Path) -> None:
    """Write the chart: success and cycle time over the versions, the course's as lines.

    Args:
        listed: as `rows` returns them, at least one.
        course: of the course's parts at the same level, or None.
        path: of the picture.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.4), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2)
    x = np.arange(len(listed))
    names = [row["robot"][:4] for row in listed]
    rate = 100.0 * np.array([row["success"] for row in listed])
    low = 100.0 * np.array([row["low"] for row in listed])
    high = 100.0 * np.array([row["high"] for row in listed])
    left.errorbar(x, rate, (rate - low, high - rate), fmt="o-", capsize=3, label="your robot")
    cycle = np.array([math.nan if row["cycle"] is None else row["cycle"] for row in listed])
    ends = np.array([row["quartiles"] or [math.nan, math.nan] for row in listed])
    right.errorbar(x, cycle, (cycle - ends[:, 0], ends[:, 1] - cycle), fmt="o-", capsize=3)
    if course is not None:
        left.axhline(100.0 * course.rate, color="0.5", linestyle="--", label="the course's parts")
        right.axhline(course.quartiles()[1], color="0.5", linestyle="--")
    left.set_ylabel("success [%], 95 % interval")
    right.set_ylabel("cycle time [s], quartiles")
    left.legend(loc="lower right")
    for axes in (left, right):
        axes.set_xticks(x, names)
        axes.set_xlabel("version (its hash)")
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
