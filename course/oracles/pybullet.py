"""PyBullet asked for the scenes of chapter 3.

Python pays for one call a step here, and for another one for every constant force or torque, which
PyBullet forgets after each call. (PyBullet's `numSubSteps` would make several equal steps in one
call. It stays at its default, so that the torque of a controller can change at each step.)

PyBullet prints while it is imported and while it reads a model, and keeps its worlds in the
library: every run has a client of its own, whose number goes with each call, and what is printed is
caught (`quiet`).
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from course.check import finite, invalid, positive
from course.libraries import import_error
from course.oracles.quiet import quiet
from course.platforms import FAIR, NO_CONTACTS, Change, ContactReport, Engine
from course.platforms.contract import Array, Run, Settings, State, reported
from course.platforms.scenes import Scene
from course.rigid_body.quaternion import conjugate, rotate

OPTIONS = ("numSolverIterations", "enableConeFriction")  # of `setPhysicsEngineParameter`
_MANUAL = "PyBullet Quickstart Guide (2023), "
_GROUND = 50.0  # half side of the ground [m]


def library() -> ModuleType:
    """Return PyBullet.

    Raises:
        ImportError: it is not installed; the message names the package.
    """
    try:
        with quiet():
            import pybullet
    except ImportError as error:
        if isinstance(error, ModuleNotFoundError) and sys.version_info >= (3, 12):
            raise ModuleNotFoundError(
                f"this needs PyBullet, which has no wheel for Python 3.{sys.version_info.minor}: "
                "use Python 3.11, and there pip install 'pybullet>=3.2.7'"
            ) from error
        install = "make platforms, or pip install 'pybullet>=3.2.7'"
        raise import_error("PyBullet", install, error) from error
    return pybullet


class PyBullet(Engine):
    """PyBullet, Bullet's multibody dynamics from Python (Coumans and Bai)."""

    name, package = "PyBullet", "pybullet"
    schemes, loop = ("semi-implicit Euler",), False
    changes = (
        Change(
            "friction",
            "lateralFriction",
            "multiplies both: mu and mu make mu^2",
            "the square root of mu on both",
            "So the coefficient of the pair is the one of the scene.",
            _MANUAL + "changeDynamics",
            "bodies",
        ),
        Change(
            "damping",
            "linearDamping, angularDamping",
            "0.04",
            "0",
            "No scene has air: what moves freely keeps its energy.",
            _MANUAL + "changeDynamics",
        ),
        Change(
            "motors",
            "velocity motors of joints",
            "on",
            "force 0",
            "No scene has motors: a joint is free unless a torque is asked for.",
            _MANUAL + "setJointMotorControl2",
            "joints",
        ),
        Change(
            "inertia",
            "URDF_USE_INERTIA_FROM_FILE",
            "off",
            "on",
            "Else it computes inertias from collision shapes, which the file may not contain.",
            _MANUAL + "loadURDF",
            "joints",
        ),
    )

    def missing(self) -> str:
        """Return why PyBullet cannot be imported, or an empty text."""
        try:
            library()
        except ImportError as error:
            return str(error)
        return ""

    def build(self, scene: Scene, dt: float, settings: Settings = FAIR) -> PyBulletRun:
        """Return a run of the scene in PyBullet, in a client of its own."""
        return PyBulletRun(self, scene, dt, settings)


