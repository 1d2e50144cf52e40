"""Compile the hot loops of the course in reading order, so that nobody waits for them later.

`python -m tools.warm` (or `make warm`) calls `warm()` of each chapter that has one, in as many
processes as there are cores.
`--background` leaves that to a process of its own and returns at once: it has the lowest priority,
writes nothing and ends by itself, whatever becomes of the caller. Ended half-way it leaves what it
has compiled so far: numba puts each finished file in its place in one go, and what was not written
is compiled again. A reader who needs a function meanwhile waits for it, or compiles it
(`course.compiled`).
"""

import argparse
import importlib
import importlib.util
import multiprocessing
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

from course import CHAPTERS

ROOT = Path(__file__).resolve().parent.parent

# What stands beside the chapters is read with one of them.
READ_WITH = {"sim_to_real": ("vector_env",)}
# What belongs to no chapter: the simulations, and the learner's robot in the package `drills`.
ELSEWHERE = {"simulations": "course.simulations", "robot": "drills.robot.compiled"}


def module_of(topic: str) -> str:
    """Return the name of the module whose `warm()` makes a topic ready."""
    return ELSEWHERE.get(topic, f"course.{topic}")


def topics() -> list[str]:
    """Return what there is to compile, in reading order."""
    result = []
    for chapter in CHAPTERS:
        result += [*READ_WITH.get(chapter.topic, ()), chapter.topic]
    # The code of a chapter may be there before its notebook.
    result = [
        topic for topic in (*result, *ELSEWHERE) if importlib.util.find_spec(module_of(topic))
    ]
    return [topic for topic in result if hasattr(importlib.import_module(module_of(topic)), "warm")]


class Warmed(NamedTuple):
    """What it took to make the loops of a topic ready."""

    topic: str
    seconds: float  # on the clock [s]
    functions: int  # compiled, or loaded from the disk cache
    processor: float  # processor time of compiling or loading them [s]


def warm_topic(name: str) -> Warmed:
    """Compile the hot loops of one topic, or load them from the disk cache."""
    from course.compiled import COMPILE_SECONDS

    known = set(COMPILE_SECONDS)
    start = time.perf_counter()
    importlib.import_module(module_of(name)).warm()
    seconds = time.perf_counter() - start
    new = [spent for key, spent in COMPILE_SECONDS.items() if key not in known]
    return Warmed(name, seconds, len(new), sum(new))


def warm(names: list[str], jobs: int = 1) -> Iterator[Warmed]:
    """Make the hot loops of these topics ready, and yield what each took.

    Args:
        names: the topics.
        jobs: how many processes share the work. A loop that two topics need is compiled once
            (`course.compiled` locks it).
    """
    if jobs == 1:
        yield from map(warm_topic, names)
        return
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        yield from pool.map(warm_topic, names)


def start_in_background(names: list[str]) -> subprocess.Popen[bytes]:
    """Start a process that warms these topics, or all, at the lowest priority."""
    return subprocess.Popen(
        [sys.executable, "-m", "tools.warm", "--gently", *names],
        cwd=ROOT,
        env={**os.environ, "COURSE_QUIET": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # an interrupt of the caller is not meant for it
    )


def main(arguments: list[str] | None = None) -> None:
    """Warm the cache and print what it took."""
    parser = argparse.ArgumentParser(prog="python -m tools.warm", description=main.__doc__)
    parser.add_argument("topics", nargs="*", help="which, such as rigid_body; default: all")
    parser.add_argument("--background", action="store_true", help="start it and return at once")
    parser.add_argument("--gently", action="store_true", help="at the lowest priority")
    given = parser.parse_args(arguments)
    if given.background:
        start_in_background(given.topics)
        return
    if given.gently:
        os.nice(19)
    known = topics()
    if unknown := sorted(set(given.topics) - set(known)):
        parser.error(f"topics must be {', '.join(known)}, got {', '.join(unknown)}")
    names = given.topics or known
    jobs = 1 if given.gently else min(len(names), os.cpu_count() or 1)
    for done in warm(names, jobs):
        print(
            f"{done.topic}: {done.functions} compiled functions ready in {done.seconds:.1f} s "
            f"({done.processor:.1f} s of processor time)",
            flush=True,
        )


if __name__ == "__main__":
    main()
