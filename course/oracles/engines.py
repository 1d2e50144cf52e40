"""The simulators of chapter 3 by name, those that are not installed among them."""

from __future__ import annotations

from course.oracles.drake import Drake
from course.oracles.mujoco_scenes import MuJoCo
from course.oracles.pybullet import PyBullet
from course.platforms import Engine
from course.platforms.own import Own


def engines() -> dict[str, Engine]:
    """Return all engines, the course's own first.

    Ask `available()` before building a scene with one.
    """
    result: tuple[Engine, ...] = (Own(), MuJoCo(), Drake(), PyBullet())
    return {engine.name: engine for engine in result}
