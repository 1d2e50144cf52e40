def bounce_step(y, v, dt, restitution, gravity=9.81):
    """Return the height and velocity of a bouncing point after dt.

    Args:
        y: height above the floor, not negative [m].
        v: velocity, upwards positive [m/s].
        dt: length of the step [s].
        restitution: speed after an impact over speed before, 0 to 1.
        gravity: downwards, positive [m/s^2].

    Returns:
        (y, v) at the end of the step.
    """
    # Free flight: the floor is missing.
    return y + v * dt - 0.5 * gravity * dt**2, v - gravity * dt
