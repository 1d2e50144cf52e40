"""Stability limits of a held arm: without damping, with it, then over postures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return arms of two rods with a payload, gains as one would set them."""

    def arm(
        label: str,
        level: str = "core",
        *,
        kp: float | None = None,
        kd: float | None = None,
        damping: float = 0.2,
        elbow: Any = None,
    ) -> Case:
        (m1, m2, load), (l1, l2) = rng.uniform([0.5, 0.5, 0.0], 1.5), rng.uniform(0.3, 0.6, 2)
        d = (m2 / 3.0 + load) * l2**2
        inertia = np.array(
            [m1 / 3.0 * l1**2 + (m2 + load) * l1**2 + d, (0.5 * m2 + load) * l1 * l2, d]
        )
        bend = np.sort(rng.uniform(-2.9, 2.9, 12)) if elbow is None else np.array(elbow)
        gains = [
            float(rng.uniform(*ends)) if g is None else g
            for g, ends in ((kp, (10.0, 60.0)), (kd, (1.0, 10.0)))
        ]
        return Case((inertia, bend, *gains, damping), label, level)

    return [
        arm("stretched, no damping", "simple", kd=0.0, damping=0.0, elbow=[0.0]),
        arm("stretched", "simple", elbow=[0.0]),
        arm("a right angle", "simple", elbow=[1.57]),
        *(arm("over postures, no damping", kd=0.0, damping=0.0) for _ in range(2)),
        arm("the joints' own damping alone", kd=0.0, damping=1.5),
        *(arm("over postures") for _ in range(3)),
        arm("much damping", kd=60.0),
        arm("stiff", kp=2e4),
        arm("no position gain", "edge", kp=0.0),
        arm("nearly no position gain", "edge", kp=1e-9),
        Case((np.array([4, 1, 1]), np.array([0, 1, 2]), 3, 2, 1), WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> float:
    """Return 1e-9 of the smallest limit."""
    return 1e-9 * float(truth[0].min())


def over_postures(figure: Any, shown: Shown) -> None:
    """Plot the limits over the elbow."""
    axes = picture.plane(figure, "elbow [rad]", "largest stable step [s]")
    for (limit,), style in ((shown.got, picture.YOURS), (shown.expected, picture.RIGHT)):
        axes.plot(shown.args[1], np.asarray(limit, dtype=float), marker=".", **style)
    axes.legend()


_BEND = "bend = np.cos(np.asarray(elbow, dtype=float))"
_QUICKEST = "quickest = 1.0 / np.linalg.eigvalsh(np.moveaxis(M, 2, 0))[:, 0]"
_DRAG = "(kd + damping) * quickest"
_LIMIT = "4.0 / (np.sqrt(drag**2 + 4.0 * stiffness) + drag)"
_INVERSE = "np.linalg.inv(np.moveaxis(M, 2, 0))"

SLIPS = slips(
    one_joints_inertia=(
        _QUICKEST,
        "quickest = 1.0 / np.moveaxis(M, 2, 0)[:, 1, 1]",
        "The inertia of one joint is used, as if the other were clamped. In a free arm the "
        "joints can move against each other, with less inertia.",
    ),
    first_joints_inertia=(
        _QUICKEST,
        "quickest = 1.0 / np.moveaxis(M, 2, 0)[:, 0, 0]",
        "The inertia of the whole arm about its first joint is used. What limits the step is "
        "the motion with the least inertia.",
    ),
    diagonal_of_the_inverse=(
        _QUICKEST,
        f"quickest = {_INVERSE}[:, 1, 1]",
        "A diagonal element of the inverse is smaller than its largest eigenvalue: the mode "
        "moves both joints.",
    ),
    heaviest_mode=(
        "[:, 0]\n",
        "[:, 1]\n",
        "That is the mode with the most inertia. The one with the least becomes unstable first.",
    ),
    folded_posture=(
        _BEND,
        "bend = -np.ones(len(np.asarray(elbow)))",
        "The folded posture is used for all. A stretched arm needs a smaller step.",
    ),
    angle_in_degrees=(
        _BEND,
        "bend = np.cos(np.deg2rad(elbow))",
        "The elbow is treated as degrees; it comes in radians.",
    ),
    kd_left_out=(
        _DRAG,
        "damping * quickest",
        "The derivative gain is missing. It acts as damping like any other, and lowers the limit.",
    ),
    joints_damping_left_out=(
        _DRAG,
        "kd * quickest",
        "The damping of the joints is missing: it acts in addition to kd.",
    ),
    no_damping_at_all=(
        _DRAG,
        "0.0 * quickest",
        "That is the undamped limit, 2 / omega. Damping from the old velocity lowers it.",
    ),
    explicit_euler=(
        _LIMIT,
        "drag / np.maximum(stiffness, 1e-300)",
        "That is the limit of explicit Euler, d / k, which is zero without damping. Here q "
        "uses the new velocity.",
    ),
    damping_raises_it=(
        _LIMIT,
        "(np.sqrt(drag**2 + 4.0 * stiffness) + drag) / np.maximum(stiffness, 1e-300)",
        "That is the other root: damping would raise the limit. It does if it is taken "
        "implicitly, from the new velocity.",
    ),
    half_the_drag=(
        _LIMIT,
        "4.0 / (np.sqrt(drag**2 / 4.0 + 4.0 * stiffness) + drag / 2.0)",
        "The damping counts only half: the limit is the root of k h^2 + 2 d h = 4.",
    ),
    divided_by_nothing=(
        _LIMIT,
        "(np.sqrt(drag**2 + 4.0 * stiffness) - drag) / stiffness",
        "Right until kp is small: then a difference of nearly equal numbers is divided by "
        "almost zero. Use the equivalent form 4 / (sqrt(d^2 + 4 k) + d).",
    ),
    damping_subtracted=(
        _DRAG,
        "(kd - damping) * quickest",
        "The joints' damping is subtracted from the gain kd. Both brake the arm, so they add up.",
    ),
    smallest_for_all=(
        f"return np.asarray({_LIMIT})",
        f"result = np.asarray({_LIMIT})\n    return np.full(len(result), result.min())",
        "Every posture gets the limit of the worst one. Return the limit of each posture.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "an eigenvalue and a root: rounding", explain=coarse),
    examples=(
        "step_limit([0.4, 0.1, 0.05], [0.0, 1.57, 3.14], 25.0, 8.0, 0.2)",
        "step_limit([0.4, 0.1, 0.05], [0.0, 1.57, 3.14], 25.0, 0.0, 0.0)",
    ),
    picture=over_postures,
    slips=SLIPS
    + coarse_slips("step_limit", "A step at the limit is decided by the last of them.")
    + value_slips("step_limit", in_part=False),
)
