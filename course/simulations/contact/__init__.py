"""Chapter 2's simulation: one shape pressed against another by two contact models at once."""

from typing import TYPE_CHECKING

from course.simulations.contact.touch import MODEL

if TYPE_CHECKING:
    from course.simulations.panel import Panel

__all__ = ["MODEL", "simulation"]


def simulation() -> "Panel":
    """The simulation of this chapter as a widget for a notebook; it starts paused."""
    from course.simulations.panel import Panel

    return Panel(MODEL)
