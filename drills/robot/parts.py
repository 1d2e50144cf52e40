"""The parts in their slots: every call is timed, limited, checked, and named where it fails."""

from __future__ import annotations

import math
import signal
import sys
import time
import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from drills.robot.records import Breach, Failure
from drills.robot.slots import NAMED, STAGES, Part, fits, stage_of

CALL = 1.0  # s of processor time that one call may take
TASK = 8.0  # s that the calls of one stage may take in one task


class PartFailed(Exception):
    """A part stopped the run; `failure` says how."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.text)
        self.failure = failure


class _TooSlow(BaseException):
    """Raised by the alarm inside a call. Not an Exception, which a part might catch."""


def _alarm(number: int, frame: Any) -> None:
    raise _TooSlow


def literal(value: Any) -> str:
    """Return a value as code; a long array with as many digits as it takes."""
    if isinstance(value, np.ndarray):
        return f"np.array({value.tolist()!r})".replace("nan", "np.nan").replace("inf", "np.inf")
    if callable(value):
        return "acceleration"
    if isinstance(value, np.generic):
        return repr(value.item())
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        fields = zip(value._fields, value, strict=True)
        return f"{type(value).__name__}({', '.join(f'{k}={literal(v)}' for k, v in fields)})"
    return repr(value)


def call_text(entry: str, args: Sequence[Any]) -> str:
    """Return a call as code that can be pasted after `import numpy as np`."""
    text = f"{entry}({', '.join(literal(a) for a in args)})"
    flat = [value for a in args for value in (a if isinstance(a, tuple) else (a,))]
    if any(callable(value) for value in flat):
        # The only function that a part is passed: the joints' accelerations, almost constant.
        q, acceleration = flat[0], next(value for value in flat if callable(value))
        text = f"acceleration = lambda q: {literal(acceleration(q))}\n{text}"
    return text


def load_part(part: Part) -> Callable[..., Any]:
    """Return the function that a part's text defines.

    Raises:
        PartFailed: where the text does not run, or lacks the function.
    """

    def failed(kind: str, text: str, line: int = 0) -> PartFailed:
        return PartFailed(Failure(part.slot, kind, text, 0, -1, line, f"import {part.slot}"))

    # A name of its own for each part, under which a traceback can find it.
    name = f"robot_part_{part.slot}"
    module = types.ModuleType(name)
    sys.modules[name] = module
    try:
        exec(compile(part.source, part.filename, "exec", dont_inherit=True), module.__dict__)
    except SyntaxError as error:
        raise failed("raised", f"SyntaxError: {error.msg}", error.lineno or 0) from None
    except Exception as error:
        text = f"{type(error).__name__}: {error}"
        raise failed("raised", text[:300], _line(error, part.filename)) from None
    function = module.__dict__.get(part.entry)
    if not callable(function):
        raise failed("raised", f"the file defines no function {part.entry}")
    return function


def _line(error: BaseException, filename: str) -> int:
    trace, line = error.__traceback__, 0
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == filename:
            line = trace.tb_lineno
        trace = trace.tb_next
    return line


class Bench:
    """The parts of one robot, with a stopwatch and a notebook.

    Args:
        parts: one for each slot.
        promises: checks of a slot's results, by its name: (args, result) -> "" or a sentence.
        limit: processor time of one call [s]; 0 for trusted parts.
        functions: known parts by slot, whose results need no check; the others are loaded from
            their text.
    """

    def __init__(
        self,
        parts: dict[str, Part],
        promises: dict[str, Callable[[tuple[Any, ...], Any], str]],
        limit: float = CALL,
        functions: Mapping[str, Callable[..., Any]] | None = None,
    ) -> None:
        self.parts, self.promises, self.limit = parts, promises, limit
        self.entering: Callable[[str, int, str], object] | None = None  # called before each call
        self.known = ready = functions or {}
        self.functions = {
            name: ready[name] if name in ready else load_part(part) for name, part in parts.items()
        }
        self.task = self.tick = 0
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.counts: dict[str, int] = {}
        self.breaches: dict[str, Breach] = {}
        if limit:
            signal.signal(signal.SIGVTALRM, _alarm)

    def begin(self, task: int) -> None:
        """Start a task: the counts of calls begin again, and so does the clock."""
        self.task, self.tick, self.counts = task, 0, {}
        self.seconds = dict.fromkeys(STAGES, 0.0)
        self.breaches = {}

    def call(self, name: str, *args: Any) -> Any:
        """Call a part.

        Returns:
            Its results as float arrays (a number as a float), a tuple where there are several.

        Raises:
            PartFailed: for an exception, a result of another shape or type, NaN, or a call that
                takes too long.
        """
        if self.entering is not None:
            self.entering(name, self.tick, call_text(self.parts[name].entry, args)[:200_000])
        begun = time.perf_counter()
        try:
            if self.limit:
                signal.setitimer(signal.ITIMER_VIRTUAL, self.limit)
            try:
                result = self.functions[name](*args)
            finally:
                if self.limit:
                    signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        except _TooSlow as error:
            text = f"no answer within {self.limit:g} s of processor time"
            raise self.failed(name, "too slow", text, args, error) from None
        except BaseException as error:  # sys.exit() too would end the whole run
            if not self.limit and not isinstance(error, Exception):
                raise  # a trusted part runs in this process: it is Ctrl-C or the end of the command
            text = f"{type(error).__name__}: {error}"[:300]
            raise self.failed(name, "raised", text, args, error) from None
        finally:
            self.seconds[stage_of(name)] += time.perf_counter() - begun
        if self.limit and self.seconds[stage_of(name)] > TASK:
            text = f"{self.counts.get(name, 0) + 1} calls in this task; its stage took {TASK:g} s"
            raise self.failed(name, "too slow", text, args)
        if name in self.known:
            return result
        if name in NAMED:
            result = self._results(name, result, args)
        count = self.counts.get(name, 0)
        self.counts[name] = count + 1
        every = NAMED[name].every if name in NAMED else 1
        if name in self.promises and name not in self.breaches:
            if count < 3 or count % every == 0:
                self.check(name, args, result)
        return result

    def check(self, name: str, args: tuple[Any, ...], result: Any) -> None:
        """Note the first promise that a part breaks in this task."""
        text = self.promises[name](args, result)
        if text:
            entry = self.parts[name].entry
            breach = Breach(name, text, self.tick, self.task, call_text(entry, args))
            self.breaches[name] = breach

    def failed(
        self, name: str, kind: str, text: str, args: tuple[Any, ...], error: Any = None
    ) -> PartFailed:
        """Return the error for a part that can't go on."""
        part = self.parts[name]
        line = _line(error, part.filename) if error is not None else 0
        call = call_text(part.entry, args)
        return PartFailed(Failure(name, kind, text, self.tick, self.task, line, call))

    def _results(self, name: str, result: Any, args: tuple[Any, ...]) -> Any:
        shapes = NAMED[name].returns
        several = len(shapes) > 1
        if several and (not isinstance(result, tuple | list) or len(result) != len(shapes)):
            text = f"returned {_kind(result)}; {len(shapes)} values are expected"
            raise self.failed(name, "wrong type", text, args)
        values: list[Any] = []
        for i, (value, shape) in enumerate(
            zip(result if several else (result,), shapes, strict=True)
        ):
            where = f"result {i + 1} of {len(shapes)}" if several else "the result"
            try:
                if value is None:
                    raise TypeError("nothing was returned")
                array = np.asarray(value, dtype=float)
            except (TypeError, ValueError):
                text = f"{where} is {_kind(value)}; numbers are expected"
                raise self.failed(name, "wrong type", text, args) from None
            if not fits(array.shape, shape):
                desired = str(shape).replace("None", "n")
                text = f"{where} has the shape {array.shape}; {desired} is expected"
                raise self.failed(name, "wrong shape", text, args)
            # A finite sum is faster to see, and enough but for an overflow.
            if not math.isfinite(array.sum()) and not np.isfinite(array).all():
                bad = "NaN" if np.isnan(array).any() else "an infinite number"
                raise self.failed(name, "not finite", f"{where} contains {bad}", args)
            values.append(array if shape else float(array))
        return tuple(values) if several else values[0]


def _kind(value: Any) -> str:
    return "None" if value is None else f"a value of type {type(value).__name__}"
