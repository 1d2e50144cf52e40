import numpy as np


def geometric_jacobian(placements, q, tool):
    """Return velocity and angular velocity at a tool point for each joint rate.

    Args:
        placements: of each joint in the frame before it, homogeneous, shape (n, 4, 4) [1, m].
        q: joint angles about each frame's own z, shape (n,) [rad].
        tool: the point, in the last frame, shape (3,) [m].

    Returns:
        The Jacobian in world axes, linear rows first, shape (6, n).
    """
    # Nothing moves yet.
    return np.zeros((6, len(q)))
