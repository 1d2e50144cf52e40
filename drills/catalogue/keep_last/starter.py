import numpy as np


def keep_last(stamps, arrivals, reads, depth, lifespan):
    """Return what a reader takes out of a cache of the last messages with a lifespan.

    Args:
        stamps: when each message was written, shape (n,) [s].
        arrivals: when it arrived, rising, (n,) [s].
        reads: when the cache is emptied, rising, (m,) [s].
        depth: how many messages it holds.
        lifespan: age from which a message is gone [s]; 0 for none.

    Returns:
        (numbers of the messages of each read in the order of arrival, then -1, shape (m, depth);
        how many were pushed out by later ones).
    """
    # Every read takes what has come since the one before, as far as there is room for it.
    taken, edges = np.full((len(reads), depth), -1), [-np.inf, *reads]
    for row in range(len(reads)):
        new = [k for k, at in enumerate(arrivals) if edges[row] < at <= edges[row + 1]][:depth]
        taken[row, : len(new)] = new
    return taken, len(arrivals) - int(np.sum(taken >= 0))
