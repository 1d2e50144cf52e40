"""What every engine did in five scenes, recorded, for a machine without them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from course.platforms.contract import Array


@dataclass(frozen=True, eq=False)
class Recorded:
    """Runs of S scenes at T steps with both settings (as shipped, fair) on E engines.

    Attributes:
        paths: what is drawn, (S, T, 2, E, samples, 2); truth: (S, samples, 2).
        errors: at the end [m or rad], (S, T, 2, E); infinite where a state was not finite.
        costs: of the motion at 1 ms, as a multiple of MuJoCo's with fair settings, (S, 2, E).
        tolerance: [m or rad], (S,); duration: [s], (S,); steps: [s], (T,).
        radar: five axes from 0 to 1: lowest over the scenes, middle and highest, (E, 5, 3).
        heights: of the block in *brake* above its start [m], fair, at 1 ms, (E, samples).
        engines, versions: their names, and what ran.
    """

    paths: Array
    truth: Array
    errors: Array
    costs: Array
    tolerance: Array
    duration: Array
    steps: Array
    radar: Array
    heights: Array
    engines: tuple[str, ...]
    versions: tuple[str, ...]


@cache
def recorded() -> Recorded:
    """Return the record; `python -m course.charts.platforms.record` makes it anew."""
    with np.load(Path(__file__).parent / "recorded.npz") as result:
        texts: dict[str, Any] = {
            name: tuple(result[name].tolist()) for name in ("engines", "versions")
        }
        arrays: dict[str, Any] = {
            name: result[name].astype(float) for name in result.files if name not in texts
        }
    return Recorded(**arrays, **texts)
