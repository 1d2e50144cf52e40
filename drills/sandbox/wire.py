"""Plain data as JSON, for the pipes between the grader and its child process.

Both ends load this file: the grader as a module of its package, the child by path. What arrives is
never trusted: `decode` accepts exactly the forms that `encode` writes, within fixed bounds.

A JSON number, string, true, false, null or array stands for itself. All else is an object of one
key: `i` an int beyond 2**53 (hexadecimal), `f` NaN or an infinity, `t` a tuple, `d` a dictionary,
`a` an array as [dtype, shape, base64], `x` a value that does not travel (its type's name), `h` an
object that stays in the child, `c` a function that stays in the grader.
"""

from __future__ import annotations

import binascii
import json
import math
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

FRAME = 16 << 20  # bytes of one message
DEPTH = 32  # levels of nesting
NODES = 200_000  # values in one message
TEXT = 256 << 10  # characters of one message's strings
ARRAY = 8 << 20  # bytes of one message's arrays
INTEGER = 4096  # bits of one int
DIMENSIONS = 32  # of one array

DTYPES = frozenset(
    ["bool", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"]
    + ["float16", "float32", "float64"]
)
SCALARS = frozenset(np.dtype(name).type for name in DTYPES) | {np.longdouble}
ARRAYS = np.ndarray
HEAD = struct.Struct(">I")


class TooLarge(ValueError):
    """The value exceeds what one message may hold."""


class Malformed(ValueError):
    """The bytes are not a message."""


def _refuse(constant: str) -> Any:
    raise Malformed(f"{constant} is not JSON")


WRITER = json.JSONEncoder(allow_nan=False, separators=(",", ":"))
READER = json.JSONDecoder(parse_constant=_refuse)


def type_name(value: Any) -> str:
    """Return the name of a value's type, short enough to print."""
    kind = type(value)
    try:
        module, name = str(kind.__module__), str(kind.__qualname__)
        if kind is ARRAYS:
            return f"array of dtype {value.dtype.name}"[:120]
        return (name if module in ("builtins", "submission") else f"{module}.{name}")[:120]
    except BaseException:  # a metaclass may do anything
        return "object"


def extent(shape: Sequence[int]) -> int:
    """Return how many rows a loop over an array visits.

    Many even where each is empty.
    """
    return math.prod(max(count, 1) for count in shape)


def encode(value: Any, unknown: Callable[[Any, str], Any], text: int = TEXT) -> Any:
    """Return a value as something that `json` writes exactly.

    Args:
        value: what is to travel.
        unknown: called with a value whose exact type is none of the plain ones, and a name for it;
            returns what stands in its place, or raises.
        text: the most characters that all strings together may have.

    Returns:
        A tree of None, bool, int, float, str, list and dict.

    Raises:
        TooLarge: beyond the bounds of one message.
    """
    remaining = {"nodes": NODES, "text": text, "array": ARRAY}

    def spend(what: str, amount: int) -> None:
        remaining[what] -= amount
        if remaining[what] < 0:
            raise TooLarge(f"too large to hand over (more than the limit of {what})")

    def put(x: Any, depth: int) -> Any:
        spend("nodes", 1)
        kind = type(x)
        if x is None or kind is bool:
            return x
        # JSON has no infinity and no NaN.
        if kind is float:
            return x if math.isfinite(x) else {"f": repr(x)}
        if kind is int:
            # Beyond 2^53 some readers of JSON would round.
            if -(1 << 53) <= x <= 1 << 53:
                return x
            if x.bit_length() > INTEGER:
                return unknown(x, f"int of {x.bit_length()} bits")
            return {"i": hex(x)}
        if kind is str:
            spend("text", len(x))
            return x
        if depth >= DEPTH:
            raise TooLarge(f"nested more than {DEPTH} deep")
        if kind is list:
            return [put(item, depth + 1) for item in x]
        # JSON knows lists and objects only: all else is an object with one key, its tag.
        if kind is tuple:
            return {"t": [put(item, depth + 1) for item in x]}
        if kind is dict:
            pairs = {}
            for key, item in x.items():
                if type(key) is not str:
                    return unknown(x, f"dict with keys of type {type_name(key)}")
                spend("text", len(key))
                pairs[key] = put(item, depth + 1)
            return {"d": pairs}
        if kind is ARRAYS or kind in SCALARS:
            if x.dtype.char == "g":  # its width differs between machines
                x = x.astype("float64")
            name = x.dtype.name
            if name not in DTYPES:
                return unknown(x, type_name(x))
            # An array of shape (10**9, 0) has no bytes, and is still expensive to make.
            spend("array", max(x.nbytes, extent(x.shape)))
            data = x.astype(x.dtype.newbyteorder("="), copy=False).tobytes()
            content = binascii.b2a_base64(data, newline=False).decode("ascii")
            return {"a": [name, list(x.shape), content]}
        return unknown(x, type_name(x))

    return put(value, 0)


def decode(data: Any, special: Callable[[str, Any], Any]) -> Any:
    """Return the value that `encode` wrote.

    Args:
        data: parsed JSON.
        special: called with "x" and a type's name, or "h" or "c" and a number; returns the value,
            or raises `Malformed` where such a thing must not appear.

    Raises:
        Malformed: for anything that `encode` would not have written.
    """

    def array(parts: Any) -> np.ndarray:
        if type(parts) is not list or len(parts) != 3:
            raise Malformed("an array is [dtype, shape, content]")
        # Everything is checked before NumPy sees it: the sender may be hostile.
        name, shape, content = parts
        if type(name) is not str or name not in DTYPES:
            raise Malformed("unknown dtype")
        if type(shape) is not list or len(shape) > DIMENSIONS or type(content) is not str:
            raise Malformed("an array's shape is a short list, its content a string")
        if not all(type(n) is int and 0 <= n <= 1 << 40 for n in shape):
            raise Malformed("an array's shape holds counts")
        try:
            raw = binascii.a2b_base64(content, strict_mode=True)
        except ValueError as error:
            raise Malformed("base64 expected") from error
        dtype = np.dtype(name)
        if extent(shape) > ARRAY:
            raise Malformed("too many rows")
        if math.prod(shape) * dtype.itemsize != len(raw):
            raise Malformed("shape and length of an array differ")
        if name == "bool" and raw and max(raw) > 1:
            raise Malformed("a bool is 0 or 1")
        try:
            return np.frombuffer(raw, dtype=dtype).reshape(shape).copy()
        except (ValueError, OverflowError, MemoryError) as error:
            raise Malformed("no such array") from error

    def get(x: Any, depth: int) -> Any:
        kind = type(x)
        if x is None or kind is bool or kind is str:
            return x
        if kind is int:
            if abs(x) > 1 << 53:
                raise Malformed("a large int travels in hexadecimal")
            return x
        if kind is float:
            if not math.isfinite(x):
                raise Malformed("a number beyond the range of float")
            return x
        if depth >= DEPTH:
            raise Malformed("nested too deeply")
        if kind is list:
            return [get(item, depth + 1) for item in x]
        if kind is not dict or len(x) != 1:
            raise Malformed("an object has one key")
        ((tag, content),) = x.items()
        if tag == "a":
            return array(content)
        if tag == "t" and type(content) is list:
            return tuple(get(item, depth + 1) for item in content)
        if tag == "d" and type(content) is dict:
            return {key: get(item, depth + 1) for key, item in content.items()}
        if tag == "f" and content in ("nan", "inf", "-inf"):
            return float(content)
        if tag == "i" and type(content) is str and len(content) <= INTEGER // 4 + 3:
            try:
                return int(content, 16)
            except ValueError as error:
                raise Malformed("not an int") from error
        if tag in ("x", "h", "c"):
            return special(tag, content)
        raise Malformed("unknown form")

    return get(data, 0)


def pack(message: dict[str, Any]) -> bytes:
    """Return a message as bytes: its length in four bytes, then JSON in ASCII.

    Raises:
        TooLarge: longer than one message may be.
    """
    payload = WRITER.encode(message).encode("ascii")
    if len(payload) > FRAME:
        raise TooLarge("too large to hand over")
    return HEAD.pack(len(payload)) + payload


def unpack(payload: bytes) -> dict[str, Any]:
    """Return the message of a payload.

    Raises:
        Malformed: when it is not a JSON object within the bounds.
    """
    # Counted first, so that a short text cannot become millions of Python objects.
    if sum(payload.count(mark) for mark in (b"[", b"{", b",")) > 3 * NODES + TEXT:
        raise Malformed("too many values")
    try:
        message = READER.decode(payload.decode("ascii"))
    except (ValueError, RecursionError, MemoryError) as error:
        raise Malformed("not JSON") from error
    if type(message) is not dict:
        raise Malformed("not an object")
    return message
