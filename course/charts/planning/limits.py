"""Where planning fails: narrow passages, thin obstacles, limits between points, local minima."""

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from course.charts import chart
from course.compiled import compiled
from course.measure.figure import Panel, Series
from course.oracles import ompl
from course.planning import (
    World,
    check,
    check_path,
    covariant_gradient,
    edge_free,
    from_function,
    length,
    plan,
    plane,
    scenes,
    sequential_convex,
    time_parameterise,
    trajectory,
)
from course.planning.worlds import EDGE

Array = NDArray[np.float64]

# --- a passage through a wall ---------------------------------------------------------------------


@register_jitable
def _through(obstacles, a, b):
    """Return whether an edge keeps out of a wall |x0| <= depth but for a hole.

    Half its width, bounded in so many directions. The hole is convex: both ends of what is in the
    wall speak for all of it.
    """
    half, depth, low, high = obstacles[0, 0], obstacles[0, 1], 0.0, 1.0
    run = b[0] - a[0]
    if run == 0.0:
        if abs(a[0]) > depth:
            return True
    else:
        # Clip the edge to the interval of t in which it is inside the wall.
        low = max(low, -a[0] / run - depth / abs(run))
        high = min(high, -a[0] / run + depth / abs(run))
    for k in range(1, int(obstacles[0, 2]) + 1):
        x, y = a[k] + low * (b[k] - a[k]), a[k] + high * (b[k] - a[k])
        if low <= high and max(abs(x), abs(y)) >= half:
            return False
    return True


def _hole_state(obstacles, body, q):
    return _through(obstacles, q, q)


def _hole_edge(obstacles, body, a, b):
    return _through(obstacles, a, b)


def _judge(world: World, a: Array, b: Array) -> Array | None:
    """Return a state of the edge in the wall, or None, by an interval of t for each side."""
    half, depth, bounded = world.obstacles[0]
    for k in range(1, int(bounded) + 1):
        for side in (-1.0, 1.0):
            ends = [(a[0] - depth, b[0] - a[0]), (-a[0] - depth, a[0] - b[0])]
            ends.append((half - side * a[k], side * (a[k] - b[k])))
            # Intersection of half-spaces along the edge, independent of the planner's own test.
            low = max([0.0, *(-c / d for c, d in ends if d < 0.0)])
            high = min([1.0, *(-c / d for c, d in ends if d > 0.0)])
            if low < high - 1e-9 and all(d or c < 0.0 for c, d in ends):
                return a + 0.5 * (low + high) * (b - a)
    return None


check.JUDGES["hole"] = _judge


def hole(n: int, width: float, depth: float, bounded: int) -> World:
    """Return a unit cube of n dimensions, cut by a wall with a hole in its middle."""
    return World(
        "hole",
        np.array([[-0.5] * n, [0.5] * n]),
        np.array([[width / 2, depth / 2, bounded]]),
        np.zeros((1, 1)),
        _hole_state,
        _hole_edge,
        _hole_state,
    )


def pair_joined(width: float, bounded: float) -> float:
    """Return the probability that a uniform pair on both sides of a thin wall is mutually visible.

    The crossing is at (1 - t) y + t y', where min(t, 1 - t) / max(t, 1 - t) is uniform on (0, 1):
    a trapezoidal density in each direction.
    """
    # Midpoint rule over the ratio of the two distances from the wall.
    r = (np.arange(20_000) + 0.5) / 20_000
    largest, least = 1.0 / (1.0 + r), r / (1.0 + r)
    flat = width / 2 <= (largest - least) / 2
    each = np.where(flat, width / largest, 1.0 - (0.5 - width / 2) ** 2 / (largest * least))
    return float(np.mean(each**bounded))


