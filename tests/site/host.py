"""A module of compiled functions under wasmtime, for tests: no browser."""

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


class Instance:
    """A module with its memory, as its host sees it."""

    def __init__(self, module: bytes | Path) -> None:
        self.store = wasmtime.Store()
        code = module if isinstance(module, bytes) else module.read_bytes()
        made = wasmtime.Module(self.store.engine, code)
        linker = wasmtime.Linker(self.store.engine)
        for each in made.imports:
            assert each.name and isinstance(each.type, wasmtime.FuncType)
            function = maths(each.name, len(each.type.params))
            linker.define_func(each.module, each.name, each.type, function)
        self.exports: dict[str, Any] = dict(
            linker.instantiate(self.store, made).exports(self.store)
        )
        self.memory: Any = self.exports["memory"]
        self.end: int = self.exports["__heap_base"].value(self.store)
        self.result, self.exception = self.room(8), self.room(8)

    def room(self, size: int) -> int:
        """A place for so many bytes; all of them before the first call."""
        here = (self.end + 15) & -16
        self.end = here + size
        if (missing := self.end - self.size) > 0:
            self.memory.grow(self.store, -(-missing // 65536))
        return here

    @property
    def size(self) -> int:
        """Bytes of the memory."""
        return self.memory.data_len(self.store)

    def write(self, place: int, data: bytes) -> None:
        self.memory.write(self.store, data, place)

    def read(self, place: int, size: int) -> bytes:
        return bytes(self.memory.read(self.store, place, place + size))

    def call(self, name: str, *given: Any) -> None:
        """Call an export with places and numbers.

        Raises:
            ValueError: with the message of whatever the function raised.
        """
        status = self.exports[name](self.store, self.result, self.exception, *given)
        if status > 0:
            info = int.from_bytes(self.read(self.exception, 4), "little")
            place, size = np.frombuffer(self.read(info, 8), np.int32).tolist()
            raise ValueError(self.read(place, size).decode())


def array(place: int, values: Any) -> tuple[int, ...]:
    """An array (N,) at a place, as an argument."""
    return 0, 0, values.size, values.itemsize, place, values.size, values.itemsize


class Hosted(Instance):
    """A model whose functions are those of its module; all else is the model's own.

    What a function is handed is copied into the module's memory and back again.
    """

    def __init__(self, model: Model, module: bytes | Path) -> None:
        super().__init__(module)
        self.given = model
        self.places = {
            model.controls.dtype: self.room(model.controls.dtype.itemsize),
            model.state.dtype: self.room(model.state.dtype.itemsize),
            np.dtype(float): self.room(model.paper.pen().nbytes + 64),
        }
        for name in ("initial", "advance", "frame", "drag", "grab", "press", "complete"):
            has = name in signatures(model)
            setattr(self, name, self._function(name) if has else None)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.given, name)

    def _function(self, name: str) -> Any:
        def function(*values: Any) -> None:
            given: list[Any] = []
            arrays = [value for value in values if isinstance(value, np.ndarray | np.void)]
            for value in values:
                if isinstance(value, np.ndarray | np.void):
                    place = self.places[value.dtype]
                    self.write(place, value.tobytes())
                    given += [place] if isinstance(value, np.void) else array(place, value)
                else:
                    given.append(value)
            try:
                self.call(name, *given)
            finally:
                for value in arrays:
                    data = self.read(self.places[value.dtype], value.nbytes)
                    np.asarray(value)[...] = np.frombuffer(data, value.dtype).reshape(value.shape)

        return function
