"""A square carriage that does not turn seeks its way through a door: a roadmap among boxes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Room:
    """What is asked, and how it is checked.

    Attributes:
        boxes: (n, 4), lower x, lower y, upper x, upper y of what stands there [m].
        grown: by what the map made every box larger, on each side [m].
        half: half the side of the carriage, by which the checks do the same [m].
        first, last: where on an edge a check begins and ends, as shares of its length.
        start, goal: of the carriage's middle, (2,) [m].
        samples: points of the roadmap, besides start and goal.
        reach: longest edge [m].
        hints: (k, 2), points that it takes besides [m].
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
    """Lower and upper corners, (n, 2), of what the carriage's middle may not enter."""
    margin = room.grown + room.half
    return room.boxes[:, :2] - margin, room.boxes[:, 2:] + margin


def free(room: Room, points: Array) -> Mask:
    """Which points, (m, 2), are in no box."""
    low, high = walls(room)
    inside = np.all((points[:, None] > low) & (points[:, None] < high), axis=2)
    return ~np.any(inside, axis=1)


def clear(room: Room, a: Array, b: Array) -> Mask:
    """Which straight edges from `a` to `b`, (m, 2), pass no box: each is clipped by the boxes."""
    low, high = walls(room)
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = ((side - a[:, None]) / (b - a)[:, None] for side in (low, high))
    enter = np.fmin(one, other).max(axis=2)
    leave = np.fmax(one, other).min(axis=2)
    return ~((enter < leave) & (leave > room.first) & (enter < room.last)).any(axis=1)


def roadmap(room: Room, rng: np.random.Generator) -> tuple[Array, NDArray[np.int64]]:
    """Points, start and goal first, and the pairs of them that are joined, (e, 2)."""
    points = np.concatenate((rng.uniform(0.0, SIZE, (room.samples, 2)), room.hints))
    points = np.concatenate(([room.start, room.goal], points[free(room, points)]))
    one, other = np.triu_indices(len(points), 1)
    near = np.hypot(*(points[other] - points[one]).T) < room.reach
    one, other = one[near], other[near]
    joined = clear(room, points[one], points[other])
    return points, np.column_stack((one[joined], other[joined]))


def reached(count: int, pairs: NDArray[np.int64], first: int = 0) -> Mask:
    """Which of `count` points are joined to the first, by any number of pairs."""
    joined = np.eye(count, dtype=np.float32)
    joined[pairs[:, 0], pairs[:, 1]] = joined[pairs[:, 1], pairs[:, 0]] = 1.0
    for _ in range(count.bit_length()):  # each time, twice as many pairs
        joined = np.minimum(joined @ joined, 1.0)
    return joined[first] > 0.0


def solved(room: Room, rng: np.random.Generator) -> bool:
    """True if the roadmap joins start and goal."""
    points, pairs = roadmap(room, rng)
    return bool(reached(len(points), pairs)[1])
