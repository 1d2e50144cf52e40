"""The grader: it runs a submission in a child, judges what comes back, and says why.

The parent draws the inputs, holds the right answers and decides; the child only computes.
"""

from __future__ import annotations

import ast
import math
import re
import secrets
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

from drills import cards as catalogue
from drills import exercise as exercises
from drills.attempt import Attempt, Place, Step
from drills.cards import Card
from drills.case_code import case_code
from drills.diagnosis import diagnosis, repeated
from drills.exercise import Exercise
from drills.grade_report import LEVELS, Check, Problem, Report
from drills.reasons import SENTENCES, Reason
from drills.sandbox import Child, Ended, Limits, Loaded, MissingName, Raised, SyntaxProblem
from drills.values import Mismatch, describe, describe_call, identical

COMPILING = 20.0  # s of processor time, for an answer that uses Numba
NUMBA = re.compile(r"^\s*(?:import|from)\s+numba\b", re.MULTILINE)
# A warning as Python prints it: its file and line, what it says, and perhaps that line.
WARNING = re.compile(r"^(?:\S*/)?(?P<said>[^/\s]+:\d+: \w*Warning: .*\n)(?:  \S.*\n)?", re.M)
PARSED = 20_000  # characters of foreign text parsed here; the time can grow as their square


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
        if _has_other_code(card, source):
            report.notes.append(
                f"{card.entry} is still the starter's. The other code in the file was not run."
            )
        return report
    return attempt(card, source, filename=filename, seed=chosen).report


def attempt(
    card: Card,
    source: str,
    *,
    seed: int,
    filename: str = "submission.py",
    place: Callable[[Card, str, str], Place] | None = None,
) -> Attempt:
    """Run and judge a submission; what was asked and answered stays in the `Attempt`.

    Args:
        card: of the exercise.
        source: the submission's text.
        seed: of the hidden cases.
        filename: how messages call it.
        place: starts a text, from the card, the text and its name; None for a `Child`. Only a text
            of this project may run anywhere else.
    """
    start = time.perf_counter()
    place = place or start_child
    report = Report(card.name, seed, filename, source)
    graded = exercises.of(card.name)
    with place(card, source, filename) as child, place(card, source, filename) as twin:
        result = Attempt(card, child, report, graded.given)
        try:
            # Cheap checks first: arguments, then values, then the replay in a second process.
            _check_signature(card, child.load())
            result.learner.loading = child.spent
            graded.judge(result)
            if not result.failed:
                _check_replay(result, twin, result.learner.steps[: graded.replayed])
        except (Ended, Raised, SyntaxProblem, MissingName, Mismatch, _WrongSignature) as stop:
            _stopped(result, stop)
        except Exception as stumble:
            # The judge stumbled over what came back, or it has a fault: the worked answer tells.
            if source == card.solution_text() or not _judges(card, seed):
                raise
            report.reason = Reason.WRONG_TYPE
            report.sentence = f"What came back could not be judged: {stumble}"
        report.output = child.output
    _note_compiling(result)
    _conclude(result, graded)
    # If a case failed, only the warnings printed during the first such case are shown.
    message = next((check.part for check in report.checks if not check.passed), -1)
    report.output = printed(report.output, *result.output_ranges.get(message, (0, math.inf)))
    report.seconds = time.perf_counter() - start
    return result


def _judges(card: Card, seed: int) -> bool:
    """Return whether the worked answer passes, so that the judge is sound for this seed."""
    return attempt(card, card.solution_text(), seed=seed).report.passed


def start_child(card: Card, source: str, filename: str) -> Child:
    """Return a child for a submission; it starts at once and is ready when `load` returns."""
    graded = exercises.of(card.name)
    limits = limits_for(graded.limits or Limits(), source)
    return Child(source, filename=filename, entry=card.entry, given=graded.given, limits=limits)


def limits_for(limits: Limits, source: str) -> Limits:
    """Return the limits of a submission; one that uses Numba may compile once on top of them."""
    if not NUMBA.search(source):
        return limits
    longer = {name: getattr(limits, name) + COMPILING for name in ("load", "call", "total")}
    return replace(limits, **longer)


def _note_compiling(attempt: Attempt) -> None:
    """Say what compiling took, where it can be told from a call."""
    longest, usual = attempt.learner.longest, attempt.learner.usual
    # Compilation shows as one call that took much longer than the median.
    if NUMBA.search(attempt.report.source) and longest > max(0.1, 20.0 * usual):
        attempt.report.notes.append(
            f"Numba compiled your answer for {longest:.2g} s of processor time. That is allowed "
            f"once, up to {COMPILING:g} s, and does not count in the time of a call."
        )


def is_starter(card: Card, source: str) -> bool:
    """Return whether the graded definition is still the starter's, up to comments and layout."""
    if len(source) > PARSED:
        return False
    theirs, ours = _entry_text(source, card.entry), _entry_text(card.starter(), card.entry)
    return theirs is not None and theirs == ours


class _WrongSignature(Exception):
    """The submission's arguments differ from those asked for."""


