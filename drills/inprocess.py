"""Our own code behind the interface of a child process: the reference, the slips, the proofs.

Only texts of this project are ever run here; a submission goes to `drills.sandbox.Child`.
"""

from __future__ import annotations

import contextlib
import copy
import functools
import hashlib
import inspect
import io
import pickle
import time
import traceback
import types
import warnings
from collections.abc import Callable
from typing import Any, ClassVar, Self

import numpy as np

from drills.sandbox import Foreign, Frame, Handle, Loaded, MissingName, Parameter, Raised, wire


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
    # Answers and their times, by a text and all that it was asked up to there; None keeps none.
    memory: ClassVar[dict[bytes, tuple[Any, float]] | None] = None

    def __init__(self, source: str, given: str = "") -> None:
        self.elapsed = 0.0
        # What tells all that it was asked, while that was plain data; of that, what was not run.
        self._past, self._spared = repr((source, given)).encode(), list[bytes]()
        self._given = _module("given", given, {})
        self._module = _module("submission", source, {"given": self._given})

    def call(self, name: str, *args: Any, repeat: int = 1, **kwargs: Any) -> Any:
        """Call a function of the text; `elapsed` is then the time of all repeats [s]."""
        known, run = self.memory, getattr(self._module, name)
        if known is None or not self._past or repeat > 1 or not _is_data((args, kwargs)):
            return self._run(run, args, kwargs, repeat)
        requested = pickle.dumps((name, args, kwargs))
        past = hashlib.sha256(self._past + requested).digest()
        if past in known:
            self._spared.append(requested)
        elif _is_data(result := self._run(run, args, kwargs)):
            known[past] = copy.deepcopy(result), self.elapsed
        else:
            return result
        self._past = past
        result, self.elapsed = known[past]
        return copy.deepcopy(result)

    def new(self, name: str, *args: Any, **kwargs: Any) -> Local:
        """Call a function or class of the text; the result stays here, behind a handle."""
        return Local(self._run(getattr(self._module, name), args, kwargs))

    def method(self, handle: Local, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a method of an object made by `new` and return its result."""
        return self._run(getattr(handle.value, name), args, kwargs)

    def given(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a function of the given module and return its result."""
        return self._run(getattr(self._given, name), args, kwargs)

    def given_new(self, name: str, *args: Any, **kwargs: Any) -> Local:
        """Call a function or class of the given module; the result stays here."""
        return Local(self._run(getattr(self._given, name), args, kwargs))

    def fetch(self, handle: Local) -> Any:
        """Return the value of a handle."""
        return copy.deepcopy(handle.value)

    def evaluate(self, expression: str) -> Any:
        """Return the value of an expression in the namespace of the text, with `given`."""
        return eval(expression, {**self._module.__dict__, "given": self._given})

    def _run(self, function: Any, args: Any, kwargs: Any, repeat: int = 1) -> Any:
        # An answer may hang on what came before: what was remembered is run after all.
        spared, self._past, self._spared = self._spared, b"", []
        for name, *before in map(pickle.loads, spared):
            self._run(getattr(self._module, name), *before)
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


class StandIn:
    """A trusted text in the place of a child: what it gives comes back as it would from there.

    It answers as `drills.sandbox.Child` does and costs a tenth, so that a text of this project can
    be graded many times. Nothing holds it: a text that does not end, ends nothing.

    Args:
        source: the text.
        filename: its name in tracebacks.
        entry: the name that is graded.
        given: the text of the drill's given module, or "".
    """

    def __init__(self, source: str, *, filename: str, entry: str, given: str = "") -> None:
        self.changed = False
        self.elapsed = self.spent = self.used = 0.0
        self._source, self._filename, self._entry = source, filename, entry
        self._printed = io.StringIO()
        self._objects: dict[int, Any] = {}
        self._dropped: list[int] = []  # filled by the handles
        self._handles = 0
        self._functions: list[Callable[..., Any]] = []  # that the text may ask
        self._modules: dict[str, types.ModuleType] = {}
        self._modules["given"] = _module("given", given, self._modules)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._objects.clear()

    @property
    def output(self) -> str:
        """What the text printed so far."""
        return self._printed.getvalue()

    def load(self) -> Loaded:
        """Run the text."""

        def execute() -> types.ModuleType:
            return _module("submission", self._source, self._modules, self._filename)

        self._modules["submission"] = self._timed(execute)
        target = self._named("submission", self._entry)
        parameters = None
        with contextlib.suppress(TypeError, ValueError):
            result = inspect.signature(target).parameters.values()
            parameters = tuple(
                Parameter(p.name, p.kind.name.lower(), p.default is not p.empty) for p in result
            )
        return Loaded(parameters, callable(target), isinstance(target, type))

    def call(
        self, name: str, *args: Any, repeat: int = 1, seconds: float | None = None, **kwargs: Any
    ) -> Any:
        """Call a function of the text; no limit on its time holds here."""
        return self._answer(self._named("submission", name), args, kwargs, repeat)

    def new(self, name: str, *args: Any, **kwargs: Any) -> Handle:
        """Call a function or class of the text; the result stays here, behind a handle."""
        return self._create(self._named("submission", name), args, kwargs)

    def method(self, handle: Handle, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a method of an object made by `new` and return its result."""
        value = self._objects[handle._number]
        return self._answer(lambda *a, **k: getattr(value, name)(*a, **k), args, kwargs)

    def given(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a function of the given module and return its result."""
        return self._answer(self._named("given", name), args, kwargs)

    def given_new(self, name: str, *args: Any, **kwargs: Any) -> Handle:
        """Call a function or class of the given module; the result stays here."""
        return self._create(self._named("given", name), args, kwargs)

    def fetch(self, handle: Handle) -> Any:
        """Return the value of a handle."""
        return self._travelled(self._objects[handle._number])

    def _named(self, module: str, name: str) -> Any:
        names = self._modules[module].__dict__
        if name in names:
            return names[name]
        own = [n for n, v in names.items() if getattr(v, "__module__", "") == module]
        raise MissingName(name, [n for n in own if not n.startswith("_")])

    def _create(self, function: Callable[..., Any], args: Any, kwargs: Any) -> Handle:
        self._handles += 1
        self._objects[self._handles] = self._run(function, args, kwargs)
        return Handle(self, self._handles)

    def _answer(self, function: Callable[..., Any], args: Any, kwargs: Any, repeat: int = 1) -> Any:
        return self._travelled(self._run(function, args, kwargs, repeat))

    def _run(self, function: Callable[..., Any], args: Any, kwargs: Any, repeat: int = 1) -> Any:
        while self._dropped:
            self._objects.pop(self._dropped.pop(), None)
        self.changed = False
        sent = [self._sent(value) for value in (*args, *kwargs.values())]
        here = [wire.decode(data, self._resolved) for data in sent]
        named = dict(zip(kwargs, here[len(args) :], strict=True))

        def run() -> Any:
            for _ in range(repeat):
                result = function(*here[: len(args)], **named)
            return result

        result = self._timed(run)
        self.changed = any(
            isinstance(data, dict | list)
            and not (isinstance(data, dict) and data.keys() & {"h", "c"})
            and self._sent(x) != data
            for data, x in zip(sent, here, strict=True)
        )
        return result

    def _timed(self, run: Callable[[], Any]) -> Any:
        """Run it; what it raises comes back as from a child."""
        start, begun = time.perf_counter(), time.process_time()
        try:
            with contextlib.redirect_stdout(self._printed), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return run()
        except Exception as error:
            frames = [
                Frame(frame.lineno or 0, frame.name)
                for frame in traceback.extract_tb(error.__traceback__)
                if frame.filename == self._filename
            ]
            kinds = [kind.__name__ for kind in type(error).mro() if kind.__module__ == "builtins"]
            raise Raised(type(error).__name__, str(error)[:2000], frames, tuple(kinds)) from error
        finally:
            self.elapsed, self.spent = time.perf_counter() - start, time.process_time() - begun
            self.used += self.spent

    def _sent(self, value: Any) -> Any:
        """Return an argument as it travels; a handle or a function goes by its number."""

        def other(x: Any, name: str) -> Any:
            if isinstance(x, Handle):
                return {"h": x._number}
            if callable(x):
                self._functions.append(x)
                return {"c": len(self._functions) - 1}
            raise TypeError(f"an argument of type {name} can't be sent to the child")

        plain = value.item() if isinstance(value, np.generic) else value
        return wire.encode(plain, other, text=wire.FRAME)

    def _resolved(self, tag: str, number: Any) -> Any:
        return self._objects[number] if tag == "h" else self._asking(self._functions[number])

    def _asking(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function of the grader: its arguments and its answer travel."""

        def requested(*args: Any) -> Any:
            try:
                value = function(*map(self._travelled, args))
            except Exception as error:
                raise TypeError(f"{type(error).__name__}: {error}"[:500]) from None
            return wire.decode(self._sent(value), self._resolved)

        return requested

    def _travelled(self, value: Any) -> Any:
        """Return a result as it comes back: plain data, or the name of what does not travel."""
        try:
            data = wire.encode(value, lambda x, name: {"x": name})
        except wire.TooLarge as error:
            return Foreign(f"{wire.type_name(value)}, {error}")
        return wire.decode(data, lambda tag, name: Foreign(name))


def _is_data(value: Any) -> bool:
    if isinstance(value, list | tuple | dict):
        return all(map(_is_data, value.values() if isinstance(value, dict) else value))
    numbers = isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject
    return numbers or value is None or isinstance(value, bool | int | float | str)


def _received(argument: Any) -> Any:
    return argument.value if isinstance(argument, Local) else copy.deepcopy(argument)


def _module(
    name: str, source: str, modules: dict[str, types.ModuleType], filename: str = ""
) -> types.ModuleType:
    module = types.ModuleType(name)
    module.__dict__["__builtins__"] = _builtins_with(modules)
    exec(_compiled(source, filename or f"<{name}>"), module.__dict__)
    return module


@functools.lru_cache(maxsize=256)
def _compiled(source: str, filename: str) -> types.CodeType:
    """Return the code of a text; one that is asked again, as each slip is, is compiled once."""
    return compile(source, filename, "exec", dont_inherit=True)


def _builtins_with(modules: dict[str, types.ModuleType]) -> dict[str, Any]:
    """Return the builtins, with an import that finds the given module without registering it."""
    import builtins

    def find(name: str, *args: Any, **kwargs: Any) -> Any:
        return modules[name] if name in modules else builtins.__import__(name, *args, **kwargs)

    return {**vars(builtins), "__import__": find}
