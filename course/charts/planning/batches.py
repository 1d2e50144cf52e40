"""What vector instructions gain in the check of an edge, and what they miss."""

import itertools
import math
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numba import types
from numpy.typing import NDArray

from course import contact, planning
from course.charts import chart
from course.compiled import MATRIX, VECTOR, compiled
from course.measure.figure import Panel, Series
from course.measure.success import wilson
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.planning import World, capsule_arm, edge_free, state_free
from course.planning.batches import LANES, in_batches, one_by_one, spheres_over
from course.planning.capsules import HAND, _state
from course.planning.worlds import EDGE

Array = NDArray[np.float64]
STEP = 2.6  # of the planner, the longest edge [rad]
PLAIN = 0.05  # spacing at which the swelling is varied [rad]
POLE = 0.004  # radius of a thin obstacle [m]
FINEST = 4000  # states of an edge by which the length of its collision is measured
RATIOS = tuple(np.geomspace(0.125, 8.0, 13))  # bounds of the classes of spacing / collision
MARKS = types.void(MATRIX, MATRIX, VECTOR, VECTOR, VECTOR)


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


def pole(capsules: Sequence[Any]) -> World:
    """Return a world with a thin upright pole before an arm of capsules, edges proved."""
    place = np.array([0.55, 0.0, 0.55, 1.0, 0.0, 0.0, 0.0])
    return capsule_arm([(contact.capsule(POLE, 0.25), place)], None, capsules)


def _mark(obstacles, body, a, b, hits):
    for k in range(hits.size):
        hits[k] = 0.0 if _state(obstacles, body, a + (k + 1) / hits.size * (b - a)) else 1.0


def collision_lengths(world: World, a: Array, b: Array) -> Array:
    """Return how much of each edge collides [rad], shape (m,).

    It is NaN where an edge collides in more than one stretch, or in a stretch of less than five of
    the `FINEST` states: of such short ones, those that are met by chance would be counted alone.

    Args:
        world: of an arm of capsules.
        a: free starts of edges, rows, (m, n) [rad].
        b: their free ends, (m, n) [rad].
    """
    mark, hits, result = compiled(_mark, MARKS), np.empty(FINEST), np.full(len(a), np.nan)
    for i, ends in enumerate(zip(a, b, strict=True)):
        mark(world.obstacles, world.body, *ends, hits)
        stretches = np.count_nonzero(np.diff(hits, prepend=0.0) > 0.0)
        if stretches == 1 and hits.sum() >= 5.0:
            result[i] = hits.mean() * np.linalg.norm(b[i] - a[i])
    return result


def across(world: World, number: int, seed: int) -> tuple[Array, Array]:
    """Return long edges between free postures that collide, (number, n) each [rad]."""
    rng, starts, ends = np.random.default_rng(seed), list[Array](), list[Array]()
    while len(starts) < number:
        a, b = (np.asarray(rng.uniform(*world.bounds)) for _ in range(2))
        if state_free(world, a) and state_free(world, b) and not edge_free(world, a, b):
            starts.append(a)
            ends.append(b)
    return np.array(starts), np.array(ends)


def expected_missed(ratio: float) -> float:
    """Return the share of collisions that points miss, for a ratio of spacing to collision.

    Points a distance h apart, with a random offset, all fall outside a stretch of length c with
    probability 1 - c / h where h > c.
    """
    return max(0.0, 1.0 - 1.0 / ratio)


