"""The first case that failed as code: complete, so that it can be pasted below an answer and run.

The feedback cuts long values so that they can be read. This text cuts nothing: it makes the same
requests with the same arguments, and prints what came back beside what was expected.
"""

from __future__ import annotations

import ast
import inspect
import itertools
import math
import textwrap
import types
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from drills.attempt import Attempt, Step
from drills.exercise import Exercise
from drills.grade_report import Check
from drills.inprocess import Local
from drills.reasons import Reason
from drills.sandbox import Handle
from drills.values import Failure, Mismatch, as_float64, describe_call, identical

WIDTH = 96  # columns of a line, where a value can be broken
_DEFAULT = {np.dtype(np.float64), np.dtype(np.int64), np.dtype(np.bool_)}


def case_code(attempt: Attempt, graded: Exercise, check: Check | None) -> str:
    """Return the case of a failed check, or of the request that ended the run, as a program.

    Args:
        attempt: the grading, after its end.
        graded: the exercise.
        check: the failed check, or None where a request ended the run.

    Returns:
        The program, or "" where nothing was requested yet.
    """
    report = attempt.report
    chosen = _relevant(attempt, check)
    if not chosen:
        return ""
    page = _Program(attempt, graded)
    level = ""
    if check is not None and check.part >= 0:
        part = report.parts[check.part]
        level = f", {part.level} case: {part.label}"
    page.comment(f"{attempt.card.name}, seed {report.seed}{level}")
    if check is not None:
        page.comment(f"{check.name}: {check.sentence}" if check.sentence else check.name)
    elif report.problem is not None:
        page.comment(f"It raises {report.problem.type}: {report.problem.message}")
    else:
        page.comment(report.sentence)
    page.requests(chosen, check is not None and check.reason is Reason.INPUTS_CHANGED)
    if check is not None:
        page.comparison(check, chosen[-1])
    return page.text()


def _relevant(attempt: Attempt, check: Check | None) -> list[Step]:
    """Return the requests that a failure needs, in order.

    A call of a function needs only itself, unless the answers depend on the calls before. An object
    needs all that was ever done with it.
    """
    learner = attempt.learner
    steps = [*learner.steps, *([learner.pending] if learner.pending else [])]
    count = len(steps) if check is None else check.requests
    if check is not None and check.reason is Reason.NOT_DETERMINISTIC:
        return steps[:count]
    case = attempt.in_case if check is None else check.part
    inside = [
        step for step, part in zip(steps[:count], learner.parts, strict=False) if part == case
    ]
    if not inside:  # a check of what all cases returned
        inside = steps[max(count - 1, 0) : count]
    if attempt.card.kind == "function" and inside:
        calls = [step for step in inside if step.kind == "call"]
        if check is None or _compared(check, inside[-1]) is not None:
            inside = calls[-1:] or inside
        elif check.call:
            same = [s for s in calls if describe_call(s.target, s.args, s.kwargs) == check.call]
            inside = same[-1:] or inside
    handles = {id(value) for step in inside for value in _handles(step)}
    begun = next((at for at, step in enumerate(steps) if step is inside[0]), 0) if inside else 0
    before: list[Step] = []
    for step in reversed(steps[:begun]):
        # What was done to an object before, and with what else, from the last to the first.
        if handles & {id(value) for value in _handles(step)}:
            handles |= {id(value) for value in _handles(step)}
            before.append(step)
    return before[::-1] + inside


def _handles(step: Step) -> list[Handle]:
    """Return the objects that a request uses or makes."""

    def inside(value: Any) -> list[Handle]:
        if isinstance(value, Handle):
            return [value]
        if isinstance(value, list | tuple):
            return [one for item in value for one in inside(item)]
        if isinstance(value, dict):
            return [one for item in value.values() for one in inside(item)]
        return []

    return inside([step.handle, step.args, step.kwargs, step.result])


