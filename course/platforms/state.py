"""The state of a scene, in the conventions of `course.platforms.contract`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class State:
    """Time [s] and the state in the conventions above."""

    time: float
    q: Array
    v: Array

    def same(self, other: State) -> bool:
        """Return whether both are equal bit by bit (time aside)."""
        pairs = ((self.q, other.q), (self.v, other.v))
        return all(a.shape == b.shape and a.tobytes() == b.tobytes() for a, b in pairs)
