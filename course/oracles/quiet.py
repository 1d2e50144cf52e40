"""What C code prints, caught: libraries that talk on standard output and on standard error."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import tempfile
from collections.abc import Iterator


@contextlib.contextmanager
def quiet() -> Iterator[list[str]]:
    """Catch what C code prints; the list holds it once this is left."""
    text: list[str] = []
    flush = ctypes.CDLL(None).fflush
    sys.stdout.flush(), sys.stderr.flush()
    flush(None)
    with tempfile.TemporaryFile() as file:
        retained = os.dup(1), os.dup(2)
        os.dup2(file.fileno(), 1), os.dup2(file.fileno(), 2)
        try:
            yield text
        finally:
            # Python buffers a file, too, and would write what is left after the descriptors are
            # restored, to the wrong place.
            sys.stdout.flush(), sys.stderr.flush()
            flush(None)
            for copy, number in zip(retained, (1, 2), strict=True):
                os.dup2(copy, number)
                os.close(copy)
            file.seek(0)
            text.append(file.read().decode(errors="replace"))
