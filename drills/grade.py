"""The grader: it runs a submission in a child, judges what comes back, and says why.

The parent draws the inputs, holds the right answers and decides; the child only computes.
"""

from __future__ import annotations

import ast
import math
import secrets
import statistics
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drills import exercise as catalogue
from drills.exercise import Card, Exercise, Slip
from drills.inprocess import InProcess
from drills.reasons import SENTENCES, Reason
from drills.report import Check, Cost, Problem, Report
from drills.sandbox import (
    Child,
    Ended,
    Handle,
    Limits,
    Loaded,
    MissingName,
    Raised,
    SyntaxProblem,
)
from drills.values import (
    Failure,
    Mismatch,
    as_float64,
    close,
    describe,
    describe_call,
    identical,
    type_name,
    worst,
)

Array = NDArray[np.float64]

PARSED = 20_000  # characters of foreign text parsed here; the time can grow as their square
SHOWN = 160  # characters of a value in the feedback


@dataclass(frozen=True)
class Step:
    """One recorded request to the child, and what came back."""

    kind: str
    target: str
    handle: Handle | None
    args: tuple[Any, ...]
    kwargs: dict[str, Any]
    result: Any


class Learner:
    """The submission in its child: every request is recorded, and its arguments watched."""

    def __init__(self, child: Child, attempt: Attempt) -> None:
        self.child = child
        self.steps: list[Step] = []
        self.loading = 0.0  # s, the submission's top level
        self.asked = ""  # the last request, as one would type it
        self.longest = 0.0  # s, the slowest request so far by this side's clock
        self._attempt = attempt

    def call(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """A function of the submission."""
        return self._record("call", name, None, args, kwargs)

    def new(self, name: str, *args: Any, **kwargs: Any) -> Handle:
        """An object of the submission, which stays in the child."""
        return self._record("new", name, None, args, kwargs)

    def method(self, handle: Handle, name: str, *args: Any, **kwargs: Any) -> Any:
        """A method of an object that is in the child."""
        return self._record("method", name, handle, args, kwargs)

    def given(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """A function of the drill's given module, run in the child."""
        return self._record("given", name, None, args, kwargs)

    def given_new(self, name: str, *args: Any, **kwargs: Any) -> Handle:
        """The same, and the result stays in the child."""
        return self._record("given_new", name, None, args, kwargs)

    def _record(
        self, kind: str, name: str, handle: Handle | None, args: Any, kwargs: dict[str, Any]
    ) -> Any:
        kept = _copied(args), _copied(kwargs)
        self.asked = describe_call(name, *kept) if kind in ("call", "new", "method") else ""
        try:
            result = _request(self.child, kind, name, handle, args, kwargs)
        except Raised as raised:
            self.steps.append(Step(kind, name, handle, *kept, Failure(raised.type)))
            raise
        self.longest = max(self.longest, self.child.elapsed)
        self.steps.append(Step(kind, name, handle, *kept, result))
        if kind in ("call", "method", "new") and self.child.changed:
            self._attempt.inputs_changed(self.asked)
        return result


class Attempt:
    """One grading: what a judge works with.

    Attributes:
        rng: the generator of this run's hidden cases, from the printed seed.
        learner: the submission in its child.
        reference: the worked answer in this process, with the same calls as `learner`.
        card, exercise: what is graded.
        report: what was found so far.
    """

    def __init__(self, card: Card, exercise: Exercise, child: Child, report: Report) -> None:
        self.card = card
        self.exercise = exercise
        self.report = report
        self.rng = np.random.default_rng(report.seed)
        self.learner = Learner(child, self)
        self.reference = InProcess(card.solution_text(), exercise.given)

    @property
    def failed(self) -> bool:
        """Whether a check has failed so far."""
        return any(not check.passed for check in self.report.checks)

    def call(self, *args: Any, **kwargs: Any) -> Any:
        """The submission's function, for an exercise that is one function."""
        return self.learner.call(self.card.entry, *args, **kwargs)

    def expected(self, *args: Any, **kwargs: Any) -> Any:
        """What the worked answer gives for the same call."""
        return self.reference.call(self.card.entry, *args, **kwargs)

    def compare(
        self,
        name: str,
        got: Any,
        expected: ArrayLike,
        *,
        tolerance: float,
        unit: str,
        why: str,
        call: str = "",
        slip: str = "",
    ) -> bool:
        """Check a value: type, shape, finite, then the worst component against the tolerance.

        Args:
            name: what is compared, in a few words.
            got: what came back.
            expected: the right values; their shape is the shape asked for.
            tolerance: largest error of a component that is right.
            unit: of the values.
            why: the reason of the tolerance.
            call: the call, as `describe_call` writes it.
            slip: the slip that a wrong value here shows, if it can only be that one.

        Returns:
            Whether it is right.
        """
        truth = np.asarray(expected, dtype=np.float64)
        base: dict[str, Any] = {"name": name, "call": call, "unit": unit, "why": why}
        base |= {"tolerance": tolerance, "expected": describe(truth, SHOWN)}
        try:
            values = as_float64(got, truth.shape)
        except Mismatch as wrong:
            said = wrong.sentence[0].upper() + wrong.sentence[1:]
            self._add(Check(**base, reason=wrong.reason, sentence=said, got=describe(got, SHOWN)))
            return False
        error, place = worst(values, truth)
        if not (error <= tolerance):
            at = f" at index {place}" if place else ""
            off = f"{error:.3g}" if unit in ("", "1") else f"{error:.3g} {unit}"
            digits = 6 if f"{values[place]:.6g}" != f"{truth[place]:.6g}" else 16
            sentence = (
                f"Off by {off}{at}: {values[place]:.{digits}g}, not {truth[place]:.{digits}g}."
            )
            base |= {"reason": Reason.WRONG_VALUE, "sentence": sentence, "slip": slip}
            self._add(Check(**base, error=error, got=describe(values, SHOWN)))
            return False
        self._add(Check(**base, reason=Reason.RIGHT, error=error, got=describe(values, SHOWN)))
        return True

    def require(
        self,
        name: str,
        holds: bool,
        *,
        sentence: str,
        got: str = "",
        expected: str = "",
        error: float = math.nan,
        tolerance: float = math.nan,
        unit: str = "",
        why: str = "",
        call: str = "",
        slip: str = "",
        reason: Reason = Reason.WRONG_PROPERTY,
    ) -> bool:
        """Check a property; `sentence` says what is wrong when it does not hold.

        Where there are an error and a tolerance, hand them in, and `holds` must come from
        `error <= tolerance`, so that a NaN fails.
        """
        if not holds:
            self._add(
                Check(
                    name, reason, sentence, call, got, expected, error, tolerance, unit, why, slip
                )
            )
            return False
        self._add(Check(name, Reason.RIGHT, "", call, got, expected, error, tolerance, unit, why))
        return True

    def require_error(
        self,
        name: str,
        request: Callable[[], Any],
        *,
        sentence: str,
        errors: Sequence[str] = ("ValueError",),
        call: str = "",
        slip: str = "",
    ) -> bool:
        """Check that a wrong argument is refused with one of the named exceptions."""
        expected = " or ".join(errors)
        try:
            value = request()
        except Raised as raised:
            if raised.type in errors or not set(errors).isdisjoint(raised.kinds):
                self._add(Check(name, Reason.RIGHT, call=call, got=raised.type, expected=expected))
                return True
            got, said = raised.type, f"It raised {raised.type}, not {expected}. {sentence}"
            slip = ""  # it was refused after all
        else:
            got, said = f"returned {describe(value)}", sentence
        self._add(Check(name, Reason.MISSING_ERROR, said, call, got, expected, slip=slip))
        return False

    def parts(self, got: Any, names: Sequence[str], *, call: str = "") -> tuple[Any, ...] | None:
        """The members of an answer that is a tuple, or None after a failed check.

        A list, or an array with one row for each member, is as good as a tuple.
        """
        if isinstance(got, np.ndarray) and got.ndim > 0 and len(got) < 100:
            got = [np.asarray(row) for row in got]
        if isinstance(got, list | tuple) and len(got) == len(names):
            return tuple(got)
        wanted = f"{len(names)} values ({', '.join(names)})"
        if got is None:
            reason, sentence = Reason.NOTHING_RETURNED, SENTENCES[Reason.NOTHING_RETURNED]
        elif isinstance(got, list | tuple) or (isinstance(got, np.ndarray) and got.ndim > 0):
            reason, sentence = Reason.WRONG_SHAPE, f"{len(got)} came back; {wanted} are asked for."
        else:
            reason = Reason.WRONG_TYPE
            sentence = f"One {type_name(got)} came back; {wanted} are asked for."
        self._add(Check("the answer's parts", reason, sentence, call, describe(got), wanted))
        return None

    def numbers(
        self, name: str, got: Any, shape: tuple[int, ...], *, call: str = ""
    ) -> Array | None:
        """What came back as finite float64 of that shape, or None after a failed check."""
        try:
            return as_float64(got, shape)
        except Mismatch as wrong:
            said = wrong.sentence[0].upper() + wrong.sentence[1:]
            self._add(Check(name, wrong.reason, said, call, describe(got)))
            return None

    def cost(self, what: str, unit: str, *, yours: float, reference: float) -> None:
        """Say what the submission spent beside the reference."""
        self.report.costs.append(Cost(what, unit, yours, reference))

    def time_call(
        self,
        *args: Any,
        here: tuple[Any, ...] | None = None,
        repeat: int = 300,
        what: str = "time per call",
    ) -> None:
        """Time one call of the function, there and here in turn, by this side's clock.

        Args:
            args: of the call.
            here: arguments of the reference, where a handle needs its counterpart.
            repeat: calls in a row; fewer where they would take longer than 0.2 s.
            what: what is timed.
        """
        child, entry = self.learner.child, self.card.entry
        single = math.inf  # one call, with the way there and back
        for _ in range(4):
            child.call(entry, *args, repeat=1)
            single = min(single, child.elapsed)
        many = max(1, min(repeat, int(0.2 / max(single, 1e-6))))
        yours, ours = [], []
        for _ in range(3):
            child.call(entry, *args, repeat=many + 1)
            yours.append((child.elapsed - single) / many)
            self.reference.call(entry, *(here or args), repeat=many)
            ours.append(self.reference.elapsed / many)
        middle = max(statistics.median(yours), 0.0)
        self.cost(what, "s", yours=middle, reference=statistics.median(ours))

    def inputs_changed(self, call: str) -> None:
        """Record that a call changed one of its arguments."""
        if not any(check.reason is Reason.INPUTS_CHANGED for check in self.report.checks):
            sentence = SENTENCES[Reason.INPUTS_CHANGED]
            self._add(Check("inputs unchanged", Reason.INPUTS_CHANGED, sentence, call))

    def _add(self, check: Check) -> None:
        self.report.checks.append(check)


@dataclass(frozen=True)
class Case:
    """One call of a function exercise: its arguments, and a word on what is special."""

    args: tuple[Any, ...]
    label: str = "random"


def judge_function(
    attempt: Attempt,
    cases: Sequence[Case],
    *,
    tolerance: float | Callable[[Case], float],
    unit: str,
    why: str,
    repeated: int = 3,
) -> None:
    """Judge a pure function: every case in random order, some of them twice.

    Args:
        attempt: the grading.
        cases: the calls; the worked answer says what is right.
        tolerance: largest error of a component, one for all or by case.
        unit: of the result.
        why: the reason of the tolerance.
        repeated: how many calls are made again at the end and must give the same bits.
    """
    order = attempt.rng.permutation(len(cases))
    first: list[tuple[Case, Any]] = []
    for index in order:
        case = cases[index]
        got = attempt.call(*case.args)
        first.append((case, got))
        allowed = tolerance(case) if callable(tolerance) else tolerance
        attempt.compare(
            case.label,
            got,
            attempt.expected(*case.args),
            tolerance=allowed,
            unit=unit,
            why=why,
            call=describe_call(attempt.card.entry, case.args),
        )
    if attempt.failed:
        return
    repeat_calls(attempt, [(case.args, got) for case, got in first], repeated)
    if not attempt.failed:
        attempt.time_call(*cases[-1].args)


def repeat_calls(
    attempt: Attempt, first: Sequence[tuple[tuple[Any, ...], Any]], repeated: int = 3
) -> None:
    """Make some of the calls again: the bits must be the same.

    Args:
        attempt: the grading, of a function.
        first: arguments and answer of each call.
        repeated: how many are made again.
    """
    for i in attempt.rng.choice(len(first), size=min(repeated, len(first)), replace=False):
        args, before = first[i]
        again = attempt.call(*args)
        same = identical(before, again)
        attempt.require(
            "same call, same answer",
            same,
            sentence="The same call gave another answer the second time.",
            got=describe(again),
            expected=describe(before),
            call=describe_call(attempt.card.entry, args),
            reason=Reason.NOT_DETERMINISTIC,
        )


def grade(
    name: str,
    source: str,
    *,
    filename: str = "submission.py",
    seed: int | None = None,
    starter_too: bool = False,
) -> Report:
    """Grade a submission.

    Args:
        name: of the exercise.
        source: the submission's text.
        filename: how messages call it.
        seed: of the hidden cases; drawn afresh when None, and in the report either way.
        starter_too: judge an untouched starter as well, instead of saying "not attempted".

    Returns:
        The report; a wrong or hostile submission never raises here.

    Raises:
        UnknownExercise: for a name that isn't in the catalogue.
    """
    card = catalogue.card(name)
    chosen = secrets.randbits(32) if seed is None else seed
    if not starter_too and is_starter(card, source):
        report = Report(card.name, chosen, filename, source)
        report.reason = Reason.NOT_ATTEMPTED
        report.sentence = SENTENCES[Reason.NOT_ATTEMPTED]
        return report
    return attempt(card, source, filename=filename, seed=chosen).report


def attempt(card: Card, source: str, *, filename: str, seed: int) -> Attempt:
    """Run and judge a submission; what was asked and answered stays in the `Attempt`."""
    start = time.perf_counter()
    report = Report(card.name, seed, filename, source)
    with start_child(card, source, filename) as child, start_child(card, source, filename) as twin:
        found = Attempt(card, catalogue.exercise(card.name), child, report)
        try:
            _check_signature(card, child.load())
            found.learner.loading = child.elapsed
            found.exercise.judge(found)
            if not found.failed:
                _check_replay(found, twin)
        except (Ended, Raised, SyntaxProblem, MissingName, Mismatch, _WrongSignature) as stop:
            _stopped(found, stop)
        except Exception as stumble:
            # The judge stumbled over what came back, or it has a fault: the worked answer tells.
            if source == card.solution_text() or not _judges(card, seed):
                raise
            report.reason = Reason.WRONG_TYPE
            report.sentence = f"What came back could not be judged: {stumble}"
        report.output = child.output
    _conclude(found)
    report.seconds = time.perf_counter() - start
    return found


def _judges(card: Card, seed: int) -> bool:
    """Whether the worked answer passes, so that the judge is sound for this seed."""
    return attempt(card, card.solution_text(), filename="solution.py", seed=seed).report.passed


def start_child(card: Card, source: str, filename: str) -> Child:
    """A child for a submission; it starts at once and is ready when `load` returns."""
    exercise = catalogue.exercise(card.name)
    limits = exercise.limits or Limits()
    return Child(source, filename=filename, entry=card.entry, given=exercise.given, limits=limits)


def is_starter(card: Card, source: str) -> bool:
    """Whether the graded definition is still that of the starter, comments and layout aside."""
    if len(source) > PARSED:
        return False
    theirs, ours = _entry_text(source, card.entry), _entry_text(card.starter(), card.entry)
    return theirs is not None and theirs == ours


def _copied(value: Any) -> Any:
    """A copy of an argument; a handle stays the same handle."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, list | tuple):
        return type(value)(map(_copied, value))
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    return value


class _WrongSignature(Exception):
    """The submission's arguments differ from those asked for."""


def _request(
    child: Any, kind: str, name: str, handle: Any, args: Any, kwargs: dict[str, Any]
) -> Any:
    if kind == "method":
        return child.method(handle, name, *args, **kwargs)
    return getattr(child, kind)(name, *args, **kwargs)


def _check_signature(card: Card, loaded: Loaded) -> None:
    asked = card.signatures[0]
    kind = "class" if loaded.is_class else "function" if loaded.callable else "value"
    if kind != card.kind:
        raise _WrongSignature(f"{card.entry} must be a {card.kind}; yours is a {kind}.")
    if loaded.parameters is None:
        return
    places = [p for p in loaded.parameters if p.kind.startswith("positional")]
    star = any(p.kind == "var_positional" for p in loaded.parameters)
    required = sum(not p.has_default for p in places)
    keyword = [p.name for p in loaded.parameters if p.kind == "keyword_only" and not p.has_default]
    least, most = asked.counts()
    if keyword or required > least or (len(places) < most and not star):
        theirs = ", ".join(p.name for p in loaded.parameters)
        raise _WrongSignature(f"The task asks for {asked.text}; yours is {card.entry}({theirs}).")


def _check_replay(attempt: Attempt, twin: Child) -> None:
    """Make the same requests in a second process: the bits must be the same."""
    twin.load()
    steps = attempt.learner.steps[: attempt.exercise.replayed]
    for step, result in _repeated(twin, steps):
        if not identical(result, step.result):
            attempt.require(
                "same answer in a second process",
                False,
                sentence="The same calls in a fresh process gave another answer. Clock, process "
                "number, hash order or an unseeded generator must not matter.",
                got=describe(result),
                expected=describe(step.result),
                call=describe_call(step.target, step.args, step.kwargs),
                reason=Reason.NOT_DETERMINISTIC,
            )
            return


def _repeated(place: Child | InProcess, steps: Sequence[Step]) -> Iterator[tuple[Step, Any]]:
    """Make the recorded requests again somewhere else; handles become those of the new place."""
    handles: dict[int, Any] = {}

    def there(value: Any) -> Any:
        return handles.get(id(value), value) if isinstance(value, Handle) else value

    for step in steps:
        args = tuple(map(there, step.args))
        kwargs = {key: there(value) for key, value in step.kwargs.items()}
        result: Any
        try:
            result = _request(place, step.kind, step.target, there(step.handle), args, kwargs)
        except Raised as raised:
            result = Failure(raised.type)
        except Ended:
            raise
        except Exception as error:  # our own text of a slip, run in this process
            result = Failure(type(error).__name__)
        if isinstance(step.result, Handle) and not isinstance(result, Failure):
            handles[id(step.result)] = result
            continue
        yield step, result


def _stopped(attempt: Attempt, stop: Exception) -> None:
    report = attempt.report
    report.call = attempt.learner.asked if isinstance(stop, Ended | Raised) else ""
    if isinstance(stop, Ended):
        report.reason, report.sentence = stop.reason, stop.sentence
    elif isinstance(stop, Mismatch):
        report.reason, report.sentence = stop.reason, stop.sentence
    elif isinstance(stop, Raised):
        report.reason = Reason.RAISED
        report.sentence = f"{attempt.card.entry} raised {stop.type}."
        report.problem = Problem(stop.type, stop.message, tuple(stop.frames))
    elif isinstance(stop, SyntaxProblem):
        report.reason, report.sentence = Reason.SYNTAX_ERROR, SENTENCES[Reason.SYNTAX_ERROR]
        report.problem = Problem("SyntaxError", stop.message, line=stop.line, column=stop.column)
    elif isinstance(stop, MissingName):
        near = f" The code defines {', '.join(stop.defined[:6])}." if stop.defined else ""
        report.reason = Reason.MISSING_NAME
        report.sentence = f"{attempt.card.entry} is not defined.{near}"
    else:
        report.reason, report.sentence = Reason.WRONG_SIGNATURE, str(stop)


def _conclude(attempt: Attempt) -> None:
    """The first failed check gives the reason, unless the run itself was stopped; then the slip."""
    report = attempt.report
    failures = [check for check in report.checks if not check.passed]
    if report.passed and failures:
        report.reason, report.sentence = failures[0].reason, failures[0].sentence
    if report.passed and not report.checks:
        raise AssertionError(f"the judge of {report.drill} checked nothing")
    if not report.passed:
        slip = next((check.slip for check in failures if check.slip), "") or _matched_slip(attempt)
        if slip:
            report.slip = slip
            report.diagnosis = next(s.sentence for s in attempt.exercise.slips if s.name == slip)


def _matched_slip(attempt: Attempt) -> str:
    """The slip that gives what the submission gave in every recorded request, or ""."""
    for slip in attempt.exercise.slips:
        if slip.ends is attempt.report.reason:
            return slip.name
    steps = attempt.learner.steps
    right = InProcess(attempt.card.solution_text(), attempt.exercise.given)
    if all(close(step.result, result) for step, result in _repeated(right, steps)):
        return ""  # what came back was right as far as it went
    for slip in attempt.exercise.slips:
        # One that never answers must not be run here.
        if slip.ends is None and _gives_the_same(attempt, slip, steps):
            return slip.name
    return ""


def _gives_the_same(attempt: Attempt, slip: Slip, steps: list[Step]) -> bool:
    local = InProcess(slip.text(attempt.card.solution_text()), attempt.exercise.given)
    return all(close(step.result, result) for step, result in _repeated(local, steps))


def _entry_text(source: str, entry: str) -> str | None:
    """The graded definition without comments, layout and docstrings; None if there is none."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(source)
        return next((_bare(node) for node in tree.body if _is_definition(node, entry)), None)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None


def _is_definition(node: ast.AST, name: str | None = None) -> bool:
    is_one = isinstance(node, ast.FunctionDef | ast.ClassDef)
    return is_one and name in (None, getattr(node, "name", None))


def _bare(node: ast.stmt) -> str:
    for inner in ast.walk(node):
        if isinstance(inner, ast.FunctionDef | ast.ClassDef) and len(inner.body) > 1:
            head = inner.body[0]
            if isinstance(head, ast.Expr) and isinstance(head.value, ast.Constant):
                del inner.body[0]
    return ast.dump(node)
