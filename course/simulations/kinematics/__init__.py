"""Chapter 4's simulations: an arm that follows its target, and one that moves in its null space."""

import importlib
import pkgutil
from typing import TYPE_CHECKING

from course.check import one_of
from course.simulations.kinematics.arm import MODEL

if TYPE_CHECKING:
    from course.simulations.panel import Panel

__all__ = ["MODEL", "simulation"]


def simulation(name: str = "arm") -> "Panel":
    """Return a simulation of this chapter as a widget for a notebook; it starts paused.

    Args:
        name: the module that has it: arm or elbow.

    Raises:
        ValueError: there is no such simulation.
    """
    from course.simulations.panel import Panel

    one_of("name", name, [each.name for each in pkgutil.iter_modules(__path__)])
    return Panel(importlib.import_module(f"{__name__}.{name}").MODEL)
