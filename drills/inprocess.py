"""Our own code behind the interface of a child process: the reference, and the slips.

Only texts of this project are ever run here; a submission goes to `drills.sandbox.Child`.
"""

from __future__ import annotations

import contextlib
import copy
import io
import time
import types
import warnings
from typing import Any


class Local:
    """A handle of this side: an object that stays where it was made."""

    def __init__(self, value: Any) -> None:
        self.value = value


class InProcess:
    """Runs a trusted text with the calls of `drills.sandbox.Child`.

    Args:
        source: the text.
        given: the text of the drill's given module, or "".
    """

    changed = False

    def __init__(self, source: str, given: str = "") -> None:
        self.elapsed = 0.0
        self._given = _module("given", given, {})
        self._module = _module("submission", source, {"given": self._given})

    def call(self, name: str, *args: Any, repeat: int = 1, **kwargs: Any) -> Any:
        """A function of the text; `elapsed` is then the time of all repeats [s]."""
        return self._run(getattr(self._module, name), args, kwargs, repeat)

    def new(self, name: str, *args: Any, **kwargs: Any) -> Local:
        """The same, and the result stays here."""
        return Local(self._run(getattr(self._module, name), args, kwargs))

    def method(self, handle: Local, name: str, *args: Any, **kwargs: Any) -> Any:
        """A method of an object made by `new`."""
        return self._run(getattr(handle.value, name), args, kwargs)

    def given(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """A function of the given module."""
        return self._run(getattr(self._given, name), args, kwargs)

    def given_new(self, name: str, *args: Any, **kwargs: Any) -> Local:
        """The same, and the result stays here."""
        return Local(self._run(getattr(self._given, name), args, kwargs))

    def fetch(self, handle: Local) -> Any:
        """The value of a handle."""
        return copy.deepcopy(handle.value)

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the namespace of the text, with `given`."""
        return eval(expression, {**self._module.__dict__, "given": self._given})

    def _run(self, function: Any, args: Any, kwargs: Any, repeat: int = 1) -> Any:
        args = [_received(a) for a in args]
        kwargs = {key: _received(value) for key, value in kwargs.items()}
        with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            start = time.perf_counter()
            for _ in range(repeat):
                result = function(*args, **kwargs)
            self.elapsed = time.perf_counter() - start
        # A child's answer is a copy; an object handed on as a handle must not be copied.
        return result


def _received(argument: Any) -> Any:
    return argument.value if isinstance(argument, Local) else copy.deepcopy(argument)


def _module(name: str, source: str, modules: dict[str, types.ModuleType]) -> types.ModuleType:
    module = types.ModuleType(name)
    module.__dict__["__builtins__"] = _builtins_with(modules)
    exec(compile(source, f"<{name}>", "exec"), module.__dict__)
    return module


def _builtins_with(modules: dict[str, types.ModuleType]) -> dict[str, Any]:
    """The builtins, with an import that finds the given module without registering it."""
    import builtins

    def find(name: str, *args: Any, **kwargs: Any) -> Any:
        return modules[name] if name in modules else builtins.__import__(name, *args, **kwargs)

    return {**vars(builtins), "__import__": find}
