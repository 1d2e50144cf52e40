import numpy as np


def success_interval(solved, tried, confidence, share, half):
    """Return Wilson's intervals of success rates, and the trials that make one narrow enough.

    Args:
        solved, tried: how many trials worked, of how many, both (n,).
        confidence: of the two-sided interval.
        share: success rate that is expected.
        half: half the width that its interval may have.

    Returns:
        (lower ends (n,), upper ends (n,), least number of trials).
    """
    # The usual interval.
    p = np.asarray(solved) / np.asarray(tried)
    width = 1.96 * np.sqrt(p * (1.0 - p) / np.asarray(tried))
    return p - width, p + width, int(1.96**2 * share * (1.0 - share) / half**2)
