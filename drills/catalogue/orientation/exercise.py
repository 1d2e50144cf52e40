"""Quaternion update: single steps up to the sign of q, then the length after many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Answer, Case, coarse, either_sign, judge_of, largest_error
from drills.chart import angle_between, chart_of
from drills.chart_plan import Plan
from drills.exercise import Exercise, coarse_slips, slips, value_slips

Array = NDArray[np.float64]

STEPS = 30
TINY = "a turn of 1e-9 rad"


def _direction(rng: np.random.Generator, size: int) -> Array:
    vector = rng.normal(size=size)
    return np.asarray(vector / np.linalg.norm(vector))


def cases(rng: np.random.Generator) -> list[Case]:
    """Return turns of every size, about every axis."""

    def start() -> Array:
        return _direction(rng, 4)

    def turn(angle: float, dt: float, label: str, level: str = "core") -> Case:
        return Case((start(), angle / dt * _direction(rng, 3), dt), label, level)

    return [
        Case((start(), rng.normal(size=3) * 8.0, float(10.0 ** rng.uniform(-3.0, -0.5))))
        for _ in range(6)
    ] + [
        Case(
            (np.array([1.0, 0.0, 0.0, 0.0]), rng.normal(size=3), 0.2), "from the identity", "simple"
        ),
        Case((start(), np.zeros(3), 0.1), "at rest", "edge"),
        Case((start(), rng.normal(size=3), 0.0), "no time", "edge"),
        Case((start(), rng.normal(size=3), -0.3), "backwards"),
        turn(1e-9, 1e-3, TINY, "edge"),
        turn(1e-5, 1e-3, "a turn of 1e-5 rad", "edge"),
        turn(math.pi, 0.5, "half a turn", "edge"),
        turn(2.0 * math.pi, 1.0, "a full turn", "edge"),
        turn(float(rng.uniform(500.0, 900.0)), 0.05, "a hundred turns", "edge"),
        Case((start(), 1e-200 * _direction(rng, 3), 1e-3), "a rate of 1e-200 rad/s", "edge"),
        Case((np.array([1, 0, 0, 0]), np.array([1, -2, 3]), 1), WHOLE, "edge"),
        *(
            Case((start(), float(rng.uniform(1.0, 6.0)) * axis, 0.25), "about one axis", "simple")
            for axis in np.eye(3)
        ),
    ]


def _angle(case: Case) -> float:
    return abs(case.args[2]) * float(np.linalg.norm(case.args[1]))


def explain(answers: Sequence[Answer]) -> str:
    """Return NaN where nothing turns; a turn that is lost where all larger ones are right."""
    for a in answers:
        if _angle(a.case) < 1e-100 and isinstance(a.got, np.ndarray) and a.got.dtype.kind == "f":
            if a.got.size and np.isnan(a.got).all():
                return "zero_over_zero"
    wrong = [a for a in answers if not all(a.right)]
    if wrong and all(_angle(a.case) < 0.01 for a in wrong):
        selected = [largest_error(a.got, either_sign(a.got, a.case.args[0])) < 1e-14 for a in wrong]
        return "small_turns_dropped" if all(selected) else coarse(answers)
    return coarse(answers)


def many_steps(attempt: Attempt, answers: Sequence[Answer]) -> None:
    """Check the length after many steps, and that they are one long one."""
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
        either_sign(end, np.asarray(attempt.expected(q, omega, STEPS * 0.02))),
        tolerance=1e-11,
        unit="1",
        why="at a constant rate the number of steps does not matter",
    )


def tumbling(attempt: Attempt) -> Plan:
    """Return attitude of a tumbling body after 5 s; every update is told the rate half way."""
    from course.oracles.mujoco import free
    from course.rigid_body import problems, quaternion

    time = 5.0
    problem = problems.tumble(duration=time)
    start = problem.system.q0
    steps = {time / n: n for n in (25, 50, 100, 200, 400)}
    # MuJoCo is asked the whole question: it has to find the rates as well.
    runners = {
        dt: free.free_body(problem.system.params, start, problem.system.v0, dt, "Euler")
        for dt in steps
    }
    rates = {
        dt: np.array([problem.truth((i + 0.5) * dt)[1] for i in range(n)])
        for dt, n in steps.items()
    }

    def added(dt: float) -> tuple[Array, float]:
        q = start
        for rate in rates[dt]:
            q = quaternion.normalise(q + dt * quaternion.derivative(q, rate))
        return q, steps[dt]

    return Plan(
        settings=list(steps),
        ask=lambda place, dt: (place.given("drive", start, rates[dt], dt), steps[dt]),
        truth=problem.truth(time)[0],
        check=problems.tight_reference(problem.system, time)[0],
        ours={"rate added, rescaled": added},
        libraries={"MuJoCo Euler": lambda dt: (runners[dt].run(steps[dt])[0], steps[dt])},
        error=angle_between,
    )


_RETURN = "    return turned / np.linalg.norm(turned)\n"

_EULER = """import math

import numpy as np


def update_orientation(q, omega, dt):
    w, x, y, z = q
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)) + omega[0] * dt
    pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x)))) + omega[1] * dt
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)) + omega[2] * dt
    halves = np.array([roll, pitch, yaw]) / 2
    (a, b, c), (r, s, t) = np.cos(halves), np.sin(halves)
    turned = [a * b * c + r * s * t, r * b * c - a * s * t, a * s * c + r * b * t]
    return np.array([*turned, a * b * t - r * s * c])
"""
_ADDED = """import numpy as np


