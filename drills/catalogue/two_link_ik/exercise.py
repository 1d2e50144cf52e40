"""Both arms of two links: values up to full turns, both edges, and what cannot be reached."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown
from drills.values import Mismatch, as_float64, describe_call

Array = NDArray[np.float64]
TURN = 2.0 * math.pi
OUTER, INNER = "on the outer edge", "on the inner edge"


def _at(r: float, angle: float) -> Array:
    return np.array([r * math.cos(angle), r * math.sin(angle)])


def cases(rng: np.random.Generator) -> list[Case]:
    """Return targets all round, well inside the annulus, and on its edges to within the slack."""

    def inside(first: float, second: float, angle: float, label: str = "random") -> Case:
        r = abs(first - second) + rng.uniform(0.1, 0.9) * 2.0 * min(first, second)
        return Case((np.array([first, second]), _at(r, angle)), label)

    long, short = float(rng.uniform(0.6, 1.4)), float(rng.uniform(0.2, 0.5))
    angle = float(rng.uniform(-3.0, 3.0))
    square = float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.3, 1.0))
    return [
        *(
            inside(l1, l2, rng.uniform(-math.pi, math.pi))
            for l1, l2 in rng.uniform(0.3, 1.5, (6, 2))
        ),
        inside(long, short, angle, "a long first link"),
        inside(short, long, angle, "a long second link"),
        inside(long, long, 2.6, "equal links, target to the left"),
        inside(long, short, -2.2, "target down to the left"),
        inside(long, short, 0.5 * math.pi, "target on the y axis"),
        Case((np.array([1.0, 1.0]), np.array([1.0, 1.0])), "a square", "simple"),
        Case((np.array(square), np.array(square)), "an elbow at a right angle", "simple"),
        Case((np.array([long, short]), _at(long + short, angle)), OUTER, "edge"),
        Case((np.array([long, short]), _at(long + short + 5e-10, -angle)), OUTER, "edge"),
        Case((np.array([short, long]), _at(long - short, angle)), INNER, "edge"),
        Case((np.array([short, long]), _at(long - short - 5e-10, -angle)), INNER, "edge"),
        Case((np.array([1e-2, 1.0]), _at(1.0, angle)), "links of very different lengths", "edge"),
        Case((np.array([3, 2]), np.array([-1, 4])), WHOLE, "edge"),
    ]


def unwound(got: Any, truth: Array) -> Array:
    """Return the right angles with the full turns of what came back."""
    try:
        with np.errstate(all="ignore"):  # what came back may be as large as it likes
            turns = np.round((as_float64(got, truth.shape) - truth) / TURN)
    except Mismatch:
        return truth
    return truth + TURN * np.where(np.abs(turns) < 1e3, turns, 0.0)


def out_of_reach(attempt: Attempt, answers: Sequence[Answer]) -> None:
    """Check targets outside and in the hole must be refused."""
    angle, lengths = float(attempt.rng.uniform(-3.0, 3.0)), attempt.rng.uniform(0.3, 1.5, 2)
    outer, inner = float(lengths.sum()), float(abs(lengths[0] - lengths[1]))
    long, stub = np.array([10.0, 7.0]), np.array([1.0, 0.02])  # a cosine hides 2e-6 m of either
    for label, links, r, slip in (
        ("beyond both links", lengths, 1.3 * outer, "clamped"),
        ("just beyond", lengths, outer + 2e-6, "clamped"),
        ("just beyond long links", long, 17.0 + 2e-6, "clamped"),
        ("just beyond a stub", stub, 1.02 + 2e-6, "clamped"),
        ("in the hole", lengths, 0.6 * inner, "hole_answered"),
        ("just in the hole", lengths, inner - 2e-6, "hole_answered"),
        ("just in the hole of long links", long, 3.0 - 2e-6, "hole_answered"),
    ):
        if r < 0.0:
            continue
        args = links, _at(r, angle)
        attempt.require_error(
            label,
            partial(attempt.call, *args),
            sentence="No arm of these lengths reaches it, and angles for it would be believed.",
            call=describe_call(attempt.card.entry, args),
            # A wrong formula may accept them too; then it is the formula that has to be named.
            slip="" if attempt.failed else slip,
        )


def arms(figure: Any, shown: Shown) -> None:
    """Plot both arms as they came back, the right ones, the target and the annulus."""
    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    (l1, l2), target = shown.args
    for r in (l1 + l2, abs(l1 - l2)):
        axes.plot(*_circle(float(r)), color="0.85", lw=1.0)
    for values, style in ((shown.got[0], picture.YOURS), (shown.expected[0], picture.RIGHT)):
        for row, (q1, q2) in enumerate(np.asarray(values, dtype=float).reshape(2, 2)):
            x = np.array([0.0, l1 * np.cos(q1), l1 * np.cos(q1) + l2 * np.cos(q1 + q2)])
            y = np.array([0.0, l1 * np.sin(q1), l1 * np.sin(q1) + l2 * np.sin(q1 + q2)])
            label = {"label": style["label"] if row == 0 else None}
            axes.plot(x, y, marker="o", **(style | label))
    axes.plot(*target, "*", color="tab:orange", ms=14)
    axes.legend()


def _circle(r: float) -> tuple[Array, Array]:
    angle = np.linspace(0.0, TURN, 145)
    return r * np.cos(angle), r * np.sin(angle)


_CHECK = "    if not inner - 1e-9 <= r <= outer + 1e-9:\n"
_AIM, _BENDS = "math.atan2(y, x) - aside", "for q2 in (bend, -bend):"
_BEND = "bend = 2.0 * math.atan2(math.sqrt(to_outer), math.sqrt(to_inner))"
_ACOS = """import math

