"""Answers that came over the pipe: rebuilt as float64, compared, described.

The order is fixed: type, shape, finite, then the error, and an answer passes only if
`not (error <= tolerance)` is false, so that a NaN never passes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.inprocess import Local
from drills.reasons import Reason
from drills.sandbox import Handle

Array = NDArray[np.float64]
# Of the largest number in an answer: less is a rounding error.
_ROUNDING = 1e-14


class Mismatch(Exception):
    """Why a value is not the answer, with a sentence of its own."""

    def __init__(self, reason: Reason, sentence: str) -> None:
        super().__init__(sentence)
        self.reason, self.sentence = reason, sentence


def as_float64(value: Any, shape: tuple[int, ...] | None, what: str = "the answer") -> Array:
    """Return the value as a float64 array of that shape.

    Args:
        value: a number, a list or tuple of numbers (nested), or a numeric array. A list of floats
            is as good as an array; booleans, texts and everything else are not numbers.
        shape: the shape it must have, () for a number, or None for any. A list of no rows cannot
            say how long its rows would be, so it fits any shape whose first length is 0.
        what: how the sentences call it.

    Raises:
        Mismatch: type, then shape, then NaN or infinity.
    """
    if value is None:
        raise Mismatch(Reason.NOTHING_RETURNED, f"{what} is None. Is a return statement missing?")
    array = numbers(value, what)
    if shape and shape[0] == 0 and array.shape == (0,):
        array = array.reshape(shape)
    if shape is not None and array.shape != shape:
        raise Mismatch(Reason.WRONG_SHAPE, _shape_sentence(array.shape, shape, what))
    if not np.all(np.isfinite(array)):
        place = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        where = f" at index {place}" if place else ""
        raise Mismatch(Reason.NOT_FINITE, f"{what} holds {array[place]}{where}.")
    return array


def type_name(value: Any) -> str:
    """Return how a sentence calls the type of a value."""
    if isinstance(value, np.ndarray):
        return f"array of {value.dtype}"
    name = getattr(value, "type_name", None)  # a value of a type that cannot travel
    return name if isinstance(name, str) else type(value).__name__


def worst(got: Array, expected: Array) -> tuple[float, tuple[int, ...]]:
    """Return the largest difference of a component, and its index."""
    if got.size == 0:
        return 0.0, ()
    difference = np.abs(got - expected)
    place = np.unravel_index(int(np.argmax(difference)), difference.shape)
    return float(difference[place]), tuple(int(i) for i in place)


def numbers(value: Any, what: str = "the answer") -> Array:
    """Return the value as a float64 array of whatever shape, NaN and infinity included.

    Raises:
        Mismatch: for what is not numbers, is ragged, or holds an integer beyond any float.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = np.asarray(value)
        if value.dtype.kind not in "iuf":
            raise Mismatch(
                Reason.WRONG_TYPE, f"{what} is {_a(type_name(value))}; numbers are asked for."
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
        if value and all(type(item) in (int, float) for item in value):
            try:
                return np.array([float(item) for item in value])
            except OverflowError:
                pass  # the sentence comes below
        rows = [numbers(item, what) for item in value]
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
        Reason.WRONG_TYPE, f"{what} is (or holds) {_a(type_name(value))}; numbers are asked for."
    )


def _a(name: str) -> str:
    """Return a name with its article."""
    return f"{'an' if name[:1].lower() in 'aeiou' else 'a'} {name}"


def _shape_sentence(got: tuple[int, ...], desired: tuple[int, ...], what: str) -> str:
    message = f"{what} has shape {got}; {desired} is asked for."
    if got == desired[::-1] and len(got) > 1:
        return f"{message} It looks transposed."
    if len(got) == len(desired) and len(got) > 0 and got[1:] == desired[1:]:
        few = "few" if got[0] < desired[0] else "many"
        return f"{message} There are {abs(got[0] - desired[0])} too {few} rows."
    if int(np.prod(got)) == int(np.prod(desired)):
        return f"{message} The number of values is right, their arrangement is not."
    return message


@dataclass(frozen=True)
class Failure:
    """Stands where a result was when the request raised: the name of the exception."""

    type: str


