"""The silent-bug hunt of chapter 1: judged by what a free body keeps, then by value."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt, Place
from drills.exercise import Exercise, Slip
from drills.judge import Case, repeat_calls
from drills.values import Mismatch, as_float64, describe_call

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision

Array = NDArray[np.float64]
ACCURATE = "RK4 errs by less than 1e-7 in these runs; the bug changes the first digits"


def judge(attempt: Attempt) -> None:
    """Every case by its conserved quantities first: they say what is wrong, values only that."""
    cases = _cases(attempt.rng)
    made: list[tuple[tuple[Any, ...], Any]] = []
    for index in attempt.rng.permutation(len(cases)):
        case = cases[index]
        call = describe_call(attempt.card.entry, case.args)
        got = attempt.call(*case.args)
        made.append((case.args, got))
        parts = attempt.parts(got, ("q", "omega"), call=call)
        if parts is None:
            continue
        try:
            q, omega = as_float64(parts[0], (4,)), as_float64(parts[1], (3,))
        except Mismatch:
            pass  # `compare` below says what is wrong with it
        else:
            with np.errstate(all="ignore"):  # what came back may be as large as it likes
                _conserved(attempt, case, call, q, omega)
        right = attempt.expected(*case.args)
        with np.errstate(all="ignore"):
            opposite = _opposite(parts[0], right[0])
        sign = -1.0 if opposite else 1.0
        check: dict[str, Any] = {"tolerance": 1e-6, "why": ACCURATE, "call": call}
        attempt.compare(f"{case.label}: orientation", parts[0], sign * right[0], unit="1", **check)
        attempt.compare(f"{case.label}: rates", parts[1], right[1], unit="rad/s", **check)
    if not attempt.failed:
        repeat_calls(attempt, made)
    if not attempt.failed:
        attempt.time_call(*cases[0].args[:4], 5, repeat=20, what="time per 5 steps")


def _opposite(got: Any, right: Array) -> bool:
    """Whether -q came back, which is the same orientation."""
    try:
        return bool(as_float64(got, (4,)) @ right < 0.0)
    except Mismatch:
        return False


def _cases(rng: np.random.Generator) -> list[Case]:
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
        Case((start(), rates(3.0), moments(), 0.01, 60), "three moments"),
        Case((start(), rates(4.0), moments(), 0.008, 60), "three moments"),
        Case(
            (start(), np.array([0.01, 3.0, -0.02]), np.array([1.0, 2.0, 2.8]), 0.02, 60),
            "about the middle axis",
        ),
        Case((start(), rates(3.0), np.array([1.0, 1.0, 1.6]), 0.01, 50), "a symmetric body"),
        Case((start(), 3.0 * np.eye(3)[axis], moments(), 0.01, 20), "about a principal axis"),
        Case((start(), rates(3.0), np.full(3, 0.7), 0.01, 20), "three equal moments"),
        Case((start(), np.zeros(3), moments(), 0.01, 3), "at rest"),
        Case((start(), rates(2.0), moments(), 0.01, 0), "no step"),
        Case((start(), rates(2.0), moments(), 0.02, 1), "one step"),
    ]


def _to_world(q: Array, vector: Array) -> Array:
    w, u = q[0], q[1:]
    return np.asarray(vector + 2.0 * np.cross(u, np.cross(u, vector) + w * vector))


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
        sentence=f"The kinetic energy changes by {energy:.2g} of itself; nothing pushes.",
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
        "it is constant, as a vector.",
        got=f"{drift:.2g}",
        expected="0",
        error=drift,
        tolerance=1e-6,
        unit="1",
        why=ACCURATE,
        call=call,
    )


def chart(attempt: Attempt, worked: Place) -> WorkPrecision:
    """Attitude of the chapter's tumbling body after 4 s."""
    from course.measure.work_precision import Method, Result, measure
    from course.oracles.mujoco import free as mujoco_free
    from course.rigid_body import problems, quaternion, simulate

    time = 4.0
    problem = problems.tumble(duration=time)
    system = problem.system
    steps = {time / n: n for n in (25, 50, 100, 200, 400)}
    runners = {
        dt: mujoco_free.free_body(system.params, system.q0, system.v0, dt, "RK4") for dt in steps
    }

    def driven(child: Place) -> Callable[[float], Result]:
        def run(dt: float) -> Result:
            start = system.q0, system.v0, system.params
            q, _ = child.call(attempt.card.entry, *start, dt, steps[dt])
            return Result(np.asarray(q, dtype=float), 4 * steps[dt])

        return run

    def course(name: str) -> Method:
        def run(dt: float) -> Result:
            end = simulate(system, name, dt, steps[dt], every=steps[dt])
            return Result(end.q[-1], 4 * steps[dt])

        return Method(f"compiled {name}", run, list(steps))

    def library(dt: float) -> Result:
        return Result(runners[dt].run(steps[dt])[0], runners[dt].evaluations(steps[dt]))

    def angle(answer: Array, truth: Array) -> float:
        length = np.linalg.norm(answer)
        if not np.isfinite(length) or length == 0.0:
            return math.inf
        return float(quaternion.angle_between(answer / length, truth))

    return measure(
        [
            Method("yours", driven(attempt.learner.child), list(steps), style="yours"),
            Method("worked answer", driven(worked), list(steps)),
            course("rk4"),
            Method("MuJoCo RK4", library, list(steps), style="oracle"),
        ],
        problem.truth(time)[0],
        angle,
        reference_check=problems.tight_reference(system, time)[0],
        tolerance=1e-3,
        failed_above=4.0,
        repeats=3,
        question="Attitude of a tumbling body after 4 s",
        error_unit="rad",
    )


