"""The silent-bug hunt of chapter 2: right on level ground, wrong on a slope and at a landing."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from drills.attempt import Attempt
from drills.case_judge import WHOLE, Case, judge_of
from drills.exercise import Exercise, slips, value_slips
from drills.values import Mismatch, as_float64


def cases(rng: np.random.Generator) -> list[Case]:
    """Return level ground, where the bug hides; slopes on both sides of the angle; landings."""

    def mu() -> float:
        return float(rng.uniform(0.3, 0.8))

    def on(slope: float, mu: float, speed: float, steps: int, label: str, level: str) -> Case:
        place, dt = rng.uniform(-1.0, 1.0), float(rng.choice([0.002, 0.005, 0.01]))
        args = (np.array([place, 0.0]), np.array([speed, 0.0]), slope, mu, dt, steps)
        return Case(args, label, level)

    def landing(slope: float) -> Case:
        start, speed = np.array([0.0, rng.uniform(0.2, 1.0)]), rng.uniform(0.5, 4.0, 2)
        args = (start, speed * [1.0, -1.0], slope, mu(), 0.005, int(rng.integers(150, 250)))
        return Case(args, "a landing")

    m = mu()
    return [
        on(0.0, mu(), 2.0, 300, "sliding on level ground", "simple"),
        on(0.0, mu(), 0.0, 50, "at rest on level ground", "simple"),
        on(0.8 * math.atan(m), m, 0.0, 100, "at rest on a gentle slope", "core"),
        on(1.04 * math.atan(m), m, 0.0, 100, "just too steep to stay", "core"),
        on(1.5 * math.atan(m), m, 0.0, 100, "sliding down", "core"),
        on(1.3 * math.atan(m), m, -2.0, 150, "thrown uphill", "core"),
        on(0.7 * math.atan(m), m, 3.0, 200, "coming to rest on a slope", "core"),
        landing(0.0),
        landing(0.3),
        landing(-0.5),
        on(0.3, 0.0, 1.0, 100, "no friction", "edge"),
        on(0.2, 0.5, 1.0, 0, "no step", "edge"),
        on(0.2, 0.5, 1.0, 1, "one step", "edge"),
        on(math.pi / 2, 0.9, 0.0, 60, "a wall", "edge"),
        Case((np.array([0, 1]), np.array([2, -1]), 0, 1, 0.01, 60), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Any, ...]) -> float:
    """Return 1e-9, of values above 1 as much of them."""
    return 1e-9 * max(1.0, *(float(np.abs(value).max()) for value in truth))


def acceleration(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Check down a slope it goes with g (sin - mu cos): said before the values are compared."""
    if case.label not in ("just too steep to stay", "sliding down"):
        return
    _, _, slope, mu, dt, steps = case.args
    try:
        speed = as_float64(parts[1], (2,))[0]
    except Mismatch:
        return  # the comparison of the values says what is wrong with it
    expected = 9.81 * (math.sin(slope) - mu * math.cos(slope))
    result = float(speed) / (dt * steps)
    attempt.require(
        f"{case.label}: acceleration",
        abs(result - expected) <= 1e-6 * (1.0 + expected),
        sentence=f"Down a slope of {slope:.3g} rad with mu {mu:.3g} the block accelerates at "
        f"{result:.4g} m/s^2; g (sin - mu cos) is {expected:.4g}.",
        got=f"{result:.6g}",
        expected=f"{expected:.6g}",
        error=abs(result - expected),
        tolerance=1e-6,
        unit="m/s^2",
        why="the scheme is exact for a constant acceleration's speed",
        call=call,
    )


FRICTION = "min(max(-v[0], -mu * normal), mu * normal)"
_WEIGHT = "largest = mu * 9.81 * dt{} if normal > 0.0 else 0.0\n        friction = "
_BOUND = "min(max(-v[0], -largest), largest)"

SLIPS = slips(
    bug_still_there=(
        "friction = " + FRICTION,
        _WEIGHT.format("") + _BOUND,
        "The bug is still there: you limit friction to mu times the weight. On a slope the plane "
        "carries less, at a landing much more. Use the normal impulse of this step.",
    ),
    cosine_put_in=(
        "friction = " + FRICTION,
        _WEIGHT.format(" * math.cos(slope)") + _BOUND,
        "You use mu times the part of the weight that is perpendicular to the slope. That is right "
        "for a block that lies on the plane. At a landing the normal impulse is many times larger, "
        "and so is friction. Use the impulse itself.",
    ),
    always_full_friction=(
        FRICTION,
        "-math.copysign(mu * normal, v[0])",
        "Your friction is always mu times the normal impulse, which pushes a block at rest back "
        "and forth. Friction is what is needed to stop the block, and at most that.",
    ),
    sticks_always=(
        FRICTION,
        "-v[0] if normal > 0.0 else 0.0",
        "Your friction stops the block at once, without a limit, so nothing slides any more.",
    ),
    no_friction=(
        FRICTION,
        "0.0 * normal",
        "There is no friction at all. It is what stops the block, and at most mu times the normal "
        "impulse.",
    ),
    friction_in_the_air=(
        "-mu * normal), mu * normal)",
        "-mu * abs(v[1] + x[1] / dt)), mu * abs(v[1] + x[1] / dt))",
        "There is friction in the air: where the normal impulse is zero, friction must be zero "
        "too.",
    ),
    friction_before_gravity=(
        "v = v + dt * gravity",
        "old, v = v[0], v + dt * gravity",
        "max(-v[0], -mu",
        "max(-old, -mu",
        "You compute friction from the velocity before gravity has acted in this step. A block "
        "that should stick then creeps downhill at g sin(slope) dt.",
    ),
    no_place_in_the_normal=(
        "-(v[1] + x[1] / dt)",
        "-v[1] if x[1] <= 0.0 else 0.0",
        "Your normal impulse acts a step late, only after the block has already sunk in. In the "
        "task's scheme the block just touches at the end of the step.",
    ),
    bounces=(
        "np.array([friction, normal])",
        "np.array([friction, 2.0 * normal])",
        "You apply the normal impulse twice, so the block bounces. Apply the impulse that makes it "
        "just touch.",
    ),
    explicit_position=(
        "v = v + np.array([friction, normal])\n        x = x + dt * v",
        "x = x + dt * v\n        v = v + np.array([friction, normal])",
        "You move the block with the velocity from before the impulses, so it sinks in. Apply the "
        "impulses first, then move the block.",
    ),
    slope_reversed=(
        "[math.sin(slope), -math.cos(slope)]",
        "[-math.sin(slope), -math.cos(slope)]",
        "Your gravity pulls uphill. The first axis points down the slope.",
    ),
    one_step_off=(
        "range(steps)",
        "range(steps + 1)",
        "This is right, but the loop makes one step too many.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "a few hundred additions, whose rounding stays below 1e-12",
        first=acceleration,
    ),
    examples=(
        "contact_step([0.0, 0.0], [1.0, 0.0], 0.0, 0.5, 0.01, 10)",
        "contact_step([0.0, 0.0], [0.0, 0.0], 0.6, 0.5, 0.01, 100)",
        "contact_step([0.0, 0.5], [2.0, 0.0], 0.0, 0.5, 0.01, 60)",
    ),
    slips=SLIPS + value_slips("contact_step", swapped=True),
)
