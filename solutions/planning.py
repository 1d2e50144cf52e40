"""Worked answers of chapter 5, planning: complete, of the size of an interview."""

import heapq
import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike


def edge_is_free(a: np.ndarray, b: np.ndarray, discs: np.ndarray) -> bool:
    """Return whether the segment from a to b touches no disc.

    The ends have shape (2,), the discs are rows (x, y, radius) [m].
    """
    along, to_centres = b - a, discs[:, :2] - a
    length_squared = max(float(along @ along), 1e-300)
    share = np.clip(to_centres @ along / length_squared, 0.0, 1.0)
    gaps = to_centres - share[:, None] * along
    return bool(np.all(np.hypot(gaps[:, 0], gaps[:, 1]) > discs[:, 2]))


def edge_check(lengths: ArrayLike, discs: ArrayLike, a: ArrayLike, b: ArrayLike) -> float:
    """Return a lower bound on the free share of a straight motion of a planar arm's joints.

    Conservative advancement (Mirtich, 1996): no point of the arm moves farther than the joints
    can carry it, so that the arm's gap says how far the motion may go on unseen.

    Args:
        lengths: of the links, shape (n,) [m]; the base is the origin.
        discs: obstacles, rows (x, y, radius), shape (m, 3) [m].
        a: joint angles at the start, each from the link before, shape (n,) [rad].
        b: at the end, shape (n,) [rad].

    Returns:
        1 when the whole motion is free, else its share up to a gap of 1e-9 m.
    """
    lengths, a, discs = (np.asarray(value, dtype=float) for value in (lengths, a, discs))
    discs = discs.reshape(-1, 3)
    move = np.asarray(b, dtype=float) - a
    # A joint carries all links from its own on: they reach at most as far as they are long.
    reach = np.cumsum(lengths[::-1])[::-1]
    speed = float(np.abs(move) @ reach)
    share = 0.0
    while True:
        angle = np.cumsum(a + share * move)
        units = np.column_stack((np.cos(angle), np.sin(angle)))
        links = lengths[:, None] * units
        offsets = discs[None, :, :2] - (np.cumsum(links, axis=0) - links)[:, None]
        along = np.einsum("nmk,nk->nm", offsets, units)
        nearest = np.clip(along, 0.0, lengths[:, None])[..., None] * units[:, None]
        away = offsets - nearest
        distance = np.hypot(away[..., 0], away[..., 1])
        gap = float(np.min(distance - discs[:, 2], initial=np.inf))
        if gap <= 1e-9:
            return share
        if gap >= speed * (1.0 - share):
            return 1.0
        share += gap / speed


def certify_edge(
    clearance: Callable[[np.ndarray], float], half: float, a: ArrayLike, b: ArrayLike
) -> float:
    """Return whether a capsule moves along a straight edge without a collision.

    Adaptive dynamic collision checking (Schwarzer, Saha and Latombe, 2005) with intervals of any
    length: a clearance certifies both sides of its pose, and the next evaluation is in the middle
    of the longest interval of shares that is not certified yet.

    Args:
        clearance: distance from the capsule to the nearest obstacle [m] at a pose (x, y, turn).
        half: half the length of the capsule's centre line [m].
        a, b: poses at both ends of the edge, (3,) [m, m, rad].

    Returns:
        1 if the whole edge is free, else 0.
    """
    a = np.asarray(a, dtype=float)
    move = np.asarray(b, dtype=float) - a
    # No point of the capsule moves farther than this over the whole edge.
    speed = math.hypot(move[0], move[1]) + half * abs(move[2])
    intervals = [(-1.0, 0.0, 1.0)]  # the longest first: minus its length, its ends
    while intervals:
        _, low, high = heapq.heappop(intervals)
        middle = 0.5 * (low + high)
        gap = float(clearance(a + middle * move))
        if gap <= 0.0:
            return 0.0
        reach = gap / speed if speed > 0.0 else 1.0
        left, right = middle - reach, middle + reach
        if left > low:
            heapq.heappush(intervals, (low - left, low, left))
        if right < high:
            heapq.heappush(intervals, (right - high, right, high))
    return 1.0


