"""Ready-made questions: a world, a start, a goal and a step, as charts, tests and exercises ask."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from course.check import finite, positive
from course.planning.worlds import World, planar_arm, plane, state_free

Array = NDArray[np.float64]

SQUARE = np.array([[0.0, 0.0], [10.0, 10.0]])  # m
START, GOAL = np.array([1.0, 1.0]), np.array([9.0, 9.0])
GAPS = (0.5, 0.1, 0.02)  # openings of the wall, as shares of its length


@dataclass(frozen=True, eq=False)
class Scene:
    """A question: the world, the start and the goal, shape (n,), and the longest edge."""

    name: str
    world: World
    start: Array
    goal: Array
    step: float


def empty() -> Scene:
    """Return nothing in the way."""
    return Scene("empty", plane(SQUARE), START, GOAL, 1.0)


def gap(share: float, thickness: float = 0.5) -> Scene:
    """Return a wall across the square with an opening in its middle.

    Args:
        share: of the wall that is open, above 0, below 1.
        thickness: of the wall [m].
    """
    half = 5.0 * finite("share", share, 1e-6, 1.0 - 1e-6)
    thick = 0.5 * positive("thickness", thickness, unit="m")
    wall = [[5 - thick, 0, 5 + thick, 5 - half], [5 - thick, 5 + half, 5 + thick, 10]]
    start, goal = np.array([1.0, 2.0]), np.array([9.0, 2.0])  # no straight line through the gap
    return Scene(f"gap {share:.0%}", plane(SQUARE, boxes=wall), start, goal, 1.0)


def bug_trap() -> Scene:
    """Return the start in a cage whose only way out is a funnel that leads back inside."""
    lower = np.array([2, 2, 7, 2, 7, 4.6, 4.5, 4.6, 4.5, 4.4, 6.8, 4.4, 6.8, 2.2, 2.2, 2.2])
    half = lower.reshape(-1, 2)
    ring = np.vstack((half, (half * [1, -1] + [0, 10])[::-1]))
    world = plane(SQUARE, polygons=[ring])
    return Scene("bug trap", world, np.array([3.0, 3.2]), np.array([9.0, 5.0]), 1.0)


def discs(seed: int = 0, count: int = 40) -> Scene:
    """Return discs of 0.3 to 0.9 m wherever they fall, but not on the start or the goal."""
    rng = np.random.default_rng(seed)
    rows = np.column_stack((rng.uniform(0, 10, (count, 2)), rng.uniform(0.3, 0.9, count)))
    distance = np.minimum(*(np.linalg.norm(rows[:, :2] - p, axis=1) for p in (START, GOAL)))
    return Scene("discs", plane(SQUARE, rows[distance > rows[:, 2] + 0.1]), START, GOAL, 1.0)


def arm() -> Scene:
    """Return four links of 1 m that reach from one side of a post to the other, past a box."""
    world = planar_arm(
        np.ones(4), 0.05, discs=[[2.2, 0.0, 0.4], [-1.5, 1.8, 0.5]], boxes=[[0.3, 2.2, 1.6, 3.0]]
    )
    start, goal = np.array([-1.0, 0.3, 0.3, 0.3]), np.array([0.9, 0.2, -0.9, -0.8])
    return Scene("4-link arm", world, start, goal, 1.0)


def all_scenes() -> list[Scene]:
    """Return empty, the three gaps, the bug trap, the discs, the arm."""
    return [empty(), *(gap(share) for share in GAPS), bug_trap(), discs(), arm()]


def free_state(world: World, rng: np.random.Generator) -> Array:
    """Return a uniform free state, shape (n,)."""
    while True:
        q = np.asarray(rng.uniform(world.bounds[0], world.bounds[1]))
        if state_free(world, q):
            return q
