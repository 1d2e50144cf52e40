"""VAMP compared on its own robot: what an edge and a plan take, and which collisions it misses."""

import functools
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course import contact, planning
from course.charts import chart
from course.charts.planning import batches
from course.compiled import compiled
from course.measure.figure import Panel, Series
from course.measure.success import Success
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.oracles import vamp
from course.planning import World, capsule_arm, edge_free, plan, state_free
from course.planning.batches import LANES, in_batches
from course.planning.worlds import EDGE

Array = NDArray[np.float64]
Edge = tuple[Array, Array]
BALL = 0.03  # radius of the obstacles [m]
LONG = 1.0  # of the timed edges [rad]
SKIP = 1000  # of Halton's points between the samples of one query and the next


def balls(number: int, seed: int) -> World:
    """Return VAMP's Panda among a number of balls, edges proved; none is near the arm's base."""
    rng, obstacles = np.random.default_rng(seed), []
    while len(obstacles) < number:
        at = rng.uniform([-0.9, -0.9, 0.0], [0.9, 0.9, 1.2])
        if np.hypot(at[0], at[1]) > 0.25:
            obstacles.append((contact.sphere(BALL), np.append(at, [1.0, 0.0, 0.0, 0.0])))
    return capsule_arm(obstacles, None, vamp.spheres())


def alike(world: World, number: int, seed: int) -> tuple[list[Edge], list[Edge], int, int]:
    """Return edges that both sides call free, and edges that both call colliding.

    All are free of collisions of the arm with itself, by VAMP's check, and their starts are free.

    Returns:
        So many free edges, so many colliding ones, how many were checked, and on how many of these
        the verdicts differed.
    """
    rng, ours = np.random.default_rng(seed), in_batches(world, vamp.spacing())
    other, alone = vamp.Arm(world), vamp.Arm()
    check, free, hit = compiled(ours.edge_free, EDGE), list[Edge](), list[Edge]()
    checked = different = 0
    for _ in range(1000 * number):
        if min(len(free), len(hit)) >= number:
            break
        a = np.asarray(rng.uniform(*world.bounds))
        along = np.asarray(rng.normal(size=a.size))
        b = a + LONG / np.linalg.norm(along) * along
        if np.any(b < world.bounds[0]) or np.any(b > world.bounds[1]):
            continue
        path = other.path(a, b)
        if not (state_free(world, a) and alone.path_free(path)):
            continue
        checked += 1
        mine = bool(check(ours.obstacles, ours.body, a, b))
        if mine != other.path_free(path):
            different += 1
        else:
            (free if mine else hit).append((a, b))
    return free[:number], hit[:number], checked, different


def _nothing(obstacles, body, a, b):
    return True


def checker(world: World, pairs: Sequence[Edge], edge: Callable[..., Any]) -> Callable[[], None]:
    """Return a function that checks all edges, one call of a compiled check from Python each."""
    check, tables = compiled(edge, EDGE), (world.obstacles, world.body)

    def run() -> None:
        for a, b in pairs:
            check(*tables, a, b)

    return run


