"""Observed order: values on exact and on perturbed power laws, and runs that have no order."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drills.attempt import Attempt, Place
from drills.exercise import Exercise, Slip
from drills.judge import Case, repeat_calls
from drills.values import Mismatch, as_float64, describe_call

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision

Array = NDArray[np.float64]


def judge(attempt: Attempt) -> None:
    """Values, then the two ways in which three runs have no order."""
    cases = _cases(attempt.rng)
    shuffled = [cases[index] for index in attempt.rng.permutation(len(cases))]
    made = [(case.args, attempt.call(*case.args)) for case in shuffled]
    slips = _seen(made, 0, _wrong_orders), _seen(made, 1, _wrong_limits)
    for case, (_, got) in zip(shuffled, made, strict=True):
        call = describe_call(attempt.card.entry, case.args)
        parts = attempt.parts(got, ("order", "limit"), call=call)
        if parts is None:
            continue
        order, limit = attempt.expected(*case.args)
        check: dict[str, Any] = {"call": call, "why": "two differences and a logarithm: rounding"}
        for what, part, right, unit, slip in (
            ("order", parts[0], order, "1", slips[0]),
            ("limit", parts[1], limit, "m", slips[1]),
        ):
            name = f"{case.label}: {what}"
            attempt.compare(name, part, right, tolerance=1e-9, unit=unit, slip=slip, **check)
    _refused(attempt)
    if not attempt.failed:
        repeat_calls(attempt, made)
    if not attempt.failed:
        attempt.time_call(*cases[0].args, repeat=1000)


def _seen(made: list[tuple[tuple[Any, ...], Any]], place: int, wrong: Callable[..., Any]) -> str:
    """The mistake that every answer shows in one of its parts, or ""."""
    names = list(wrong(*made[0][0]))
    for args, got in made:
        part = got[place] if isinstance(got, list | tuple) and len(got) == 2 else None
        names = [name for name, value in wrong(*args).items() if name in names and _is(part, value)]
    return names[0] if names else ""


def _wrong_orders(
    coarse: Array, medium: Array, fine: Array, ratio: float = 2.0
) -> dict[str, float]:
    """What the usual mistakes give, so that they are known whatever else is in the answer."""
    first, second = np.linalg.norm(medium - coarse), np.linalg.norm(fine - medium)
    return {
        "fine_taken_for_the_truth": math.log(np.linalg.norm(fine - coarse) / second, ratio),
        "ratio_not_used": math.log2(first / second),
        "natural_logarithm": math.log(first / second),
    }


def _wrong_limits(
    coarse: Array, medium: Array, fine: Array, ratio: float = 2.0
) -> dict[str, Array]:
    growth = np.linalg.norm(medium - coarse) / np.linalg.norm(fine - medium)
    return {
        "minus_one_missing": fine + (fine - medium) / growth,
        "extrapolated_backwards": fine - (fine - medium) / (growth - 1.0),
        "not_extrapolated": fine,
    }


def _is(got: Any, wrong: ArrayLike) -> bool:
    """Whether a wrong value came back; `compare` names it only where it is not the right one."""
    try:
        return bool(np.max(np.abs(as_float64(got, np.shape(wrong)) - np.asarray(wrong))) <= 1e-10)
    except Mismatch:
        return False


def _cases(rng: np.random.Generator) -> list[Case]:
    def runs(order: float, ratio: float, n: int, disturbed: float, label: str) -> Case:
        end, C, D = rng.normal(size=(3, n))
        C = 0.5 * C / np.linalg.norm(C)
        steps = [0.7 * ratio**-i for i in range(3)]
        values = [end + C * h**order + disturbed * D * h ** (order + 1.0) for h in steps]
        return Case((*values, ratio) if "left out" not in label else tuple(values), label)

    return [
        runs(1.0, 2.0, 3, 0.0, "first order"),
        runs(2.0, 2.0, 3, 0.0, "second order"),
        runs(4.0, 2.0, 2, 0.0, "fourth order"),
        runs(2.0, 2.0, 4, 0.1, "second order and a little more"),
        runs(4.0, 2.0, 4, 0.1, "fourth order and a little more"),
        runs(2.0, 3.0, 3, 0.0, "a third of the step"),
        runs(3.0, 1.5, 3, 0.05, "two thirds of the step"),
        runs(float(rng.uniform(0.5, 0.9)), 2.0, 2, 0.0, "less than first order"),
        runs(2.0, 2.0, 1, 0.0, "one quantity"),
        runs(2.0, 10.0, 6, 0.0, "a tenth of the step"),
        runs(3.0, 2.0, 3, 0.0, "ratio left out"),
    ]


def _refused(attempt: Attempt) -> None:
    start = attempt.rng.normal(size=3)
    away = attempt.rng.normal(size=3)
    same = "two runs are equal", (start + away, start, start.copy(), 2.0)
    worse = "the differences grow", (start, start + away, start + 3.0 * away, 2.0)
    # There and back: both differences are equal to the last bit.
    swing = "the differences stay as they are", (start, start + away, start.copy(), 2.0)
    for label, args in (same, worse, swing):
        attempt.require_error(
            label,
            partial(attempt.call, *args),
            sentence="Runs whose differences do not get smaller have no order; a number here "
            "would be believed.",
            call=describe_call(attempt.card.entry, args),
            # A wrong formula may accept them too; then it is the formula that has to be named.
            slip="" if attempt.failed else "no_order_not_refused",
        )


def chart(attempt: Attempt, worked: Place) -> WorkPrecision:
    """What extrapolation buys: Verlet's three runs against a single finer one."""
    from course.measure.work_precision import Method, Result, measure
    from course.oracles.mujoco import oscillator as mujoco_oscillator
    from course.rigid_body import problems, simulate

    problem = problems.pendulum()
    system, time = problem.system, problem.duration
    counts = {time / n: n for n in (100, 200, 400, 800)}
    finest = {dt: 4 * n for dt, n in counts.items()}

    def angle(steps: int) -> np.ndarray:
        return simulate(system, "velocity_verlet", time / steps, steps, every=steps).q[-1]

    def three(dt: float) -> list[np.ndarray]:
        return [angle(counts[dt] * factor) for factor in (1, 2, 4)]

    def driven(child: Place) -> Callable[[float], Result]:
        def run(dt: float) -> Result:
            _, limit = child.call(attempt.card.entry, *three(dt), 2.0)
            return Result(np.asarray(limit, dtype=float), 7 * counts[dt])

        return run

    def single(dt: float) -> Result:
        return Result(angle(finest[dt]), finest[dt])

    runners = {
        dt: mujoco_oscillator.pendulum(
            1.0, float(system.q0[0]), 0.0, time / n, "Euler", gravity=problems.STANDARD_GRAVITY
        )
        for dt, n in finest.items()
    }

    def library(dt: float) -> Result:
        return Result(runners[dt].run(finest[dt])[0], finest[dt])

    all_steps = list(counts)
    return measure(
        [
            Method("yours", driven(attempt.learner.child), all_steps, style="yours"),
            Method("worked answer", driven(worked), all_steps),
            Method("Verlet, the finest run alone", single, all_steps),
            Method("MuJoCo Euler, one run", library, all_steps, style="oracle"),
        ],
        problem.truth(time)[0],
        reference_check=problems.tight_reference(system, time)[0],
        tolerance=1e-5,
        failed_above=10.0,
        repeats=3,
        question="A pendulum's angle after 2 s, extrapolated",
        error_unit="rad",
    )