def update_orientation(q, omega, dt):
    w, x, y, z = np.asarray(q, dtype=float)
    i, j, k = np.asarray(omega, dtype=float)
    rate = [-x * i - y * j - z * k, w * i + y * k - z * j, w * j + z * i - x * k]
    new = q + 0.5 * dt * np.array([*rate, w * k + x * j - y * i])
    return {result}
"""

SLIPS = slips(
    multiplied_on_the_left=(
        "w * i + x * c + y * k - z * j",
        "w * i + x * c - y * k + z * j",
        "w * j - x * k + y * c + z * i",
        "w * j + x * k + y * c - z * i",
        "w * k + x * j - y * i + z * c",
        "w * k - x * j + y * i + z * c",
        "The turn is multiplied on the left of q, which is right for a rate in the world frame; "
        "or the cross product in your product has its sign turned, which comes to the same. This "
        "rate is the body's: q times turn. From the identity one does not see it.",
    ),
    scalar_last=(
        "    w, x, y, z = np.asarray",
        "    x, y, z, w = np.asarray",
        _RETURN,
        "    return np.roll(turned, -1) / np.linalg.norm(turned)\n",
        "Your quaternions have the scalar last, (x, y, z, w). Here it comes first. Libraries "
        "differ on this (MuJoCo: first; ROS and SciPy: last), so it is worth a test.",
    ),
    half_angle_missing=(
        "half_turn = 0.5 * dt",
        "half_turn = dt",
        "The body turns twice as far as it should: a quaternion holds cosine and sine of *half* "
        "the angle.",
    ),
    added=(
        _ADDED.format(result="new"),
        "The rate of the quaternion is added. That is right to first order only, and q gets "
        "longer at every step: its length is multiplied by sqrt(1 + (|omega| dt / 2)^2).",
    ),
    added_and_rescaled=(
        _ADDED.format(result="new / np.linalg.norm(new)"),
        "The rate is added and the result scaled back to length one. That repairs the length, "
        "not the angle, which is atan(|omega| dt / 2) where it should be |omega| dt / 2.",
    ),
    euler_angles_added=(
        _EULER,
        "Roll, pitch and yaw are changed by omega dt each. Angular velocity is not the rate of "
        "those angles: that holds about one axis only. Multiply q by the quaternion of the turn.",
    ),
    absolute_step=(
        "half_turn = 0.5 * dt",
        "half_turn = 0.5 * abs(dt)",
        "A negative dt turns the body forwards: somewhere its sign is lost, as in a norm or in "
        "abs(). Backwards in time the body turns the other way.",
    ),
    degrees_for_radians=(
        "half_turn = 0.5 * dt",
        "half_turn = np.pi / 360.0 * dt",
        "The rate is treated as degrees a second. It comes in rad/s: convert nothing.",
    ),
    dt_missing=(
        "half_turn = 0.5 * dt *",
        "half_turn = 0.5 *",
        "The turn does not depend on dt: the angle is the rate times the time.",
    ),
    conjugate_of_the_start=(
        "w, x, y, z = np.asarray(q, dtype=float)",
        "w, x, y, z = np.asarray(q, dtype=float) * [1.0, -1.0, -1.0, -1.0]",
        "The start is turned round: its conjugate takes the world into the body. Here q turns body "
        "coordinates into world ones, and is used as it comes.",
    ),
    turned_backwards=(
        "half_turn = 0.5 * dt",
        "half_turn = -0.5 * dt",
        "The body turns the wrong way: the sign of the rate (or the conjugate of the turn) is "
        "that of the world seen from the body.",
    ),
    small_turns_dropped=(
        "    c = np.cos(half_angle)\n",
        "    if half_angle < 1e-6:\n        return np.array(q, dtype=float)\n"
        "    c = np.cos(half_angle)\n",
        "Small angles are treated as no turn at all. At a gyroscope's rate of 10 kHz the Earth's "
        "rotation is 7e-9 rad a step, and it adds up to a full turn a day.",
    ),
    zero_over_zero=(
        "np.sinc(half_angle / np.pi)",
        "np.sin(half_angle) / half_angle",
        "A body that does not turn has no axis: dividing by its angle gives 0 / 0. Divide "
        "nothing: sin(x) / x is np.sinc(x / pi), which is 1 at zero.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        # A large angle is itself known to its rounding only.
        lambda case, truth: 1e-13 * (1.0 + _angle(case)),
        "the exponential is exact; what is left is rounding, which grows with the angle",
        nearest=either_sign,
        explain=explain,
        last=many_steps,
    ),
    given=Path(__file__).with_name("given.py").read_text(encoding="utf-8"),
    examples=(
        "update_orientation(np.array([1.0, 0, 0, 0]), np.array([0, 0, np.pi]), 0.5)",
        "update_orientation(np.array([0.5, 0.5, 0.5, 0.5]), np.array([1.0, 0, 0]), 0.1)",
        "update_orientation(np.array([1.0, 0, 0, 0]), np.array([0.0, 0, 0]), 0.1)",
    ),
    picture=lambda figure, s: picture.bodies(figure, s.args[0], s.got[0], s.expected[0]),
    chart=chart_of(
        "Attitude of a tumbling body after 5 s",
        tumbling,
        unit="updates",
        tolerance=1e-2,
        error_unit="rad",
        failed_above=4.0,
    ),
    slips=SLIPS
    + coarse_slips("update_orientation", "A step of 1e-9 rad then does nothing.")
    + value_slips("update_orientation"),
)
