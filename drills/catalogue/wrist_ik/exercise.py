"""The silent-bug hunt of chapter 4: that the hand arrives, then which way it went."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Answer, Case, judge_of, largest_error
from drills.exercise import Exercise, slips, value_slips
from drills.grade_report import Shown
from drills.values import Mismatch, as_float64

Array = NDArray[np.float64]
STEPS, DAMPING = 60, 0.05


def _hand(q: Array) -> Array:
    """Return quaternion (w, x, y, z) of the hand: turns about z, then y, then x."""
    (a, b, c), (r, s, t) = np.cos(0.5 * np.asarray(q)), np.sin(0.5 * np.asarray(q))
    return np.array(
        [a * b * c + r * s * t, a * b * t - r * s * c, a * s * c + r * b * t, r * b * c - a * s * t]
    )


def cases(rng: np.random.Generator) -> list[Case]:
    """Return targets a short way off, given with either sign, and wrists that are wound up."""

    def task(wound: float, sign: int, label: str, level: str = "core", far: float = 0.9) -> Case:
        goal = np.array([rng.uniform(-1.5, 1.5), *rng.uniform(-0.7, 0.7, 2)])
        start = goal + rng.uniform(0.4, far, 3) * rng.choice([-1.0, 1.0], 3)
        goal[0], start[0] = goal[0] + wound, start[0] + wound
        # The hand at the goal, as the joints give it: its scalar part may be negative.
        return Case((start, sign * _hand(goal), DAMPING, STEPS), label, level)

    near = task(0.0, 1, "").args
    across = np.array([math.pi - 0.3, 0.2, 0.1]), np.array([math.pi + 0.3, -0.2, 0.3])
    observed = _hand(across[1]) * np.sign(_hand(across[1])[0])
    return [
        task(0.0, 1, "a short turn", "simple"),
        task(0.0, -1, "the target's quaternion is negative", "core"),
        task(2.0 * math.pi, 1, "wound up by a turn"),
        task(2.0 * math.pi, -1, "wound up by a turn, the target is not"),
        task(-2.0 * math.pi, -1, "unwound by a turn, the target is not"),
        Case((across[0], observed, DAMPING, STEPS), "across half a turn"),
        Case((across[1], _hand(across[0]), DAMPING, STEPS), "back across half a turn"),
        Case((near[0], _hand(near[0]), DAMPING, STEPS), "there already", "edge"),
        Case((near[0], -_hand(near[0]), DAMPING, STEPS), "there already, negative", "edge"),
        Case((near[0], near[1], DAMPING, 0), "no step", "edge"),
        # A damping of 1 slows every step down: 60 steps leave 7e-5 rad, 120 leave 4e-9.
        Case((np.array([4, 0, -1]), np.array([0, 0, 0, 1]), 1, 2 * STEPS), WHOLE, "edge"),
    ]


def arrived(attempt: Attempt, case: Case, parts: tuple[Any, ...], call: str) -> None:
    """Run the check that the program's author made."""
    try:
        q = as_float64(parts[0], (3,))
    except Mismatch:
        return  # the comparison of the values says what is wrong with it
    target, steps = np.asarray(case.args[1], dtype=float), case.args[3]
    if not steps or case.label == WHOLE:
        return
    with np.errstate(all="ignore"):  # what came back may be as large as it likes
        hand = _hand(q)
        away = 2.0 * min(float(np.linalg.norm(hand - s * target)) for s in (1.0, -1.0))
    attempt.require(
        f"{case.label}: the hand",
        bool(away <= 1e-6),
        sentence=f"The hand is {math.degrees(away):.3g} degrees away from its target at the end.",
        got=f"{away:.3g}",
        expected="0",
        error=away,
        tolerance=1e-6,
        unit="rad",
        why="sixty steps of three tenths leave 1e-9 of the way",
        call=call,
    )


def explain(answers: Sequence[Answer]) -> str:
    """Return angles that are right but for full turns, in an answer that is wrong there alone."""
    wrong = [a for a in answers if not all(a.right)]
    wrapped = [
        largest_error(a.parts[0], (a.truth[0] + math.pi) % (2.0 * math.pi) - math.pi) for a in wrong
    ]
    return "wrapped_at_the_end" if wrong and max(wrapped) < 1e-6 else ""