def rrt_connect(
    start: ArrayLike, goal: ArrayLike, discs: ArrayLike, samples: ArrayLike, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return a path from two trees (Kuffner and LaValle, 2000), whose samples are given.

    Args:
        start, goal: ends of the path, shape (2,) [m].
        discs: obstacles, rows (x, y, radius), shape (m, 3) [m].
        samples: targets in the order in which they are drawn, shape (s, 2) [m].
        step: the longest edge [m].

    Returns:
        (path, sizes): from start to goal, shape (k, 2) [m], of no rows when the samples have run
        out; how many nodes the start's tree and the goal's have, shape (2,).
    """
    discs = np.asarray(discs, dtype=float).reshape(-1, 3)
    trees = [([np.array(end, dtype=float)], [-1]) for end in (start, goal)]

    def grow(tree: tuple[list, list], target: np.ndarray, greedy: bool) -> bool:
        """Return a step towards the target, or all the way; whether no disc was in it."""
        nodes, parents = tree
        offsets = np.array(nodes) - target
        near = int(np.argmin(np.hypot(offsets[:, 0], offsets[:, 1])))
        while True:
            offset = target - nodes[near]
            distance = math.hypot(*offset)
            new = target if distance <= step else nodes[near] + step / distance * offset
            if not edge_is_free(nodes[near], new, discs):
                return False
            nodes.append(new)
            parents.append(near)
            if distance <= step or not greedy:
                return True
            near = len(nodes) - 1

    path = np.zeros((0, 2))
    for turn, sample in enumerate(np.asarray(samples, dtype=float)):
        tree, other = trees[turn % 2], trees[1 - turn % 2]
        if grow(tree, sample, False) and grow(other, tree[0][-1], True):
            halves = []
            for nodes, parents in trees:
                half = [len(nodes) - 1]
                while parents[half[-1]] >= 0:
                    half.append(parents[half[-1]])
                halves.append(np.array(nodes)[half])
            path = np.vstack((halves[0][::-1], halves[1][1:]))
            break
    return path, np.array([len(nodes) for nodes, _ in trees])


def shortcut(path: ArrayLike, discs: ArrayLike, draws: ArrayLike) -> np.ndarray:
    """Cut corners of a path, each time between two of its points, if the way between is free.

    Args:
        path: vertices, shape (k, 2) [m].
        discs: obstacles, rows (x, y, radius), shape (m, 3) [m].
        draws: two places on the path for each try, as shares of its length then, shape (d, 2).

    Returns:
        The new path, shape (j, 2) [m], never longer.
    """
    path, discs = np.array(path, dtype=float), np.asarray(discs, dtype=float).reshape(-1, 3)
    for pair in np.asarray(draws, dtype=float):
        edges = np.hypot(*np.diff(path, axis=0).T)
        along = np.concatenate(([0.0], np.cumsum(edges)))
        places = np.sort(pair) * along[-1]
        i, j = np.searchsorted(along, places, side="right") - 1
        if i == j:
            continue
        share = (places - along[[i, j]]) / edges[[i, j]]
        p, q = path[[i, j]] + share[:, None] * (path[[i + 1, j + 1]] - path[[i, j]])
        if edge_is_free(p, q, discs):
            path = np.vstack((path[: i + 1], p, q, path[j + 1 :]))
    return path


def lazy_prm(
    points: ArrayLike, edges: ArrayLike, discs: ArrayLike, start: int, goal: int
) -> tuple[np.ndarray, int]:
    """Return the shortest free route of a roadmap, of which only what is needed is checked.

    Lazy PRM (Bohlin and Kavraki, 2000): take every edge for free, search, check the route's edges
    from the start on, and search again without the one that hits.

    Args:
        points: of the roadmap, all free, shape (n, 2) [m].
        edges: pairs of their indices, both ways, not checked, shape (e, 2).
        discs: obstacles, rows (x, y, radius), shape (m, 3) [m].
        start, goal: indices of points.

    Returns:
        (route, checks): indices from start to goal, shape (k,), none when there is no route; how
        many edges were checked, each at most once.
    """
    points, discs = np.asarray(points, dtype=float), np.asarray(discs, dtype=float).reshape(-1, 3)
    neighbours: list[list[tuple[int, float]]] = [[] for _ in points]
    for i, j in np.asarray(edges).reshape(-1, 2).tolist():
        length = math.dist(points[i], points[j])
        neighbours[i].append((j, length))
        neighbours[j].append((i, length))
    free: dict[tuple[int, int], bool] = {}
    checks = 0
    while True:
        best, came, queue = {start: 0.0}, {start: start}, [(0.0, start)]
        while queue:
            cost, i = heapq.heappop(queue)
            for j, length in neighbours[i]:
                if free.get((min(i, j), max(i, j)), True) and cost + length < best.get(j, np.inf):
                    best[j], came[j] = cost + length, i
                    heapq.heappush(queue, (best[j], j))
        if goal not in came:
            return np.zeros(0, dtype=int), checks
        route = [goal]
        while route[-1] != start:
            route.append(came[route[-1]])
        route.reverse()
        for i, j in itertools.pairwise(route):
            edge = min(i, j), max(i, j)
            if edge not in free:
                free[edge] = edge_is_free(points[i], points[j], discs)
                checks += 1
            if not free[edge]:
                break
        else:
            return np.array(route), checks


def trapezoid(
    start: ArrayLike, end: ArrayLike, speed: ArrayLike, acceleration: ArrayLike, times: ArrayLike
) -> tuple[float, np.ndarray, np.ndarray]:
    """Return the quickest motion from rest to rest along a straight line of the joints.

    Args:
        start, end: joint angles, shape (n,) [rad].
        speed: largest of each joint, shape (n,) [rad/s].
        acceleration: largest of each joint, shape (n,) [rad/s^2].
        times: at which to tell, shape (m,) [s]; outside of the motion the arm rests.

    Returns:
        (duration, q, rate): duration [s]; angles and rates, one row a joint, shape (n, m).
    """
    start, times = np.asarray(start, dtype=float), np.asarray(times, dtype=float)
    move = np.asarray(end, dtype=float) - start
    if not move.any():
        return 0.0, start[:, None] + 0.0 * times, 0.0 * start[:, None] * times
    # Of the share s of the line: each joint goes at |move| times the rate of s.
    size = np.maximum(np.abs(move), 1e-300)
    v, a = float(np.min(speed / size)), float(np.min(acceleration / size))
    ramp = v / a
    if v * ramp > 1.0:  # half way, before it is at full speed
        ramp = 1.0 / math.sqrt(a)
        v = a * ramp
    duration = ramp + 1.0 / v
    t = np.clip(times, 0.0, duration)
    left = duration - t
    s = np.where(t <= ramp, 0.5 * a * t**2, v * (t - 0.5 * ramp))
    s = np.where(left <= ramp, 1.0 - 0.5 * a * left**2, s)
    rate = np.minimum(np.minimum(a * t, v), a * left)
    return duration, start[:, None] + move[:, None] * s, move[:, None] * rate


def rrt_star(
    start: ArrayLike, discs: ArrayLike, samples: ArrayLike, step: float, radius: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a tree of short paths (RRT*, Karaman and Frazzoli, 2011), whose samples are given.

    Args:
        start: the root, shape (2,) [m].
        discs: obstacles, rows (x, y, radius), shape (m, 3) [m].
        samples: targets in the order in which they are drawn, shape (s, 2) [m].
        step: the longest way towards a target [m].
        radius: of the neighbourhood that is rewired [m], at least the step.

    Returns:
        (nodes, parents, costs): shape (k, 2) [m]; index of each node's parent, -1 for the root,
        shape (k,); length of each node's path from the root, shape (k,) [m].
    """
    discs = np.asarray(discs, dtype=float).reshape(-1, 3)
    nodes, parents, costs = [np.array(start, dtype=float)], [-1], [0.0]
    for target in np.asarray(samples, dtype=float):
        points = np.array(nodes)
        away = np.hypot(*(points - target).T)
        near = int(np.argmin(away))
        new = target
        if away[near] > step:
            new = points[near] + step / away[near] * (target - points[near])
        if not edge_is_free(points[near], new, discs):
            continue
        distance = np.hypot(*(points - new).T)
        around = [i for i in range(len(nodes)) if distance[i] <= radius]
        around = [i for i in around if i == near or edge_is_free(points[i], new, discs)]
        parent = min([near, *around], key=lambda i: costs[i] + distance[i])
        cost = costs[parent] + distance[parent]
        for i in around:
            saved = costs[i] - (cost + distance[i])
            if saved > 0.0:
                parents[i] = len(nodes)
                below = [i]
                while below:  # what hangs on the node gets nearer too
                    costs[below[-1]] -= saved
                    last = below.pop()
                    below += [k for k, p in enumerate(parents) if p == last]
        nodes.append(new)
        parents.append(parent)
        costs.append(cost)
    return np.array(nodes), np.array(parents), np.array(costs)


def edge_clearance(a: ArrayLike, b: ArrayLike, discs: ArrayLike) -> np.ndarray:
    """Return the clearance between a straight edge and each disc.

    Args:
        a, b: the ends, shape (2,) each [m].
        discs: rows (x, y, radius), shape (m, 3) [m].

    Returns:
        Distance of the edge from each centre less its radius, shape (m,) [m].
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    x, y, radius = np.asarray(discs, dtype=float).reshape(-1, 3).T
    along, centres = b - a, np.column_stack((x, y))
    length2 = float(along @ along)
    share = (centres - a) @ along / length2 if length2 > 0.0 else np.zeros(len(x))
    nearest = a + np.clip(share, 0.0, 1.0)[:, None] * along
    return np.hypot(*(centres - nearest).T) - radius