class _Program:
    """Lines of code: what has to be defined first, then the requests.

    Attributes:
        given: source of the judge's module; it may import `submission`.
        definitions: lines that define what the requests use.
        lines: the requests, in their order.
    """

    def __init__(self, attempt: Attempt, graded: Exercise) -> None:
        self.attempt = attempt
        self.given = graded.given
        self.uses_given = False
        self.comments: list[str] = []
        self.definitions: list[str] = []
        self.lines: list[str] = []
        self.names: dict[int, str] = {}  # of objects, by the identity of their handles
        self.defined: dict[int, str] = {}  # of functions, by their identity

    def comment(self, text: str) -> None:
        """Add a sentence at the top."""
        from drills.feedback import clean

        flat = " ".join(clean(text).split())
        self.comments += textwrap.wrap(flat, WIDTH, initial_indent="# ", subsequent_indent="# ")

    def text(self) -> str:
        """Return the whole program."""
        body = "\n".join([*self.definitions, *self.lines])
        imports = ["import numpy as np"]
        if "deepcopy(" in body:
            imports.insert(0, "from copy import deepcopy")
        if self.uses_given:
            imports[:0] = ["import sys", "import types"]
        entry, file = self.attempt.card.entry, Path(self.attempt.report.filename)
        if file.suffix == ".py" and file.stem.isidentifier():
            imports += ["", f"from {file.stem} import {entry}  # not needed below your own code"]
        head = [*self.comments, *imports, ""]
        if self.uses_given:
            head += [
                'submission = types.ModuleType("submission")',
                f"submission.{entry} = {entry}",
                'sys.modules["submission"] = submission',
                'given = types.ModuleType("given")',
                f"exec({_text_literal(self.given)}, given.__dict__)",
                "",
            ]
        return "\n".join([*head, body, ""])

    def requests(self, steps: Sequence[Step], watched: bool = False) -> None:
        """Add the requests; the last result is called `got`.

        Args:
            steps: the requests.
            watched: keep a copy of the arguments of the last one, called `before`.
        """
        for number, step in enumerate(steps, 1):
            last = number == len(steps)
            self._request(step, last, alone=len(steps) == 1, watched=watched and last)

    def _request(self, step: Step, last: bool, alone: bool, watched: bool) -> None:
        if step.kind == "method":
            function = f"{self.names[id(step.handle)]}.{step.target}"
        elif step.kind in ("given", "given_new"):
            function, self.uses_given = f"given.{step.target}", True
        else:
            function = step.target
        texts = [self.value(value) for value in step.args]
        if alone and step.kind == "call":
            # A single call reads best with its arguments by name.
            names = [value.name for value in self.attempt.card.signatures[0].arguments]
            names = [name for name, _ in zip(names, texts, strict=False)]
            if len(names) == len(texts):
                for name, text in zip(names, texts, strict=True):
                    if text != name:
                        self.lines += _broken(f"{name} = {text}")
                texts = names
        if watched:
            self.lines += _broken(f"arguments = [{', '.join(texts)}]")
            self.lines.append("before = deepcopy(arguments)")
            texts = ["*arguments"]
        texts += [f"{key}={self.value(value)}" for key, value in step.kwargs.items()]
        call = f"{function}({', '.join(texts)})"
        if isinstance(step.result, Handle):
            name = self.names[id(step.result)] = f"{step.target.lower()}_{len(self.names) + 1}"
            self.lines += _broken(f"{name} = {call}")
        elif isinstance(step.result, Failure) and not last:
            # An error that was asked for, before the request that failed.
            self.lines += ["try:", *("    " + line for line in _broken(call))]
            self.lines += [f"except Exception as error:  # {step.result.type}", "    print(error)"]
        else:
            self.lines += _broken(f"got = {call}" if last else call)

    def value(self, value: Any) -> str:
        """Return a value as code; what it needs is defined before."""
        if isinstance(value, Handle | Local):
            return self.names[id(value)]
        if callable(value):
            return self._function(value)
        if isinstance(value, list | tuple):
            inside = ", ".join(map(self.value, value))
            if isinstance(value, list):
                return f"[{inside}]"
            return f"({inside},)" if len(value) == 1 else f"({inside})"
        if isinstance(value, dict):
            return "{" + ", ".join(f"{k!r}: {self.value(v)}" for k, v in value.items()) + "}"
        return literal(value)

    def _function(self, function: Callable[..., Any]) -> str:
        """Define a function that the grader answers, and return its name."""
        if id(function) in self.defined:
            return self.defined[id(function)]
        if hasattr(function, "code"):  # an object that says how it is written
            name, text = str(getattr(function, "__name__", "function")), str(function.code())
            self.definitions += [*text.strip().splitlines(), ""]
        else:
            assert isinstance(function, types.FunctionType)
            name = function.__name__
            for free, cell in zip(
                function.__code__.co_freevars, function.__closure__ or (), strict=True
            ):
                self.definitions += _broken(f"{free} = {self.value(cell.cell_contents)}")
            self.definitions += [*_bare_source(function).splitlines(), ""]
        self.defined[id(function)] = name
        return name

    def comparison(self, check: Check, step: Step) -> None:
        """Add what shows the failure: the result beside what was expected."""
        if check.reason is Reason.INPUTS_CHANGED:
            self.lines += ['print("before", before)', 'print("after ", arguments)']
            return
        if check.values is None:
            if not isinstance(step.result, Handle | Failure):
                self.lines.append('print("got", got)')
            if check.expected:
                self.lines += _broken(f"# Expected: {check.expected}"[:WIDTH])
            return
        got, truth = check.values
        place = _compared(check, step)
        if place is None:
            return
        self.lines += ["", *([f"got = got{place}"] if place else [])]
        self.lines += _broken(f"expected = {literal(truth)}")
        self.lines += ['print("got", got)', 'print("expected", expected)']
        try:
            as_float64(got, truth.shape)
        except Mismatch:
            return
        allowed = "" if math.isnan(check.tolerance) else f", {check.tolerance:g} allowed"
        self.lines += [
            "error = np.max(np.abs(np.asarray(got, dtype=float) - expected), initial=0.0)",
            f'print(f"error {{error:.3g}}{allowed}")',
        ]


