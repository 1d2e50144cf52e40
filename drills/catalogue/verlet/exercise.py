"""Velocity Verlet: single steps by value, then order, reversal and evaluations."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt, Place
from drills.exercise import Exercise, Slip
from drills.judge import repeat_calls
from drills.reasons import Reason
from drills.values import describe_call
from drills.values import numbers as numbers_of

if TYPE_CHECKING:
    from course.measure.work_precision import WorkPrecision

Array = NDArray[np.float64]
GIVEN = Path(__file__).with_name("given.py").read_text(encoding="utf-8")
UNITS = {"positions": "m", "velocities": "m/s", "acceleration": "m/s^2"}
ROUNDING = "a step is a few sums: 1e-11 leaves room for another order of adding up, and no more"


def judge(attempt: Attempt) -> None:
    """Values of single steps, then what a run of many steps must show."""
    made: list[tuple[tuple[Any, ...], Any]] = []
    for kind, numbers, q, v, dt, label in _cases(attempt.rng):
        made.append(_single_step(attempt, kind, numbers, q, v, dt, label))
    # A property of numbers that are missing or not finite says nothing.
    if any(c.reason not in (Reason.RIGHT, Reason.WRONG_VALUE) for c in attempt.report.checks):
        return
    _order(attempt)
    _reversal(attempt)
    if not attempt.failed:
        repeat_calls(attempt, made)
    if not attempt.failed:
        _time(attempt)


def _cases(rng: np.random.Generator) -> list[tuple[str, list[float], Any, Any, float, str]]:
    cases: list[tuple[str, list[float], Any, Any, float, str]] = []
    for n in (1, 1, 2, 3, 6):
        numbers = [float(rng.uniform(0.5, 30.0)), float(rng.uniform(-0.5, 3.0))]
        dt = float(10.0 ** rng.uniform(-2.5, -0.8))
        cases.append(("spring", numbers, rng.normal(size=n), rng.normal(size=n), dt, "springs"))
    fall = [-9.81]
    cases.append(("constant", fall, rng.normal(size=3), rng.normal(size=3), 0.1, "constant pull"))
    cases.append(("spring", [9.0, 0.0], rng.normal(size=2), np.zeros(2), 0.05, "from rest"))
    cases.append(("spring", [9.0, 0.0], np.zeros(2), rng.normal(size=2), 0.05, "no force yet"))
    cases.append(
        ("spring", [20.0, 1.0], rng.normal(size=2), rng.normal(size=2), -0.04, "backwards")
    )
    cases.append(("spring", [20.0, 1.0], rng.normal(size=2), rng.normal(size=2), 0.0, "no time"))
    turn = rng.uniform(0.0, 2.0 * math.pi)
    place, across = (np.array([math.cos(b), math.sin(b)]) for b in (turn, turn + 0.5 * math.pi))
    cases.append(("planet", [1.0], place, across, 0.1, "orbit"))
    return [cases[i] for i in rng.permutation(len(cases))]


def _single_step(
    attempt: Attempt, kind: str, numbers: list[float], q: Any, v: Any, dt: float, label: str
) -> tuple[tuple[Any, ...], Any]:
    asked: list[Any] = []

    def acceleration(place: Any) -> Array:
        """Answered by the grader, which also counts: the child's own count could be forged."""
        asked.append(place)
        return _pull(attempt, kind, numbers, place, q.shape)

    args = q, v, _pull(attempt, kind, numbers, q, q.shape), acceleration, dt
    call = describe_call(attempt.card.entry, args)
    got = attempt.call(*args)
    calls = len(asked)
    parts = attempt.parts(got, tuple(UNITS), call=call)
    if parts is None:
        return args, got
    for part, right, (what, unit) in zip(
        parts, attempt.expected(*args), UNITS.items(), strict=True
    ):
        attempt.compare(
            f"{label}: {what}", part, right, tolerance=1e-11, unit=unit, why=ROUNDING, call=call
        )
    attempt.require(
        f"{label}: evaluations",
        calls == 1,
        sentence=f"The acceleration was asked for {calls} times in one step; once is enough.",
        got=str(calls),
        expected="1",
        call=call,
        slip="evaluated_twice" if calls == 2 else "",
    )
    return args, got


def _pull(
    attempt: Attempt, kind: str, numbers: list[float], place: Any, shape: tuple[int, ...]
) -> Array:
    """The acceleration at a place; a `ValueError` where that is no place of this system."""
    q = numbers_of(place, "the position")
    if q.shape != shape:
        raise ValueError(f"acceleration takes positions of shape {shape}, got {q.shape}")
    return np.asarray(attempt.reference.given("acceleration", kind, numbers, q))


