import numpy as np


def compatible(offered, requested):
    """Return the policies for which a writer offers less than a reader requests.

    Args:
        offered, requested: reliability, durability, deadline [s], liveliness, lease [s],
            destination order and ownership of each end, shape (7,); a time of 0 is none.

    Returns:
        1 where reliability, durability, deadline, liveliness with its lease, destination order or
        ownership fails, else 0, shape (6,).
    """
    # As if both ends had to say the same.
    unlike = np.asarray(offered) != np.asarray(requested)
    return unlike[[0, 1, 2, 3, 5, 6]].astype(int)
