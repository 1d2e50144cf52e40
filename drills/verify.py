"""Proof of the catalogue: what must be true of every exercise, tried on the real grader.

The command proves with every text in a child process. The everyday tests prove with most of them in
this process, at a tenth of the price, and show apart that both ways give the same.
"""

from __future__ import annotations

import ast
import contextlib
import re
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import active_children, get_context
from threading import current_thread, main_thread
from typing import Any

import numpy as np

from drills import cards as catalogue
from drills import exercise as exercises
from drills.attempt import Attempt, Place
from drills.cards import Card, Quantity
from drills.exercise import HEADROOM, Exercise, Slip
from drills.grade_report import LEVELS
from drills.grader import attempt, grade, start_child
from drills.inprocess import InProcess, Local, StandIn
from drills.reasons import Reason
from drills.sandbox import Handle, Limits

LEAST_SLIPS = 4
HINTS = 3


@dataclass(frozen=True)
class Finding:
    """One thing that was proved of an exercise, or was not."""

    exercise: str
    what: str
    passed: bool
    detail: str = ""


def verify(
    names: list[str] | None = None,
    seeds: int = 50,
    progress: Callable[[Finding], None] = lambda finding: None,
    workers: int = 2,
) -> list[Finding]:
    """Prove the named exercises, or all.

    Args:
        names: of exercises; None for the whole catalogue.
        seeds: how many seeds the worked answer has to pass.
        progress: called with each finding.
        workers: processes that work side by side.

    Raises:
        UnknownExercise: for a name that isn't in the catalogue.
        ValueError: for seeds or workers below 1.
    """
    if seeds < 1 or workers < 1:
        raise ValueError(f"seeds and workers must be at least 1, got {seeds} and {workers}")
    chosen = [catalogue.card(name).name for name in names or catalogue.names()]
    result: list[Finding] = []
    # Spawned, not forked: a fork would inherit threads and locks of the libraries.
    context = get_context("spawn")
    with ProcessPoolExecutor(
        workers, context, signal.signal, (signal.SIGINT, signal.SIG_IGN)
    ) as pool:
        try:
            with _no_interrupt():
                running = [pool.submit(findings_of, name, Effort(seeds)) for name in chosen]
            for future in running:
                for finding in future.result():
                    progress(finding)
                    result.append(finding)
        except BaseException:
            # Stopped by Ctrl-C, say: what runs is ended, so what waits is not begun. It must not be
            # cancelled as well, as `map` would: the pool's thread fails at a cancelled future.
            for worker in active_children():
                worker.terminate()
            raise
    return result


@contextlib.contextmanager
def _no_interrupt() -> Iterator[None]:
    """Hold Ctrl-C back, in this process until the end and for good in those that it starts here.

    A worker ignores Ctrl-C only once its initializer has run. One that came before, while the
    worker still imports or this process tells it what to import, would end in a traceback.
    """
    if not hasattr(signal, "pthread_sigmask") or current_thread() is not main_thread():
        yield
        return
    came: list[int] = []
    # The mask is inherited by what this thread starts. The handler is for what reaches this process
    # by another thread, which has a mask of its own.
    handler = signal.signal(signal.SIGINT, lambda number, _frame: came.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, handler)
    if came:
        signal.raise_signal(signal.SIGINT)


def in_this_process(card: Card, source: str, filename: str) -> StandIn:
    """Return the place of a text of this project that is graded often."""
    given = exercises.of(card.name).given
    return StandIn(source, filename=filename, entry=card.entry, given=given)


@dataclass(frozen=True)
class Effort:
    """How hard an exercise is tried.

    Attributes:
        seeds: that the worked answer has to pass.
        slip_seeds: with which each slip has to be caught and named.
        place: where these run. Not in a child, then the worked answer is tried there once more; the
            starter and a slip that never answers always are.
    """

    seeds: int = 50
    slip_seeds: int = 3
    place: Callable[[Card, str, str], Place] = start_child


def findings_of(name: str, effort: Effort = Effort()) -> list[Finding]:
    """Return everything that is proved of one exercise."""
    card, exercise = catalogue.card(name), exercises.of(name)
    steps = (_texts, _examples, _starter, _solution, _slips)
    InProcess.memory = {}  # all slips are asked alike, and each is compared with the others
    try:
        return [finding for step in steps for finding in step(card, exercise, effort)]
    finally:
        InProcess.memory = None


