"""The drill autograder: exercises, a grader in a process of its own, and the command `drills`.

Importing this package is light: what is heavy is imported by the function that needs it.
"""

from __future__ import annotations

from typing import Any

_IN_NOTEBOOKS = ("badges", "card", "check", "solution")


def __getattr__(name: str) -> Any:
    if name in _IN_NOTEBOOKS:
        from drills import notebook

        return getattr(notebook, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
