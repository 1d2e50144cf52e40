import numpy as np


def edge_is_free(a, b, discs):
    """Return whether the segment from a to b, each (2,), touches no disc (x, y, radius) [m]."""
    along, to_centres = b - a, discs[:, :2] - a
    length_squared = max(float(along @ along), 1e-300)
    share = np.clip(to_centres @ along / length_squared, 0.0, 1.0)
    gaps = to_centres - share[:, None] * along
    return bool(np.all(np.hypot(gaps[:, 0], gaps[:, 1]) > discs[:, 2]))


def rrt_star(start, discs, samples, step, radius):
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
                costs[i] -= saved
        nodes.append(new)
        parents.append(parent)
        costs.append(cost)
    return np.array(nodes), np.array(parents), np.array(costs)
