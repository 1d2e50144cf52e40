import numpy as np


def error_budget(errors):
    """Return who owns how much of an error, from runs with every set of stages at fault.

    Args:
        errors: shape (2^k, n, 2) [m]; in row s stage i is real where bit i of s is set.

    Returns:
        (signed part of each stage (k, 2), its share (k,), mean square without it (k,)).
    """
    # Each stage at fault alone.
    alone = np.asarray(errors, dtype=float)[[1 << i for i in range(len(errors).bit_length() - 1)]]
    square = np.mean(np.sum(alone**2, axis=2), axis=1)
    return alone.mean(axis=1), square, square.sum() - square
