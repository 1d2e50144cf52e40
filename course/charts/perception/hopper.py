"""Chapter 7: a hopper's height and velocity, by when a leg reading counts, beside the bound."""

from collections.abc import Iterator

import numpy as np

from course.charts import chart
from course.measure.figure import Panel, Series
from course.perception.camera import Array
from course.perception.hopper import CONTACT, HopLog, hop_bound, hop_filter, hop_logs

RULES = CONTACT[1:]


def squared_errors(logs: list[HopLog], rule: str) -> tuple[Array, Array]:
    """Return squared height errors and normalised squared errors, each (logs, samples)."""
    squares, normalised = [], []
    for log in logs:
        states, covariances = hop_filter(log, rule)
        error = states - np.column_stack((log.height, log.velocity))
        squares.append(error[:, 0] ** 2)
        solved = np.linalg.solve(covariances, error[:, :, None])[:, :, 0]
        normalised.append(np.sum(error * solved, axis=1))
    return np.array(squares), np.array(normalised)


@chart(columns=2)
def hopper_errors(logs: int = 200, samples: int = 300) -> Iterator[Panel]:
    """Chart the height error and the consistency of four contact rules over time."""
    drawn = hop_logs(np.random.default_rng(7), logs, samples=samples)
    time = drawn[0].dt * np.arange(samples)
    bound = np.sqrt(np.mean([hop_bound(log)[:, 0, 0] for log in drawn], axis=0))
    height = Panel(
        "Error of the height",
        "time [s]",
        "root mean square error [mm]",
        scale="log y",
    )
    consistency = Panel(
        "Normalised squared error",
        "time [s]",
        "median of the runs",
        scale="log y",
        lines=[("y", 1.386, "consistent")],
    )
    scored = samples // 3
    for rule in RULES:
        squares, normalised = squared_errors(drawn, rule)
        error = np.sqrt(np.mean(squares, axis=0))
        late = np.sqrt(np.mean(squares[:, scored:]))
        ratio = late / np.sqrt(np.mean(bound[scored:] ** 2))
        height.series.append(Series(rule, time, 1e3 * error, marker=""))
        consistency.series.append(Series(rule, time, np.median(normalised, axis=0), marker=""))
        height.notes.append(
            f"{rule}: {1e3 * late:.3g} mm from {time[scored]:g} s on, {ratio:.3g} times the bound"
        )
    height.series.append(Series("Cramér-Rao bound", time, 1e3 * bound, key="theory", marker=""))
    yield height
    yield consistency
