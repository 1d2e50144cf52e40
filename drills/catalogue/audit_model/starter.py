import numpy as np


def audit_model(ids, masses, inertias, loaded_ids, loaded_masses, moments, turns, tolerance):
    """Return which links of a file are not what the simulator has loaded.

    Args:
        ids, masses, inertias: of the file, (n,), (n,) [kg], (n, 3, 3) [kg m^2].
        loaded_ids, loaded_masses: of the simulator, (m,), (m,) [kg].
        moments, turns: principal moments (m, 3) [kg m^2] and quaternions (m, 4).
        tolerance: largest error, as a part of the file's value.

    Returns:
        Sum of 1: other mass, 2: other inertia, 4: not loaded, (n,).
    """
    marks = np.zeros(len(ids), dtype=int)
    for i in range(len(ids)):
        if abs(loaded_masses[i] - masses[i]) > tolerance:
            marks[i] += 1
        if np.abs(np.diag(moments[i]) - inertias[i]).max() > tolerance:
            marks[i] += 2
    return marks
