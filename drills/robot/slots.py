"""The table of slots: which exercise fills which one, in which stage, and what it returns."""

from __future__ import annotations

from typing import Any, NamedTuple

YOURS, COURSE = "yours", "course"  # holders of a slot; the others are names of libraries
STAGES = ("perception", "estimation", "kinematics", "planning", "control", "physics")


class Slot(NamedTuple):
    """A position in the robot that one exercise fills.

    Attributes:
        name: of the exercise, and of the slot.
        stage: one of `STAGES`.
        entry: name of the function.
        does: what the part does in the robot, a few words.
        returns: shapes of the results; None stands for any count, () for a number.
        every: its promises are checked at the first three calls of a task and at each n-th later.
    """

    name: str
    stage: str
    entry: str
    does: str
    returns: tuple[tuple[int | None, ...], ...]
    every: int = 1


SLOTS = (
    Slot("back_project", "perception", "back_project", "depth image to points", ((3, None),), 7),
    Slot("plane_ransac", "perception", "plane_ransac", "finds the table", ((4,), (None,), ()), 7),
    Slot("dbscan", "perception", "dbscan", "separates the objects", ((None,),), 7),
    Slot("rigid_fit", "perception", "rigid_fit", "first pose of the part", ((3, 3), (3,)), 9),
    Slot(
        "point_to_plane_step",
        "perception",
        "point_to_plane_step",
        "refines the pose",
        ((3, 3), (3,)),
        9,
    ),
    Slot(
        "to_the_present",
        "estimation",
        "to_the_present",
        "brings an old message to now",
        ((4,), (4, 4)),
    ),
    Slot("visual_gain", "estimation", "visual_gain", "chooses the tracking gain", ((), ()), 4),
    Slot("two_link_ik", "kinematics", "two_link_ik", "joint angles for a position", ((2, 2),)),
    Slot(
        "jacobian", "kinematics", "geometric_jacobian", "tip velocity per joint rate", ((6, 2),), 4
    ),
    Slot("damped_step", "kinematics", "damped_step", "corrects the tip a little", ((2,),), 4),
    Slot("edge_check", "planning", "edge_check", "is a straight motion free?", ((),)),
    Slot(
        "rrt_connect", "planning", "rrt_connect", "finds a way around the posts", ((None, 2), (2,))
    ),
    Slot("shortcut", "planning", "shortcut", "cuts corners", ((None, 2),)),
    Slot("trapezoid", "planning", "trapezoid", "times the motion", ((), (2, None), (2, None)), 2),
    Slot(
        "computed_torque", "control", "computed_torque", "torques that follow a motion", ((2,),), 97
    ),
    Slot("lqr", "control", "lqr", "gains of the joint loops", ((1, 2),)),
    Slot("rnea_planar", "control", "rnea_planar", "torques that hold the arm", ((2,),), 53),
    Slot(
        "friction_torque",
        "control",
        "friction_torque",
        "torques against joint friction",
        ((2,),),
        23,
    ),
    Slot("contact_step", "physics", "contact_step", "the released part on the table", ((2,), (2,))),
    Slot("verlet", "physics", "verlet_step", "moves the arm by one tick", ((2,), (2,), (2,)), 97),
)

NAMED = {slot.name: slot for slot in SLOTS}
NAMES = tuple(NAMED)
# The functions of `records.Stages`: a file of your own may replace one.
FUNCTIONS = {
    "perceive": "perception",
    "estimate": "estimation",
    "choose_gain": "estimation",
    "reach": "kinematics",
    "correct": "kinematics",
    "plan": "planning",
    "gains": "control",
    "control": "control",
    "move": "physics",
    "release": "physics",
}


# Shapes of what these functions return, as `Slot.returns`.
FUNCTION_SHAPES: dict[str, tuple[tuple[int | None, ...], ...]] = {
    "perceive": ((2,), (), ()),
    "estimate": ((2,), (2,), (4, 4)),
    "choose_gain": ((),),
    "reach": ((None, 2),),
    "correct": ((2,),),
    "plan": ((None, 2), (), (None, 2), (None, 2), (None, 2)),
    "gains": ((2,), (2,)),
    "control": ((2,),),
    "move": ((2,), (2,)),
    "release": ((2,),),
}


def fits(shape: tuple[int, ...], expected: tuple[int | None, ...]) -> bool:
    """Return whether an array has an expected shape; None stands for any count."""
    return len(shape) == len(expected) and all(
        n is None or n == m for n, m in zip(expected, shape, strict=True)
    )


def of_stage(stage: str) -> list[Slot]:
    """Return the slots of a stage, in the order of the data."""
    return [slot for slot in SLOTS if slot.stage == stage]


def stage_of(part: str) -> str:
    """Return the stage of a slot, or of a function of `records.Stages`."""
    return NAMED[part].stage if part in NAMED else FUNCTIONS[part]


class Part(NamedTuple):
    """What fills a slot, or replaces a whole function of `records.Stages`, as text.

    Attributes:
        slot: name of the slot or of the function.
        holder: "yours", "course", or the name of a library.
        source: Python text that defines the entry.
        entry: name of the function.
        filename: as messages name it.
    """

    slot: str
    holder: str
    source: str
    entry: str
    filename: str

    def plain(self) -> list[Any]:
        """Return it as data for a pipe."""
        return list(self)
