import math


def hold_joint(q, target, pole, load, dt, steps):
    """Return a link in a vertical plane under computed torque with an integral, from rest.

    Args:
        q: angle at the start, from the horizontal [rad].
        target: angle to hold [rad].
        pole: the error must have three poles there, at -pole [1/s].
        load: torque that the controller does not know of [N m].
        dt: sample time and step [s].
        steps: how many.

    Returns:
        (q, v, total): angle, rate and integral of the error at the end [rad, rad/s, rad s].
    """
    inertia, weight = 0.5, 9.0  # kg m^2; N m, times the cosine of the angle
    kp, ki, kd = 3.0 * pole**2, pole**3, 3.0 * pole
    q, v, total = float(q), 0.0, 0.0
    for _ in range(steps):
        error = target - q
        wanted = kp * error + ki * (total + error) - kd * v
        torque = inertia * wanted + weight * math.cos(q)
        total = total + dt * error
        v = v + dt * (torque + load - weight * math.cos(q)) / inertia
        q = q + dt * v
    return q, v, total
