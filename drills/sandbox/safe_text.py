"""Words for a verdict: foreign text made safe, and amounts of bytes."""

from __future__ import annotations


def readable(text: str) -> str:
    """Return text of foreign origin, safe to print.

    Control characters and lone surrogates are spelled out.
    """
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return "".join(
        c if c in "\n\t" or (c.isprintable() or c == " ") else c.encode("unicode_escape").decode()
        for c in text.replace("\r\n", "\n")
    )


def size_text(count: int) -> str:
    """Return bytes for people."""
    for unit, name in ((1 << 30, "GiB"), (1 << 20, "MiB"), (1 << 10, "KiB")):
        if count >= unit:
            return f"{count / unit:.3g} {name}"
    return f"{count} bytes"
