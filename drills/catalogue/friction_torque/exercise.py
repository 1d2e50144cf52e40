"""Torques against joint friction: values against the worked answer."""

from __future__ import annotations

from typing import Any

import numpy as np

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown


def cases(rng: np.random.Generator) -> list[Case]:
    """Return one joint in both directions and at rest; then several, slow and fast."""

    def turning(
        label: str,
        level: str = "core",
        *,
        n: int = 4,
        slow: float = 0.2,
        fast: float = 40.0,
        transition: float = 0.05,
    ) -> Case:
        """Return rates between these multiples of the transition speed, in both directions."""
        speed = transition * rng.uniform(slow, fast, n)
        v = speed * rng.choice([-1.0, 1.0], n)
        if n > 1:
            v[0], v[1] = speed[0], -speed[1]
        return Case(
            (v, rng.uniform(0.2, 8.0, n), rng.uniform(0.1, 3.0, n), transition), label, level
        )

    def one(v: float, label: str) -> Case:
        return Case((np.array([v]), np.array([2.0]), np.array([0.5]), 0.05), label, "simple")

    width = float(rng.uniform(0.02, 0.2))
    dry, wet, abrupt = (turning("").args for _ in range(3))
    dry[2][:], wet[1][:], abrupt[0][2] = 0.0, 0.0, 0.0
    rest = turning("").args
    return [
        one(2.0, "forwards, fast"),
        one(-2.0, "backwards, fast"),
        one(0.0, "at rest"),
        *(turning("several joints", transition=width) for _ in range(4)),
        turning("slower than the transition", slow=0.02, fast=1.0),
        turning("around the transition speed", slow=0.7, fast=2.0, transition=width),
        turning("fast", slow=20.0, fast=80.0),
        Case(dry, "Coulomb friction alone"),
        Case(wet, "viscous friction alone"),
        Case((np.zeros(4), *rest[1:]), "all at rest", "edge"),
        Case((*abrupt[:3], 0.0), "a transition speed of zero", "edge"),
        turning("far above the transition", "edge", n=6, slow=1e4, fast=1e5, transition=1e-4),
        Case((np.array([1, -2]), np.array([3, 1]), np.array([1, 2]), 2), WHOLE, "edge"),
    ]


def torques(figure: Any, shown: Shown) -> None:
    """Plot the torques over the rates, a mark for each joint."""
    axes = picture.plane(figure, "rate [rad/s]", "torque [N m]")
    v = np.asarray(shown.args[0], dtype=float)
    order = np.argsort(v)
    axes.plot(v[order], np.asarray(shown.got[0])[order], "o-", **picture.YOURS)
    axes.plot(v[order], np.asarray(shown.expected[0])[order], marker="o", **picture.RIGHT)
    axes.axhline(0.0, color="0.7", lw=1.0)
    axes.legend()


_TANH = "np.tanh(v / transition)"
_SHARE = f"{_TANH} if transition > 0.0 else np.sign(v)"
_DRY = "np.asarray(coulomb) * share"
_WET = "np.asarray(viscous) * v"
_SUM = f"{_DRY} + {_WET}"