_ORDER = "order = math.log(growth) / math.log(ratio)"
_LIMIT = "fine + (fine - medium) / (growth - 1.0)"
_CHECK = "    if not 0.0 < second < first < math.inf:\n"

EXERCISE = Exercise(
    judge=judge,
    examples=(
        "observed_order(np.array([1.16]), np.array([1.04]), np.array([1.01]))",
        "observed_order(np.array([2.0, 0.0]), np.array([1.5, 0.5]), np.array([1.25, 0.75]))",
        "observed_order(np.array([1.81]), np.array([1.09]), np.array([1.01]), 3.0)",
    ),
    chart=chart,
    slips=(
        Slip(
            "fine_taken_for_the_truth",
            "The finest run is treated as the truth. Its own error is in both differences then: at "
            "order 1 you get 1.58, at order 2 you get 2.32.",
            edits=(
                (
                    "first = np.linalg.norm(medium - coarse)",
                    "first = np.linalg.norm(fine - coarse)",
                ),
            ),
        ),
        Slip(
            "ratio_not_used",
            "The logarithm is to the base 2 whatever the ratio of the steps was.",
            edits=((_ORDER, "order = math.log2(growth)"),),
        ),
        Slip(
            "natural_logarithm",
            "The natural logarithm of the ratio of the differences is p log(r): divide by log(r).",
            edits=((_ORDER, "order = math.log(growth)"),),
        ),
        Slip(
            "largest_component",
            "The differences are measured by their largest component. That is a norm too, but the "
            "task asks for the 2-norm; where the runs are not yet in the range of one power of h, "
            "the two give different orders.",
            edits=(
                ("np.linalg.norm(medium - coarse)", "np.max(np.abs(medium - coarse))"),
                ("np.linalg.norm(fine - medium)", "np.max(np.abs(fine - medium))"),
            ),
        ),
        Slip(
            "minus_one_missing",
            "The last difference is r^p - 1 times the error that is left, not r^p times: it "
            "is the error of `medium` minus that of `fine`.",
            edits=((_LIMIT, "fine + (fine - medium) / growth"),),
        ),
        Slip(
            "extrapolated_backwards",
            "The correction has the wrong sign: the result goes on in the direction in which the "
            "runs were going, from medium to fine and beyond.",
            edits=((_LIMIT, "fine - (fine - medium) / (growth - 1.0)"),),
        ),
        Slip(
            "not_extrapolated",
            "The second value is the finest run itself, not what the three runs are heading for.",
            edits=((_LIMIT, "fine"),),
        ),
        Slip(
            "no_order_not_refused",
            "Runs that do not converge get a number all the same. Check that the second difference "
            "is smaller than the first and not zero, else raise ValueError.",
            edits=((_CHECK, "    if not second > -1.0:\n"),),
        ),
    ),
)
