import numpy as np


def damped_step(J, error, damping):
    """Return one step of damped least squares.

    Args:
        J: Jacobian, shape (m, n) [m/rad].
        error: what the tip has yet to move, shape (m,) [m].
        damping: positive [m/rad].

    Returns:
        The step dq, shape (n,) [rad].
    """
    # This one has no bound.
    return np.linalg.pinv(J) @ error
