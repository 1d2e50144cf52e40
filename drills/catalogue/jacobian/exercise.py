"""The geometric Jacobian: values on planar and spatial arms, slips by their values."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips
from drills.grade_report import Shown
from drills.picture import RIGHT, YOURS

Array = NDArray[np.float64]
NO_TOOL = np.zeros(3)


def _placed(offset: Any, rotation: Any = None) -> Array:
    made = np.eye(4)
    made[:3, 3] = offset
    if rotation is not None:
        made[:3, :3] = rotation
    return made


def _planar(*lengths: float) -> Array:
    """Return joints about the world's z, the next one at the end of each link."""
    return np.array([_placed((x, 0.0, 0.0)) for x in (0.0, *lengths)])


def cases(rng: np.random.Generator) -> list[Case]:
    """Return arms from one joint to ten, in the plane and in space."""

    def rotation() -> Array:
        basis, upper = np.linalg.qr(rng.normal(size=(3, 3)))
        basis = basis * np.sign(np.diag(upper))
        return np.asarray(basis * np.linalg.det(basis))

    def spatial(n: int, label: str = "random", tool: bool = True, level: str = "core") -> Case:
        placements = np.array([_placed(rng.uniform(-0.4, 0.4, 3), rotation()) for _ in range(n)])
        offset = rng.uniform(-0.3, 0.3, 3) if tool else NO_TOOL
        return Case((placements, rng.uniform(-math.pi, math.pi, n), offset), label, level)

    l1, l2, l3 = rng.uniform(0.3, 1.0, 3)
    reach = np.array([l3, 0.0, 0.0])
    quarter = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 2], [0, 0, 0, 1]])
    turned = spatial(4)
    return [
        Case((_planar(), np.zeros(1), np.array([1.0, 0, 0])), "one joint, along x", "simple"),
        Case((_planar(), rng.uniform(0.3, 1.2, 1), reach), "one joint, turned", "simple"),
        Case((_planar(l1), np.zeros(2), reach), "two links, stretched", "simple"),
        Case((_planar(l1), rng.uniform(0.3, 1.2, 2), reach), "two links, bent"),
        Case((_planar(l1, l2), rng.uniform(-1.2, 1.2, 3), reach), "three links in the plane"),
        *(spatial(n) for n in (2, 3, 4, 6, 7)),
        spatial(6, "six joints, no tool", tool=False),
        Case((turned.args[0], np.zeros(4), turned.args[2]), "all angles zero"),
        spatial(10, "ten joints", level="edge"),
        spatial(1, "one joint, placed and turned", level="edge"),
        Case((turned.args[0], rng.uniform(20.0, 60.0, 4), turned.args[2]), "many turns", "edge"),
        Case(
            (np.stack([np.eye(4, dtype=int), quarter]), np.array([2, -1]), np.array([3, 0, 1])),
            WHOLE,
            "edge",
        ),
    ]


def rounding(case: Case, truth: Any) -> float:
    """Return 1e-12 for each metre and radian, one of each added."""
    placements, q, tool = case.args
    metres = np.linalg.norm(placements[:, :3, 3], axis=1).sum() + np.linalg.norm(tool)
    return float(1e-12 * (1.0 + metres) * (1.0 + np.abs(q).sum()))


def velocities(figure: Any, shown: Shown) -> None:
    """Plot the arm, and at the tool point the velocity that each joint gives it."""
    placements, q, tool = shown.args
    frame, points = np.eye(4), [np.zeros(3)]
    for placement, angle in zip(placements, q, strict=True):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]])
        frame = frame @ placement @ turn
        points.append(frame[:3, 3])
    tip = frame[:3, 3] + frame[:3, :3] @ tool
    axes = figure.add_subplot(projection="3d")
    axes.plot(*np.array([*points, tip]).T, "-o", color="0.6", lw=2.0)
    for value, style in ((shown.got[0], YOURS), (shown.expected[0], RIGHT)):
        for i, column in enumerate(np.asarray(value, dtype=float)[:3].T):
            ends = np.column_stack((tip, tip + column))
            axes.plot(*ends, **(style | {"label": style["label"] if i == 0 else None}))
    axes.set(xlabel="x [m]", ylabel="y [m]", zlabel="z [m]")
    axes.legend(title="velocity of the tool, joint by joint", loc="upper left")


_FRAME = "frame = frame @ placement @ turn"
_TIP = "tip = frame[:3, 3] + frame[:3, :3] @ tool"
_LINEAR, _STACK = (
    "np.cross(axes, tip - np.array(points))",
    "np.vstack((linear.T, np.array(axes).T))",
)
_ANGLES = "for placement, angle in zip(placements, q, strict=True):"

