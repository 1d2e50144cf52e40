"""What a step costs: how it grows with a scene, and Python's share of it."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from course.charts import chart
from course.charts.platforms.smooth import LIBRARIES, again, here
from course.measure.figure import Panel, Series
from course.measure.timing import Timing, interleaved
from course.measure.work_precision import machine
from course.platforms import FAIR, Engine, Scene, prepared
from course.platforms.measures import slope
from course.platforms.scenes import chain, field, tower

SIZES: dict[str, tuple[Callable[[int], Scene], Sequence[int], Mapping[str, int]]] = {
    "chain": (chain, (1, 2, 4, 8, 16, 32, 64), {}),
    "tower": (tower, (1, 2, 3, 5, 8), {"Drake": 5, "own code": 5}),
    "field": (field, (1, 4, 16, 64), {"Drake": 16, "own code": 16}),
}


def step_costs(
    jobs: Sequence[tuple[Engine, Scene, int]], dt: float, repeats: int
) -> list[tuple[Timing, int]]:
    """Measure each job's processor time of all its steps in one call, interleaved."""
    samplers = []
    for engine, scene, steps in jobs:
        run = prepared(engine, scene, dt, FAIR)
        run.run(20)  # contacts are made, caches are filled
        samplers.append(again(run, steps))
        samplers[-1](1)
    times = interleaved(samplers, repeats=repeats, sample=2e-3, warm=True)
    return [(time, steps) for time, (_, _, steps) in zip(times, jobs, strict=True)]


def in_one_call(name: str) -> int:
    """Return how many steps are timed at once: few where a step takes milliseconds."""
    return {"own code": 20, "Drake": 10}.get(name, 100)


@chart(columns=2)
def platform_scaling(
    scenes: Sequence[str] = tuple(SIZES), at_most: int = 64, dt: float = 1e-3, repeats: int = 5
) -> Iterator[Panel]:
    """Chart the cost of a step against the size of a scene, and what Python adds to it.

    Args:
        scenes: some of `SIZES`.
        at_most: largest number of bodies.
        dt: step [s].
        repeats: rounds.
    """
    for name in scenes:
        make, sizes, limits = SIZES[name]
        rows = [
            (label, n) for label in here() for n in sizes if n <= min(at_most, limits.get(label, n))
        ]
        jobs, smooth = [], name == "chain"
        for label, n in rows:
            jobs.append((here()[label], make(n), 100 if smooth else in_one_call(label)))
        result = step_costs(jobs, dt, repeats)
        cost = {row: time.best / steps for row, (time, steps) in zip(rows, result, strict=True)}
        unit = cost["MuJoCo", sizes[0]]
        busy = max(time.busy for time, _ in result)
        panel = Panel(
            f"A step of a {name}",
            "links n" if smooth else "cubes n",
            f"cost, MuJoCo at n = {sizes[0]} is 1",
            scale="log",
            footer=machine(busy, libraries=LIBRARIES),
        )
        for label in here():
            x = [n for row, n in rows if row == label]
            y = [cost[label, n] / unit for n in x]
            last = slope(x[-3:], y[-3:])
            beside = [cost[label, n] / cost["MuJoCo", n] for n in x]
            message = ", ".join(f"n={n}: {c:.3g}" for n, c in zip(x, beside, strict=True))
            panel.series.append(
                Series(
                    f"{label}, n^{last:.2f}",
                    x,
                    y,
                    label,
                    size=5.0,
                    note=f"{name}: {label} over MuJoCo: {message}; at the end {label}'s "
                    f"cost grows as n^{last:.2f}",
                )
            )
        panel.notes.append(
            f"{name}: MuJoCo's step of n = {sizes[0]} takes {1e6 * unit:.2g} us here"
        )
        yield panel
    panel = Panel(
        "Overhead of one call for each step",
        "links of a chain",
        "share of the step",
        scale="log x",
        ylim=(0.0, 1.05),
    )
    links = [n for n in (1, 4, 16, 64) if n <= at_most]
    for label, engine in here().items():
        jobs = [(engine, chain(n), steps) for n in links for steps in (1, 100)]
        result = step_costs(jobs, dt, repeats)
        each = np.array([time.best / steps for time, steps in result]).reshape(-1, 2)
        if engine.loop:
            share = np.maximum(1.0 - each[:, 1] / each[:, 0], 0.0)
            words = f"{label}, chain of n links: time saved by 100 steps in one call"
            name, style = label, "-"
        else:
            # It is called once per step: a call costs at most a step of a world with nothing in it.
            (empty, steps) = step_costs([(engine, _nothing(), 100)], dt, repeats)[0]
            share = np.minimum(empty.best / steps / each[:, 1], 1.0)
            words = f"{label}, chain of n links: an empty world's step as a share"
            name, style = f"{label}, an empty step", "--"
        message = ", ".join(f"n={n}: {100 * s:.0f} %" for n, s in zip(links, share, strict=True))
        panel.series.append(
            Series(name, links, share, label, style, size=5.0, note=f"{words}: {message}")
        )
    yield panel


def _nothing() -> Scene:
    """Return a ground on which nothing is."""
    return replace(field(1), bodies=())
