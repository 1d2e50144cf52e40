"""A body whose rate changes: one update per step, at the rate half way. For the chart."""

import numpy as np


def drive(q, rates, dt):
    """Return the orientation after one update of the submission for each of the rates."""
    from submission import update_orientation

    for rate in np.asarray(rates):
        q = update_orientation(q, rate, dt)
    return np.array(q, dtype=float)
