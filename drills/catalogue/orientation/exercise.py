"""Quaternion update: single steps up to the sign of q, then the length after many."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt, Place
from drills.exercise import Exercise, Slip
from drills.judge import Case, repeat_calls
from drills.reasons import Reason
from drills.values import Mismatch, as_float64, describe_call

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision

Array = NDArray[np.float64]

GIVEN = Path(__file__).with_name("given.py").read_text(encoding="utf-8")
STEPS = 30
TINY = "a turn of 1e-9 rad"


def judge(attempt: Attempt) -> None:
    """Single steps in random order, then many of them in a row."""
    cases = _cases(attempt.rng)
    shuffled = [cases[index] for index in attempt.rng.permutation(len(cases))]
    # The smallest turn comes last: what it means that it is lost depends on the others.
    shuffled.sort(key=lambda case: case.label == TINY)
    made = [(case.args, _single_step(attempt, case)) for case in shuffled]
    if any(c.reason not in (Reason.RIGHT, Reason.WRONG_VALUE) for c in attempt.report.checks):
        return
    _many_steps(attempt)
    if not attempt.failed:
        repeat_calls(attempt, made)
    if not attempt.failed:
        attempt.time_call(*cases[0].args, repeat=100)


def _direction(rng: np.random.Generator, size: int) -> Array:
    vector = rng.normal(size=size)
    return np.asarray(vector / np.linalg.norm(vector))


def _cases(rng: np.random.Generator) -> list[Case]:
    def start() -> Array:
        return _direction(rng, 4)

    def turn(angle: float, dt: float, label: str) -> Case:
        return Case((start(), angle / dt * _direction(rng, 3), dt), label)

    cases = [
        Case((start(), rng.normal(size=3) * 8.0, float(10.0 ** rng.uniform(-3.0, -0.5))))
        for _ in range(6)
    ]
    cases += [
        Case((np.array([1.0, 0.0, 0.0, 0.0]), rng.normal(size=3), 0.2), "from the identity"),
        Case((start(), np.zeros(3), 0.1), "at rest"),
        Case((start(), rng.normal(size=3), 0.0), "no time"),
        Case((start(), rng.normal(size=3), -0.3), "backwards"),
        turn(1e-9, 1e-3, TINY),
        turn(1e-5, 1e-3, "a turn of 1e-5 rad"),
        turn(math.pi, 0.5, "half a turn"),
        turn(2.0 * math.pi, 1.0, "a full turn"),
        turn(float(rng.uniform(500.0, 900.0)), 0.05, "a hundred turns"),
        Case((start(), 1e-200 * _direction(rng, 3), 1e-3), "a rate of 1e-200 rad/s"),
    ]
    for axis in np.eye(3):
        cases.append(Case((start(), float(rng.uniform(1.0, 6.0)) * axis, 0.25), "about one axis"))
    return cases


def _same_sign(got: Any, expected: Array) -> Array:
    """The expected quaternion or its negative, whichever is nearer to what came back."""
    try:
        return expected if as_float64(got, (4,)) @ expected >= 0.0 else -expected
    except Mismatch:
        return expected


def _is(got: Any, q: Array) -> bool:
    """Whether q came back as it was, or its negative."""
    try:
        return bool(np.max(np.abs(as_float64(got, (4,)) - _same_sign(got, q))) < 1e-14)
    except Mismatch:
        return False


def _single_step(attempt: Attempt, case: Case) -> Any:
    q, omega, dt = case.args
    got = attempt.call(q, omega, dt)
    call = describe_call(attempt.card.entry, case.args)
    angle = abs(dt) * float(np.linalg.norm(omega))
    if (
        angle < 1e-100
        and isinstance(got, np.ndarray)
        and got.dtype.kind == "f"
        and np.all(np.isnan(got))
    ):
        attempt.require(
            case.label,
            False,
            sentence="Nothing turns here, and the answer is NaN.",
            got="NaN",
            expected="q",
            call=call,
            slip="zero_over_zero",
            reason=Reason.NOT_FINITE,
        )
        return got
    lost = case.label == TINY and not attempt.failed
    attempt.compare(
        case.label,
        got,
        _same_sign(got, np.asarray(attempt.expected(q, omega, dt))),
        slip="small_turns_dropped" if lost and _is(got, q) else "",
        # A large angle is itself known to its rounding only.
        tolerance=1e-13 * (1.0 + angle),
        unit="1",
        why="the exponential is exact; what is left is rounding, which grows with the angle",
        call=call,
    )
    return got


def _many_steps(attempt: Attempt) -> None:
    q, omega = _direction(attempt.rng, 4), 5.0 * _direction(attempt.rng, 3)
    end = q
    for _ in range(STEPS):
        new = attempt.numbers("a step of many", attempt.call(end, omega, 0.02), (4,))
        if new is None:
            return
        end = new
    length = math.hypot(*end)
    attempt.require(
        "unit length",
        abs(length - 1.0) <= 1e-12,
        sentence=f"After {STEPS} steps the quaternion has length {length:.9g}.",
        got=f"{length:.9g}",
        expected="1",
        error=abs(length - 1.0),
        tolerance=1e-12,
        unit="1",
        why=f"{STEPS} products of unit quaternions leave rounding only",
    )
    attempt.compare(
        f"{STEPS} steps are one long one",
        end,
        _same_sign(end, np.asarray(attempt.expected(q, omega, STEPS * 0.02))),
        tolerance=1e-11,
        unit="1",
        why="at a constant rate the number of steps does not matter",
    )


def chart(attempt: Attempt, worked: Place) -> WorkPrecision:
    """Attitude of a tumbling body after 5 s; every update is told the rate half way."""
    from course.measure.work_precision import Method, Result, measure
    from course.oracles.mujoco import free as mujoco_free
    from course.rigid_body import problems, quaternion

    time = 5.0
    problem = problems.tumble(duration=time)
    start = problem.system.q0
    steps = {time / n: n for n in (25, 50, 100, 200, 400)}
    # MuJoCo is asked the whole question: it has to find the rates as well.
    runners = {
        dt: mujoco_free.free_body(problem.system.params, start, problem.system.v0, dt, "Euler")
        for dt in steps
    }
    rates = {
        dt: np.array([problem.truth((i + 0.5) * dt)[1] for i in range(n)])
        for dt, n in steps.items()
    }

    def driven(child: Place) -> Callable[[float], Result]:
        return lambda dt: Result(child.given("drive", start, rates[dt], dt), steps[dt])

    def added(dt: float) -> Result:
        q = start
        for rate in rates[dt]:
            q = quaternion.normalise(q + dt * quaternion.derivative(q, rate))
        return Result(q, steps[dt])

    def library(dt: float) -> Result:
        return Result(runners[dt].run(steps[dt])[0], steps[dt])

    def angle(answer: Array, truth: Array) -> float:
        length = np.linalg.norm(answer)
        if not np.isfinite(length) or length == 0.0:
            return math.inf
        return float(quaternion.angle_between(answer / length, truth))

    unit, all_steps = "updates", list(steps)
    return measure(
        [
            Method("yours", driven(attempt.learner.child), all_steps, style="yours", unit=unit),
            Method("worked answer", driven(worked), all_steps, unit=unit),
            Method("rate added, rescaled", added, all_steps, unit=unit),
            Method("MuJoCo Euler", library, all_steps, style="oracle", unit=unit),
        ],
        problem.truth(time)[0],
        angle,
        reference_check=problems.tight_reference(problem.system, time)[0],
        tolerance=1e-2,
        failed_above=4.0,
        repeats=3,
        question="Attitude of a tumbling body after 5 s",
        error_unit="rad",
    )


_RETURN = "    return turned / np.linalg.norm(turned)\n"

_ADDED = """import numpy as np


