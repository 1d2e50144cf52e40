"""Beside OMPL: how soon a plan is found and in how many samples, and what a path costs in time."""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse, stats

from course import planning
from course.charts import chart
from course.compiled import compiled
from course.measure.figure import Panel, Series
from course.measure.success import Success, wilson
from course.measure.work_precision import machine
from course.oracles import ompl
from course.planning import Plan, Scene, World, build_roadmap, check_path, length, plan, scenes
from course.planning.roadmaps import FREE
from course.planning.worlds import EDGE

Array = NDArray[np.float64]
BUDGET = 20_000  # samples
FINE = 0.002  # of the diagonal, between two states that OMPL tries; its own choice is 0.01


def ours(
    scene: Scene, seed: int, method: str = "rrt_connect", budget: int = BUDGET, **options: Any
) -> Plan:
    """Return our plan of a scene."""
    if not method.startswith("prm"):
        options["step"] = scene.step
    return plan(
        scene.world, scene.start, scene.goal, method=method, budget=budget, rng=seed, **options
    )


def theirs(
    scene: Scene,
    seed: int,
    method: str,
    state: Any,
    edge: Any,
    budget: int = BUDGET,
    resolution: float = 0.01,
) -> ompl.Plan:
    """Return OMPL's plan of a scene."""
    return ompl.solve(
        scene.world.bounds,
        scene.start,
        scene.goal,
        method,
        scene.step,
        budget,
        seed,
        state,
        edge,
        resolution=resolution,
    )


def alone(run: Callable[..., Any], *args: Any) -> tuple[Any, float]:
    """Return what a run returns, and the share of its time that it had a core.

    Other processes' time is not counted.
    """
    # Thread time over wall time: below 1 another process had the core for a while.
    wall, own = time.perf_counter(), time.thread_time()
    result = run(*args)
    return result, min(1.0, (time.thread_time() - own) / (time.perf_counter() - wall))


def checked_twice(world: World) -> World:
    """Return the same world with each edge checked from both ends.

    The added time is that of the edge checks.
    """
    once = compiled(world.edge_free, EDGE)

    def edge_free(obstacles, body, a, b):
        # Doubling the edge checks makes their cost measurable without a timer inside the loop.
        forward, back = once(obstacles, body, a, b), once(obstacles, body, b, a)
        return forward and back

    return replace(world, edge_free=edge_free)


# --- time to a plan -------------------------------------------------------------------------------


def planners(world: World, slow: int) -> dict[str, tuple[int, Callable[[Scene, int], Any]]]:
    """Return each interface as a pair (k, plan), by its name.

    Every k-th seed is planned with it, and `plan(scene, seed)` makes the plan.

    Args:
        world: of the scenes.
        slow: k of OMPL with states in Python, in the plane; four times as large for an arm.
    """
    (state, edge), python = ompl.tests(world), ompl.plain(world)
    # States in Python are slow, so fewer seeds are planned with them.
    twice, rare = checked_twice(world), slow if world.dim == 2 else 4 * slow

    def other(state: Any, edge: Any, resolution: float = 0.01) -> Callable[[Scene, int], Any]:
        return lambda q, k: theirs(q, k, "rrt_connect", state, edge, resolution=resolution)

    return {
        "ours": (1, ours),
        "ours twice": (1, lambda q, k: ours(replace(q, world=twice), k)),
        "OMPL, our edge check": (1, other(state, edge)),
        "OMPL, Python states": (rare, other(python, None)),
        f"OMPL, Python, {FINE:.1%}": (2 * rare, other(python, None, FINE)),
    }