import numpy as np


def two_link_ik(lengths, target):
    first, second = lengths
    x, y = target
    r = math.hypot(x, y)
    {check}
    cosine = (r * r - first**2 - second**2) / (2 * first * second)
    bend = {bend}
    rows = []
    for q2 in (bend, -bend):
        aside = np.arctan2(second * np.sin(q2), first + second * np.cos(q2))
        rows.append([np.arctan2(y, x) - aside, q2])
    return np.array(rows)
"""
_REFUSED = (
    "if r > first + second + 1e-8 or r < abs(first - second) - 1e-8:\n        raise ValueError"
)

SLIPS = slips(
    interior_angle=(
        _BEND,
        "bend = math.pi - 2.0 * math.atan2(math.sqrt(to_outer), math.sqrt(to_inner))",
        "q2 is the inner angle of the triangle at the elbow. The joint's angle is measured from "
        "the direction of the first link: it is pi minus that one, zero at full stretch.",
    ),
    absolute_elbow=(
        "aside, q2])",
        "aside, math.atan2(y, x) - aside + q2])",
        "The second angle is measured from the x axis. It is measured from the first link: "
        "subtract q1.",
    ),
    one_arm_twice=(
        _BENDS,
        "for q2 in (bend, bend):",
        "Both rows are the same arm. A target inside the annulus has two: the second one bends "
        "by the same angle to the other side, with a first joint of its own.",
    ),
    first_joint_shared=(
        "rows.append([math.atan2(y, x) - aside, q2])",
        "rows.append([rows[0][0] if rows else math.atan2(y, x) - aside, q2])",
        "The second arm has the first joint of the first one and misses the target. Mirroring the "
        "elbow turns the first link as well: put the negative q2 into the formula of q1.",
    ),
    rows_swapped=(
        _BENDS,
        "for q2 in (-bend, bend):",
        "Both arms are right and stand in the other order: the one with q2 from 0 to pi is first.",
    ),
    branches_in_columns=(
        "return np.array(rows)",
        "return np.array(rows).T",
        "The two arms stand in columns. One row is one arm, (q1, q2).",
    ),
    aside_added=(
        _AIM,
        "math.atan2(y, x) + aside",
        "The first link is on the wrong side of the line to the target: what the elbow adds to "
        "the direction of the tip has to be subtracted from q1.",
    ),
    half_plane_lost=(
        _AIM,
        "math.atan(y / x if x else math.inf) - aside",
        "Targets with negative x come out half a turn off: y / x is the same for a point and its "
        "mirror image through the base. Use atan2(y, x).",
    ),
    atan2_of_x_and_y=(
        _AIM,
        "math.atan2(x, y) - aside",
        "atan2 takes y first, then x. Yours measures the direction of the target from the y axis.",
    ),
    first_points_at_target=(
        _AIM,
        "math.atan2(y, x)",
        "The first link points at the target. Only a straight arm does that: subtract the angle "
        "at the base, atan2(l2 sin(q2), l1 + l2 cos(q2)).",
    ),
    lengths_swapped=(
        "first, second = (float",
        "second, first = (float",
        "The link lengths are taken for each other. The first is the one at the base.",
    ),
    degrees_returned=(
        "return np.array(rows)",
        "return np.degrees(np.array(rows))",
        "The angles come back in degrees. Radians are asked for.",
    ),
    nan_at_the_edges=(
        _ACOS.format(check=_REFUSED, bend="np.arccos(cosine)"),
        "At full stretch or folded up the cosine comes out beyond 1 by rounding, and arccos gives "
        "NaN without an error. Refuse what is out of reach by its distance, then limit the "
        "cosine to -1 ... 1, or take the half angle by atan2.",
    ),
    edges_refused=(
        _CHECK,
        "    if not inner + 1e-6 < r < outer - 1e-6:\n",
        "A target on the edge of what can be reached is refused. It has one arm, straight or "
        "folded; the task grants it a slack of 1e-9 m.",
    ),
    clamped=(
        _CHECK,
        "    if not r > -1.0:\n",
        "A target beyond reach gets angles: the cosine is clamped, or the root of a negative "
        "number taken for zero, or the slack is on the cosine and not on the distance. That arm "
        "does not reach it, and nobody is told. Raise ValueError.",
    ),
    hole_answered=(
        _CHECK,
        "    if not r <= outer + 1e-9:\n",
        "A target in the hole around the base gets angles. Links of unequal length cannot come "
        "nearer to the base than |l1 - l2|. Raise ValueError there too, by the distance: a slack "
        "on the cosine is none in metres.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        # On an edge q2 changes with the root of the distance: 1e-9 m are 4e-5 rad.
        lambda case, truth: 1e-4 if case.label in (OUTER, INNER) else 1e-10,
        "a closed form: rounding is left, whose root counts on the edges",
        nearest=unwound,
        explain=coarse,
        last=out_of_reach,
        then=("edge", "targets out of reach"),
    ),
    examples=(
        "two_link_ik(np.array([1.0, 1.0]), np.array([1.0, 1.0]))",
        "two_link_ik(np.array([1.0, 0.5]), np.array([0.6, 0.8]))",
        "two_link_ik(np.array([1.0, 0.5]), np.array([-1.5, 0.0]))",
    ),
    picture=arms,
    slips=SLIPS
    + coarse_slips("two_link_ik", "A tip at 1 m is then off by a tenth of a micrometre.")
    + value_slips("two_link_ik"),
)