_SIGN = ("-np.cross(omega, inertia * omega)", "np.cross(omega, inertia * omega)")
_LEFT = (
    ("w * i + y * k - z * j", "w * i - y * k + z * j"),
    ("w * j + z * i - x * k", "w * j - z * i + x * k"),
    ("w * k + x * j - y * i", "w * k - x * j + y * i"),
)

EXERCISE = Exercise(
    judge=judge,
    examples=(
        "tumble(np.array([1.0, 0, 0, 0]), np.array([0, 0, 2.0]), np.array([1.0, 2.0, 2.5]), 0.01, "
        "50)",
        "tumble(np.array([0.6, 0.8, 0, 0]), np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 2.5]), "
        "0.01, 50)",
    ),
    chart=chart,
    slips=(
        Slip(
            "bug_still_there",
            "The bug is still there: the gyroscopic term has the wrong sign. Energy and |L| cannot "
            "see it, because omega x (I omega) is at right angles to omega and to I omega.",
            edits=(_SIGN,),
        ),
        Slip(
            "wrong_suspect",
            "You changed the side of the quaternion's product, which was right, and the bug is "
            "still there. Spin about a principal axis from a tilted start: that was right before, "
            "and there only the quaternion works.",
            edits=(_SIGN, *_LEFT),
        ),
        Slip(
            "one_bug_for_another",
            "The sign of the gyroscopic term is right now, but the quaternion's product is on the "
            "wrong side: the rate is the body's, so it stands to the right of q.",
            edits=_LEFT,
        ),
        Slip(
            "gyroscopic_term_removed",
            "The gyroscopic term is gone. Then omega stays constant in the body, which only "
            "a spin about a principal axis does: the energy is kept and L is not.",
            edits=(
                (
                    "omega_rate = -np.cross(omega, inertia * omega) / inertia",
                    "omega_rate = np.zeros(3)",
                ),
            ),
        ),
        Slip(
            "inertia_not_divided",
            "omega x (I omega) is a torque; it must be divided by the moments to be an angular "
            "acceleration. Without it not even the energy is kept.",
            edits=(
                (
                    "-np.cross(omega, inertia * omega) / inertia",
                    "-np.cross(omega, inertia * omega)",
                ),
            ),
        ),
        Slip(
            "time_runs_backwards",
            "Instead of the gyroscopic term you turned the quaternion's rate round. Both together "
            "are the motion of another body: one seen in a mirror of time.",
            edits=(_SIGN, ("q_rate = 0.5 * np.array(", "q_rate = -0.5 * np.array(")),
        ),
    ),
)
