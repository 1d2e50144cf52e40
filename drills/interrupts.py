"""Ctrl-C, noted the moment it comes: whatever swallows the exception, the command still ends.

Python raises `KeyboardInterrupt` between two instructions of the main thread. Code of a library
that runs at that moment may turn it into another error or drop it (a compiler's callback, a
finalizer, a module that is being imported), and a call into machine code delays it until the call
returns.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any

PATIENCE = 0.5  # s for a computation to end by itself before the process is ended
STOPPED = 130
_came = threading.Event()


def note() -> None:
    """Note every Ctrl-C of this process; it raises `KeyboardInterrupt` as before."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _raise)
        sys.unraisablehook = _report_unraisable


def ignore() -> None:
    """Let Ctrl-C change nothing any more: the command has ended, and only says so."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def came() -> bool:
    """Return whether Ctrl-C was typed."""
    return _came.is_set()


def check() -> None:
    """Raise `KeyboardInterrupt` if Ctrl-C was typed, as before a file is written."""
    if came():
        raise KeyboardInterrupt


@contextlib.contextmanager
def heeded(ends_process: bool = False) -> Iterator[None]:
    """Compute inside; after a Ctrl-C the block ends with `KeyboardInterrupt`, however it ends.

    Args:
        ends_process: end the process where the block takes longer than `PATIENCE` to end. Nothing
            that has to be cleared up may be open, and no file half written that is not replaced as
            a whole.

    Raises:
        KeyboardInterrupt: Ctrl-C was typed.
    """
    watch: contextlib.AbstractContextManager[None] = contextlib.nullcontext()
    if ends_process and signal.getsignal(signal.SIGINT) is _raise:
        watch = _watched()
    try:
        with watch:
            yield
    except Exception:
        check()  # an error that Ctrl-C caused is nobody's fault
        raise
    check()


@contextlib.contextmanager
def _watched() -> Iterator[None]:
    """End the process from another thread, if the main one does not end the block after Ctrl-C."""
    receiver, sender = os.pipe()
    os.set_blocking(sender, False)
    over = threading.Event()

    def watch() -> None:
        while not over.is_set():
            select.select([receiver], [], [])
            if signal.SIGINT in os.read(receiver, 1024):
                _came.set()
                if not over.wait(PATIENCE):
                    _end()

    thread = threading.Thread(target=watch, daemon=True)
    before = signal.set_wakeup_fd(sender, warn_on_full_buffer=False)
    thread.start()
    try:
        yield
    finally:
        over.set()
        signal.set_wakeup_fd(before)
        os.write(sender, bytes(1))
        thread.join()
        os.close(receiver)
        os.close(sender)


def _report_unraisable(what: Any) -> None:
    """Report an exception that had nowhere to go, unless it is a Ctrl-C, which is noted."""
    if not issubclass(what.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(what)


def _end() -> None:
    with contextlib.suppress(OSError, AttributeError):
        os.write(sys.stderr.fileno(), b"\nStopped.\n")
    os._exit(STOPPED)


def _raise(number: int, frame: Any) -> None:
    _came.set()
    raise KeyboardInterrupt
