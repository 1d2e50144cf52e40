"""A simulation's module under wasmtime, for tests: no browser and no second implementation."""

import ctypes
import ctypes.util
from pathlib import Path
from typing import Any

import numpy as np
import wasmtime

from course.simulations.model import Model
from course.site.wasm import signatures

_LIBM = ctypes.CDLL(ctypes.util.find_library("m"))


def maths(name: str, count: int) -> Any:
    """A function of the C library of so many numbers."""
    function = getattr(_LIBM, name)
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double] * count
    return function


class Hosted:
    """A model whose functions are those of its module; all else is the model's own.

    What a function is handed is copied into the module's memory and back again.
    """

    def __init__(self, model: Model, module: bytes | Path) -> None:
        self.given = model
        self.store = wasmtime.Store()
        code = module if isinstance(module, bytes) else module.read_bytes()
        made = wasmtime.Module(self.store.engine, code)
        linker = wasmtime.Linker(self.store.engine)
        for each in made.imports:
            assert each.name and isinstance(each.type, wasmtime.FuncType)
            function = maths(each.name, len(each.type.params))
            linker.define_func(each.module, each.name, each.type, function)
        made_here = linker.instantiate(self.store, made)
        self.exports: dict[str, Any] = dict(made_here.exports(self.store))
        self.memory: Any = self.exports["memory"]
        self.end: int = self.exports["__heap_base"].value(self.store)
        self.result, self.exception = self.room(8), self.room(8)
        self.controls_at = self.room(model.controls.dtype.itemsize)
        self.state_at = self.room(model.state.dtype.itemsize)
        self.pen_at = self.room(model.paper.pen().nbytes)
        if (missing := self.end - self.memory.data_len(self.store)) > 0:
            self.memory.grow(self.store, -(-missing // 65536))
        for name in ("initial", "advance", "frame", "drag", "grab", "press"):
            has = name in signatures(model)
            setattr(self, name, self._function(name) if has else None)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.given, name)

    def room(self, size: int) -> int:
        """A place for so many bytes."""
        here = (self.end + 15) & -16
        self.end = here + size
        return here

    def read(self, place: int, size: int) -> bytes:
        """Bytes of the memory."""
        return bytes(self.memory.read(self.store, place, place + size))

    def call(self, name: str, *given: Any) -> None:
        """Call an export with places and numbers.

        Raises:
            ValueError: what the function raised.
        """
        status = self.exports[name](self.store, self.result, self.exception, *given)
        if status > 0:
            info = int.from_bytes(self.read(self.exception, 4), "little")
            place, size = np.frombuffer(self.read(info, 8), np.int32).tolist()
            raise ValueError(self.read(place, size).decode())

    def _function(self, name: str) -> Any:
        def function(*values: Any) -> None:
            given: list[Any] = []
            arrays: list[tuple[int, Any]] = []
            for value in values:
                if isinstance(value, np.void):
                    own = value.dtype == self.given.controls.dtype
                    place = self.controls_at if own else self.state_at
                    arrays.append((place, np.asarray(value)))
                    given.append(place)
                elif isinstance(value, np.ndarray):
                    arrays.append((self.pen_at, value))
                    given += [0, 0, value.size, 8, self.pen_at, value.size, 8]
                else:
                    given.append(value)
            for place, array in arrays:
                self.memory.write(self.store, array.tobytes(), place)
            self.call(name, *given)
            for place, array in arrays:
                array[...] = np.frombuffer(self.read(place, array.nbytes), array.dtype).reshape(
                    array.shape
                )

        return function
