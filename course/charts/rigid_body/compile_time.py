"""Chapter 1: what the first call costs, and what every later one does."""

import json
import os
import subprocess
import sys
import tempfile
from typing import Any

from course.charts import chart, save
from course.measure.work_precision import PALETTE, machine

_PROBE = """
import json, time
start = time.perf_counter()
from course import rigid_body
imported = time.perf_counter() - start
seconds = rigid_body.warm()
warmed = time.perf_counter() - start
rigid_body.warm()
print(json.dumps([imported, seconds, warmed - imported, time.perf_counter() - start - warmed]))
"""


def compile_times() -> dict[str, Any]:
    """Import and first calls of chapter 1 in three states: no cache, a cache, same process.

    Returns:
        "import" [s]; "functions": name -> [processor seconds without a cache, with one];
        "first", "next process", "again": seconds for all first calls of the chapter together,
        without a cache, with one, and a second time in the same process.
    """
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder, "COURSE_QUIET": "1"}
        cold, warm = (
            json.loads(
                subprocess.run(
                    [sys.executable, "-c", _PROBE],
                    env=environment,
                    capture_output=True,
                    text=True,
                    check=True,
                ).stdout
            )
            for _ in range(2)
        )
    return {
        "import": warm[0],
        "functions": {name: [seconds, warm[1][name]] for name, seconds in cold[1].items()},
        "first": cold[2],
        "next process": warm[2],
        "again": warm[3],
        "machine": machine(),
    }


def _short(name: str) -> str:
    function, _, signature = name.partition(" ")
    batch = "float64, 2, " in signature.split("->")[0] or "2d, C" in signature.split(",")[0]
    return function.rsplit(".", 1)[1].lstrip("_") + (" (batch)" if batch else "")


@chart
def compile_time() -> str:
    """Compilation without a cache, with one, and later calls."""
    import matplotlib.pyplot as plt

    data = compile_times()
    rows = sorted(data["functions"].items(), key=lambda row: row[1][0])
    total = sum(seconds[0] for _, seconds in rows)
    figure, ax = plt.subplots(figsize=(9, 0.3 * len(rows) + 1.5), layout="constrained")
    places = range(len(rows))
    ax.barh(
        places,
        [seconds[0] for _, seconds in rows],
        color=PALETTE[0],
        label="first run: compiled",
    )
    ax.barh(
        places,
        [seconds[1] for _, seconds in rows],
        height=0.4,
        color=PALETTE[1],
        label="next process: from the cache",
    )
    ax.set_yticks(places, [_short(name) for name, _ in rows], fontsize="small")
    ax.set_xlabel("processor time of the first call [s]")
    ax.set_title(f"Compiling chapter 1 takes {total:.0f} s, once")
    ax.legend(loc="lower right")
    ax.grid(True, axis="x", alpha=0.3)
    figure.supxlabel(data["machine"], fontsize="x-small", color="0.4")
    save("compile_time", figure, data)
    return (
        f"import {data['import']:.2f} s; all first calls of the chapter: {data['first']:.1f} s "
        f"without a cache (compiling {total:.1f} s of processor time), "
        f"{data['next process']:.2f} s in the next process, {data['again']:.3f} s when called again"
    )
