"""Chapter 1: what the first call costs, and what every later one does."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from typing import Any

from course.charts import chart
from course.measure.figure import Panel, Series
from course.measure.work_precision import machine

_PROBE = """
import json, time
start = time.perf_counter()
from course import rigid_body
from course.compiled import COMPILE_SECONDS as seconds
imported = time.perf_counter() - start
rigid_body.warm()
warmed = time.perf_counter() - start
rigid_body.warm()
print(json.dumps([imported, seconds, warmed - imported, time.perf_counter() - start - warmed]))
"""


def _first_calls() -> list[Any]:
    """Return chapter 1 in two fresh processes, the first without a cache: what `_PROBE` prints."""
    command = [sys.executable, "-c", _PROBE]
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"NUMBA_CACHE_DIR": folder, "COURSE_QUIET": "1"}
        return [
            json.loads(
                subprocess.run(
                    command, env=environment, capture_output=True, text=True, check=True
                ).stdout
            )
            for _ in range(2)
        ]


def _short(name: str) -> str:
    function, _, signature = name.partition(" ")
    batch = "float64, 2, " in signature.split("->")[0] or "2d, C" in signature.split(",")[0]
    return function.rsplit(".", 1)[1].lstrip("_") + (" (batch)" if batch else "")


@chart(height=5.4)
def compile_time() -> Iterator[Panel]:
    """Chart compilation without a cache, with one, and later calls."""
    (_, cold, first, _), (imported, warm, again, last) = _first_calls()
    names = sorted(cold, key=lambda name: cold[name], reverse=True)
    total = sum(cold.values())
    panel = Panel(
        f"Compiling chapter 1 takes {total:.0f} s, once",
        "processor time of the first call [s]",
        footer=machine(),
    )
    for label, seconds in (
        ("first run: compiled", cold),
        ("next process: from the cache", warm),
    ):
        lengths = [seconds[name] for name in names]
        panel.series.append(Series(label, lengths, [_short(name) for name in names], style="bar"))
    panel.notes.append(
        f"import {imported:.2f} s; all first calls of the chapter: {first:.1f} s "
        f"without a cache (compiling {total:.1f} s of processor time), "
        f"{again:.2f} s in the next process, {last:.3f} s when called again"
    )
    yield panel
