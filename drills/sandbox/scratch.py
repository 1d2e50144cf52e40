"""The child's folder: how full it is while foreign code runs, and its removal afterwards."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
from collections.abc import Iterator

FILES = 2000  # entries
LEVELS = 40  # of folders


def excess(folder: str, limit: int) -> str:
    """Return why the folder holds too much, as the beginning of a sentence.

    Empty while it does not.
    """
    total = entries = 0

    def problem(place: int, level: int) -> str:
        nonlocal total, entries
        if level > LEVELS:
            return f"Folders were nested more than {LEVELS} deep"
        inner: list[str] = []
        with os.scandir(place) as result:
            for entry in result:
                entries += 1
                if entries > FILES:
                    return f"More than {FILES} files were made"
                with contextlib.suppress(OSError):  # removed meanwhile
                    if entry.is_dir(follow_symlinks=False):
                        inner.append(entry.name)
                    else:
                        total += entry.stat(follow_symlinks=False).st_blocks * 512
        for name in inner:
            with contextlib.suppress(OSError), _opened(name, place) as below:
                text = problem(below, level + 1)
                if text:
                    return text
        return ""

    with contextlib.suppress(OSError), _opened(folder) as top:
        text = problem(top, 0)
        if text:
            return text
    if total > limit:
        return f"More than {limit / (1 << 20):.3g} MiB were written to disk"
    return ""


@contextlib.contextmanager
def _opened(name: str, above: int | None = None) -> Iterator[int]:
    """Open a folder, never through a link; one closed to its owner is opened to us first."""
    flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC
    try:
        handle = os.open(name, flags, dir_fd=above)
    except PermissionError:
        if not hasattr(os, "O_PATH"):
            raise
        # By its handle, as its name may lead elsewhere by now.
        place = os.open(name, os.O_PATH | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=above)
        try:
            os.chmod(f"/proc/self/fd/{place}", 0o700)
            handle = os.open(f"/proc/self/fd/{place}", flags & ~os.O_NOFOLLOW)
        finally:
            os.close(place)
    try:
        yield handle
    finally:
        os.close(handle)


def remove(folder: str) -> None:
    """Remove a folder that nobody can change any more, however closed, deep or full it is."""
    try:
        _flatten(folder)
    except OSError:  # something that this file system does not let move: the plain way is left
        shutil.rmtree(folder, ignore_errors=True)


def _flatten(folder: str) -> None:
    """Remove a folder; each subfolder is first moved to the top, so that no path ever gets long."""
    try:
        os.chmod(folder, 0o700)
        top = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    except FileNotFoundError:
        return
    try:
        count = 0
        while names := os.listdir(top):
            for name in names:
                if not stat.S_ISDIR(os.lstat(name, dir_fd=top).st_mode):
                    os.unlink(name, dir_fd=top)
                    continue
                os.chmod(name, 0o700, dir_fd=top)
                inner = os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=top)
                try:
                    for below in os.listdir(inner):
                        if stat.S_ISDIR(os.lstat(below, dir_fd=inner).st_mode):
                            os.chmod(below, 0o700, dir_fd=inner)
                            count += 1
                            fresh = f".{os.urandom(8).hex()}{count}"
                            os.rename(below, fresh, src_dir_fd=inner, dst_dir_fd=top)
                        else:
                            os.unlink(below, dir_fd=inner)
                finally:
                    os.close(inner)
                os.rmdir(name, dir_fd=top)
    finally:
        os.close(top)
    os.rmdir(folder)
