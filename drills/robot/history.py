"""Your robot's versions over time: success and cycle time of each, and of the known robots."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from drills.robot import report


def versions(runs: list[dict[str, Any]], number: int) -> list[dict[str, Any]]:
    """Return the runs of a level in the order of time, one for each robot: that of most tasks.

    Of equally many tasks the last one counts.
    """
    last: dict[str, dict[str, Any]] = {}
    for run in runs:
        if (
            run.get("level") == number
            and run.get("twin", False) is False
            and isinstance(run.get("robot"), str)
        ):
            before = last.get(run["robot"])
            if before is not None and before.get("tasks", 0) > run.get("tasks", 0):
                continue
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


def longest(results: dict[str, dict[str, Any]], number: int) -> report.Summary | None:
    """Return the result of most tasks at a level with the exact arm; None where there is none.

    Args:
        results: as `drills.robot.store.Stored` has them, by "level/tasks/seed/world/version".
        number: of the level.
    """
    best = None
    for key, data in results.items():
        if key.startswith(f"{number}/") and "/exact/" in key:
            try:
                one = report.restored(data)
            except (KeyError, TypeError, ValueError):
                continue
            best = one if best is None or one.tasks >= best.tasks else best
    return best


def draw(
    listed: list[dict[str, Any]],
    path: Path,
    course: report.Summary | None = None,
    libraries: report.Summary | None = None,
) -> None:
    """Write the chart: success and cycle time over the versions, the others' as lines.

    Args:
        listed: as `rows` returns them, at least one.
        path: of the picture.
        course: of the course's parts at the same level, or None.
        libraries: the same with the libraries' parts.
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
    others = (("the course's parts", course, "--"), ("libraries' parts", libraries, ":"))
    for name, one, style in others:
        if one is not None:
            left.axhline(100.0 * one.rate, color="0.4", linestyle=style, label=name)
            right.axhline(one.quartiles()[1], color="0.4", linestyle=style, label=name)
    left.set_ylabel("success [%], 95 % interval")
    right.set_ylabel("cycle time [s], quartiles")
    left.legend(loc="lower right")
    for axes in (left, right):
        axes.set_xticks(x, names)
        axes.set_xlabel("version (its hash)")
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
