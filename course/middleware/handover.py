"""The newest value from one thread to another in C++: built with sanitizers, and measured.

`cpp/newest_value.hpp` has a triple buffer without a lock, and a value behind a mutex, ordinary or
with priority inheritance. Sources: H.-J. Boehm, Can seqlocks get along with programming language
memory models?, 2012; POSIX, pthread_mutexattr_setprotocol.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

from course.check import POSITIVE, finite, one_of
from course.middleware.controller import NO_COMPILER, compiler

SOURCE = Path(__file__).parent / "cpp" / "newest_value.cpp"
FLAGS = "-std=c++17 -g -pthread -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Werror".split()
SANITIZERS = ("", "thread", "address,undefined")
METHODS = {
    "none": "a copy, not shared",
    "triple": "triple buffer",
    "inherit": "mutex with inheritance",
    "mutex": "std::mutex",
}
SCENARIOS = ("alone", "loaded", "preempted")
SHARES = (0.5, 0.99, 0.999, 1.0)  # of the calls


def build(folder: Path, sanitizer: str = "", source: Path = SOURCE) -> Path:
    """Compile the program that checks and measures the buffers.

    Args:
        folder: where it is put.
        sanitizer: one of `SANITIZERS`; "" to measure.
        source: of the program, beside the header that it includes.

    Raises:
        FileNotFoundError: there is no compiler.
        RuntimeError: it did not compile; the text is the compiler's.
    """
    one_of("sanitizer", sanitizer, SANITIZERS)
    if (name := compiler()) is None:
        raise FileNotFoundError(NO_COMPILER)
    made = folder / f"newest_value_{sanitizer.replace(',', '_')}"
    with_it = [f"-fsanitize={sanitizer}", "-fno-sanitize-recover=all"] if sanitizer else []
    done = subprocess.run(
        [name, *FLAGS, "-O1" if sanitizer else "-O2", *with_it, str(source), "-o", str(made)],
        capture_output=True,
        text=True,
        timeout=300,
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    return made


def check(program: Path, method: str, count: int = 20_000) -> subprocess.CompletedProcess[str]:
    """Write `count` values in one thread and read them in another.

    Returns:
        The process: its code is 0, 1 to 4 for a fault that the program names, or the sanitizer's,
        whose report is in `stderr`.
    """
    # The thread sanitizer needs fixed addresses; newer kernels shuffle them farther.
    fixed = ["setarch", "-R"] if shutil.which("setarch") else []
    return subprocess.run(
        [*fixed, str(program), "check", method, str(count)],
        capture_output=True,
        text=True,
        timeout=120,
    )


@dataclass(frozen=True)
class Latency:
    """How long the calls of two threads took.

    Attributes:
        read, written: times below which `SHARES` of the calls lie, shape (4,) each [s].
        reads, writes: how many calls.
        urgent: whether the reader ran under SCHED_FIFO.
    """

    read: tuple[float, ...]
    written: tuple[float, ...]
    reads: int
    writes: int
    urgent: bool


def latency(program: Path, method: str, scenario: str, seconds: float = 1.0) -> Latency:
    """Let a reader of 2 kHz and a writer without a pause share a trajectory of 5.6 kB.

    Args:
        program: what `build` made, without a sanitizer.
        method: one of `METHODS`.
        scenario: "alone"; "loaded", two busy threads on each core; "preempted", one busy thread
            beside the writer on its core.
        seconds: for how long.

    Raises:
        RuntimeError: the program failed; the text is what it printed.
    """
    one_of("method", method, tuple(METHODS))
    one_of("scenario", scenario, SCENARIOS)
    duration = finite("seconds", seconds, POSITIVE, 60.0, unit="s")
    cores = sorted(os.sched_getaffinity(0))
    done = subprocess.run(
        [str(program), "latency", method, scenario, str(duration), str(cores[0]), str(cores[-1])],
        capture_output=True,
        text=True,
        timeout=120,
    )
    if done.returncode:
        raise RuntimeError(f"code {done.returncode}: {done.stderr}")
    read, written, urgent = (list(map(int, line.split())) for line in done.stdout.splitlines())
    return Latency(
        tuple(1e-9 * x for x in read[1:]),
        tuple(1e-9 * x for x in written[1:]),
        read[0],
        written[0],
        bool(urgent[0]),
    )
