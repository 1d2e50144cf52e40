"""An emulated CPU is really in force, and what depends on the CPU says so."""

import json
import os
import subprocess
import sys
from typing import Any

import pytest
from click.testing import CliRunner

from tests.budget import ROOT
from tools import cpus

pytestmark = pytest.mark.skipif(
    cpus.platform.machine() not in ("x86_64", "AMD64"), reason="emulates x86-64 CPUs only"
)

# What the libraries report, in one process that imports them all. OpenBLAS has no Python interface:
# NumPy and SciPy each bring one, found among the libraries that the process has loaded.
REPORT = """
import ctypes, json, math, re
import numba, numpy as np, scipy.linalg, torch
from numpy._core import _multiarray_umath as umath

cores = set()
for path in set(re.findall(r"/[^ ]*openblas[^ ]*[.]so[^ \\n]*", open("/proc/self/maps").read())):
    library = ctypes.CDLL(path)
    for name in ("scipy_openblas_get_corename", "scipy_openblas_get_corename64_"):
        if function := getattr(library, name, None):
            function.restype = ctypes.c_char_p
            cores.add(function().decode())

@numba.njit
def double(values):
    for i in range(values.size):
        values[i] *= 2.0

double(np.ones(4))
(assembly,) = double.inspect_asm().values()
x = np.random.default_rng(0).uniform(-10.0, 10.0, 20_000).tolist()
print(json.dumps({
    "numpy": [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__[name]],
    "openblas": sorted(cores),
    "torch": torch.backends.cpu.get_cpu_capability(),
    "registers": [name for name in ("ymm", "zmm") if name in assembly],
    "sines": [math.sin(value) for value in x],
}))
"""


def run(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tools.cpus", *words], cwd=ROOT, capture_output=True, text=True
    )


def reported(*words: str) -> dict[str, Any]:
    done = run(*words, "--", sys.executable, "-c", REPORT)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.prove
def test_a_nehalem_is_in_force_in_every_library() -> None:
    result = reported("nehalem")
    assert result["numpy"] == []
    assert result["openblas"] == ["Nehalem"]
    assert result["torch"] == "DEFAULT"
    assert result["registers"] == []


@pytest.mark.prove
def test_a_haswell_is_in_force_in_every_library_even_within_a_nehalem() -> None:
    if "AVX2" not in cpus.features()[0]:
        pytest.skip("this CPU has no AVX2")
    result = reported("nehalem", "--", sys.executable, "-m", "tools.cpus", "haswell")
    assert not any("AVX512" in name or name == "X86_V4" for name in result["numpy"])
    assert result["numpy"]
    assert result["openblas"] == ["Haswell"]
    assert result["torch"] == "AVX2"
    assert "zmm" not in result["registers"]


@pytest.mark.prove
def test_the_sines_of_the_c_library_differ_between_the_two() -> None:
    """Its own choice needs a variable too: with fused multiply-adds the last bit differs."""
    if "FMA3" not in cpus.features()[0]:
        pytest.skip("this CPU has no fused multiply-add")
    one, other = (reported(name)["sines"] for name in ("nehalem", "haswell"))
    assert one != other
    assert max(abs(a - b) for a, b in zip(one, other, strict=True)) < 1e-15


def test_the_farthest_differs_from_this_machine_unless_it_is_a_nehalem() -> None:
    name, (has, chosen_by) = cpus.farthest(), cpus.features()
    assert name == "nehalem"
    removed = cpus.environment(name)["NPY_DISABLE_CPU_FEATURES"].split()
    assert removed == chosen_by and set(removed) <= has
    assert bool(removed) == ("AVX2" in has)


def test_the_command_gets_its_words_and_its_exit_code_comes_back() -> None:
    code = "import sys; print(sys.argv[1:]); sys.exit(3)"
    done = run("farthest", "--", sys.executable, "-c", code, "--x", "--", "list")
    assert done.returncode == 3
    assert done.stdout == "['--x', '--', 'list']\n"
    assert done.stderr.startswith("computing as on a Nehalem CPU")
    assert done.stderr.count("\n") == 1
    assert run("nehalem", "--", "no-such-command").returncode == 127
    assert run("nehalem").returncode == 2
    assert run("pentium", "--", "true").returncode == 2


def test_list_prints_the_variables_of_each() -> None:
    done = run("list")
    assert done.returncode == 0
    names = [line for line in done.stdout.splitlines() if not line.startswith(" ")]
    assert names == list(cpus.NAMES)
    for key, value in cpus.environment("nehalem").items():
        assert f"  {key}={value}" in done.stdout.splitlines()


def test_an_unknown_or_impossible_cpu_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ValueError, match="name must be one of nehalem, haswell, got 'pentium'"):
        cpus.environment("pentium")
    monkeypatch.setattr(cpus, "features", lambda: ({"SSE42"}, []))
    with pytest.raises(ValueError, match="needs a CPU with AVX2"):
        cpus.environment("haswell")
    assert "nothing" in cpus.describe("nehalem", cpus.environment("nehalem"))
    done = CliRunner().invoke(cpus.main, ["haswell", "--", "true"])
    assert done.exit_code == 1 and "needs a CPU with AVX2" in done.output
    monkeypatch.setattr(cpus.platform, "machine", lambda: "aarch64")
    with pytest.raises(ValueError, match="this one is aarch64"):
        cpus.environment("nehalem")


def test_features_are_those_of_the_machine_within_an_emulation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    native = cpus.features()
    for name, value in cpus.environment("nehalem").items():
        monkeypatch.setitem(os.environ, name, value)
    assert cpus.features() == native
