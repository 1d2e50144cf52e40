"""The claims of chapter 1, section by section; importing a section registers its claims."""

from course.derivations.rigid_body import energy, flight, loop, methods, mujoco, rotation, tops

__all__ = ["energy", "flight", "loop", "methods", "mujoco", "rotation", "tops"]
