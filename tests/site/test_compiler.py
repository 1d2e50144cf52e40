"""Numba's code as a module: what it computes, what it takes, and what it refuses."""

import fcntl
import inspect
import multiprocessing
import os
import pickle
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
import pytest
from numba import types
from numba.core import callconv, codegen, lowering
from numba.core.cpu import CPUContext
from numba.core.registry import CPUTarget
from numba.core.runtime import rtsys

from course.site import compiler
from tests.site import pieces
from tests.site.host import Instance, array

pytestmark = pytest.mark.slow

# What the compiler replaces or uses inside Numba, with the arguments that it counts on.
NEEDED = {
    codegen.CPUCodeLibrary: {
        "_optimize_functions": "self ll_module",
        "_optimize_final_module": "self",
        "_finalize_final_module": "self",
        "_ensure_finalized": "self",
    },
    codegen.CPUCodegen: {
        "_init": "self llvm_module",
        "_create_empty_module": "self name",
        "_add_module": "self module",
        "_get_host_cpu_name": "self",
    },
    callconv.CPUCallConv: {
        "set_static_user_exc": "self builder exc exc_args loc func_name",
        "set_dynamic_user_exc": "self builder exc exc_args nb_types loc func_name",
        "_get_excinfo_argument": "self func",
    },
    CPUContext: {
        "init": "self",
        "load_additional_registries": "self",
        "post_lowering": "self mod library",
        "get_env_manager": "self builder return_pyobject",
        "create_cpython_wrapper": "self library fndesc env call_helper release_gil",
        "create_cfunc_wrapper": "self library fndesc env call_helper",
        "get_executable": "self library fndesc env",
        "insert_const_string": "self mod string",
        "insert_unique_const": "self mod name val",
    },
    CPUTarget: {"_toplevel_target_context": ""},
    lowering.BaseLower: {"lower_inst": "", "emit_environment_object": ""},
    type(rtsys): {"initialize": "self ctx"},
}


@pytest.mark.parametrize("owner", NEEDED, ids=lambda owner: owner.__name__)
def test_numba_still_has_what_the_compiler_reaches_into(owner: Any) -> None:
    """Fails first where a new Numba has moved it; the other tests say what then goes wrong."""
    for name, arguments in NEEDED[owner].items():
        assert hasattr(owner, name) or owner is lowering.BaseLower, f"{owner.__name__}.{name}"
        if arguments:
            result = " ".join(inspect.signature(getattr(owner, name)).parameters)
            assert result == arguments, f"{owner.__name__}.{name}"
    assert rtsys._init in (False, True) and isinstance(rtsys._init, bool)


ARRAY = types.Array(types.float64, 1, "C")


