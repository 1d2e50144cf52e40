import math

import numpy as np


def wrist_ik(q, target, damping, steps):
    """Return joint angles that turn a wrist of three joints to a target orientation.

    Args:
        q: joint angles at the start, about z, then y, then x, shape (3,) [rad].
        target: orientation of the hand, unit quaternion (w, x, y, z), shape (4,).
        damping: of the steps, positive.
        steps: how many.

    Returns:
        The angles after all steps, shape (3,) [rad].
    """

    def product(p, r):
        (w, x, y, z), (a, b, c, d) = p, r
        return np.array(
            [
                w * a - x * b - y * c - z * d,
                w * b + x * a + y * d - z * c,
                w * c - x * d + y * a + z * b,
                w * d + x * c - y * b + z * a,
            ]
        )

    def about(axis, angle):
        turn = [math.cos(angle / 2), 0.0, 0.0, 0.0]
        turn[1 + axis] = math.sin(angle / 2)
        return turn

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
        q = q + 0.3 * J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(3), error)
    return q