def times(questions: Sequence[Scene], slow: int, repeats: int, longest: float = 1.0) -> Panel:
    """Chart the share of queries with a free path against time.

    There is one world, with seeds from 1 up.

    A path that the exact judge refuses is a failure. OMPL's own part is its run with our edge check
    without the calls into Python. `slow` is as in `planners`.
    """
    paths = planners(questions[0].world, slow)
    spent: dict[str, list[float]] = {name: [] for name in [*paths, "OMPL's own part"]}
    rejected = dict.fromkeys(paths, 0)
    for seed, scene in enumerate(questions, 1):
        for owner, (every, method) in paths.items():
            if seed % every:
                continue
            # Each seed is repeated; the same seed plans the same tree, so the times differ by
            # disturbances only.
            runs = [alone(method, scene, seed) for _ in range(repeats)]
            path = runs[0][0].path
            if path is not None and isinstance(runs[0][0], ompl.Plan):
                path = path.T
            free = path is not None and (
                owner == "ours twice"  # the path of "ours", judged there
                or bool(check_path(scene.world, path, scene.start, scene.goal))
            )
            rejected[owner] += path is not None and not free
            # The fastest undisturbed run, else the one that was disturbed least: what took the
            # core away may have done so outside of the search.
            calm = [pair for pair in runs if pair[1] > 0.95]
            run, share = (
                min(calm, key=lambda pair: pair[0].seconds)
                if calm
                else max(runs, key=lambda pair: pair[1])
            )
            least = run.seconds * share
            spent[owner].append(least if free else math.inf)
            if owner == "OMPL, our edge check":
                own = run.own_seconds * share
                spent["OMPL's own part"].append(own if free else math.inf)
    # With b without checks and e for the checks: 2 (b + e) - (b + 2 e) = b.
    bare_times = 2 * np.array(spent["ours"]) - np.array(spent.pop("ours twice"))
    middle = {name: float(np.median(result)) for name, result in spent.items()}
    name = questions[0].name
    # A single sample: what a call costs before any search.
    door = np.median([ours(q, k, budget=1).seconds for k, q in enumerate(questions, 1)])
    bare = 1e3 * float(np.median(bare_times)), 1e3 * middle["OMPL's own part"]
    panel = Panel(
        name,
        "seconds for a plan",
        "share of plans with a free path",
        scale="log x",
        footer=machine(libraries=("ompl",)) + "; one core",
    )
    within = np.geomspace(1e-5, longest, 101)
    for owner, result in spent.items():
        key = {"ours": "course", "OMPL's own part": "theory"}.get(owner, "")
        series = Success(owner, np.array([result]), "s").series(within, key)
        missed = rejected.get(owner, 0)
        series.note = (
            f"{name:<11} {owner:<21} median {1e3 * middle[owner]:7.3f} ms, "
            f"{middle[owner] / middle['ours']:5.1f} of ours; {missed} of {len(result)} collide"
        )
        panel.series.append(series)
    panel.notes = [
        f"{name:<11} edge checks left out on both sides: ours {bare[0]:.3f} ms, OMPL's "
        f"{bare[1]:.3f} ms; ours with a single sample {1e3 * door:.3f} ms"
    ]
    return panel


@chart(columns=2)
def plan_times(seeds: int = 200, slow: int = 2, repeats: int = 3) -> Iterator[Panel]:
    """Chart RRT-Connect, ours and OMPL's: the share of seeds with a free path against time."""
    planning.warm()
    for scene in (scenes.discs(), scenes.gap(0.1), scenes.gap(0.02), scenes.arm()):
        yield times([scene] * seeds, slow, repeats)


@chart
def shelf_times(queries: int = 80, repeats: int = 2) -> Iterator[Panel]:
    """Chart the same for the 7-R arm, from bay to bay of the open shelf, each question once."""
    planning.warm()
    place, rng = planning.shelf("open"), np.random.default_rng(1)
    requested = [place.query(rng) for _ in range(queries)]
    yield times([Scene("7-R arm", place.world, *q, 1.0) for q in requested], 1, repeats, 100.0)


# --- as many samples ------------------------------------------------------------------------------


def cumulative(name: str, values: tuple[Array, Array], scale: float, unit: str) -> list[Series]:
    """Return shares below each value, ours and OMPL's; the rank test between them."""
    # Mann-Whitney: are both samples from one distribution? No assumption about its shape.
    same = stats.mannwhitneyu(*values).pvalue
    low, high = np.min(values), np.max(np.ma.masked_invalid(values))
    within, both = np.geomspace(low / scale, high * scale, 61), []
    for owner, result in zip(("ours", "OMPL"), values, strict=True):
        label = f"{name}, {owner}"
        both.append(
            Success(label, result[None], unit).series(
                within, style="-" if owner == "ours" else "--"
            )
        )
        both[-1].marker = ""
        middle = np.median(result)
        both[
            -1
        ].note = f"{label:<22} median {middle:7.4g} {unit}, {result.size} seeds; p {same:.2f}"
    return both