def edge_times(counts: Sequence[int], number: int, repeats: int, built: str) -> Panel:
    """Chart the time of an edge of 1 rad against the number of obstacles.

    The time of a call that checks nothing is measured in the same rounds and subtracted.
    """
    kinds = ("free", "colliding")
    names = ("VAMP", f"batches of {LANES}", "conservative advancement")
    samplers, labels, notes = [], [], []
    for count in counts:
        world = balls(count, count)
        *sets, checked, different = alike(world, number, 0)
        ours, other = in_batches(world, vamp.spacing()), vamp.Arm(world)
        notes.append(f"{count} balls: {different} verdicts of {checked} edges differ from VAMP's")
        for kind, pairs in zip(kinds, sets, strict=True):
            if len(pairs) < number // 2:
                continue
            paths, bare = [other.path(*pair) for pair in pairs], [other.path(a) for a, _ in pairs]

            def theirs(paths: Sequence[Any], other: vamp.Arm = other) -> None:
                for path in paths:
                    other.path_free(path)

            runs = (
                functools.partial(theirs, paths),
                checker(ours, pairs, ours.edge_free),
                checker(world, pairs, world.edge_free),
                functools.partial(theirs, bare),
                checker(world, pairs, _nothing),
            )
            samplers += [calls(run, clock=time.process_time) for run in runs]
            labels.append((count, kind, len(pairs)))
    taken = interleaved(samplers, repeats=repeats, sample=2e-3)
    rows: dict[tuple[str, str], list[tuple[float, ...]]] = {}
    floors = []
    for i, (count, kind, size) in enumerate(labels):
        *own, vamp_call, own_call = taken[5 * i : 5 * i + 5]
        floors.append((vamp_call.median / size, own_call.median / size))
        for name, t in zip(names, own, strict=True):
            floor = vamp_call.median if name == "VAMP" else own_call.median
            micros = (1e6 * (v - floor) / size for v in (t.median, t.low, t.high))
            rows.setdefault((kind, name), []).append((count, *micros))
    panel = Panel(
        "An edge of 1 rad: filled free, hollow colliding",
        "balls among the obstacles",
        "µs for an edge",
        scale="log",
        footer=machine(max(t.busy for t in taken), libraries=("vamp-planner",))
        + f"{built}; processor time, one core",
        ticks=tuple(counts),
    )
    for (kind, name), row in rows.items():
        x, middle, low, high = np.transpose(row)
        words = ", ".join(
            f"{n:g}: {m:.3g} ({a:.3g} to {b:.3g})"
            for n, m, a, b in zip(x, middle, low, high, strict=True)
        )
        panel.series.append(
            Series(
                f"{name}, {kind}",
                x,
                middle,
                "",
                "-" if kind == "free" else "--",
                low=low,
                high=high,
                hollow=kind != "free",
                note=f"{kind} edge, {name}, by balls: {words} µs",
            )
        )
    vamp_call, own_call = 1e6 * np.median(floors, axis=0)
    panel.notes = [
        *notes,
        f"a call that checks nothing: VAMP {vamp_call:.2f} µs, ours {own_call:.2f} µs",
    ]
    return panel


def queries(shelf: planning.Shelf, world: World, number: int, seed: int) -> tuple[list[Edge], int]:
    """Return queries between bays whose ends are free for VAMP's spheres, and how many were not."""
    rng, result, rejected = np.random.default_rng(seed), list[Edge](), 0
    other = vamp.Arm(world)
    while len(result) < number:
        pair = shelf.query(rng)
        if all(state_free(world, q) and other.state_free(q) for q in pair):
            result.append(pair)
        else:
            rejected += 1
    return result, rejected


def own_time(run: Callable[[], Any]) -> tuple[Any, float]:
    """Return what a run returns, and its processor time [s]."""
    begun = time.thread_time()
    result = run()
    return result, time.thread_time() - begun


