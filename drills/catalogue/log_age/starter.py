import numpy as np


def log_age(captured, published, times):
    """Return how old the newest information is that a reader has.

    Args:
        captured: when each measurement was taken, shape (n,) [s].
        published: when it arrived, shape (n,) [s], in any order.
        times: of reading, shape (m,) [s].

    Returns:
        Ages, shape (m,) [s]; -1 where nothing has arrived.
    """
    arrivals = np.sort(np.asarray(published, dtype=float))
    ages = np.full(len(times), -1.0)
    for i, now in enumerate(times):
        last = np.searchsorted(arrivals, now, side="right") - 1
        if last >= 0:
            ages[i] = now - arrivals[last]
    return ages
