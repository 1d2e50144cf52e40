"""No case of an exercise is decided by rounding: a right answer that rounds otherwise still passes.

The worked answer is asked twice: as it is, and with its floats moved by 1e-12 of themselves. A
continuous answer then moves by as little. One that jumps has a case on a switching line, where a
right answer of another order of operations is rejected.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from drills import exercise as exercises
from drills.cards import card
from drills.case_judge import WHOLE, Case
from drills.grader import attempt
from drills.inprocess import InProcess
from drills.verify import in_this_process
from tests.budget import PROVE, exercise_params, exercise_topics, sampled

pytestmark = pytest.mark.slow

MOVE = 1e-12  # of each float
JUMP = 1e-7  # of the largest element of a result, one added: far above what MOVE does by itself
SEEDS = (0, 1, 2) if PROVE else (0,)

# Cases in which a move of 1e-12 may matter, by exercise and label, with the reason. They lie on a
# limit on purpose (the task says what holds there, and exact numbers reach it without rounding), or
# the answer is so sensitive there that its tolerance allows for it.
EXPECTED: dict[str, dict[str, str]] = {
    "impact_time": {"slow": "sensitive: two velocities of 1 m/s differ by 1e-6 m/s"},
    "two_link_ik": {
        "on the inner edge": "on purpose: the target is just within reach",
        "on the outer edge": "on purpose: the target is just within reach",
    },
    "mppi_step": {"large costs, some failed": "sensitive: small differences of costs of 1e6"},
    "dbscan": {
        "a lattice, along x": "on purpose: integer distances of exactly eps",
        "exactly eps": "on purpose: a distance of exactly eps",
        "whole numbers on a lattice": "on purpose: integer distances of exactly eps",
    },
    "boundary_update": {
        "at a threshold": "on purpose: 12 of 16 is the threshold 0.75, exactly",
        "whole numbers": "on purpose: thresholds of 0 and 1, which a mean reaches exactly",
    },
    "tune_randomised": {
        label: "the delay is a count of steps, which an array of floats holds"
        for label in (
            "all drawn",
            "one cart to train on",
            "other delays",
            "the last cart is for the test",
        )
    },
    "rescale_step": {
        "no discount": "on purpose: a discount of exactly 1 has a formula of its own",
        "no discount, no goal": "on purpose: a discount of exactly 1 has a formula of its own",
    },
}

# Continuous functions, whose results carry the rounding of a whole algorithm, which differs between
# right answers. They are moved, too. Those that round would turn the move into a jump of their own.
NOISY = '''

import math as _math
import numpy as _np


class _Noisy:
    """A module whose continuous functions return floats that are moved by 1e-12 of themselves."""

    CONTINUOUS = frozenset(
        "sin cos tan exp log sqrt hypot arctan2 atan2 arctan arccos acos arcsin tanh dot cross"
        " matmul einsum vdot outer sum mean cumsum prod inner trapezoid radians norm solve inv pinv"
        " lstsq svd eig eigh eigvals eigvalsh qr det cholesky convolve interp gradient".split()
    )

    def __init__(self, module):
        self.module = module

    def __getattr__(self, name):
        found = getattr(self.module, name)
        if name == "linalg":
            return _Noisy(found)
        if name not in self.CONTINUOUS:
            return found

        def noisy(*args, **kwargs):
            return _moved(found(*args, **kwargs))

        return noisy


def _moved(value):
    if isinstance(value, tuple):
        return type(value)(*map(_moved, value)) if hasattr(value, "_fields") else tuple(
            map(_moved, value))
    if isinstance(value, float):
        return value * (1.0 + 1e-12)
    if isinstance(value, _np.ndarray) and value.dtype.kind == "f":
        signs = 1.0 - 2.0 * (_np.arange(value.size).reshape(value.shape) % 2)
        return value * (1.0 + 1e-12 * signs)
    return value


np, math = _Noisy(_np), _Noisy(_math)
'''

# The worked answer, asked with floats that are moved by 1e-12 of themselves.
MOVED = """

import numpy as _np

_exact = {entry}


def {entry}(*args):
    return _exact(*map(_moved_argument, args))


def _moved_argument(value):
    if type(value) is float:
        return float(_moved_argument(_np.array(value)))
    if isinstance(value, _np.ndarray) and value.dtype.kind == "f":
        up = _np.ascontiguousarray(value, dtype=float).view(_np.int64) // 7 % 2
        return value * (1.0 + 1e-12 * (2.0 * up.reshape(value.shape) - 1.0))
    return value
