"""The silent-bug hunt of chapter 1: judged by what a free body keeps, then by value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Answer, Case, either_sign, judge_of, largest_error
from drills.chart import angle_between, chart_of
from drills.chart_plan import Plan
from drills.exercise import Exercise, slips, value_slips
from drills.values import Mismatch, as_float64

Array = NDArray[np.float64]
COARSE = 0.01  # a drift beyond it is a mistake, one below it may be that of a coarse method
ACCURATE = "RK4 errs by less than 1e-7 in these runs; the bug changes the first digits"


def cases(rng: np.random.Generator) -> list[Case]:
    """Return bodies on which a bug shows, and bodies on which it does not."""

    def start() -> Array:
        q = rng.normal(size=4)
        return np.asarray(q / np.linalg.norm(q))

    def moments() -> Array:
        # Sums of squared distances, as those of a real body: no moment above the other two.
        squares = rng.uniform(0.3, 2.0, size=3)
        return np.asarray(squares.sum() - squares)

    def rates(size: float) -> Array:
        direction = rng.normal(size=3)
        return np.asarray(size * direction / np.linalg.norm(direction))

    axis = int(rng.integers(3))
    return [
        Case((start(), rates(3.0), moments(), 0.01, 30), "three moments"),
        Case((start(), rates(4.0), moments(), 0.008, 30), "three moments"),
        Case(
            (start(), np.array([0.01, 3.0, -0.02]), np.array([1.0, 2.0, 2.8]), 0.02, 40),
            "about the middle axis",
        ),
        Case((start(), rates(3.0), np.array([1.0, 1.0, 1.6]), 0.01, 25), "a symmetric body"),
        Case(
            (start(), 3.0 * np.eye(3)[axis], moments(), 0.01, 20),
            "about a principal axis",
            "simple",
        ),
        Case((start(), rates(3.0), np.full(3, 0.7), 0.01, 20), "three equal moments", "simple"),
        Case((start(), np.zeros(3), moments(), 0.01, 3), "at rest", "edge"),
        Case((start(), rates(2.0), moments(), 0.01, 0), "no step", "edge"),
        Case((start(), rates(2.0), moments(), 0.02, 1), "one step", "edge"),
        Case(
            (np.array([0, 1, 0, 0]), np.array([1, -2, 2]), np.array([2, 3, 4]), 0.01, 20),
            WHOLE,
            "edge",
        ),
    ]


def _to_world(q: Array, vector: Array) -> Array:
    w, u = q[0], q[1:]
    return np.asarray(vector + 2.0 * np.cross(u, np.cross(u, vector) + w * vector))


def conserved(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check what a free body keeps: it says what is wrong, a value only that something is."""
    try:
        q, omega = as_float64(parts[0], (4,)), as_float64(parts[1], (3,))
    except Mismatch:
        return  # the comparison of the values says what is wrong with it
    with np.errstate(all="ignore"):  # what came back may be as large as it likes
        _conserved(attempt, case, call, q, omega)


def _conserved(attempt: Attempt, case: Case, call: str, q: Array, omega: Array) -> None:
    q0, omega0, inertia = case.args[:3]
    start, end = _to_world(q0, inertia * omega0), _to_world(q, inertia * omega)
    size = float(np.linalg.norm(start))
    if size == 0.0:
        return
    energy = float(inertia @ omega**2 / (inertia @ omega0**2) - 1.0)
    attempt.require(
        f"{case.label}: energy",
        abs(energy) <= 1e-6,
        sentence=f"The kinetic energy changes by {energy:.2g} of itself"
        + ("; nothing pushes." if abs(energy) > COARSE else ", more than RK4 loses."),
        got=f"{energy:.2g}",
        expected="0",
        error=abs(energy),
        tolerance=1e-6,
        unit="1",
        why=ACCURATE,
        call=call,
    )
    drift = float(np.linalg.norm(end - start)) / size
    turned = math.degrees(
        math.atan2(float(np.linalg.norm(np.cross(start, end))), float(start @ end))
    )
    attempt.require(
        f"{case.label}: angular momentum in the world",
        drift <= 1e-6,
        sentence=f"The angular momentum in the world has turned by {turned:.2f} degrees and its "
        f"length changed by {np.linalg.norm(end) / size - 1.0:.1g} of itself. Without a torque "
        "it is constant, as a vector."
        if drift > COARSE
        else f"The angular momentum in the world drifts by {drift:.1g} of itself, more than with "
        "RK4.",
        got=f"{drift:.2g}",
        expected="0",
        error=drift,
        tolerance=1e-6,
        unit="1",
        why=ACCURATE,
        call=call,
    )


