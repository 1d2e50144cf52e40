import numpy as np


def observed_order(coarse, medium, fine, ratio=2.0):
    """Order of accuracy from three runs, and the result that they are heading for.

    Args:
        coarse, medium, fine: results with the steps r^2 h, r h and h, shape (n,) each [m].
        ratio: r, above 1.

    Returns:
        The order, and the result extrapolated to step zero, shape (n,) [m].
    """
    # Neither is right yet.
    return 1.0, np.array(fine, dtype=float)
