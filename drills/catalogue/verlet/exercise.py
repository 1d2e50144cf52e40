"""Velocity Verlet: single steps by value, then order, reversal and evaluations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.cards import definitions
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of
from drills.chart import chart_of
from drills.chart_plan import Plan
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.inprocess import InProcess
from drills.values import numbers as numbers_of

Array = NDArray[np.float64]
GIVEN = Path(__file__).with_name("given.py").read_text(encoding="utf-8")
FIELDS = InProcess("", GIVEN)
NAMES = ("positions", "velocities", "acceleration")


class Field:
    """Accelerations that the grader answers, and counts: the child's own count could be forged."""

    __name__ = "acceleration"

    def __init__(self, kind: str, numbers: Sequence[float], shape: tuple[int, ...]) -> None:
        self.kind, self.numbers, self.shape, self.calls = kind, list(numbers), shape, 0

    def __deepcopy__(self, memo: Any) -> Field:
        """Return a field of its own for the worked answer, whose calls do not count."""
        return Field(self.kind, self.numbers, self.shape)

    def code(self) -> str:
        """Return the acceleration as a function that a learner can run."""
        call = f"forces({self.kind!r}, {self.numbers!r}, q)"
        source = definitions(Path(__file__).with_name("given.py"), ["acceleration"])
        source = source.replace("def acceleration(", "def forces(")
        return f"{source}\n\ndef acceleration(q):\n    return {call}\n"

    def __call__(self, place: Any) -> Array:
        """Return the acceleration at a position and count the call, after checking its shape."""
        self.calls += 1
        q = numbers_of(place, "the position")
        if q.shape != self.shape:
            raise ValueError(f"acceleration takes positions of shape {self.shape}, got {q.shape}")
        return np.asarray(FIELDS.given("acceleration", self.kind, self.numbers, q))


def cases(rng: np.random.Generator) -> list[Case]:
    """Return springs of one to six coordinates, and steps in which one mistake shows alone."""

    def step(
        label: str,
        kind: str,
        numbers: Sequence[float],
        dt: float,
        q: Any,
        v: Any,
        *,
        level: str = "core",
    ) -> Case:
        field = Field(kind, numbers, q.shape)
        return Case((q, v, Field(kind, numbers, q.shape)(q), field, dt), label, level)

    drawn = []
    for n in (1, 1, 2, 3, 6):
        numbers = float(rng.uniform(0.5, 30.0)), float(rng.uniform(-0.5, 3.0))
        dt = float(10.0 ** rng.uniform(-2.5, -0.8))
        drawn.append(step("springs", "spring", numbers, dt, *rng.normal(size=(2, n))))
    soft, stiff = (9.0, 0.0), (20.0, 1.0)
    drawn += [
        step("constant pull", "constant", (-9.81,), 0.1, *rng.normal(size=(2, 3)), level="simple"),
        step("from rest", "spring", soft, 0.05, rng.normal(size=2), np.zeros(2), level="simple"),
        step("no force yet", "spring", soft, 0.05, np.zeros(2), rng.normal(size=2), level="simple"),
        step("backwards", "spring", stiff, -0.04, *rng.normal(size=(2, 2)), level="edge"),
        step("no time", "spring", stiff, 0.0, *rng.normal(size=(2, 2)), level="edge"),
        step(WHOLE, "spring", soft, 0.5, np.array([1, -2]), np.array([0, 3]), level="edge"),
    ]
    turn = rng.uniform(0.0, 2.0 * math.pi)
    place, across = (np.array([math.cos(b), math.sin(b)]) for b in (turn, turn + 0.5 * math.pi))
    return [*drawn, step("orbit", "planet", (1.0,), 0.1, place, across)]


def explain(answers: Sequence[Answer]) -> str:
    """Return right values at twice the price."""
    requested = {a.case.args[3].calls for a in answers}
    right = all(all(a.right) for a in answers)
    return "evaluated_twice" if requested == {2} and right else coarse(answers)


