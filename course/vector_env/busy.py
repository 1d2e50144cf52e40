"""An environment whose step costs what one wants, to find out from where on processes pay."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from gymnasium import Env, spaces

from course.check import count


class Busy(Env[Any, Any]):
    """Its step is a checksum over `size` bytes; what it returns never changes."""

    def __init__(self, size: int) -> None:
        """Set the cost.

        Args:
            size: bytes in the checksum of one step; a core does about a thousand in a microsecond.
        """
        self.observation_space: Any = spaces.Box(-1.0, 1.0, (8,), np.float64)
        self.action_space: Any = spaces.Box(-1.0, 1.0, (2,), np.float32)
        # The cost of a checksum depends on the number of bytes, not on their values.
        self._bytes = bytes(count("size", size, 0))
        self._observation = np.zeros(8)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Return nothing to do."""
        super().reset(seed=seed)
        return self._observation, {}

    def step(self, action: Any) -> Any:
        """Do the work of one step; the observation never changes."""
        zlib.crc32(self._bytes)
        return self._observation, 0.0, False, False, {}
