"""Forward kinematics of a planar arm: values against the closed form, slips by their values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.attempt import Attempt, Place
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of, largest_error
from drills.chart_plan import Drawing
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return drawn arms, and those in which one mistake shows alone."""

    def lengths() -> Array:
        return rng.uniform(0.2, 1.5, 3)

    def angles() -> Array:
        return rng.uniform(-math.pi, math.pi, 3)

    quarter = math.pi / 2.0
    return [Case((lengths(), angles())) for _ in range(10)] + [
        Case((np.ones(3), np.zeros(3)), "stretched along x", "simple"),
        Case((lengths(), np.array([0.5, 0.0, 0.0])), "straight, at half a radian", "simple"),
        Case((lengths(), np.array([0.0, math.pi, 0.0])), "folded back"),
        Case((lengths(), np.array([quarter, -quarter, quarter])), "a staircase"),
        Case((lengths(), np.array([0.0, 0.0, rng.uniform(0.3, 2.5)])), "the last joint alone"),
        Case((lengths(), -rng.uniform(0.1, 1.0, 3)), "all clockwise"),
        Case((lengths(), rng.uniform(20.0, 60.0, 3)), "many turns", "edge"),
        Case((np.array([1.0, 0.0, 0.5]), angles()), "a link of no length", "edge"),
        Case((np.zeros(3), angles()), "an arm of no length", "edge"),
        Case((np.array([1e-3, 1.0, 1e3]), angles()), "links of very different lengths", "edge"),
        Case((np.array([2, 1, 3]), rng.permutation([1, 2, -1])), WHOLE, "edge"),
    ]


def explain(answers: Sequence[Answer]) -> str:
    """Return three points for four, whatever else is wrong with them.

    Else digits that are missing.
    """
    firsts = [
        largest_error(np.asarray(a.got[0]), np.zeros(2))
        for a in answers
        if np.shape(a.got) == (3, 2)
    ]
    if firsts and len(firsts) == len(answers):
        return "base_missing" if max(firsts) > 0.0 else "tip_missing"
    return coarse(answers)


def arms(attempt: Attempt, answer: Place) -> Drawing:
    """Return two arms, yours and the worked answer's: a closed form has no accuracy to trade."""
    from course.measure.figure import Panel, Series

    lengths, panels = np.array([0.4, 0.3, 0.2]), []
    for thetas in np.random.default_rng(attempt.report.seed).uniform(-1.5, 1.5, (2, 3)):
        yours, right = (
            np.asarray(place.call("fk3", lengths, thetas), dtype=float)
            for place in (attempt.learner.child, answer)
        )
        message = ", ".join(f"{theta:.2f}" for theta in thetas)
        panel = Panel(f"angles {message} rad", "x [m]", "y [m]", equal=True)
        panel.series = [
            Series("yours", yours[:, 0], yours[:, 1], "yours"),
            Series("worked answer", right[:, 0], right[:, 1], style="--"),
        ]
        error = np.abs(yours - right).max()
        tip = f"tip at ({right[-1, 0]:.3f}, {right[-1, 1]:.3f}) m"
        panel.notes = [f"angles {message} rad: {tip}; yours is within {error:.1e} m"]
        panels.append(panel)
    return Drawing(panels)


def arm(figure: Any, shown: Shown) -> None:
    """Plot both arms, joint by joint."""
    axes = picture.plane(figure, "x [m]", "y [m]", equal=True)
    axes.plot(*shown.got[0].T, "-o", **picture.YOURS)
    axes.plot(*shown.expected[0].T, marker="o", **picture.RIGHT)
    axes.legend()


SUM, TURNS = "np.cumsum(thetas)", "np.column_stack((np.cos(directions), np.sin(directions)))"
POINTS = "np.vstack((np.zeros(2), np.cumsum(links, axis=0)))"

