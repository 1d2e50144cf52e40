import numpy as np


def dbscan(points, eps, least):
    """Return the cluster of each point, -1 for noise.

    Args:
        points: shape (3, n) [m].
        eps: largest distance of neighbours [m].
        least: neighbours of a core point, itself among them.

    Returns:
        Labels, shape (n,), numbered in the order of the clusters' first core points.
    """
    # All are one.
    return np.zeros(np.shape(points)[1])
