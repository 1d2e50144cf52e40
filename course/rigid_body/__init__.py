"""Chapter 1: rigid bodies, rotations, integrators.

The public names of the chapter; each lives in the file of its section.

The chapter's algorithms, and the functions of their steps:

- Munthe-Kaas Runge-Kutta (Munthe-Kaas and Owren, 1999): `integrators.rk4`; `retract` moves along
  the group, `bracket` corrects its stages.
- Implicit midpoint with simplified Newton iterations (Hairer, Lubich and Wanner, 2006):
  `integrators.implicit_midpoint`.
- Event location by safeguarded regula falsi (Dowell and Jarratt, 1971): `events.time_of_event`;
  `events.step_with_event` cuts the step and continues it.
- Impact with Coulomb friction and energetic restitution (Stronge, 1990): `planar_contact.impact`;
  `first_impact` finds the time, `sustain` holds a resting contact, `planar._advance` is the loop.
- Fixed-step loop with an accumulator (Fiedler, 2004): `loop.FixedStepLoop.advance`, its phases in
  `_step`, `_expose`, `_control` and `_render`.

Examples:
    >>> from course.rigid_body import problems, simulate
    >>> top = problems.tumble()
    >>> run = simulate(top.system, "rk4", dt=1e-3, steps=20_000)
    >>> bool(top.error(run.q[-1]) < 1e-9)  # rad, after 20 s
    True
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