SLIPS = slips(
    friction_itself=(
        f"return {_SUM}",
        f"return -({_SUM})",
        "That is the torque of friction itself, which acts against the motion. The motor has to "
        "add the opposite torque, which has the sign of the speed.",
    ),
    sign_for_the_transition=(
        _SHARE,
        "np.sign(v)",
        "Coulomb friction jumps at zero speed in your answer: it has the sign of the speed. "
        "Multiply it by tanh(v / transition), which passes through zero smoothly.",
    ),
    viscous_missing=(
        f" + {_WET}",
        "",
        "Viscous friction is missing: add viscous times the rate.",
    ),
    coulomb_missing=(
        f"{_DRY} + ",
        "",
        "Coulomb friction is missing: its size does not depend on the speed, and it has the sign "
        "of the speed.",
    ),
    speed_without_its_sign=(
        f"return {_SUM}",
        f"return np.abs({_SUM})",
        "The torques are positive in both directions. A joint that turns backwards needs a "
        "negative torque: use the rate with its sign, not its absolute value.",
    ),
    viscous_without_its_sign=(
        _WET,
        "np.asarray(viscous) * np.abs(v)",
        "The viscous term is positive in both directions. It is viscous times the rate, with its "
        "sign.",
    ),
    coulomb_without_its_sign=(
        _DRY,
        "np.asarray(coulomb) * np.abs(share)",
        "The Coulomb term is positive in both directions. It changes its sign with the speed.",
    ),
    viscous_subtracted=(
        f"{_DRY} + {_WET}",
        f"{_DRY} - {_WET}",
        "The viscous term is subtracted. Both kinds of friction act against the motion, so the "
        "motor has to compensate both in the same direction.",
    ),
    coulomb_subtracted=(
        f"{_DRY} + {_WET}",
        f"{_WET} - {_DRY}",
        "The Coulomb term is subtracted. Both kinds of friction act against the motion, so the "
        "motor has to compensate both in the same direction.",
    ),
    times_the_transition=(
        _TANH,
        "np.tanh(v * transition)",
        "The rate is multiplied by the transition speed. Divide by it: tanh of 1 is reached where "
        "the rate equals the transition speed.",
    ),
    transition_ignored=(
        _SHARE,
        "np.tanh(v)",
        "The transition speed has no effect: the argument of tanh is the rate itself. Divide it by "
        "the transition speed.",
    ),
    coefficients_swapped=(
        _SUM,
        "np.asarray(viscous) * share + np.asarray(coulomb) * v",
        "The two coefficients are swapped: viscous [N m s/rad] belongs to the rate, coulomb [N m] "
        "to the tanh.",
    ),
    degrees_for_radians=(
        "v = np.asarray(v, dtype=float)",
        "v = np.degrees(np.asarray(v, dtype=float))",
        "The rates are converted into degrees. All arguments are in radians.",
    ),
    degrees_in_the_viscous_term=(
        _WET,
        "np.asarray(viscous) * np.degrees(v)",
        "The viscous term takes the rate in degrees per second. All arguments are in radians.",
    ),
    straight_transition=(
        _TANH,
        "np.clip(v / transition, -1.0, 1.0)",
        "The transition is a straight line that ends at the transition speed. The task uses tanh, "
        "which has no corners.",
    ),
    other_curve=(
        _TANH,
        "2.0 / np.pi * np.arctan(v / transition)",
        "The transition is an arctangent, which approaches 1 slowly. The task uses tanh.",
    ),
    dead_zone=(
        _TANH,
        "np.where(np.abs(v) < transition, 0.0, np.sign(v))",
        "Coulomb friction is switched off below the transition speed and complete above it. Both "
        "are jumps; tanh(v / transition) has none.",
    ),
    share_of_both=(
        f"return {_SUM}",
        "return (np.asarray(coulomb) + np.asarray(viscous) * np.abs(v)) * share",
        "The transition multiplies viscous friction as well. That one is smooth by itself: only "
        "Coulomb friction is multiplied by tanh.",
    ),
    viscous_of_the_share=(
        _SUM,
        "(np.asarray(coulomb) + np.asarray(viscous)) * share",
        "Viscous friction is multiplied by the tanh instead of the rate: it has to grow with the "
        "speed.",
    ),
    zero_transition_has_no_friction=(
        "np.sign(v)",
        "0.0 * v",
        "With a transition speed of zero your Coulomb term is zero. The limit is the sign of the "
        "speed.",
    ),
    full_friction_at_rest=(
        "np.sign(v)",
        "np.where(v < 0.0, -1.0, 1.0)",
        "With a transition speed of zero, a joint at rest gets the full Coulomb torque. At rest it "
        "needs none.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: 1e-12 * max(1.0, float(np.abs(truth[0]).max(initial=0.0))),
        "two products and a tanh: rounding",
        explain=coarse,
    ),
    examples=(
        "friction_torque([2.0, -2.0], [3.0, 3.0], [0.5, 0.5], 0.05)",
        "friction_torque([0.05, 0.0], [1.0, 1.0], [0.0, 0.0], 0.05)",
        "friction_torque([0.1, 0.0, -0.1], [1.0, 1.0, 1.0], [0.0, 0.0, 2.0], 0.0)",
    ),
    picture=torques,
    slips=SLIPS
    + coarse_slips("friction_torque", "A slow joint needs a small torque, of few digits.")
    + value_slips("friction_torque", in_part=False),
)
