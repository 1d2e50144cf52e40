"""Chapter 5's simulation: planners grow their trees among obstacles that one places."""

from typing import TYPE_CHECKING

from course.check import one_of
from course.simulations.planning.growing import MODEL

if TYPE_CHECKING:
    from course.simulations.panel import Panel

__all__ = ["MODEL", "simulation"]


def simulation(preset: str = "Among obstacles") -> "Panel":
    """Return the simulation of this chapter as a widget for a notebook; it starts paused.

    Args:
        preset: what it begins with, one of its presets.

    Raises:
        ValueError: there is no such preset.
    """
    from course.simulations.panel import Panel

    one_of("preset", preset, MODEL.presets)
    panel = Panel(MODEL)
    panel.choose(preset)
    return panel
