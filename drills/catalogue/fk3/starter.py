import numpy as np


def fk3(lengths, thetas):
    """Joint positions of a planar arm of three links.

    Args:
        lengths: link lengths, shape (3,) [m].
        thetas: joint angles, shape (3,) [rad], each relative to the link before it.

    Returns:
        Base, both inner joints and tip as rows (x, y), shape (4, 2) [m].
    """
    positions = np.zeros((4, 2))
    # Fill in the rows after the first.
    return positions
