"""Worked answers of chapter 0, the role: complete, of the size of an interview."""

import numpy as np
from numpy.typing import ArrayLike


def chain_age(executions: ArrayLike, periods: ArrayLike) -> np.ndarray:
    """Return the least, mean and greatest age of the information behind the command in force.

    Args:
        executions: of each stage, shape (n,) [s].
        periods: of its clock, shape (n,) [s]; 0 where it starts when its input arrives.

    Returns:
        The three, shape (3,) [s].
    """
    C, T = np.asarray(executions, dtype=float), np.asarray(periods, dtype=float)
    least, waits, interval = C.sum(), 0.0, 0.0
    for i in range(len(C)):
        if T[i] > 0.0:
            interval = T[i]
        # A clock reads the result later, or it is the last one and stays in force.
        if i + 1 == len(C) or T[i + 1] > 0.0:
            waits += interval
    return np.array([least, least + waits / 2.0, least + waits])


def over_budget(
    edges: ArrayLike, latencies: ArrayLike, budgets: ArrayLike, start: int, goal: int
) -> tuple[int, float]:
    """Return the first edge on the critical path that takes more than it may.

    Args:
        edges: from box, to box, shape (m, 2); no loops.
        latencies: what each edge takes, shape (m,) [s].
        budgets: what it may take, shape (m,) [s].
        start, goal: boxes at the ends of the path.

    Returns:
        (number of the edge, -1 for none; latency of the whole critical path [s]).
    """
    boxes = np.asarray(edges, dtype=int).tolist()
    taken, allowed = (np.asarray(x, dtype=float).tolist() for x in (latencies, budgets))

    def longest(box: int) -> tuple[float, list[int]]:
        """Return latency and edges of the longest way from a box to the goal."""
        if box == goal:
            return 0.0, []
        best: tuple[float, list[int]] = (-np.inf, [])
        for k, (a, b) in enumerate(boxes):
            if a == box:
                rest, path = longest(b)
                best = max(best, (taken[k] + rest, [k, *path]))
        return best

    total, path = longest(start)
    over = [k for k in path if taken[k] > allowed[k]]
    return (over[0] if over else -1), total


def log_age(captured: ArrayLike, published: ArrayLike, times: ArrayLike) -> np.ndarray:
    """Return how old the newest information is that a reader has.

    Args:
        captured: when each measurement was taken, shape (n,) [s].
        published: when it arrived, shape (n,) [s], in any order.
        times: of reading, shape (m,) [s].

    Returns:
        Ages, shape (m,) [s]; -1 where nothing has arrived.
    """
    captured, published = np.asarray(captured, dtype=float), np.asarray(published, dtype=float)
    times = np.asarray(times, dtype=float)
    ages = np.full(len(times), -1.0)
    for i, now in enumerate(times):
        here = published <= now
        if here.any():
            ages[i] = now - captured[here].max()
    return ages


def blind_distance(
    latencies: ArrayLike, period: float, speed: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Return how far a robot moves between a measurement and the command that uses it.

    Args:
        latencies: of each stage, shape (n,) [s].
        period: of the control loop [s].
        speed: of the robot, shape (m,) [m/s].

    Returns:
        (mean distances, greatest distances), shape (m,) each [m].
    """
    delay = float(np.sum(np.asarray(latencies, dtype=float)))
    v = np.asarray(speed, dtype=float)
    return v * (delay + period / 2.0), v * (delay + period)
