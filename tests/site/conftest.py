"""The site, built once for all tests of a run."""

import fcntl
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.budget import ROOT


def built(target: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Build the site into a folder, as `make site` does, in a process of its own."""
    command = [sys.executable, "-m", "course.site", "-o", str(target)]
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
