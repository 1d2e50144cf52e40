import numpy as np


def radar_areas(values, worst, best):
    """Return the smallest and the largest area of a radar chart, over the orders of its axes.

    Args:
        values: what was measured, (n,).
        worst: the value at the centre of each axis, (n,).
        best: the value at its end, (n,).

    Returns:
        (smallest, largest) area; an axis has the length 1.
    """
    radius = (np.asarray(values) - worst) / (np.asarray(best) - worst)
    n = len(radius)
    area = np.sin(2.0 * np.pi / n) / 2.0 * np.sum(radius[1:] * radius[:-1])
    return area, area
