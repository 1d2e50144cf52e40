"""Robots for the tests: with the course's parts, some replaced, in this process."""

from __future__ import annotations

from typing import Any

from drills.robot.cell import World
from drills.robot.holders import course_part
from drills.robot.inside import Robot
from drills.robot.levels import exact_world, level
from drills.robot.play import Played, gather
from drills.robot.slots import NAMES, Part


def parts_with(**texts: str) -> list[Part]:
    """The course's parts, some replaced by a text of "yours"."""
    parts = []
    for name in NAMES:
        part = course_part(name)
        if name in texts:
            part = part._replace(source=texts[name], holder="yours")
        parts.append(part)
    return parts


def robot(number: int = 1, *, seed: int = 0, world: World | None = None, **texts: str) -> Robot:
    """A robot in this process, for our own texts."""
    return Robot(parts_with(**texts), level(number), world or exact_world(), seed, limit=0.0)


def played(number: int, tasks: int, **options: Any) -> Played:
    """Some tasks in this process."""
    one = robot(number, **options)
    return gather([one.play(k) for k in range(tasks)])
