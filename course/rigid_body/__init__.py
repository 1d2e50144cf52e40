"""Chapter 1: rigid bodies, rotations, integrators.

The public names of the chapter; each lives in the file of its section.
"""

from course.rigid_body.integrators import (
    INTEGRATORS,
    Integrator,
    System,
    Trajectory,
    evaluations_per_step,
    explicit_euler,
    explicit_midpoint,
    implicit_midpoint,
    retract,
    rk4,
    rk4_renormalised,
    semi_implicit_euler,
    simulate,
    velocity_verlet,
)
from course.rigid_body.planar import PlanarBody, advance_boxes, step_boxes
from course.rigid_body.spatial import RigidBody, advance_bodies

__all__ = [
    "INTEGRATORS",
    "Integrator",
    "PlanarBody",
    "RigidBody",
    "System",
    "Trajectory",
    "advance_bodies",
    "advance_boxes",
    "evaluations_per_step",
    "explicit_euler",
    "explicit_midpoint",
    "implicit_midpoint",
    "retract",
    "rk4",
    "rk4_renormalised",
    "semi_implicit_euler",
    "simulate",
    "step_boxes",
    "velocity_verlet",
    "warm",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    import numpy as np

    from course.rigid_body.problems import all_problems

    for problem in all_problems().values():
        for name in INTEGRATORS:
            simulate(problem.system, name, 1e-3, 1)
    q = np.zeros((7, 2))
    q[3] = 1.0
    advance_bodies(q, np.zeros((6, 2)), (1.0, 2.0, 3.0), 1e-3, 1)
    PlanarBody().step(1e-3)