def built() -> tuple[bytes, dict[str, str]]:
    """A module of the right pieces, and what is said of each wrong one."""
    text = {}
    module = compiler.compiled({name: (each, (ARRAY,)) for name, each in pieces.RIGHT.items()})
    for name, each in pieces.WRONG.items():
        with pytest.raises(RuntimeError) as report:
            compiler.compiled({name: (each, (ARRAY,))})
        text[name] = str(report.value)
    return module, text


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """What `built` returns; of several workers one builds it, and the others wait."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base
    stored = shared / "pieces.pickle"
    with (shared / "pieces.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not stored.exists():
            fresh = multiprocessing.get_context("spawn")
            with ProcessPoolExecutor(1, mp_context=fresh) as pool:
                stored.write_bytes(pickle.dumps(pool.submit(built).result()))
    return pickle.loads(stored.read_bytes())


def run(instance: Instance, name: str, values: Any) -> Any:
    """What is in an array after a call."""
    given = np.array(values, float)
    place = instance.room(given.nbytes)
    instance.write(place, given.tobytes())
    instance.call(name, *array(place, given))
    return np.frombuffer(instance.read(place, given.nbytes))


@pytest.mark.parametrize(
    "name",
    ["arrays", *(pytest.param(x, marks=pytest.mark.prove) for x in ("maths", "lists", "wholes"))],
)
def test_a_piece_is_what_plain_python_says(made: Any, name: str) -> None:
    rng = np.random.default_rng(1)
    for _ in range(20):
        values = rng.normal(size=5) * 3.0
        plain = values.copy()
        pieces.RIGHT[name](plain)
        assert run(Instance(made[0]), name, values) == pytest.approx(plain, rel=1e-13, abs=1e-13)


def test_an_error_comes_with_its_message_and_leaves_the_rest(made: Any) -> None:
    instance = Instance(made[0])
    assert run(instance, "raises", [0.0])[0] == 1.0
    with pytest.raises(ValueError, match=r"^0 is the most — of a\[0\]$"):
        run(instance, "raises", [0.5])
    assert run(instance, "raises", [-1.0])[0] == 1.0


@pytest.mark.prove
def test_memory_grows_once_and_begins_anew_with_each_call(made: Any) -> None:
    instance = Instance(made[0])
    place = instance.room(16)
    sizes = []
    for count in (10, 4_000, 10, 4_000, 4_000):
        values = np.array([count, 0.0])
        instance.write(place, values.tobytes())
        instance.call("takes", *array(place, values))
        sizes.append(instance.size)
        expected = sum(float(k) for k in range(count))
        assert np.frombuffer(instance.read(place, 16))[1] == expected
    assert sizes[0] < 1_000_000 and sizes[1] > 4_000_000 and len(set(sizes[1:])) == 1


@pytest.mark.parametrize("count", [1e12, 2.0**29, 2.0**61, -1.0])
def test_more_memory_than_there_is_is_an_error(made: Any, count: float) -> None:
    instance = Instance(made[0])
    with pytest.raises(ValueError, match=r"[Aa]rray|[Aa]llocat|negative"):
        run(instance, "takes_at_once", [count, 0.0])
    assert run(instance, "takes_at_once", [1000.0, 0.0])[1] == 1000.0


def test_it_takes_only_functions_of_the_c_library(made: Any) -> None:
    assert {"sin", "pow", "fmod"} <= set(compiler.imports(made[0])) <= compiler.MATHS


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("solves", "solves, line {} needs numba_xgesv"),
        ("inner", "solves, line {} needs numba_xgesv"),
        ("draws", "draws, line {} needs numba_get_np_random_state"),
        ("looks_up", "looks_up, line {} needs numba_dict"),
        ("prints", "prints, line {} needs Python's interpreter"),
    ],
)
def test_what_it_cannot_have_is_told_with_its_place(made: Any, name: str, text: str) -> None:
    function = getattr(pieces, text.split(",")[0])
    lines, first = inspect.getsourcelines(function)
    line = first + len(lines) - 1  # its last one
    assert made[1][name].startswith(f"{pieces.__name__}.{text.format(line)}"), made[1][name]


def test_it_does_not_mix_with_code_for_this_machine() -> None:
    with pytest.raises(RuntimeError, match="for this machine already"):
        # This process may not have compiled anything yet.
        CPUTarget("cpu")
        from numba.core.registry import cpu_target

        assert cpu_target.target_context is not None
        compiler.compiled({})


def test_without_a_linker_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(*_: Any, **__: Any) -> Any:
        return compiler.subprocess.CompletedProcess((), 1, "", "")

    monkeypatch.setattr(compiler.subprocess, "run", absent)
    compiler.linker.cache_clear()
    with pytest.raises(RuntimeError, match="install the extra `site`"):
        compiler.linker()
    compiler.linker.cache_clear()


def test_a_custom_section_of_any_size_is_read_back() -> None:
    empty = b"\0asm\1\0\0\0"
    for size in (0, 1, 127, 128, 20_000):
        module = compiler.with_custom(compiler.with_custom(empty, "a", b"x"), "b", b"y" * size)
        assert compiler.custom(module, "b") == b"y" * size
        assert compiler.custom(module, "a") == b"x" and compiler.custom(module, "c") == b""