def _compared(check: Check, step: Step) -> str | None:
    """Return where the compared value is in a result: "", "[1]", or None if it is not there."""
    if check.values is None:
        return None
    got, result = check.values[0], step.result
    if got is result or _same(got, result):
        return ""
    if isinstance(result, list | tuple) or (isinstance(result, np.ndarray) and result.ndim):
        for at, part in enumerate(result):
            if got is part or _same(got, part):
                return f"[{at}]"
    return None


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray | np.generic):
        return identical(one, np.asarray(other))
    return identical(one, other) and not isinstance(one, Failure)


def literal(value: Any) -> str:
    """Return plain data as code that makes the same value, to the last bit."""
    if isinstance(value, np.ndarray):
        kind = "" if value.dtype in _DEFAULT else f", dtype=np.{value.dtype.name}"
        if value.size == 0:
            return f"np.zeros({value.shape}, dtype=np.{value.dtype.name})"
        return f"np.array({literal(value.tolist())}{kind})"
    if isinstance(value, np.generic):
        return literal(value.item())
    if isinstance(value, bool) or value is None:
        return repr(value)
    if isinstance(value, float):
        if math.isnan(value):
            return "np.nan"
        return repr(value) if math.isfinite(value) else f"{'-' * (value < 0)}np.inf"
    if isinstance(value, list):
        return f"[{', '.join(map(literal, value))}]"
    return repr(value)


def _bare_source(function: types.FunctionType) -> str:
    """Return the text of a function without annotations, whose names are not defined here."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            node.returns = None
            arguments = node.args
            for argument in itertools.chain(
                arguments.posonlyargs, arguments.args, arguments.kwonlyargs
            ):
                argument.annotation = None
    return ast.unparse(tree)


def _text_literal(text: str) -> str:
    """Return a program as a literal that can be read line by line."""
    escaped = text.replace("\\", "\\\\").replace("'''", "\\'\\'\\'")
    return f"'''\n{escaped}'''"


def _broken(line: str) -> list[str]:
    """Return a line of code in lines of `WIDTH` columns: it is broken at commas in brackets."""
    if len(line) <= WIDTH or "'" in line or '"' in line:
        return [line]
    return textwrap.wrap(
        line, WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False
    )
