import numpy as np


def inertia_from_log(q, tau, dt):
    """Return the inertia of a joint with friction and gravity, from a log of angles and torques.

    Args:
        q: measured angle at each sample, shape (n,) [rad].
        tau: torque, held from this sample to the next, shape (n,) [N m].
        dt: sample time [s].

    Returns:
        The inertia [kg m^2].
    """
    # The largest torque over the largest acceleration.
    acceleration = np.gradient(np.gradient(q, dt), dt)
    return float(np.max(np.abs(tau)) / np.max(np.abs(acceleration)))
