"""What a judge works with: the submission, the worked answer, and the checks made so far."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drills.cards import Card
from drills.grade_report import Check, Cost, Part, Report
from drills.inprocess import InProcess
from drills.reasons import SENTENCES, Reason
from drills.sandbox import Handle, Loaded, Raised
from drills.values import Failure, Mismatch, as_float64, describe, describe_call, type_name, worst

Array = NDArray[np.float64]

SHOWN = 160  # characters of a value in the feedback
SLOW = 0.05  # s: what takes longer is timed once, as the way to the child no longer counts


class Place(Protocol):
    """Where a text runs: a `drills.sandbox.Child`, or this process where the text is ours.

    Attributes:
        changed: whether the last request changed one of its arguments.
        elapsed: what the last request took [s].
        spent, used: processor time of the last request, and of all [s].
        output: what the text printed so far.
    """

    changed: bool
    elapsed: float
    spent: float
    used: float

    @property
    def output(self) -> str:
        """What the submission printed so far."""
        ...

    def __enter__(self) -> Self: ...
    def __exit__(self, *exception: object) -> None: ...
    def load(self) -> Loaded:
        """Import the submission in the child and return which names it defines."""
        ...

    def call(self, name: str, *args: Any, repeat: int = 1, **kwargs: Any) -> Any:
        """Call a function of the submission, `repeat` times, and return the last result."""
        ...

    def new(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """Construct a class of the submission and return the handle of the instance."""
        ...

    def method(self, handle: Any, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a method of the instance behind a handle."""
        ...

    def given(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a function of the exercise's `given.py` in the child."""
        ...

    def given_new(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """Construct a class of `given.py` in the child and return its handle."""
        ...


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

    def __init__(self, child: Place, attempt: Attempt) -> None:
        self.child = child
        self.steps: list[Step] = []
        self.loading = 0.0  # s, the submission's top level
        self.last_request = ""  # the last request, as one would type it
        self.last_args: tuple[Any, ...] = ()  # of the last request
        self.parts: list[int] = []  # the case that each step belongs to, -1 for none
        self.pending: Step | None = None  # a request that ended the child before it was answered
        self.longest = 0.0  # s of processor time, the slowest request so far
        self._spent: list[float] = []
        self._attempt = attempt

    @property
    def usual(self) -> float:
        """The median of what requests took [s of processor time]."""
        return float(np.median(self._spent)) if self._spent else 0.0

    def call(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a function of the submission and return its result."""
        return self._record("call", name, None, args, kwargs)

    def new(self, name: str, *args: Any, **kwargs: Any) -> Handle:
        """Construct a class of the submission; the object stays in the child, behind a handle."""
        return self._record("new", name, None, args, kwargs)

    def method(self, handle: Handle, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a method of an object that is in the child and return its result."""
        return self._record("method", name, handle, args, kwargs)

    def given(self, name: str, *args: Any, **kwargs: Any) -> Any:
        """Call a function of the exercise's `given.py` in the child and return its result."""
        return self._record("given", name, None, args, kwargs)

    def given_new(self, name: str, *args: Any, **kwargs: Any) -> Handle:
        """Construct a class of `given.py`; the object stays in the child, behind a handle."""
        return self._record("given_new", name, None, args, kwargs)

    def _record(
        self, kind: str, name: str, handle: Handle | None, args: Any, kwargs: dict[str, Any]
    ) -> Any:
        # The arguments are copied before the call: a submission may change them in place.
        retained = _copied(args), _copied(kwargs)
        self.last_args = retained[0]
        self.last_request = (
            describe_call(name, *retained) if kind in ("call", "new", "method") else ""
        )
        self.pending = Step(kind, name, handle, *retained, None)
        self.parts.append(self._attempt.in_case)
        try:
            result = request(self.child, kind, name, handle, args, kwargs)
        except Raised as raised:
            self.pending = None
            self.steps.append(Step(kind, name, handle, *retained, Failure(raised.type)))
            raise
        self.pending = None
        self.longest = max(self.longest, self.child.spent)
        self._spent.append(self.child.spent)
        self.steps.append(Step(kind, name, handle, *retained, result))
        # The child compares its arguments after the call with what was sent.
        if kind in ("call", "method", "new") and self.child.changed:
            self._attempt.inputs_changed(self.last_request)
        return result


class Attempt:
    """One grading: what a judge works with.

    Attributes:
        rng: the generator of this run's hidden cases, from the printed seed.
        learner: the submission in its child.
        reference: the worked answer in this process, with the same calls as `learner`.
        card: what is graded.
        report: what was found so far.
        shown: the slip that the answers show, whichever check has failed; or "".
        in_part: a sentence on what is right where the rest is wrong, or "".
        factor: a sentence on the factor that all values have too much, or "".
        answers: of a function, each a `drills.case_judge.Answer`.
        nearest: of several right results, from what came back and one of them: the nearest.
        output_ranges: for each case that was begun, the length of the output before and after it.
    """

    def __init__(self, card: Card, child: Place, report: Report, given: str = "") -> None:
        """Create an attempt that has just begun.

        Args:
            card: of the exercise.
            child: where the submission runs.
            report: to write into; its seed is that of the hidden cases.
            given: source of the module that the child got as `given`, or "".
        """
        self.card = card
        self.report = report
        self.shown = ""
        self.in_part = self.factor = ""
        self.answers: list[Any] = []
        self.nearest: Callable[[Any, Array], Array] = lambda got, truth: truth
        self._part = -1
        self.output_ranges: dict[int, tuple[float, float]] = {}
        self.rng = np.random.default_rng(report.seed)
        self.learner = Learner(child, self)
        self.reference = InProcess(card.solution_text(), given)

    def plan(self, parts: Sequence[tuple[str, str]]) -> None:
        """Say which cases there will be, each with its level and its label."""
        self.report.parts = [Part(*part) for part in parts]

    @contextmanager
    def part(self, index: int) -> Iterator[None]:
        """Count what is checked inside as this case of the plan."""
        before, self._part = self._part, index
        # The output before and after a case bounds what its feedback may quote.
        self.report.begun.add(index)
        start = len(self.learner.child.output)
        self.output_ranges[index] = start, math.inf
        yield  # a case that an exception leaves has not ended
        self.report.ended.add(index)
        self.output_ranges[index] = start, len(self.learner.child.output)
        self._part = before

    @property
    def in_case(self) -> int:
        """The case that is tried now, an index into the plan; -1 for none."""
        return self._part

    @property
    def failed(self) -> bool:
        """True if a check has failed so far."""
        return any(not check.passed for check in self.report.checks)

    def call(self, *args: Any, **kwargs: Any) -> Any:
        """Call the submission's function, where the exercise is a single function."""
        return self.learner.call(self.card.entry, *args, **kwargs)

    def expected(self, *args: Any, **kwargs: Any) -> Any:
        """Call the worked solution the same way and return its result."""
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
            expected: the right values; theirs is the required shape.
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
        base |= {"values": (got, truth)}
        try:
            values = as_float64(got, truth.shape)
        except Mismatch as wrong:
            text = wrong.sentence[0].upper() + wrong.sentence[1:]
            self._add(Check(**base, reason=wrong.reason, sentence=text, got=describe(got, SHOWN)))
            return False
        error, place = worst(values, truth)
        # Written with `not`, so that an error of NaN fails as well.
        if not (error <= tolerance):
            at = f" at index {place}" if place else ""
            deviation = f"{error:.3g}" if unit in ("", "1") else f"{error:.3g} {unit}"
            # Where six digits look equal, the feedback shows all sixteen.
            digits = 6 if f"{values[place]:.6g}" != f"{truth[place]:.6g}" else 16
            sentence = (
                f"Off by {deviation}{at}: {values[place]:.{digits}g}, "
                f"not {truth[place]:.{digits}g}."
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
            got, message = raised.type, f"It raised {raised.type}, not {expected}. {sentence}"
            slip = ""  # it was refused after all
        else:
            got, message = f"returned {describe(value)}", sentence
        self._add(Check(name, Reason.MISSING_ERROR, message, call, got, expected, slip=slip))
        return False

    def parts(self, got: Any, names: Sequence[str], *, call: str = "") -> tuple[Any, ...] | None:
        """Return the members of an answer that is a tuple, or None after a failed check.

        A list, or an array with one row for each member, is as good as a tuple.
        """
        # An array with one row for each value is accepted like a tuple.
        if isinstance(got, np.ndarray) and got.ndim > 0 and len(got) < 100:
            got = [np.asarray(row) for row in got]
        if isinstance(got, list | tuple) and len(got) == len(names):
            return tuple(got)
        expected = f"{len(names)} values ({', '.join(names)})"
        if got is None:
            reason, sentence = Reason.NOTHING_RETURNED, SENTENCES[Reason.NOTHING_RETURNED]
        elif isinstance(got, list | tuple) or (isinstance(got, np.ndarray) and got.ndim > 0):
            reason, sentence = (
                Reason.WRONG_SHAPE,
                f"{len(got)} came back; {expected} are asked for.",
            )
        else:
            reason = Reason.WRONG_TYPE
            sentence = f"One {type_name(got)} came back; {expected} are asked for."
        self._add(Check("the answer's parts", reason, sentence, call, describe(got), expected))
        return None

    def numbers(
        self, name: str, got: Any, shape: tuple[int, ...], *, call: str = ""
    ) -> Array | None:
        """Return what came back as finite float64 of that shape, or None after a failed check."""
        try:
            return as_float64(got, shape)
        except Mismatch as wrong:
            text = wrong.sentence[0].upper() + wrong.sentence[1:]
            self._add(Check(name, wrong.reason, text, call, describe(got)))
            return None

    def cost(self, what: str, unit: str, *, yours: float, reference: float) -> None:
        """Say what the submission spent beside the reference."""
        self.report.costs.append(Cost(what, unit, yours, reference))

    def time_call(
        self, *args: Any, here: tuple[Any, ...] | None = None, what: str = "time per call"
    ) -> None:
        """Time one call of the function.

        Args:
            args: of the call.
            here: arguments of the worked answer, where a handle needs its counterpart.
            what: what is timed.
        """

        def sampler(place: Any, args: tuple[Any, ...]) -> Callable[[int], float]:
            def run(n: int) -> float:
                place.call(self.card.entry, *args, repeat=n)
                return float(place.elapsed)

            return run

        self.time(what, sampler(self.learner.child, args), sampler(self.reference, here or args))

    def time(self, what: str, yours: Callable[[int], float], ours: Callable[[int], float]) -> None:
        """Time a piece of work there and here in turn, without the way between the processes.

        Args:
            what: what is timed.
            yours: n -> what the submission takes for n of them, in one request [s].
            ours: the same for the worked answer.
        """
        from course.measure.timing import interleaved

        # The smallest of four: the first call warms caches up, and a disturbance only adds time.
        single = min(yours(1) for _ in range(4))  # with the way there and back
        if single > SLOW:
            self.cost(what, "s", yours=single, reference=ours(1))
            return
        # n + 1 calls in one request, less a single one: the trip between the processes cancels. The
        # least of five, because on a busy machine most trips are delayed by far more than a call.
        other, here = interleaved(
            [lambda n: max(min(yours(n + 1) for _ in range(5)) - single, 0.0), ours],
            repeats=3,
            patience=0.0,
            warm=True,
        )
        self.cost(what, "s", yours=other.median, reference=here.median)

    def inputs_changed(self, call: str) -> None:
        """Record that a call changed one of its arguments."""
        if not any(check.reason is Reason.INPUTS_CHANGED for check in self.report.checks):
            sentence = SENTENCES[Reason.INPUTS_CHANGED]
            self._add(Check("inputs unchanged", Reason.INPUTS_CHANGED, sentence, call))

    def _add(self, check: Check) -> None:
        requests = len(self.learner.steps)
        self.report.checks.append(replace(check, part=self._part, requests=requests))


def _copied(value: Any) -> Any:
    """Return a copy of an argument; a handle stays the same handle."""
    if isinstance(value, np.ndarray):
        return value.copy()
    if isinstance(value, list | tuple):
        return type(value)(map(_copied, value))
    if isinstance(value, dict):
        return {key: _copied(item) for key, item in value.items()}
    return value


def request(
    place: Any, kind: str, name: str, handle: Any, args: Any, kwargs: dict[str, Any]
) -> Any:
    """Make one request of a `Step`, in whichever place."""
    if kind == "method":
        return place.method(handle, name, *args, **kwargs)
    return getattr(place, kind)(name, *args, **kwargs)
