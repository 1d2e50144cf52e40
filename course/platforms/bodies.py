"""A step of boxes as a `Problem` of chapter 2, made from the contacts that any engine reports.

So one set of residuals judges them all, and the course's own engine is stepped by the same
equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from course import contact
from course.platforms.contract import Array, ContactReport, State
from course.platforms.scenes import Body, Scene
from course.rigid_body.quaternion import conjugate, cross, rotate


def freedom(body: Body) -> Array:
    """Return columns of a body's freedom in the six numbers of its velocity, (6, 6) or (6, 1)."""
    if body.guide is None:
        return np.eye(6)
    return np.append(body.guide, np.zeros(3))[:, None]


def contact_frame(normal: Array) -> Array:
    """Return three unit vectors of each contact, the normal first: shape (3 vectors, 3, n)."""
    # Any axis that is not nearly parallel to the normal completes the frame.
    aside = np.abs(normal[0]) < 0.5
    other = np.stack((aside, ~aside, np.zeros(aside.shape))).astype(float)
    second = cross(normal, other)
    second /= np.linalg.norm(second, axis=0)
    return np.stack((normal, cross(second, normal), second))


def free_velocity(scene: Scene, state: State, dt: float) -> Array:
    """Return velocities after a step without contact, (6, N).

    They include gravity, constant forces and the gyroscopic term.
    """
    mass = np.array([body.mass for body in scene.bodies])
    moments = np.array([body.moments for body in scene.bodies]).T
    force = np.array([body.force for body in scene.bodies]).T
    # Euler's equations: the gyroscopic term in principal axes.
    spin = state.v[3:]
    turning = cross(spin, moments * spin) / moments
    pull = force / mass + np.reshape(scene.gravity, (3, 1))
    return np.asarray(state.v + dt * np.vstack((pull, -turning)))


@dataclass(frozen=True, eq=False)
class Step:
    """One step of some bodies of a scene.

    Attributes:
        problem: for chapter 2; its velocities are those of the members one after the other.
        frame: of the contacts, as `contact_frame` has it.
        members: numbers of the bodies.
        basis: their `freedom`.
    """

    problem: contact.Problem
    frame: Array
    members: Sequence[int]
    basis: list[Array]

    def impulses(self, force: Array) -> Array:
        """Return impulses (n, 3) in the contacts' frames from forces (3, n) in the world."""
        return np.asarray(self.problem.dt * np.einsum("dik,ik->kd", self.frame, force))

    def force(self, impulses: Array) -> Array:
        """Return forces (3, n) in the world from impulses (n, 3) in the contacts' frames."""
        return np.asarray(np.einsum("dik,kd->ik", self.frame, impulses) / self.problem.dt)

    def spread(self, velocity: Array) -> Array:
        """Return velocities of the members (6, m) from generalised ones (nv,)."""
        # The generalised velocities lie one body after the other, six or one each.
        parts = np.split(velocity, np.cumsum([b.shape[1] for b in self.basis])[:-1])
        return np.stack([b @ part for b, part in zip(self.basis, parts, strict=True)], axis=1)


def step_of(
    scene: Scene,
    state: State,
    free: Array,
    report: ContactReport,
    dt: float,
    members: Sequence[int] | None = None,
    recovery: float = 0.2,
) -> Step:
    """Return the step from a state with the contacts of a report, which must all be of the members.

    Args:
        scene: the scene.
        state: before the step.
        free: velocities after it without contact, (6, N).
        report: one or more contacts; forces and slip are not looked at.
        dt: step [s].
        members: bodies that take part; None for all.
        recovery: as for `Problem`.
    """
    members = range(len(scene.bodies)) if members is None else members
    basis = [freedom(scene.bodies[i]) for i in members]
    ends = np.cumsum([0, *(b.shape[1] for b in basis)])
    frame = contact_frame(report.normal)
    jacobian: Any = np.zeros((report.gap.size, 3, ends[-1]))
    # Each contact row is +1 for one body and -1 for the other, with the lever arm in the body's
    # axes.
    for here, sign in zip(report.bodies, (-1.0, 1.0), strict=True):
        # Angular velocities are in the body's axes, so the moment arm is turned back into them.
        arm, back = report.point - state.q[:3, here], conjugate(state.q[3:, here])
        rows = np.stack([np.vstack((d, rotate(back, cross(arm, d)))) for d in frame])  # (3, 6, n)
        for i, b, low, high in zip(members, basis, ends, ends[1:], strict=False):
            ours = np.flatnonzero(here == i)
            jacobian[ours, :, low:high] += sign * np.einsum("dvk,vf->kdf", rows[:, :, ours], b)
    # Generalised masses: a guided body keeps its component along the guide only.
    mass = np.concatenate(
        [
            np.array([scene.bodies[i].mass] * 3 + list(scene.bodies[i].moments)) @ b**2
            for i, b in zip(members, basis, strict=True)
        ]
    )
    # Projected on the guide, or all six numbers where there is none.
    before, after = (
        np.concatenate([v[:, i] @ b for i, b in zip(members, basis, strict=True)])
        for v in (state.v, free)
    )
    friction = np.full((report.gap.size, 2), scene.friction)
    problem = contact.Problem(
        np.diag(mass), jacobian, before, after, report.gap, friction, dt, 0.0, recovery
    )
    return Step(problem, frame, members, basis)
