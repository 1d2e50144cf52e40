"""What self-collision and a held object cost a check, and what goes wrong without them."""

import itertools
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course import contact, planning
from course.charts import chart
from course.charts.planning.ladder import BOTH
from course.charts.planning.ompl_comparison import alone
from course.compiled import compiled
from course.kinematics import panda
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.oracles import coal
from course.planning import Shelf, World, check_path, edge_free, plan, state_free
from course.planning.capsules import (
    CENTRE,
    FRAME,
    FROM,
    HALF,
    HAND,
    PAIR,
    RADIUS,
    THICK,
    TO,
)
from course.planning.held import CUP, GRASP, holding, pairs_of, with_self_collision
from course.planning.worlds import EDGE, STATE

Array = NDArray[np.float64]
LENGTH = 1.0  # of a timed edge [rad]
NAMES = ("obstacles only", "and itself", "and a cup")


def variants(world: World) -> tuple[World, World, World]:
    """Return the world, the world with self-collision, and that with a cup in the hand as well."""
    checked = with_self_collision(world)
    return world, checked, holding(checked, contact.box(CUP))


def _timed(world: World, a: Array, b: Array | None) -> Any:
    tables = world.obstacles, world.body
    state, edge = compiled(world.state_free, STATE), compiled(world.edge_free, EDGE)

    def states() -> None:
        for q in a:
            state(*tables, q)

    def edges() -> None:
        for start, end in zip(a, b, strict=True):  # type: ignore[arg-type]
            edge(*tables, start, end)

    return calls(states if b is None else edges, clock=time.process_time)


def by_coal(world: World, box: bool = False) -> coal.CapsuleArm:
    """Return the same arm and obstacles in Coal, with the cup as its capsules or as a box."""
    rows = [r for r in world.body[world.dim + 1 :] if r[FRAME] != PAIR]
    capsules = [(int(r[FRAME]), r[FROM:TO], r[TO:THICK], float(r[THICK])) for r in rows]
    boards = [(contact.box(r[HALF:RADIUS]), [*r[CENTRE:HALF], 1, 0, 0, 0]) for r in world.obstacles]
    pairs, arm = pairs_of(world), len(HAND)
    if not box:
        return coal.CapsuleArm(panda(), capsules, boards, pairs)
    pairs = np.unique(np.minimum(pairs, arm), axis=0)
    return coal.CapsuleArm(panda(), HAND, boards, pairs, [(contact.box(CUP), GRASP)])


def _touching(world: World, path: Array) -> bool:
    """Return whether an edge of a path is rejected by a world's check."""
    return not all(edge_free(world, a, b) for a, b in itertools.pairwise(path.T))


def _library(arm: coal.CapsuleArm, states: Array) -> Any:
    def run() -> None:
        for q in states:
            arm.state_free(q)

    return calls(run, clock=time.process_time)


def free_edges(world: World, number: int, seed: int) -> tuple[Array, Array]:
    """Return free edges of `LENGTH` in random directions, (number, n) each [rad]."""
    rng, starts, ends = np.random.default_rng(seed), list[Array](), list[Array]()
    while len(starts) < number:
        a = np.asarray(rng.uniform(*world.bounds))
        along = np.asarray(rng.normal(size=a.size))
        b = np.clip(a + LENGTH * along / np.linalg.norm(along), *world.bounds)
        if edge_free(world, a, b):
            starts.append(a)
            ends.append(np.ascontiguousarray(b))
    return np.array(starts), np.array(ends)


