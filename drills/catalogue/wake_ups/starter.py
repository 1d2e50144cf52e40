import numpy as np


def wake_ups(start, period, late, work):
    """Return when a periodic loop asks to be woken, and how many of its periods it has to skip.

    Args:
        start: of the first period [ns].
        period: [ns].
        late: how long after the time asked for each cycle really begins, shape (n,) [ns].
        work: how long it then works, (n,) [ns].

    Returns:
        (time that each cycle asked for (n,) [ns], periods skipped right after it (n,)).
    """
    # Work, then sleep for a period.
    spent = np.cumsum(np.asarray(late) + np.asarray(work) + period)
    return start + np.concatenate(([0], spent[:-1])), np.zeros(len(spent))
