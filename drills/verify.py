"""Proof of the catalogue: what must be true of every exercise, tried on the real grader."""

from __future__ import annotations

import ast
import itertools
import re
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import active_children, get_context
from typing import Any

import numpy as np

from drills import cards as catalogue
from drills import exercise as exercises
from drills.attempt import Attempt
from drills.cards import Card, Quantity
from drills.exercise import HEADROOM, Exercise
from drills.grade import attempt, grade
from drills.inprocess import InProcess, Local
from drills.reasons import Reason
from drills.sandbox import Handle, Limits

LEAST_SLIPS = 4
SLIP_SEEDS = 3
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
    found: list[Finding] = []
    context = get_context("spawn")
    with ProcessPoolExecutor(
        workers, context, signal.signal, (signal.SIGINT, signal.SIG_IGN)
    ) as pool:
        try:
            for findings in pool.map(findings_of, chosen, itertools.repeat(seeds)):
                for finding in findings:
                    progress(finding)
                    found.append(finding)
        except BaseException:
            # Stopped by Ctrl-C, say: what is still waiting is not begun, what runs is ended.
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in active_children():
                worker.terminate()
            raise
    return found


def findings_of(name: str, seeds: int = 50) -> list[Finding]:
    """Everything that is proved of one exercise."""
    card, exercise = catalogue.card(name), exercises.of(name)
    steps = (_texts, _examples, _starter, _solution, _slips)
    return [finding for step in steps for finding in step(card, exercise, seeds)]


def _texts(card: Card, exercise: Exercise, seeds: int) -> Iterator[Finding]:
    hints = [hint for hint in card.hints if hint.symptom.strip() and hint.text.strip()]
    yield Finding(card.name, "three hints, none empty", len(hints) == len(card.hints) == HINTS)
    filled = all((card.title, card.teaches, card.insight, card.prompt().strip()))
    sane = 1 <= card.difficulty <= 5 and card.minutes > 0 and card.kind in ("function", "class")
    yield Finding(card.name, "the card is complete", filled and sane)
    asked = card.signatures[0]
    arguments = ast.parse(f"def {asked.text}: ...").body[0]
    assert isinstance(arguments, ast.FunctionDef)
    named = [argument.arg for argument in arguments.args.args]
    stated = [quantity.name for quantity in asked.arguments]
    detail = "" if named == stated else f"signature has {named}, table has {stated}"
    yield Finding(card.name, "the prompt states every argument", named == stated, detail)


def _examples(card: Card, exercise: Exercise, seeds: int) -> Iterator[Finding]:
    bad = [text for text in exercise.examples if not _example_runs(card, exercise, text)]
    detail = f"these fail: {bad}" if bad else f"{len(exercise.examples)} examples"
    yield Finding(card.name, "public examples run", bool(exercise.examples) and not bad, detail)


def _example_runs(card: Card, exercise: Exercise, text: str) -> bool:
    return example_result(card, exercise, text) is not None


def example_result(card: Card, exercise: Exercise, text: str) -> Any:
    """What the worked answer gives for a public example, an expression as one would type it."""
    module = InProcess(card.solution_text(), exercise.given)
    return module.evaluate(text)


def _starter(card: Card, exercise: Exercise, seeds: int) -> Iterator[Finding]:
    untouched = grade(card.name, card.starter(), seed=0).reason
    yield Finding(
        card.name, "an untouched starter is no attempt", untouched is Reason.NOT_ATTEMPTED
    )
    judged = grade(card.name, card.starter(), seed=0, starter_too=True)
    honest = not judged.passed and judged.reason not in (Reason.SYNTAX_ERROR, Reason.MISSING_NAME)
    yield Finding(card.name, "the starter runs and fails", honest, str(judged.reason))


