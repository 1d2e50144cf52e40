"""What a run shows: success with its interval, cycle time, the error budget, and who broke what."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from course.measure.success import paired, wilson
from drills.robot.play import Played
from drills.robot.records import Array, Breach
from drills.robot.slots import STAGES, stage_of

NOTABLE = 0.5e-3  # m, by which a stage's error has to exceed the course's to be named
REPEATS = 1000  # of the bootstrap


class Summary(NamedTuple):
    """A run in numbers; lengths in m, times in s.

    Attributes:
        tasks: number of tasks.
        success: whether each succeeded, shape (n,).
        low, high: Wilson's 95 % interval of the success rate.
        seconds: cycle time of each task, infinite without a placed part, shape (n,).
        distance: of the placed part from its slot, NaN without one, shape (n,).
        mean: signed share of each stage in the error, mean over tasks, shape (stages, 2).
        rms: root mean square of each share's length, shape (stages,).
        total: mean of the whole error, shape (2,), and its root mean square.
        processor: time of each stage, mean over tasks, shape (stages,).
    """

    tasks: int
    success: Array
    low: float
    high: float
    seconds: Array
    distance: Array
    mean: Array
    rms: Array
    total: tuple[Array, float]
    processor: Array

    @property
    def rate(self) -> float:
        """Share of successes."""
        return float(np.mean(self.success))

    def quartiles(self) -> tuple[float, float, float]:
        """Return the quartiles of the cycle time of the placed parts [s]; NaN if there are none."""
        measured = self.seconds[np.isfinite(self.seconds)]
        if not measured.size:
            return math.nan, math.nan, math.nan
        low, middle, high = np.quantile(measured, [0.25, 0.5, 0.75])
        return float(low), float(middle), float(high)

    def plain(self) -> dict[str, Any]:
        """Return it as data for a file."""

        def listed(values: Array) -> list[float | None]:
            return [round(float(v), 7) if math.isfinite(v) else None for v in np.ravel(values)]

        return {
            "success": [int(x) for x in self.success],
            "seconds": listed(self.seconds),
            "distance": listed(self.distance),
            "mean": listed(self.mean),
            "rms": listed(self.rms),
            "total": listed(self.total[0]) + listed(np.array([self.total[1]])),
            "processor": listed(self.processor),
        }


def summarise(played: Played) -> Summary:
    """Return the numbers of a run."""
    n, ok = len(played.success), int(np.sum(played.success))
    low, high = wilson(ok, max(n, 1))
    finite = np.isfinite(played.budget).all(axis=(1, 2))
    budget = played.budget[finite] if finite.any() else np.full((1, len(STAGES), 2), np.nan)
    total = budget.sum(axis=1)
    return Summary(
        n,
        played.success,
        float(low),
        float(high),
        played.seconds,
        np.hypot(played.error[:, 0], played.error[:, 1]),
        budget.mean(axis=0),
        np.sqrt(np.mean(np.sum(budget**2, axis=2), axis=0)),
        (total.mean(axis=0), float(np.sqrt(np.mean(np.sum(total**2, axis=1))))),
        played.processor.mean(axis=0),
    )


def tasks_needed(rate: float, threshold: float) -> int | None:
    """Return a round number of tasks at which the interval of this rate lies above a threshold.

    None where the rate itself does not exceed it, or by so little that 5,000 tasks don't show it.
    """
    for n in (50, 100, 150, 200, 300, 500, 1000, 2000, 5000):
        if rate > threshold and wilson(int(rate * n), n)[0] > threshold:
            return n
    return None


def restored(data: dict[str, Any]) -> Summary:
    """Return the summary that `Summary.plain` wrote.

    Raises:
        ValueError, KeyError, TypeError: for anything else.
    """

    def array(name: str) -> Array:
        return np.array([math.nan if v is None else float(v) for v in data[name]])

    success = array("success").astype(bool)
    seconds = array("seconds")
    low, high = wilson(int(success.sum()), success.size)
    total = array("total")
    return Summary(
        success.size,
        success,
        float(low),
        float(high),
        np.where(np.isnan(seconds), math.inf, seconds),
        array("distance"),
        array("mean").reshape(len(STAGES), 2),
        array("rms"),
        (total[:2], float(total[2])),
        array("processor"),
    )


class Change(NamedTuple):
    """How a robot differs from another on the same tasks: value, and both ends of its 95 %."""

    success: tuple[float, float, float]
    seconds: tuple[float, float, float]
    distance: tuple[float, float, float]


def compare(before: Summary, after: Summary) -> Change:
    """Return what changed from one robot to another, task by task, on the same tasks and noise."""
    n = min(before.tasks, after.tasks)
    success = paired(before.success[:n], after.success[:n])
    return Change(
        success,
        _mean_change(before.seconds[:n], after.seconds[:n]),
        _mean_change(before.distance[:n], after.distance[:n]),
    )


def _mean_change(before: Array, after: Array) -> tuple[float, float, float]:
    """Return the mean difference over tasks that both finished, with a bootstrap interval."""
    both = np.isfinite(before) & np.isfinite(after)
    if both.sum() < 2:
        return math.nan, math.nan, math.nan
    change = after[both] - before[both]
    rng = np.random.default_rng(0)
    picked = rng.integers(0, change.size, (REPEATS, change.size))
    low, high = np.quantile(change[picked].mean(axis=1), [0.025, 0.975])
    return float(change.mean()), float(low), float(high)


class Named(NamedTuple):
    """A part or a stage that a run names.

    Attributes:
        part: slot, function or stage.
        tasks: number of tasks in which it broke a promise; 0 where the budget names it.
        text: what is wrong.
        breach: the first broken promise, or None.
    """

    part: str
    tasks: int
    text: str
    breach: Breach | None


def diagnose(played: Played, mine: Summary, course: Summary | None) -> list[Named]:
    """Return who is to blame, the part with the most broken promises first.

    Args:
        played: a run without a failed part.
        mine: its summary.
        course: of the course's parts on the same tasks, for the budget; None to use promises only.
    """
    grouped: dict[str, list[Breach]] = {}
    for breach in played.breaches:
        grouped.setdefault(breach.part, []).append(breach)
    result = [Named(part, len(rows), rows[0].text, rows[0]) for part, rows in grouped.items()]
    result.sort(key=lambda named: -named.tasks)
    named = {stage_of(row.part) for row in result}
    if course is not None and np.isfinite(mine.rms).all():
        excess = mine.rms - course.rms
        for i in np.argsort(-excess):
            stage = STAGES[int(i)]
            if excess[i] > NOTABLE and excess[i] > 0.5 * excess.max() and stage not in named:
                text = (
                    f"its part of the error is {1e3 * mine.rms[i]:.1f} mm; "
                    f"{1e3 * course.rms[i]:.1f} mm with the course's parts"
                )
                result.append(Named(stage, 0, text, None))
    return result


def reasons(played: Played) -> list[tuple[str, int]]:
    """Return why tasks failed, and how many each, the most frequent first."""
    count: dict[str, int] = {}
    for why in played.why:
        if why:
            count[why] = count.get(why, 0) + 1
    return sorted(count.items(), key=lambda row: -row[1])