def _run(
    attempt: Attempt, q: Array, v: Array, omega: float, dt: float, steps: int
) -> tuple[Array, Array] | None:
    """A run on a spring, or None after a failed check."""

    def acceleration(place: Any) -> Array:
        return _pull(attempt, "spring", [omega**2, 0.0], place, shape)

    a, shape = -(omega**2) * q, q.shape
    for _ in range(steps):
        parts = attempt.parts(attempt.call(q, v, a, acceleration, dt), tuple(UNITS))
        if parts is None:
            return None
        new = [attempt.numbers("a step of a run", part, q.shape) for part in parts]
        if new[0] is None or new[1] is None or new[2] is None:
            return None
        q, v, a = new[0], new[1], new[2]
    return q, v


def _order(attempt: Attempt) -> None:
    omega, time = float(attempt.rng.uniform(2.0, 3.0)), 1.5
    q, v = np.array([1.0]), np.array([0.3])
    truth = math.cos(omega * time) + 0.3 / omega * math.sin(omega * time)
    speed = 0.3 * math.cos(omega * time) - omega * math.sin(omega * time)
    errors = []
    for steps in (12, 24):
        end = _run(attempt, q, v, omega, time / steps, steps)
        if end is None:
            return
        errors.append(math.hypot(end[0][0] - truth, (end[1][0] - speed) / omega))
    # Without any error there is no order; a method as good as that is none of second order.
    order = math.log2(errors[0] / errors[1]) if min(errors) > 1e-12 else math.inf
    attempt.require(
        "order of accuracy",
        abs(order - 2.0) <= 0.1,
        sentence=f"With half the step the error is {errors[0] / max(errors[1], 1e-300):.2f} times "
        f"smaller, which is order {order:.2f}. Velocity Verlet has order 2: 4 times smaller.",
        got=f"{order:.2f}",
        expected="2",
        error=abs(order - 2.0),
        tolerance=0.1,
        unit="1",
        why="at these steps the next term of the error moves the slope by up to 0.03",
    )


def _reversal(attempt: Attempt) -> None:
    q, v = attempt.rng.normal(size=2), attempt.rng.normal(size=2)
    end = _run(attempt, q, v, 3.0, 0.1, 10)
    back = end and _run(attempt, *end, 3.0, -0.1, 10)
    if not back:
        return
    error = float(np.max(np.abs(np.concatenate([back[0] - q, back[1] - v]))))
    attempt.require(
        "runs back",
        error <= 1e-11,
        sentence=f"10 steps forward and 10 with -dt end {error:.2g} away from the start. A "
        "symmetric step undoes itself exactly, at any step size.",
        got=f"{error:.2g}",
        expected="0",
        error=error,
        tolerance=1e-11,
        unit="1",
        why="nothing but rounding is left of 20 steps",
    )


def _time(attempt: Attempt) -> None:
    q, v = np.array([1.0, 0.5]), np.zeros(2)
    theirs = attempt.learner.given_new("field", "spring", [4.0, 0.0])
    ours = attempt.reference.given_new("field", "spring", [4.0, 0.0])
    attempt.time_call(
        *(q, v, -4.0 * q, theirs, 0.01), here=(q, v, -4.0 * q, ours, 0.01), what="time per step"
    )


