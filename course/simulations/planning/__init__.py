"""Chapter 5's simulation: planners grow their trees among obstacles that one places."""

from course.simulations.planning.growing import MODEL

__all__ = ["MODEL"]
