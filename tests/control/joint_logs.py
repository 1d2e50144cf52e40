"""Logs of joints whose numbers the laws do not know, many at once."""

import numpy as np

from course.control.identify import JointModel, Log


def record(models, seconds=6.0, dt=2e-3, noise=3e-5, seed=0, speed=1.0):
    """One log for each model, all under the same PD loop on the same motion.

    The truth is stepped by Runge-Kutta ten times finer than the log; Coulomb friction turns round
    within 1 mrad/s. The loop sees noisy angles; `noise` is one number or one for each joint.
    """

    def of(name):
        return np.array([getattr(m, name) for m in models])

    inertia, damping, coulomb, gravity, constant, limit = (
        of(name) for name in ("inertia", "damping", "coulomb", "gravity", "constant", "limit")
    )
    rng = np.random.default_rng(seed)
    late = of("delay") / dt
    whole, part = np.floor(late + 1e-9).astype(int), late - np.floor(late + 1e-9)
    T, N, steps = round(seconds / dt), len(models), 10
    t = dt * np.arange(T + 1)
    w = speed * np.array([1.3, 3.1, 5.7])
    target = (np.array([0.9, 0.5, 0.25]) * np.sin(np.outer(t, w) + [0.1, 1.0, 2.0])).sum(1)
    rate = (np.array([0.9, 0.5, 0.25]) * w * np.cos(np.outer(t, w) + [0.1, 1.0, 2.0])).sum(1)
    q, v = np.full(N, target[0]), np.full(N, rate[0])
    seen, sent = np.zeros((T + 1, N)), np.zeros((T, N))
    lanes, h = np.arange(N), dt / steps

    def acceleration(q, v, u):
        dry = coulomb * np.tanh(v / 1e-3)
        return (constant * u - damping * v - dry - gravity * np.cos(q)) / inertia

    for k in range(T + 1):
        seen[k] = q + noise * rng.normal(size=N)
        if k == T:
            break
        slow = 0.0 if k == 0 else (seen[k] - seen[max(0, k - 5)]) / (dt * min(k, 5))
        sent[k] = 12.0 * (target[k] - seen[k]) + 1.2 * (rate[k] - slow)
        for i in range(steps):
            # Before the switch the command of one sample earlier is still on its way.
            at = k - whole - ((i + 0.5) / steps < part)
            u = np.where(at >= 0, sent[np.maximum(at, 0), lanes], 0.0)
            u = np.minimum(np.maximum(u, -limit), limit)
            a1 = acceleration(q, v, u)
            s2 = v + 0.5 * h * a1
            a2 = acceleration(q + 0.5 * h * v, s2, u)
            s3 = v + 0.5 * h * a2
            a3 = acceleration(q + 0.5 * h * s2, s3, u)
            s4 = v + h * a3
            a4 = acceleration(q + h * s3, s4, u)
            q = q + h / 6.0 * (v + 2.0 * s2 + 2.0 * s3 + s4)
            v = v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    return [Log(dt, seen[:, i], sent[:, i]) for i in range(N)]


NOMINAL = JointModel(0.1, 0.15, 0.12, 0.8)
FLAT = JointModel(0.1)
