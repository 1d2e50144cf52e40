"""Chapter 8's simulations: one policy on two arms, and faults that can be combined."""

from course.simulations.sim_to_real.arms import MODEL

__all__ = ["MODEL"]