def whole_runs(attempt: Attempt, answers: Sequence[Answer]) -> None:
    """Check how often the acceleration was asked for, then what a run of many steps must show."""
    for a in answers:
        calls = a.case.args[3].calls
        attempt.require(
            f"{a.case.label}: evaluations",
            calls == 1,
            sentence=f"The acceleration was asked for {calls} times in one step; once is enough.",
            got=str(calls),
            expected="1",
            call=a.call,
        )
    _order(attempt)
    _reversal(attempt)


def _run(
    attempt: Attempt, q: Array, v: Array, omega: float, dt: float, steps: int
) -> tuple[Array, Array] | None:
    """Run the submission on a spring and return the run, or None after a failed check."""
    field = Field("spring", (omega**2, 0.0), q.shape)
    a = field(q)
    for _ in range(steps):
        parts = attempt.parts(attempt.call(q, v, a, field, dt), NAMES)
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


def one_step(attempt: Attempt, cases: Sequence[Case]) -> None:
    """Time one step, with a field on either side of the pipe."""
    start = np.array([1.0, 0.5]), np.zeros(2), np.array([-4.0, -2.0])
    fields = (
        place.given_new("field", "spring", [4.0, 0.0])
        for place in (attempt.learner, attempt.reference)
    )
    theirs, ours = ((*start, field, 0.01) for field in fields)
    attempt.time_call(*theirs, here=ours, what="time per step")


def pendulum(attempt: Attempt) -> Plan:
    """Return the error of a pendulum's angle after 2 s against evaluations and time."""
    from course.oracles.mujoco import oscillator
    from course.rigid_body import problems, simulate

    problem = problems.pendulum()
    system, time = problem.system, problem.duration
    steps = {time / n: n for n in (50, 100, 200, 400, 800, 1600)}
    start = system.q0, system.v0, "pendulum", [float(system.params[0])]

    def compiled(name: str) -> Any:
        # Verlet keeps its last evaluation and needs one before the first step.
        more = name == "velocity_verlet"
        return lambda dt: (
            simulate(system, name, dt, steps[dt], every=steps[dt]).q[-1],
            steps[dt] + more,
        )

    def library(name: str) -> Any:
        length, angle = 1.0, float(system.q0[0])
        runners = {
            dt: oscillator.pendulum(length, angle, 0.0, dt, name, gravity=problems.STANDARD_GRAVITY)
            for dt in steps
        }
        return lambda dt: (runners[dt].run(steps[dt])[0], runners[dt].evaluations(steps[dt]))

    return Plan(
        settings=list(steps),
        ask=lambda place, dt: place.given("drive", *start, dt, steps[dt]),
        truth=problem.truth(time)[0],
        check=problems.tight_reference(system, time)[0],
        ours={f"compiled {n}": compiled(n) for n in ("velocity_verlet", "semi_implicit_euler")},
        libraries={f"MuJoCo {name}": library(name) for name in ("Euler", "RK4")},
    )


_V_HALF = "    v_half = v + 0.5 * dt * a\n"
_Q_NEW = "    q_new = q + dt * v_half\n"
_A_NEW = "    a_new = np.asarray(acceleration(q_new), dtype=float)\n"
_V_NEW = "    v_new = v_half + 0.5 * dt * a_new\n"

