"""The functions of a simulation as one WebAssembly module, kept beside its source.

`python -m course.site.wasm` compiles every live simulation whose sources have changed, and writes
`course/simulations/<name>.wasm` beside the `.py`; with names (`rigid_body.bouncing_box`) just
those; each in a process of its own, so that the same sources give the same bytes on machines whose
CPUs compute the same constants.

For a host. A module exports `memory`, `__heap_base` and those of `initial, advance, frame, drag,
grab, press, complete` that the model has. It imports functions of "env" that take and return f64,
named as in the C library (`compiler.MATHS`). The host lays its arrays out from `__heap_base` on,
grows the memory to hold them before its first call, and renews its views when the memory has grown.
A call is

    status = f(result, exception, arguments...)

where result (8 bytes) and exception (4 bytes) are places, a record is its place, a float64 an
f64, an int64 an i64, and the pen seven numbers: i32 0, i32 0, i64 items, i64 8, i32 place,
i64 items, i64 8. Arguments stand in the order of `course.simulations.model`. A status above 0 says
that the function raised an error: `exception` then holds the place of two i32, the place
and the length of its message (UTF-8). The state is not to be used any more.

The custom section "sources" is a JSON object: `fingerprint` of what was compiled, and the
versions of Numba, llvmlite, Python and the linker.
"""

import ast
import gzip
import hashlib
import importlib
import inspect
import json
import multiprocessing
import sys
import textwrap
import time
import types as python
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core.errors import NumbaError

from course.simulations.declaration import RECORDED, model, names
from course.simulations.declaration import module as file_of
from course.simulations.model import Model
from course.site import compiler

SIMULATIONS = Path(__file__).parents[1] / "simulations"

# A constant that is computed while a module is imported differs in its last digits from CPU to CPU.
# The number of its digits that belong to the fingerprint.
DIGITS = 12

# A simulation whose module, packed with gzip, has more bytes is refused: a page may hold several.
LARGEST = 60_000
# What these may have beyond that, each the only module of its page: the weights of networks hardly
# compress, and the whole chain of chapter 7 is in one module.
MORE = {"learning.two_ways": 150_000, "perception": 90_000}


def signatures(model: Model) -> dict[str, tuple[Any, ...]]:
    """Return the argument types of the model's functions for Numba, by name."""
    controls, state = numba.from_dtype(model.controls.dtype), numba.from_dtype(model.state.dtype)
    number, pen = types.float64, types.Array(types.float64, 1, "C")
    takes: dict[str, tuple[Any, ...]] = {
        "initial": (controls, state),
        "advance": (state, controls, number),
        "frame": (pen, state, controls),
        "drag": (controls, state, number, number),
        "grab": (controls, state, number, number),
        "press": (controls, state, types.int64),
        "complete": (controls, state),
    }
    return {name: each for name, each in takes.items() if getattr(model, name) is not None}


def read_sources(module: bytes) -> dict[str, str]:
    """Return the content of a module's section "sources"; nothing if there is none."""
    return json.loads(compiler.custom(module, "sources") or b"{}")


# --- What it was made from ------------------------------------------------------------------------


def fingerprint(model: Model) -> str:
    """Return a hash of all that the module of a model depends on.

    The text of its functions and of those of the course that they call, without words for readers,
    the values that they find outside themselves, the layout of the records, and the compiler.
    """
    state, observed = hashlib.sha256(), set[int]()
    # The compiler's own sources count, without comments, as their code decides the module.
    here = SIMULATIONS.parent
    code = Path(compiler.__file__), here / "compiled.py", SIMULATIONS / "splitmix.py"
    for path in (*code, compiler.ARENA):
        text = path.read_text(encoding="utf-8")
        state.update((bare(text) if path.suffix == ".py" else text).encode())

    def visit(value: Any) -> None:
        # A compiled function stands for its Python source.
        value = getattr(value, "py_func", value)
        if isinstance(value, python.FunctionType):
            if id(value) in observed or not value.__module__.startswith(("course.", "tests.")):
                return
            observed.add(id(value))
            state.update(_text(value.__code__.co_filename, value.__code__).encode())
            inner = [value.__code__, *_inner(value.__code__)]
            # Follow the names that the bytecode mentions: constants, functions, parts of our
            # modules.
            used = sorted({name for code in inner for name in code.co_names})
            for name in used:
                result = value.__globals__.get(name)
                if not isinstance(result, python.ModuleType):
                    note(name, result)
                elif result.__name__.startswith("course."):
                    for part in used:
                        note(part, getattr(result, part, None))
            for name, cell in zip(value.__code__.co_freevars, value.__closure__ or (), strict=True):
                note(name, cell.cell_contents)
            note("", value.__defaults__)
            note("", tuple((value.__kwdefaults__ or {}).values()))
        elif isinstance(value, tuple | list):
            for each in value:
                visit(each)
        # Rounded, so that a last digit that differs between machines does not count.
        elif isinstance(value, np.ndarray | np.generic):
            state.update(f"{value.dtype}{value.shape}".encode() + _rounded(value).tobytes())
        elif isinstance(value, float):
            state.update(repr(_rounded(np.float64(value)).item()).encode())
        elif isinstance(value, int | str):
            state.update(repr(value).encode())

    def note(name: str, value: Any) -> None:
        if isinstance(value, _COUNTS) or hasattr(value, "py_func"):
            state.update(name.encode())
            visit(value)

    # From the entry points, through everything that the functions refer to.
    for name in signatures(model):
        visit(getattr(model, name))
    for record in (model.controls, model.state):
        state.update(str(record.dtype.descr).encode())
    return state.hexdigest()