def missed(label: str, ratios: Array, accepted: NDArray[np.bool_], **looks: Any) -> Series:
    """Return the share of colliding edges that a check accepts, by spacing over collision.

    Args:
        label: of the series.
        ratios: of each edge, spacing of the points over the length of the collision, (m,).
        accepted: whether the check called the edge free, (m,).
        **looks: further arguments of `Series`.
    """
    rows, worst, short = [], 0.0, ratios <= 1.0
    for low, high in itertools.pairwise(RATIOS):
        these = (ratios >= low) & (ratios < high)
        count = int(these.sum())
        if count < 20:
            continue
        share = float(accepted[these].mean())
        law = float(np.mean([expected_missed(r) for r in ratios[these]]))
        # In standard errors of a share of this number of edges.
        worst = max(worst, abs(share - law) / math.sqrt(max(law * (1 - law), 1 / count) / count))
        bounds = wilson(np.array(share * count), count)
        rows.append((math.sqrt(low * high), share, *(float(v) for v in bounds), count))
    x, y, lower, upper, counts = np.transpose(rows)
    words = ", ".join(f"{r:.2g}: {v:.1%}" for r, v in zip(x, y, strict=True))
    note = (
        f"{label}, missed by spacing over collision: {words}; {int(counts.sum())} checks; "
        f"{accepted[short].sum()} of {short.sum()} missed at ratios up to 1, "
        f"{accepted[~short].sum()} of {(~short).sum()} above"
    )
    if accepted.any():
        note += f"; at most {worst:.1f} standard errors from 1 - 1/ratio"
    return Series(label, x, y, low=lower, high=upper, note=note, **looks)


def limit(panel: Panel) -> Panel:
    """Give a panel of `missed` its theory and its limit."""
    x = np.geomspace(RATIOS[0], RATIOS[-1], 200)
    law = [expected_missed(r) for r in x]
    panel.series.append(Series("1 - collision / spacing", x, law, "theory", marker=""))
    panel.lines = [("x", 1.0, "spacing = collision")]
    return panel


def missed_collisions(number: int, spacings: Sequence[float], footer: str) -> Panel:
    """Chart which collisions with a thin pole the batches miss, and that the proof misses none."""
    spheres = spheres_over(HAND)
    world = pole(spheres)
    a, b = across(world, number, 1)
    length, along = np.linalg.norm(b - a, axis=1), collision_lengths(world, a, b)
    known = np.isfinite(along)
    a, b, length, along = a[known], b[known], length[known], along[known]
    ratios, accepted = list[Array](), list[NDArray[np.bool_]]()
    for h in spacings:
        # A batch has all its points on the edge, so that the spacing is often finer than h.
        points = LANES * np.ceil(length / h / LANES)
        ratios.append(length / points / along)
        accepted.append(verdicts(in_batches(world, h), a, b))
    panel = Panel(
        "Collisions missed with a pole of 8 mm",
        "spacing of the points / length of the collision",
        "share of the colliding edges",
        scale="log x",
        footer=footer,
        ticks=(0.25, 0.5, 1, 2, 4, 8),
    )
    every = np.concatenate(ratios)
    proved = np.tile(verdicts(world, a, b), len(spacings))
    panel.series = [
        missed(f"batches of {LANES}", every, np.concatenate(accepted), style=""),
        missed("conservative advancement", every, proved, style=":"),
    ]
    return limit(panel)


@chart(columns=2)
def batch_edges(
    number: int = 3000,
    timed: int = 60,
    spacings: Sequence[float] = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0),
    swells: Sequence[float] = (0.02, 0.05, 0.1, 0.2, 0.4, 0.8),
    repeats: int = 15,
    crossed: int = 4000,
) -> Iterator[Panel]:
    """Chart the time of an edge check in batches, and what it gets wrong.

    Args:
        number: of edges whose verdicts are compared.
        timed: of free and of colliding edges that are timed.
        spacings: of points along an edge [rad].
        swells: of the spheres.
        repeats: rounds of the timing.
        crossed: edges through a thin pole.
    """
    world = planning.shelf("open").world
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
        footer = machine(max(t.busy for t in taken), libraries=()) + "; processor time, one core"
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
        "Free edges rejected",
        "swelling of the spheres, share of the radius",
        "share of the edges",
        scale="log",
        ticks=(0.02, 0.1, 0.8),
        footer=footer,
    )
    passed, fat = [], []
    for h in spacings:
        result = verdicts(in_batches(world, h), a, b)
        passed.append(np.mean(result[~free]))
    for swell in swells:
        result = verdicts(in_batches(world, PLAIN, swell), a, b)
        fat.append(1.0 - np.mean(result[free]))
    pairs = (
        ("collisions missed, by spacing", spacings, passed, int((~free).sum()), "colliding"),
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
    yield missed_collisions(crossed, spacings, footer)
