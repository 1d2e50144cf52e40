import numpy as np


def update_orientation(q, omega, dt):
    """Return the orientation after turning for dt at a constant body rate.

    Args:
        q: unit quaternion (w, x, y, z), body to world, shape (4,).
        omega: angular velocity in the body frame, shape (3,) [rad/s].
        dt: step [s].

    Returns:
        Unit quaternion (w, x, y, z), shape (4,).
    """
    # It does not turn yet.
    return np.array(q, dtype=float)
