"""Hybrid control: surfaces along the world's axes first, then turned ones."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills import picture
from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return one part of the law at a time on a level table, then surfaces turned any way."""

    def turned() -> Array:
        frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        return np.asarray(frame * np.linalg.det(frame))

    def task(
        label: str,
        level: str = "core",
        *,
        frame: Array | None = None,
        n: int = 3,
        forced: tuple[int, ...] = (0, 0, 1),
        parts: str = "error velocity force wanted",
        gain: float = 1.5,
    ) -> Case:
        """Return a drawn task; the parts that are not named are zero."""
        sizes = {"error": 0.02, "velocity": 0.3, "force": 8.0, "wanted": 10.0}
        vectors = [size * rng.normal(size=3) * (name in parts) for name, size in sizes.items()]
        gains = np.array([rng.uniform(500.0, 3000.0), rng.uniform(20.0, 90.0), gain])
        frame = turned() if frame is None else frame
        args = rng.normal(size=(3, n)), frame, np.array(forced, dtype=float), *vectors, gains
        return Case(args, label, level)

    level, tilt = np.eye(3), rng.uniform(0.3, 1.2)
    ramp = np.array(
        [
            [math.cos(tilt), 0.0, math.sin(tilt)],
            [0.0, 1.0, 0.0],
            [-math.sin(tilt), 0.0, math.cos(tilt)],
        ]
    )
    pressed = task("a level table, as pressed as wanted", "simple", frame=level).args
    pressed[6][:] = pressed[5]
    whole = (
        np.array([[1, 0, 2], [0, 1, 1], [3, 1, 0]]),
        np.eye(3, dtype=int)[[2, 0, 1]],
        np.array([0, 1, 0]),
        np.array([1, -2, 3]),
        np.array([2, 0, 1]),
        np.array([5, 4, -3]),
        np.array([7, 6, 2]),
        np.array([100, 10, 1.25]),
    )
    return [
        task("a level table, the place alone", "simple", frame=level, parts="error velocity"),
        task("a level table, the force alone", "simple", frame=level, parts="wanted"),
        Case(pressed, "a level table, as pressed as wanted", "simple"),
        task("a level table, all together", "simple", frame=level),
        task("a ramp", frame=ramp),
        task("a ramp, the force alone", frame=ramp, parts="wanted"),
        task("a ramp, the place alone", frame=ramp, parts="error"),
        task("a ramp, moving", frame=ramp, parts="velocity"),
        task("a turned surface"),
        task("a turned surface", n=7),
        task("a turned surface", n=6),
        task("forced along its first axis", forced=(1, 0, 0)),
        task("an edge, forced along two axes", forced=(1, 1, 0)),
        task("no feedback of the force", gain=0.0),
        task("forced along all axes", "edge", forced=(1, 1, 1)),
        task("no force wanted", "edge", forced=(0, 0, 0)),
        task("fewer joints than axes", "edge", n=2),
        Case(whole, WHOLE, "edge"),
    ]


def allowed(case: Case, truth: Any) -> float:
    """Return 1e-11 of the scale that the task states, one added."""
    J, _, _, error, velocity, force, expected, (stiffness, damping, gain) = case.args
    size = np.linalg.norm
    pushed = stiffness * size(error) + damping * size(velocity)
    return float(
        1e-11 * (1 + np.abs(J).max() * (pushed + (1 + gain) * (size(force) + size(expected))))
    )


def torques(figure: Any, shown: Shown) -> None:
    """Plot the torques, joint by joint."""
    axes = picture.plane(figure, "joint", "torque [N m]")
    number = np.arange(1, shown.args[0].shape[1] + 1)
    axes.plot(number, shown.got[0], "o-", **picture.YOURS)
    axes.plot(number, shown.expected[0], marker="o", **picture.RIGHT)
    axes.set_xticks(number)
    axes.legend()


_SELECT = "along = np.where(np.asarray(forced) > 0.5, pressing, following)"
_COMMAND = "command = axes @ along - damping * np.asarray(velocity)"
_PRESSING = "pressing = push + gain * (push - axes.T @ np.asarray(force))"
_RETURN = "return np.asarray(J, dtype=float).T @ command"