def roadmap_joins(scene: Scene, nodes: Array, pairs: NDArray[np.int64]) -> bool:
    """Return whether the states nearest to start and goal, of those with an edge, are joined."""
    matrix = sparse.coo_matrix((np.ones(len(pairs)), pairs.T), (len(nodes),) * 2)
    _, part = sparse.csgraph.connected_components(matrix, directed=False)
    # Isolated states join nothing and are not counted as entrances.
    near = np.flatnonzero(np.bincount(pairs.ravel(), minlength=len(nodes)))
    if not near.size:
        return False
    ends = [
        part[near[np.linalg.norm(nodes[near] - q, axis=1).argmin()]]
        for q in (scene.start, scene.goal)
    ]
    return bool(ends[0] == ends[1])


@chart(columns=2)
def sample_counts(
    seeds: int = 500,
    stars: int = 100,
    maps: int = 100,
    sizes: Sequence[int] = (10, 20, 40, 80, 160),
) -> Iterator[Panel]:
    """Chart samples to a path, ours and OMPL's, with the same edge checks."""
    for method, name, places in (
        ("rrt", "RRT", (scenes.discs(), scenes.gap(0.1))),
        ("rrt_connect", "RRT-Connect", (scenes.discs(), scenes.gap(0.1), scenes.arm())),
    ):
        panel = Panel(
            f"{name}: as many samples", "samples to a path", "share of seeds", scale="log x"
        )
        for scene in places:
            tests = ompl.tests(scene.world)
            # The same seeds, scenes and edge tests on both sides: only the planners differ.
            runs = [
                (ours(scene, k, method), theirs(scene, k, method, *tests))
                for k in range(1, seeds + 1)
            ]
            spent = np.array(
                [[p.samples if p.path is not None else np.inf for p in r] for r in runs]
            )
            panel.series += cumulative(scene.name, (spent[:, 0], spent[:, 1]), 1.2, "samples")
        yield panel
    panel = Panel(
        "RRT*, 1000 samples: as short, if ours too stops drawing the goal",
        "length of the path [m]",
        "share of seeds",
    )
    for scene in (scenes.discs(), scenes.gap(0.1)):
        tests = ompl.tests(scene.world)
        result = [
            theirs(scene, k, "rrt_star", *tests, budget=1000).path for k in range(1, stars + 1)
        ]
        other = np.array([np.inf if path is None else length(path.T) for path in result])
        usual, mine = np.array(
            [
                [ours(scene, k, "rrt_star", 1000, goal_bias=b).cost for k in range(1, stars + 1)]
                for b in (0.05, 0.0)
            ]
        )
        # OMPL draws the goal until it is in the tree; ours goes on, which brings nothing.
        panel.series += cumulative(scene.name, (mine, other), 1.002, "m")
        p = stats.mannwhitneyu(usual, other).pvalue
        panel.notes.append(
            f"RRT* {scene.name}, goal drawn to the end: median {np.median(usual):.4g} m, p {p:.2g}"
        )
    yield panel
    panel = Panel(
        "PRM: start and goal as often joined",
        "states of the roadmap",
        "share of seeds",
        scale="log x",
    )
    for scene in (scenes.discs(), scenes.gap(0.1)):
        tests, joined = ompl.tests(scene.world), np.zeros((2, len(sizes)))
        for k in range(1, maps + 1):
            mine = build_roadmap(scene.world, 4 * max(sizes), k, neighbours=10)
            free = mine.pairs[mine.status == FREE]
            for i, size in enumerate(sizes):
                # A prefix of one roadmap: our samples are drawn in order.
                nodes, pairs = mine.nodes[:size], free[free.max(axis=1) < size]
                joined[0, i] += roadmap_joins(scene, nodes, pairs)
                joined[1, i] += roadmap_joins(
                    scene, *ompl.roadmap(scene.world.bounds, size, k, *tests)
                )
        for owner, hits in zip(("ours", "OMPL"), joined, strict=True):
            low, high = wilson(hits, maps)
            label = f"{scene.name}, {owner}"
            panel.series.append(
                Series(
                    label,
                    sizes,
                    hits / maps,
                    style="-" if owner == "ours" else "--",
                    low=low,
                    high=high,
                    note=f"PRM {label}: joined {', '.join(f'{x:.0f}' for x in hits)} of {maps}",
                )
            )
    yield panel


# --- short ----------------------------------------------------------------------------------------


