"""Compile a hot loop once, keep the result on disk, and say so while the reader waits.

`numba.njit` without a signature compiles at the first call, for whatever types come in, and a
function handed in as an argument defeats its cache. Here a loop is compiled for one explicit
signature, in which functions are typed by what they take and return; so the machine code is found
again by the next process whatever function is handed in.
"""

import functools
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numba
from numba import types

# A cached function loads in a few hundredths of a second; only a real compilation is announced.
_ANNOUNCE_AFTER = 0.5  # s

VECTOR = types.Array(numba.float64, 1, "C")
MATRIX = types.Array(numba.float64, 2, "C")


def acceleration_type(array: types.Array) -> types.FunctionType:
    """The type of `acceleration(q, v, params)` over states of the given array type."""
    return types.FunctionType(array(array, array, VECTOR))


def _announce(name: str) -> None:
    if os.environ.get("COURSE_QUIET") != "1":
        print(f"compiling {name} (once; the next run starts at once) ...", file=sys.stderr)


@functools.cache
def compiled(function: Callable[..., Any], signature: Any) -> Callable[..., Any]:
    """`function` compiled for `signature`, from the disk cache where it is there.

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
    timer = threading.Timer(_ANNOUNCE_AFTER, _announce, [function.__qualname__])
    timer.daemon = True
    timer.start()
    start = time.thread_time()
    try:
        result = numba.njit(signature, cache=True, error_model="numpy")(function)
    finally:
        timer.cancel()
    name = f"{function.__module__}.{function.__qualname__}"
    COMPILE_SECONDS[f"{name} {signature}"] = time.thread_time() - start
    return result


# Processor time of each compilation, or of loading it from the cache, in this process [s].
COMPILE_SECONDS: dict[str, float] = {}
