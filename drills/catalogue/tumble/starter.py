import numpy as np


def tumble(q, omega, inertia, dt, steps):
    """Return a body that turns freely, integrated with RK4.

    Args:
        q: orientation, unit quaternion (w, x, y, z), body to world, shape (4,).
        omega: angular velocity in the body frame, shape (3,) [rad/s].
        inertia: principal moments, shape (3,) [kg m^2].
        dt: step [s].
        steps: how many.

    Returns:
        (q, omega) at the end.
    """
    inertia = np.asarray(inertia, dtype=float)

    def rates(q, omega):
        w, x, y, z = q
        i, j, k = omega
        q_rate = 0.5 * np.array(
            [
                -x * i - y * j - z * k,
                w * i + y * k - z * j,
                w * j + z * i - x * k,
                w * k + x * j - y * i,
            ]
        )
        omega_rate = np.cross(omega, inertia * omega) / inertia
        return q_rate, omega_rate

    q, omega = np.array(q, dtype=float), np.array(omega, dtype=float)
    for _ in range(steps):
        q1, w1 = rates(q, omega)
        q2, w2 = rates(q + 0.5 * dt * q1, omega + 0.5 * dt * w1)
        q3, w3 = rates(q + 0.5 * dt * q2, omega + 0.5 * dt * w2)
        q4, w4 = rates(q + dt * q3, omega + dt * w3)
        q = q + dt / 6.0 * (q1 + 2.0 * q2 + 2.0 * q3 + q4)
        omega = omega + dt / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4)
        q = q / np.linalg.norm(q)
    return q, omega
