"""MuJoCo as an engine of chapter 3: scenes as MJCF or URDF, as shipped and fair.

`run(steps)` is one call of `mj_step` with nstep. MuJoCo puts a contact's normal from its first geom
to the second, tells forces in the contact's frame, and keeps contacts and forces of a step in its
data until the next one: what the contract asks for.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from course.check import positive, vector
from course.oracles.mujoco.kit import ALWAYS_OFF, CONTACT_OFF, MUJOCO_INTEGRATORS, library
from course.platforms import FAIR, NO_CONTACTS, Change, ContactReport, Engine
from course.platforms.contract import Array, Run, Settings, State, reported
from course.platforms.scenes import Body, Scene

_TUNING = "MuJoCo 4.0 manual (2026), Modeling, Tuning and default values"
CHANGES = (
    Change(
        "cone",
        "option/cone",
        "pyramidal",
        "elliptic",
        "The scenes ask for Coulomb's round cone; a pyramid inside it brakes less off its axes.",
        _TUNING,
        "bodies",
    ),
    Change(
        "impratio",
        "option/impratio",
        "1",
        "10",
        "Friction is ten times as stiff as the resistance to sinking: a part creeps less.",
        _TUNING,
        "bodies",
    ),
    Change(
        "solref",
        "geom/solref",
        "0.02 1",
        "0.005 1, or two steps if that is longer",
        "Time constant [s], damping ratio (1: critical). Less sag at rest, but higher hops.",
        _TUNING,
        "bodies",
    ),
    Change(
        "solimp",
        "geom/solimp",
        "0.9 0.95 0.001",
        "0.95 0.99 0.001",
        "Hardness at the surface, hardness at a depth, that depth [m]. Halves sag and creep.",
        _TUNING,
        "bodies",
    ),
    Change(
        "autoreset",
        "option/flag/autoreset",
        "enable",
        "disable",
        "On: a state that diverges is put back to the start, and the run looks stable.",
        "MuJoCo 4.0 manual (2026), XML reference, option/flag",
    ),
    Change(
        "constraint",
        "option/flag/constraint, contact",
        "enable",
        "disable",
        "Saves time in tumble, chain and arm, where nothing touches. The motion stays the same.",
        "MuJoCo 4.0 manual (2026), XML reference, option/flag",
        "joints",
    ),
)
OPTIONS = ("cone", "impratio", "solref", "solimp", "noslip_iterations", "iterations", "solver")


class MuJoCo(Engine):
    """MuJoCo.

    Options: `cone` ("pyramidal", "elliptic"), `impratio`, `solref` (2 numbers), `solimp` (3 or 5),
    `noslip_iterations`, `iterations`, `solver` ("PGS", "CG", "Newton").
    """

    name, package = "MuJoCo", "mujoco"
    schemes = MUJOCO_INTEGRATORS
    changes = CHANGES

    def missing(self) -> str:
        """Return why MuJoCo cannot be imported, or an empty text."""
        try:
            library()
        except ImportError as error:
            return str(error)
        return ""

    def build(self, scene: Scene, dt: float, settings: Settings = FAIR) -> Run:
        """Return a run of the scene in MuJoCo, its options checked."""
        positive("dt", dt, unit="s")
        return _Run(scene, dt, settings, settings.checked(self, OPTIONS))


def _text(values: ArrayLike) -> str:
    return " ".join(f"{float(x):.17g}" for x in np.ravel(np.asarray(values)))


def _body(body: Body, contact: str) -> str:
    joint = "<freejoint/>"
    if body.guide is not None:
        joint = f'<joint type="slide" axis="{_text(body.guide)}"/>'
    geom = ""
    if body.half is not None:
        geom = f'<geom type="box" size="{_text(body.half)}" {contact}/>'
    return (
        f'<body name="{body.name}" pos="{_text(body.pose[:3])}" quat="{_text(body.pose[3:])}">'
        f'{joint}<inertial pos="0 0 0" mass="{body.mass:.17g}" '
        f'diaginertia="{_text(body.moments)}"/>{geom}</body>'
    )


def mjcf(scene: Scene, dt: float, settings: Settings = FAIR) -> str:
    """Return the MJCF text of a scene of bodies: geom 0 is the ground, where there is one."""
    fair = {"solref": (max(0.005, 2.0 * dt), 1.0), "solimp": (0.95, 0.99, 0.001)}
    # Sliding friction of both geoms is the scene's; MuJoCo takes the larger of the two.
    contact = f'friction="{scene.friction:.17g}"'
    for name, value in fair.items():
        # An explicit option wins over the fair value, and that over MuJoCo's default.
        if name in settings.options or settings.applies(name):
            contact += f' {name}="{_text(settings.options.get(name, value))}"'
    ground = f'<geom type="plane" size="0 0 1" {contact}/>' if scene.ground else ""
    bodies = "".join(_body(body, contact) for body in scene.bodies)
    return f"<mujoco><worldbody>{ground}{bodies}</worldbody></mujoco>"


class _Run(Run):
    """A model and its data."""

    def __init__(self, scene: Scene, dt: float, settings: Settings, scheme: str) -> None:
        mujoco = self.lib = library()
        self.scene, self.dt = scene, dt
        text = scene.urdf or mjcf(scene, dt, settings)
        self.model = mujoco.MjModel.from_xml_string(text)
        option, options = self.model.opt, settings.options
        option.timestep, option.gravity[:] = dt, scene.gravity
        option.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{scheme.upper()}")
        cone = options.get("cone", "elliptic" if settings.applies("cone") else "pyramidal")
        option.cone = getattr(mujoco.mjtCone, f"mjCONE_{str(cone).upper()}")
        option.impratio = options.get("impratio", 10.0 if settings.applies("impratio") else 1.0)
        for name in ("noslip_iterations", "iterations"):
            if name in options:
                setattr(option, name, options[name])
        if "solver" in options:
            option.solver = getattr(mujoco.mjtSolver, f"mjSOL_{str(options['solver']).upper()}")
        if settings.applies("autoreset"):
            self._disable("autoreset")
        # Without shapes nothing can touch, so the solver's overhead is saved for a fair timing.
        smooth = all(body.half is None for body in scene.bodies)
        if smooth and settings.applies("constraint"):
            self._disable(*CONTACT_OFF, *ALWAYS_OFF)
        self.data = mujoco.MjData(self.model)
        self.taken = 0
        self.reset()

    def _disable(self, *flags: str) -> None:
        for flag in flags:
            bit = getattr(self.lib.mjtDisableBit, f"mjDSBL_{flag.upper()}")
            self.model.opt.disableflags |= int(bit)

    def advance(self, steps: int) -> None:
        self.lib.mj_step(self.model, self.data, steps)
        self.taken += steps

    # A guided body has one number in qpos and qvel, a free one 7 and 6.
    def _columns(self) -> list[tuple[slice, slice]]:
        """Return places of each body's numbers in qpos and qvel."""
        result, q, v = [], 0, 0
        for body in self.scene.bodies:
            nq, nv = (1, 1) if body.guide else (7, 6)
            result.append((slice(q, q + nq), slice(v, v + nv)))
            q, v = q + nq, v + nv
        return result

    def state(self) -> State:
        data, scene = self.data, self.scene
        if scene.chain:
            return State(data.time, data.qpos.copy(), data.qvel.copy())
        start = scene.start
        q, v = start.q, np.zeros_like(start.v)
        for i, (body, (at, moves)) in enumerate(zip(scene.bodies, self._columns(), strict=True)):
            if body.guide is None:
                q[:, i], v[:, i] = data.qpos[at], data.qvel[moves]
            else:
                # A slide's qpos is the distance along its axis from the start.
                q[:3, i] += np.array(body.guide) * data.qpos[at]
                v[:3, i] = np.array(body.guide) * data.qvel[moves]
        return State(data.time, q, v)

    def energy(self) -> float:
        """Return MuJoCo's own, after the places of the present state; constant forces are added."""
        # On a copy: the evaluation must not change the contacts and warm start of the run.
        scratch = self.lib.MjData(self.model)
        scratch.qpos[:], scratch.qvel[:] = self.data.qpos, self.data.qvel
        self.lib.mj_forward(self.model, scratch)
        self.lib.mj_energyPos(self.model, scratch)
        self.lib.mj_energyVel(self.model, scratch)
        pairs = zip(self.scene.bodies, self.state().q.T, strict=True)
        work = sum(float(np.dot(b.force, q[:3])) for b, q in pairs) if self.scene.bodies else 0.0
        return float(scratch.energy.sum()) - work

    def contacts(self) -> ContactReport:
        data, first = self.data, int(self.scene.ground)
        # Contacts in the margin that carry no force have no rows in the solver.
        live = [i for i in range(data.ncon) if data.contact.efc_address[i] >= 0]
        if self.scene.chain or not self.taken or not live:
            return NO_CONTACTS
        bodies = data.contact.geom[live].T.astype(np.int64) - first
        frame = data.contact.frame[live].reshape(-1, 3, 3)
        local, force = np.zeros(6), np.empty((3, len(live)))
        for k, i in enumerate(live):
            self.lib.mj_contactForce(self.model, data, i, local)
            # MuJoCo's contact frame has the normal and the tangents as rows; to the world by f @
            # frame.
            force[:, k] = local[:3] @ frame[k]
        point, gap = data.contact.pos[live].T.copy(), data.contact.dist[live].copy()
        return reported(self.state(), bodies, point, frame[:, 0].T.copy(), gap, force)

    def set_velocity(self, v: Array) -> None:
        if self.scene.chain:
            self.data.qvel[:] = vector("v", v, (self.model.nv,))
            return
        v = vector("v", v, (6, len(self.scene.bodies)))
        pairs = zip(self.scene.bodies, self._columns(), strict=True)
        for i, (body, (_, moves)) in enumerate(pairs):
            self.data.qvel[moves] = v[:, i] if body.guide is None else v[:3, i] @ body.guide

    def set_torque(self, torque: Array) -> None:
        if not self.scene.chain:
            super().set_torque(torque)
        self.data.qfrc_applied[:] = vector("torque", torque, (self.model.nv,))

    def reset(self) -> None:
        """`mj_resetData`, then the start of the scene."""
        self.lib.mj_resetData(self.model, self.data)
        start = self.scene.start
        if self.scene.chain:
            self.data.qpos[:] = start.q
        for i, body in enumerate(self.scene.bodies):
            self.data.xfrc_applied[i + 1, :3] = body.force
        self.set_velocity(start.v)
        self.taken = 0

    def save(self) -> Any:
        # The integration state includes the warm start, so that a restored run repeats bit for bit.
        kind = self.lib.mjtState.mjSTATE_INTEGRATION
        saved = np.empty(self.lib.mj_stateSize(self.model, kind))
        self.lib.mj_getState(self.model, self.data, saved, kind)
        return saved

    def restore(self, saved: Any) -> None:
        self.lib.mj_setState(self.model, self.data, saved, self.lib.mjtState.mjSTATE_INTEGRATION)
