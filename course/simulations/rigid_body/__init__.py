"""Chapter 1's simulations: the bouncing box, and small ones that show one idea each."""

import importlib
import pkgutil
from typing import TYPE_CHECKING

from course.check import one_of
from course.simulations.rigid_body.bouncing_box import MODEL

if TYPE_CHECKING:
    from course.simulations.panel import Panel

__all__ = ["MODEL", "simulation"]


def simulation(name: str = "bouncing_box") -> "Panel":
    """Return a simulation of this chapter as a widget for a notebook; it starts paused.

    Args:
        name: the module that has it: bouncing_box, free_body, flip, top, gimbal, double_cover,
            spring or tunnelling.

    Raises:
        ValueError: there is no such simulation.
    """
    from course.simulations.panel import Panel

    one_of("name", name, [each.name for each in pkgutil.iter_modules(__path__)])
    return Panel(importlib.import_module(f"{__name__}.{name}").MODEL)
