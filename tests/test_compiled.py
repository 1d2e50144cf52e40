"""Compiled code is found again by the next process, and not when a source it contains changed."""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.slow


MODULE = """
from numba import float64
from numba.extending import register_jitable
from course.compiled import compiled

from {package}.inner import inner

def outer(x):
    return 2.0 * inner(x)

f = compiled(outer, float64(float64))
print(f(3.0), sum(f.stats.cache_hits.values()), sum(f.stats.cache_misses.values()))
"""
INNER = """
from numba.extending import register_jitable

@register_jitable
def inner(x):
    return x + {number}
"""


def run(package: Path, cache: Path, extra: dict[str, str] | None = None) -> list[float]:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "COURSE_QUIET": "1"} | (extra or {})
    environment["PYTHONPATH"] = str(package.parent)
    result = subprocess.run(
        [sys.executable, "-m", "course.outer"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
        cwd=package.parent,
    )
    return [float(word) for word in result.stdout.split()]


def copy_of_the_package(tmp_path: Path) -> Path:
    """A package named course that holds the real compiled.py and two small modules."""
    source = Path(__file__).parents[1] / "course" / "compiled.py"
    package = tmp_path / "course"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "compiled.py").write_text(source.read_text())
    (package / "outer.py").write_text(MODULE.format(package="course"))
    (package / "inner.py").write_text(INNER.format(number="1.0"))
    return package


@pytest.mark.prove
def test_cache_is_used_by_the_next_process_and_dropped_when_a_callee_changes(tmp_path) -> None:
    package, cache = copy_of_the_package(tmp_path), tmp_path / "cache"
    assert run(package, cache) == [8.0, 0, 1]
    assert run(package, cache) == [8.0, 1, 0]
    # Only the inner module changes; numba alone would go on with the old machine code.
    (package / "inner.py").write_text(INNER.format(number="5.0"))
    assert run(package, cache) == [16.0, 0, 1]
    assert len(list((cache / "compiled").iterdir())) == 2


@pytest.mark.prove
def test_a_cache_is_dropped_when_recorded_numbers_change(tmp_path) -> None:
    """Machine code holds the arrays of its module as constants."""
    package, cache = copy_of_the_package(tmp_path), tmp_path / "cache"
    for number in (1.0, 2.0):
        np.savez(package / "recorded.npz", number=number)
        assert run(package, cache) == [8.0, 0, 1]
        assert run(package, cache) == [8.0, 1, 0]


@pytest.mark.prove
def test_old_caches_are_removed(tmp_path) -> None:
    package, cache = copy_of_the_package(tmp_path), tmp_path / "cache"
    assert run(package, cache) == [8.0, 0, 1]
    (mine,) = (cache / "compiled").iterdir()
    for number in range(6):
        old = cache / "compiled" / f"{number:016x}"
        old.mkdir()
        os.utime(old, (number, number))
    assert run(package, cache) == [8.0, 1, 0]
    remaining = {path.name for path in (cache / "compiled").iterdir()}
    assert remaining == {mine.name, *(f"{number:016x}" for number in (3, 4, 5))}


def test_without_compilation_the_function_itself_comes_back() -> None:
    code = (
        "from course.compiled import compiled, function_argument; from numba import float64\n"
        "def f(x): return x\n"
        "print(compiled(f, float64(float64)) is f, function_argument(f) is f)"
    )
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    out = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    assert out.stdout.split() == ["True", "True"]


@pytest.mark.prove
def test_a_compilation_announces_itself_unless_told_not_to(tmp_path) -> None:
    """Slow compilations print one line; the threshold is lowered so that this one is slow."""
    package = copy_of_the_package(tmp_path)
    text = (package / "compiled.py").read_text()
    (package / "compiled.py").write_text(
        text.replace("_ANNOUNCE_AFTER = 0.5", "_ANNOUNCE_AFTER = 0")
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "c"), "PYTHONPATH": str(tmp_path)}
    environment.pop("COURSE_QUIET", None)
    command = [sys.executable, "-m", "course.outer"]
    loud = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert loud.stderr.count("compiling outer (once") == 1
    result = subprocess.run(  # loading is no compilation, however long it takes
        command, env=environment, capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert result.stderr == ""
    quiet = subprocess.run(
        command,
        env=environment | {"COURSE_QUIET": "1", "NUMBA_CACHE_DIR": str(tmp_path / "d")},
        capture_output=True,
        text=True,
        check=True,
        cwd=tmp_path,
    )
    assert quiet.stderr == ""


@pytest.mark.prove
def test_who_comes_second_waits_for_who_compiles(tmp_path) -> None:
    package, cache = copy_of_the_package(tmp_path), tmp_path / "cache"
    assert run(package, cache) == [8.0, 0, 1]
    (lock,) = cache.rglob("outer.outer.lock")
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(tmp_path)}
    environment.pop("COURSE_QUIET", None)
    with open(lock, "w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        second = subprocess.Popen(
            [sys.executable, "-m", "course.outer"],
            env=environment,
            cwd=tmp_path,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert second.stderr is not None
        assert second.stderr.readline().startswith("compiling outer")  # it waits, and says so
        with pytest.raises(subprocess.TimeoutExpired):
            second.wait(timeout=5)
    assert second.communicate()[0].split() == ["8.0", "1", "0"]


@pytest.mark.prove
def test_a_process_that_was_killed_while_it_wrote_leaves_no_broken_cache(tmp_path) -> None:
    package, cache = copy_of_the_package(tmp_path), tmp_path / "cache"
    run(package, cache)
    # numba names a file in its index before it writes that file.
    (data,) = cache.rglob("*.nbc")
    data.rename(data.with_name(data.name + ".tmp.0123456789abcdef"))
    assert run(package, cache) == [8.0, 0, 1]
    assert run(package, cache) == [8.0, 1, 0]