def exactly_known() -> list[tuple[Scene, float]]:
    """Return scenes with the exact length of the shortest path [m].

    It is two tangents and an arc, or three segments.
    """
    start, goal, radius = scenes.START, scenes.GOAL, 2.0
    far = float(np.linalg.norm(goal - start)) / 2
    # Tangent, arc, tangent around a disc in the middle between start and goal.
    around = 2 * math.sqrt(far**2 - radius**2) + radius * (math.pi - 2 * math.acos(radius / far))
    disc = Scene("one disc", planning.plane(scenes.SQUARE, [[5, 5, radius]]), start, goal, 1.0)
    wall = scenes.gap(0.1)
    corners = np.array([wall.start, [4.75, 4.5], [5.25, 4.5], wall.goal])
    return [(disc, around), (wall, length(corners.T))]


def settings(
    scene: Scene, budgets: Sequence[int]
) -> dict[str, tuple[Sequence[int], Callable[[int, int], tuple[float, Any]]]]:
    """Return for each method its settings, and a function of seed and setting.

    The function returns seconds and a path (n, k).
    """
    tests = ompl.tests(scene.world)

    def cut(k: int, rounds: int) -> tuple[float, Any]:
        # The time of the shortcuts is added to that of the plan.
        result, rng = ours(scene, k), np.random.default_rng(k)
        assert result.path is not None
        begun = time.perf_counter()
        path = planning.shortcut(result.path, scene.world, rng, rounds=rounds)
        return result.seconds + time.perf_counter() - begun, path

    def by(method: str) -> Callable[[int, int], tuple[float, Any]]:
        def run(k: int, budget: int) -> tuple[float, Any]:
            result = ours(scene, k, method, budget)
            return result.seconds, result.path

        return run

    def other(k: int, budget: int) -> tuple[float, Any]:
        result = theirs(scene, k, "rrt_star", *tests, budget=budget)
        return result.seconds, None if result.path is None else result.path.T

    return {
        "RRT*": (budgets, by("rrt_star")),
        "Informed RRT*": (budgets, by("informed_rrt_star")),
        "PRM*": (budgets[:4], by("prm_star")),
        "RRT-Connect, shortcuts": ((0, 10, 30, 100, 300), cut),
        "OMPL RRT*": (budgets[:4], other),
    }


@chart(columns=2)
def path_quality(
    seeds: int = 31,
    budgets: Sequence[int] = (100, 300, 1000, 3000, 10_000),
    tolerance: float = 0.05,
) -> Iterator[Panel]:
    """Chart the ratio of path length to the exact shortest length against time.

    A failure counts as infinite length.
    """
    planning.warm()
    for scene, best in exactly_known():
        panel = Panel(
            scene.name,
            "seconds for a plan",
            "length over the shortest, less 1",
            scale="log",
            lines=[("y", tolerance, f"tolerance {tolerance:.0%}")],
            footer=machine(libraries=("ompl",)) + "; one core",
        )
        good = []
        for name, (values, method) in settings(scene, budgets).items():
            rows = []
            for value in values:
                runs = []
                for k in range(1, seeds + 1):
                    # Seconds times the share of the core that the thread had.
                    (spent, path), share = alone(method, k, value)
                    assert path is None or check_path(scene.world, path, scene.start, scene.goal)
                    runs.append(
                        (spent * share, np.inf if path is None else length(path) / best - 1)
                    )
                seconds, deviation = np.transpose(runs)
                rows.append(
                    (
                        np.median(seconds),
                        *np.quantile(deviation, (0.25, 0.5, 0.75), method="higher"),
                    )
                )
                if rows[-1][2] <= tolerance:
                    good.append((rows[-1][0], rows[-1][2], name, value))
            x, low, middle, high = np.transpose(rows)
            pairs = [f"{1e3 * t:.3g} ms {y:.2g}" for t, y in zip(x, middle, strict=True)]
            panel.series.append(
                Series(
                    name,
                    x,
                    middle,
                    style="--" if "OMPL" in name else "-",
                    hollow="OMPL" in name,
                    low=low,
                    high=np.minimum(high, 1.0),
                    note=f"{scene.name:<9} {name:<22} {', '.join(pairs)}",
                )
            )
        # The fastest of all settings within the tolerance.
        spent, deviation, name, value = min(good)
        panel.series.append(
            Series(
                "",
                [spent],
                [deviation],
                "chosen",
                "",
                hollow=True,
                size=13.0,
                tags=["pick"],
                note=f"pick: {name} at {value}, {1e3 * spent:.3g} ms",
            )
        )
        panel.title = f"{scene.name}: fastest within {tolerance:.0%}:\n{name}"
        yield panel
