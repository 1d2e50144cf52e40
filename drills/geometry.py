"""The exact judge of planar paths among discs, written apart from every planner.

An edge is free when no point of it lies in a disc. The judge does not try points along the edge: a
shallow cut can lie between two of them, however close they are. Of all lines through a disc of
radius r, points at a spacing h miss a share of about h^2 / (24 r^2) (`missed_by_sampling`), and
a planner that tries points calls those edges free.

Planners and judge round differently. An edge that grazes a disc to within `TOLERANCE` is accepted
by the judge whichever way the planner saw it, so that rounding never decides a verdict.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

TOLERANCE = 1e-9  # [m]; rounding in a world of 10 m is near 1e-15, a slip is far above


@dataclass(frozen=True)
class Fault:
    """What is wrong with a path: its kind, the edge or vertex, and a sentence with the figures.

    Kinds: "shape", "start", "goal", "bounds", "collision", "step".
    """

    kind: str
    index: int
    sentence: str


def clearances(a: ArrayLike, b: ArrayLike, discs: ArrayLike) -> Array:
    """Return gap between a segment and each disc: distance from the centre, less the radius.

    Seen along the segment, a centre is behind its start, beyond its end, or beside it. Beside it,
    the distance is the height of the triangle over the segment, its doubled area by its base; else
    it is that to the end point (Ericson, Real-Time Collision Detection, 2005, sec. 5.1.2).

    Args:
        a: one end, shape (2,) or, of many segments, (m, 2) [m].
        b: the other end, same shape [m]; it may equal a.
        discs: rows (x, y, radius), shape (n, 3) [m].

    Returns:
        Gaps, shape (n,) or (m, n) [m]; negative where the segment enters the disc.
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    x, y, radius = np.asarray(discs, dtype=float).reshape(-1, 3).T
    ax, ay, bx, by = (end[..., k, None] for end in (a, b) for k in (0, 1))
    dx, dy = bx - ax, by - ay
    length = np.hypot(dx, dy)
    from_a, from_b = np.hypot(x - ax, y - ay), np.hypot(x - bx, y - by)
    behind = (x - ax) * dx + (y - ay) * dy <= 0.0
    beyond = (x - bx) * dx + (y - by) * dy >= 0.0
    height = np.abs((x - ax) * dy - (y - ay) * dx) / np.where(length, length, 1.0)
    return np.where(behind, from_a, np.where(beyond, from_b, height)) - radius


def path_faults(
    path: ArrayLike,
    start: ArrayLike,
    goal: ArrayLike,
    discs: ArrayLike,
    bounds: ArrayLike,
    step: float,
) -> list[Fault]:
    """Return everything that is wrong with a path, in the order of travel; empty if it is right.

    It must begin at the start and end at the goal exactly (these are copied, not computed), stay
    within the bounds, touch no disc, and have no edge longer than `step`, the last two to within
    `TOLERANCE`.

    Args:
        path: vertices, shape (k, 2) [m], k at least 1.
        start: where it must begin, shape (2,) [m].
        goal: where it must end, shape (2,) [m].
        discs: obstacles, rows (x, y, radius), shape (n, 3) [m].
        bounds: the world, rows (xmin, ymin) and (xmax, ymax), shape (2, 2) [m].
        step: the longest edge allowed [m].

    Returns:
        The faults.
    """
    path, start, goal = (np.asarray(p, dtype=float) for p in (path, start, goal))
    if path.ndim != 2 or path.shape[1] != 2 or not len(path) or not np.isfinite(path).all():
        text = f"the path must be finite, of shape (k, 2) with k at least 1, got {path.shape}"
        return [Fault("shape", 0, text)]
    faults = []
    if not np.array_equal(path[0], start):
        text = f"the path begins at {_point(path[0])}, not at the start {_point(start)}"
        faults.append(Fault("start", 0, text))
    if not np.array_equal(path[-1], goal):
        deviation = math.dist(path[-1], goal)
        text = (
            f"the path ends at {_point(path[-1])}, {deviation:.3g} m from the goal {_point(goal)}"
        )
        faults.append(Fault("goal", len(path) - 1, text))
    faults += bounds_faults(path, bounds)
    for i in range(max(len(path) - 1, 1)):  # a path of one vertex is an edge without length
        faults += edge_faults(path[i], path[min(i + 1, len(path) - 1)], discs, step, i)
    return faults


def bounds_faults(points: ArrayLike, bounds: ArrayLike) -> list[Fault]:
    """Return the points, shape (k, 2), that lie outside the bounds by more than `TOLERANCE`."""
    points = np.asarray(points, dtype=float).reshape(-1, 2)
    low, high = np.asarray(bounds, dtype=float)
    outside = ((points < low - TOLERANCE) | (points > high + TOLERANCE)).any(axis=1)
    return [
        Fault("bounds", int(i), f"vertex {i}, {_point(points[i])}, lies outside the bounds")
        for i in np.flatnonzero(outside)
    ]


def edge_faults(
    a: ArrayLike, b: ArrayLike, discs: ArrayLike, step: float, index: int = 0
) -> list[Fault]:
    """Return what is wrong with the edge from a to b.

    The deepest disc it enters, and its length.
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    faults = []
    gaps = clearances(a, b, discs)
    if len(gaps) and gaps.min() < -TOLERANCE:
        deepest = int(np.argmin(gaps))
        text = (
            f"edge {index}, from {_point(a)} to {_point(b)}, "
            f"enters disc {deepest} by {-gaps[deepest]:.3g} m"
        )
        faults.append(Fault("collision", index, text))
    length = math.dist(a, b)
    if length > step + TOLERANCE:
        text = f"edge {index}, from {_point(a)} to {_point(b)}, is {length:.6g} m, over {step:g} m"
        faults.append(Fault("step", index, text))
    return faults


def missed_by_sampling(spacing: float, radius: float) -> float:
    """Return the share of the lines crossing a disc that points at a spacing along them all miss.

    A line at distance y from the centre leaves a chord c = 2 sqrt(radius^2 - y^2) in the disc;
    points at a spacing h with a random offset miss it with probability 1 - c/h if c < h. The mean
    over y, uniform up to the radius, is (with sin(alpha) = h / (2 radius))

        1 - cos(alpha) - (alpha - sin(alpha) cos(alpha)) / (2 sin(alpha)),

    about h^2 / (24 radius^2) for a small spacing: finer sampling makes a miss rare, never
    impossible.

    Args:
        spacing: distance between neighbouring points [m], positive, at most twice the radius.
        radius: of the disc [m].

    Returns:
        The share, between 0 and 1.

    Raises:
        ValueError: if the spacing is not within (0, 2 radius].
    """
    if not 0.0 < spacing <= 2.0 * radius:
        raise ValueError(f"spacing must be within (0, 2 radius], got {spacing} at radius {radius}")
    sine = spacing / (2.0 * radius)
    alpha, cosine = math.asin(sine), math.sqrt(1.0 - sine**2)
    return 1.0 - cosine - (alpha - sine * cosine) / (2.0 * sine)


def _point(p: Array) -> str:
    return f"({p[0]:.6g}, {p[1]:.6g})"
