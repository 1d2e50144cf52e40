"""Chapter 6's simulations: a joint that answers a step, and a probe that touches a wall."""

import importlib
import pkgutil
from typing import TYPE_CHECKING

from course.check import one_of
from course.simulations.control.joint import MODEL

if TYPE_CHECKING:
    from course.simulations.panel import Panel

__all__ = ["MODEL", "simulation"]


def simulation(name: str = "joint", preset: str = "") -> "Panel":
    """Return a simulation of this chapter as a widget for a notebook; it starts paused.

    Args:
        name: the module that has it: joint or probe.
        preset: what it begins with, one of its presets; the first one if empty.

    Raises:
        ValueError: there is no such simulation or preset.
    """
    from course.simulations.panel import Panel

    one_of("name", name, [each.name for each in pkgutil.iter_modules(__path__)])
    panel = Panel(importlib.import_module(f"{__name__}.{name}").MODEL)
    if preset:
        panel.choose(one_of("preset", preset, panel.model.presets))
    return panel
