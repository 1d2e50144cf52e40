"""Planners that have learned, beside those that have not: a sampler, and paths out of noise."""

import functools
import itertools
import math
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.success import Success
from course.measure.work_precision import machine
from course.planning import check_path, edge_free, plan, scenes, sequential_convex, shortcut, warm
from course.planning.learned import (
    CELLS,
    denoised,
    drawn,
    grown,
    picture,
    questions,
    slits,
    train_diffusion,
    train_sampler,
)
from course.planning.scenes import Scene

Array = NDArray[np.float64]

DISCS = 24  # of the world that the diffusion knows
STATES = 1000  # proposed for a question
TRIES = 8  # paths proposed for a question


# --- a sampler ------------------------------------------------------------------------------------


def searched(scene: Scene, count: int, rng: np.random.Generator) -> Array:
    """Return states along the path that a grid search of the image finds, (2, count).

    It needs no training.

    A cell is joined to its eight neighbours if both are free; which can't be proved, so this too is
    only a proposal. Without a way the states are uniform.
    """
    free = picture(scene)[0].astype(bool)
    number = np.arange(free.size).reshape(free.shape)
    rows = []
    for i, j, distance in ((0, 1, 1.0), (1, 0, 1.0), (1, 1, math.sqrt(2)), (1, -1, math.sqrt(2))):
        a = number[: CELLS - i, max(0, -j) : CELLS - max(0, j)]
        b = number[i:, max(0, j) : CELLS + min(0, j)]
        # Eight-connected grid of free cells.
        both = free.ravel()[a] & free.ravel()[b]
        rows.append(np.array([a[both], b[both], np.full(both.sum(), distance)]))
    a, b, distance = np.hstack(rows)
    graph = sparse.coo_matrix((distance, (a.astype(int), b.astype(int))), (free.size,) * 2).tocsr()
    low, high = scene.world.bounds
    ends = [(CELLS * (q - low) / (high - low)).astype(int) for q in (scene.start, scene.goal)]
    begin, at = (int(number[tuple(np.minimum(end, CELLS - 1))]) for end in ends)
    *_, before = sparse.csgraph.dijkstra(graph, False, begin, return_predecessors=True)
    path = [at]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    cells = rng.choice(path, count) if path[-1] == begin else rng.integers(free.size, size=count)
    inside = (np.array(divmod(cells, CELLS)) + rng.uniform(size=(2, count))) / CELLS
    return np.asarray(low[:, None] + (high - low)[:, None] * inside)


def checks(scene: Scene, seed: int, **options: Any) -> float:
    """Return states and edges asked until there is a path, infinite without one.

    The judge passes it.
    """
    result = plan(
        scene.world, scene.start, scene.goal, rng=seed, step=1.0, budget=20_000, **options
    )
    if result.path is None:
        return math.inf
    # The judge's verdict, not the planner's.
    assert check_path(scene.world, result.path, scene.start, scene.goal)
    return float(result.state_checks + result.edge_checks)


def sampled(nets: Sequence[Any], some: Sequence[Scene], *only: str) -> list[Success]:
    """Return the checks that each sampler needs in held-out scenes, a seed for each network."""

    def listed(scene: Scene, seed: int, propose: Callable[..., Array], *first: Any) -> float:
        # States are proposed outside of the count; "grid counted" adds the cells.
        states = propose(*first, scene, STATES, np.random.default_rng(seed))
        return checks(scene, seed, sampler=states, mix=0.8)

    bridge: dict[str, Any] = {"sampler": "bridge", "mix": 0.2, "spread": 0.5}
    methods: dict[str, Callable[[Any, Scene, int], float]] = {
        "uniform": lambda net, q, k: checks(q, k),
        "learned": lambda net, q, k: listed(q, k, drawn, net),
        "learned, grid counted": lambda net, q, k: listed(q, k, drawn, net) + CELLS**2,
        "grid search": lambda net, q, k: listed(q, k, searched),
        "bridge test, a fifth": lambda net, q, k: checks(q, k, **bridge),
        "one tree, goal bias": lambda net, q, k: checks(q, k, method="rrt", goal_bias=0.05),
    }
    return [
        Success(
            name,
            np.array(
                [
                    [methods[name](net, q, 1000 * k + i) for i, q in enumerate(some)]
                    for k, net in enumerate(nets)
                ]
            ),
            "checks",
        )
        for name in only or methods
    ]


# --- paths out of noise ---------------------------------------------------------------------------


def bent(scene: Scene, count: int, rng: np.random.Generator) -> list[Array]:
    """Return a straight line, and others bent over random points.

    Proposals that nobody has learned.
    """
    low, high = scene.world.bounds
    vias = rng.uniform(low, high, (count - 1, 2))
    ends = scene.start, scene.goal
    return [np.array(ends).T] + [np.array([ends[0], via, ends[1]]).T for via in vias]


def pushed(scene: Scene, path: Array) -> Array:
    """Return a path pushed out of the discs: the projection."""
    return sequential_convex(path, scene.world, margin=0.1, points=30, iterations=20).path


def first_free(scene: Scene, propose: Callable[[], Any], push: bool) -> tuple[float, bool, bool]:
    """Return seconds to the first path that passes the planner's edge test, infinite without one.

    It also returns whether the first proposal collides as it comes, and after it was pushed.
    """
    world, begun, free = scene.world, time.thread_time(), []
    proposals = propose()
    for proposal in proposals:
        path = pushed(scene, proposal) if push else proposal
        inside = all(world.within(q) for q in path.T)
        free.append(inside and all(edge_free(world, *e) for e in itertools.pairwise(path.T)))
        if free[-1]:
            break
    # Thread time, proposals and checks included.
    spent = time.thread_time() - begun if free[-1] else math.inf
    assert not free[-1] or check_path(world, path, scene.start, scene.goal)
    return spent, not check_path(world, proposals[0]), not free[0]


