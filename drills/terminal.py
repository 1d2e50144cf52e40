"""What the commands write: text that fits the terminal, or one line of JSON.

Nothing here fails because of where the output goes: a locale without Unicode gets ASCII, a pipe
gets no colour, a reader that has gone away ends the output and not the command.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import sys
import textwrap
import unicodedata
from collections.abc import Callable, Iterable
from typing import Any, TextIO

SCHEMA = "drills/1"
LEFT: list[TextIO] = []  # what nobody reads any more

# Styles of rich; its modules are imported when something is painted first.
STYLES = {
    "good": "green",
    "right": "bold green",
    "bad": "red",
    "wrong": "bold red",
    "warn": "yellow",
    "dim": "dim",
    "head": "bold",
}
_WIDEST, _NARROWEST = 100, 40

# What a text of the course may hold, in ASCII; other characters lose their accents or are escaped.
_ASCII = str.maketrans(
    {
        **dict(zip("─━│┃┌┐└┘├┤┬┴┼╭╮╰╯╷╵╶╴┏┓┗┛┡┩╇╞╪╡═║", "--||" + "+" * 27 + "=|", strict=False)),
        **{"█": "#", "░": ".", "▌": "|", "•": "*", "·": ".", "✓": "v", "✗": "x", "✘": "x"},
        **{"…": "...", "–": "-", "—": "-", "−": "-", "→": "->", "←": "<-", "×": "x", "÷": "/"},
        **{"‘": "'", "’": "'", "“": '"', "”": '"', "≤": "<=", "≥": ">=", "≠": "!=", "≈": "~"},
        **{"°": " deg", "±": "+-", "²": "^2", "³": "^3", "√": "sqrt", "π": "pi", "∞": "inf"},
        **{"α": "alpha", "β": "beta", "γ": "gamma", "δ": "delta", "ε": "epsilon", "θ": "theta"},
        **{"λ": "lambda", "μ": "mu", "ρ": "rho", "σ": "sigma", "τ": "tau", "φ": "phi"},
        **{"ω": "omega", "Δ": "Delta", "∆": "Delta", "Σ": "Sigma", "Ω": "Omega", "ζ": "zeta"},
        **{"○": "o", "◐": "/", "●": "*", "η": "eta", "κ": "kappa", "ν": "nu", "ξ": "xi"},
        **{"χ": "chi", "ψ": "psi", "Γ": "Gamma", "Θ": "Theta", "Λ": "Lambda", "Π": "Pi"},
        **{"Φ": "Phi", "Ψ": "Psi", "∝": "~", "≪": "<<", "≫": ">>", "≡": "==", "∓": "-+"},
        **{"⊥": "perp", "∈": "in", "∂": "d", "∫": "integral of ", "∇": "grad "},
        **{"⌈": "ceil(", "⌉": ")", "⌊": "floor(", "⌋": ")"},
    }
)
_CODES = re.compile(r"\x1b\[[0-9;]*m")
_POWERS = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻ⁿ]+")


class OutputLost(OSError):
    """What is to be said can't be written, as on a full disk."""


