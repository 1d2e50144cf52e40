"""The controller in C++: compiled with all warnings as errors and with sanitizers, and driven.

`cpp/arm_controller.cpp` has ros2_control's shape, `cpp/callback_controller.cpp` the common form.
`torques` is the same law here.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import vector

Array = NDArray[np.float64]
SOURCE = Path(__file__).parent / "cpp" / "drive.cpp"
# No fused multiply-add: each operation is rounded by itself, as NumPy's is.
FLAGS = (
    "-std=c++17 -O1 -g -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Werror -ffp-contract=off"
    " -fsanitize=address,undefined -fno-sanitize-recover=all"
).split()

# What the driver prints before it ends by itself.
REFUSALS = ("on_configure failed", "on_activate failed")


def torques(
    position: ArrayLike,
    velocity: ArrayLike,
    target: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    limit: ArrayLike,
) -> Array:
    """Return stiffness (target - position) - damping velocity, cut off at +-limit; all shape (n,).

    Units: [rad], [rad/s], [rad], [N m/rad], [N m s/rad], [N m]; returns [N m].
    """
    q = vector("position", position, (None,))
    v, goal, k, d = (
        vector(name, value, q.shape)
        for name, value in (
            ("velocity", velocity),
            ("target", target),
            ("stiffness", stiffness),
            ("damping", damping),
        )
    )
    largest = vector("limit", limit, q.shape, low=0.0)
    # PD law about a fixed target, saturated at the actuator's limit.
    return np.clip(k * (goal - q) - d * v, -largest, largest)


NO_COMPILER = "this needs a C++ compiler: apt-get install g++"


def compiler() -> str | None:
    """Return the C++ compiler of this machine (CXX, g++ or clang++), or None."""
    names = (os.environ.get("CXX", ""), "g++", "clang++")
    return next((result for name in names if name and (result := shutil.which(name))), None)


def build(folder: Path) -> Path:
    """Compile the driver with both controllers into `folder`.

    Raises:
        FileNotFoundError: there is no compiler.
        RuntimeError: it did not compile; the text is the compiler's.
    """
    if (name := compiler()) is None:
        raise FileNotFoundError(NO_COMPILER)
    made = folder / "drive"
    # Sanitizers report memory errors and undefined behaviour at run time; the compiler's
    # warnings are errors.
    done = subprocess.run(
        [name, *FLAGS, str(SOURCE), "-o", str(made)], capture_output=True, text=True, timeout=300
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    return made


@dataclass(frozen=True)
class Driven:
    """What came of the rows.

    Attributes:
        code: of the process: 0, or what the sanitizer or a refusal made of it.
        good: of each row, whether the controller was content.
        allocations: in each row, inside update or the callback.
        torque: of each row [N m].
        report: the first line of the sanitizer that names the fault, or why the controller was
            not started, or "".
    """

    code: int
    good: list[bool]
    allocations: list[int]
    torque: list[list[float]]
    report: str


def drive(
    program: Path,
    mode: str,
    first: Sequence[Sequence[float]] | Array,
    rows: Sequence[Sequence[float]] | Array,
) -> Driven:
    """Run one of the controllers.

    Args:
        program: what `build` made.
        mode: "update" or "callback".
        first: for "update" the target, stiffness, damping and limit; for "callback" the targets.
        rows: for "update" positions and velocities in each row; for "callback" the number of
            positions, those, the number of velocities, those.

    Raises:
        RuntimeError: the program ended early and neither the sanitizer nor the controller says
            why; the text is what it printed.
    """
    # 17 significant digits represent a double exactly, so that both languages compute with the same
    # numbers.
    text = "\n".join(" ".join(f"{value:.17g}" for value in row) for row in (*first, *rows))
    done = subprocess.run(
        [str(program), mode, str(len(first[0])), str(len(rows))],
        input=text,
        capture_output=True,
        text=True,
        timeout=60,
    )
    result = [line.split() for line in done.stdout.splitlines()]
    faults = [line for line in done.stderr.splitlines() if "ERROR: " in line or "error: " in line]
    # An early end without a reason from the sanitizer or the controller is a fault of the tool
    # itself.
    if done.returncode and not faults and not done.stderr.startswith(REFUSALS):
        reason = done.stderr.strip() or "it printed nothing"
        hint = ""
        if "initial library list" in done.stderr:
            hint = " (unset LD_PRELOAD)"
        raise RuntimeError(f"{program.name} ended with code {done.returncode}: {reason}{hint}")
    return Driven(
        done.returncode,
        [line[0] == "1" for line in result],
        [int(line[1]) for line in result],
        [[float(value) for value in line[2:]] for line in result],
        faults[0].split("ror: ")[-1].split("ERROR: ")[-1] if faults else done.stderr.strip(),
    )
