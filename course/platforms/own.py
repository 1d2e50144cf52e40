"""The course's own code as an engine: chapters 1, 2 and 4 behind the contract of this chapter.

Joints go through chapter 4's articulated body algorithm and one of chapter 1's integrators, in one
compiled loop. Bodies in contact go through chapter 2: contacts, one problem for each group that
touches, Newton's method on the round cone; Python pays for every step there.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from course import contact, kinematics, rigid_body
from course.check import invalid, one_of, positive, vector
from course.platforms.bodies import free_velocity, freedom, step_of
from course.platforms.contract import (
    FAIR,
    NO_CONTACTS,
    Array,
    ContactReport,
    Engine,
    Run,
    Settings,
    State,
    reported,
)
from course.platforms.scenes import Scene
from course.rigid_body.integrators import System, retract
from course.rigid_body.spatial import free_flight_acceleration

# Models of chapter 2 that start from the impulses of the last step.
WARM = ("pgs", "coulomb", "convex")
NEAR = 1e-3  # distance from which two bodies are watched, besides what they travel in a step [m]


class Own(Engine):
    """Chapters 1, 2 and 4. Nothing has to be changed to make it fair.

    Options for bodies in contact: `model`, one of chapter 2's, and `recovery`, the share of a
    penetration that a step takes back.
    """

    name, package = "own code", "robotics-simulation-course"
    schemes = ("semi_implicit_euler", "rk4", "implicit_midpoint", "velocity_verlet")

    def missing(self) -> str:
        """Return "": the course's own code is always there."""
        return ""

    def build(self, scene: Scene, dt: float, settings: Settings = FAIR) -> Run:
        """Return a run without contact where nothing can touch, else one with a contact model."""
        scheme = settings.checked(self, ("model", "recovery"))
        positive("dt", dt, unit="s")
        # Without shapes nothing can touch: the integrators of chapter 1 do, at any order.
        if scene.chain or all(body.half is None for body in scene.bodies):
            if len(scene.bodies) > 1:
                raise invalid("scene", scene.name, "one body, where none touches anything")
            return Smooth(scene, dt, scheme)
        # With contacts only the scheme of chapter 2's time stepping exists.
        one_of("settings.scheme", scheme, self.schemes[:1])
        return Touching(scene, dt, **settings.options)


class Smooth(Run):
    """Joints, or one free body: a `System` of chapter 1."""

    time: float
    q: Array
    v: Array

    def __init__(self, scene: Scene, dt: float, scheme: str) -> None:
        self.scene, self.dt, self.scheme = scene, dt, scheme
        self.loop = free_flight_acceleration
        if scene.chain:
            self.loop = kinematics.acceleration
            self.params = kinematics.pack(scene.chain, gravity=scene.gravity)
        else:
            self.params = np.array([*scene.gravity, *scene.bodies[0].moments])
        self.reset()

    def reset(self) -> None:
        """Return to the start of the scene."""
        start = self.scene.start
        self.restore((0.0, start.q.reshape(len(start.q)), start.v.reshape(len(start.v))))

    def advance(self, steps: int) -> None:
        """Integrate n steps with the scheme of chapter 1."""
        system = System(self.scene.name, self.loop, self.params, self.q, self.v)
        end = rigid_body.simulate(system, self.scheme, self.dt, steps)
        self.q, self.v, self.time = end.q[-1], end.v[-1], self.time + steps * self.dt

    def state(self) -> State:
        """Return the time, positions and velocities as copies."""
        shape = (len(self.q),) if self.scene.chain else (len(self.q), 1)
        return State(self.time, self.q.reshape(shape).copy(), self.v.reshape(-1, *shape[1:]).copy())

    def set_velocity(self, v: Array) -> None:
        """Replace the velocities, joint rates or those of the bodies."""
        self.v = vector("v", v).reshape(self.v.shape).copy()

    def set_torque(self, torque: Array) -> None:
        """Hold joint torques, shape (n,) [N m], until the next call."""
        if not self.scene.chain:
            return super().set_torque(torque)
        self.params = kinematics.pack(self.scene.chain, torque, self.scene.gravity)

    def save(self) -> Any:
        """Return a copy of the state."""
        return self.time, self.q.copy(), self.v.copy()

    def restore(self, saved: Any) -> None:
        """Return to a state that `save` returned."""
        self.time, self.q, self.v = saved[0], saved[1].copy(), saved[2].copy()


