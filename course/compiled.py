"""Compile a hot loop once, keep the result on disk, and say so while the reader waits.

`numba.njit` without a signature compiles at the first call, for whatever types come in, and a
function handed in as an argument defeats its cache. Here a loop is compiled for one explicit
signature, in which functions are typed by what they take and return; so the machine code is found
again by the next process whatever function is handed in.

numba also forgets that compiled code contains the functions it calls: it looks only at the file of
the outermost one. Here the cache lives in a folder named after the text of every source file that
mentions numba, so editing `quaternion.py` recompiles the integrators that use it.
"""

import contextlib
import ctypes
import fcntl
import functools
import hashlib
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import types
from numba.core import cgutils, event
from numba.extending import intrinsic, overload
from numba.np.random.generator_core import _bit_gen_type

# What takes less is not announced. Loading from the cache never is, however long it takes.
_ANNOUNCE_AFTER = 0.5  # s

VECTOR = types.Array(numba.float64, 1, "C")
MATRIX = types.Array(numba.float64, 2, "C")


def acceleration_type(array: types.Array) -> types.FunctionType:
    """Return the type of `acceleration(q, v, params)` over states of the given array type."""
    return types.FunctionType(array(array, array, VECTOR))


def _announce(name: str) -> None:
    if os.environ.get("COURSE_QUIET") != "1":
        print(f"compiling {name} (once; the next run starts at once) ...", file=sys.stderr)


def _announce_later(name: str) -> threading.Timer:
    timer = threading.Timer(_ANNOUNCE_AFTER, _announce, [name])
    timer.daemon = True
    timer.start()
    return timer


