import numpy as np


def delay_from_log(sent, measured, dt, longest):
    """Return how late a measurement follows a command, in parts of a sample too.

    Args:
        sent, measured: one value a sample, (n,); the measurement has a gain and an offset.
        dt: sample time [s].
        longest: delay that is looked for [s].

    Returns:
        The delay [s].
    """
    # From the largest command to the largest measurement.
    return float(dt * (np.argmax(measured) - np.argmax(sent)))