SLIPS = slips(
    semi_implicit_euler=(
        _V_HALF,
        "    v_half = v + dt * a\n",
        _V_NEW,
        "    v_new = v_half\n",
        "This is semi-implicit Euler: the velocity takes its whole step first. It costs the same "
        "and is of first order only, because its velocity belongs half a step away.",
    ),
    semi_implicit_position_first=(
        _Q_NEW,
        "    q_new = q + dt * v\n",
        _V_NEW,
        "    v_new = v + dt * a_new\n",
        "This is semi-implicit Euler the other way round: the position takes its whole step "
        "first, then the velocity with the new acceleration. Still of first order: the velocity "
        "belongs half a step away, now on the other side.",
    ),
    explicit_euler=(
        _Q_NEW,
        "    q_new = q + dt * v\n",
        _V_NEW,
        "    v_new = v + dt * a\n",
        "This is explicit Euler: the position moves with the old velocity and the velocity with "
        "the old acceleration. First order, and its energy grows at every step size.",
    ),
    old_acceleration_twice=(
        _V_NEW,
        "    v_new = v_half + 0.5 * dt * a\n",
        "Both halves of the velocity's step use the old acceleration. The second half belongs to "
        "the new position: use the acceleration that you have just computed there.",
    ),
    new_acceleration_twice=(
        _V_NEW,
        "    v_new = v + dt * a_new\n",
        "The velocity's whole step uses the new acceleration. Over the step it changes by dt times "
        "the mean of both, of the old position's and of the new one's.",
    ),
    half_step_velocity=(
        _V_NEW,
        "    v_new = v_half\n",
        "The velocity that you return is that of half way. The other half of the step is missing: "
        "add dt/2 times the acceleration at the new position.",
    ),
    dt_not_squared=(
        _Q_NEW,
        "    q_new = q + dt * v + 0.5 * dt * a\n",
        "The acceleration moves the position by dt/2 times a, in m/s: the time must stand there "
        "twice, 0.5 * dt**2 * a.",
    ),
    velocity_halved=(
        _Q_NEW,
        "    q_new = q + 0.5 * dt * v_half\n",
        "The position moves for half of the step only: it takes the whole dt with the velocity "
        "that holds half way.",
    ),
    half_missing_in_position=(
        _Q_NEW,
        "    q_new = q + dt * v + dt**2 * a\n",
        "The position gets dt^2 * a; it must be half of that. A body that falls from rest then "
        "falls twice as far in its first step.",
    ),
    half_missing_in_velocity=(
        _V_NEW,
        "    v_new = v + dt * (a + a_new)\n",
        "The velocity gets dt times the sum of both accelerations; it must be their mean, so "
        "half of the sum.",
    ),
    old_acceleration_returned=(
        "return q_new, v_new, a_new",
        "return q_new, v_new, a",
        "Position and velocity are right, but the acceleration that you return is the old one. "
        "The next step begins with it, so it must be that of the new position.",
    ),
    acceleration_at_old_position=(
        "acceleration(q_new)",
        "acceleration(q)",
        "The new acceleration is evaluated at the old position. Move the position first, then "
        "ask for the acceleration there.",
    ),
    position_verlet=(
        _V_HALF,
        "    q_half = q + 0.5 * dt * v\n",
        _Q_NEW,
        "",
        _A_NEW,
        "    a_new = np.asarray(acceleration(q_half), dtype=float)\n",
        _V_NEW,
        "    v_new = v + dt * a_new\n    q_new = q_half + 0.5 * dt * v_new\n",
        "This is position Verlet (drift, kick, drift): of second order too, but another method. "
        "Its acceleration is that of half way, which the next step can't begin with. The task "
        "asks for kick, drift, kick.",
    ),
    evaluated_twice=(
        _V_HALF,
        "    v_half = v + 0.5 * dt * np.asarray(acceleration(q))\n",
        "The values are right, at twice the price: the acceleration at the start of the step is "
        "what came in as `a`. In a real simulator that evaluation is the whole cost.",
    ),
    sign_of_the_acceleration=(
        "v_half = v + 0.5 * dt * a",
        "v_half = v - 0.5 * dt * a",
        "The acceleration at the old position is subtracted. Both halves of the kick are added.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        1e-11,
        "a step is a few sums: 1e-11 leaves room for another order of adding up, and no more",
        names=NAMES,
        explain=explain,
        last=whole_runs,
        then=("core", "evaluations, order, reversal"),
        timed=one_step,
    ),
    given=GIVEN,
    examples=(
        "verlet_step(np.array([1.0]), np.array([0.0]), np.array([-4.0]), lambda q: -4.0 * q, 0.1)",
        "verlet_step(np.array([0.0]), np.array([3.0]), np.array([-9.81]), lambda q: "
        "np.array([-9.81]), 0.2)",
    ),
    chart=chart_of(
        "A pendulum's angle after 2 s",
        pendulum,
        tolerance=1e-3,
        error_unit="rad",
        failed_above=10.0,
    ),
    slips=SLIPS
    + coarse_slips("verlet_step", "After a thousand steps they are in the picture.")
    + value_slips("verlet_step", swapped=True),
)
