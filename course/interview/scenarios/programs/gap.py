"""A square carriage that does not rotate plans a path through a door with a random roadmap."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Room:
    """The planning problem and the parameters of its checks.

    Attributes:
        boxes: obstacles, (n, 4): lower x, lower y, upper x, upper y [m].
        grown: margin by which the map enlarges every box on each side [m].
        half: half the width of the carriage, by which the checks enlarge every box [m].
        first, last: where on an edge its check begins and ends, as fractions of its length.
        start, goal: positions of the carriage's center, (2,) [m].
        samples: number of random points of the roadmap.
        reach: longest edge [m].
        hints: additional points of the roadmap, (k, 2) [m].
    """

    boxes: Array
    grown: float
    half: float
    first: float
    last: float
    start: Array
    goal: Array
    samples: int
    reach: float
    hints: Array


SIZE = np.array([8.0, 4.0])  # m


def walls(room: Room) -> tuple[Array, Array]:
    """Return lower and upper corners, (n, 2), of the regions that the center must not enter."""
    margin = room.grown + room.half
    return room.boxes[:, :2] - margin, room.boxes[:, 2:] + margin


def free(room: Room, points: Array) -> Mask:
    """Return which of the points, (m, 2), are in no enlarged box."""
    low, high = walls(room)
    inside = np.all((points[:, None] > low) & (points[:, None] < high), axis=2)
    return ~np.any(inside, axis=1)


def clear(room: Room, a: Array, b: Array) -> Mask:
    """Return which straight edges from `a` to `b`, (m, 2), cross no enlarged box."""
    low, high = walls(room)
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = ((side - a[:, None]) / (b - a)[:, None] for side in (low, high))
    enter = np.fmin(one, other).max(axis=2)
    leave = np.fmax(one, other).min(axis=2)
    return ~((enter < leave) & (leave > room.first) & (enter < room.last)).any(axis=1)


def roadmap(room: Room, rng: np.random.Generator) -> tuple[Array, NDArray[np.int64]]:
    """Return the points, start and goal first, and the connected pairs of them, (e, 2)."""
    points = np.concatenate((rng.uniform(0.0, SIZE, (room.samples, 2)), room.hints))
    points = np.concatenate(([room.start, room.goal], points[free(room, points)]))
    one, other = np.triu_indices(len(points), 1)
    near = np.hypot(*(points[other] - points[one]).T) < room.reach
    one, other = one[near], other[near]
    joined = clear(room, points[one], points[other])
    return points, np.column_stack((one[joined], other[joined]))


def reached(count: int, pairs: NDArray[np.int64], first: int = 0) -> Mask:
    """Return which of `count` points are connected to the first by any number of pairs."""
    joined = np.eye(count, dtype=np.float32)
    joined[pairs[:, 0], pairs[:, 1]] = joined[pairs[:, 1], pairs[:, 0]] = 1.0
    for _ in range(count.bit_length()):  # each pass doubles the number of pairs
        joined = np.minimum(joined @ joined, 1.0)
    return joined[first] > 0.0


def solved(room: Room, rng: np.random.Generator) -> bool:
    """Return whether the roadmap connects start and goal."""
    points, pairs = roadmap(room, rng)
    return bool(reached(len(points), pairs)[1])
