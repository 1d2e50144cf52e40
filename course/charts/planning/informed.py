"""Short paths of today: batches of samples in order of their promise, and convex regions."""

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from course import planning
from course.charts import chart
from course.charts.planning.ompl_comparison import exactly_known, ours, theirs
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine
from course.oracles import convex_sets, ompl
from course.oracles.convex_sets import Region
from course.planning import Scene, check_path, edge_free, length

Array = NDArray[np.float64]
OVERLAP = 0.02  # of neighbouring sectors; regions that only touch are joined by chance [rad]
MARGIN = 1e-5  # of the regions from the obstacles, for the tolerance of the solver [m]


def sectors(number: int, radius: float = 2.0 + MARGIN) -> list[Region]:
    """Return convex regions around the disc in the middle of the square, and inside the square.

    Each is a sector of the plane, cut off by a tangent of the disc. Together they leave out only
    the corners between the disc and the polygon of these tangents.
    """
    middle, result = np.array([5.0, 5.0]), []
    walls = np.vstack((np.eye(2), -np.eye(2)))
    ends = np.array([10.0, 10.0, 0.0, 0.0])
    half = math.pi / number + OVERLAP
    for k in range(number):
        angle = 2.0 * math.pi * (k + 0.5) / number
        out = np.array([math.cos(angle), math.sin(angle)])
        low = np.array([math.sin(angle - half), -math.cos(angle - half)])
        high = np.array([-math.sin(angle + half), math.cos(angle + half)])
        A = np.vstack((walls, -out, low, high))
        b = np.concatenate((ends, [-(out @ middle) - radius, low @ middle, high @ middle]))
        result.append((A, b))
    return result


def rooms() -> list[Region]:
    """Return the two rooms and the gap of `scenes.gap(0.1)`, as three rectangles."""
    rows = np.vstack((np.eye(2), -np.eye(2)))
    corners = ((4.75, 10.0, 0.0, 0.0), (5.25, 5.5, -4.75, -4.5), (10.0, 10.0, -5.25, 0.0))
    return [(rows, np.array(each)) for each in corners]


def counted(scene: Scene, method: str) -> Callable[[int, int], tuple[float, Array | None]]:
    """Return a function of seed and budget that returns the edge checks and the path."""
    tests = ompl.tests(scene.world)

    def cut(k: int, rounds: int) -> tuple[float, Array | None]:
        result, more = ours(scene, k), 0

        def free(a: Array, b: Array) -> bool:
            nonlocal more
            more += 1
            return edge_free(scene.world, a, b)

        assert result.path is not None
        path = planning.shortcut(result.path, free, np.random.default_rng(k), rounds=rounds)
        return result.edge_checks + more, path

    def own(k: int, budget: int) -> tuple[float, Array | None]:
        result = ours(scene, k, method, budget)
        return result.edge_checks, result.path

    def other(k: int, budget: int) -> tuple[float, Array | None]:
        result = theirs(scene, k, method, *tests, budget=budget)
        return result.checks, None if result.path is None else result.path.T

    return cut if method == "shortcuts" else other if method == "bit_star" else own


@chart(columns=2)
def informed_and_convex(
    seeds: int = 15,
    budgets: Sequence[int] = (100, 300, 1000, 3000),
    numbers: Sequence[int] = (6, 8, 12, 16, 24, 32),
) -> Iterator[Panel]:
    """Chart path length against edge checks, BIT* among the methods, and against convex regions.

    Args:
        seeds: of each sampling planner.
        budgets: samples of RRT* and Informed RRT*, iterations of BIT*.
        numbers: of regions around the disc.
    """
    footer = machine(libraries=("ompl", "drake"))
    methods = {
        "RRT*": ("rrt_star", budgets),
        "Informed RRT*": ("informed_rrt_star", budgets),
        "RRT-Connect, shortcuts": ("shortcuts", (0, 10, 30, 100, 300)),
        "OMPL BIT*": ("bit_star", budgets),
    }
    for scene, best in exactly_known():
        panel = Panel(
            scene.name,
            "edge checks",
            "length over the shortest, less 1",
            scale="log",
            footer=footer,
        )
        for label, (method, values) in methods.items():
            run, rows = counted(scene, method), []
            for value in values:
                runs = []
                for k in range(1, seeds + 1):
                    checks, path = run(k, value)
                    assert path is None or check_path(scene.world, path, scene.start, scene.goal)
                    runs.append((checks, math.inf if path is None else length(path) / best - 1.0))
                checks_, excess = np.transpose(runs)
                quartiles = np.quantile(excess, (0.25, 0.5, 0.75), method="higher")
                rows.append((np.median(checks_), *quartiles))
            x, low, middle, high = np.transpose(rows)
            words = ", ".join(f"{c:.0f}: {e:.2%}" for c, e in zip(x, middle, strict=True))
            style = "--" if "OMPL" in label else "-"
            panel.series.append(
                Series(
                    label,
                    x,
                    middle,
                    style=style,
                    hollow="OMPL" in label,
                    low=low,
                    high=np.minimum(high, 1.0),
                    note=f"{scene.name}, {label}, by checks: {words}",
                )
            )
        yield panel

    (disc, shortest), (wall, narrow) = exactly_known()
    excess, spent = [], []
    for number in numbers:
        answer = convex_sets.solve(disc.start, disc.goal, sectors(number))
        assert answer.path is not None and check_path(
            disc.world, answer.path, disc.start, disc.goal
        )
        excess.append(length(answer.path) / shortest - 1.0)
        spent.append(1e3 * answer.seconds)
    scale = excess[-1] * numbers[-1] ** 2
    panel = Panel(
        "Convex regions around the disc",
        "regions",
        "length over the shortest, less 1",
        scale="log",
        theory="1 / regions²",
        footer=footer,
    )
    words = ", ".join(
        f"{n}: {e:.2%} in {t:.0f} ms" for n, e, t in zip(numbers, excess, spent, strict=True)
    )
    panel.series.append(
        Series(
            "Drake, graph of convex sets",
            numbers,
            excess,
            "Drake",
            theory=lambda n: scale / np.asarray(n, dtype=float) ** 2,
            note=f"one disc, convex sets, by regions: {words}",
        )
    )
    answer = convex_sets.solve(wall.start, wall.goal, rooms())
    assert answer.path is not None
    panel.notes.append(
        f"gap 10%, three convex regions: {length(answer.path) / narrow - 1.0:.1e} above the "
        f"shortest, in {1e3 * answer.seconds:.0f} ms"
    )
    yield panel
