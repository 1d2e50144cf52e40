import math

import numpy as np


def contact_step(position, velocity, slope, mu, dt, steps):
    """Return a block over an inclined plane.

    By time stepping with one contact and Coulomb friction.

    Args:
        position: along the slope downwards, and above the plane, shape (2,) [m].
        velocity: along the same axes, shape (2,) [m/s].
        slope: inclination of the plane [rad].
        mu: coefficient of friction.
        dt: step [s].
        steps: how many.

    Returns:
        (position, velocity) at the end, each shape (2,).
    """
    x, v = np.array(position, dtype=float), np.array(velocity, dtype=float)
    gravity = 9.81 * np.array([math.sin(slope), -math.cos(slope)])
    for _ in range(steps):
        v = v + dt * gravity
        # Impulses per kilogram: the normal one lets the block just touch at the end of the step.
        normal = max(0.0, -(v[1] + x[1] / dt))
        largest = mu * 9.81 * dt if normal > 0.0 else 0.0
        friction = min(max(-v[0], -largest), largest)
        v = v + np.array([friction, normal])
        x = x + dt * v
    return x, v
