"""Chapter 2's simulations: one of two shapes that touch, and small ones that show one idea each."""

from course.simulations.contact.touch import MODEL

__all__ = ["MODEL"]
