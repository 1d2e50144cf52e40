"""Chapter 4's simulations: an arm that follows its target, and one that moves in its null space."""

from course.simulations.kinematics.arm import MODEL

__all__ = ["MODEL"]
