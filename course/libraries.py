"""Libraries that are imported when needed: why an import fails, and what installs what is missing.

Two things can be missing: the Python package, which pip installs, or a shared library of the
system that the package loads, which the system's package manager installs. An error that names the
wrong one sends the reader in circles, so every adapter builds its error here. PyTorch, which
several chapters need, is imported here as well.
"""

import contextlib
import ctypes
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any

# The Debian package that contains each shared library which a wheel of the course loads but does
# not bring along. The names are those of Debian 12; on Debian 13 libglib2.0-0t64 provides the last.
SYSTEM_PACKAGES = {
    "libgomp.so.1": "libgomp1",  # Pinocchio, Open3D
    "libEGL.so.1": "libegl1",  # Open3D
    "libGL.so.1": "libgl1",  # Open3D
    "libX11.so.6": "libx11-6",  # Open3D, Drake
    "libglib-2.0.so.0": "libglib2.0-0",  # Drake
}
# What glibc's loader writes. It stops at the first library that it does not find.
_NOT_FOUND = re.compile(r"([\w.+-]+\.so[.\d]*): cannot open shared object file")


def missing_shared_library(error: BaseException) -> str:
    """Return the file name of the shared library whose absence caused an error, or ""."""
    result = _NOT_FOUND.search(str(error))
    return result[1] if result else ""


def absent_packages() -> list[str]:
    """Return the Debian packages of the shared libraries that this system cannot load.

    The loader names one missing library at a time. This tries all of `SYSTEM_PACKAGES`, so that one
    installation is enough.
    """
    # The names above are Debian's, and the tried files those of Linux.
    if not sys.platform.startswith("linux"):
        return []
    absent = []
    for name, package in SYSTEM_PACKAGES.items():
        try:
            ctypes.CDLL(name)
        except OSError:
            absent.append(package)
    return absent


def install_line(packages: Iterable[str]) -> str:
    """Return the command that installs some Debian packages."""
    return " ".join(["apt-get install --no-install-recommends", *packages])


def import_error(title: str, install: str, error: BaseException) -> ImportError:
    """Return the error to raise where a library cannot be imported.

    Args:
        title: The library's name as people write it, such as "Pinocchio".
        install: What to do where the package is not installed, such as "pip install 'pin>=4.0'".
        error: What the import raised.

    Returns:
        A ModuleNotFoundError if a Python package is missing, otherwise an ImportError; its text
        gives the cause and the command that removes it.
    """
    # A loader's message may go on for a page; its first line has the cause.
    cause = str(error).strip().partition("\n")[0] or type(error).__name__
    if isinstance(error, ModuleNotFoundError):
        if error.name:
            cause = f"there is no module {error.name}"
        return ModuleNotFoundError(
            f"this needs {title}: {install} ({cause})", name=error.name, path=error.path
        )
    if library := missing_shared_library(error):
        if library in SYSTEM_PACKAGES:
            fix = install_line(sorted({SYSTEM_PACKAGES[library], *absent_packages()}))
        else:
            fix = f"`apt-file search {library}` finds the package that contains it"
        return ImportError(
            f"{title} is installed, but the system library {library} is missing: {fix}"
        )
    return ImportError(f"{title} is installed, but importing it fails: {cause}")


def pytorch() -> Any:
    """Return the module torch; importing it takes seconds, so it waits until it is needed.

    Raises:
        ImportError: without it, with what to install.
    """
    try:
        import torch
    except ImportError as error:
        raise import_error("PyTorch", "pip install 'torch>=2.6'", error) from error
    return torch


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Hold PyTorch to one thread, which is faster on small networks, and restore the count after.

    Raises:
        ImportError: without PyTorch, with what to install.
    """
    torch = pytorch()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
