"""How much of a stored film differs from one that is recorded again."""

import io

import numpy as np
from PIL import Image, ImageSequence

COMPARED = 20  # frames: 2 s, in which a difference of rounding has not grown to a pixel
VISIBLE = 40  # of 255 levels
LARGEST = 0.003  # share of a frame


def frames(film: bytes) -> list[np.ndarray]:
    """Return the first frames of an animated PNG, each (height, width, 3)."""
    with Image.open(io.BytesIO(film)) as pictures:
        some = [np.array(p.convert("RGB"), int) for p in ImageSequence.Iterator(pictures)]
    return some[:COMPARED]


def is_out_of_date(stored: bytes, recorded: bytes) -> bool:
    """Return whether a stored film visibly differs from a recording of the present model."""
    before, after = frames(stored), frames(recorded)
    if len(before) != len(after) or before[0].shape != after[0].shape:
        return True
    differing = [
        np.mean(np.abs(a - b).max(axis=-1) > VISIBLE) for a, b in zip(before, after, strict=True)
    ]
    return bool(max(differing) > LARGEST)