SLIPS = slips(
    angular_rows_in_the_body=(
        _STACK,
        "np.vstack((linear.T, frame[:3, :3].T @ np.array(axes).T))",
        "The angular rows are in the axes of the last frame, the linear ones in those of the "
        "world. Libraries offer both, and a mixture steers nowhere: leave the axes z as they are "
        "in the world.",
    ),
    all_rows_in_the_body=(
        _STACK,
        "np.vstack((frame[:3, :3].T @ linear.T, frame[:3, :3].T @ np.array(axes).T))",
        "All rows are in the axes of the last frame (the body Jacobian). The task asks for the "
        "axes of the world: multiply by the rotation of the last frame, or do not multiply by "
        "its transpose.",
    ),
    millimetres=(
        _STACK,
        "np.vstack((1000.0 * linear.T, np.array(axes).T))",
        "The linear rows are in millimetres. That also changes the condition number a "
        "hundredfold, so say the unit whenever you quote one.",
    ),
    absolute_angles=(
        _ANGLES,
        "for placement, angle in zip(placements, np.diff(q, prepend=0.0), strict=True):",
        "The angles are treated as measured from a fixed direction. Each is measured in the frame "
        "of the joint before it: every joint turns all that comes after.",
    ),
    tool_forgotten=(
        _TIP,
        "tip = frame[:3, 3]",
        "The Jacobian is that of the last joint's origin: the tool's offset is missing. The "
        "angular rows do not see it, the linear ones do.",
    ),
    tool_not_turned=(
        _TIP,
        "tip = frame[:3, 3] + tool",
        "The tool's offset is added in the axes of the world. It is given in the last frame and "
        "turns with it.",
    ),
    tool_turned_back=(
        _TIP,
        "tip = frame[:3, 3] + frame[:3, :3].T @ tool",
        "The tool's offset is turned the wrong way: the rotation of the last frame takes what is "
        "given in it to the world, its transpose takes it back.",
    ),
    axis_of_another_letter=(
        "axes.append(frame[:3, 2])",
        "axes.append(frame[:3, 0])",
        "The joints turn about x. The axis is z, the third column of the rotation.",
    ),
    axis_from_a_row=(
        "axes.append(frame[:3, 2])",
        "axes.append(frame[2, :3])",
        "The axis is read from a row. The columns of a rotation are the frame's axes in the world; "
        "its rows are the world's in the frame.",
    ),
    arm_from_the_base=(
        _LINEAR,
        "np.cross(axes, np.tile(tip, (len(axes), 1)))",
        "Every joint swings the tool point about the origin. It swings it about itself: the arm "
        "is x - p_i, from the joint to the point.",
    ),
    cross_product_reversed=(
        _LINEAR,
        "np.cross(tip - np.array(points), axes)",
        "The linear rows have the wrong sign: it is axis cross arm, not arm cross axis.",
    ),
    angular_rows_first=(
        _STACK,
        "np.vstack((np.array(axes).T, linear.T))",
        "The angular rows stand above the linear ones. Textbooks differ on this; here the linear "
        "rows come first.",
    ),
    axis_of_the_frame_before=(
        "        " + _FRAME + "\n        axes.append(frame[:3, 2])\n",
        "        axes.append(frame[:3, 2])\n        " + _FRAME + "\n",
        "Joint i turns about the z axis of the frame before it. That is the convention of the "
        "classic DH table; here every joint turns about its own z, so read the axis after its "
        "placement.",
    ),
    point_of_the_frame_before=(
        "        " + _FRAME + "\n",
        "        points.append(frame[:3, 3])\n        " + _FRAME + "\n",
        "        points.append(frame[:3, 3])\n    tip",
        "    tip",
        "The points lag behind by one joint: a joint stands at the origin of its own frame, not "
        "of the one before it.",
    ),
    turned_before_placed=(
        _FRAME,
        "frame = frame @ turn @ placement",
        "The turn is applied before the placement, so that each joint turns about the z axis of "
        "the frame before it. The order is placement, then turn.",
    ),
    multiplied_from_the_left=(
        _FRAME,
        "frame = placement @ turn @ frame",
        "The transforms are multiplied in the wrong order. A frame seen from the one before it "
        "goes to the right: frame @ placement @ turn.",
    ),
    clockwise=(
        "[s, c, 0, 0]",
        "[-s, c, 0, 0]",
        "[[c, -s, 0, 0]",
        "[[c, s, 0, 0]",
        "The joints turn clockwise: the minus belongs to the sine in the first row.",
    ),
    degrees_for_radians=(
        "math.cos(angle), math.sin(angle)",
        "math.cos(math.radians(angle)), math.sin(math.radians(angle))",
        "The angles are treated as degrees. They come in radians: convert nothing.",
    ),
    axes_not_turned=(
        "axes.append(frame[:3, 2])",
        "axes.append(placement[:3, 2])",
        "Each axis is taken from its own placement, as seen from the frame before it. Carry the "
        "frames along and read the axis in the world.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        rounding,
        "cross products of a chain of rotations: only rounding is left",
        explain=coarse,
    ),
    examples=(
        "geometric_jacobian(np.eye(4)[None], np.array([0.0]), np.array([1.0, 0.0, 0.0]))",
        "geometric_jacobian(np.eye(4)[None], np.array([0.5]), np.array([1.0, 0.0, 0.5]))",
        "geometric_jacobian(np.array([np.eye(4), np.eye(4) + np.eye(4, k=3)]), "
        "np.array([0.0, 0.5]), np.array([1.0, 0.0, 0.0]))",
    ),
    picture=velocities,
    slips=SLIPS
    + coarse_slips("geometric_jacobian", "Near a singularity the small singular value is noise.")
    + value_slips("geometric_jacobian", in_part=False),
)