SLIPS = slips(
    degrees_for_radians=(
        SUM,
        "np.cumsum(np.deg2rad(thetas))",
        "The angles are treated as degrees. They come in radians, which is what np.cos and "
        "np.sin take: convert nothing.",
    ),
    absolute_angles=(
        SUM,
        "thetas",
        "Each angle is taken from the x axis. It is measured from the link before: the direction "
        "of a link is the sum of all angles up to its joint.",
    ),
    last_joint_forgotten=(
        SUM,
        "np.cumsum(thetas * [1.0, 1.0, 0.0])",
        "The last joint does nothing: the third link follows the direction of the second. Its "
        "direction is the sum of all three angles.",
    ),
    turned_one_link_late=(
        SUM,
        "np.cumsum(thetas) - thetas",
        "Every joint turns the link after the next: the sum of the angles lags behind by one. "
        "Add a joint's angle before you place its link.",
    ),
    elbow_sign=(
        SUM,
        "np.cumsum(thetas * [1.0, -1.0, 1.0])",
        "The elbow bends the wrong way: the second angle is subtracted where it is added. All "
        "joints turn counter-clockwise.",
    ),
    clockwise=(
        SUM,
        "-np.cumsum(thetas)",
        "The arm is mirrored in the x axis: your angles count clockwise, or y points down as on "
        "a screen. Here angles count counter-clockwise and y points up.",
    ),
    sine_and_cosine_swapped=(
        TURNS,
        "np.column_stack((np.sin(directions), np.cos(directions)))",
        "Sine and cosine are swapped, so that a zero angle points along y. x goes with the "
        "cosine, y with the sine.",
    ),
    links_not_added_up=(
        POINTS,
        "np.vstack((np.zeros(2), links))",
        "Each row is one link as seen from its own joint. A joint's position is the sum of all "
        "links before it.",
    ),
    arguments_swapped=(
        "def fk3(lengths: ArrayLike, thetas: ArrayLike)",
        "def fk3(thetas, lengths)",
        "if (lengths < 0.0).any():",
        "if False:",
        "Lengths and angles are taken for each other. The task's order is fk3(lengths, thetas).",
    ),
    lengths_summed=(
        "lengths[:, None]",
        "np.cumsum(lengths)[:, None]",
        "The lengths are summed before the links are: each link is as long as all up to it. Sum "
        "the angles, then the links, not the lengths.",
    ),
    lengths_reversed=(
        "lengths[:, None]",
        "lengths[::-1, None]",
        "The link lengths are used from tip to base. They come from base to tip.",
    ),
    order_reversed=(
        POINTS,
        POINTS + "[::-1]",
        "The points are right but run from tip to base. The base comes first.",
    ),
    tip_missing=(
        POINTS,
        POINTS + "[:-1]",
        "The tip is missing: three links end in three points, and the base is a fourth.",
    ),
    base_missing=(
        POINTS,
        "np.cumsum(links, axis=0)",
        "The base is missing: the first row is the origin, where the first joint sits.",
    ),
    tip_only=(
        POINTS,
        "np.sum(links, axis=0)",
        "Only the tip came back. Drawing an arm, or checking it for collisions, takes every "
        "joint: base, both inner joints, tip.",
    ),
    rows_and_columns_swapped=(
        POINTS,
        POINTS + ".T",
        "The points are right but stand in columns. One row is one point, (x, y).",
    ),
    half_angles=(
        "np.cumsum(thetas)",
        "np.cumsum(thetas) / 2.0",
        "Each link is turned by half of its angle. Half angles belong to quaternions; sine and "
        "cosine here take the whole angle.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: float(
            1e-12 * (1.0 + case.args[0].sum()) * (1.0 + np.abs(case.args[1]).sum())
        ),
        "a closed form: only rounding is left, which grows with the arm's length and the angles",
        explain=explain,
    ),
    examples=(
        "fk3(np.array([1.0, 1.0, 1.0]), np.array([0.0, 0.0, 0.0]))",
        "fk3(np.array([1.0, 1.0, 1.0]), np.array([0.5, 0.0, 0.0]))",
        "fk3(np.array([1.0, 1.0, 1.0]), np.array([0.5, -0.5, 0.5]))",
        "fk3(np.array([0.5, 0.3, 0.2]), np.array([0.3, 0.4, -0.2]))",
    ),
    picture=arm,
    chart=arms,
    slips=SLIPS
    + coarse_slips("fk3", "A difference of two near positions then has hardly any.")
    + value_slips("fk3"),
)