@chart(columns=2)
def narrow_passages(
    dims: Sequence[int] = (2, 3, 4, 5, 6, 7),
    pairs: int = 100_000,
    seeds: int = 100,
    budget: int = 20_000,
    width: float = 0.1,
) -> Iterator[Panel]:
    """Chart a passage of a tenth, by dimension: what one pair sees, and what RRT-Connect needs.

    A slab is bounded in one direction, a hole in all, a tunnel is a hole as long as it is wide. The
    medians come with their quartiles, as the spread over seeds is wider than most differences.
    """
    rng = np.random.default_rng(0)
    one = Panel(
        "A uniform pair sees through a slab in any dimension, through a hole in few",
        "dimension",
        "probability that a pair is joined",
        scale="log y",
    )
    need = Panel(
        f"RRT-Connect; triangle: over {budget} samples",
        "dimension",
        "samples to a path",
        scale="log y",
    )
    kinds: list[tuple[str, Callable[[Any], Any], float]] = [
        ("slab", lambda n: 1, 1e-6),
        ("hole", lambda n: n - 1, 1e-6),
        ("tunnel", lambda n: n - 1, width),
    ]
    for name, bounds, deep in kinds:
        observed, result = [], {"": list[Array](), ", OMPL": list[Array]()}
        for n in dims:
            world = hole(n, width, deep, bounds(n))
            free = compiled(world.edge_free, EDGE)
            ends = rng.uniform(-0.5, 0.5, (2, pairs, n))
            # One end on each side of the wall.
            ends[:, :, 0] = rng.uniform(deep / 2, 0.5, (2, pairs)) * [[-1], [1]]
            joined = [free(world.obstacles, world.body, a, b) for a, b in zip(*ends, strict=True)]
            observed.append(np.mean(joined) or np.nan)
            start, goal = np.full(n, -0.3), np.full(n, -0.3)
            goal[0], tests = 0.3, ompl.tests(world)
            for method, rows in result.items():
                # Once the median exceeds the budget, higher dimensions are not tried.
                if rows and math.isinf(rows[-1][1]):
                    continue  # no more is known above
                spent = []
                for seed in range(1, seeds + 1):
                    question = (world, start, goal, 0.5, budget, seed)
                    spent.append(_samples(method == "", *question, tests))
                rows.append(np.quantile(spent, (0.25, 0.5, 0.75), method="higher"))
        law = [pair_joined(width, bounds(n)) for n in dims]
        # In standard errors of a binomial share.
        deviation = (np.array(observed) - law) / np.sqrt(np.array(law) / pairs)
        theory = None if name == "tunnel" else lambda n, b=bounds: pair_joined(width, b(n))
        message = (
            ""
            if name == "tunnel"
            else f"; off by {np.abs(deviation).max():.1f} standard errors at most"
        )
        one.series.append(
            Series(
                name,
                dims,
                observed,
                theory=theory,
                style="" if theory else ":",
                note=f"{name}: a pair {', '.join(f'{p:.2g}' for p in observed)}{message}",
            )
        )
        for method, rows in result.items():
            low, middle, high = np.transpose(rows)
            need.series.append(
                Series(
                    name + method,
                    dims[: len(rows)],
                    middle,
                    style="--" if method else "-",
                    hollow=bool(method),
                    low=np.minimum(low, budget),
                    high=np.minimum(high, budget),
                    note=f"{name + method:<10} samples, median (quartiles) of {seeds} seeds: "
                    + ", ".join(f"{m:.0f} ({a:.0f} to {b:.0f})" for a, m, b in rows),
                )
            )
    # The planner's own curves first: so an opening has one colour in both panels.
    need.series.sort(key=lambda series: series.hollow)
    yield from (one, need)


def _samples(
    mine: bool,
    world: World,
    start: Array,
    goal: Array,
    step: float,
    budget: int,
    seed: int,
    tests: tuple[Any, ...],
) -> float:
    """Return samples to a path that the judge passes."""
    if mine:
        result: Any = plan(world, start, goal, budget=budget, rng=seed, step=step)
    else:
        question = (world.bounds, start, goal, "rrt_connect", step, budget, seed, *tests)
        result = ompl.solve(*question)
    if result.path is None:
        return math.inf
    path = result.path if mine else result.path.T
    # The independent judge: a path that collides would make the count worthless.
    assert check_path(world, path, start, goal)
    return float(result.samples)


# --- points along an edge -------------------------------------------------------------------------


def disc_missed(x: float) -> float:
    """Return the share of edges across a disc of diameter x spacings that points miss."""
    r = 0.5 * x
    y = math.sqrt(max(r * r - 0.25, 0.0)) / r  # nearer to the middle no chord is missed
    return 1.0 - y - r * (math.pi / 2 - y * math.sqrt(1 - y * y) - math.asin(y))


