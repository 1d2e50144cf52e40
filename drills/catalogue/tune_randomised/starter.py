import numpy as np


def tune_randomised(gains, draws, trained):
    """Return the gains that are best on randomised carts, and what they cost on carts not seen.

    Args:
        gains: rows (kp, kd) to choose from, shape (K, 2) [N/m, N s/m].
        draws: rows (mass, damping, delay in samples) of carts, shape (n, 3).
        trained: how many of them, from the first on, are for choosing.

    Returns:
        (mean cost of each row of gains (K,), the best row, its mean cost on the other carts).
    """
    dt, steps = 0.02, 100
    nominal = {"mass": 1.0, "damping": 0.2, "delay": 0.0}
    cart = dict(nominal)

    def rollout(kp, kd):
        x, v, cost = 1.0, 0.0, 0.0
        for _ in range(steps):
            force = -kp * x - kd * v
            v += dt * (force - cart["damping"] * v) / cart["mass"]
            x += dt * v
            cost += dt * min(x * x, 1.0)
        return cost

    def mean_cost(kp, kd, carts):
        costs = []
        for mass, damping, delay in carts:
            cart.update(mass=mass, damping=damping, delay=delay)
            cart.update(nominal)
            costs.append(rollout(kp, kd))
        return float(np.mean(costs))

    rows, carts = np.asarray(gains, dtype=float), np.asarray(draws, dtype=float)
    costs = np.array([mean_cost(kp, kd, carts[:trained]) for kp, kd in rows])
    best = int(np.argmin(costs))
    kp, kd = rows[best]
    return costs, best, mean_cost(kp, kd, carts[:trained])
