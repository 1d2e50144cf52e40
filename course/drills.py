"""Reference answers of the coding drills, as one would write them in an interview.

Each section is self-contained: it needs NumPy, and where the drill is about MuJoCo, MuJoCo. The
autograder shows these texts as the solutions and compares submissions with what they compute.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
