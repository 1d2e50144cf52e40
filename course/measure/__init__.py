"""How the course measures: work against precision, stability limits, scenes.

Generic: the functions here get callables and know nothing of a chapter. They need NumPy;
matplotlib is imported when something is drawn.

Examples:
    >>> import numpy as np
    >>> from course.measure.stability import spectral_radius
    >>> turn = np.array([[0.0, 1.0], [-1.0, 0.0]])  # a rotation neither grows nor decays
    >>> print(spectral_radius(turn))
    1.0
"""
