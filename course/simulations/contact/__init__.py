"""Chapter 2's simulation: one shape pressed against another by two contact models at once."""

from course.simulations.contact.touch import MODEL

__all__ = ["MODEL"]
