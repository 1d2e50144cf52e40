"""Chapter 1, speed against accuracy: every integrator on every problem, beside MuJoCo."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from course.charts import chart
from course.check import one_of
from course.measure import figure
from course.measure.figure import Panel
from course.measure.work_precision import Method, Result, WorkPrecision, machine, measure
from course.oracles.mujoco import box as mujoco_box
from course.oracles.mujoco import free as mujoco_free
from course.oracles.mujoco import kit as mujoco_kit
from course.oracles.mujoco import oscillator as mujoco_oscillator
from course.rigid_body import planar, problems
from course.rigid_body.integrators import (
    INTEGRATORS,
    STANDARD_GRAVITY,
    Array,
    evaluations_per_step,
    simulate,
)
from course.rigid_body.problems import Problem


@dataclass(frozen=True)
class Question:
    """What a problem's chart asks, and of whom.

    Attributes:
        text: the question.
        tolerance: the error it can bear, in the problem's unit.
        why: where that tolerance comes from.
        ask_mujoco: (dt, integrator) -> prepared run of the same problem.
        positions: from MuJoCo's positions to ours.
    """

    text: str
    tolerance: float
    why: str
    ask_mujoco: Callable[[float, str], mujoco_kit.Runner]
    positions: Callable[[Array], Array] = lambda q: q


def _top_question(problem: Problem) -> Question:
    system = problem.system
    i1, _, i3, weight = system.params.tolist()
    return Question(
        "Where does the top point after 2 s?",
        1e-2,
        "10 mrad, 5 mm at the tip of a 0.5 m top",
        lambda dt, name: mujoco_free.heavy_top((i1, i3), weight, system.q0, system.v0, dt, name),
    )


def questions() -> dict[str, tuple[Problem, Question]]:
    """Return the smooth problems of the chapter and what is asked of each."""
    result = problems.all_problems()
    spring, pendulum = result["oscillator"].system, result["pendulum"].system
    free, double = result["tumble"].system, result["double_pendulum"].system
    omega, zeta = spring.params.tolist()
    rows = {
        "oscillator": Question(
            "Where is the mass after 2.3 periods?",
            1e-3,
            "1 mm of an amplitude of 1 m",
            lambda dt, name: mujoco_oscillator.oscillator(
                1.0, omega**2, 2.0 * zeta * omega, 1.0, 0.0, dt, name
            ),
        ),
        "pendulum": Question(
            "Where is the pendulum after 2 s?",
            1e-3,
            "1 mrad: 1 mm on an arm of 1 m",
            lambda dt, name: mujoco_oscillator.pendulum(
                1.0, float(pendulum.q0[0]), 0.0, dt, name, gravity=STANDARD_GRAVITY
            ),
        ),
        "tumble": Question(
            "How is the free body turned after 20 s?",
            1e-3,
            "1 mrad: what a star tracker of a small satellite resolves, with a margin",
            lambda dt, name: mujoco_free.free_body(
                free.params,
                np.concatenate([np.zeros(3), free.q0]),
                np.concatenate([np.zeros(3), free.v0]),
                dt,
                name,
            ),
            lambda q: q[3:],
        ),
        "heavy_top": _top_question(result["heavy_top"]),
        "double_pendulum": Question(
            "Where is the double pendulum after 3 s?",
            1e-3,
            "1 mrad: 1 mm on an arm of 1 m",
            lambda dt, name: mujoco_oscillator.double_pendulum(
                (1.0, 1.0),
                (1.0, 1.0),
                (double.q0[0], double.q0[1] - double.q0[0]),
                (0.0, 0.0),
                dt,
                name,
                gravity=STANDARD_GRAVITY,
            ),
            lambda q: np.array([q[0], q[0] + q[1]]),
        ),
    }
    return {name: (result[name], question) for name, question in rows.items()}


def _problem_and_question(name: str) -> tuple[Problem, Question]:
    result = questions()
    return result[one_of("name", name, result)]


# Steps of a run: coarse to fine, a factor of about two apart.
_STEPS = {
    "oscillator": (20, 40, 80, 160, 320, 640, 1280, 2560),
    "pendulum": (20, 40, 80, 160, 320, 640, 1280, 2560),
    "tumble": (250, 500, 1000, 2000, 4000, 8000, 16000, 32000),
    "heavy_top": (250, 500, 1000, 2000, 4000, 8000, 16000, 32000),
    "double_pendulum": (50, 100, 200, 400, 800, 1600, 3200, 6400),
}
MUJOCO_SHOWN = ("Euler", "RK4", "implicitfast", "discrete")
FIRST = {"semi_implicit_euler", "velocity_verlet", "rk4", "MuJoCo Euler", "MuJoCo RK4"}


def _ours(problem: Problem, name: str, steps: tuple[int, ...]) -> Method:
    # Evaluations are counted beforehand, so that counting does not slow the timed run.
    per_step = {n: evaluations_per_step(problem.system, name, problem.duration / n) for n in steps}

    def run(dt: float) -> Result:
        n = round(problem.duration / dt)
        end = simulate(problem.system, name, problem.duration / n, n)
        return Result(end.q[-1], per_step[n] * n)

    return Method(name, run, [problem.duration / n for n in steps])


def _mujocos(problem: Problem, question: Question, name: str, steps: tuple[int, ...]) -> Method:
    # The model is compiled once; only its step size changes between runs.
    runner = question.ask_mujoco(problem.duration / steps[0], name)

    def run(dt: float) -> Result:
        n = round(problem.duration / dt)
        runner.dt = problem.duration / n
        q, _ = runner.run(n)
        return Result(question.positions(q), runner.evaluations(n))

    return Method(f"MuJoCo {name}", run, [problem.duration / n for n in steps], "oracle")


def work_precision(
    name: str,
    repeats: int = 5,
    steps: tuple[int, ...] | None = None,
    names: tuple[str, ...] | None = None,
    best: bool = False,
) -> WorkPrecision:
    """Return the error against cost of every integrator, ours and MuJoCo's, on one problem.

    Args:
        name: "oscillator", "pendulum", "tumble", "heavy_top" or "double_pendulum".
        repeats: timed rounds.
        steps: numbers of steps to try; default: a range that fits the problem.
        names: of the methods; default: all.
        best: draw the least time of each, not the median (see `measure`).

    Returns:
        The measured curves; `with_method` puts a step function of yours beside them (see
        `your_method`).
    """
    problem, question = _problem_and_question(name)
    counts = _STEPS[name] if steps is None else steps
    rotation = problem.system.q0.shape != problem.system.v0.shape
    # Off the quaternion the renormalised method is plain RK4: one curve, not two.
    methods = [
        _ours(problem, method, counts)
        for method in INTEGRATORS
        if rotation or method != "rk4_renormalised"
    ]
    methods += [_mujocos(problem, question, method, counts) for method in MUJOCO_SHOWN]
    first = FIRST | {"rk4_renormalised" if rotation else "implicit_midpoint"}
    methods = [
        replace(method, extra=names is None and method.name not in first)
        for method in methods
        if names is None or method.name in names
    ]
    truth, _ = problem.truth(problem.duration)
    # A reference by another route; `measure` compares it with the truth before it trusts either.
    check, _ = problems.tight_reference(
        problem.system, problem.duration, 1e-13 if problem.closed_form else 5e-14
    )
    return measure(
        methods,
        truth,
        lambda answer, _: problem.error(answer),
        reference_check=check,
        tolerance=question.tolerance,
        failed_above=1.0,
        repeats=repeats,
        best=best,
        question=question.text,
        error_unit=problem.unit,
        duration=problem.duration,
    )


def your_method(name: str, step: Callable[..., Any], label: str = "yours") -> Method:
    """Return a step function of your own, ready for `WorkPrecision.with_method`.

    Args:
        name: the problem, as for `work_precision`.
        step: (q, v, acceleration, dt, params) -> (q, v).
        label: name on the chart.
    """
    problem, _ = _problem_and_question(name)
    steps = _STEPS[name][:5]
    # Counted with one step size: an explicit step has the same number at any.
    per_step = evaluations_per_step(problem.system, step, problem.duration / steps[0])

    def run(dt: float) -> Result:
        n = round(problem.duration / dt)
        end = simulate(problem.system, step, problem.duration / n, n)
        return Result(end.q[-1], per_step * n)

    return Method(label, run, [problem.duration / n for n in steps], "yours")


# --- the box -----------------------------------------------------------------------------------

BOX_START = np.array([0.0, 1.0, 0.4, 0.5, 0.0, 1.0])
BOX_SIZE = (0.3, 0.2)
BOX_RESTITUTION = 0.7
BOX_DURATION = 1.0  # two impacts
_BOX_STEPS = (10, 20, 40, 80, 160, 320, 640, 1280, 2560, 5120)


def box_work_precision(repeats: int = 5, counts: tuple[int, ...] = _BOX_STEPS) -> WorkPrecision:
    """Return the error of the bouncing box's position after 1 s against cost, beside MuJoCo.

    Args:
        repeats: timed rounds.
        counts: numbers of steps to try.

    Frictionless, so that the truth is independent of every contact solver here.
    """
    reference = problems.frictionless_box(BOX_DURATION, BOX_START, *BOX_SIZE, BOX_RESTITUTION)
    parameters = planar.box_parameters(
        1.0, *BOX_SIZE, restitution=BOX_RESTITUTION, friction=0.0, rest_speed=0.0
    )
    # The second route to the truth: our own simulation with exact flight at 1 ms.
    fine, _ = planar.advance_boxes(BOX_START[:, None], parameters, 1e-3, 1000, integrator="rk4")

    def ours(label: str, integrator: str, resolve: bool) -> Method:
        def run(dt: float) -> Result:
            n = round(BOX_DURATION / dt)
            end, _ = planar.advance_boxes(
                BOX_START[:, None],
                parameters,
                BOX_DURATION / n,
                n,
                integrator=integrator,
                resolve_impacts=resolve,
            )
            return Result(end[:2, 0], n)

        return Method(label, run, [BOX_DURATION / n for n in counts], unit="steps")

    def mujocos(name: str, contact: str, extra: bool = True) -> Method:
        # One prepared model for each number of steps, as the contact depends on the step.
        runners = {
            n: mujoco_box.box_drop(
                (0.5 * BOX_SIZE[0], 0.5 * BOX_SIZE[1]),
                1.0,
                BOX_START[:3],
                BOX_START[3:],
                BOX_DURATION / n,
                name,
                restitution=BOX_RESTITUTION,
                friction=0.0,
                gravity=STANDARD_GRAVITY,
                contact=contact,
            )
            for n in counts
        }

        def run(dt: float) -> Result:
            n = round(BOX_DURATION / dt)
            q, _ = runners[n].run(n)
            return Result(q[:2], n)

        steps = [BOX_DURATION / n for n in counts]
        return Method(f"MuJoCo {name} ({contact})", run, steps, "oracle", "steps", extra=extra)

    result = measure(
        [
            ours("exact flight, impact times", "rk4", True),
            ours("semi-implicit, impact times", "semi_implicit_euler", True),
            ours("exact flight, end of step", "rk4", False),
            ours("semi-implicit, end of step", "semi_implicit_euler", False),
            mujocos("Euler", "impulse", extra=False),
            mujocos("Euler", "spring"),
            mujocos("implicitfast", "impulse"),
            mujocos("discrete", "spring"),
            mujocos("RK4", "spring", extra=False),
        ],
        reference[:2],
        reference_check=fine[:2, 0],
        tolerance=5e-3,
        failed_above=1.0,
        repeats=repeats,
        # Our runs of some 10 us take turns with MuJoCo's of milliseconds.
        warm_up=1e-3,
        question="Where is the bouncing box after 1 s?",
        error_unit="m",
        duration=BOX_DURATION,
    )
    # Our runs take about as long as a call from Python, so their times say little about a step.
    return replace(result, counts_only=True)


def draw(result: WorkPrecision) -> Any:
    """Draw the two panels of a work-precision result as a figure."""
    return figure.draw(result.panels())


for _problem in _STEPS:
    chart(
        lambda problem=_problem, **sizes: iter(work_precision(problem, **sizes).panels()),
        name=f"work_precision_{_problem}",
        height=4.2,
    )
chart(
    lambda **sizes: iter(box_work_precision(**sizes).panels()),
    name="work_precision_box",
    height=4.2,
)


# --- the same millisecond for all ---------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """One line of the table at one step: who, on what, how wrong, how fast."""

    problem: str
    method: str
    error: float
    unit: str
    nanoseconds: float


def table_at(
    dt: float = 1e-3,
    repeats: int = 15,
    problems: tuple[str, ...] = ("tumble", "heavy_top", "oscillator"),
) -> list[Row]:
    """Return the error and time per step of MuJoCo's integrators and ours at one step.

    Args:
        dt: step [s].
        repeats: timed rounds, interleaved.
        problems: the smooth ones; the box drop follows.
    """
    outcome = questions()
    requested = [
        (name, outcome[name][0].unit, work_precision(name, repeats, (steps,)), steps)
        for name in problems
        for steps in [round(outcome[name][0].duration / dt)]
    ]
    # One step size for all, so that a row shows error and time of the same step.
    steps = round(BOX_DURATION / dt)
    requested.append(("box drop", "m", box_work_precision(repeats, (steps,)), steps))
    return [
        Row(name, curve.name, point.error, unit, point.time / steps * 1e9)
        for name, unit, result, steps in requested
        for curve in result.curves
        for point in curve.points
    ]


@chart
def table_at_one_millisecond(**sizes: Any) -> Iterator[Panel]:
    """Tabulate error and time per step of every method and problem at a step of 1 ms."""
    panel = Panel("Everybody at the same step")
    panel.notes = [f"{'problem':<11} {'method':<30} {'error':>9}      {'time per step':>13}"]
    for row in table_at(**sizes):
        head = f"{row.problem:<11} {row.method:<30}"
        panel.notes.append(
            f"{head} {row.error:>9.1e} {row.unit:<4} {row.nanoseconds:>10.0f} ns"
            if np.isfinite(row.error)
            else f"{head} failed: off by more than 1 {row.unit}"
        )
    panel.notes.append(machine())
    yield panel
