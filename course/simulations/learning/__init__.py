"""Chapter 9's simulations: a point that learns while one watches, and heads that clone two ways."""

import importlib
import pkgutil
from typing import TYPE_CHECKING

from course.check import one_of
from course.simulations.learning.point import MODEL

if TYPE_CHECKING:
    from course.simulations.panel import Panel

__all__ = ["MODEL", "simulation"]


def simulation(name: str = "point") -> "Panel":
    """Return a simulation of this chapter as a widget for a notebook; it starts paused.

    Args:
        name: the module that has it: point or two_ways.

    Raises:
        ValueError: there is no such simulation.
    """
    from course.simulations.panel import Panel

    one_of("name", name, [each.name for each in pkgutil.iter_modules(__path__)])
    return Panel(importlib.import_module(f"{__name__}.{name}").MODEL)
