"""Chapter 6's simulations: a joint that answers a step, and a probe that touches a wall."""

from course.simulations.control.joint import MODEL

__all__ = ["MODEL"]
