import numpy as np


def shaped_reward(state, following, reward, terminated, truncated, phi, gamma):
    """Return rewards of logged steps with a potential's difference added.

    Args:
        state, following: where each step begins and leads to, whole numbers (n,).
        reward: of each step, (n,).
        terminated, truncated: whether the episode ended there, or was cut off, (n,).
        phi: potential of each state, (S,).
        gamma: discount.

    Returns:
        Shaped rewards, (n,).
    """
    # The potential itself as a reward.
    return np.asarray(reward, dtype=float) + np.asarray(phi, dtype=float)[state]