def _texts(card: Card, exercise: Exercise, effort: Effort) -> Iterator[Finding]:
    hints = [hint for hint in card.hints if hint.symptom.strip() and hint.text.strip()]
    yield Finding(card.name, "three hints, none empty", len(hints) == len(card.hints) == HINTS)
    filled = all((card.title, card.teaches, card.insight, card.prompt().strip()))
    sane = 1 <= card.difficulty <= 5 and card.minutes > 0 and card.kind in ("function", "class")
    yield Finding(card.name, "the card is complete", filled and sane)
    requested = card.signatures[0]
    arguments = ast.parse(f"def {requested.text}: ...").body[0]
    assert isinstance(arguments, ast.FunctionDef)
    named = [argument.arg for argument in arguments.args.args]
    stated = [quantity.name for quantity in requested.arguments]
    detail = "" if named == stated else f"signature has {named}, table has {stated}"
    yield Finding(card.name, "the prompt states every argument", named == stated, detail)


def _examples(card: Card, exercise: Exercise, effort: Effort) -> Iterator[Finding]:
    bad = [text for text in exercise.examples if example_result(card, exercise, text) is None]
    detail = f"these fail: {bad}" if bad else f"{len(exercise.examples)} examples"
    yield Finding(card.name, "public examples run", bool(exercise.examples) and not bad, detail)


def example_result(card: Card, exercise: Exercise, text: str) -> Any:
    """Return the worked answer's result for a public example.

    The example is an expression as a learner would type it.
    """
    module = InProcess(card.solution_text(), exercise.given)
    return module.evaluate(text)


def _starter(card: Card, exercise: Exercise, effort: Effort) -> Iterator[Finding]:
    untouched = grade(card.name, card.starter(), seed=0).reason
    yield Finding(
        card.name, "an untouched starter is no attempt", untouched is Reason.NOT_ATTEMPTED
    )
    judged = grade(card.name, card.starter(), seed=0, starter_too=True)
    # A starter that raises shows a learner an error in code that they did not write.
    broken = (Reason.SYNTAX_ERROR, Reason.MISSING_NAME, Reason.RAISED)
    honest = not judged.passed and judged.reason not in broken
    detail = judged.sentence if judged.reason in broken else str(judged.reason)
    yield Finding(card.name, "the starter runs and fails", honest, detail)


def _solution(card: Card, exercise: Exercise, effort: Effort) -> Iterator[Finding]:
    text = card.solution_text()
    runs = [
        attempt(card, text, filename="solution.py", seed=seed, place=effort.place)
        for seed in range(effort.seeds)
    ]
    # The seeds ran in this process; one more in a real child shows that it works there.
    if effort.place is not start_child:
        runs.append(attempt(card, text, filename="solution.py", seed=effort.seeds))
    failures = [
        f"seed {run.report.seed}: {run.report.reason}: {run.report.sentence}"
        for run in runs
        if not run.report.passed
    ]
    detail = "; ".join(failures[:3]) or f"{len(runs)} seeds"
    yield Finding(card.name, f"the worked answer passes {effort.seeds} seeds", not failures, detail)
    if effort.place is start_child:
        yield _headroom(card, exercise.limits or Limits(), runs)
    one = runs[-1]
    levels = [part.level for part in one.report.parts]
    ordered = sorted(set(levels), key=LEVELS.index) == list(LEVELS)
    ordered &= one.report.unreached == 0
    yield Finding(card.name, "its cases are simple, core and edge", ordered, ", ".join(levels))
    yield _units(card, one)
    yield _shapes(card, one)


def _headroom(card: Card, limits: Limits, runs: list[Attempt]) -> Finding:
    """Prove that the limits on processor time leave room above what the quickest run needed."""
    # The clock of a process may tick too slowly to see what is quick.
    loading = max(min(run.learner.loading for run in runs), 1e-6)
    longest = max(min(run.learner.longest for run in runs), 1e-6)
    whole = max(min(run.learner.child.used for run in runs), 1e-6)
    spare = min(limits.load / loading, limits.call / longest, limits.total / whole)
    return Finding(
        card.name,
        f"the limits leave it {HEADROOM} times its own time",
        bool(spare >= HEADROOM),
        f"{spare:.0f} times (top level {loading:.3f} s of {limits.load:g}, slowest call "
        f"{longest:.4f} s of {limits.call:g}, all {whole:.2f} s of {limits.total:g})",
    )


