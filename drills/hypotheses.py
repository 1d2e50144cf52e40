"""Mistakes that need no slip: what else the worked answer would have to be to give these values.

Three families are tried on the answers of a function. The right results are changed (a sign, an
order, degrees for radians). The worked answer gets other arguments (two swapped, one left out). One
step of the worked answer is changed (a sine for a cosine, a term left out). An explanation is given
only where every wrong value is what the changed computation gives, so it is never a guess.
"""

from __future__ import annotations

import ast
import copy
import itertools
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import FrameType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import Answer, largest_error
from drills.exercise import Exercise
from drills.inprocess import InProcess
from drills.terminal import listed
from drills.values import Mismatch, as_float64

Array = NDArray[np.float64]
Parts = tuple[Any, ...]
# What the explanations are called; those of a computation are true of every wrong value.
COMPUTED = frozenset({"result_changed", "argument_changed", "step_changed"})
ROUGH = frozenset({"nearly_right", "some_cases_only"})
SHAPED = {"zeros", "ones", "empty", "full", "eye", "identity"}
MATRIX, VECTOR = 40_000, 1_000_000  # elements of an array that a changed text may make
LINES = 50_000  # of a changed text in one call
SECONDS = 3.0  # of processor time for all explanations; the verdict is there already
RELATIVE = 1e-7  # of the largest number of a result, or of 1
SPARED = 0.1  # the share of right answers that a mistake may spare
COARSE = 0.01  # relative error of an answer that is called an approximation


