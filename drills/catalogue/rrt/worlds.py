"""The worlds of the rrt drill: each is there for a mistake that it makes visible."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.geometry import clearances

Array = NDArray[np.float64]

LOW, HIGH = np.array([-4.0, 1.0]), np.array([6.0, 9.0])  # neither at the origin nor square
START, GOAL = np.array([-3.0, 2.0]), np.array([5.0, 8.0])


@dataclass(frozen=True)
class World:
    """A query: where from, where to, among what, with which step and how many targets."""

    label: str
    start: Array
    goal: Array
    discs: Array
    bounds: Array
    step: float
    max_samples: int
    closed: bool = False  # the goal cannot be reached, so that every target is drawn
    level: str = "core"

    def arguments(self) -> tuple[Array, Array, Array, Array, float, int]:
        """Return the call's arguments but for the generator."""
        return self.start, self.goal, self.discs, self.bounds, self.step, self.max_samples


def _world(label: str, discs: Array, step: float, budget: int, **more: Any) -> World:
    return World(label, START, GOAL, discs, np.array([LOW, HIGH]), step, budget, **more)


def _between(p: Array, q: Array, centres: Array) -> Array:
    """Return distances from two points, the smaller one."""
    return np.minimum(*(np.hypot(*(centres - point).T) for point in (p, q)))


def clutter(rng: np.random.Generator, count: int, smallest: float, largest: float) -> Array:
    """Return discs anywhere, but clear of start and goal by 0.3 m."""
    discs = np.column_stack((rng.uniform(LOW, HIGH, (count, 2)), rng.uniform(0.0, 1.0, count)))
    discs[:, 2] = smallest + (largest - smallest) * discs[:, 2]
    return discs[_between(START, GOAL, discs[:, :2]) > discs[:, 2] + 0.3]


def fence(x: float, radius: float) -> Array:
    """Return posts from bottom to top that overlap.

    The wall is 0.2 of a radius thick between two.
    """
    spacing = 2.0 * radius * math.sqrt(1.0 - 0.1**2)
    ys = np.arange(LOW[1], HIGH[1] + spacing, spacing)
    return np.column_stack((np.full_like(ys, x), ys, np.full_like(ys, radius)))


def ring(centre: Array, around: float, radius: float) -> Array:
    """Return overlapping posts on a circle."""
    count = math.ceil(2.0 * math.pi * around / (1.8 * radius))
    angles = np.arange(count) * 2.0 * math.pi / count
    places = centre + around * np.column_stack((np.cos(angles), np.sin(angles)))
    return np.column_stack((places, np.full(count, radius)))


def worlds(rng: np.random.Generator) -> list[World]:
    """Return the queries of one grading.

    So few targets that a loop over a list of nodes is no burden.
    """
    x = float(rng.uniform(0.5, 1.5))
    gate = fence(x, 0.25)
    hole = float(rng.uniform(3.0, 7.0))
    gate = gate[np.abs(gate[:, 1] - hole) > 0.55]
    near = START + np.array([0.3, 0.2])
    corridor = np.array([[0.0, 0.0], [10.0, 1e-9]])
    dip = np.array([[float(rng.uniform(4.0, 6.0)), 1.0 - 1e-7, 1.0]])
    ends = np.array([0.5, 5e-10]), np.array([9.5, 5e-10])
    empty = np.zeros((0, 3))
    result = [
        _world("no disc at all", empty, 0.7, 500, level="simple"),
        _world("thin posts", clutter(rng, 90, 0.1, 0.2), 0.8, 500),
        _world("thick discs", clutter(rng, 22, 0.4, 0.8), 0.5, 500),
        _world("a gate in a fence", gate, 0.5, 500),
        _world("a thin closed fence", fence(x, 0.05), 0.6, 250, closed=True),
        _world("a thick closed fence", fence(x, 0.3), 0.9, 200, closed=True),
        _world("a ring around the goal", ring(GOAL, 0.6, 0.1), 0.9, 400, closed=True),
        World(
            "a corridor into which a disc dips by 1e-7 m",
            *ends,
            dip,
            corridor,
            4.0,
            150,
            closed=True,
            level="edge",
        ),
        World(
            "goal within one step",
            START,
            near,
            clutter(rng, 20, 0.2, 0.4),
            np.array([LOW, HIGH]),
            0.5,
            500,
            level="simple",
        ),
        World(
            "start is goal",
            START,
            START.copy(),
            empty,
            np.array([LOW, HIGH]),
            0.5,
            50,
            level="edge",
        ),
        _world("no target allowed", empty, 0.5, 0, level="edge"),
    ]
    return [world for world in result if _fair(world)]


def _fair(world: World) -> bool:
    """Return whether start and goal are free, by enough that rounding has no say."""
    points = (world.start, world.goal)
    return all(clearances(p, p, world.discs).min(initial=1.0) > 1e-7 / 2.0 for p in points)


def invalid_queries(rng: np.random.Generator) -> list[World]:
    """Return queries that must raise ValueError."""
    some = clutter(rng, 10, 0.3, 0.5)
    angle, depth = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.05, 0.35)
    aside = depth * np.array([math.cos(angle), math.sin(angle)])
    bounds = np.array([LOW, HIGH])
    on_start = np.vstack((some, [*(START + aside), 0.4]))
    on_goal = np.vstack(([*(GOAL + aside), 0.4], some))
    outside = np.array([HIGH[0] + 0.2, 5.0])
    # Out of bounds and nothing else: no disc may lie there.
    apart = some[np.hypot(*(some[:, :2] - outside).T) > some[:, 2] + 0.1]
    return [
        World("start in a disc", START, GOAL, on_start, bounds, 0.5, 200),
        World("goal in a disc", START, GOAL, on_goal, bounds, 0.5, 200),
        World("start out of bounds", outside, GOAL, apart, bounds, 0.5, 200),
        World("goal out of bounds", START, outside, apart, bounds, 0.5, 200),
        World("both in one disc", START, START.copy(), on_start, bounds, 0.5, 200),
    ]


def paths(figure: Any, discs: Any, before: Any, got: Any, right: Any) -> None:
    """Plot the given paths, the results, and the correct results."""
    from matplotlib.patches import Circle

    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    for x, y, radius in np.asarray(discs, dtype=float).reshape(-1, 3):
        axes.add_patch(Circle((x, y), radius, color="0.8"))
    styles = ({"color": "0.6", "lw": 0.8, "label": "given"}, picture.YOURS, picture.RIGHT)
    for path, style in zip((before, got, right), styles, strict=True):
        axes.plot(*np.asarray(path, dtype=float).reshape(-1, 2).T, marker="o", ms=3, **style)
    axes.legend()