class _Announcement(event.Listener):
    """Announces that numba compiles this function: what it finds in its cache is no such event."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function
        self._timers: list[threading.Timer] = []

    def on_start(self, event: Any) -> None:
        # numba reports callees as well; only the function itself is announced.
        if event.data["dispatcher"].py_func is self._function:
            self._timers.append(_announce_later(self._function.__qualname__))

    def on_end(self, event: Any) -> None:
        if event.data["dispatcher"].py_func is self._function:
            self._timers.pop().cancel()


_KEEP = 3  # folders of earlier states of the sources


@functools.cache
def _cache_folder() -> str:
    """Return the folder for this state of the sources; older ones are removed, but for a few.

    It is below NUMBA_CACHE_DIR if that is set, else below the package's own __pycache__; where
    that can't be written, numba's default applies ("").
    """
    package = Path(__file__).parent
    # One digest over all sources that mention numba, so that a change in any callee counts, and of
    # recorded numbers, since compiled code holds the arrays of its module as constants.
    state = hashlib.sha256()
    for path in sorted([*package.rglob("*.py"), *package.rglob("*.npz")]):
        text = path.read_bytes()
        if path.suffix == ".npz" or b"numba" in text:
            # Path and length delimit each text, so that moving text between files changes the
            # digest.
            state.update(f"{path.relative_to(package)} {len(text)}\n".encode() + text)
    root = Path(os.environ.get("NUMBA_CACHE_DIR") or package / "__pycache__") / "compiled"
    folder = root / state.hexdigest()[:16]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # A folder in use gets a new time, so the least recently used ones are removed.
        os.utime(folder)
        for old in sorted(root.iterdir(), key=lambda p: p.stat().st_mtime)[: -_KEEP - 1]:
            shutil.rmtree(old, ignore_errors=True)
    except OSError:
        return ""
    return str(folder)


@contextlib.contextmanager
def _alone(folder: str, function: Callable[..., Any]) -> Iterator[None]:
    """Nobody else compiles this function meanwhile.

    Whoever comes second waits and finds the result; two at once would do the work twice, and could
    write the code of two signatures into one file, since numba numbers the files of a function.
    The lock goes with its process, however that ends.
    """
    name = f"{Path(function.__code__.co_filename).stem}.{function.__qualname__}.lock"
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # where nothing can be written, nothing is kept either
            lock = stack.enter_context(open(Path(folder or os.devnull) / name, "w"))
            try:
                # Tried without waiting first, so that only a real wait is announced.
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                waiting = _announce_later(function.__qualname__)
                stack.callback(waiting.cancel)
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@functools.cache
def compiled(function: Callable[..., Any], signature: Any) -> Callable[..., Any]:
    """Return `function` compiled for `signature`, from the disk cache where it is there.

    A compilation that takes longer than half a second prints one line to standard error, unless
    the environment variable COURSE_QUIET is 1. Under NUMBA_DISABLE_JIT=1 the function itself
    comes back, so a debugger can step through it.

    Args:
        function: a plain Python function in the subset of Python that numba compiles, defined at
            the top level of a module (the cache is kept beside that module).
        signature: a numba signature, such as `MATRIX(MATRIX, numba.float64)`.

    Returns:
        The compiled function.
    """
    if numba.config.DISABLE_JIT:
        return function
    # Processor time of this thread: waiting for another process does not count.
    start = time.thread_time()
    name = f"{function.__module__}.{function.__qualname__}"
    # numba reads this setting when it decorates, so it is changed for that moment only.
    folder, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _cache_folder()
    try:
        with (
            _alone(numba.config.CACHE_DIR, function),
            event.install_listener("numba:compile", _Announcement(function)),
        ):
            # As in NumPy, a division by zero gives inf or NaN here and raises nothing.
            result = numba.njit(signature, cache=True, error_model="numpy")(function)
    finally:
        numba.config.CACHE_DIR = folder
    COMPILE_SECONDS[f"{name} {signature}"] = time.thread_time() - start
    return result


def loop(function: Callable[..., Any], signature: Any) -> Callable[..., Any]:
    """Return `function` for callers in plain Python and in compiled code alike.

    Args:
        function: as for `compiled`.
        signature: as for `compiled`.

    Returns:
        A function that is `compiled(function, signature)` where plain Python calls it, compiled at
        the first call, and `function` itself, compiled along, where compiled code calls it.
    """
    # Compiled at the first call, so that importing a module compiles nothing.
    ready: list[Callable[..., Any]] = []

    def call(*arguments: Any) -> Any:
        if not ready:
            ready.append(compiled(function, signature))
        return ready[0](*arguments)

    # Compiled callers get the plain function, which numba compiles along with them.
    overload(call, strict=False)(lambda *arguments: function)
    return call


def function_argument(function: Any) -> Callable[..., Any]:
    """Return a compiled function in the form that is cheapest to hand to another one.

    numba looks up the address of a function argument at every call, which takes longer than a
    short run; this form carries the address.

    Args:
        function: what `compiled` returned.
    """
    if numba.config.DISABLE_JIT:
        return function
    # One signature was compiled, so there is exactly one overload.
    (result,) = function.overloads.values()
    address = types.CompileResultWAP(result)
    address._numba_type_ = types.FunctionType(result.signature)  # else made anew at every call
    return address


def address_of(value: Any) -> Any:
    """Return a `function_argument` or a NumPy generator as a number, which `from_address` takes.

    To take apart one of these costs a compiled loop 2 to 20 us a call, a number nothing. Whoever
    hands the number on keeps `value` alive meanwhile. Under NUMBA_DISABLE_JIT=1 it is `value`.
    """
    if numba.config.DISABLE_JIT:
        return value
    if isinstance(value, np.random.Generator):
        # The generator's C struct, from the capsule in which NumPy hands it out.
        return _POINTER(value.bit_generator.capsule, b"BitGenerator")
    return value.address


# A function of CPython's C API, called with the interpreter's lock held.
_POINTER = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", ctypes.pythonapi)
)


def from_address(kind: Any) -> Callable[[Any], Any]:
    """Return, in compiled code, the function or generator behind an `address_of`.

    Args:
        kind: `numba.types.FunctionType(signature)` or `numba.types.npy_rng`.
    """

    @intrinsic
    def made(context, address):
        def code(context, builder, signature, values):
            here = values[0]
            result = cgutils.create_struct_proxy(kind)(context, builder)  # all null so far
            if kind is not types.npy_rng:
                # The address is all that compiled code needs to call it.
                result.c_addr = builder.inttoptr(here, context.get_value_type(types.voidptr))
                return result._getvalue()
            # NumPy's struct bitgen: state, next_uint64, next_uint32, next_double.
            bits = cgutils.create_struct_proxy(_bit_gen_type)(context, builder)
            words = builder.inttoptr(here, context.get_value_type(types.CPointer(types.uintp)))
            bits.state_address = here
            for i, name in enumerate(("state", *_DRAWS)):
                setattr(bits, name, builder.load(cgutils.gep(builder, words, i)))
            result.bit_generator = bits._getvalue()
            return result._getvalue()

        return kind(types.uintp), code

    def at(address: Any) -> Any:
        return address

    # The outer function types the call; the inner one is what numba compiles.
    overload(at, strict=False)(lambda address: lambda address: made(address))
    return at


_DRAWS = ("fnptr_next_uint64", "fnptr_next_uint32", "fnptr_next_double")

# Processor time of each compilation, or of loading it from the cache, in this process [s].
COMPILE_SECONDS: dict[str, float] = {}
