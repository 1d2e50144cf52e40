"""The random numbers of a run, and many runs in a row for the chart."""

import numpy as np


def generator(seed):
    """Return a generator that the child owns, so that draws are counted there."""
    return np.random.default_rng(seed)


def drive(start, goal, discs, bounds, step, max_samples, seeds):
    """Run the submission; return how many runs reached the goal, and how many targets all drew."""
    from submission import rrt

    solved = drawn = 0
    for seed in seeds:
        rng = np.random.default_rng(seed)
        path, _, _, samples = rrt(start, goal, discs, bounds, step, max_samples, rng)
        solved += path is not None
        drawn += len(samples)
    return [solved, drawn]
