"""The 5-second question: from a naive RRT at a shelf to some milliseconds, one idea at a time."""

import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course import planning
from course.charts import chart
from course.charts.planning.ompl_comparison import alone
from course.measure.figure import Panel, Series
from course.measure.timing import core_share
from course.measure.work_precision import machine
from course.planning import Budget, Roadmap, Shelf, World, plan
from course.planning.batches import in_batches
from course.planning.capsules import sampled

Query = tuple[NDArray[np.float64], NDArray[np.float64]]
SAMPLES = 20_000
RUNGS = """versions: 5 one tree with long steps, 6 RRT-Connect, 7 the same in batches, 8 bridge
samples, 9 lazy roadmap, 10 stored roadmap, 11 with small trees, 12 with earlier paths;"""
FEW = 4  # versions that get only some of the queries
SHORT = 1.0  # step of the first four rungs [rad]; the others take `plan`'s own, 2.6 rad here
FINE, WIDE = 0.01, 0.05  # spacing of the points in the batches of short and of long steps [rad]
SWELL = 0.02  # of the spheres in the batches; larger ones reject more of the queries' ends
BOTH: dict[str, Any] = {"method": "rrt_connect", "budget": 10 * SAMPLES}
CACHED: dict[str, Any] = {"method": "roadmap", "budget": 10 * SAMPLES}


def certified(requested: Shelf, queries: int, seed: int) -> tuple[list[Query], int]:
    """Return `queries` queries that a long search solves, and how many it failed to solve."""
    rng, result, rejected = np.random.default_rng(seed), list[Query](), 0
    while len(result) < queries:
        start, goal = requested.query(rng)
        if plan(requested.world, start, goal, **BOTH, rng=seed).solved:
            result.append((start, goal))
        else:
            rejected += 1
    return result, rejected


def interpreted(world: World) -> World:
    """Return the same source as plain Python, an edge tried every 0.01 rad."""

    def valid(q: NDArray[np.float64]) -> bool:
        return bool(world.state_free(world.obstacles, world.body, q))

    return planning.from_function(valid, world.bounds, 0.01)


def batched(spacing: float) -> Callable[[World], World]:
    """Return the change of a world to edges in batches of points at a spacing [rad]."""
    return lambda world: in_batches(world, spacing, SWELL)


def rungs(
    roadmap: Roadmap, experience: Roadmap, naive: float, samples: int
) -> dict[str, tuple[int, Any]]:
    """Return for each rung the queries it solves, every how many, and the plan that it makes."""

    def ask(options: dict[str, Any], change: Callable[[World], World] = lambda w: w) -> Any:
        return lambda world, query, seed: plan(change(world), *query, rng=seed, **options)

    def patient(world: World, query: Query, seed: int) -> planning.Plan:
        # A budget is by the clock: longer where other work on the machine has a part of the core.
        share = float(np.mean([core_share() for _ in range(100)]))
        limited: dict[str, Any] = short | {"budget": Budget(samples, naive / share)}
        return plan(interpreted(world), *query, rng=seed, **limited)

    tree = {"method": "rrt", "budget": samples}
    short = tree | {"step": SHORT}
    return {
        "RRT in Python": (20, patient),
        "compiled": (10, ask(short, sampled)),
        "in batches": (10, ask(short, batched(FINE))),
        "edges proved": (10, ask(short)),
        "longer steps": (1, ask(tree)),
        "from both ends": (1, ask(BOTH)),
        "both, in batches": (1, ask(BOTH, batched(WIDE))),
        "bridge sampler": (1, ask(BOTH | {"sampler": "bridge", "mix": 0.2})),
        "lazy PRM": (1, ask({"method": "lazy_prm", "budget": samples})),
        "cached, by a list": (1, ask(CACHED | {"roadmap": roadmap, "attach": "list"})),
        "cached, by trees": (1, ask(CACHED | {"roadmap": roadmap})),
        "earlier paths too": (1, ask(CACHED | {"roadmap": experience})),
    }


@chart(height=4.4)
def shelf_ladder(
    queries: int = 100,
    nodes: int = 3000,
    names: tuple[str, ...] = ("open", "tight"),
    naive: float = 5.0,
    samples: int = SAMPLES,
) -> Iterator[Panel]:
    """Time a plan of the 7-R arm from bay to bay, version by version, with and without a ball.

    Versions 1 to 4 get few queries, so their results are among the key figures and not drawn.
    """
    planning.warm()
    for name in names:
        requested, rng = planning.shelf(name), np.random.default_rng(1)
        known, rejected = certified(requested, queries, 0)
        moved = [requested.disturbed(rng, *query) for query in known]
        begun = time.perf_counter()
        roadmap = planning.build_roadmap(requested.world, nodes, 0)
        built = time.perf_counter() - begun
        solved = [
            plan(requested.world, *q, **BOTH).path for q in certified(requested, queries, 2)[0]
        ]
        paths = [
            planning.shortcut(p, requested.world, rng, rounds=30) for p in solved if p is not None
        ]
        experience = planning.with_paths(roadmap, paths)
        learned = time.perf_counter() - begun
        ladder = rungs(roadmap, experience, naive, samples)
        panel = Panel(
            f"{name} shelf: median and slowest query",
            "version",
            "seconds for a plan",
            scale="log y",
            ticks=tuple(range(FEW + 1, len(ladder) + 1)),
        )
        panel.lines = [("y", 0.1, "required: 100 ms")]
        panel.notes = [
            f"{name} shelf: {rejected} of {queries + rejected} drawn were not certified; roadmap "
            f"{roadmap.memory / 1e6:.1f} MB, built in {built:.1f} s;",
            f"with earlier paths {experience.memory / 1e6:.1f} MB, in {learned:.1f} s",
        ]
        had = list[float]()
        for place in ("still", "moved"):
            rows = []
            answers: dict[str, list[tuple[planning.Plan, float]]] = {rung: [] for rung in ladder}
            collided = dict.fromkeys(ladder, 0)
            for i, query in enumerate(known):
                world = requested.world if place == "still" else moved[i]
                for rung, (every, run) in ladder.items():
                    if i % every == 0:
                        result, share = alone(run, world, query, i)
                        answers[rung].append((result, share * result.seconds))
                        had.append(share)
                        if result.path is not None and (every > 1 or i % 10 == 0):
                            collided[rung] += not planning.check_path(world, result.path, *query)
            for rung, plans in answers.items():
                spent = np.array([own if p.solved else np.inf for p, own in plans])
                middle, tail = np.quantile(spent, (0.5, 1.0), method="higher")
                rows.append((middle, tail))
                panel.notes.append(
                    f"{rung:<17} {place} {name:<5} {np.isfinite(spent).sum():3d} of "
                    f"{len(plans):3d}, ms: median {1e3 * middle:7.2f}, slowest {1e3 * tail:7.1f}; "
                    f"{np.median([p.edge_checks for p, _ in plans]):5.0f} edges; "
                    f"{collided[rung]} collide"
                )
            x = np.arange(FEW + 1, len(ladder) + 1)
            middle, tail = np.array(rows[FEW:]).T
            panel.series += [
                Series(f"median, {place}", x, middle),
                Series(f"slowest, {place}", x, tail, style="--"),
            ]
        panel.notes.append(
            f"{name} shelf: the runs had {np.median(had):.0%} of a core in the median; times are "
            "those of the core"
        )
        panel.footer = f"{RUNGS}\n{machine(libraries=())}; one core, its own time"
        yield panel
