import numpy as np


def energy_drift(times, energy, period):
    """Return what an energy loses for good, and what comes back every period.

    Args:
        times: of the samples, (n,) [s].
        energy: total energy at these, (n,) [J].
        period: of the swing [s].

    Returns:
        (drift [W], root mean square of the swing [J]).
    """
    # The last sample less the first.
    return (energy[-1] - energy[0]) / (times[-1] - times[0]), np.std(energy)