SLIPS = slips(
    axes_swapped=(
        "pressing, following)",
        "following, pressing)",
        "The axes have changed places: force is controlled along the surface, and the place along "
        "the normal, where the surface doesn't let it move.",
    ),
    selection_in_the_world=(
        _PRESSING,
        "push = axes @ push\n    pressing = push + gain * (push - np.asarray(force))",
        "following = stiffness * (axes.T @ np.asarray(error))",
        "following = stiffness * np.asarray(error)",
        _COMMAND,
        _COMMAND.replace("axes @ ", ""),
        "The selection is made along the axes of the world. On a rotated surface these are "
        "neither its normal nor its tangents: rotate the vectors into its frame first.",
    ),
    frame_ignored=(
        "axes, push = np.asarray(frame, dtype=float)",
        "axes, push = np.eye(3)",
        "The frame is not used: everything is computed as if the surface were aligned with "
        "the axes of the world.",
    ),
    frame_transposed=(
        "axes, push = np.asarray(frame, dtype=float)",
        "axes, push = np.asarray(frame, dtype=float).T",
        "The frame is used in the wrong direction. Its columns are the surface's axes: "
        "frame.T rotates into them, frame rotates back.",
    ),
    not_turned_back=(
        _COMMAND,
        "command = along - damping * np.asarray(velocity)",
        "The force along the surface's axes is not rotated back into the world before it is "
        "mapped to the joints.",
    ),
    wanted_force_in_the_world=(
        "np.asarray(wanted, dtype=float)",
        "np.asarray(frame, dtype=float).T @ np.asarray(wanted)",
        "The desired force is treated as a vector in the world. It is given along the axes "
        "of the surface.",
    ),
    force_not_turned=(
        _PRESSING,
        _PRESSING.replace("axes.T @ ", ""),
        "The measured force is used as it is. It is given in the world and has to be rotated "
        "into the surface's axes, like the position error.",
    ),
    no_feedforward=(
        _PRESSING,
        "pressing = gain * (push - axes.T @ np.asarray(force))",
        "The desired force itself is missing: once the force error is zero, the tip would "
        "let go. The gain only adds a correction.",
    ),
    force_not_fed_back=(
        _PRESSING,
        "pressing = push",
        "The measured force is not fed back, so friction and a wrong model leave an error.",
    ),
    force_error_reversed=(
        _PRESSING,
        _PRESSING.replace("push + gain", "push - gain"),
        "The force error has the wrong sign: use desired minus measured. (The force is the "
        "one that the tip exerts, not the one that acts on the sensor.)",
    ),
    damping_along_the_surface_only=(
        _COMMAND,
        "command = axes @ (along - damping * "
        "(1 - np.asarray(forced)) * (axes.T @ np.asarray(velocity)))",
        "Damping is missing along the force-controlled axes. It acts along all axes: without "
        "it a force loop is hardly stable at a stiff wall.",
    ),
    damping_reversed=(
        _COMMAND,
        "command = axes @ along + damping * np.asarray(velocity)",
        "The damping accelerates instead of braking: it has to act against the velocity.",
    ),
    place_held_everywhere=(
        _SELECT,
        "along = np.where(np.asarray(forced) > 0.5, pressing, 0.0) + following",
        "The position is also controlled along the force-controlled axes. There the surface "
        "fixes the position, and the stiffness adds a force that nobody asked for.",
    ),
    inverse_for_transpose=(
        _RETURN,
        "return np.linalg.pinv(np.asarray(J, dtype=float)) @ command",
        "Forces are mapped to joint torques with the transpose of the Jacobian, not with its "
        "inverse: the power is the same on both sides.",
    ),
    force_returned=(
        _RETURN,
        "return command",
        "This is the force at the tip. The torques at the joints are J.T times it.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "some dozen products and sums: rounding", explain=coarse),
    examples=(
        "hybrid_torque(np.eye(3), np.eye(3), np.array([0, 0, 1]), np.array([0.01, 0.0, 0.05]), "
        "np.zeros(3), np.zeros(3), np.array([0.0, 0.0, -10.0]), np.array([1000.0, 50.0, 1.0]))",
        "hybrid_torque(np.eye(3), np.eye(3)[:, [1, 2, 0]], np.array([0, 0, 1]), np.zeros(3), "
        "np.zeros(3), np.array([-4.0, 0.0, 0.0]), np.array([0.0, 0.0, -10.0]), "
        "np.array([1000.0, 50.0, 1.0]))",
        "hybrid_torque(np.eye(3), np.eye(3), np.zeros(3), np.zeros(3), np.ones(3), np.zeros(3), "
        "np.ones(3), np.array([1000.0, 50.0, 1.0]))",
    ),
    picture=torques,
    slips=SLIPS
    + coarse_slips("hybrid_torque", "It is a force, and a stiff wall answers to the last digit.")
    + value_slips("hybrid_torque", in_part=False),
)