def _units(card: Card, one: Attempt) -> Finding:
    """Prove that the prompt states every unit that a check relies on."""
    stated = {q.unit for s in card.signatures for q in (*s.arguments, *s.returns)} | {"", "1"}
    prompt = card.prompt()
    used = {check.unit for check in one.report.checks}
    missing = sorted(
        u for u in used - stated if not re.search(rf"(?<!\w){re.escape(u)}(?!\w)", prompt)
    )
    detail = f"not stated: {missing}" if missing else ", ".join(sorted(used - {""}))
    return Finding(card.name, "the prompt states every unit", not missing, detail)


def _shapes(card: Card, one: Attempt) -> Finding:
    """Prove that the arguments sent to the worked answer have the shapes stated in the prompt.

    Args:
        card: of the exercise.
        one: the grading of the worked answer with the last seed.
    """
    signatures = {signature.name: signature for signature in card.signatures}
    wrong: list[str] = []
    unknown: set[str] = set()
    for step in one.learner.steps:
        # Calls of the exercise's own `given.py`, which the prompt need not state.
        if step.kind.startswith("given"):
            continue
        signature = signatures.get(step.target)
        if signature is None:
            unknown.add(step.target)
            continue
        # Symbols in the shapes (n, m) must mean the same number in all arguments of a call.
        sizes: dict[str, int] = {}
        # Arguments with defaults may be left out.
        for quantity, argument in zip(signature.arguments, step.args, strict=False):
            if not shape_matches(quantity, argument, sizes):
                shape = getattr(argument, "shape", type(argument).__name__)
                wrong.append(f"{step.target}: {quantity.name} has {shape}, not {quantity.shape}")
    wrong += [f"{name} is called but not in the prompt" for name in sorted(unknown)]
    detail = "; ".join(sorted(set(wrong))[:3])
    return Finding(card.name, "the arguments have the stated shapes", not wrong, detail)


def shape_matches(quantity: Quantity, argument: Any, sizes: dict[str, int]) -> bool:
    """Return whether an argument has the stated shape; symbols such as n are bound in `sizes`."""
    if isinstance(argument, Handle | Local) or callable(argument):
        return not quantity.shape.startswith("(")
    if quantity.shape == "number":
        return type(argument) in (int, float) or np.shape(argument) == ()
    if not quantity.shape.startswith("("):
        return True
    expected = [part.strip() for part in quantity.shape.strip("()").split(",") if part.strip()]
    shape = np.shape(argument)
    if len(shape) != len(expected):
        return False
    return all(
        size == (int(part) if part.isdigit() else sizes.setdefault(part, size))
        for part, size in zip(expected, shape, strict=True)
    )


def _unnoticed(slip: Slip) -> str:
    """Return what the cases lack for a slip that passes."""
    if slip.name == "whole_numbers":
        return (
            "a case whose arguments are integers needs results that are not; "
            "where there is none, value_slips(..., whole=False)"
        )
    return "add a case in which its result differs from the worked answer's"


def _slips(card: Card, exercise: Exercise, effort: Effort) -> Iterator[Finding]:
    count = len(exercise.slips)
    unique = len({slip.name for slip in exercise.slips}) == count
    yield Finding(
        card.name, "at least four slips", count >= LEAST_SLIPS and unique, f"{count} slips"
    )
    solution = card.solution_text()
    for slip in exercise.slips:
        text = slip.text(solution)
        place = start_child if slip.ends else effort.place
        # Seeds from 1000 on: other cases than those which proved the solution.
        reports = [
            attempt(card, text, seed=1000 + seed, place=place).report
            for seed in range(effort.slip_seeds)
        ]
        wrong = [
            f"seed {report.seed}: it passes; {_unnoticed(slip)}"
            if report.passed
            else f"seed {report.seed}: {report.verdict}, named {report.slip or 'nothing'}"
            for report in reports
            if report.passed or report.slip != slip.name
        ]
        named = f"slip {slip.name} is caught and named"
        yield Finding(card.name, named, not wrong, "; ".join(wrong))
