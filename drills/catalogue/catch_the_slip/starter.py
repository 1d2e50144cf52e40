import numpy as np


def catch_the_slip(turns, rates, moments, step):
    """Return what is wrong with each of several implementations of a free body.

    Args:
        turns: attitudes that each gave, body to world, shape (k, n, 3, 3).
        rates: angular velocities that each gave, in the world's axes, (k, n, 3) [rad/s].
        moments: principal moments of each one's body, along its axes, (k, 3) [kg m^2].
        step: time between two samples [s].

    Returns:
        1: no rotation, 2: other rates, 3: not free, 0: nothing found, (k,).
    """
    # Columns of length 1, at the first sample.
    lengths = np.linalg.norm(turns[:, 0], axis=1)
    return np.any(np.abs(lengths - 1.0) > 1e-3, axis=1).astype(int)