@chart
def thin_obstacles(
    sizes: Sequence[float] = tuple(np.linspace(0.2, 1.6, 8)), edges: int = 3000
) -> Iterator[Panel]:
    """Chart edges through a wall or a disc that points along them miss, against its size."""
    rng = np.random.default_rng(0)
    panel = Panel(
        "Points miss what they step over; an exact test misses nothing",
        "thickness or diameter / spacing of the points",
        "share of colliding edges accepted",
        theory="closed form",
    )
    laws: dict[str, Callable[[float], float]] = {
        "wall": lambda x: max(0.0, 1.0 - x),
        "disc": disc_missed,
    }
    bounds, exact = np.array([[0.0, 0.0], [12.0, 12.0]]), []
    for shape, law in laws.items():
        missed: dict[str, list[float]] = {"points": [], "OMPL": []}
        for size in sizes:
            wall = [[6 - size / 2, 0, 6 + size / 2, 12]]
            world = (
                plane(bounds, boxes=wall) if shape == "wall" else plane(bounds, [[6, 6, size / 2]])
            )
            state, _ = ompl.tests(world)
            # Points along the edge at a spacing of 1, by the same state test as OMPL's.
            points = from_function(state, bounds, 1.0)
            # OMPL's spacing is a share of the diagonal; a hair less than 10 spacings are 10.
            tests: tuple[Callable[[Any, Any], bool], ...] = (
                functools.partial(edge_free, points),
                ompl.points_along(bounds, state, 1.0 / points.extent),
            )
            a = np.column_stack((rng.uniform(0.5, 1.5, edges), np.full(edges, 6.0)))
            a[:, 1] += 0.5 * size * rng.uniform(-1, 1, edges)
            b = a + [10 - 1e-9, 0]
            for name, test in zip(missed, tests, strict=True):
                hits = [test(*pair) for pair in zip(a, b, strict=True)]
                missed[name].append(float(np.mean(hits)))
            exact += [edge_free(world, *pair) for pair in zip(a, b, strict=True)]
        for name, shares in missed.items():
            deviation = np.abs(np.array(shares) - [law(x) for x in sizes]).max()
            # Binomial standard error; the bars are two of them.
            error = np.sqrt(np.array(shares) * (1 - np.array(shares)) / edges)
            panel.series.append(
                Series(
                    f"{shape}, {name}",
                    sizes,
                    shares,
                    style="",
                    hollow=name == "OMPL",
                    theory=law if name == "points" else None,
                    low=np.array(shares) - 2 * error,
                    high=np.array(shares) + 2 * error,
                    note=f"{shape}, {name}: within {deviation:.3f} of the closed form",
                )
            )
    panel.series.append(
        Series(
            "both, our exact test",
            sizes,
            [np.mean(exact)] * len(sizes),
            "course",
            note=f"our exact test passes {sum(exact)} of {len(exact)}",
        )
    )
    yield panel


# --- limits between points ------------------------------------------------------------------------


def kept_at_points(h: Array, first: Array, second: Array, cap: Array, limit: Array) -> Array:
    """Return squared speeds (m + 1,) of the fastest motion within the limits at the grid points."""
    x = cap.copy()

    def pushes(i: int, here: Array) -> tuple[Array, Array]:
        shift = -second[i, :, None] * here / first[i, :, None]
        reach = (limit / np.abs(first[i]))[:, None]
        return (shift - reach).max(axis=0), (shift + reach).min(axis=0)

    for i in reversed(range(len(h))):
        low, high = 0.0, cap[i]
        for _ in range(5):  # the largest squared speed from which the next can be reached
            here = np.linspace(low, high, 65)
            least, largest = pushes(i, here)
            # Backward pass of TOPP: from which squared speeds can the next one be reached?
            good = np.maximum(least, -here / h[i] / 2) <= np.minimum(
                largest, (x[i + 1] - here) / h[i] / 2
            )
            k = int(np.flatnonzero(good).max(initial=0))
            low, high = here[k], here[min(k + 1, 64)]
        x[i] = low
    x[0] = 0.0
    for i in range(len(h)):
        # Forward pass with the largest acceleration.
        x[i + 1] = min(x[i + 1], x[i] + 2 * h[i] * float(pushes(i, x[i : i + 1])[1][0]))
    return x


def both_ways(path: Array, limits: Array, blend: float, grid: int) -> Array:
    """Return how far the acceleration is over its limit, and the duration, rows.

    By points, both ends.
    """
    h, _, first, second, _ = trajectory._curve(path.T, blend, None, grid)
    count = np.where(second.any(axis=1), 1, grid)  # a line in as many pieces as a rounding
    h, first, second = (np.repeat(v, count, axis=0) for v in (h / count, first, second))
    rate = np.maximum(np.abs(first), np.abs(first + h[:, None] * second))
    top = np.min(limits[0] / rate, axis=1) ** 2
    cap = np.minimum(np.append(top, np.inf), np.append(np.inf, top))
    cap[[0, -1]] = 0.0
    x = np.empty(len(cap))
    trajectory._kernel()(h, first, second, cap, limits[1], x)
    rows = []
    for square in (kept_at_points(h, first, second, cap, limits[1]), x):
        push = 0.5 * np.diff(square) / h
        inner = np.linspace(0, 1, 9)[:, None, None] * h[:, None]
        bend = second * square[:-1, None]
        over = np.abs(first * push[:, None] + bend + 3 * second * push[:, None] * inner)
        w = np.sqrt(np.maximum(square, 0.0))
        rows.append((max((over / limits[1]).max() - 1, 1e-16), np.sum(2 * h / (w[1:] + w[:-1]))))
    return np.array(rows)


