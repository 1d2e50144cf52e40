"""Chapter 0's simulations: the stack as a graph, and what development costs."""

from course.simulations.role.stack import MODEL

__all__ = ["MODEL"]
