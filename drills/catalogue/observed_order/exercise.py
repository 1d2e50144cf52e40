"""Observed order: values on exact and on perturbed power laws, and runs that have no order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of, largest_error
from drills.chart import chart_of
from drills.chart_plan import Plan
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.values import describe_call

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return power laws, exact and disturbed by the next power."""

    def runs(
        order: float, ratio: float, n: int, disturbed: float, label: str, level: str = "core"
    ) -> Case:
        end, C, D = rng.normal(size=(3, n))
        C = 0.5 * C / np.linalg.norm(C)
        steps = [0.7 * ratio**-i for i in range(3)]
        values = [end + C * h**order + disturbed * D * h ** (order + 1.0) for h in steps]
        return Case((*values, ratio) if "left out" not in label else tuple(values), label, level)

    return [
        runs(1.0, 2.0, 3, 0.0, "first order", "simple"),
        runs(2.0, 2.0, 3, 0.0, "second order", "simple"),
        runs(4.0, 2.0, 2, 0.0, "fourth order"),
        runs(2.0, 2.0, 4, 0.1, "second order and a little more"),
        runs(4.0, 2.0, 4, 0.1, "fourth order and a little more"),
        runs(2.0, 3.0, 3, 0.0, "a third of the step"),
        runs(3.0, 1.5, 3, 0.05, "two thirds of the step"),
        runs(float(rng.uniform(0.5, 0.9)), 2.0, 2, 0.0, "less than first order", "edge"),
        runs(2.0, 2.0, 1, 0.0, "one quantity", "edge"),
        runs(2.0, 10.0, 6, 0.0, "a tenth of the step"),
        runs(3.0, 2.0, 3, 0.0, "ratio left out", "edge"),
        Case((np.array([21, 40]), np.array([9, 25]), np.array([5, 20]), 2), WHOLE, "edge"),
    ]


def explain(answers: Sequence[Answer]) -> str:
    """Return the mistake that every answer shows in one of its parts, whatever is in the other."""
    for place, wrong in enumerate((_wrong_orders, _wrong_limits)):
        if all(answer.right[place] for answer in answers):
            continue
        names = list(wrong(*answers[0].case.args))
        for a in answers:
            values = wrong(*a.case.args)
            names = [name for name in names if largest_error(a.parts[place], values[name]) <= 1e-10]
        if names:
            return names[0]
    return coarse(answers)


def _wrong_orders(coarse: Array, medium: Array, fine: Array, ratio: float = 2.0) -> dict[str, Any]:
    first, second = np.linalg.norm(medium - coarse), np.linalg.norm(fine - medium)
    each = np.abs((medium - coarse) / (fine - medium))
    return {
        "fine_taken_for_the_truth": math.log(np.linalg.norm(fine - coarse) / second, ratio),
        "ratio_not_used": math.log2(first / second),
        "natural_logarithm": math.log(first / second),
        "order_rounded": round(math.log(first / second, ratio)),
        "norm_squared": 2.0 * math.log(first / second, ratio),
        "order_negative": math.log(second / first, ratio),
        "ratios_averaged": math.log(np.mean(each), ratio),
        "logarithms_averaged": np.mean(np.log(each)) / math.log(ratio),
        "another_norm": math.log(
            np.sum(np.abs(medium - coarse)) / np.sum(np.abs(fine - medium)), ratio
        ),
    }


def _wrong_limits(coarse: Array, medium: Array, fine: Array, ratio: float = 2.0) -> dict[str, Any]:
    growth = np.linalg.norm(medium - coarse) / np.linalg.norm(fine - medium)
    return {
        "minus_one_missing": fine + (fine - medium) / growth,
        "extrapolated_backwards": fine - (fine - medium) / (growth - 1.0),
        "not_extrapolated": fine,
        "order_rounded": fine + (fine - medium) / (ratio ** round(math.log(growth, ratio)) - 1.0)
        if round(math.log(growth, ratio))
        else fine,
        "second_order_assumed": fine + (fine - medium) / 3.0,
    }