def _solution(card: Card, exercise: Exercise, seeds: int) -> Iterator[Finding]:
    text, limits = card.solution_text(), exercise.limits or Limits()
    failures: list[str] = []
    loading, longest, whole = np.inf, np.inf, np.inf
    one: Attempt | None = None
    for seed in range(seeds):
        one = attempt(card, text, filename="solution.py", seed=seed)
        if not one.report.passed:
            failures.append(f"seed {seed}: {one.report.reason}: {one.report.sentence}")
        # The quickest run says what the answer needs; the others what the machine was doing.
        loading = min(loading, one.learner.loading)
        longest = min(longest, one.learner.longest)
        whole = min(whole, one.report.seconds)
    assert one is not None
    detail = "; ".join(failures[:3]) or f"{seeds} seeds"
    yield Finding(card.name, f"the worked answer passes {seeds} seeds", not failures, detail)
    spare = min(limits.load / loading, limits.call / longest, limits.total / whole)
    yield Finding(
        card.name,
        f"the limits leave it {HEADROOM} times its own time",
        bool(spare >= HEADROOM),
        f"{spare:.0f} times (top level {loading:.3f} s of {limits.load:g}, slowest call "
        f"{longest:.4f} s of {limits.call:g}, all {whole:.2f} s of {limits.total:g})",
    )
    yield _units(card, one)
    yield _shapes(card, one)


def _units(card: Card, one: Attempt) -> Finding:
    """Every unit that a check relies on is stated in the prompt."""
    stated = {q.unit for s in card.signatures for q in (*s.arguments, *s.returns)} | {"", "1"}
    prompt = card.prompt()
    used = {check.unit for check in one.report.checks}
    missing = sorted(
        u for u in used - stated if not re.search(rf"(?<!\w){re.escape(u)}(?!\w)", prompt)
    )
    detail = f"not stated: {missing}" if missing else ", ".join(sorted(used - {""}))
    return Finding(card.name, "the prompt states every unit", not missing, detail)


def _shapes(card: Card, one: Attempt) -> Finding:
    """Every argument that the checks sent has the shape that the prompt states."""
    signatures = {signature.name: signature for signature in card.signatures}
    wrong: list[str] = []
    unknown: set[str] = set()
    for step in one.learner.steps:
        if step.kind.startswith("given"):
            continue
        signature = signatures.get(step.target)
        if signature is None:
            unknown.add(step.target)
            continue
        sizes: dict[str, int] = {}
        for quantity, argument in zip(signature.arguments, step.args, strict=False):
            if not shape_matches(quantity, argument, sizes):
                shape = getattr(argument, "shape", type(argument).__name__)
                wrong.append(f"{step.target}: {quantity.name} has {shape}, not {quantity.shape}")
    wrong += [f"{name} is called but not in the prompt" for name in sorted(unknown)]
    detail = "; ".join(sorted(set(wrong))[:3])
    return Finding(card.name, "the prompt states every shape", not wrong, detail)


def shape_matches(quantity: Quantity, argument: Any, sizes: dict[str, int]) -> bool:
    """Whether an argument has the stated shape; symbols such as n are bound in `sizes`."""
    if isinstance(argument, Handle | Local) or callable(argument):
        return not quantity.shape.startswith("(")
    if quantity.shape == "number":
        return type(argument) in (int, float) or np.shape(argument) == ()
    if not quantity.shape.startswith("("):
        return True
    wanted = [part.strip() for part in quantity.shape.strip("()").split(",") if part.strip()]
    shape = np.shape(argument)
    if len(shape) != len(wanted):
        return False
    return all(
        size == (int(part) if part.isdigit() else sizes.setdefault(part, size))
        for part, size in zip(wanted, shape, strict=True)
    )


def _slips(card: Card, exercise: Exercise, seeds: int) -> Iterator[Finding]:
    many = len(exercise.slips)
    unique = len({slip.name for slip in exercise.slips}) == many
    yield Finding(card.name, "at least four slips", many >= LEAST_SLIPS and unique, f"{many} slips")
    solution = card.solution_text()
    for slip in exercise.slips:
        text = slip.text(solution)
        reports = [grade(card.name, text, seed=1000 + seed) for seed in range(SLIP_SEEDS)]
        wrong = [
            f"seed {report.seed}: {report.verdict}, named {report.slip or 'nothing'}"
            for report in reports
            if report.passed or report.slip != slip.name
        ]
        named = f"slip {slip.name} is caught and named"
        yield Finding(card.name, named, not wrong, "; ".join(wrong))