def angles(figure: Any, shown: Shown) -> None:
    """Plot the joint angles at the start and at the end."""
    axes = picture.plane(figure, "joint", "angle [rad]")
    number = np.arange(3)
    axes.plot(number, shown.args[0], "s:", color="0.7", label="start")
    axes.plot(number, shown.got[0], "o-", **picture.YOURS)
    axes.plot(number, shown.expected[0], marker="o", **picture.RIGHT)
    axes.set_xticks(number, ["z", "y", "x"])
    axes.legend()


def five_steps(attempt: Attempt, drawn: Sequence[Case]) -> None:
    """Time a few steps."""
    attempt.time_call(*drawn[0].args[:3], 5, what="time per 5 steps")


_ERROR = "error = 2.0 * math.copysign(1.0, left[0]) * left[1:]"
_LEFT = "left = product(target, hand * [1.0, -1.0, -1.0, -1.0])"
_VECTOR = (
    "size = np.linalg.norm(left[1:])\n"
    "        angle = 2.0 * math.atan2(size, {w})\n"
    "        error = angle * left[1:] / size if size else np.zeros(3)"
)

SLIPS = slips(
    bug_still_there=(
        _ERROR,
        "error = 2.0 * left[1:]",
        "The bug is still there. Where the scalar part of what is left is negative, the vector "
        "part points the long way round: the hand moves away from the target, a full turn, and "
        "arrives from the other side.",
    ),
    long_way_exact=(
        _ERROR,
        _VECTOR.format(w="left[0]"),
        "The exact logarithm does not mend it: 2 atan2(|v|, w) goes up to a full turn, and with w "
        "negative it is the long way round. Turn the sign of all four parts first.",
    ),
    angle_without_axis=(
        _ERROR,
        _VECTOR.format(w="abs(left[0])"),
        "The angle is that of the short way and the axis that of the long one: with |w| the angle "
        "is right, but the vector part has to change its sign too.",
    ),
    target_flipped=(
        _LEFT,
        "left = product(np.asarray(target, dtype=float) * "
        "math.copysign(1.0, target[0]), hand * [1.0, -1.0, -1.0, -1.0])",
        _ERROR,
        "error = 2.0 * left[1:]",
        "The sign of the target is fixed, but the hand has one of its own: a joint beyond half a "
        "turn makes it negative. What has to be at most half a turn is the rotation that is left.",
    ),
    both_flipped=(
        _LEFT,
        "left = product(np.asarray(target, dtype=float) * "
        "math.copysign(1.0, target[0]), hand * math.copysign(1.0, hand[0]) "
        "* [1.0, -1.0, -1.0, -1.0])",
        _ERROR,
        "error = 2.0 * left[1:]",
        "Target and hand are both made positive. On either side of half a turn they are then still "
        "far apart as quaternions, though not as rotations: it is the scalar part of their product "
        "that has to be positive.",
    ),
    error_in_the_hand=(
        _LEFT,
        "left = product(hand * [1.0, -1.0, -1.0, -1.0], target)",
        "The rotation that is left is taken in the axes of the hand, and the Jacobian is in those "
        "of the world. Target times the conjugate of the hand, in this order, is in the world's.",
    ),
    always_reversed=(
        _ERROR,
        "error = -2.0 * left[1:]",
        "The error is reversed everywhere: now the short turns go wrong that were right before.",
    ),
    wrapped_at_the_end=(
        "    return q\n",
        "    return (q + np.pi) % (2.0 * np.pi) - np.pi\n",
        "The angles are brought between -pi and pi at the end. A joint knows how often it has been "
        "turned, and so does its cable: that hides the symptom, and throws a wound joint round.",
    ),
    half_missing=(
        _ERROR,
        "error = math.copysign(1.0, left[0]) * left[1:]",
        "The sign is right, and each step goes half as far as it should: the vector part of a "
        "quaternion is the sine of *half* the angle.",
    ),
    stops_on_the_far_side=(
        _ERROR,
        "error = 2.0 * max(math.copysign(1.0, left[0]), 0.0) * left[1:]",
        "Where the scalar part is negative nothing moves. Change the sign of the error there.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        1e-6,
        "sixty steps of three tenths leave 1e-9 of the way",
        first=arrived,
        explain=explain,
        timed=five_steps,
    ),
    examples=(
        "wrist_ik(np.array([0.5, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]), 0.05, 60).round(6)",
        "wrist_ik(np.array([0.5, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0, 0.0]), 0.05, 60).round(6)",
        "wrist_ik(np.array([0.0, 0.3, 0.0]), np.array([0.96, 0.0, 0.0, 0.28]), 0.05, 60).round(6)",
    ),
    picture=angles,
    slips=SLIPS + value_slips("wrist_ik", in_part=False, whole=True),
)