# What a compiled function may find outside itself.
_COUNTS = python.FunctionType | tuple | list | np.ndarray | np.generic | int | float | str


def _rounded(value: np.ndarray | np.generic) -> np.ndarray:
    """Return floats rounded to `DIGITS` significant digits, and anything else unchanged."""
    if value.dtype.kind != "f":
        return np.asarray(value)
    texts = [f"{number:.{DIGITS - 1}e}" for number in np.ravel(value).tolist()]
    return np.array(texts, dtype=float).astype(value.dtype).reshape(value.shape)


def _inner(code: python.CodeType) -> Iterator[python.CodeType]:
    for each in code.co_consts:
        if isinstance(each, python.CodeType):
            yield each
            yield from _inner(each)


@cache
def _text(_path: str, code: python.CodeType) -> str:
    """Return the source of a function as Python reads it.

    Code equals that of another file which differs in decorators and defaults only, so the path
    belongs to what is remembered.
    """
    text = textwrap.dedent(inspect.getsource(code))
    try:
        return bare(text)
    except SyntaxError:  # a lambda within a statement
        return text


def bare(text: str) -> str:
    """Return source without comments, layout and docstrings."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef) and ast.get_docstring(
            node
        ):
            node.body[0] = ast.Pass()
    return ast.unparse(tree)


# --- All simulations ------------------------------------------------------------------------------


def live() -> list[str]:
    """Return the simulations that run in a page, as dotted paths below course.simulations."""
    return [name for name in names() if name not in RECORDED and not model(name).recorded]


def stale(name: str) -> bool:
    """Return whether the module of a simulation is missing or was made from other sources."""
    path = file_of(name)
    return not path.exists() or read_sources(path.read_bytes()).get("fingerprint") != fingerprint(
        model(name)
    )


def build(name: str) -> bytes:
    """Return the module of a simulation, compiled in this process.

    It imports no other simulation; see `compiler.compiled`.

    Raises:
        RuntimeError: its functions can't be compiled, or the module is too large.
    """
    made = importlib.import_module(f"course.simulations.{name}").MODEL
    takes = signatures(made)
    module = compiler.compiled({each: (getattr(made, each), takes[each]) for each in takes})
    sources = {
        "fingerprint": fingerprint(made),
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        # Numba reads bytecode, which differs between versions of Python.
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "linker": compiler.linker()[1],
    }
    module = compiler.with_custom(module, "sources", json.dumps(sources).encode())
    if (packed := len(gzip.compress(module))) > largest(name):
        raise RuntimeError(f"{name} has {packed} bytes packed, allowed are {largest(name)}")
    return module


def largest(name: str) -> int:
    """Return how many bytes the module of a simulation may have, packed with gzip."""
    return LARGEST + MORE.get(name, 0)


def rebuilt(name: str) -> bytes:
    """Return the module of a simulation, compiled in a fresh process; see `build`."""
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=fresh) as pool:
        return pool.submit(build, name).result()


def main(chosen: Sequence[str]) -> int:
    """Compile these simulations, or all that are stale, and write them; return how many failed."""
    unknown = sorted(set(chosen) - set(live()))
    if unknown:
        print(f"no live simulation: {', '.join(unknown)}; there are {', '.join(live())}")
        return 2
    failed = 0
    for name in chosen or filter(stale, live()):
        start = time.perf_counter()
        try:
            module = rebuilt(name)
        except (RuntimeError, NumbaError) as error:
            failed += 1
            print(f"{name}: {error}", file=sys.stderr, flush=True)
            continue
        file_of(name).write_bytes(module)
        packed, seconds = len(gzip.compress(module)), time.perf_counter() - start
        print(f"{name}: {len(module):,} bytes, {packed:,} packed, {seconds:.0f} s", flush=True)
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