def no_order(attempt: Attempt, answers: Sequence[Answer]) -> None:
    """Check runs that must be refused."""
    start, away = attempt.rng.normal(size=(2, 3))
    for label, runs in (
        ("two runs are equal", (start + away, start, start.copy(), 2.0)),
        ("the differences grow", (start, start + away, start + 3.0 * away, 2.0)),
        # There and back: both differences are equal to the last bit.
        ("the differences stay as they are", (start, start + away, start.copy(), 2.0)),
    ):
        attempt.require_error(
            label,
            partial(attempt.call, *runs),
            sentence="Runs whose differences do not get smaller have no order; a number here "
            "would be believed.",
            call=describe_call(attempt.card.entry, runs),
            # A wrong formula may accept them too; then it is the formula that has to be named.
            slip="" if attempt.failed else "no_order_not_refused",
        )


def extrapolated(attempt: Attempt) -> Plan:
    """Return what extrapolation buys: Verlet's three runs against a single finer one.

    Richardson extrapolation (1911) cancels the leading error of three runs at steps dt, dt / 2 and
    dt / 4. It costs all three, so the diagram has the work on its axis: the force evaluations.

    Args:
        attempt: the learner's answer, which extrapolates; `ask` calls it.

    Returns:
        The plan of a work-precision diagram of the angle of a pendulum at the end [rad].
    """
    from course.oracles.mujoco import oscillator
    from course.rigid_body import problems, simulate

    problem = problems.pendulum()
    system, time = problem.system, problem.duration
    counts = {time / n: n for n in (100, 200, 400, 800)}  # steps of the coarsest run, by its dt
    # MuJoCo's model is compiled here, outside of what is timed.
    start = 1.0, float(system.q0[0]), 0.0
    runners = {
        dt: oscillator.pendulum(*start, dt / 4, "Euler", gravity=problems.STANDARD_GRAVITY)
        for dt in counts
    }

    def angle(steps: int) -> Array:
        return simulate(system, "velocity_verlet", time / steps, steps, every=steps).q[-1]

    def ask(place: Any, dt: float) -> tuple[Any, float]:
        three = [angle(counts[dt] * factor) for factor in (1, 2, 4)]
        _, limit = place.call("observed_order", *three, 2.0)
        # The work of n + 2 n + 4 n steps.
        return np.asarray(limit, dtype=float), 7 * counts[dt]

    return Plan(
        settings=list(counts),
        ask=ask,
        truth=problem.truth(time)[0],
        check=problems.tight_reference(system, time)[0],
        ours={
            "Verlet, the finest run alone": lambda dt: (angle(4 * counts[dt]), 4 * counts[dt]),
        },
        libraries={
            "MuJoCo Euler, one run": lambda dt: (runners[dt].run(4 * counts[dt])[0], 4 * counts[dt])
        },
    )


_ORDER = "order = math.log(growth) / math.log(ratio)"
_LIMIT = "fine + (fine - medium) / (growth - 1.0)"
_CHECK = "    if not 0.0 < second < first < math.inf:\n"