def proposed(nets: Sequence[Any], some: Sequence[Scene]) -> dict[str, tuple[Success, Array, Array]]:
    """Return for each method seconds to a free path, and how often its first proposals collide.

    Shares are counted before and after proposals are pushed, with a seed for each network.
    """

    def searching(net: Any, scene: Scene, rng: np.random.Generator) -> list[Array]:
        result = plan(scene.world, scene.start, scene.goal, rng=rng, step=1.0)
        return (
            [shortcut(result.path, scene.world, rng, rounds=60)] if result.path is not None else []
        )

    def noise(net: Any, scene: Scene, rng: np.random.Generator) -> Array:
        return denoised(net, scene, TRIES, rng)

    def lines(net: Any, scene: Scene, rng: np.random.Generator) -> list[Array]:
        return bent(scene, TRIES, rng)

    methods: dict[str, tuple[Callable[..., Any], bool]] = {
        "diffusion, checked": (noise, False),
        "diffusion, pushed out": (noise, True),
        "bent lines, pushed out": (lines, True),
        "RRT-Connect, shortcuts": (searching, False),
    }
    result = {}
    for name, (propose, push) in methods.items():
        rows = [
            first_free(
                scene, functools.partial(propose, net, scene, np.random.default_rng((k, i))), push
            )
            for k, net in enumerate(nets)
            for i, scene in enumerate(some)
        ]
        spent, before, after = np.array(rows).reshape(len(nets), len(some), 3).transpose(2, 0, 1)
        result[name] = Success(name, spent, "s"), before.mean(axis=1), after.mean(axis=1)
    return result


# --- all of it ------------------------------------------------------------------------------------


def timed(train: Callable[..., Any], seeds: int, *sizes: Any) -> tuple[list[Any], float]:
    """Return a network of each seed, and the processor time of one [s]."""
    # Training time is stated beside the results, as the other planners need none.
    begun = time.process_time()
    nets = [train(*sizes, seed=seed) for seed in range(seeds)]
    return nets, (time.process_time() - begun) / seeds


@chart(columns=2)
def learned_planners(
    seeds: int = 3,
    worlds: int = 200,
    queries: int = 100,
    sampler: Sequence[int] = (1500, 600),
    diffusion: Sequence[int] = (4000, 8000),
) -> Iterator[Panel]:
    """Chart a learned sampler in held-out worlds, at equal checks; a diffusion over paths, checked.

    Args:
        seeds: networks of each kind; planners get as many.
        worlds: held-out ones of each family.
        queries: held-out ones of the world that the diffusion knows.
        sampler: worlds and training steps of the sampler.
        diffusion: paths and training steps of the diffusion model.
    """
    warm()
    nets, cost = timed(train_sampler, seeds, *sampler)
    rng = np.random.default_rng(9)
    # Held-out worlds, drawn with another generator than the training's.
    some = [slits(rng) for _ in range(worlds)]
    turned = [slits(rng, turned=True) for _ in range(worlds)]

    observed = Panel("One world, and what its sampler proposes", "x [m]", "y [m]", equal=True)
    states = drawn(nets[0], some[0], 400, np.random.default_rng(0))
    ends = np.array([some[0].start, some[0].goal]).T
    walls = 10.0 * (np.argwhere(picture(some[0])[0] == 0.0).T + 0.5) / CELLS
    for label, (x, y), key, size in (
        ("proposed states", states, "course", 2.0),
        ("walls", walls, "theory", 5.5),
        ("", ends, "chosen", 8.0),
    ):
        tags = () if label else ("start", "goal")
        observed.series.append(Series(label, x, y, key, "", marker="s", size=size, tags=tags))
    observed.notes = [f"sampler: {cost:.0f} s of processor time to train, on {sampler[0]} worlds"]
    yield observed

    within = np.geomspace(30, 30_000, 61)
    families = {"Held-out worlds of the family": some, "The same worlds, rotated by 90°": turned}
    for title, family in families.items():
        only = ("uniform", "learned") if family is turned else ()
        panel = Panel(
            title,
            "collision checks of states and edges",
            "share of worlds with a path",
            scale="log x",
        )
        for success in sampled(nets, family, *only):
            series = success.series(within, style="--" if "counted" in success.name else "-")
            middle, least, largest = success.budget()
            series.extra = success.name == "one tree, goal bias"
            series.note = (
                f"{'turned: ' if only else ''}{success.name:<24} median {middle:6.0f} checks "
                f"({least:.0f} to {largest:.0f} by seed), 90 % within {success.budget(0.9)[0]:.0f}"
            )
            panel.series.append(series)
        yield panel

    world = scenes.discs(count=DISCS).world
    nets, cost = timed(train_diffusion, seeds, world, *diffusion)
    requested = questions(grown(world), queries, np.random.default_rng(8))
    requested = [Scene("discs", world, q.start, q.goal, 1.0) for q in requested]
    panel = Panel(
        "Diffusion: paths in the world of its training",
        "seconds to a free path",
        "share of queries",
        scale="log x",
        footer=machine(libraries=("torch",)) + "; one core",
    )
    panel.notes = [f"diffusion: {cost:.0f} s of processor time to train, on {diffusion[0]} paths"]
    within = np.geomspace(1e-4, 3.0, 61)
    for name, (success, before, after) in proposed(nets, requested).items():
        series = success.series(within)
        series.note = (
            f"{name:<23} {np.median(before):4.0%} collide, "
            f"{np.median(after):4.0%} once pushed; solves {success.ever:4.0%}, median "
            f"{1e3 * success.budget()[0]:.3g} ms"
        )
        panel.series.append(series)
    yield panel