def _check_signature(card: Card, loaded: Loaded) -> None:
    requested = card.signatures[0]
    kind = "class" if loaded.is_class else "function" if loaded.callable else "value"
    if kind != card.kind:
        raise _WrongSignature(f"{card.entry} must be a {card.kind}; yours is a {kind}.")
    if loaded.parameters is None:
        return
    places = [p for p in loaded.parameters if p.kind.startswith("positional")]
    star = any(p.kind == "var_positional" for p in loaded.parameters)
    required = sum(not p.has_default for p in places)
    keyword = [p.name for p in loaded.parameters if p.kind == "keyword_only" and not p.has_default]
    # Accepted if every call of the task is possible: extra defaults are the author's business.
    least, largest = requested.counts()
    if keyword or required > least or (len(places) < largest and not star):
        theirs = ", ".join(p.name for p in loaded.parameters)
        raise _WrongSignature(
            f"The task asks for {requested.text}; yours is {card.entry}({theirs})."
        )


def _check_replay(attempt: Attempt, twin: Place, steps: Sequence[Step]) -> None:
    """Make the same requests in a second process: the bits must be the same."""
    twin.load()
    for step, result in repeated(twin, steps):
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


# How the import of a hidden module fails: in a checkout its folder can't be listed, and of an
# installed package the file is found and can't be opened.
_OWN = re.compile(
    r"No module named '(course|drills|solutions)\b"
    r"|Permission denied: '.*[/\\](course|drills|solutions)[/\\]__init__\.py'"
)


def _own_module(stop: Raised) -> str:
    """Return the sentence for an answer that imports a module of the course, or ""."""
    match = _OWN.search(stop.message)
    if match is None or not {stop.type, *stop.kinds} & {"ImportError", "OSError"}:
        return ""
    return (
        f"An answer can't use the course's own modules, such as {match[1] or match[2]}: the worked "
        "answers are in them. Write what you need yourself, with NumPy and the standard library."
    )


def _stopped(attempt: Attempt, stop: Exception) -> None:
    report = attempt.report
    report.call = attempt.learner.last_request if isinstance(stop, Ended | Raised) else ""
    if isinstance(stop, Ended):
        report.reason, report.sentence = stop.reason, stop.sentence
    elif isinstance(stop, Mismatch):
        report.reason, report.sentence = stop.reason, stop.sentence
    elif isinstance(stop, Raised):
        report.reason = Reason.RAISED
        report.sentence = _own_module(stop) or f"{attempt.card.entry} raised {stop.type}."
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


def _conclude(attempt: Attempt, graded: Exercise) -> None:
    """Set the reason by the first failed check, unless the run was stopped, and name the slip."""
    report = attempt.report
    report.sort()
    failures = [check for check in report.checks if not check.passed]
    # The simplest failure gives the reason: better than a crash at a harder level.
    if failures and (report.passed or _is_simpler(failures[0], report)):
        report.reason, report.sentence = failures[0].reason, failures[0].sentence
    if report.passed and not report.checks:
        raise AssertionError(f"the judge of {report.drill} checked nothing")
    if not report.passed:
        report.slip, report.diagnosis = diagnosis(attempt, graded)
        shown = failures[0] if failures and failures[0].reason is report.reason else None
        report.case = case_code(attempt, graded, shown)


def printed(output: str, start: float, end: float) -> str:
    """Return what was printed.

    Of warnings only those between two places, and no folders in them.
    """

    def report(match: re.Match[str]) -> str:
        return match["said"] if start <= match.start() < end else ""

    return WARNING.sub(report, output)


def _is_simpler(failed: Check, report: Report) -> bool:
    """Return whether a check failed at a lower level than the case that stopped the run."""
    stopped = [report.parts[i].level for i in report.begun - report.ended]
    level = report.parts[failed.part].level if failed.part >= 0 else LEVELS[-1]
    return any(LEVELS.index(level) < LEVELS.index(later) for later in stopped)


def _entry_text(source: str, entry: str) -> str | None:
    """Return the graded definition without comments, layout and docstrings.

    It is None if the definition is missing.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            tree = ast.parse(source)
        return next((_bare(node) for node in tree.body if _is_definition(node, entry)), None)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return None


def _has_other_code(card: Card, source: str) -> bool:
    """Return whether an untouched starter has code around it that the starter did not have."""
    ours, theirs = (
        [_bare(node) for node in ast.parse(text).body if not _is_text(node)]
        for text in (card.starter(), source)
    )
    return any(statement not in ours for statement in theirs)


def _is_text(node: ast.stmt) -> bool:
    """Return whether a statement is a bare string, such as the docstring of a file."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _is_definition(node: ast.AST, name: str | None = None) -> bool:
    is_one = isinstance(node, ast.FunctionDef | ast.ClassDef)
    return is_one and name in (None, getattr(node, "name", None))


def _bare(node: ast.stmt) -> str:
    # Docstrings go; `ast.dump` without positions already drops comments and layout.
    for inner in ast.walk(node):
        if isinstance(inner, ast.FunctionDef | ast.ClassDef) and len(inner.body) > 1:
            head = inner.body[0]
            if _is_text(head):
                del inner.body[0]
    return ast.dump(node)
