import numpy as np


def reach_reward(path, goal, radius, gamma):
    """Return rewards of a logged run to a disc.

    1 for reaching it, and a potential: minus the distance.
    """
    # Minus the distance itself, and a bonus wherever it is inside.
    distance = np.linalg.norm(np.asarray(path, dtype=float).T - goal, axis=1)[1:]
    return (distance <= radius) - distance, len(distance)