SLIPS = slips(
    fine_taken_for_the_truth=(
        "first = np.linalg.norm(medium - coarse)",
        "first = np.linalg.norm(fine - coarse)",
        "The finest run is treated as the truth. Its own error is in both differences then: at "
        "order 1 you get 1.58, at order 2 you get 2.32.",
    ),
    ratio_not_used=(
        _ORDER,
        "order = math.log2(growth)",
        "The logarithm is to the base 2 whatever the ratio of the steps was.",
    ),
    natural_logarithm=(
        _ORDER,
        "order = math.log(growth)",
        "The natural logarithm of the ratio of the differences is p log(r): divide by log(r).",
    ),
    order_rounded=(
        _ORDER,
        "order = round(math.log(growth) / math.log(ratio))",
        "The order is rounded to a whole number. The runs show one near it: return what they show, "
        "and extrapolate with it.",
    ),
    norm_squared=(
        _ORDER,
        "order = 2.0 * math.log(growth) / math.log(ratio)",
        "The order is twice what it should be: the differences are measured by the squares of "
        "their norms.",
    ),
    order_negative=(
        _ORDER,
        "order = -math.log(growth) / math.log(ratio)",
        "The order has the wrong sign: the ratio of the differences is upside down. It is the "
        "first, larger, over the second.",
    ),
    another_norm=(
        "np.linalg.norm(medium - coarse)",
        "np.sum(np.abs(medium - coarse))",
        "np.linalg.norm(fine - medium)",
        "np.sum(np.abs(fine - medium))",
        "The differences are measured by the sum or the mean of their sizes. The task asks for the "
        "2-norm; where the runs are not yet in the range of one power of h the two differ.",
    ),
    ratios_averaged=(
        "growth = first / second",
        "growth = np.mean(np.abs((medium - coarse) / (fine - medium)))",
        "The ratio is taken component by component and averaged. One in which the runs hardly "
        "differ then counts as much as all others: take the ratio of the two 2-norms.",
    ),
    logarithms_averaged=(
        "growth = first / second",
        "growth = np.exp(np.mean(np.log(np.abs((medium - coarse) / (fine - medium)))))",
        "The order is found component by component and averaged. One in which the runs hardly "
        "differ then counts as much as all others: take one order, of the ratio of the 2-norms.",
    ),
    second_order_assumed=(
        _LIMIT,
        "fine + (fine - medium) / 3.0",
        "The extrapolation divides by 3, which is 2^2 - 1: right for order 2 and halved steps "
        "only. Divide by r^p - 1 with the order that you have found.",
    ),
    largest_component=(
        "np.linalg.norm(medium - coarse)",
        "np.max(np.abs(medium - coarse))",
        "np.linalg.norm(fine - medium)",
        "np.max(np.abs(fine - medium))",
        "The differences are measured by their largest component. That is a norm too, but the "
        "task asks for the 2-norm; where the runs are not yet in the range of one power of h, "
        "the two give different orders.",
    ),
    minus_one_missing=(
        _LIMIT,
        "fine + (fine - medium) / growth",
        "The last difference is r^p - 1 times the error that is left, not r^p times: it is the "
        "error of `medium` minus that of `fine`.",
    ),
    extrapolated_backwards=(
        _LIMIT,
        "fine - (fine - medium) / (growth - 1.0)",
        "The correction has the wrong sign: the result goes on in the direction in which the "
        "runs were going, from medium to fine and beyond.",
    ),
    not_extrapolated=(
        _LIMIT,
        "fine",
        "The second value is the finest run itself, not what the three runs are heading for.",
    ),
    no_order_not_refused=(
        _CHECK,
        "    if not second > -1.0:\n",
        "Runs that do not converge get a number all the same. Check that the second difference "
        "is smaller than the first and not zero, else raise ValueError.",
    ),
    mean_beside_a_norm=(
        "first = np.linalg.norm(medium - coarse)",
        "first = np.mean(np.abs(medium - coarse))",
        "The first difference is measured by its mean size and the second by its 2-norm. Use the "
        "2-norm for both.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        1e-9,
        "two differences and a logarithm: rounding",
        explain=explain,
        last=no_order,
        then=("edge", "runs that have no order"),
    ),
    examples=(
        "observed_order(np.array([1.16]), np.array([1.04]), np.array([1.01]))",
        "observed_order(np.array([2.0, 0.0]), np.array([1.5, 0.5]), np.array([1.25, 0.75]))",
        "observed_order(np.array([1.81]), np.array([1.09]), np.array([1.01]), 3.0)",
    ),
    chart=chart_of(
        "A pendulum's angle after 2 s, extrapolated",
        extrapolated,
        tolerance=1e-5,
        error_unit="rad",
        failed_above=10.0,
    ),
    slips=SLIPS
    + coarse_slips("observed_order", "A difference of two extrapolated results needs the others.")
    + value_slips("observed_order", swapped=True),
)