class Touching(Run):
    """Boxes in contact: velocities with the impulses of a contact model, then places with them."""

    time: float
    q: Array
    v: Array
    memory: dict[Any, Array]

    def __init__(
        self, scene: Scene, dt: float, model: str = "coulomb", recovery: float = 0.2
    ) -> None:
        self.scene, self.dt, self.recovery = scene, dt, recovery
        self.model = one_of("model", model, contact.MODELS)
        kinds = {body.half: contact.box(np.array(body.half)) for body in scene.bodies}
        self.shapes = [kinds[body.half] for body in scene.bodies]
        if scene.ground:
            self.shapes.insert(0, contact.plane())
        self.reset()

    def reset(self) -> None:
        """Return to the start of the scene, without contacts or impulses to start from."""
        start = self.scene.start
        self.restore((0.0, start.q, start.v, NO_CONTACTS, {}))

    def advance(self, steps: int) -> None:
        """Advance n steps, solving the contacts in each."""
        for _ in range(steps):
            self._step()
        self.time += steps * self.dt

    def _step(self) -> None:
        """Free velocities, contacts, impulses of each group that touches, places."""
        scene, dt, before = self.scene, self.dt, State(0.0, self.q, self.v)
        free = free_velocity(scene, before, dt)
        pose = self.q
        if scene.ground:
            # The ground is shape 0, at the origin; below it has the number -1.
            pose = np.column_stack((np.array([0.0, 0, 0, 1, 0, 0, 0]), self.q))
        # Speculative contacts: within the travel of a step anything may touch.
        # The largest speed bounds how far two bodies approach each other in a step.
        travel = float(np.max(np.abs(free[:3]))) * dt
        result = contact.contacts(self.shapes, pose, NEAR + 2.0 * travel)
        bodies, nothing = result.bodies - int(scene.ground), np.zeros_like(result.point)
        report = ContactReport(
            bodies, result.point, result.normal, result.distance, nothing, nothing
        )
        v, force, memory = free.copy(), nothing.copy(), {}
        # Project the free velocity of a guided body on its guide.
        for i, body in enumerate(scene.bodies):
            if body.guide is not None:
                v[:, i] = freedom(body) @ (freedom(body).T @ free[:, i])
        # Islands: bodies that touch, directly or through others, are solved together.
        for members in self._groups(bodies):
            ours = np.flatnonzero(np.isin(bodies[1], members))
            if not ours.size:
                continue
            # One contact problem of chapter 2 for the island: Delassus matrix, gaps and free
            # velocities.
            step = step_of(scene, before, free, report.only(ours), dt, members, self.recovery)
            # Warm start: the impulses of the last step, if the same bodies touch in the same order.
            key = tuple(bodies[:, ours].ravel())
            start = {"start": self.memory.get(key)} if self.model in WARM else {}
            done = contact.solve(self.model, step.problem, **start)
            memory[key], force[:, ours] = done.impulses, step.force(done.impulses)
            v[:, members] = step.spread(done.velocity)
        now = State(0.0, self.q, v)
        self.last = reported(now, bodies, result.point, result.normal, result.distance, force)
        # Positions follow the new velocities (semi-implicit Euler on the group).
        self.q, self.v, self.memory = retract(self.q, dt * v), v, memory

    def _groups(self, pairs: Any) -> list[list[int]]:
        """Return bodies that hold each other, directly or through others; the ground parts them."""
        of = list(range(len(self.scene.bodies)))

        def root(i: int) -> int:
            # Follow the parents to the island's representative.
            while of[i] != i:
                i = of[i]
            return i

        # Union-find; the ground, index -1, does not join islands.
        for i, j in pairs.T:
            if i >= 0:
                low, high = sorted((root(i), root(j)))
                of[high] = low
        groups: dict[int, list[int]] = {}
        for i in range(len(of)):
            groups.setdefault(root(i), []).append(i)
        return list(groups.values())

    def state(self) -> State:
        """Return the time, poses and velocities as copies."""
        return State(self.time, self.q.copy(), self.v.copy())

    def contacts(self) -> ContactReport:
        """Return the contacts and forces of the last step."""
        return self.last

    def set_velocity(self, v: Array) -> None:
        """Replace the velocities of the bodies."""
        self.v = vector("v", v, self.v.shape).copy()

    def save(self) -> Any:
        """Return a copy of the state, with the impulses that the next step starts from."""
        return self.time, self.q.copy(), self.v.copy(), self.last, dict(self.memory)

    def restore(self, saved: Any) -> None:
        """Return to a state that `save` returned, so that the same steps follow."""
        self.time, q, v, self.last, memory = saved
        self.q, self.v, self.memory = q.copy(), v.copy(), dict(memory)