def smaller_steps(attempt: Attempt, answers: Sequence[Answer]) -> None:
    """Check that smaller steps converge.

    Correct equations of too low an order only come closer.
    """
    case = next(a.case for a in answers if a.case.label == "three moments")
    if not attempt.failed or attempt.shown:
        return
    q, omega, inertia, dt, steps = case.args
    truth = np.concatenate(attempt.expected(q, omega, inertia, dt / 4, 4 * steps))
    first = next(a for a in answers if a.case is case)
    for other in (steps - 1, steps + 1):
        _, rates_off = attempt.expected(q, omega, inertia, dt, other)
        if first.parts and largest_error(first.parts[1], rates_off) < 1e-6:
            attempt.shown = "one_step_off"
            return
    errors = []
    for finer in (1, 2, 4):
        result = attempt.call(q, omega, inertia, dt / finer, finer * steps)
        try:
            end, rates = as_float64(result[0], (4,)), as_float64(result[1], (3,))
        except (Mismatch, TypeError, IndexError):
            return
        right = np.concatenate((either_sign(end, truth[:4]), truth[4:]))
        errors.append(largest_error(np.concatenate((end, rates)), right))
    if 1e-9 < errors[2] < errors[1] < errors[0] < 1.0:
        orders = [math.log2(errors[i] / errors[i + 1]) for i in range(2)]
        if min(orders) > 0.7 and abs(orders[1] - orders[0]) < 0.5:
            attempt.shown = "order_too_low"


def tumbling(attempt: Attempt) -> Plan:
    """Return attitude of the chapter's tumbling body after 4 s."""
    from course.oracles.mujoco import free
    from course.rigid_body import problems, simulate

    time = 4.0
    problem = problems.tumble(duration=time)
    system = problem.system
    steps = {time / n: n for n in (25, 50, 100, 200, 400)}
    start = system.q0, system.v0, system.params
    runners = {dt: free.free_body(system.params, system.q0, system.v0, dt, "RK4") for dt in steps}

    def ask(place: Any, dt: float) -> tuple[Array, float]:
        return np.asarray(place.call("tumble", *start, dt, steps[dt])[0], float), 4 * steps[dt]

    def compiled(dt: float) -> tuple[Array, float]:
        return simulate(system, "rk4", dt, steps[dt], every=steps[dt]).q[-1], 4 * steps[dt]

    def library(dt: float) -> tuple[Array, float]:
        return runners[dt].run(steps[dt])[0], runners[dt].evaluations(steps[dt])

    return Plan(
        settings=list(steps),
        ask=ask,
        truth=problem.truth(time)[0],
        check=problems.tight_reference(system, time)[0],
        ours={"compiled rk4": compiled},
        libraries={"MuJoCo RK4": library},
        error=angle_between,
    )


def five_steps(attempt: Attempt, cases: Sequence[Case]) -> None:
    """Time a few steps."""
    attempt.time_call(*cases[0].args[:4], 5, what="time per 5 steps")


_SIGN = ("-np.cross(omega, inertia * omega)", "np.cross(omega, inertia * omega)")
_LEFT = (
    *("w * i + y * k - z * j", "w * i - y * k + z * j"),
    *("w * j + z * i - x * k", "w * j - z * i + x * k"),
    *("w * k + x * j - y * i", "w * k - x * j + y * i"),
)

