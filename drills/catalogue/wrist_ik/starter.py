import math

import numpy as np


def wrist_ik(q, target, damping, steps):
    """Joint angles that turn a wrist of three joints to a target orientation.

    Args:
        q: joint angles at the start, about z, then y, then x, shape (3,) [rad].
        target: orientation of the hand, unit quaternion (w, x, y, z), shape (4,).
        damping: of the steps, positive.
        steps: how many.

    Returns:
        The angles after all steps, shape (3,) [rad].
    """

    def product(p, r):
        return np.array(
            [p[0] * r[0] - p[1:] @ r[1:], *(p[0] * r[1:] + r[0] * p[1:] + np.cross(p[1:], r[1:]))]
        )

    def about(axis, angle):
        return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * np.eye(3)[axis])])

    q = np.array(q, dtype=float)
    for _ in range(steps):
        hand = product(about(2, q[0]), product(about(1, q[1]), about(0, q[2])))
        left = product(target, hand * [1.0, -1.0, -1.0, -1.0])
        error = 2.0 * left[1:]  # of a small turn, its vector
        c, s = math.cos(q[0]), math.sin(q[0])
        J = np.array(
            [
                [0.0, -s, c * math.cos(q[1])],
                [0.0, c, s * math.cos(q[1])],
                [1.0, 0.0, -math.sin(q[1])],
            ]
        )
        q = q + 0.2 * J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(3), error)
    return q
