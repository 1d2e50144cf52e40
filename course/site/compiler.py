"""Numba's code for WebAssembly instead of this machine: functions as one module.

A target context of its own, whose code generator knows the processor wasm32, takes the place of
Numba's: no native code is made in this process from then on. The whole program is linked to
`arena.ll`, optimised at once, and made a module by `wasm-ld`, of the `ziglang` wheel or the system.

These are internals of Numba 0.68: `tests/site/test_compiler.py` says which.
"""

import inspect
import re
import shutil
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba
from llvmlite import ir
from numba import types
from numba.core import callconv, cgutils, codegen, lowering
from numba.core.compiler_lock import global_compiler_lock
from numba.core.cpu import CPUContext
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys

# What a module may ask of its host, besides memory: functions of the C library.
MATHS = frozenset(
    "acos acosh asin asinh atan atan2 atanh cbrt cos cosh exp exp2 expm1 fmod hypot log log10 log1p"
    " log2 pow sin sinh tan tanh".split()
)
ARENA = Path(__file__).with_name("arena.ll")

_TRIPLE = "wasm32-unknown-unknown"
_FEATURES = "+bulk-memory,+mutable-globals,+nontrapping-fptoint,+sign-ext"
_STACK = 1 << 17  # bytes; below everything else, so that an overflow traps

# --- Numba, with another processor ----------------------------------------------------------------


class _Module(ir.Module):
    """Notes from where in the source a function asked for another one."""

    places: dict[tuple[str, str], str] = {}  # noqa: RUF012

    def add_global(self, globalvalue: Any) -> None:
        super().add_global(globalvalue)
        function, place = _being_compiled()
        self.places[function, globalvalue.name] = place


def _being_compiled() -> tuple[str, str]:
    """Return the function that Numba is at: its name in the code, and where in the source."""
    frame = inspect.currentframe()
    # Numba passes no position on: it is read from the lowering object up the call stack.
    while frame and not isinstance(frame.f_locals.get("self"), lowering.BaseLower):
        frame = frame.f_back
    if not frame:
        return "", ""
    lower = frame.f_locals["self"]
    line = getattr(lower.loc, "line", "")  # no place before the first statement
    made = lower.fndesc
    return made.mangled_name, f"{made.modname}.{made.qualname}, line {line}"


class _Library(codegen.CPUCodeLibrary):
    """Collects code as Numba has made it; nothing is optimised before all of it is there."""

    # Numba would optimise each function for itself; here LLVM gets the whole module at once.
    def _optimize_functions(self, ll_module: Any) -> None:
        pass

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalized = True


class _Codegen(codegen.CPUCodegen):
    _library_class = _Library

    def _init(self, llvm_module: Any) -> None:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        target = llvm.Target.from_triple(_TRIPLE)
        # Static relocation: a module is linked once and loaded at a fixed place in its own memory.
        self.machine = target.create_target_machine(
            features=_FEATURES, opt=3, reloc="static", codemodel="default"
        )
        self._target_data = self.machine.target_data
        self._data_layout = str(self._target_data)
        self._tm_features = _FEATURES

    def _create_empty_module(self, name: str) -> ir.Module:
        module = _Module(cgutils.normalize_ir_text(name))
        module.triple, module.data_layout = _TRIPLE, self._data_layout or ""
        return module

    def _add_module(self, module: Any) -> None:
        raise AssertionError("nothing is run here")

    def _get_host_cpu_name(self) -> str:
        return "generic"


class _CallConv(callconv.CPUCallConv):
    """Errors as messages, where Numba's own are pickled Python objects."""

    def set_static_user_exc(
        self, builder: Any, exc: Any, exc_args: Any = None, loc: Any = None, func_name: Any = None
    ) -> None:
        # Compiled code has no interpreter that could unpickle an exception: store the text instead.
        text = ", ".join(str(each) for each in exc_args or ()) or exc.__name__
        text = text.partition("\nFile ")[0]  # Numba adds where the source lies on this machine
        words = self.context.insert_const_string(builder.module, text)
        null, size = callconv.GENERIC_POINTER(None), len(text.encode())
        info = [words, ir.IntType(32)(size), null, null, ir.IntType(32)(0)]
        report = ir.Constant.literal_struct(info)
        place = self.context.insert_unique_const(builder.module, f".error.{text}", report)
        builder.store(place, self._get_excinfo_argument(builder.function))

    def set_dynamic_user_exc(
        self,
        builder: Any,
        exc: Any,
        exc_args: Any,
        nb_types: Any,
        loc: Any = None,
        func_name: Any = None,
    ) -> None:
        known = tuple(arg for arg in exc_args if isinstance(arg, str))
        self.set_static_user_exc(builder, exc, known)


