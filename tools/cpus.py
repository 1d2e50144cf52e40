"""Run a command as on an older x86-64 CPU, to see that nothing depends on the CPU.

    python -m tools.cpus nehalem -- python -m course.derivations
    python -m tools.cpus list

The numerical libraries look at the CPU and pick their code: OpenBLAS and MKL sum in another order,
NumPy and PyTorch use wider vectors, Numba compiles for the CPU's own instructions, and the C
library's `sin`, `cos`, `exp`, `log` and `pow` use fused multiply-adds where the CPU has them. Each
choice changes last digits. Environment variables override all of these choices:

- `nehalem` (2008) has SSE4.2 and neither AVX nor fused multiply-adds. Numba compiles for the first
  x86-64 CPUs, which are older still.
- `haswell` (2013) has AVX2 and fused multiply-adds, and no AVX-512. Most machines compute so.
- `farthest` picks the one of the two that differs most from the machine it runs on. That is
  `nehalem` on every machine. With AVX-512 or AVX2 it takes away most. Without AVX2 a Haswell cannot
  be emulated, because the variables only take instructions away. A machine without AVX is a Nehalem
  itself, and the printed line then says that nothing was taken away.

What they cannot change are libraries that were compiled for one CPU: MuJoCo, Pinocchio, OMPL and
Open3D compute the same under each of them, and as on the machine itself.
"""

import json
import os
import platform
import shutil
import subprocess
import sys

import click

# What a Haswell has of the features that NumPy chooses by: by the names of NumPy 2.4 and newer
# first, then by those of older versions.
_HASWELL = {"X86_V3"} | {"SSSE3", "SSE41", "POPCNT", "SSE42", "AVX", "F16C", "FMA3", "AVX2"}

# The choices of OpenBLAS, MKL, PyTorch, oneDNN (PyTorch's convolutions), Numba and the C library of
# GNU. Numba adds the machine's own features to those of a named CPU unless it is given some; the
# one here is among a Haswell's anyway. In the last variable the names with _Usable are those of
# glibc before version 2.33.
_SETTINGS = {
    "nehalem": {
        "OPENBLAS_CORETYPE": "Nehalem",
        "MKL_CBWR": "COMPATIBLE",
        "ATEN_CPU_CAPABILITY": "default",
        "ONEDNN_MAX_CPU_ISA": "SSE41",
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CPU_FEATURES": "-avx",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,"
        "-AVX_Usable,-AVX2_Usable,-FMA_Usable,-FMA4_Usable",
    },
    "haswell": {
        "OPENBLAS_CORETYPE": "Haswell",
        "MKL_CBWR": "AVX2",
        "ATEN_CPU_CAPABILITY": "avx2",
        "ONEDNN_MAX_CPU_ISA": "AVX2",
        "NUMBA_CPU_NAME": "haswell",
        "NUMBA_CPU_FEATURES": "+avx2",
        "GLIBC_TUNABLES": "",
    },
}
NAMES = tuple(_SETTINGS)
_NUMPY = "NPY_DISABLE_CPU_FEATURES"
_ASK_NUMPY = """
import json
from numpy._core import _multiarray_umath as numpy
has = sorted(name for name, there in numpy.__cpu_features__.items() if there)
print(json.dumps([has, [name for name in numpy.__cpu_dispatch__ if name in has]]))
"""


def features() -> tuple[set[str], list[str]]:
    """Return the features of this machine's CPU that NumPy knows, and those that it chooses by.

    They are read in a process without the variables of an emulation, so that one may be started
    within another.
    """
    variables = {_NUMPY, *_SETTINGS["nehalem"]}
    plain = {name: value for name, value in os.environ.items() if name not in variables}
    done = subprocess.run(
        [sys.executable, "-c", _ASK_NUMPY], env=plain, capture_output=True, text=True, check=True
    )
    has, chosen_by = json.loads(done.stdout)
    return set(has), chosen_by


def environment(name: str) -> dict[str, str]:
    """Return the environment variables under which this machine computes like another CPU.

    Args:
        name: one of `NAMES`.

    Raises:
        ValueError: for an unknown name, and for a CPU whose instructions this machine lacks.
    """
    if name not in NAMES:
        raise ValueError(f"name must be one of {', '.join(NAMES)}, got {name!r}")
    if platform.machine().lower() not in ("x86_64", "amd64"):
        raise ValueError(f"name {name!r} is an x86-64 CPU, and this one is {platform.machine()}")
    has, chosen_by = features()
    if name == "haswell" and "AVX2" not in has:
        raise ValueError("name 'haswell' needs a CPU with AVX2, which this one lacks; try nehalem")
    selected = _HASWELL if name == "haswell" else set()
    # NumPy warns about features that it does not know or the machine does not have.
    disabled = " ".join(feature for feature in chosen_by if feature not in selected)
    return {**_SETTINGS[name], _NUMPY: disabled}


def farthest() -> str:
    """Return the name of the CPU that differs most from this machine; see the top of this file."""
    return "nehalem"


def describe(name: str, variables: dict[str, str]) -> str:
    """Return the line that says which CPU is emulated."""
    removed = variables[_NUMPY] or "nothing: the machine has no more than that"
    return f"computing as on a {name.capitalize()} CPU; taken away from NumPy: {removed}"


@click.command(context_settings={"ignore_unknown_options": True})
@click.argument("cpu", type=click.Choice([*NAMES, "farthest", "list"]))
@click.argument("command", nargs=-1, type=click.UNPROCESSED)
def main(cpu: str, command: tuple[str, ...]) -> None:
    """Run COMMAND as on another CPU and end with its exit code; with "list", print the variables.

    Example: python -m tools.cpus nehalem -- python -m course.derivations
    """
    if cpu == "list":
        if command:
            raise click.UsageError("list runs no command")
        for name in NAMES:
            try:
                lines = [f"  {key}={value}" for key, value in environment(name).items()]
            except ValueError as problem:
                lines = [f"  {problem}"]
            click.echo("\n".join([name, *lines]))
        return
    if not command:
        raise click.UsageError("there is no command; write it after --")
    name = farthest() if cpu == "farthest" else cpu
    try:
        variables = environment(name)
    except ValueError as problem:
        raise click.ClickException(str(problem)) from None
    click.echo(describe(name, variables), err=True)
    if not shutil.which(command[0]):
        click.echo(f"{command[0]}: command not found", err=True)
        sys.exit(127)
    os.execvpe(command[0], list(command), {**os.environ, **variables})


if __name__ == "__main__":
    main()
