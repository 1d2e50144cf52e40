"""Reject bad input in one wording: "NAME must be RULE, got VALUE".

Examples:
    >>> from course.check import positive
    >>> positive("mass", -1.0, unit="kg")
    Traceback (most recent call last):
    ValueError: mass must be a positive finite number [kg], got -1.0
"""

from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")

# The smallest of the usual floats: as a lower bound it says "positive".
POSITIVE = float(np.finfo(float).tiny)


def invalid(name: str, value: Any, allowed: str) -> ValueError:
    """Return the error for a value that is not allowed.

    Args:
        name: of the argument.
        value: what the caller passed; a long array is shown by its shape.
        allowed: the rule, as a noun phrase such as "a positive integer".

    Returns:
        The error, to be raised.
    """
    # A long array would drown the message.
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist() if value.size <= 12 else f"an array of shape {value.shape}"
        return ValueError(f"{name} must be {allowed}, got {value}")
    return ValueError(f"{name} must be {allowed}, got {value!r}")


def finite(
    name: str, value: Any, low: float = -np.inf, high: float = np.inf, *, unit: str = ""
) -> float:
    """Return a finite number from `low` to `high`, both allowed.

    Raises:
        ValueError: otherwise.
    """
    try:
        # float() would accept text and arrays of one element; neither is a number here.
        if isinstance(value, str) or np.ndim(value):
            raise TypeError("not a number")
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        # NaN fails the comparisons below, which raise the error.
        number = np.nan
    if not (low <= number <= high and abs(number) < np.inf):
        raise invalid(name, value, _number(low, high, unit))
    return number


def positive(name: str, value: Any, *, unit: str = "") -> float:
    """Return a finite number above 0; anything else raises ValueError."""
    return finite(name, value, POSITIVE, unit=unit)


def count(name: str, value: Any, least: int = 0, at_most: int | None = None) -> int:
    """Return an integer from `least` to `at_most`, both included.

    Raises:
        ValueError: for anything else, a bool or a float without a fraction included.
    """
    # To Python a bool is an integer; as a count it is a mistake.
    integer = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not integer or value < least or (at_most is not None and value > at_most):
        if at_most is not None:
            rule = f"an integer from {least} to {at_most}"
        else:
            rule = {0: "a non-negative integer", 1: "a positive integer"}.get(
                least, f"an integer of at least {least}"
            )
        raise invalid(name, value, rule)
    return int(value)


def _real_array(name: str, value: Any) -> NDArray[np.float64]:
    """Return the value as an array of floats.

    NumPy would drop an imaginary part with a warning only, so a complex array is rejected, even
    where every imaginary part is 0: a derivative by a complex step would silently be 0.

    Raises:
        ValueError: if the value is complex or not numeric; it names the argument.
    """
    try:
        array = np.asarray(value)
        if not np.iscomplexobj(array):
            return np.asarray(array, dtype=float)
    except (TypeError, ValueError):
        pass
    raise invalid(name, value, "an array of real numbers") from None


def vector(
    name: str,
    value: Any,
    *shapes: tuple[int | None, ...],
    low: float = -np.inf,
    high: float = np.inf,
    unit: str = "",
) -> NDArray[np.float64]:
    """Return an array of finite numbers, each from `low` to `high`.

    Args:
        name: of the argument.
        value: anything NumPy makes an array of.
        shapes: those that are allowed, None standing for any size; without one any shape is.
        low: smallest number that is allowed.
        high: largest number that is allowed.
        unit: for the message.

    Returns:
        The array; the same one if it was one of floats.

    Raises:
        ValueError: otherwise; it names the first number that is wrong.
    """
    array = _real_array(name, value)
    if shapes and not any(_fits(array.shape, shape) for shape in shapes):
        shown = (", ".join("N" if n is None else str(n) for n in shape) for shape in shapes)
        # Shapes as Python writes tuples, with N for any size.
        texts = (f"({text},)" if "," not in text and text else f"({text})" for text in shown)
        raise invalid(f"{name}.shape", array.shape, " or ".join(texts))
    good = np.isfinite(array) & (array >= low) & (array <= high)
    if not good.all():
        # The message points at the first number that is wrong.
        where = tuple(int(i) for i in np.argwhere(~good)[0])
        place = f"{name}{list(where)}" if where else name
        raise invalid(place, float(array[where]), _number(low, high, unit))
    return array


def bounds(name: str, value: Any, size: int) -> NDArray[np.float64]:
    """Return the bounds of `size` numbers: one for each, or one for all.

    Infinite where there is none.

    Returns:
        A new array, shape (size,).

    Raises:
        ValueError: for another shape, NaN, or what is no number.
    """
    try:
        array = _real_array(name, value)
    except ValueError:
        # What is no array of real numbers is rejected below, as NaN is.
        array = np.array(np.nan)
    if array.shape not in ((), (size,)):
        raise invalid(f"{name}.shape", array.shape, f"() or ({size},)")
    if np.isnan(array).any():
        raise invalid(name, value, "an array of numbers, which may be infinite")
    return np.full(size, array)


def one_of(name: str, value: T, allowed: Iterable[T]) -> T:
    """Return `value` if it is one of `allowed`.

    Raises:
        ValueError: if it is not; the message lists what is allowed.
    """
    known = list(allowed)
    if value not in known:
        raise invalid(name, value, f"one of {', '.join(map(repr, known))}")
    return value


def _fits(shape: tuple[int, ...], desired: tuple[int | None, ...]) -> bool:
    return len(shape) == len(desired) and all(
        size is None or size == n for n, size in zip(shape, desired, strict=True)
    )


def _number(low: float, high: float, unit: str) -> str:
    if high < np.inf:
        text = f"a number from {low:g} to {high:g}"
    elif low == POSITIVE:
        text = "a positive finite number"
    elif low > -np.inf:
        text = (
            "a non-negative finite number" if low == 0 else f"a finite number of at least {low:g}"
        )
    else:
        text = "a finite number"
    return f"{text} [{unit}]" if unit else text
