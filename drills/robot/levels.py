"""The levels: what each one asks, what usually breaks there, and which success passes it."""

from __future__ import annotations

from typing import Any

from drills.robot.cell import Level, World
from drills.robot.records import Cell

_SENSOR: dict[str, Any] = {"noise": 0.002, "lost_pixels": 0.02, "marker": 0.0005, "offset": 0.006}
_LATE: dict[str, Any] = {**_SENSOR, "latency": 0.1, "jitter": 0.03}
_MOVING: dict[str, Any] = {**_LATE, "speed": 0.04}
_CLUTTER: dict[str, Any] = {**_MOVING, "jitter": 0.08, "posts": 2, "clutter": 3, "lost": 0.2}

LEVELS = (
    Level(
        1,
        "a still part, perfect sensing",
        "Signs, frames and units: a part that is only almost right is wrong every time.",
        0.95,
    ),
    Level(
        2,
        "sensor noise",
        "Perception that trusts single pixels, and an arm that trusts the camera's calibration.",
        0.95,
        **_SENSOR,
    ),
    Level(
        3,
        "latency",
        "Tracking with a gain that was chosen for fresh images: the tip starts to oscillate.",
        0.93,
        **_LATE,
    ),
    Level(
        4,
        "a moving part",
        "An old measurement that is used as if it were new: the gripper closes behind the part.",
        0.90,
        **_MOVING,
    ),
    Level(
        5,
        "clutter and dropped images",
        "Other objects in the image, more posts around the arm, gaps in the stream of messages.",
        0.85,
        **_CLUTTER,
    ),
    Level(
        6,
        "a hidden fault",
        "You do. The budget is switched off: find the stage in the log.",
        0.0,
        **_LATE,
    ),
)
CELL = Cell()


def level(number: int) -> Level:
    """Return a level by its number, from 1."""
    return LEVELS[number - 1]


def exact_world(cell: Cell = CELL) -> World:
    """Return an arm that is as the robot's programs believe, with friction in its joints.

    Friction belongs to this arm alone. Chapter 11's arm has none, so that its figures and
    recordings stay what they are.
    """
    return World(
        cell.lengths,
        cell.masses,
        damping=cell.viscous,
        coulomb=cell.coulomb,
        transition=cell.transition,
    )
