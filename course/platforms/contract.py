"""What a scene asks of a simulator, and what a simulator answers: the contract of this chapter.

An `Engine` builds a `Run` of a `Scene` at a step and with `Settings`; the run is stepped in the
engine's own loop and asked for state, energy and contacts. The course's own code is an engine like
the others (`course.platforms.own`); MuJoCo, Drake and PyBullet stand in `course.oracles`.

Conventions, the same for all engines (an adapter converts):

- Scenes of joints: `State.q` and `State.v` have shape (n,), in the order of the joints in the
  URDF text [rad, rad/s].
- Scenes of bodies: q is (7, N): centre of mass in the world [m] and the unit quaternion body to
  world, scalar first; v is (6, N): velocity of the centre of mass in the world [m/s], angular
  velocity in the body's own frame [rad/s]. Guided bodies (fingers) are told in the same way.
- Gravity is a vector. A slope is a level ground z = 0 under gravity that is turned.
- Energy is kinetic plus potential [J]; a mass at the world's origin has no potential energy.
- A step leads from a state to the next. `contacts()` are those of the last step that was taken:
  places and gaps as they were found for it (at its start), forces that acted during it, slip after
  it. Each is told once, one column each.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import metadata
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.check import count, invalid, one_of
from course.platforms.scenes import Scene
from course.platforms.state import Array as Array
from course.platforms.state import State as State
from course.rigid_body import quaternion

NAMES = ("as shipped", "fair")


@dataclass(frozen=True)
class Change:
    """One difference between an engine as shipped and its fair settings.

    Attributes:
        key: a short name, for `Settings.but`.
        what: the setting, as the engine's manual calls it.
        shipped, fair: its two values.
        reason: why the change is fair, one sentence.
        source: page of the engine's manual, with its version or year.
        kind: "bodies", "joints" or "all": the scenes that it acts on.
    """

    key: str
    what: str
    shipped: str
    fair: str
    reason: str
    source: str
    kind: str = "all"


@dataclass(frozen=True)
class Settings:
    """How an engine is run: one of two names, and what is asked for besides.

    Attributes:
        name: "as shipped" (nothing but the scene and the step is set) or "fair".
        scheme: one of the engine's `schemes`; "" for its first.
        but: keys of changes that are taken the other way: FAIR without one, or AS_SHIPPED with it.
        options: further options of the engine by name; what it doesn't know it refuses.
    """

    name: str = "fair"
    scheme: str = ""
    but: tuple[str, ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        one_of("settings.name", self.name, NAMES)

    def applies(self, key: str) -> bool:
        """Return whether the change of this key is made."""
        return (self.name == "fair") != (key in self.but)

    def using(self, scheme: str = "", but: tuple[str, ...] = (), **options: Any) -> Settings:
        """Return the same with another scheme, changes the other way, or further options."""
        return replace(
            self,
            scheme=scheme or self.scheme,
            but=(*self.but, *but),
            options={**self.options, **options},
        )

    def checked(self, engine: Engine, options: tuple[str, ...] = ()) -> str:
        """Return the scheme, after a look at all names.

        Raises:
            ValueError: for a scheme, a key or an option that the engine doesn't have.
        """
        for key in self.but:
            one_of("settings.but", key, [change.key for change in engine.changes])
        for option in self.options:
            one_of("settings.options", option, options)
        return one_of("settings.scheme", self.scheme or engine.schemes[0], engine.schemes)


AS_SHIPPED, FAIR = Settings("as shipped"), Settings("fair")


@dataclass(frozen=True, eq=False)
class ContactReport:
    """Contacts of the last step, one a column.

    Attributes:
        bodies: numbers of the first and the second body in `scene.bodies`, -1 for the ground,
            which is always first; shape (2, n).
        point: in the world, (3, n) [m].
        normal: unit vectors from the first to the second body, (3, n).
        gap: signed distance, negative in overlap, (n,) [m].
        force: on the second body, in the world, (3, n) [N].
        slip: velocity of the second relative to the first at the point, along the surface, (3, n)
            [m/s]; `slip_of` computes it.
    """

    bodies: NDArray[np.int64]
    point: Array
    normal: Array
    gap: Array
    force: Array
    slip: Array

    @property
    def normal_force(self) -> Array:
        """Along the normals, positive when it pushes, (n,) [N]."""
        return np.asarray(np.sum(self.force * self.normal, axis=0))

    @property
    def tangential_force(self) -> Array:
        """What is left of the forces, (3, n) [N]."""
        return np.asarray(self.force - self.normal_force * self.normal)

    def only(self, these: Any) -> ContactReport:
        """Return some of the contacts, by number or by a mask."""
        return ContactReport(
            self.bodies[:, these],
            self.point[:, these],
            self.normal[:, these],
            self.gap[these],
            self.force[:, these],
            self.slip[:, these],
        )


_NONE = np.zeros((3, 0))
NO_CONTACTS = ContactReport(_NONE[:2].astype(np.int64), _NONE, _NONE, _NONE[0], _NONE, _NONE)


def slip_of(q: Array, v: Array, bodies: NDArray[np.int64], point: Array, normal: Array) -> Array:
    """Return slip of contacts in a state of bodies, (3, n) [m/s], as `ContactReport` has it."""
    relative = np.zeros_like(point)
    for here, sign in zip(bodies, (-1.0, 1.0), strict=True):
        spin = quaternion.rotate(q[3:, here], v[3:, here])
        speed = v[:3, here] + quaternion.cross(spin, point - q[:3, here])
        relative += np.where(here >= 0, sign, 0.0) * speed
    return np.asarray(relative - np.sum(relative * normal, axis=0) * normal)


def reported(
    now: State, bodies: NDArray[np.int64], point: Array, normal: Array, gap: Array, force: Array
) -> ContactReport:
    """Return the report of contacts that an engine lists in any order, with their slip.

    Normals point from the first to the second, and forces act on the second, as it tells them.
    """
    turned = bodies[0] > bodies[1]
    bodies = np.where(turned, bodies[::-1], bodies)
    normal, force = np.where(turned, -normal, normal), np.where(turned, -force, force)
    slip = slip_of(now.q, now.v, bodies, point, normal)
    return ContactReport(bodies, point, normal, gap, force, slip)


class Run(ABC):
    """A built scene at its start. What an adapter writes."""

    scene: Scene
    dt: float

    def run(self, steps: int) -> None:
        """Advance by a number of steps, in the engine's own compiled loop where it has one.

        This alone is timed. A state that is no longer finite is a result and raises nothing.

        Args:
            steps: a non-negative integer; 0 changes nothing.

        Raises:
            ValueError: for any other number of steps, with every engine.
        """
        if count("steps", steps):
            self.advance(int(steps))

    @abstractmethod
    def advance(self, steps: int) -> None:
        """Take one step or more; `run` has checked the number."""

    @abstractmethod
    def state(self) -> State:
        """Return a copy of where it is."""

    def energy(self) -> float:
        """Return [J]; an engine that tells its own figure does so here."""
        return self.scene.energy(self.state())

    def contacts(self) -> ContactReport:
        """Return those of the last step; `NO_CONTACTS` before the first and in scenes of joints."""
        return NO_CONTACTS

    @abstractmethod
    def set_velocity(self, v: Array) -> None:
        """Give the bodies or joints these velocities, in the form of `State.v`."""

    def set_torque(self, torque: Array) -> None:
        """Torques of the joints [N m], (n,), kept until they are set again; joints only."""
        raise invalid("scene", self.scene.name, "a scene of joints")

    @abstractmethod
    def reset(self) -> None:
        """Back to the start in the way that the engine's manual shows, in the same world."""

    @abstractmethod
    def save(self) -> Any:
        """Return the whole state as the engine saves it, for `restore`."""

    @abstractmethod
    def restore(self, saved: Any) -> None:
        """Back to what `save` returned."""

    def close(self) -> None:  # noqa: B027 - most have nothing to give back
        """Give back what the engine holds (a client, a world)."""