def chart(attempt: Attempt, worked: Place) -> WorkPrecision:
    """Error of a pendulum's angle after 2 s against evaluations and time."""
    from course.measure.work_precision import Method, Result, measure
    from course.oracles.mujoco import oscillator as mujoco_oscillator
    from course.rigid_body import problems, simulate

    problem = problems.pendulum()
    system, time = problem.system, problem.duration
    pull = float(system.params[0])
    steps = {time / n: n for n in (50, 100, 200, 400, 800, 1600)}

    def driven(child: Place) -> Callable[[float], Result]:
        def run(dt: float) -> Result:
            start = system.q0, system.v0, "pendulum", [pull]
            end, calls = child.given("drive", *start, dt, steps[dt])
            return Result(end, calls)

        return run

    def course(name: str) -> Method:
        def run(dt: float) -> Result:
            end = simulate(system, name, dt, steps[dt], every=steps[dt])
            # Verlet keeps its last evaluation and needs one before the first step.
            return Result(end.q[-1], steps[dt] + (name == "velocity_verlet"))

        return Method(f"compiled {name}", run, list(steps))

    def library(name: str) -> Method:
        runners = {
            dt: mujoco_oscillator.pendulum(
                1.0, float(system.q0[0]), 0.0, dt, name, gravity=problems.STANDARD_GRAVITY
            )
            for dt in steps
        }

        def run(dt: float) -> Result:
            return Result(runners[dt].run(steps[dt])[0], runners[dt].evaluations(steps[dt]))

        return Method(f"MuJoCo {name}", run, list(steps), style="oracle")

    return measure(
        [
            Method("yours", driven(attempt.learner.child), list(steps), style="yours"),
            Method("worked answer", driven(worked), list(steps)),
            course("velocity_verlet"),
            course("semi_implicit_euler"),
            library("Euler"),
            library("RK4"),
        ],
        problem.truth(time)[0],
        reference_check=problems.tight_reference(system, time)[0],
        tolerance=1e-3,
        failed_above=10.0,
        repeats=3,
        question="A pendulum's angle after 2 s",
        error_unit="rad",
    )


_V_HALF = "    v_half = v + 0.5 * dt * a\n"
_Q_NEW = "    q_new = q + dt * v_half\n"
_V_NEW = "    v_new = v_half + 0.5 * dt * a_new\n"

EXERCISE = Exercise(
    judge=judge,
    given=GIVEN,
    examples=(
        "verlet_step(np.array([1.0]), np.array([0.0]), np.array([-4.0]), lambda q: -4.0 * q, 0.1)",
        "verlet_step(np.array([0.0]), np.array([3.0]), np.array([-9.81]), lambda q: "
        "np.array([-9.81]), 0.2)",
    ),
    chart=chart,
    slips=(
        Slip(
            "semi_implicit_euler",
            "This is semi-implicit Euler: the velocity takes its whole step first. It costs the "
            "same and is of first order only, because its velocity belongs half a step away.",
            edits=((_V_HALF, "    v_half = v + dt * a\n"), (_V_NEW, "    v_new = v_half\n")),
        ),
        Slip(
            "semi_implicit_position_first",
            "This is semi-implicit Euler the other way round: the position takes its whole step "
            "first, then the velocity with the new acceleration. Still of first order: the "
            "velocity belongs half a step away, now on the other side.",
            edits=((_Q_NEW, "    q_new = q + dt * v\n"), (_V_NEW, "    v_new = v + dt * a_new\n")),
        ),
        Slip(
            "explicit_euler",
            "This is explicit Euler: the position moves with the old velocity and the velocity "
            "with the old acceleration. First order, and its energy grows at every step size.",
            edits=((_Q_NEW, "    q_new = q + dt * v\n"), (_V_NEW, "    v_new = v + dt * a\n")),
        ),
        Slip(
            "old_acceleration_twice",
            "Both halves of the velocity's step use the old acceleration. The second half belongs "
            "to the new position: use the acceleration that you have just computed there.",
            edits=((_V_NEW, "    v_new = v_half + 0.5 * dt * a\n"),),
        ),
        Slip(
            "half_missing_in_position",
            "The position gets dt^2 * a; it must be half of that. A body that falls from rest "
            "then falls twice as far in its first step.",
            edits=((_Q_NEW, "    q_new = q + dt * v + dt**2 * a\n"),),
        ),
        Slip(
            "half_missing_in_velocity",
            "The velocity gets dt times the sum of both accelerations; it must be their mean, "
            "so half of the sum.",
            edits=((_V_NEW, "    v_new = v + dt * (a + a_new)\n"),),
        ),
        Slip(
            "old_acceleration_returned",
            "Position and velocity are right, but the acceleration that you return is the old "
            "one. The next step begins with it, so it must be that of the new position.",
            edits=(("return q_new, v_new, a_new", "return q_new, v_new, a"),),
        ),
        Slip(
            "acceleration_at_old_position",
            "The new acceleration is evaluated at the old position. Move the position first, then "
            "ask for the acceleration there.",
            edits=(("acceleration(q_new)", "acceleration(q)"),),
        ),
        Slip(
            "evaluated_twice",
            "The values are right, at twice the price: the acceleration at the start of the "
            "step is what came in as `a`. In a real simulator that evaluation is the whole cost.",
            edits=((_V_HALF, "    v_half = v + 0.5 * dt * np.asarray(acceleration(q))\n"),),
        ),
    ),
)
