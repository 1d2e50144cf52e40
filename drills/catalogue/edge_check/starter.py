import numpy as np


def edge_check(lengths, discs, a, b):
    """Return how much of a straight motion of the joints of a planar arm is free of discs.

    Args:
        lengths: of the links, shape (n,) [m]; the base is the origin.
        discs: obstacles, rows (x, y, radius), shape (m, 3) [m].
        a: joint angles at the start, each from the link before, shape (n,) [rad].
        b: at the end, shape (n,) [rad].

    Returns:
        1 when the whole motion is free, else its share up to a gap of 1e-9 m.
    """
    # Only a motion that is none is free.
    return 0.0 if np.not_equal(a, b).any() else 1.0
