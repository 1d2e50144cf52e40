"""Chapter 1's simulations: the bouncing box, and small ones that show one idea each."""

from course.simulations.rigid_body.bouncing_box import MODEL

__all__ = ["MODEL"]