def plan_times(number: int, repeats: int) -> Panel:
    """Chart RRT-Connect at the open shelf: share of queries solved against processor time."""
    shelf = planning.shelf("open")
    # Without the floor, the first obstacle: VAMP's base stands in it.
    boards = shelf.world.obstacles[1:]
    world = replace(capsule_arm([], None, vamp.spheres()), obstacles=boards)
    known, rejected = queries(shelf, world, number, 3)
    other = vamp.Arm(world)
    ours = {
        f"ours, batches of {LANES}": in_batches(world, vamp.spacing()),
        "ours, conservative advancement": world,
    }
    spent: dict[str, list[float]] = {name: [] for name in ("VAMP", *ours)}
    unproved, single = dict.fromkeys(spent, 0), list[float]()
    nodes, own = list[int](), list[float]()
    for k, (start, goal) in enumerate(known):
        for name, costs in spent.items():
            runs = []
            for _ in range(repeats):
                if name == "VAMP":
                    run = functools.partial(other.plan, start, goal, other.planner(SKIP * k))
                else:
                    run = functools.partial(
                        plan, ours[name], start, goal, rng=k, budget=vamp.SAMPLES
                    )
                runs.append(own_time(run))
            answer = runs[0][0]
            if name == "VAMP":
                nodes.append(answer.nodes)
                own.append(float(np.median([result.seconds for result, _ in runs])))
            costs.append(
                math.inf if answer.path is None else float(np.median([t for _, t in runs]))
            )
            if answer.path is not None:
                edges = itertools.pairwise(np.ascontiguousarray(answer.path.T))
                unproved[name] += not all(edge_free(world, *edge) for edge in edges)
        single.append(own_time(functools.partial(plan, world, start, goal, rng=k, budget=1))[1])
    panel = Panel(
        "RRT-Connect at the open shelf",
        "processor time of a plan [s]",
        "share of the queries",
        scale="log x",
    )
    within = np.geomspace(1e-6, 1.0, 121)
    for name, costs in spent.items():
        series = Success(name, np.array([costs]), "s").series(within)
        low, middle, high = 1e3 * np.quantile(costs, (0.25, 0.5, 0.75), method="higher")
        series.note = (
            f"plan, {name}: median {middle:.3g} ms ({low:.3g} to {high:.3g}), slowest "
            f"{1e3 * max(costs):.3g} ms; {np.isfinite(costs).sum()} of {number} solved; "
            f"{unproved[name]} paths not proved free"
        )
        series.marker, series.key = "", ""
        panel.series.append(series)
    panel.notes = [
        f"{rejected} further queries had an end that collides for VAMP's spheres; ours with a "
        f"single sample takes {1e3 * np.median(single):.3g} ms; VAMP's trees have "
        f"{np.median(nodes):.0f} nodes in the median, {max(nodes)} at most, and its own search "
        f"takes {1e3 * np.median(own):.3g} ms"
    ]
    return panel


def missed_collisions(number: int) -> Panel:
    """Chart the collisions with a thin pole that both edge checks of VAMP miss."""
    world = batches.pole(vamp.spheres())
    a, b = batches.across(world, number, 2)
    along, alone, other = batches.collision_lengths(world, a, b), vamp.Arm(), vamp.Arm(world)
    shares = np.linspace(0.0, 1.0, 200)
    # An edge on which the arm meets itself is rejected for another reason.
    known = np.isfinite(along) & [
        all(alone.state_free(p + s * (q - p)) for s in shares) for p, q in zip(a, b, strict=True)
    ]
    a, b, along = a[known], b[known], along[known]
    length = np.linalg.norm(b - a, axis=1)
    panel = Panel(
        "VAMP: collisions missed with a pole of 8 mm",
        "spacing of the points / length of the collision",
        "share of the colliding edges",
        scale="log x",
        ticks=(0.25, 0.5, 1, 2, 4, 8),
    )
    checks: dict[str, tuple[float, Callable[[Array, Array], bool]]] = {
        "its planners": (vamp.spacing(), lambda p, q: other.path_free(other.path(p, q))),
        "validate_motion": (1.0, other.edge_free),
    }
    for name, (h, check) in checks.items():
        points = vamp.LANES * np.ceil(length / h / vamp.LANES)
        accepted = np.array([check(p, q) for p, q in zip(a, b, strict=True)])
        panel.series.append(batches.missed(name, length / points / along, accepted, style=""))
    return batches.limit(panel)


@chart(columns=2)
def vamp_comparison(
    counts: Sequence[int] = (3, 10, 30, 100),
    number: int = 40,
    repeats: int = 15,
    plans: int = 100,
    crossed: int = 4000,
    built: str = "",
) -> Iterator[Panel]:
    """Compare VAMP's Panda with the course's checks, the robot made of VAMP's own spheres.

    VAMP checks the arm against itself as well; the course's batches do not.

    Args:
        counts: of obstacles.
        number: of free and of colliding edges that are timed.
        repeats: rounds of the timing.
        plans: queries at the open shelf.
        crossed: edges through a thin pole.
        built: how VAMP was built, for the footer.
    """
    planning.warm()
    yield edge_times(counts, number, repeats, built and f"; {built}")
    yield plan_times(plans, 5)
    yield missed_collisions(crossed)
