import numpy as np


def pgs_sweep(impulses, A, b, mu):
    """Return the impulses after one sweep of projected Gauss-Seidel with friction cones.

    Args:
        impulses: of each contact: normal, then two tangents, shape (n, 3) [N s].
        A: velocity at the contacts by unit impulses, shape (3 n, 3 n) [1/kg].
        b: velocity at the contacts without impulses, shape (3 n,) [m/s].
        mu: coefficient of friction.

    Returns:
        The impulses after the sweep, shape (n, 3) [N s].
    """
    swept = np.array(impulses, dtype=float)
    # No contact has been looked at yet.
    return swept
