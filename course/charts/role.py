"""Charts of chapter 0: the closed form beside event simulation, and where its mean is wrong."""

import functools
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.role import CHAIN, Stage, age, simulate

Array = NDArray[np.float64]
CAMERA = 1.0 / 30.0


def lattice(count: int, dimensions: int) -> Array:
    """Return points spread evenly in the unit cube, (count, dimensions).

    They are multiples of roots, modulo 1.
    """
    root = 1.0
    # Fixed-point iteration for the generalised golden ratio: a low-discrepancy sequence.
    for _ in range(40):  # root^(dimensions + 1) = root + 1 (Roberts, 2018)
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    return (0.5 + np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, dimensions + 1))) % 1.0


def sampled(phases: Array) -> float:
    """Return the mean age at one moment of as many runs of the chain [s].

    Rows hold phases and a moment.
    """
    return float(
        np.mean(
            [
                simulate(CHAIN, row[:3], seconds=0.6).age(np.array([0.4 + 0.1 * row[3]]))[0]
                for row in phases
            ]
        )
    )


@chart
def age_precision(
    runs: Sequence[int] = (3, 10, 30, 100, 300, 1000), repeats: int = 9, reference: int = 8192
) -> Iterator[Panel]:
    """Chart the mean age of the chapter's chain: error against processor time."""
    # The truth by even phases: event simulation, independent of the closed form.
    truth, rng = sampled(lattice(reference, 4)), np.random.default_rng(0)
    predicted = age(CHAIN)
    panel = Panel(
        "Error of the mean age: closed form and simulation",
        "processor time [s]",
        "error of the mean age [s]",
        scale="log",
        lines=[("y", 1e-3, "1 ms: 0.3 mm at 0.3 m/s")],
    )
    requested: list[Callable[[], object]] = [functools.partial(age, CHAIN)]
    draws = {n: [rng.random((n, 4)) for _ in range(repeats)] for n in runs}
    requested += [functools.partial(sampled, draws[n][0]) for n in runs]
    # Processor time, closed form and all numbers of runs in turn.
    timed = interleaved([calls(f, clock=time.process_time) for f in requested], repeats=3)
    # Many repeats of each size, since a single error may be small by luck.
    errors = np.array([[abs(sampled(d) - truth) for d in draws[n]] for n in runs])
    panel.series.append(
        Series(
            "event simulation",
            [t.median for t in timed[1:]],
            np.median(errors, axis=1),
            "events",
            low=np.quantile(errors, 0.25, axis=1),
            high=np.quantile(errors, 0.75, axis=1),
            note=f"{runs[-1]:,} runs: computed in {1e3 * timed[-1].median:.0f} ms, median error "
            f"{1e3 * np.median(errors[-1]):.2f} ms; standard deviation of one age "
            f"{1e3 * predicted.std:.1f} ms",
        )
    )
    own = abs(predicted.mean - truth)
    panel.series.append(
        Series(
            "closed form",
            [timed[0].median],
            [own],
            "closed form",
            "",
            note=f"closed form: computed in {1e6 * timed[0].median:.1f} µs, "
            f"differs by {1e3 * own:.3f} ms from the mean of {reference:,} even phases",
        )
    )
    panel.notes.append(
        f"mean {1e3 * predicted.mean:.2f} ms predicted, {1e3 * truth:.2f} by even phases; least "
        f"{1e3 * predicted.least:.2f}, bound {1e3 * predicted.greatest:.2f}"
    )
    panel.footer = machine(max(t.busy for t in timed))
    yield panel


def at_read(reader: float, phase: float, seconds: float, depth: int = 1) -> tuple[Array, Array]:
    """Return when a reader reads a quick camera, and how old what it gets is [s]."""
    # Executions of a microsecond: what is left is the waiting.
    run = simulate(
        [Stage("camera", 1e-6, CAMERA), Stage("reader", 1e-6, reader, depth)],
        [0.0, phase],
        seconds=seconds,
    )
    return run.published, run.published - run.captured


@chart
def age_limits(phases: int = 41, seconds: float = 30.0, beats: float = 2.5) -> Iterator[Panel]:
    """Chart where the mean is wrong: locked clocks, drifting clocks, deep queues, overload."""
    panel = Panel(
        "Locked clocks: the mean depends on the start",
        "start phase, share of the reader's period",
        "mean age at reading [s]",
        lines=[("y", CAMERA / 2, "T / 2")],
    )
    starts = np.linspace(0.01, 0.99, phases)
    readers = (("10 Hz, locked", 10.0, "locked"), ("9.73 Hz, not locked", 9.73, "events"))
    for label, rate, key in readers:
        # Without the first readings, which start before the camera.
        ages = [at_read(1 / rate, p, seconds)[1][3:].mean() for p in starts]
        panel.series.append(
            Series(
                label,
                starts,
                ages,
                key,
                theory=(lambda p: (0.1 * p) % CAMERA + 1e-6) if rate == 10.0 else None,
                note=f"{label:<19} from {min(ages):.4f} to {max(ages):.4f} s",
            )
        )
    yield panel

    panel = Panel("100 ppm apart: a tooth of one period in 333 s", "time [s]", "age at reading [s]")
    times, tooth = at_read(CAMERA * (1 + 1e-4), 0.3, beats * CAMERA / 1e-4)
    few = slice(0, None, max(times.size // 400, 1))
    panel.series.append(
        Series(
            "30 Hz and 29.997 Hz",
            times[few],
            tooth[few],
            "events",
            "",
            theory=lambda t: (0.3 * CAMERA + 1e-4 * t) % CAMERA,
            note=f"drift of 1e-4: age from {tooth.min():.4f} to {tooth.max():.4f} s",
        )
    )
    yield panel

    depths = np.arange(1, 11)
    panel = Panel(
        "A queue of depth d adds (d - 1) T if its reader is slower",
        "queue depth d",
        "mean age at reading [s]",
    )
    for label, reader, full, key in (
        ("reader at 9.7 Hz", 1 / 9.7, 1.0, "queue"),
        ("reader at 33 Hz", 1 / 33.0, 0.0, "events"),
    ):
        ages = [at_read(reader, 0.3, seconds, int(d))[1][60:].mean() for d in depths]
        panel.series.append(
            Series(
                label,
                depths,
                ages,
                key,
                theory=functools.partial(lambda d, f: CAMERA / 2 + f * (d - 1) * CAMERA, f=full),
                note=f"{label:<18} depth 1 {ages[0]:.3f} s, depth 10 {ages[-1]:.3f} s",
            )
        )
    yield panel

    loads = np.concatenate([np.linspace(0.5, 0.99, 6), np.linspace(1.01, 2.0, 10)])
    slopes = []
    for load in loads:
        late = Stage("slow", load * CAMERA, None, 100_000, "queue")
        run = simulate([Stage("camera", 1e-6, CAMERA), late], [0.0, 0.0], seconds=seconds)
        # Slope after the first samples, when the queue has begun to grow.
        slopes.append(np.polyfit(run.published[9:], (run.published - run.captured)[9:], 1)[0])
    panel = Panel(
        "Overload: without a limit the age grows",
        "execution time over interval, C / T",
        "growth of the age [s/s]",
        lines=[("x", 1.0, "always busy")],
    )
    panel.series.append(
        Series(
            "queue without a limit",
            loads,
            slopes,
            "queue",
            "",
            theory=lambda x: max(1 - 1 / x, 0.0),
            note=f"C / T = {loads[-1]:g}: the age grows by {slopes[-1]:.3f} s/s",
        )
    )
    yield panel
