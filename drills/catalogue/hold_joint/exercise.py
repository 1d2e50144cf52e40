"""The silent-bug hunt of chapter 6: a load that is held, and how it is held."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown
from drills.values import Mismatch, as_float64

PUSHED = "a load comes on"


def cases(rng: np.random.Generator) -> list[Case]:
    """Return links that stay, where the bug hides; loads and steps of the target, slow and fast."""

    def held(
        label: str,
        level: str = "core",
        *,
        pole: float = 0.0,
        load: float = 0.0,
        far: float = 0.0,
        time: float = 0.0,
    ) -> Case:
        """Return for a time in units of 1 / pole, drawn where they are 0."""
        q, pole = float(rng.uniform(-1.2, 1.2)), pole or float(rng.uniform(2.0, 8.0))
        dt = float(rng.choice([0.001, 0.002, 0.005]))
        steps = round((time or rng.uniform(1.0, 6.0)) / (pole * dt))
        return Case((q, q + far, pole, load, dt, steps), label, level)

    def load() -> float:
        return float(rng.uniform(1.0, 5.0) * rng.choice([-1.0, 1.0]))

    return [
        held("it stays where it is", "simple"),
        held("it stays, fast poles", "simple", pole=12.0),
        held(PUSHED, pole=4.0, load=3.0, time=2.0),
        held(PUSHED, load=load(), time=2.0),
        *(held("later under a load", load=load()) for _ in range(3)),
        held("another target", far=0.5),
        held("another target", far=-0.8),
        held("another target, with a load", far=0.4, load=load()),
        held("slow poles", pole=1.0, load=load()),
        held("fast poles", pole=12.0, load=load(), far=0.2),
        held("a large load", "edge", load=200.0),
        Case((0.3, 0.5, 4.0, 1.0, 0.01, 0), "no step", "edge"),
        Case((0.3, 0.5, 4.0, 1.0, 0.01, 1), "one step", "edge"),
        Case((0.3, 0.5, 4.0, 1.0, 0.01, 2), "two steps", "edge"),
        Case((1, 0, 2, 3, 0.01, 90), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Any, ...]) -> float:
    """Return 1e-9, of values above 1 as much of them."""
    return 1e-9 * max(1.0, *(abs(float(value)) for value in truth))


def pushed(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check how far a load has pushed the link when it should be farthest.

    It reports before the values are compared.
    """
    if case.label != PUSHED:
        return
    q, _, pole, load, _, _ = case.args
    try:
        result = float(as_float64(parts[0], ())) - q
    except Mismatch:
        return  # the comparison of the values says what is wrong with it
    expected = load / 0.5 * 2.0 * math.exp(-2.0) / pole**2
    attempt.require(
        f"{PUSHED}: how far",
        abs(result - expected) <= 0.05 * abs(expected),
        sentence=f"At t = 2 / pole = {2.0 / pole:.3g} s the load has moved the link by "
        f"{result:.4g} rad. With three poles at -pole it is load / inertia t^2 / 2 e^(-2) "
        f"= {expected:.4g} rad.",
        got=f"{result:.6g}",
        expected=f"{expected:.6g}",
        error=abs(result - expected),
        tolerance=0.05 * abs(expected),
        unit="rad",
        why="the formula is that of a continuous loop; sampling moves it by less than 0.05 of it",
        call=call,
    )


def ends(figure: Any, shown: Shown) -> None:
    """Plot where the link is and where it goes, between the start and its target."""
    axes = picture.plane(figure, "angle [rad]", "rate [rad/s]")
    axes.plot([shown.args[0]], [0.0], "s", color="0.7", label="start")
    axes.axvline(shown.args[1], color="0.7", lw=1.0)
    for (q, v, _), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot([shown.args[0], q], [0.0, v], marker="o", markevery=[1], **style)
    axes.legend()


_TOTAL = "total = total + dt * error"
_TORQUE = "torque = inertia * (kp * error + ki * total - kd * v) + weight * math.cos(q)"

