"""Import every third-party library of the course once, and say what the system lacks.

`python -m tools.libraries` prints one line when all of them can be imported. pip installs a package
whether or not the shared libraries that it loads are there; without this check the first chapter
that needs one would fail. Each library is imported in a process of its own, so that one that
crashes is named like the others.
"""

import importlib.metadata
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from course.libraries import (
    SYSTEM_PACKAGES,
    absent_packages,
    install_line,
    missing_shared_library,
)

ROOT = Path(__file__).resolve().parent.parent
AT_ONCE = 2  # each takes up to a few hundred MB
PATIENCE = 300.0  # for one import on a cold disk [s]

# What imports a distribution, where that is not `import` with its own name.
STATEMENTS = {
    "absl-py": "import absl.logging",
    "array-api-compat": "import array_api_compat",
    "build": "import build",
    "codespell": "import codespell_lib",
    "cyclonedds": "import cyclonedds.domain",
    "drake": "import pydrake.all",
    "eclipse-zenoh": "import zenoh",
    "jax": "import jax.numpy",
    "libusb-package": "import libusb_package",
    "markdown-it-py": "import markdown_it",
    "matplotlib": "import matplotlib.pyplot",
    "ompl": "import ompl.base, ompl.geometric",
    "open3d": "from course.oracles import open3d; open3d.library()",  # it loads libusb first
    "opencv-python-headless": "import cv2",
    "pillow": "import PIL.Image",
    "pin": "import pinocchio, coal",
    "pin-pink": "import pink",
    "playwright": "import playwright.sync_api",
    "pytest-xdist": "import xdist",
    "scipy": "import scipy.linalg, scipy.special, scipy.integrate, scipy.spatial, scipy.optimize",
    "small-gicp": "import small_gicp",
    "stable-baselines3": "import stable_baselines3",
    "mujoco": "import mujoco, mujoco.sysid",
    "vamp-planner": "import vamp",
    "myst-nb": "import myst_nb",
}


def requirements() -> Iterator[str]:
    """Yield the distributions that pyproject.toml names, its extras included."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for group in (project["dependencies"], *project["optional-dependencies"].values()):
        for text in group:
            yield re.split(r"[<>=!~;\[ ]", text)[0]


def installed() -> list[str]:
    """Return those of `requirements` that are installed here."""
    result = {name.lower().replace("_", "-") for name in _distributions()}
    return [name for name in dict.fromkeys(requirements()) if name in result]


def _distributions() -> Iterator[str]:
    for distribution in importlib.metadata.distributions():
        yield distribution.metadata["Name"]


def statement(distribution: str) -> str:
    """Return the Python statement that imports a distribution."""
    return STATEMENTS.get(distribution, f"import {distribution.replace('-', '_')}")


def failure(code: str) -> str:
    """Run a statement in a process of its own and return what its last error says, or ""."""
    try:
        done = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", code],
            cwd=ROOT,
            capture_output=True,
            text=True,
            errors="replace",
            stdin=subprocess.DEVNULL,
            timeout=PATIENCE,
        )
    except subprocess.TimeoutExpired:
        return f"it was not imported within {PATIENCE:g} s"
    if done.returncode == 0:
        return ""
    if done.returncode < 0:
        return f"the import ended with signal {-done.returncode}"
    # The loader's own words, wherever they stand; else the first line of the last error.
    if library := missing_shared_library(Exception(done.stderr)):
        return f"{library}: cannot open shared object file"
    errors = re.findall(r"^\w[\w.]*(?:Error|Exception|Exit)\b.*$", done.stderr, re.MULTILINE)
    return errors[-1] if errors else done.stderr.strip().rpartition("\n")[2]


def failures(statements: Mapping[str, str]) -> dict[str, str]:
    """Return the libraries that cannot be imported, each with the cause.

    Args:
        statements: name of a library -> the statement that imports it.
    """
    with ThreadPoolExecutor(AT_ONCE) as pool:
        causes = dict(zip(statements, pool.map(failure, statements.values()), strict=True))
    return {name: cause for name, cause in causes.items() if cause}


def report(failed: Mapping[str, str]) -> str:
    """Return what to tell the user about libraries that cannot be imported."""
    lines = [
        f"{name} is installed, but importing it fails: {text}" for name, text in failed.items()
    ]
    absent = {missing_shared_library(Exception(cause)) for cause in failed.values()} - {""}
    packages = {SYSTEM_PACKAGES[library] for library in absent if library in SYSTEM_PACKAGES}
    if packages:
        lines.append("On Debian and Ubuntu, this line installs what is missing:")
        lines.append(f"  {install_line(sorted(packages | set(absent_packages())))}")
    for library in sorted(absent - set(SYSTEM_PACKAGES)):
        lines.append(f"`apt-file search {library}` finds the package that contains {library}.")
    return "\n".join(lines)


def main() -> int:
    """Import everything and return the exit code: 1 if a library cannot be imported."""
    statements = {name: statement(name) for name in installed()}
    failed = failures(statements)
    if failed:
        print(report(failed), file=sys.stderr)
        return 1
    print(f"{len(statements)} libraries can be imported")
    return 0


if __name__ == "__main__":
    sys.exit(main())