class Terminal:
    """Where a command writes.

    Args:
        as_json: whether nothing but the final line of JSON goes to standard output.
    """

    def __init__(self, as_json: bool = False) -> None:
        self.json = as_json
        self.unicode = _speaks_unicode(sys.stdout)
        self.colour = _wants_colour(sys.stdout)
        columns = shutil.get_terminal_size((80, 24)).columns
        self.width = max(_NARROWEST, min(columns, _WIDEST))
        self._read: Callable[..., str] | None = None  # after a screen, where a person watches
        self._rows = 0  # written since something was typed

    def paged(self, read_line: Callable[..., str]) -> Callable[..., str]:
        """Stop after each screen from now on, where a person watches, and wait for Enter.

        Args:
            read_line: reads a line behind a prompt.

        Returns:
            What reads a line in its stead: a new screen begins with what was typed.
        """
        watched = sys.stdin is not None and sys.stdin.isatty() and sys.stdout.isatty()
        if self.json or not watched:
            return read_line
        self._read, self._rows = read_line, 0

        def read(*prompt: str) -> str:
            try:
                return read_line(*prompt)
            finally:
                self._rows = 0

        return read

    def say(self, text: str = "") -> None:
        """Write a text to standard output, unless JSON is asked for."""
        if self.json:
            return
        if self._read is None:
            _write(sys.stdout, text + "\n", self.unicode)
            return
        size = shutil.get_terminal_size((80, 24))
        for line in text.split("\n"):
            rows = max(-(-len(_CODES.sub("", line)) // max(size.columns, 1)), 1)
            if self._rows and self._rows + rows > max(size.lines - 1, 5):
                typed = self._read("-- Enter for more --").strip()
                self._rows = 0
                if self.colour:
                    _write(sys.stdout, "\x1b[A\x1b[2K", True)  # the text goes on in its place
                if typed:
                    # It was meant for a prompt that had not come yet, which may ask for a mark.
                    note = f"({typed[:30]!a} was not used: type it again at the next prompt.)"
                    _write(sys.stdout, note + "\n", self.unicode)
                    self._rows = 1
            _write(sys.stdout, line + "\n", self.unicode)
            self._rows += rows

    def wrap(self, text: str, indent: str = "", first: str | None = None) -> None:
        """Write a paragraph that fits the width."""
        for line in wrapped(text, self.width, indent, first):
            self.say(line)

    def complain(self, text: str) -> None:
        """Write a sentence to standard error, unless JSON is asked for: there it is in the line."""
        if not self.json:
            plain = "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)
            for line in wrapped(plain, self.width):
                _write(sys.stderr, line + "\n", _speaks_unicode(sys.stderr))

    def paint(self, text: str, style: str) -> str:
        """Return the text in a colour, where there is colour."""
        return painted(text, style) if self.colour else text

    def line_of_json(self, payload: dict[str, Any]) -> None:
        """Write the one line, in ASCII, if JSON is asked for."""
        if self.json:
            text = json.dumps(payload, ensure_ascii=True, allow_nan=False)
            _write(sys.stdout, text + "\n", True)


def painted(text: str, style: str) -> str:
    """Return the text with the codes of one of `STYLES`, in the 16 colours of any terminal."""
    from rich.color import ColorSystem
    from rich.style import Style

    return Style.parse(STYLES[style]).render(text, color_system=ColorSystem.STANDARD)


def wrapped(text: str, width: int, indent: str = "", first: str | None = None) -> list[str]:
    """Return the lines of a paragraph; words that are longer than a line are left whole."""
    return textwrap.wrap(
        text,
        width,
        initial_indent=indent if first is None else first,
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    ) or [""]


def to_ascii(text: str) -> str:
    """Return the text in ASCII: names for Greek letters, plain signs for drawn ones."""
    if text.isascii():
        return text
    powers = _POWERS.sub(lambda m: f"^{unicodedata.normalize('NFKD', m[0])}", text)
    plain = unicodedata.normalize("NFKD", powers.translate(_ASCII))
    plain = "".join(c for c in plain if not unicodedata.combining(c))
    return plain.encode("ascii", "backslashreplace").decode("ascii")


def bar(part: int, whole: int, width: int = 10) -> str:
    """Return a bar of `width` characters of which the given share is full."""
    full = round(width * part / whole) if whole else 0
    # Neither full nor empty before it is true.
    full = min(max(full, int(part > 0)), width - int(part < whole)) if whole else 0
    return "█" * full + "░" * (width - full)


def listed(words: Iterable[str], joint: str = "or") -> str:
    """Return the words as a sentence lists them: "a, b or c"."""
    items = list(words)
    return f" {joint} ".join([", ".join(items[:-1]), items[-1]] if len(items) > 1 else items)


def write(text: str) -> None:
    """Write a text to standard output as it is, without a line break, such as a prompt."""
    _write(sys.stdout, text, _speaks_unicode(sys.stdout))


def _write(stream: TextIO | None, text: str, unicode: bool) -> None:
    if stream is None:  # closed before the start
        return
    text = text if unicode else to_ascii(text)
    encoding = getattr(stream, "encoding", None) or "utf-8"
    text = text.encode(encoding, "backslashreplace").decode(encoding)
    try:
        stream.write(text)
        stream.flush()
    except OSError as error:
        # The rest goes nowhere, also what the interpreter flushes last.
        with contextlib.suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, stream.fileno())
            os.close(nowhere)
        LEFT.append(stream)
        if not isinstance(error, BrokenPipeError):  # then the reader has seen enough
            raise OutputLost(error.errno, error.strerror) from None


def _speaks_unicode(stream: TextIO | None) -> bool:
    encoding = (getattr(stream, "encoding", None) or "ascii").lower().replace("-", "")
    if not encoding.startswith("utf"):
        return False
    # Python writes UTF-8 under LC_ALL=C too; a reader there was promised ASCII.
    report = os.environ.get("PYTHONIOENCODING") or os.environ.get("PYTHONUTF8") == "1"
    return bool(report) or os.environ.get("LC_ALL") not in ("C", "POSIX")


def _wants_colour(stream: TextIO | None) -> bool:
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return stream is not None and stream.isatty()
