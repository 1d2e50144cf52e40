import numpy as np


def flow_sample(field, noise, steps):
    """Return samples of a flow policy.

    From noise at time 0 to actions at time 1, by Heun's method.
    """
    # A single Euler step.
    return np.asarray(noise, dtype=float) + field(noise, 0.0)