def update_orientation(q, omega, dt):
    w, x, y, z = np.asarray(q, dtype=float)
    i, j, k = np.asarray(omega, dtype=float)
    rate = [-x * i - y * j - z * k, w * i + y * k - z * j, w * j + z * i - x * k]
    new = q + 0.5 * dt * np.array([*rate, w * k + x * j - y * i])
    return {result}
"""

EXERCISE = Exercise(
    judge=judge,
    given=GIVEN,
    examples=(
        "update_orientation(np.array([1.0, 0, 0, 0]), np.array([0, 0, np.pi]), 0.5)",
        "update_orientation(np.array([0.5, 0.5, 0.5, 0.5]), np.array([1.0, 0, 0]), 0.1)",
        "update_orientation(np.array([1.0, 0, 0, 0]), np.array([0.0, 0, 0]), 0.1)",
    ),
    chart=chart,
    slips=(
        Slip(
            "multiplied_on_the_left",
            "The turn is multiplied on the left of q, which is right for a rate in the world "
            "frame. This rate is the body's: q times turn. From the identity one does not see it.",
            edits=(
                ("w * i + x * c + y * k - z * j", "w * i + x * c - y * k + z * j"),
                ("w * j - x * k + y * c + z * i", "w * j + x * k + y * c - z * i"),
                ("w * k + x * j - y * i + z * c", "w * k - x * j + y * i + z * c"),
            ),
        ),
        Slip(
            "scalar_last",
            "Your quaternions have the scalar last, (x, y, z, w). Here it comes first. Libraries "
            "differ on this (MuJoCo: first; ROS and SciPy: last), so it is worth a test.",
            edits=(
                ("    w, x, y, z = np.asarray", "    x, y, z, w = np.asarray"),
                (_RETURN, "    return np.roll(turned, -1) / np.linalg.norm(turned)\n"),
            ),
        ),
        Slip(
            "half_angle_missing",
            "The body turns twice as far as it should: a quaternion holds cosine and sine of "
            "*half* the angle.",
            edits=(("half_turn = 0.5 * dt", "half_turn = dt"),),
        ),
        Slip(
            "added",
            "The rate of the quaternion is added. That is right to first order only, and q gets "
            "longer at every step: its length is multiplied by sqrt(1 + (|omega| dt / 2)^2).",
            source=_ADDED.format(result="new"),
        ),
        Slip(
            "added_and_rescaled",
            "The rate is added and the result scaled back to length one. That repairs the length, "
            "not the angle, which is atan(|omega| dt / 2) where it should be |omega| dt / 2.",
            source=_ADDED.format(result="new / np.linalg.norm(new)"),
        ),
        Slip(
            "turned_backwards",
            "The body turns the wrong way: the sign of the rate (or the conjugate of the turn) is "
            "that of the world seen from the body.",
            edits=(("half_turn = 0.5 * dt", "half_turn = -0.5 * dt"),),
        ),
        Slip(
            "small_turns_dropped",
            "Small angles are treated as no turn at all. At a gyroscope's rate of 10 kHz the "
            "Earth's rotation is 7e-9 rad a step, and it adds up to a full turn a day.",
            edits=(
                (
                    "    c = np.cos(half_angle)\n",
                    "    if half_angle < 1e-6:\n        return np.array(q, dtype=float)\n"
                    "    c = np.cos(half_angle)\n",
                ),
            ),
        ),
        Slip(
            "zero_over_zero",
            "A body that does not turn has no axis: dividing by its angle gives 0 / 0. Divide "
            "nothing: sin(x) / x is np.sinc(x / pi), which is 1 at zero.",
            edits=(("np.sinc(half_angle / np.pi)", "np.sin(half_angle) / half_angle"),),
        ),
    ),
)