def hypothesis(attempt: Attempt, graded: Exercise) -> tuple[str, str]:
    """Return a name and the sentence for the learner, or two times "" where nothing explains it."""
    answers: list[Answer] = attempt.answers
    wrong = [a for a in answers if not all(a.right)]
    if len(answers) < 3 or not wrong or not _telling(wrong):
        return "", ""
    # Values this close to the right ones would be explained by what leaves these as they are.
    if all(_fits(attempt, [a], _truth) for a in wrong):
        return "", ""
    ordered = wrong + [a for a in answers if all(a.right)]
    limit = time.process_time() + SECONDS
    for name, sentence, other in itertools.chain(
        _results(attempt, ordered), _arguments(attempt, graded), _steps(attempt, graded)
    ):
        if time.process_time() > limit:
            break
        # What divides by zero is given up at once: LAPACK prints a line for every NaN that it gets.
        with np.errstate(all="raise", under="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if _fits(attempt, ordered, other):
                return name, sentence
    return "", ""


def rough(answers: Sequence[Answer]) -> tuple[str, str]:
    """Return what the answers have in common where no computation is known that gives them."""
    wrong = [a for a in answers if not all(a.right)]
    if len(answers) < 3 or not wrong:
        return "", ""
    errors = [
        largest_error(part, truth) / max(float(np.max(np.abs(truth), initial=0.0)), 1e-300)
        for a in wrong
        for part, truth, right in zip(a.parts, a.truth, a.right, strict=True)
        if not right
    ]
    if max(errors) <= COARSE and 2 * len(wrong) >= len(answers):
        return "nearly_right", (
            f"No value is farther than {100.0 * max(errors):.2g} % from the right one: an "
            "approximation is too coarse (a step, a number of iterations, a rounded constant), or "
            "a small term is missing."
        )
    labels = sorted({a.case.label for a in wrong})
    others = {a.case.label for a in answers if all(a.right)}
    if len(labels) <= 3 and not others & set(labels) and 2 * len(wrong) <= len(answers):
        names = listed([f'"{label}"' for label in labels], "and")
        return "some_cases_only", (
            f"Wrong in the case{'s' * (len(wrong) > 1)} {names} and right in all the others: what "
            "is special there is not handled."
        )
    return _labels(answers, wrong)


def _labels(answers: Sequence[Answer], wrong: Sequence[Answer]) -> tuple[str, str]:
    """Return a sentence on the kinds of case that are right where all the others are wrong."""
    failed = {a.case.label for a in wrong}
    # No numbers at all are right by themselves.
    passed = [a.case.label for a in answers if all(a.right) and any(t.size for t in a.truth)]
    right = sorted(set(passed))
    if len(passed) < 2 or failed & set(passed) or len(right) > 4:
        return "", ""
    names = listed([f'"{label}"' for label in right], "and")
    return "some_cases_only", (
        f"Right in the case{'s' * (len(right) > 1)} {names} and wrong in all the others: what you "
        "compute wrongly makes no difference there."
    )


def _telling(wrong: Sequence[Answer]) -> bool:
    """Return whether wrong values have digits, or are many, so that they hardly agree by chance."""
    values = [
        np.asarray(part, dtype=float)
        for a in wrong
        for part, truth, right in zip(a.parts, a.truth, a.right, strict=True)
        if not right and largest_error(part, truth) < np.inf
    ]
    digits = sum(bool(np.any(value != np.rint(value))) for value in values)
    return digits >= 2 or (len(values) >= 4 and len({value.tobytes() for value in values}) > 1)


def _fits(attempt: Attempt, answers: Sequence[Answer], other: Callable[[Answer], Any]) -> bool:
    """Return whether a computation gives every wrong answer, and nearly all the right ones."""
    spared = SPARED * sum(all(a.right) for a in answers)
    for a in answers:
        try:
            result = other(a)
            same = _same(attempt, a, result)
        except Exception:  # a step that was changed may raise anything
            same = False
        if not same:
            if not all(a.right) or spared < 1.0:
                return False
            spared -= 1.0
    return True


def _truth(a: Answer) -> Any:
    return a.truth[0] if len(a.truth) == 1 else a.truth


def _same(attempt: Attempt, a: Answer, result: Any) -> bool:
    parts = (result,) if len(a.truth) == 1 else tuple(result)
    if len(parts) != len(a.parts):
        return False
    for i, (got, value) in enumerate(zip(a.parts, parts, strict=True)):
        expected = np.asarray(value, dtype=float)
        if not np.isfinite(expected).all():
            return False
        if i == 0:
            expected = attempt.nearest(got, expected)
        scale = max(1.0, float(np.max(np.abs(expected), initial=0.0)))
        if not largest_error(got, expected) <= RELATIVE * scale:
            return False
    return True


class _TooLong(Exception):
    """A changed computation takes more lines or larger arrays than any worked answer."""


class _Numpy(ModuleType):
    """NumPy for a changed text: it makes no large arrays, whose algebra no line limit can stop."""

    def __init__(self) -> None:
        super().__init__("numpy")

    def __getattr__(self, name: str) -> Any:
        function = getattr(np, name)
        if name in SHAPED:

            def shaped(shape: Any, *args: Any, **kwargs: Any) -> Any:
                sides = [int(side) for side in np.ravel(shape)]
                if name in ("eye", "identity"):
                    sides = sides * 2
                if np.prod([float(side) for side in sides]) > (
                    MATRIX if len(sides) > 1 else VECTOR
                ):
                    raise _TooLong
                return function(shape, *args, **kwargs)

            return shaped
        if name in ("arange", "linspace"):

            def counted(*args: Any, **kwargs: Any) -> Any:
                if name == "arange":
                    low, high, step = (0, args[0], 1) if len(args) == 1 else (*args, 1)[:3]
                    count = abs((high - low) / step)
                else:
                    count = args[2] if len(args) > 2 else kwargs.get("num", 50)
                if not count <= VECTOR:
                    raise _TooLong
                return function(*args, **kwargs)

            return counted
        return function


def limited(place: InProcess, entry: str, args: Sequence[Any], lines: int = LINES) -> Any:
    """Call a changed text, and stop it after a number of lines: it may never end by itself."""
    count, before = 0, sys.gettrace()

    def trace(frame: FrameType, event: str, _arg: Any) -> Any:
        nonlocal count
        if frame.f_code.co_filename != "<submission>":
            return None
        count += event == "line"
        if count > lines:
            raise _TooLong
        return trace

    own = vars(place._module)
    if own.get("np") is np:
        own["np"] = _Numpy()
    sys.settrace(trace)
    try:
        return place.call(entry, *args)
    finally:
        sys.settrace(before)


# The right results, changed.


def _results(
    attempt: Attempt, answers: Sequence[Answer]
) -> Iterator[tuple[str, str, Callable[[Answer], Any]]]:
    """Yield name, sentence and results for each change of one result, the others being right."""
    values = [v.name for v in attempt.card.signatures[0].returns]
    for i, name in enumerate(values):
        if not any(not a.right[i] for a in answers):
            continue
        what = f"`{name}`" if len(values) > 1 else "the result"
        for phrase, change in _changes([a.truth[i] for a in answers]):
            sentence = f"In every case that is wrong, {what} is the right one {phrase}."
            yield "result_changed", sentence, _with_part(i, change)
        factor = _factor(answers, i)
        if factor:
            sentence = (
                f"In every case that is wrong, {what} is {factor:.4g} times the right one: a "
                "factor is missing or one too many."
            )
            yield "result_changed", sentence, _with_part(i, partial(np.multiply, factor))


def _with_part(i: int, change: Callable[[Array], Any]) -> Callable[[Answer], Any]:
    def other(a: Answer) -> Any:
        parts = [change(t) if j == i else t for j, t in enumerate(a.truth)]
        return parts[0] if len(parts) == 1 else parts

    return other


def _factor(answers: Sequence[Answer], i: int) -> float:
    """Return the factor between a wrong value and the right one, from the first answer, or 0."""
    got, truth = answers[0].parts[i], answers[0].truth[i]
    try:
        values = as_float64(got, truth.shape)
    except Mismatch:
        return 0.0
    at = np.unravel_index(int(np.argmax(np.abs(truth))), truth.shape) if truth.size else None
    ratio = float(values[at] / truth[at]) if at is not None and truth[at] else 0.0
    return 0.0 if abs(ratio) < 1e-9 or abs(ratio - 1.0) < 1e-6 else ratio


def _changes(truths: Sequence[Array]) -> Iterator[tuple[str, Callable[[Array], Any]]]:
    """Yield phrase and change of one result."""
    yield "with the other sign", np.negative
    yield "without its sign", np.abs
    yield "in degrees: radians are asked for", np.degrees
    yield "turned from degrees into radians although it is in radians already", np.radians
    yield "upside down: 1 over it", np.reciprocal
    yield "squared: a root is missing", np.square
    yield "under a root", np.sqrt
    yield "taken from 1", lambda x: 1.0 - x
    for offset in (-2, -1, 1, 2):
        word = f"{abs(offset)} too {'small' if offset < 0 else 'large'}"
        yield f"and {word}: look at where a count or an index begins", partial(np.add, offset)
    yield "cut off to an integer", np.trunc
    yield "rounded to an integer", np.rint
    shapes = {t.shape for t in truths}
    if all(len(shape) == 2 for shape in shapes):
        yield "transposed", np.transpose
    if all(len(shape) > 0 for shape in shapes):
        yield "in reverse order", lambda x: x[::-1]
        yield "one place too late: the first ones are right for the place before", _late
        yield "one place too early", lambda x: np.concatenate((x[1:], x[-1:]))
        yield "rolled on by one place", lambda x: np.roll(x, 1, axis=0)
        yield "rolled back by one place", lambda x: np.roll(x, -1, axis=0)
        yield "sorted", lambda x: np.sort(x, axis=0)
        yield "summed up from the first one on", lambda x: np.cumsum(x, axis=0)
        yield (
            "with each one's difference from the one before",
            lambda x: np.diff(x, axis=0, prepend=0),
        )
    if len(shapes) == 1 and (shape := next(iter(shapes))) and 1 < shape[0] <= 4:
        for order in itertools.permutations(range(shape[0])):
            text = ", ".join(map(str, order))
            yield f"in another order: its components {text}", partial(_taken, list(order))
        for i in range(shape[0]):
            signs = np.where(np.arange(shape[0]) == i, -1.0, 1.0)
            yield f"but for the sign of component {i}", partial(_signed, signs)


def _taken(order: list[int], x: Array) -> Array:
    return x[order]


def _signed(signs: Array, x: Array) -> Array:
    return np.asarray((signs * x.T).T)


def _late(x: Array) -> Array:
    return np.concatenate((x[:1], x[:-1]))


# The worked answer with other arguments.


def _arguments(
    attempt: Attempt, graded: Exercise
) -> Iterator[tuple[str, str, Callable[[Answer], Any]]]:
    """Yield name, sentence and results of the worked answer for other arguments."""
    place = InProcess(attempt.card.solution_text(), graded.given)
    names = [v.name for v in attempt.card.signatures[0].arguments]

    def called(change: Callable[[list[Any]], None]) -> Callable[[Answer], Any]:
        def other(a: Answer) -> Any:
            args = copy.deepcopy(list(a.case.args))
            change(args)
            return limited(place, attempt.card.entry, args)

        return other

    for i, j in itertools.combinations(range(len(names)), 2):

        def swap(args: list[Any], i: int = i, j: int = j) -> None:
            args[i], args[j] = args[j], args[i]

        yield (
            "argument_changed",
            f"Every wrong value is right for `{names[i]}` and `{names[j]}` swapped.",
            called(swap),
        )
    for i, name in enumerate(names):
        for phrase, change in _instead(name):

            def replace(args: list[Any], i: int = i, change: Callable[[Any], Any] = change) -> None:
                if callable(args[i]) or isinstance(args[i], str | dict):
                    raise TypeError
                value = np.asarray(args[i], dtype=float)
                args[i] = change(value)
                # A time step that is far smaller, or a count far larger, fills the memory.
                if value.ndim == 0 and value and args[i]:
                    if not 0.25 <= abs(args[i] / value) <= 4.0:
                        raise _TooLong
                if args[i].ndim == 0:
                    args[i] = float(args[i])

            yield "argument_changed", f"Every wrong value is right {phrase}.", called(replace)


def _instead(name: str) -> Iterator[tuple[str, Callable[[Any], Any]]]:
    """Yield phrase and change of one argument."""
    yield f"for `{name}` of 0, as if it were left out", np.zeros_like
    yield f"for `{name}` of 1, as if it were left out", np.ones_like
    yield f"for `{name}` with the other sign", np.negative
    yield f"for `{name}` without its sign", np.abs
    yield f"for `{name}` upside down, 1 over it", np.reciprocal
    yield f"for `{name}` squared", np.square
    yield f"for the root of `{name}`", np.sqrt
    yield f"for half of `{name}`", lambda x: 0.5 * x
    yield f"for twice `{name}`", lambda x: 2.0 * x
    yield f"for `{name}` taken from radians into degrees", np.degrees
    yield f"for `{name}` taken from degrees into radians", np.radians
    yield f"for `{name}` reduced by 1", lambda x: x - 1.0
    yield f"for `{name}` increased by 1", lambda x: x + 1.0
    yield f"for `{name}` transposed", _transposed
    yield f"for `{name}` in reverse order", lambda x: x[::-1]
    yield f"for `{name}` one place later", _late
    yield f"for `{name}` one place earlier", lambda x: np.concatenate((x[1:], x[-1:]))
    yield f"if only the first of `{name}` is used, for all", lambda x: x[:1] + np.zeros_like(x)
    yield f"if only the last of `{name}` is used, for all", lambda x: x[-1:] + np.zeros_like(x)
    yield f"for the mean of `{name}`, for all", lambda x: np.full_like(x, x.mean())
    yield f"for the smallest of `{name}`, for all", lambda x: np.full_like(x, x.min())
    yield f"for the largest of `{name}`, for all", lambda x: np.full_like(x, x.max())
    yield f"for `{name}` sorted", lambda x: np.sort(x, axis=0)
    yield f"for `{name}` with its columns in reverse order", lambda x: x[:, ::-1]
    for length in (2, 3, 4):
        for order in itertools.permutations(range(length)):
            text = ", ".join(map(str, order))
            yield f"for `{name}` with its components in the order {text}", partial(_ordered, order)


def _ordered(order: tuple[int, ...], x: Array) -> Array:
    if x.ndim != 1 or len(x) != len(order):
        raise TypeError
    return x[list(order)]


def _transposed(x: Array) -> Array:
    if x.ndim < 2:
        raise TypeError
    return np.swapaxes(x, -1, -2)


# The worked answer with one step changed.


def _steps(
    attempt: Attempt, graded: Exercise
) -> Iterator[tuple[str, str, Callable[[Answer], Any]]]:
    """Yield name, sentence and results of the worked answer with one step changed."""
    text = attempt.card.solution_text()
    names = {v.name for v in attempt.card.signatures[0].arguments}
    for phrase, changed, touched in itertools.chain(mutants(text), pairs(text)):
        try:
            place = InProcess(changed, graded.given)
        except Exception:  # not every change of a text is Python
            continue
        near = sorted(names & touched)
        where = f", where {listed([f'`{n}`' for n in near[:3]], 'and')} is used" if near else ""
        where = where.replace(" is used", " are used") if len(near) > 1 else where

        def other(a: Answer, place: InProcess = place) -> Any:
            return limited(place, attempt.card.entry, copy.deepcopy(a.case.args))

        yield "step_changed", f"Every wrong value comes out {phrase}{where}.", other


TURNED = {"sin": "cos", "cos": "sin", "minimum": "maximum", "maximum": "minimum", "min": "max"}
TURNED |= {"max": "min", "argmin": "argmax", "argmax": "argmin", "all": "any", "any": "all"}
TURNED |= {"mean": "sum", "sum": "mean", "floor": "ceil", "ceil": "floor", "tan": "sin"}
SIZED = {"arange", "zeros", "ones", "empty", "full", "eye", "linspace"}  # no larger arrays
WORDS = {"sin": "a sine", "cos": "a cosine", "tan": "a tangent", "min": "the smallest"}
WORDS |= {"max": "the largest", "minimum": "the smaller", "maximum": "the larger", "sum": "a sum"}
WORDS |= {"mean": "a mean", "argmin": "the smallest", "argmax": "the largest", "all": "all"}
WORDS |= {"any": "any", "floor": "the integer below", "ceil": "the integer above"}
OTHERS: dict[type, type] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
REVERSED: dict[type, type] = {ast.Lt: ast.Gt, ast.LtE: ast.GtE, ast.Gt: ast.Lt, ast.GtE: ast.LtE}


def mutants(text: str) -> Iterator[tuple[str, str, set[str]]]:
    """Yield the worked answer with one step changed, in words, as text, and the names in the step.

    Little inside a `while` is changed, nor how large an array is: most texts would not end.
    """
    tree = ast.parse(text)
    for function in [n for n in tree.body if isinstance(n, ast.FunctionDef)]:
        for parent, field, index, node in _places(function):
            for phrase, new in _instead_of(node):
                _put(parent, field, index, new)
                try:
                    changed = ast.unparse(ast.fix_missing_locations(tree))
                except Exception:
                    changed = ""
                _put(parent, field, index, node)
                if changed:
                    touched = {n.id for n in ast.walk(node) if isinstance(n, ast.Name)}
                    yield phrase, changed, touched
        yield from _statements(tree, function)
        yield from _everywhere(tree, function)


# What is often done wrong in two places at once: the words for one place and for two.
TWICE = {
    "with one sign turned": "with two signs turned",
    "if one difference is taken the wrong way round": (
        "if two differences are taken the wrong way round"
    ),
    "with a sine in place of a cosine": "with a sine in place of a cosine in two places",
    "with a cosine in place of a sine": "with a cosine in place of a sine in two places",
    "if one entry of a list is left out": "if two entries of a list are left out",
}


def pairs(text: str) -> Iterator[tuple[str, str, set[str]]]:
    """Yield the worked answer with the same change made in two places, as `mutants` does."""
    yielded = {ast.unparse(ast.parse(text))}
    for phrase, changed, touched in mutants(text):
        if phrase not in TWICE:
            continue
        for other, twice, also in mutants(changed):
            if other == phrase and twice not in yielded:
                yielded.add(twice)
                yield TWICE[phrase], twice, touched | also


def _everywhere(tree: ast.Module, function: ast.FunctionDef) -> Iterator[tuple[str, str, set[str]]]:
    """Yield the text with every call of one function turned into its counterpart."""
    calls = [n for n in ast.walk(function) if isinstance(n, ast.Attribute) and n.attr in TURNED]
    for name in sorted({n.attr for n in calls}):
        for pair in (False, True):
            old = [n.attr for n in calls]
            for n in calls:
                if n.attr == name or (pair and n.attr == TURNED[name]):
                    n.attr = TURNED[n.attr]
            changed = ast.unparse(tree)
            for n, attr in zip(calls, old, strict=True):
                n.attr = attr
            other = TURNED[name]
            yield f"with {WORDS[other]} in place of {WORDS[name]} everywhere", changed, set()


def _put(parent: ast.AST, field: str, index: int | None, node: ast.AST) -> None:
    if index is None:
        setattr(parent, field, node)
    else:
        getattr(parent, field)[index] = node


def _places(node: ast.AST) -> Iterator[tuple[ast.AST, str, int | None, ast.expr]]:
    """Yield where the expressions of a function are, the outer ones first."""
    for field, value in ast.iter_fields(node):
        if field in ("args", "returns", "decorator_list") and isinstance(node, ast.FunctionDef):
            continue
        members = value if isinstance(value, list) else [value]
        for i, member in enumerate(members):
            if not isinstance(member, ast.AST) or isinstance(member, ast.While):
                continue
            if isinstance(member, ast.expr):
                yield node, field, i if isinstance(value, list) else None, member
            if isinstance(member, ast.Call) and _called(member) in SIZED:
                continue
            yield from _places(member)


def _called(node: ast.Call) -> str:
    f = node.func
    return f.attr if isinstance(f, ast.Attribute) else f.id if isinstance(f, ast.Name) else ""


def _instead_of(node: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    """Yield what may stand in place of an expression, and in words how it comes out."""
    if isinstance(node, ast.BinOp):
        yield from _instead_of_operation(node)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield "with one sign turned", node.operand
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in OTHERS:
        for phrase, table in (
            ("if a value exactly at a limit counts on the other side", OTHERS),
            ("with one comparison turned round", REVERSED),
        ):
            yield phrase, ast.Compare(node.left, [table[type(node.ops[0])]()], node.comparators)
    elif isinstance(node, ast.BoolOp):
        for i in range(len(node.values)):
            rest = node.values[:i] + node.values[i + 1 :]
            new = rest[0] if len(rest) == 1 else ast.BoolOp(node.op, rest)
            yield "if one of several conditions is left out", new
    elif isinstance(node, ast.IfExp):
        yield "if a special case is not treated, or is treated always", node.body
        yield "if a special case is not treated, or is treated always", node.orelse
    elif isinstance(node, ast.Call):
        yield from _instead_of_call(node)
    elif isinstance(node, ast.Tuple | ast.List) and len(node.elts) > 2:
        if isinstance(node.ctx, ast.Load):
            for i in range(len(node.elts)):
                rest = node.elts[:i] + node.elts[i + 1 :]
                yield "if one entry of a list is left out", type(node)(rest, node.ctx)
    elif isinstance(node, ast.Attribute) and node.attr == "T":
        yield "if one matrix is not transposed", node.value
    elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield from _instead_of_number(node)


def _instead_of_operation(node: ast.BinOp) -> Iterator[tuple[str, ast.expr]]:
    left, op, right = node.left, node.op, node.right
    if isinstance(op, ast.Add | ast.Sub):
        turned = ast.Sub() if isinstance(op, ast.Add) else ast.Add()
        yield "with one sign turned", ast.BinOp(left, turned, right)
        if isinstance(op, ast.Sub):
            yield "if one difference is taken the wrong way round", ast.BinOp(right, op, left)
        yield from _brackets(node)
        yield "if one term of a sum is left out", left
        minus = isinstance(op, ast.Sub)
        yield (
            "if one term of a sum is left out",
            ast.UnaryOp(ast.USub(), right) if minus else right,
        )
    elif isinstance(op, ast.Mult):
        for factor, total in ((left, right), (right, left)):
            if isinstance(total, ast.BinOp) and isinstance(total.op, ast.Add | ast.Sub):
                for first, last in (
                    (ast.BinOp(factor, op, total.left), total.right),
                    (total.left, ast.BinOp(factor, op, total.right)),
                ):
                    new = ast.BinOp(first, total.op, last)
                    yield "if a factor of a whole sum is a factor of one term only", new
        yield "if one factor is left out", left
        yield "if one factor is left out", right
        yield "if one factor divides instead of multiplying", ast.BinOp(left, ast.Div(), right)
        yield "if one factor divides instead of multiplying", ast.BinOp(right, ast.Div(), left)
    elif isinstance(op, ast.Div | ast.FloorDiv):
        yield "if one division is left out", left
        yield "if one division multiplies instead", ast.BinOp(left, ast.Mult(), right)
        yield "if one quotient is upside down", ast.BinOp(right, op, left)
        if isinstance(op, ast.Div):
            yield "if one quotient loses its fraction", ast.BinOp(left, ast.FloorDiv(), right)
    elif isinstance(op, ast.Pow):
        yield "if one power, such as a square or a root, is left out", left
    elif isinstance(op, ast.MatMult):
        yield "if two matrices are multiplied in the other order", ast.BinOp(right, op, left)
        yield (
            "if one matrix is transposed",
            ast.BinOp(ast.Attribute(left, "T", ast.Load()), op, right),
        )
        yield (
            "if one matrix is transposed",
            ast.BinOp(left, op, ast.Attribute(right, "T", ast.Load())),
        )
        yield "if one factor is left out", left
        yield "if one factor is left out", right


def _brackets(node: ast.BinOp) -> Iterator[tuple[str, ast.expr]]:
    """Yield a sum in which a factor of one term is a factor of the next one too."""
    left, op, right = node.left, node.op, node.right
    phrase = "if a factor of one term is a factor of the next one too"
    if isinstance(left, ast.BinOp) and isinstance(left.op, ast.Mult):
        yield phrase, ast.BinOp(left.left, left.op, ast.BinOp(left.right, op, right))
    if isinstance(left, ast.BinOp) and isinstance(left.op, ast.Add | ast.Sub):
        last = left.right
        if isinstance(last, ast.BinOp) and isinstance(last.op, ast.Mult):
            inner = op
            if isinstance(left.op, ast.Sub):
                inner = ast.Sub() if isinstance(op, ast.Add) else ast.Add()
            both = ast.BinOp(last.left, last.op, ast.BinOp(last.right, inner, right))
            yield phrase, ast.BinOp(left.left, left.op, both)
    if isinstance(right, ast.BinOp) and isinstance(right.op, ast.Mult):
        inside = ast.BinOp(left, op, right.right)
        yield phrase, ast.BinOp(inside, right.op, right.left)


def _instead_of_call(node: ast.Call) -> Iterator[tuple[str, ast.expr]]:
    name = _called(node)
    if name in TURNED:
        other = TURNED[name]
        func = copy.deepcopy(node.func)
        if isinstance(func, ast.Attribute):
            func.attr = other
        elif isinstance(func, ast.Name):
            func.id = other
        yield (
            f"with {WORDS[other]} in place of {WORDS[name]}",
            ast.Call(func, node.args, node.keywords),
        )
    args = node.args
    if name == "clip" and len(args) == 3:
        yield "without one limit to a range", args[0]
        for i, function in ((1, "minimum"), (2, "maximum")):
            func = ast.Attribute(ast.Name("np", ast.Load()), function, ast.Load())
            yield "without one limit to a range", ast.Call(func, [args[0], args[3 - i]], [])
    elif len(args) == 2 and not node.keywords:
        yield "if two arguments of a function are swapped", ast.Call(node.func, args[::-1], [])
        if name in ("minimum", "maximum", "min", "max"):
            yield "without one limit", args[0]
            yield "without one limit", args[1]
    elif len(args) == 1 and name not in ("range", "len", "zip", "list", "float", "int"):
        yield f"if `{name}` is left out of one step", args[0]


def _instead_of_number(node: ast.Constant) -> Iterator[tuple[str, ast.expr]]:
    value = node.value
    assert isinstance(value, int | float)
    if isinstance(value, bool):
        return
    if isinstance(value, int):
        for near in (value - 1, value + 1):
            yield "if one count or index is off by one", ast.Constant(near)
    elif value:
        for other in (2.0 * value, 0.5 * value, 1.0, 0.0):
            if other != value:
                yield f"with {other:g} in place of a constant {value:g}", ast.Constant(other)
    else:
        yield "with 1 in place of a constant 0", ast.Constant(1.0)


def _statements(tree: ast.Module, function: ast.FunctionDef) -> Iterator[tuple[str, str, set[str]]]:
    """Yield the text with two steps in the other order, one left out, or a branch never taken."""
    for block in _blocks(function):
        for i, statement in enumerate(block):
            touched = {n.id for n in ast.walk(statement) if isinstance(n, ast.Name)}
            changes: list[tuple[str, list[ast.stmt]]] = []
            if i + 1 < len(block) and not isinstance(block[i + 1], ast.Return):
                swapped = [block[i + 1], statement]
                changes.append(
                    (
                        "if two steps come in the other order",
                        [*block[:i], *swapped, *block[i + 2 :]],
                    )
                )
            if isinstance(statement, ast.AugAssign | ast.Expr | ast.Assign):
                changes.append(
                    ("if one step is left out", [*block[:i], ast.Pass(), *block[i + 1 :]])
                )
            if isinstance(statement, ast.If):
                for body in (statement.orelse or [ast.Pass()], statement.body):
                    changes.append(
                        (
                            "if a special case is not treated, or is treated always",
                            [*block[:i], *body, *block[i + 1 :]],
                        )
                    )
            for phrase, new in changes:
                old = block[:]
                block[:] = new
                changed = ast.unparse(ast.fix_missing_locations(tree))
                block[:] = old
                yield phrase, changed, touched


def _blocks(node: ast.AST) -> Iterator[list[ast.stmt]]:
    for field in ("body", "orelse"):
        block = getattr(node, field, None)
        if isinstance(block, list) and block:
            yield block
            for statement in block:
                if not isinstance(statement, ast.While):
                    yield from _blocks(statement)