class _Context(CPUContext):
    def init(self) -> None:
        self.is32bit = False  # what Numba means by it: an int64 is there
        self._internal_codegen = _Codegen("simulation")

    def load_additional_registries(self) -> None:
        rtsys._init = True  # the native runtime is not needed
        super().load_additional_registries()

    @property
    def call_conv(self) -> _CallConv:
        return _CallConv(self)

    def post_lowering(self, mod: Any, library: Any) -> None:
        pass

    def get_env_manager(self, builder: Any, return_pyobject: bool = False) -> Any:
        raise _not_there(_being_compiled()[1], "Python's interpreter")

    def create_cpython_wrapper(self, *args: Any, **kwargs: Any) -> None:
        pass

    def create_cfunc_wrapper(self, *args: Any, **kwargs: Any) -> None:
        pass

    def get_executable(self, library: Any, fndesc: Any, env: Any) -> Any:
        library._ensure_finalized()
        return [].append  # a built-in function that equals no other; nobody calls it


# --- One module -----------------------------------------------------------------------------------


def compiled(functions: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]]) -> bytes:
    """Return a module of functions.

    It makes Numba compile for WebAssembly until the process ends, so `wasm.rebuilt` calls it
    in a process of its own.

    Args:
        functions: each with the Numba types of what it takes, by the name to export.

    Raises:
        RuntimeError: one of them needs something that a module doesn't have.
    """
    # Numba creates its target once per process: the context must come before the first compilation.
    before = cpu_target.__dict__.get("_toplevel_target_context")
    if before is None:
        cpu_target._toplevel_target_context = _Context(cpu_target.typing_context, "cpu")
    elif not isinstance(before, _Context):
        raise RuntimeError("Numba has compiled for this machine already, so it cannot for another")
    # The arena allocator comes first; each function and its callees are linked into it.
    whole = llvm.parse_assembly(ARENA.read_text(encoding="utf-8"))
    for name, (function, takes) in functions.items():
        made = numba.njit(types.none(*takes), error_model="numpy")(function)
        (result,) = made.overloads.values()
        whole.link_in(result.library._final_module.clone())
        # The exported wrapper empties the arena, then calls the compiled function with the same
        # arguments.
        entry = whole.get_function(result.fndesc.llvm_func_name)
        _, _, kinds = str(entry.global_value_type).rstrip(")").partition("(")
        given = ", ".join(f"{kind} %{i}" for i, kind in enumerate(kinds.split(", ")))
        whole.link_in(
            llvm.parse_assembly(f"""
            declare void @empty()
            declare i32 @"{entry.name}"({kinds})
            define i32 @{name}({given}) {{
                call void @empty()
                %status = call i32 @"{entry.name}"({given})
                ret i32 %status
            }}""")
        )
    inside = [*whole.functions, *whole.global_variables]
    # All but the exports become internal, so that the optimiser may inline and remove them.
    for value in inside:
        if not value.is_declaration and value.name not in (*functions, "__multi3"):
            value.linkage = "internal"
    plain = str(whole)
    machine = cpu_target.target_context.codegen().machine
    tuning = llvm.create_pipeline_tuning_options(speed_level=2)
    # Vectorisation is switched off: the target has no SIMD instructions.
    tuning.loop_vectorization = tuning.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, tuning)
    with global_compiler_lock:
        builder.getModulePassManager().run(whole, builder)
    whole.verify()
    module = linked(machine.emit_object(whole), list(functions))
    # An import that is no function of the C library belongs to Python or to Numba's runtime.
    for name in imports(module):
        if name not in MATHS:
            raise _not_there(_caller(name, plain), name)
    return module