"""

# Arguments that the answer has to hand on to the last bit, by exercise, with the reason.
EXACT = {"rrt": "the first node is the start, the last vertex of a path is the goal"}


def moved(value: Any) -> Any:
    """Return floats moved by MOVE up or down, equal ones alike, so that copies stay equal."""
    if isinstance(value, float):
        return float(moved(np.array(value)))
    if isinstance(value, np.ndarray) and value.dtype.kind == "f":
        up = (np.ascontiguousarray(value, dtype=float).view(np.int64) // 7 % 2).reshape(value.shape)
        return value * (1.0 + MOVE * (2.0 * up - 1.0))
    return value


def answers(name: str) -> Iterator[tuple[Case, list[tuple[Any, ...]]]]:
    """Yield each case with the right results: as they are, of moved floats, of noisy routines."""
    exercise, text = card(name), card(name).solution_text()
    given = exercises.of(name).given
    exact = InProcess(text, given)
    noisy = InProcess(text + NOISY, given)
    module = importlib.import_module(f"drills.catalogue.{name}.exercise")
    for seed in SEEDS:
        for case in module.cases(np.random.default_rng(seed)):
            results = [
                exact.call(exercise.entry, *case.args),
                exact.call(exercise.entry, *map(moved, case.args)),
                noisy.call(exercise.entry, *case.args),
            ]
            yield case, [one if isinstance(one, tuple) else (one,) for one in results]


def jumps(right: tuple[Any, ...], other: tuple[Any, ...]) -> bool:
    """Return whether a result differs by more than MOVE explains; a sign of all may turn."""
    for one, two in zip(right, other, strict=True):
        a, b = np.asarray(one, dtype=float), np.asarray(two, dtype=float)
        if a.shape != b.shape:
            return True
        size = JUMP * (1.0 + np.max(np.abs(a), initial=0.0))
        if min(np.max(np.abs(a - b), initial=0.0), np.max(np.abs(a + b), initial=0.0)) > size:
            return True
    return False


def decided_by_rounding(name: str) -> list[str]:
    """Return the labels of the cases in which a move of 1e-12 makes the right results jump."""
    return sorted(
        {
            case.label
            for case, (right, *others) in answers(name)
            if any(jumps(right, other) for other in others)
        }
    )


def judged_by_cases() -> Iterator[Any]:
    """Yield the exercises whose right results are those of the worked answer, case by case."""
    for name, topic in exercise_topics().items():
        module = importlib.import_module(f"drills.catalogue.{name}.exercise")
        if card(name).kind == "function" and hasattr(module, "judge_of"):
            yield pytest.param(name, id=name, marks=pytest.mark.topic(topic))


@pytest.mark.parametrize("name", sampled(list(judged_by_cases()), 3))
def test_no_case_is_decided_by_rounding(name: str) -> None:
    assert set(decided_by_rounding(name)) <= set(EXPECTED.get(name, {}))


EVERY = exercise_params("hopper_filter", "solve_stack", step=5)


def changed_verdicts(name: str) -> list[str]:
    """Return the checks of an exercise that fail where an answer is moved, for another reason.

    An error that the move explains is none, although it may be above the tolerance: this shows
    where rounding decides, not where an answer is less exact than the task asks for.
    """
    entry_card, text = card(name), card(name).solution_text()
    variants = [text + NOISY]
    if entry_card.kind == "function" and name not in EXACT:
        variants.append(text + MOVED.format(entry=entry_card.entry))
    result = []
    for variant in variants:
        for seed in SEEDS:
            report = attempt(entry_card, variant, seed=seed, place=in_this_process).report
            assert report.passed or any(not check.passed for check in report.checks), report.problem
            for check in report.checks:
                if check.passed:
                    continue
                size = np.max(np.abs(check.values[1]), initial=0.0) if check.values else 0.0
                if not check.error <= JUMP * (1.0 + size):
                    result.append(check.name)
    return [one for one in result if one.partition(":")[0] not in EXPECTED.get(name, {})]


@pytest.mark.parametrize("name", EVERY)
def test_no_verdict_is_decided_by_rounding(name: str) -> None:
    assert changed_verdicts(name) == []


def test_a_case_on_a_switching_line_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check the case that `dagger_round` once had: the expert's brake switches where x[1] = 0."""
    from drills.catalogue.dagger_round import exercise

    def brake(x: Any) -> Any:
        return -np.sign(np.asarray(x, dtype=float)[1:])

    plant = np.array([[1, 1], [0, 1]]), np.array([[0], [1]])
    data = np.array([[0, 1], [1, -1]]), np.array([[-1, 1]])
    on_the_line = Case((*plant, brake, *data, np.array([1, 2]), 3), "on the line", "edge")
    monkeypatch.setattr(exercise, "cases", lambda rng: [on_the_line])
    assert decided_by_rounding("dagger_round") == ["on the line"]


# Results that are integers by nature: indices, counts, codes, and times in integer nanoseconds.
INTEGER_RESULTS = {
    "certify_edge",
    "compatible",
    "keep_last",
    "response_times",
    "wake_ups",
    "which_stage",
}


@pytest.mark.parametrize("name", list(judged_by_cases()))
def test_integer_arguments_have_fractional_results(name: str) -> None:
    """Check the case of integers: an answer that keeps their type shows only in fractions."""
    exercise = card(name)
    module = importlib.import_module(f"drills.catalogue.{name}.exercise")
    place = InProcess(exercise.solution_text(), exercises.of(name).given)
    whole = [case for case in module.cases(np.random.default_rng(0)) if case.label == WHOLE]
    for case in whole:
        got = place.call(exercise.entry, *case.args)
        parts = [np.asarray(v, dtype=float) for v in (got if isinstance(got, tuple) else (got,))]
        fractional = any(np.any(part != np.trunc(part)) for part in parts)
        assert fractional is not (name in INTEGER_RESULTS)