@chart(columns=2)
def held_object(
    states: int = 20_000, timed: int = 200, queries: int = 100, cups: int = 50, repeats: int = 15
) -> Iterator[Panel]:
    """Chart the cost of a check with and without self-collision and a cup, and what they find.

    Args:
        states: random free configurations whose self-collisions are counted.
        timed: free configurations and free edges that are timed, free for all three variants.
        queries: of the arm at each shelf, planned without self-collision.
        cups: of those planned with a cup in the hand.
        repeats: rounds of the timing.
    """
    open_shelf = planning.shelf("open")
    worlds = variants(open_shelf.world)
    a, b = free_edges(worlds[-1], timed, 0)
    samplers = [_timed(w, a, ends) for ends in (None, b) for w in worlds]
    rivals = [by_coal(w) for w in worlds]
    samplers += [_library(rival, a) for rival in rivals]
    taken = interleaved(samplers, repeats=repeats)
    micros = np.array([1e6 * t.median / timed for t in taken]).reshape(3, -1)
    panel = Panel(
        "Time of a check, free",
        "microseconds",
        xlim=(0.0, None),
        footer=machine(libraries=("pin",)) + "; one core; Coal with Pinocchio",
    )
    labels, values = [], []
    kinds = ("state", "edge", "state by Coal")
    for kind, row in zip(kinds, micros, strict=True):
        for name, value in zip(NAMES, row, strict=True):
            labels.append(f"{kind}, {name}")
            values.append(value)
            panel.notes.append(f"free {kind}, {name}: {value:.1f} µs")
    panel.series.append(Series("", values, labels, style="bar"))
    panel.notes.append(f"pairs of capsules: {', '.join(str(len(pairs_of(w))) for w in worlds)}")
    yield panel

    panel = Panel("Collisions missed", "% of states or paths", xlim=(0.0, 100.0))
    labels, values = [], []

    def share(label: str, hits: int, of: int) -> None:
        labels.append(label)
        values.append(100.0 * hits / of)
        panel.notes.append(f"passed, {label}: {hits} of {of}, {100.0 * hits / of:.1f} %")

    rng, free, hits, different = np.random.default_rng(1), 0, np.zeros(2, int), 0
    exact, truly, needless = by_coal(worlds[2], box=True), 0, np.zeros(3, int)
    covers = [holding(worlds[1], contact.box(CUP), columns=m) for m in (1, 2, 3)]
    while free < states:
        q = np.asarray(rng.uniform(*open_shelf.world.bounds))
        if state_free(worlds[0], q):
            free += 1
            # Within 10 um of contact rounding and `FLOOR` may decide.
            if abs(planning.clearance(worlds[2], q)) > 1e-5:
                different += state_free(worlds[2], q) != rivals[2].state_free(q)
            if exact.state_free(q):
                truly += 1
                needless += [not state_free(cover, q) for cover in covers]
            by_itself = not state_free(worlds[1], q)
            hits += (by_itself, not by_itself and not state_free(worlds[2], q))
    share("random states, itself", int(hits[0]), states)
    share("random states, cup", int(hits[1]), states)
    panel.notes.append(f"states on which Coal disagrees: {different} of {states}")
    for m, count in enumerate(needless, 1):
        panel.notes.append(
            f"free for the box, rejected for {m * m} capsules: {count} of {truly}, "
            f"{100.0 * count / truly:.1f} %"
        )
    for name in ("open", "tight"):
        requested = planning.shelf(name)
        bare, itself, cup = variants(requested.world)
        for label, world, blind, number in (
            ("itself", itself, bare, queries),
            ("cup", cup, itself, cups),
        ):
            shelf: Shelf = replace(requested, world=world)
            rng, solved, wrong, paths, failed = np.random.default_rng(0), 0, 0, 0, 0
            spent: list[tuple[float, float]] = []
            alone(plan, world, *shelf.query(rng))  # compiles
            for k in range(number):
                ends = shelf.query(rng)
                (ignorant, before), (result, part) = (
                    alone(lambda w, q, s: plan(w, *q, rng=s, **BOTH), each, ends, k)
                    for each in (blind, world)
                )
                if ignorant.path is not None:
                    paths += 1
                    wrong += _touching(world, ignorant.path)
                solved += result.solved
                spent.append(
                    (
                        1e3 * before * ignorant.seconds if ignorant.solved else np.inf,
                        1e3 * part * result.seconds if result.solved else np.inf,
                    )
                )
                if result.path is not None and k % 10 == 0:
                    failed += not check_path(world, result.path, *ends)
            share(f"paths, {name} shelf, {label}", wrong, paths)
            without, own = np.median(spent, axis=0)
            panel.notes.append(
                f"planned, {name} shelf, {label}: {solved} of {number}, median {own:.2f} ms, "
                f"without the check {without:.2f} ms; {failed} of every tenth path collide"
            )
    panel.series.append(Series("", values, labels, style="bar"))
    yield panel
