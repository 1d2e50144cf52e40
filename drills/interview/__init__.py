"""Commands that rehearse an interview; each module is imported when its command is used."""

import io
import os
import sys

from drills import terminal


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
    return input(prompt)
