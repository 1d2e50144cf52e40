"""Which files the child may read: Python, packages, the system's libraries; not the course."""

from __future__ import annotations

import functools
import os
import sys
import sysconfig
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]  # holds drills, course, solutions, tests
HIDDEN = ("course", "drills", "solutions", "tests", "notebooks", "work", "docs", ".git")
OURS = "robotics_simulation_course"  # the distribution, as its metadata and finder are named

SYSTEM = (
    "/lib",
    "/lib64",
    "/usr/lib",
    "/usr/lib64",
    "/usr/local/lib",
    "/usr/share/zoneinfo",
    "/etc/ld.so.cache",
    "/etc/localtime",
    "/etc/timezone",
    "/sys/devices/system/cpu",
    "/sys/devices/system/node",
    "/sys/fs/cgroup",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/stat",
    "/proc/sys/vm",
    "/proc/filesystems",
    "/dev/null",
    "/dev/zero",
    "/dev/urandom",
    "/dev/random",
    "/nix/store",
    "/gnu/store",
)


@functools.cache
def search_path() -> list[str]:
    """Return the folders of installed packages, for the child's `sys.path`."""
    numpy_home = str(Path(sys.modules["numpy"].__file__ or "").resolve().parents[1])
    result = [p for p in sys.path if os.path.basename(p) in ("site-packages", "dist-packages")]
    if all(os.path.realpath(p) != numpy_home for p in result):
        result.append(numpy_home)
    return result


def _hidden(path: str) -> bool:
    """Return whether a path belongs to the course, in a checkout or among installed packages."""
    place, name = os.path.split(path)
    if place == str(HERE) and name in HIDDEN:
        return True
    installed = place in map(os.path.realpath, search_path())
    return installed and (name in HIDDEN or name.startswith((OURS, "__editable__")))


@functools.cache
def _rules() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return places to read with all below them, and folders on the way that may be listed."""
    readable: list[str] = []
    listable: list[str] = []
    packages = [os.path.realpath(p) for p in search_path()]
    standard = [os.path.realpath(sysconfig.get_path(n)) for n in ("stdlib", "platstdlib")]
    shared = [sysconfig.get_config_var("LIBDIR") or "", os.path.join(sys.base_prefix, "lib")]
    split = [*packages, str(HERE)]

    def allow(path: str) -> None:
        path = os.path.realpath(path)
        if _hidden(path) or path in readable:
            return
        if os.path.isdir(path) and any(
            place == path or place.startswith(path.rstrip("/") + "/") for place in split
        ):
            if path in listable:
                return
            listable.append(path)
            try:
                names = sorted(os.listdir(path))
            except OSError:
                return
            for name in names:
                allow(os.path.join(path, name))
        elif os.path.exists(path):
            readable.append(path)

    for path in (*standard, *packages, *filter(None, shared), *SYSTEM):
        allow(path)
    return tuple(readable), tuple(listable)


def access(folder: str) -> dict[str, list[str]]:
    """Return what the child with this scratch folder may read, list and write."""
    readable, listable = _rules()
    return {
        "readable": list(readable),
        "listable": list(listable),
        "writable": [folder, "/dev/null"],
    }
