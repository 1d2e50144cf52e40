import numpy as np


def fk3(lengths, thetas):
    """Return joint positions of a planar arm of three links, from the base to the tip.

    Args:
        lengths: link lengths, base to tip, shape (3,) [m].
        thetas: joint angles, shape (3,) [rad], each relative to the link before it.

    Returns:
        Positions (x, y) of the base, both inner joints and the tip, shape (4, 2) [m].
    """
    positions = np.zeros((4, 2))
    # Every joint still sits on the base.
    return positions
