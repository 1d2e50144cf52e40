import numpy as np


def two_link_ik(lengths, target):
    """Return both pairs of joint angles that bring the tip of a two-link arm to a target.

    Args:
        lengths: of both links, shape (2,) [m].
        target: of the tip, shape (2,) [m].

    Returns:
        Rows (q1, q2), shape (2, 2) [rad]: the arm with q2 >= 0, then the one with q2 <= 0.

    Raises:
        ValueError: when the target is out of reach.
    """
    # It points both arms at the target, stretched.
    direction = np.arctan2(target[1], target[0])
    return np.array([[direction, 0.0], [direction, 0.0]])
