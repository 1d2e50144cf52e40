import numpy as np


def boundary_update(bounds, centre, outcomes, thresholds, step):
    """Return both ends of each range after their buffers are full.

    Args:
        bounds: low and high end of each range, shape (n, 2).
        centre: calibrated values, (n,).
        outcomes: success (1) or not (0) of the episodes on each end, shape (n, 2, m).
        thresholds: shares of success, (lower, upper).
        step: by which an end moves, (n,).

    Returns:
        New ends, (n, 2).
    """
    # Wider, whatever happened.
    return np.asarray(bounds, dtype=float) + np.outer(step, [-1.0, 1.0])
