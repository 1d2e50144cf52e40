"""Controls and state of a simulation as records: one declaration of what there is to set or keep.

A `Record` gives the fields, their defaults, limits, units and labels, and the NumPy dtype. What a
model's functions are handed is one structured scalar: in plain Python and compiled by Numba,
`state["steps"] += 1` and `state["box"][1, 0] = 2.0` change it in place. Every field is eight bytes
wide: float64, int64 (whole numbers, choices, switches) or uint64 (the seeds of `splitmix`).
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from course.check import count, finite, invalid, one_of, vector

# Eight bytes for every field, so that records look the same in Python, Numba and JavaScript.
_WIDE = {"f": np.float64, "i": np.int64, "b": np.int64, "u": np.uint64}


@dataclass(frozen=True)
class Field:
    """One field: its default says whether it is a number, a whole number, a switch or a seed.

    Attributes:
        default: a number or switch; with `shape` or as a sequence, an array of numbers.
        label: shown on the panel; a field without one is set by presets and drags only.
        low, high: limits, both allowed; of each number of an array.
        step: between two settings of the slider.
        unit: as shown.
        decimals: as shown.
        choices: what a menu shows; the field is the number of the choice, from 0.
        live: a change acts on the running state; else the experiment restarts.
        shape: of an array.
    """

    default: Any
    label: str = ""
    low: float = -np.inf
    high: float = np.inf
    step: float = 0.0
    unit: str = ""
    decimals: int = 2
    choices: tuple[str, ...] = ()
    live: bool = False
    shape: tuple[int, ...] = ()

    @property
    def switch(self) -> bool:
        """True for a boolean field."""
        return isinstance(self.default, bool)

    @property
    def ends(self) -> tuple[Any, ...]:
        """Both ends of a number, every choice of a menu, both ways of a switch."""
        if self.switch:
            return (False, True)
        return tuple(range(len(self.choices))) or (self.low, self.high)

    def type(self) -> tuple[Any, tuple[int, ...]]:
        """Return the dtype of its numbers and its shape."""
        value = np.asarray(self.default)
        return _WIDE[value.dtype.kind], self.shape or value.shape

    def checked(self, name: str, value: Any) -> Any:
        """Return the value as the record keeps it; a choice may be given by what the menu shows.

        Raises:
            ValueError: it is not allowed.
        """
        if self.choices:
            if isinstance(value, str):
                return self.choices.index(one_of(name, value, self.choices))
            return count(name, value, 0, len(self.choices) - 1)
        kind, shape = self.type()
        if self.switch:
            return int(one_of(name, value, (False, True)))
        if shape:
            good: Any = vector(name, value, shape, low=self.low, high=self.high, unit=self.unit)
        else:
            good = finite(name, value, self.low, self.high, unit=self.unit)
        # Integers arrive as floats from sliders and pages.
        if kind is not np.float64 and np.any(good != np.floor(good)):
            raise invalid(name, value, "an integer")
        return np.asarray(value, kind)


def slider(
    label: str,
    default: float,
    low: float,
    high: float,
    step: float,
    unit: str = "",
    decimals: int = 2,
    live: bool = False,
) -> Field:
    """Return a number on the panel; a whole number if the default is an int."""
    return Field(default, label, low, high, step, unit, decimals, live=live)


def menu(label: str, choices: tuple[str, ...], default: int = 0, live: bool = False) -> Field:
    """Return a field with one of several choices, a menu on the panel."""
    return Field(default, label, choices=choices, live=live)


def switch(label: str, default: bool, live: bool = False) -> Field:
    """Return a field that is on or off, a switch on the panel."""
    return Field(default, label, live=live)


class Record:
    """The fields of a record, in order, by name."""

    def __init__(self, **fields: Field) -> None:
        self.fields: Mapping[str, Field] = fields
        self.dtype = np.dtype([(name, *field.type()) for name, field in fields.items()])

    def panel(self) -> Iterator[tuple[str, Field]]:
        """Return the fields that are shown on the panel."""
        return ((name, field) for name, field in self.fields.items() if field.label)

    def new(self, **values: Any) -> Any:
        """Return a record with the defaults, but for these values.

        Raises:
            ValueError: there is no such field, or its value is not allowed.
        """
        # A structured scalar, whose fields change in place.
        record = np.zeros((), self.dtype)[()]
        self.reset(record)
        self.set(record, **values)
        return record

    def reset(self, record: Any) -> None:
        """Put the defaults into a record."""
        for name, field in self.fields.items():
            record[name] = field.default

    def set(self, record: Any, **values: Any) -> None:
        """Put values into a record; all of them or, if one is not allowed, none.

        Raises:
            ValueError: there is no such field, or its value is not allowed.
        """
        # Check all values first: a record is changed completely or not at all.
        fields = [self.fields[one_of("field", name, self.fields)] for name in values]
        good = [f.checked(n, v) for f, (n, v) in zip(fields, values.items(), strict=True)]
        for name, value in zip(values, good, strict=True):
            record[name] = value

    def read(self, data: bytes) -> Any:
        """Return the record that has these bytes.

        Raises:
            ValueError: it has another size, or a field has a value that is not allowed.
        """
        if len(data) != self.dtype.itemsize:
            raise invalid("bytes of a record", len(data), str(self.dtype.itemsize))
        record = np.frombuffer(data, self.dtype)[0]
        self.check(record)
        return record

    def check(self, record: Any) -> None:
        """Raise ValueError if a field of the record has a value that is not allowed."""
        for name, field in self.fields.items():
            field.checked(name, record[name])
