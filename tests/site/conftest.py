"""The site, built once for all tests of a run.

But in `make prove`, only the README's charts are drawn for phones; the others are empty pictures.
"""

import fcntl
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from course import charts as stored
from course.site import charts
from tests.budget import PROVE, ROOT

# The command of `make site`, with the drawn charts in a folder of the tests.
BUILD = """
import pathlib, sys
from course.site import __main__, charts
charts.CACHE = pathlib.Path(sys.argv.pop(1))
__main__.main()
"""
EMPTY = """<?xml version="1.0" encoding="utf-8"?>
<svg xmlns="http://www.w3.org/2000/svg" width="302.4pt" height="200pt" viewBox="0 0 302 200"/>
"""


def mostly_empty(folder: Path) -> Path:
    """Fill a folder with empty pictures of all charts but those that the README shows."""
    shown = set(re.findall(r"docs/charts/(\w+)\.png", (ROOT / "README.md").read_text("utf-8")))
    folder.mkdir()
    for path in stored.FOLDER.glob("*.json"):
        if path.stem not in shown:
            (folder / charts.cached(path.stem).name).write_text(EMPTY, encoding="utf-8")
    return folder


def built(target: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Build the site into a folder, as `make site` does, in a process of its own."""
    cache = charts.CACHE if PROVE else mostly_empty(target.with_name(f"{target.name}-charts"))
    command = [sys.executable, "-c", BUILD, str(cache), "-o", str(target)]
    command += ["--work", str(target.with_name(f"{target.name}-work"))]
    quiet = {"COURSE_QUIET": "1", "OMP_NUM_THREADS": "1", **environment}
    return subprocess.run(
        command, cwd=ROOT, env=os.environ | quiet, capture_output=True, text=True, timeout=900
    )


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the site; of several workers one builds it, and the others wait."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base
    target = shared / "site"
    with (shared / "site.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not target.exists():
            done = built(target)
            assert done.returncode == 0, done.stderr
    return target
