import numpy as np


def verlet_step(q, v, a, acceleration, dt):
    """Return one step of velocity Verlet.

    Args:
        q, v, a: positions [m], velocities [m/s] and acceleration at q [m/s^2], shape (n,) each.
        acceleration: function q -> acceleration, to be called once.
        dt: step [s].

    Returns:
        The new (q, v, a).
    """
    # Explicit Euler: change this into velocity Verlet.
    q_new = np.asarray(q) + dt * np.asarray(v)
    v_new = np.asarray(v) + dt * np.asarray(a)
    return q_new, v_new, acceleration(q_new)