def describe(value: Any, limit: int = 72) -> str:
    """Return a value as a short text: numbers with six digits, long ones cut."""
    text = _described(value, limit)
    return text if len(text) <= limit else text[: limit - 3] + "..."


def _described(value: Any, limit: int) -> str:
    if isinstance(value, np.ndarray):
        if value.size > 16 or any(count > 16 for count in value.shape):
            return f"array of shape {value.shape}"
        return _described(value.tolist(), limit)
    if isinstance(value, bool) or value is None:
        return repr(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, int):
        bits = value.bit_length()
        return str(value) if bits <= 128 else f"an integer of {bits} bits"
    if isinstance(value, str):
        return repr(value[:limit])
    if isinstance(value, dict):
        items = [f"{key!r}: {describe(value[key], limit)}" for key in list(value)[:8]]
        return "{" + ", ".join(items) + "}"
    if isinstance(value, list | tuple):
        inside = ", ".join(describe(item, limit) for item in value[:17])
        return f"[{inside}]" if isinstance(value, list) else f"({inside})"
    if callable(value):
        return str(getattr(value, "__name__", type_name(value)))
    return "an object" if isinstance(value, Handle | Local) else type_name(value)


def describe_call(name: str, args: Sequence[Any], kwargs: dict[str, Any] | None = None) -> str:
    """Return a call as one would type it."""
    inside = [describe(a, 40) for a in args]
    inside += [f"{key}={describe(value, 40)}" for key, value in (kwargs or {}).items()]
    return f"{name}({', '.join(inside)})"


def without_rounding(result: Any) -> Any:
    """Replace the floats of an answer that are nothing but rounding errors by zero.

    They are below `_ROUNDING` of the largest float in the whole answer. A reader takes them for
    values, and they differ from CPU to CPU.
    """
    limit = _ROUNDING * max(_magnitudes(result), default=0.0)

    def cleaned(value: Any) -> Any:
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            return np.where(np.abs(value) < limit, 0.0, value)
        if isinstance(value, float):
            return 0.0 if abs(value) < limit else value
        if type(value) in (list, tuple):
            return type(value)(cleaned(each) for each in value)
        return value

    return cleaned(result)


def _magnitudes(value: Any) -> Iterator[float]:
    """Yield the sizes of the finite floats in a value."""
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        yield from np.abs(value[np.isfinite(value)]).tolist()
    elif isinstance(value, float) and math.isfinite(value):
        yield abs(value)
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _magnitudes(each)


def identical(a: Any, b: Any) -> bool:
    """Return whether two results are the same to the last bit, NaN equal to NaN."""
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if type(a) is not type(b):
        return False
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(identical, a, b))
    if isinstance(a, dict):
        return list(a) == list(b) and all(identical(a[key], b[key]) for key in a)
    if isinstance(a, float):
        return a == b or (math.isnan(a) and math.isnan(b))
    if isinstance(a, bool | int | str) or a is None:
        return bool(a == b)
    return not isinstance(a, Failure) or a == b  # handles, and what cannot travel


def close(a: Any, b: Any, relative: float = 1e-9) -> bool:
    """Return whether two results are the same but for rounding; lists are as good as arrays."""
    if isinstance(a, Failure) or isinstance(b, Failure):
        return type(a) is type(b) and bool(a == b)
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(close(a[key], b[key], relative) for key in a)
    x, y = _as_numbers(a), _as_numbers(b)
    if x is not None and y is not None:
        if x.shape != y.shape:
            return False
        finite = np.isfinite(y)
        scale = max(1.0, float(np.max(np.abs(y[finite]), initial=0.0)))
        near = np.abs(x[finite] - y[finite]) <= relative * scale
        return bool(np.all(near) and np.array_equal(x[~finite], y[~finite], equal_nan=True))
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        return len(a) == len(b) and all(close(p, q, relative) for p, q in zip(a, b, strict=True))
    return type(a) is type(b) and (a is None or (isinstance(a, str) and a == b))


def _as_numbers(value: Any) -> Array | None:
    """Return numbers as a float64 array, truth values as 0 and 1; None for anything else."""
    if isinstance(value, bool) or (isinstance(value, np.ndarray) and value.dtype.kind == "b"):
        return np.asarray(value, dtype=np.float64)
    try:
        return numbers(value)
    except Mismatch:
        return None
