import numpy as np


def rrt(start, goal, discs, bounds, step, max_samples, rng):
    """Return a collision-free path for a point among discs, by a rapidly-exploring random tree.

    Args:
        start: where the path begins, shape (2,) [m].
        goal: where it ends, shape (2,) [m].
        discs: obstacles, rows (x, y, radius), shape (n, 3) [m]; n may be zero.
        bounds: the world, rows (xmin, ymin) and (xmax, ymax), shape (2, 2) [m].
        step: the longest edge [m].
        max_samples: how many targets to draw at most.
        rng: a numpy Generator; draw every random number from it.

    Returns:
        path, shape (k, 2) [m] or None; nodes, shape (m, 2) [m]; parents, shape (m,); samples,
        shape (s, 2) [m].
    """
    start = np.array(start, dtype=float)
    nodes, parents, samples = [start], [-1], []
    # The tree has a root and does not grow yet.
    return None, np.array(nodes), np.array(parents), np.reshape(samples, (-1, 2))
