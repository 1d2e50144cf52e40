import numpy as np


def execute_chunks(chunks, every, rate):
    """Return what is executed of a chunk policy.

    Committed for some steps, and ensembled over time.
    """
    # One whole chunk, then nothing.
    plans = np.zeros((np.shape(chunks)[0], np.shape(chunks)[2]))
    plans[: np.shape(chunks)[1]] = chunks[0][: len(plans)]
    return plans, plans
