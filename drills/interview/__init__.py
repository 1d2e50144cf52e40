"""Commands that rehearse an interview; each module is imported when its command is used."""

import io
import os
import sys


def listen() -> None:
    """Have `input` take whatever is typed for text; where there is no input, it is at its end."""
    sys.stdin = sys.stdin or open(os.devnull)
    if isinstance(sys.stdin, io.TextIOWrapper):
        sys.stdin.reconfigure(errors="replace")
