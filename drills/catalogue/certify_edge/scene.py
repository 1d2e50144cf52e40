"""The clearance of a capsule among discs: the grader evaluates it, and a learner can run it."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def capsule_gaps(
    poses: ArrayLike, half: float, radius: float, discs: ArrayLike
) -> NDArray[np.float64]:
    """Return the distance from a capsule to the nearest disc at each pose.

    Args:
        poses: rows (x, y, turn), shape (k, 3) [m, m, rad].
        half: half the length of the capsule's centre line [m].
        radius: of the capsule [m].
        discs: rows (x, y, radius), shape (m, 3) [m]; at least one.

    Returns:
        The distances, negative where they overlap, shape (k,) [m].
    """
    at, rows = np.asarray(poses, dtype=float), np.asarray(discs, dtype=float)
    along = np.stack((np.cos(at[:, 2]), np.sin(at[:, 2])), axis=1)
    to = rows[None, :, :2] - at[:, None, :2]
    nearest = np.clip(np.einsum("kmi,ki->km", to, along), -half, half)
    distance = np.linalg.norm(to - nearest[:, :, None] * along[:, None], axis=2)
    return np.asarray(np.min(distance - rows[:, 2], axis=1) - radius)
