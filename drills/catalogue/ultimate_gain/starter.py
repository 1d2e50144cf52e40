import math


def ultimate_gain(inertia, damping, dt, delay):
    """Return the gain at which a sampled P loop around a joint swings for ever.

    And the period of that.

    Args:
        inertia: of the joint [kg m^2].
        damping: viscous friction [N m s/rad].
        dt: sample time; the torque is held between samples [s].
        delay: from a measurement to its torque, any length [s].

    Returns:
        (gain, period) [N m/rad, s].
    """
    # As if the whole loop were one dead time and the joint did not turn meanwhile.
    late = delay + dt
    return inertia / late**2, 2.0 * math.pi * late