@chart(columns=2)
def limits_between(grids: Sequence[int] = (8, 16, 32, 64, 128), paths: int = 15) -> Iterator[Panel]:
    """Chart acceleration between grid points, and duration, of a 7-joint motion past corners."""
    rng = np.random.default_rng(0)
    limits = np.array([[2.2] * 4 + [2.6] * 3, [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]])
    some = [rng.uniform(-1.5, 1.5, (7, 5)) for _ in range(paths)]
    over = np.array([[both_ways(path, limits, 0.3, grid) for path in some] for grid in grids])
    excess_panel = Panel(
        "Acceleration above its limit between grid points",
        "grid intervals of a rounded corner",
        "acceleration above limit, share",
        scale="log",
    )
    for k, name in enumerate(("tested at the first point", "tested at both ends")):
        low, middle, high = np.quantile(over[:, :, k, 0], (0, 0.5, 1), axis=1)
        excess_panel.series.append(
            Series(
                name,
                grids,
                middle,
                low=low,
                high=high,
                note=f"{name}: over by "
                + ", ".join(f"{100 * x:.3g} %" for x in middle)
                + f" (up to {100 * high.max():.3g} %)",
            )
        )
    slower = np.median(over[:, :, 1, 1] / over[:, :, 0, 1], axis=1) - 1
    excess_panel.notes = ["both ends cost time: " + ", ".join(f"{100 * x:.2g} %" for x in slower)]
    yield excess_panel
    right = Panel(
        "Rounded corners against a stop at each",
        "rounding begins before a corner [rad]",
        "duration over that of stops",
    )
    blends = np.linspace(0.0, 1.0, 11)
    times = np.array(
        [
            [time_parameterise(p, (limits[0], limits[1]), blend=b).duration for p in some]
            for b in blends
        ]
    )
    legs = [
        trajectory.trapezoid(np.diff(p), *limits[:, :, None])[0].max(axis=0).sum() for p in some
    ]
    for name, rows in (("time-optimal, rounded", times), ("each joint a trapezoid", [legs] * 11)):
        low, middle, high = np.quantile(np.array(rows) / times[0], (0.1, 0.5, 0.9), axis=1)
        right.series.append(
            Series(
                name,
                blends,
                middle,
                low=low,
                high=high,
                note=f"{name}: {middle[0]:.3f} to {middle[-1]:.3f} of the stops",
            )
        )
    yield right


# --- local minima ---------------------------------------------------------------------------------


@chart(columns=2)
def optimiser_minima(side: int = 13, points: int = 24, count: int = 16) -> Iterator[Panel]:
    """Chart two optimisers from paths bent over a via point: where each ends, by that point."""
    scene = scenes.discs(count=count)
    world, start, goal = scene.world, scene.start, scene.goal
    balls = world.obstacles[:, 1:4].T[:, :, None]

    def gaps(q: Array) -> Array:
        return np.asarray(np.min(np.hypot(*(q[:, None] - balls[:2])) - balls[2], axis=0))

    vias = [np.array([x, y]) for x in np.linspace(1, 9, side) for y in np.linspace(1, 9, side)]
    methods: dict[str, Callable[..., Any]] = {
        "CHOMP": lambda p, weight=20.0: covariant_gradient(
            p, gaps, margin=0.2, weight=weight, points=points
        ),
        "TrajOpt": lambda p: sequential_convex(p, gaps, margin=0.2, points=points),
    }
    turn = np.linspace(0, 2 * math.pi, 120)
    solved = [plan(world, start, goal, rng=k, step=1.0).solved for k in range(len(vias))]
    for name, method in methods.items():
        bent = [np.array([start, via, goal]).T for via in vias]
        ends = [method(path).path for path in bent]
        free = np.array([bool(check_path(world, path, start, goal)) for path in ends])
        costs = np.where(free, [length(path) for path in ends], np.inf)
        best = costs <= 1.05 * costs.min()
        panel = Panel(
            f"our {name}: {np.mean(~free):.0%} of the results collide",
            "via point x [m]",
            "via point y [m]",
            equal=True,
        )
        for label, which in (
            ("free, shortest", best),
            ("collides", ~free),
            ("free, longer", free & ~best),
        ):
            x, y = np.array(vias)[which].T
            panel.series.append(
                Series(
                    label,
                    x,
                    y,
                    style="",
                    size=4.0,
                    note=f"{name:<8} {label:<15} {which.sum():4d} of {len(vias)}",
                )
            )
        x, y = (balls[:2] + balls[2] * [[np.cos(turn)], [np.sin(turn)]]).reshape(2, -1)
        panel.series.append(Series("", x, y, "theory", "", marker="o", size=1.0))
        panel.notes = [f"RRT-Connect finds a path with {sum(solved)} of {len(solved)} seeds"]
        if name == "CHOMP":
            stuck = sum(not check_path(world, method(path, weight=100.0).path) for path in bent)
            panel.notes.append(f"CHOMP with five times the weight: {stuck} collide")
        yield panel
