import numpy as np


def silent_gate(seeds, outcomes, old_seeds, old_outcomes, gate):
    """Return what a nightly run says of a new version, beside the night before."""

    def results(names, values):
        table = {}
        for name, value in zip(names, values, strict=True):
            if value >= 0:
                table[int(name)] = bool(value)
        return table

    new, old = results(seeds, outcomes), results(old_seeds, old_outcomes)
    n, square = len(new), 1.959963984540054**2
    p = sum(new.values()) / n
    width = np.sqrt(square * (p * (1.0 - p) / n + square / (4.0 * n**2)))
    low = (p + square / (2.0 * n) - width) / (1.0 + square / n)
    both = list(zip(new.values(), old.values(), strict=False))
    tally = np.array([both.count((True, False)), both.count((False, True))])
    return low, tally, int(low >= gate)