class Engine(ABC):
    """A simulator. What an adapter writes.

    Attributes:
        name: as its makers write it.
        schemes: names of its time stepping schemes; the first is what it ships.
        package: that is installed, whose version counts.
        changes: all differences between as shipped and fair.
        loop: whether `run(steps)` is one call for all steps; else Python pays for each.
    """

    name: str
    package: str
    schemes: tuple[str, ...]
    changes: tuple[Change, ...] = ()
    loop: bool = True

    @abstractmethod
    def missing(self) -> str:
        """Return empty where it can run.

        Else one sentence: what to install, or that there is no wheel.
        """

    def version(self) -> str:
        """Return the installed version, or "" if there is none."""
        return "" if self.missing() else metadata.version(self.package)

    @abstractmethod
    def build(self, scene: Scene, dt: float, settings: Settings = FAIR) -> Run:
        """Return the scene at its start (its velocities included).

        Raises:
            ImportError: it is not installed.
            ValueError: for a step, a scheme or an option that it doesn't have, and for a scene
                that it cannot build; the text says why.
        """

    def available(self) -> bool:
        """Return whether it can run here."""
        return not self.missing()


def prepared(engine: Engine, scene: Scene, dt: float, settings: Settings = FAIR) -> Run:
    """Return the scene ready to be measured.

    A scene with a settling time first runs at rest for this time. Then its bodies get their
    initial velocities, and the time of the motion starts to count.
    """
    if not scene.settle:
        return engine.build(scene, dt, settings)
    run = engine.build(scene.at_rest(), dt, settings)
    run.run(max(1, round(scene.settle / dt)))
    run.set_velocity(scene.start.v)
    return run