SLIPS = slips(
    bug_still_there=(
        _TORQUE,
        _TORQUE.replace("ki * total", "ki * (total - dt * error + error)"),
        "The bug is still there: the error of this instant is added to the integral as if it had "
        "lasted a second. ki then adds to kp, and the poles are not where they were put.",
    ),
    error_added_on_top=(
        _TORQUE,
        _TORQUE.replace("ki * total", "ki * (total + error)"),
        "The integral is right, and the error of this instant is still added to it without dt.",
    ),
    summed_without_dt=(
        _TOTAL,
        "total = total + error",
        "The errors are summed without dt. That is not an integral: its gain depends on how often "
        "one samples, and here it is a thousand times ki.",
    ),
    dt_twice=(
        _TORQUE,
        _TORQUE.replace("ki * total", "ki * (total + dt * error)"),
        "The error of this sample counts twice: it is in the integral already.",
    ),
    one_sample_late=(
        _TORQUE,
        _TORQUE.replace("ki * total", "ki * (total - dt * error)"),
        "The dt is right, and the integral acts a sample late: the error of this sample counts in "
        "the torque.",
    ),
    integral_left_out=(
        _TORQUE,
        _TORQUE.replace(" + ki * total", ""),
        "The integral is computed and not used: a load then leaves an error for ever.",
    ),
    sign_of_the_integral=(
        _TORQUE,
        _TORQUE.replace("+ ki * total", "- ki * total"),
        "The integral acts the wrong way round: the error grows under a load.",
    ),
    integral_outside_the_inertia=(
        _TORQUE,
        "torque = inertia * (kp * error - kd * v) + ki * total + weight * math.cos(q)",
        "The integral stands outside the inertia. ki is the gain of an acceleration, as kp and kd "
        "are: the poles come out right only where the inertia is one.",
    ),
    gains_outside_the_inertia=(
        _TORQUE,
        _TORQUE.replace("inertia * (", "(", 1),
        "The gains act as torques. They ask for an acceleration, which the inertia turns into a "
        "torque.",
    ),
    proportional_gain_reduced=(
        "kp, ki, kd = 3.0 * pole**2, pole**3, 3.0 * pole",
        "kp, ki, kd = 3.0 * pole**2 - pole**3, pole**3, 3.0 * pole",
        "kp is reduced by ki. This compensates the bug instead of removing it. Once the "
        "integral is correct, kp is too small.",
    ),
    trapezoid=(
        _TOTAL,
        "last = error if _ == 0 else last\n"
        "        total, last = total + 0.5 * dt * (error + last) * (1 if _ else 2), error",
        "This integral is accurate, but it is not the task's scheme: a rectangle sum, dt "
        "times the error of this sample.",
    ),
    gravity_of_the_target=(
        _TORQUE,
        _TORQUE.replace("math.cos(q)", "math.cos(target)"),
        "Gravity is cancelled for the target angle. It acts at the actual angle.",
    ),
    load_known=(
        _TORQUE,
        f"{_TORQUE} - load",
        "The load is subtracted from the torque. The controller does not know it; the "
        "integral is there to compensate it.",
    ),
    explicit_euler=(
        "v = v + dt * (torque + load - weight * math.cos(q)) / inertia\n        q = q + dt * v",
        "q, v = q + dt * v, v + dt * (torque + load - weight * math.cos(q)) / inertia",
        "The step has become explicit Euler. In the task's scheme the new rate moves the angle.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "some thousand steps of additions: their rounding is below 1e-11",
        first=pushed,
    ),
    examples=(
        "hold_joint(0.3, 0.3, 4.0, 0.0, 0.01, 100)",
        "hold_joint(0.3, 0.3, 4.0, 3.0, 0.001, 500)",
        "hold_joint(0.0, 0.5, 4.0, 0.0, 0.001, 1000)",
    ),
    picture=ends,
    slips=SLIPS + value_slips("hold_joint"),
)