SLIPS = slips(
    bug_still_there=(
        *_SIGN,
        "The bug is still there: the gyroscopic term has the wrong sign. Energy and |L| cannot "
        "see it, because omega x (I omega) is at right angles to omega and to I omega.",
    ),
    wrong_suspect=(
        *_SIGN,
        *_LEFT,
        "You changed the side of the quaternion's product, which was right, and the bug is still "
        "there. Spin about a principal axis from a tilted start: that was right before, and "
        "there only the quaternion works.",
    ),
    one_bug_for_another=(
        *_LEFT,
        "The sign of the gyroscopic term is right now, but the quaternion's product is on the "
        "wrong side: the rate is the body's, so it stands to the right of q.",
    ),
    gyroscopic_term_removed=(
        "omega_rate = -np.cross(omega, inertia * omega) / inertia",
        "omega_rate = np.zeros(3)",
        "The gyroscopic term is gone. Then omega stays constant in the body, which only a spin "
        "about a principal axis does: the energy is kept and L is not.",
    ),
    inertia_not_divided=(
        "-np.cross(omega, inertia * omega) / inertia",
        "-np.cross(omega, inertia * omega)",
        "omega x (I omega) is a torque; it must be divided by the moments to be an angular "
        "acceleration. Without it not even the energy is kept.",
    ),
    one_step_off=(
        "range(steps)",
        "range(steps - 1)",
        "It is right, and one step off: the result is that of a step fewer or more. The loop makes "
        "`steps` of them, and none where that is 0.",
    ),
    inertia_divided_twice=(
        "-np.cross(omega, inertia * omega) / inertia",
        "-np.cross(omega, inertia * omega) / inertia**2",
        "The torque omega x (I omega) is divided by the moments twice.",
    ),
    step_halved=(
        "q = q + dt / 6.0 *",
        "q = q + dt / 12.0 *",
        "omega = omega + dt / 6.0 *",
        "omega = omega + dt / 12.0 *",
        "Each step goes half as far as dt: the weights of the four stages, 1, 2, 2, 1, are divided "
        "by their sum, 6.",
    ),
    half_missing=(
        "q_rate = 0.5 * np.array(",
        "q_rate = np.array(",
        "The quaternion turns twice as fast as the body: its rate is half the product with omega.",
    ),
    rates_in_the_world=(
        "    return q, omega\n",
        "    w, u = q[0], q[1:]\n"
        "    return q, omega + 2.0 * np.cross(u, np.cross(u, omega) + w * omega)\n",
        "The rates that you return are turned into the world. The task asks for them in the body.",
    ),
    order_too_low=(
        "q = q + dt / 6.0 * (q1 + 2.0 * q2 + 2.0 * q3 + q4)",
        "q = q + dt * q2",
        "omega = omega + dt / 6.0 * (w1 + 2.0 * w2 + 2.0 * w3 + w4)",
        "omega = omega + dt * w2",
        "The equations are right: with smaller steps your result comes to the right one. The "
        "method is of too low an order for these steps; keep all four stages of RK4.",
    ),
    time_runs_backwards=(
        *_SIGN,
        "q_rate = 0.5 * np.array(",
        "q_rate = -0.5 * np.array(",
        "Instead of the gyroscopic term you turned the quaternion's rate round. Both together "
        "are the motion of another body: one seen in a mirror of time.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        1e-6,
        ACCURATE,
        names=("orientation", "rates"),
        nearest=either_sign,
        first=conserved,
        timed=five_steps,
        last=smaller_steps,
        then=("core", "smaller steps"),
    ),
    examples=(
        "tumble(np.array([1.0, 0, 0, 0]), np.array([0, 0, 2.0]), np.array([1.0, 2.0, 2.5]), 0.01, "
        "50)",
        "tumble(np.array([0.6, 0.8, 0, 0]), np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 2.5]), "
        "0.01, 50)",
    ),
    picture=lambda figure, s: picture.bodies(figure, s.args[0], s.got[0], s.expected[0]),
    chart=chart_of(
        "Attitude of a tumbling body after 4 s",
        tumbling,
        tolerance=1e-3,
        error_unit="rad",
        failed_above=4.0,
    ),
    slips=SLIPS + value_slips("tumble", swapped=True),
)
