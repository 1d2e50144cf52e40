"""What an engine costs before its first step: size on disk, import, loading a model, memory.

Times and memory are those of a fresh process that has imported the course already (`python -m
course.oracles.installs NAME` prints them); sizes are those of the package's own metadata.
"""

from __future__ import annotations

import importlib.metadata
import json
import resource
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from course.check import count, one_of
from course.oracles import drake, pybullet
from course.oracles.engines import engines
from course.oracles.mujoco import kit
from course.platforms import scenes

# What comes with an engine and is used by it alone.
PACKAGES = {
    "MuJoCo": ("mujoco", "mujoco-core", "mujoco-studio"),
    "Drake": ("drake", "mosek"),
    "PyBullet": ("pybullet",),
}
LIBRARIES = {"MuJoCo": kit.library, "Drake": drake.library, "PyBullet": pybullet.library}
MB = 1e6


@dataclass(frozen=True)
class Install:
    """One engine.

    Attributes:
        engine, version: its name and what is installed.
        missing: why it isn't, else "".
        size: of its packages on disk [MB], None where it isn't installed.
        import_time: of its import, the course being there [s].
        load_time: to build a chain of six links from its URDF text [s].
        memory: by which import and model raise the peak of the process [MB].
    """

    engine: str
    version: str = ""
    missing: str = ""
    size: float | None = None
    import_time: float | None = None
    load_time: float | None = None
    memory: float | None = None


def size_of(engine: str) -> float:
    """Return size of an engine's packages by their metadata [MB]; the course's own by its files."""
    if engine not in PACKAGES:
        here = Path(__file__).resolve().parents[1]
        return sum(path.stat().st_size for path in here.rglob("*.py")) / MB
    result = 0
    for package in PACKAGES[engine]:
        try:
            files = importlib.metadata.files(package) or []
        except importlib.metadata.PackageNotFoundError:
            continue
        result += sum(file.size or 0 for file in files)
    return result / MB


def _peak() -> float:
    """Return the most memory that this process held so far [MB]."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        # Elsewhere than on Linux; there this is the most of the parent as well.
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MB
    return float(status.partition("VmHWM:")[2].split()[0]) * 1024 / MB


def _measured(name: str) -> dict[str, float]:
    engine, chain = engines()[name], scenes.chain(6)
    before = _peak()
    start = time.perf_counter()
    if name in LIBRARIES:
        LIBRARIES[name]()
    imported = time.perf_counter() - start
    loads = []
    for _ in range(3):
        start = time.perf_counter()
        engine.build(chain, 1e-3).close()
        loads.append(time.perf_counter() - start)
    return {
        "import_time": imported,
        "load_time": min(loads),
        "memory": _peak() - before,
    }


def install(name: str, processes: int = 3) -> Install:
    """Return facts of an engine, the least of several fresh processes.

    Args:
        name: one of `engines()`.
        processes: how many are started.
    """
    engine = engines()[one_of("name", name, engines())]
    if missing := engine.missing():
        return Install(name, missing=missing)
    rows = []
    for _ in range(count("processes", processes, 1)):
        command = [sys.executable, "-m", "course.oracles.installs", name]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
    least = {key: min(row[key] for row in rows) for key in rows[0]}
    return Install(name, engine.version(), size=size_of(name), **least)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(_measured(sys.argv[1])))
    else:
        for each in engines():
            print(asdict(install(each)))