def _not_there(place: str, name: str) -> RuntimeError:
    return RuntimeError(f"{place or 'it'} needs {name}, which is not to be had in a browser")


def _caller(name: str, code: str) -> str:
    """Return where something is needed.

    The nearest function that is not Numba's own on the way to it.
    """
    callers: dict[str, list[str]] = {}
    for body in re.findall(r"^define .*?^}", code, re.M | re.S):
        own, *others = (a or b for a, b in re.findall(r'@(?:"([^"]+)"|([\w.$]+))', body))
        for other in others:
            callers.setdefault(other, []).append(own)
    # Breadth-first search from the missing symbol over its callers.
    queue = deque([name, f"llvm.{name}.f64"])
    observed = set(queue)
    while queue:
        callee = queue.popleft()
        for caller in callers.get(callee, ()):
            place = _Module.places.get((caller, callee), "")
            if place and not place.startswith("numba."):
                return place
            if caller not in observed:
                observed.add(caller)
                queue.append(caller)
    return ""


@cache
def linker() -> tuple[tuple[str, ...], str]:
    """Return the command of `wasm-ld`, and its version.

    Raises:
        RuntimeError: there is none.
    """
    for command in ((sys.executable, "-m", "ziglang", "wasm-ld"), ("wasm-ld",)):
        if command[0] != "wasm-ld" or shutil.which("wasm-ld"):
            done = subprocess.run([*command, "--version"], capture_output=True, text=True)
            if done.returncode == 0:
                return command, " ".join((done.stdout + done.stderr).split()[:2])
    raise RuntimeError("there is no wasm-ld: install the extra `site` or your system's lld")


def linked(code: bytes, exports: Sequence[str]) -> bytes:
    """Return an object file of LLVM's as a module with these exports."""
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "module.o"), Path(folder, "module.wasm")
        source.write_bytes(code)
        options = ["--no-entry", "--stack-first", f"-zstack-size={_STACK}", "--strip-all"]
        options += [
            "--allow-undefined",
            *(f"--export={name}" for name in ["__heap_base", *exports]),
        ]
        command = [*linker()[0], *options, str(source), "-o", str(target)]
        subprocess.run(command, check=True, capture_output=True)
        return target.read_bytes()


# --- What is in a module --------------------------------------------------------------------------


def _number(data: bytes, at: int) -> tuple[int, int]:
    """Return the unsigned LEB128 number at a place, and where it ends."""
    value = shift = 0
    while True:
        value |= (data[at] & 127) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 128:
            return value, at


def _written(value: int) -> bytes:
    # LEB128: seven bits at a time, the highest bit says that more follow.
    return bytes([value]) if value < 128 else bytes([value & 127 | 128]) + _written(value >> 7)


def _named(data: bytes, at: int) -> tuple[str, int]:
    size, at = _number(data, at)
    return data[at : at + size].decode(), at + size


def _sections(module: bytes) -> Iterator[tuple[int, bytes]]:
    # The sections begin after the magic number and the version, four bytes each.
    at = 8
    while at < len(module):
        size, begin = _number(module, at + 1)
        yield module[at], module[begin : begin + size]
        at = begin + size


def imports(module: bytes) -> list[str]:
    """Return the functions that a module takes from its host."""
    result: list[str] = []
    for kind, data in _sections(module):
        if kind == 2:
            count, at = _number(data, 0)
            for _ in range(count):
                _, at = _named(data, at)
                name, at = _named(data, at)
                _, at = _number(data, at + 1)
                result.append(name)
    return result


def custom(module: bytes, name: str) -> bytes:
    """Return the custom section of a module; empty if there is none."""
    for kind, data in _sections(module):
        if kind == 0:
            own, at = _named(data, 0)
            if own == name:
                return data[at:]
    return b""


def with_custom(module: bytes, name: str, data: bytes) -> bytes:
    """Return a module with a custom section more."""
    section = _written(len(name)) + name.encode() + data
    return module + b"\0" + _written(len(section)) + section
