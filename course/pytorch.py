"""PyTorch, imported where it is needed, as it takes seconds, and held to one thread."""

import contextlib
from collections.abc import Iterator
from typing import Any

from course.libraries import import_error


def pytorch() -> Any:
    """Return the module torch.

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
    """PyTorch with one thread, which is faster on small networks; their number is put back."""
    torch = pytorch()
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
