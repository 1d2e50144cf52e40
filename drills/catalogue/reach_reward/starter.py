import numpy as np


def reach_reward(path, goal, radius, gamma):
    """Return the rewards of a logged run to a disc: 1 for reaching it, and a potential."""
    # Minus the distance itself, and a bonus at every step inside.
    distance = np.linalg.norm(np.asarray(path, dtype=float).T - goal, axis=1)[1:]
    return (distance <= radius) - distance, len(distance)