class PyBulletRun(Run):
    """A client with its world.

    Attributes:
        client: its number.
        bodies: PyBullet's numbers of the scene's bodies, or of the arm.
    """

    def __init__(self, engine: PyBullet, scene: Scene, dt: float, settings: Settings) -> None:
        self._lib = library()
        settings.checked(engine, OPTIONS)
        self.scene, self.dt, self._settings = scene, positive("dt", dt, unit="s"), settings
        self.bodies: list[int] = []
        self._ground, self._steps = -2, 0
        self._links: list[int] = []
        self._torque = np.zeros(len(scene.joints))
        self._forces: list[tuple[int, list[float]]] = []
        with quiet():
            self.client = self._lib.connect(self._lib.DIRECT)
            self._ask("setGravity", *scene.gravity)
            self._ask("setTimeStep", dt)
            if settings.options:
                self._ask("setPhysicsEngineParameter", **settings.options)
            if scene.urdf:
                self._load()
            else:
                self._add_bodies()
        self.reset()

    def _ask(self, name: str, *arguments: Any, **named: Any) -> Any:
        return getattr(self._lib, name)(*arguments, physicsClientId=self.client, **named)

    # --- building -----------------------------------------------------------------------------

    def _load(self) -> None:
        lib = self._lib
        flags = lib.URDF_USE_INERTIA_FROM_FILE if self._settings.applies("inertia") else 0
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "model.urdf")
            # PyBullet loads a URDF only from a file.
            path.write_text(self.scene.urdf, encoding="utf-8")
            arm = self._ask("loadURDF", str(path), useFixedBase=True, flags=flags)
        self.bodies.append(arm)
        count = self._ask("getNumJoints", arm)
        result = [self._ask("getJointInfo", arm, i) for i in range(count)]
        names = {info[1].decode(): info[0] for info in result}
        self._links = [names[name] for name in self.scene.joints]
        self._free(arm, range(-1, count))

    def _free(self, body: int, links: Iterable[int]) -> None:
        """Apply the changes that act on links and joints."""
        for link in links:
            if self._settings.applies("damping"):
                self._ask("changeDynamics", body, link, linearDamping=0.0, angularDamping=0.0)
            # PyBullet starts every joint with a velocity motor; force 0 switches it off.
            if link >= 0 and self._settings.applies("motors"):
                mode = self._lib.VELOCITY_CONTROL
                self._ask("setJointMotorControl2", body, link, mode, force=0.0)

    def _add_bodies(self) -> None:
        scene, lib = self.scene, self._lib
        # Bullet multiplies the coefficients of both bodies.
        mu = np.sqrt(scene.friction) if self._settings.applies("friction") else scene.friction
        if scene.ground:
            size = (_GROUND, _GROUND, 0.5)
            shape = self._ask("createCollisionShape", lib.GEOM_BOX, halfExtents=size)
            self._ground = self._ask("createMultiBody", 0.0, shape, basePosition=(0, 0, -0.5))
            self._ask("changeDynamics", self._ground, -1, lateralFriction=mu)
        for body in scene.bodies:
            shape, pose = -1, np.array(body.pose)
            if body.half:
                shape = self._ask("createCollisionShape", lib.GEOM_BOX, halfExtents=body.half)
            # Bullet's quaternions have the scalar last: (x, y, z, w).
            place, turn = pose[:3].tolist(), np.roll(pose[3:], -1).tolist()
            if any(body.force) and not body.guide:
                raise invalid(f"force of {body.name}", body.force, "none: it isn't on a rail")
            if body.guide:
                # A link on a base that stands where the body starts and touches nothing.
                # The link's frame is turned with the body, so axis and force go into that frame.
                back = conjugate(pose[3:])
                axis, force = (rotate(back, np.array(x)) for x in (body.guide, body.force))
                here, upright = [[0, 0, 0]], [[0, 0, 0, 1]]
                number = self._ask(
                    "createMultiBody",
                    0.0,
                    -1,
                    -1,
                    place,
                    turn,
                    linkMasses=[body.mass],
                    linkCollisionShapeIndices=[shape],
                    linkVisualShapeIndices=[-1],
                    linkPositions=here,
                    linkOrientations=upright,
                    linkInertialFramePositions=here,
                    linkInertialFrameOrientations=upright,
                    linkParentIndices=[0],
                    linkJointTypes=[lib.JOINT_PRISMATIC],
                    linkJointAxis=[axis.tolist()],
                )
            else:
                number = self._ask("createMultiBody", body.mass, shape, -1, place, turn)
            link = 0 if body.guide else -1
            material = {"lateralFriction": mu, "localInertiaDiagonal": body.moments}
            self._ask("changeDynamics", number, link, **material)
            self._free(number, [link])
            self.bodies.append(number)
            if any(body.force):
                self._forces.append((number, force.tolist()))

    def couple(self, first: str, second: str, ratio: float, torque: float) -> None:
        """Make a joint copy another one with a gear constraint, for the rest of the run.

        PyBullet's reader of URDF drops a mimic joint; this adds what it describes (PyBullet
        Quickstart Guide, createConstraint and changeConstraint).

        Args:
            first: name of the joint that is copied.
            second: name of the joint that copies it.
            ratio: angle of the second joint over that of the first.
            torque: largest torque of the constraint [N m].

        Raises:
            ValueError: for an unknown joint, a ratio of 0 or a torque that is not positive.
        """
        if finite("ratio", ratio) == 0.0:
            raise invalid("ratio", ratio, "other than 0")
        largest = positive("torque", torque, unit="N m")
        one, two = (self._links[self._joint(name)] for name in (first, second))
        arm, still = self.bodies[0], [0.0] * 3
        kind, axis = self._lib.JOINT_GEAR, [0, 0, 1]
        gear = self._ask("createConstraint", arm, one, arm, two, kind, axis, still, still)
        # Bullet's ratio is that of the rates with the other sign, first over second.
        self._ask("changeConstraint", gear, gearRatio=-1.0 / ratio, maxForce=largest)

    def _joint(self, name: str) -> int:
        """Return the number of a joint of the scene."""
        if name not in self.scene.joints:
            raise invalid("joint", name, f"one of {', '.join(self.scene.joints) or 'none'}")
        return self.scene.joints.index(name)

    # --- running ------------------------------------------------------------------------------

    def advance(self, steps: int) -> None:
        """Advance by this many steps of dt, applying forces and torques before each."""
        # Names bound outside the loop: attribute look-ups are not charged to the engine.
        step, client, lib = self._lib.stepSimulation, self.client, self._lib
        turn, mode, turning = lib.setJointMotorControlArray, lib.TORQUE_CONTROL, self._torque.any()
        for _ in range(steps):
            for number, force in self._forces:
                # Bullet clears external forces and torques after each step.
                lib.applyExternalForce(number, 0, force, (0, 0, 0), lib.LINK_FRAME, client)
            if turning:
                turn(self.bodies[0], self._links, mode, forces=self._torque, physicsClientId=client)
            step(client)
        self._steps += steps

    def state(self) -> State:
        """Return the state: joint angles of a URDF, or pose and velocity of each body."""
        time = self._steps * self.dt
        if self.scene.urdf:
            result = self._ask("getJointStates", self.bodies[0], self._links)
            return State(time, *(np.array([row[k] for row in result]) for k in (0, 1)))
        q, v = np.empty((7, len(self.bodies))), np.empty((6, len(self.bodies)))
        for i, (body, number) in enumerate(zip(self.scene.bodies, self.bodies, strict=True)):
            if body.guide:
                link = self._ask("getLinkState", number, 0, computeLinkVelocity=1)
                place, turn, speed, spin = (link[k] for k in (0, 1, 6, 7))
            else:
                place, turn = self._ask("getBasePositionAndOrientation", number)
                speed, spin = self._ask("getBaseVelocity", number)
            q[:3, i], q[3:, i], v[:3, i] = place, (turn[3], *turn[:3]), speed
            # Bullet's angular velocity is in the world, the course's in the body.
            v[3:, i] = rotate(conjugate(q[3:, i]), np.array(spin))
        return State(time, q, v)

    def contacts(self) -> ContactReport:
        """Return the contacts of the last step."""
        rows = self._ask("getContactPoints") if self._steps and not self.scene.urdf else ()
        if not rows:
            return NO_CONTACTS
        # PyBullet's body numbers to the scene's; the ground is -1.
        number = {body: i for i, body in enumerate(self.bodies)} | {self._ground: -1}
        bodies = np.array([(number[row[1]], number[row[2]]) for row in rows]).T
        point, gap = np.array([row[6] for row in rows]).T, np.array([row[8] for row in rows])
        # The normal points to the first body, and so do the forces, which act on it.
        normal, along, aside = (-np.array([row[k] for row in rows]).T for k in (7, 11, 13))
        sizes = np.array([[row[k] for row in rows] for k in (9, 10, 12)])
        force = sizes[0] * normal + sizes[1] * along + sizes[2] * aside
        return reported(self.state(), bodies, point, normal, gap, force)

    def set_velocity(self, v: Array) -> None:
        """Set joint rates, or each body's velocity (linear in the world, angular in the body)."""
        if self.scene.urdf:
            return self._set_joints(self.state().q, v)
        q = self.state().q
        for i, (body, number) in enumerate(zip(self.scene.bodies, self.bodies, strict=True)):
            if body.guide:
                along = [float(np.dot(body.guide, x)) for x in (q[:3, i] - body.pose[:3], v[:3, i])]
                self._ask("resetJointState", number, 0, *along)
            else:
                spin = rotate(q[3:, i], v[3:, i])
                self._ask("resetBaseVelocity", number, v[:3, i].tolist(), spin.tolist())

    def _set_joints(self, q: Array, v: Array) -> None:
        for link, angle, rate in zip(self._links, q.tolist(), v.tolist(), strict=True):
            self._ask("resetJointState", self.bodies[0], link, angle, rate)

    def set_torque(self, torque: Array) -> None:
        """Set the joint torques that act from now on."""
        self._torque = np.array(torque)

    def reset(self) -> None:
        """Return to the state at time 0."""
        start = self.scene.start
        if self.scene.urdf:
            self._set_joints(start.q, start.v)
        pairs = zip(self.scene.bodies, self.bodies, strict=False)
        for (body, number), q in zip(pairs, start.q.T, strict=False):
            if body.guide:
                self._ask("resetJointState", number, 0, 0.0, 0.0)
            else:
                turn = np.roll(q[3:], -1).tolist()
                self._ask("resetBasePositionAndOrientation", number, q[:3].tolist(), turn)
        if not self.scene.urdf:
            self.set_velocity(start.v)
        self._steps = 0

    def save(self) -> Any:
        """Return the handle of a state saved in memory and the number of steps, for `restore`."""
        return self._ask("saveState"), self._steps

    def restore(self, saved: Any) -> None:
        """Continue from what `save` returned."""
        number, self._steps = saved
        # PyBullet restores the world, not our count of steps.
        self._ask("restoreState", stateId=number)

    def close(self) -> None:
        """Disconnect the client; a second call does nothing."""
        if self.client >= 0:
            with quiet():
                self._ask("disconnect")
            self.client = -1
