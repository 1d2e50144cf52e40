def visual_gain(gain, delay):
    """Return corrections from a picture that is some frames old.

    How much gain, and what noise becomes.

    Args:
        gain: part of the error seen that is corrected at each frame.
        delay: age of the picture in frames, a whole number from 0 on.

    Returns:
        (gain below which it settles, variance of the place over that of a picture, or -1).
    """
    # As if all of what was seen could be corrected at once, and no noise came of it.
    return 1.0, gain**2
