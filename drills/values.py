"""Answers that came over the pipe, rebuilt as float64 and compared.

The order is fixed: type, shape, finite, then the error, and an answer passes only if
`not (error <= tolerance)` is false, so that a NaN never passes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.reasons import Reason

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mismatch(Exception):
    """Why a value is not the answer, with a sentence of its own."""

    reason: Reason
    sentence: str


def as_float64(value: Any, shape: tuple[int, ...] | None, what: str = "the answer") -> Array:
    """The value as a float64 array of that shape.

    Args:
        value: a number, a list or tuple of numbers (nested), or a numeric array. A list of floats
            is as good as an array; booleans, texts and everything else are not numbers.
        shape: the shape it must have, () for a number, or None for any.
        what: how the sentences call it.

    Raises:
        Mismatch: type, then shape, then NaN or infinity.
    """
    if value is None:
        raise Mismatch(Reason.NOTHING_RETURNED, f"{what} is None. Is a return statement missing?")
    array = _numbers(value, what)
    if shape is not None and array.shape != shape:
        raise Mismatch(Reason.WRONG_SHAPE, _shape_sentence(array.shape, shape, what))
    if not np.all(np.isfinite(array)):
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        where = f" at index {place}" if place else ""
        raise Mismatch(Reason.NOT_FINITE, f"{what} holds {array[place]}{where}.")
    return array


def type_name(value: Any) -> str:
    """How a sentence calls the type of a value."""
    if isinstance(value, np.ndarray):
        return f"array of {value.dtype}"
    name = getattr(value, "type_name", None)  # a value of a type that cannot travel
    return name if isinstance(name, str) else type(value).__name__


def worst(got: Array, expected: Array) -> tuple[float, tuple[int, ...]]:
    """The largest difference of a component, and its index."""
    if got.size == 0:
        return 0.0, ()
    difference = np.abs(got - expected)
    place = np.unravel_index(int(np.argmax(difference)), difference.shape)
    return float(difference[place]), tuple(int(i) for i in place)


def _numbers(value: Any, what: str) -> Array:
    if isinstance(value, np.ndarray | np.generic):
        value = np.asarray(value)
        if value.dtype.kind not in "iuf":
            raise Mismatch(
                Reason.WRONG_TYPE, f"{what} is an {type_name(value)}; numbers are asked for."
            )
        return value.astype(np.float64)
    if type(value) in (int, float):
        try:
            return np.asarray(float(value))
        except OverflowError:
            raise Mismatch(
                Reason.NOT_FINITE, f"{what} holds an integer too large for a float."
            ) from None
    if isinstance(value, list | tuple):
        if value and all(type(item) is float for item in value):
            return np.array(value, dtype=np.float64)
        rows = [_numbers(item, what) for item in value]
        if not rows:
            return np.zeros(0)
        shapes = {row.shape for row in rows}
        if len(shapes) > 1:
            lengths = ", ".join(str(row.shape) for row in rows[:4])
            raise Mismatch(
                Reason.WRONG_SHAPE, f"{what} is ragged: its rows have the shapes {lengths}."
            )
        return np.stack(rows)
    raise Mismatch(
        Reason.WRONG_TYPE, f"{what} is (or holds) a {type_name(value)}; numbers are asked for."
    )


def _shape_sentence(got: tuple[int, ...], wanted: tuple[int, ...], what: str) -> str:
    said = f"{what} has shape {got}; {wanted} is asked for."
    if got == wanted[::-1] and len(got) > 1:
        return f"{said} It looks transposed."
    if len(got) == len(wanted) and len(got) > 0 and got[1:] == wanted[1:]:
        few = "few" if got[0] < wanted[0] else "many"
        return f"{said} There are {abs(got[0] - wanted[0])} too {few} rows."
    if int(np.prod(got)) == int(np.prod(wanted)):
        return f"{said} The number of values is right, their arrangement is not."
    return said
