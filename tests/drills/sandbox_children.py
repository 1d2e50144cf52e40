"""Children for the tests of the sandbox: short limits, and a submission run to its end."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Any

import pytest

from drills.sandbox import Child, Ended, Limits

QUICK = Limits(call=0.5, patience=3, memory=512 << 20, output=1 << 18, disk=2 << 20)
PLAIN = """
import numpy as np

def same(x, *more):
    return x
"""


def child(source: str, entry: str = "f", **options: Any) -> Child:
    options.setdefault("limits", QUICK)
    return Child(source, filename="answer.py", entry=entry, **options)


@contextlib.contextmanager
def loaded(source: str, entry: str = "f", **options: Any) -> Iterator[Child]:
    with child(source, entry, **options) as running:
        running.load()
        yield running


def ended(source: str, **options: Any) -> Ended:
    """How a submission ends when its `f` is loaded and called."""
    with child(source, **options) as running:
        with pytest.raises(Ended) as caught:
            running.load()
            running.call("f")
        with pytest.raises(Ended):  # it stays ended
            running.call("f")
        return caught.value
