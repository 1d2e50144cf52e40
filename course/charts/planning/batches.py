"""What vector instructions gain in the check of an edge, and what they miss."""

import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course import planning
from course.charts import chart
from course.compiled import compiled
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.planning import World, state_free
from course.planning.batches import LANES, in_batches, one_by_one
from course.planning.worlds import EDGE

Array = NDArray[np.float64]
STEP = 2.6  # of the planner, the longest edge [rad]
PLAIN = 0.05  # spacing at which the swelling is varied [rad]


def edges(world: World, number: int, seed: int) -> tuple[Array, Array]:
    """Return edges from free configurations in random directions, (number, 7) each [rad]."""
    rng, starts, ends = np.random.default_rng(seed), list[Array](), list[Array]()
    fat = in_batches(world)
    while len(starts) < number:
        a = np.asarray(rng.uniform(*world.bounds))
        if not state_free(fat, a):
            continue
        along = np.asarray(rng.normal(size=a.size))
        along *= STEP * rng.uniform(0.2, 1.0) / np.linalg.norm(along)
        starts.append(a)
        ends.append(np.clip(a + along, *world.bounds))
    return np.array(starts), np.array(ends)


def verdicts(world: World, a: Array, b: Array) -> NDArray[np.bool_]:
    """Return for each edge whether a world's check calls it free."""
    check = compiled(world.edge_free, EDGE)
    return np.array(
        [check(world.obstacles, world.body, *ends) for ends in zip(a, b, strict=True)], dtype=bool
    )


def _sampler(world: World, a: Array, b: Array) -> Any:
    check, tables = compiled(world.edge_free, EDGE), (world.obstacles, world.body)

    def run() -> None:
        for start, end in zip(a, b, strict=True):
            check(*tables, start, end)

    return calls(run, clock=time.process_time)


@chart(columns=2)
def batch_edges(
    number: int = 3000,
    timed: int = 60,
    spacings: Sequence[float] = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0),
    swells: Sequence[float] = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8),
    repeats: int = 9,
) -> Iterator[Panel]:
    """Chart the time of an edge check in batches, and what it gets wrong.

    Args:
        number: of edges whose verdicts are compared.
        timed: of free and of colliding edges that are timed.
        spacings: of points along an edge [rad].
        swells: of the spheres.
        repeats: rounds of the timing.
    """
    world = planning.shelf("open").world
    footer = machine(libraries=()) + "; one core"
    a, b = edges(world, number, 0)
    free = verdicts(world, a, b)
    for name, these in (("Free edges", free), ("Colliding edges", ~free)):
        some = np.flatnonzero(these)[:timed]
        start, end = np.ascontiguousarray(a[some]), np.ascontiguousarray(b[some])
        worlds = {"conservative advancement": [world] * len(spacings)}
        worlds["batches"] = [in_batches(world, h) for h in spacings]
        worlds["one by one"] = [one_by_one(each) for each in worlds["batches"]]
        flat = [world, *worlds["batches"], *worlds["one by one"]]
        taken = interleaved([_sampler(each, start, end) for each in flat], repeats=repeats)
        micros = np.array([1e6 * t.median / len(some) for t in taken])
        panel = Panel(
            name, "spacing of the points [rad]", "µs for an edge", scale="log", footer=footer
        )
        values = {
            "conservative advancement": np.full(len(spacings), micros[0]),
            f"batches of {LANES}": micros[1 : 1 + len(spacings)],
            "the same points, one by one": micros[1 + len(spacings) :],
        }
        for label, y in values.items():
            words = ", ".join(f"{x:.3g}" for x in y)
            note = f"{name.lower()}, {label}: {words} µs"
            panel.series.append(Series(label, spacings, y, note=note))
        panel.series[0].style, panel.series[0].marker = ":", ""
        panel.notes = [f"spacing {', '.join(f'{h:g}' for h in spacings)} rad"]
        yield panel

    panel = Panel(
        "Free edges rejected", "swelling of the spheres, share of the radius",
        "share of the edges", scale="log", ticks=(0.02, 0.1, 0.8), footer=footer,
    )  # fmt: skip
    missed, fat = [], []
    for h in spacings:
        result = verdicts(in_batches(world, h), a, b)
        missed.append(np.mean(result[~free]))
    for swell in swells:
        result = verdicts(in_batches(world, PLAIN, swell), a, b)
        fat.append(1.0 - np.mean(result[free]))
    pairs = (
        ("collisions missed, by spacing", spacings, missed, int((~free).sum()), "colliding"),
        ("free edges rejected, by swelling", swells, fat, int(free.sum()), "free"),
    )
    for label, x, share, of, kind in pairs:
        words = ", ".join(f"{v:.2%}" for v in share)
        note = f"{label} {', '.join(f'{v:g}' for v in x)}: {words} of {of} {kind} edges"
        # A logarithmic axis has no place for none.
        y = np.array(share)
        if np.any(y > 0.0):
            panel.series.append(Series(label, np.array(x)[y > 0.0], y[y > 0.0], note=note))
        else:
            panel.notes.append(note)
    yield panel
