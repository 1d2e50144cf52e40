"""Commands that rehearse an interview; each module is imported when its command is used."""

import io
import os
import select
import signal
import sys

from drills import terminal

# Bytes of a line that the system's terminals pass on.
LONGEST_LINE = 4095 if sys.platform == "linux" else 1023


def listen() -> None:
    """Have `input` take whatever is typed for text; where there is no input, it is at its end."""
    sys.stdin = sys.stdin or open(os.devnull)
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(errors="replace")


def read_line(prompt: str = "") -> str:
    """Return the next line that is typed.

    Raises:
        EOFError: at the end of the input, or when the reader of the output has closed it.
    """
    if sys.stdout in terminal.LEFT:
        raise EOFError
    if os.name != "posix" or not sys.stdin.isatty():
        return input(prompt)
    terminal.write(prompt)
    wait_for_line()
    return input()


def was_cut(line: str) -> bool:
    """Return whether a line is as long as the longest that a terminal passes on.

    A terminal that reads whole lines drops what is behind its limit, and gives no sign of it.
    """
    return sys.stdin.isatty() and len(line.encode("utf-8", "replace")) >= LONGEST_LINE


def wait_for_line() -> None:
    """Wait until the terminal has a line, or its end, so that `input` returns at once.

    `input` writes its prompt and reads, and looks for signals only afterwards: a Ctrl-C that comes
    between the two waits for the next line. Here every signal is also written to a pipe, and
    `select` waits for the terminal and for the pipe.

    Raises:
        KeyboardInterrupt: on Ctrl-C, whenever it comes.
    """
    receiver, sender = os.pipe()
    os.set_blocking(sender, False)
    before = signal.set_wakeup_fd(sender, warn_on_full_buffer=False)
    try:
        while sys.stdin not in select.select([sys.stdin, receiver], [], [])[0]:
            os.read(receiver, 1024)  # a signal whose handler did not raise
    finally:
        signal.set_wakeup_fd(before)
        os.close(receiver)
        os.close(sender)
