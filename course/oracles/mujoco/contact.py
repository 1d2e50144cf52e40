"""MuJoCo asked about the contact scenes of chapter 2, and what its solver was given and found.

The scenes are those of `course.contact.scenes`, with the same degrees of freedom, and more for its
own model: a box on a plane, a stack, two links against a wall. `Options` are those of contact and
solver. `contact_state` reads the arrays of the constraint solver.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from course.check import invalid, one_of
from course.contact.problem import Problem
from course.contact.soft import Softness
from course.oracles.mujoco.kit import GRAVITY, Runner, library

Array = NDArray[np.float64]
SOLVERS = ("Newton", "CG", "PGS")

_SLIDES = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))


@dataclass(frozen=True)
class Options:
    """Options of MuJoCo that the scenes vary; the names are MuJoCo's.

    Attributes:
        dt: step [s].
        integrator: one of MuJoCo's.
        solver: one of `SOLVERS`.
        iterations, tolerance: of the solver; 0 asks for all that rounding allows.
        cone, impratio, refsafe, diagexact: of the model.
        condim: rows of a contact.
        friction: sliding, torsion [m], rolling [m].
        solref, solimp, margin: of the geoms.
    """

    dt: float = 0.002
    integrator: str = "Euler"
    solver: str = "Newton"
    iterations: int = 100
    tolerance: float = 0.0
    cone: str = "elliptic"
    impratio: float = 1.0
    refsafe: bool = True
    diagexact: bool = False
    condim: int = 3
    friction: Sequence[float] = (0.5, 0.005, 0.0001)
    solref: Sequence[float] = (0.02, 1.0)
    solimp: Sequence[float] = (0.9, 0.95, 0.001, 0.5, 2.0)
    margin: float = 0.0

    def softness(self, weight: Array | None = None) -> Softness:
        """Return the same for `course.contact.soft`."""
        return Softness(
            self.solref,
            self.solimp,
            self.impratio,
            self.cone,
            self.margin,
            self.refsafe,
            None if self.diagexact else weight,
        )


def contact_xml(
    body: str, options: Options, gravity: Sequence[float] = (0.0, 0.0, -GRAVITY)
) -> str:
    """Return a model's text.

    Off: what the question does not need, as everywhere, and the warm start.
    """
    one_of("solver", options.solver, SOLVERS)

    def text(values: Sequence[float]) -> str:
        return " ".join(f"{value:.17g}" for value in values)

    deviation = " ".join(
        f'{flag}="disable"' for flag in ("autoreset", "island", "warmstart", "sensor")
    )
    safe = "enable" if options.refsafe else "disable"
    exact = ' diagexact="enable"' if options.diagexact else ""
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{options.dt:.17g}" '
        f'integrator="{options.integrator}" gravity="{text(gravity)}" solver="{options.solver}" '
        f'iterations="{options.iterations}" tolerance="{options.tolerance:.17g}" '
        f'ls_iterations="50" ls_tolerance="1e-6" cone="{options.cone}" '
        f'impratio="{options.impratio:.17g}">'
        f'<flag {deviation} refsafe="{safe}"{exact}/></option>'
        f'<default><geom condim="{options.condim}" friction="{text(options.friction)}" '
        f'solref="{text(options.solref)}" solimp="{text(options.solimp)}" '
        # MuJoCo adds the margins of both geoms, hence half of it each.
        f'margin="{0.5 * options.margin:.17g}"/></default>'
        f"<worldbody>{body}</worldbody></mujoco>"
    )


def _runner(body: str, options: Options, q0: Array, v0: Array, gravity: Sequence[float]) -> Runner:
    return Runner(contact_xml(body, options, gravity), q0, v0, options.integrator)


def _down(angle: float = 0.0) -> tuple[float, float, float]:
    """Return gravity in the frame of a plane that goes down along x."""
    # The plane stays horizontal, and gravity is tilted instead.
    return (GRAVITY * math.sin(angle), 0.0, -GRAVITY * math.cos(angle))


_FLOOR = '<geom type="plane" size="9 9 1"/>'


def _ball(joint: str = "") -> str:
    """Return a ball of 1 kg, 0.1 m and 0.005 kg m^2 on three slides above the floor.

    One more joint can be added.
    """
    return (
        f'{_FLOOR}<body pos="0 0 0.1">{_SLIDES}{joint}<inertial pos="0 0 0" mass="1" '
        'diaginertia="0.005 0.005 0.005"/><geom size="0.1"/></body>'
    )


def block(
    options: Options, angle: float = 0.0, velocity: Sequence[float] = (0.0, 0.0), start: float = 0.0
) -> Runner:
    """Return a block that slides on a point and does not turn.

    On a slope [rad], sent off along it and across [m/s], its lowest point at a height `start` [m].
    """
    q0, v0 = np.array([0.0, 0.0, start]), np.array([*velocity, 0.0])
    return _runner(_ball(), options, q0, v0, _down(angle))


def spinning_disc(options: Options, spin: float = 10.0) -> Runner:
    """Return a ball that spins on a point [rad/s]."""
    body = _ball('<joint type="hinge" axis="0 0 1"/>')
    return _runner(body, options, np.zeros(4), np.array([0.0, 0.0, 0.0, spin]), _down())


def tower(options: Options, masses: Sequence[float]) -> Runner:
    """Return balls of 0.1 m on top of each other, each on one vertical slide.

    Masses start with the lowest [kg].
    """
    body = _FLOOR + "".join(
        f'<body pos="0 0 {0.1 + 0.2 * i:.17g}"><joint type="slide" axis="0 0 1"/>'
        f'<geom size="0.1" mass="{mass:.17g}"/></body>'
        for i, mass in enumerate(masses)
    )
    n = len(masses)
    return _runner(body, options, np.zeros(n), np.zeros(n), _down())


def table(options: Options, load: Sequence[float] = (0.0, 0.0), side: float = 1.0) -> Runner:
    """Return a table of 10 kg on four legs, with height, roll and pitch.

    Its weight acts at `load`.
    """
    legs = "".join(
        f'<geom size="0.01" pos="{x:.17g} {y:.17g} -0.49" mass="0"/>'
        for x, y in np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * 0.5 * side
    )
    moment = 10.0 * side**2 / 6.0
    body = (
        f'{_FLOOR}<body pos="0 0 0.5"><joint type="slide" axis="0 0 1"/>'
        '<joint type="hinge" axis="1 0 0"/><joint type="hinge" axis="0 1 0"/>'
        f'<inertial pos="0 0 0" mass="10" diaginertia="{moment} {moment} {moment}"/>{legs}</body>'
    )
    # The weight is applied as a force, so that an eccentric load can add its moments.
    runner = _runner(body, options, np.zeros(3), np.zeros(3), (0.0, 0.0, 0.0))
    weight = 10.0 * GRAVITY
    runner.data.qfrc_applied[:] = (-weight, -weight * load[1], weight * load[0])
    return runner


def pinch(options: Options, squeeze: float = 5.0, mass: float = 0.2) -> Runner:
    """Return a glass between two fingers of 50 g that press with `squeeze` [N].

    q is that of the scene.
    """

    def finger(x: float) -> str:
        return (
            f'<body pos="{x} 0 0"><joint type="slide" axis="1 0 0"/>'
            '<geom type="sphere" size="0.02" mass="0.05"/></body>'
        )

    body = (
        f"{finger(-0.05)}{finger(0.05)}<body>"
        '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>'
        f'<geom type="box" size="0.03 0.03 9" mass="{mass:.17g}"/></body>'
    )
    runner = _runner(body, options, np.zeros(4), np.zeros(4), _down())
    runner.data.qfrc_applied[:2] = (squeeze, -squeeze)
    return runner


def box(options: Options, velocity: Sequence[float] = (0.0, 0.0), count: int = 1) -> Runner:
    """Return free boxes of 0.2 m and 1 kg, one on top of the other, the lowest sent off [m/s]."""
    body = _FLOOR + "".join(
        f'<body pos="0 0 {0.1 + 0.2 * i:.17g}"><freejoint/>'
        '<geom type="box" size="0.1 0.1 0.1" mass="1"/></body>'
        for i in range(count)
    )
    # qpos of a free joint: position, then the quaternion (w, x, y, z).
    q0 = np.zeros((count, 7))
    q0[:, 2], q0[:, 3] = 0.1 + 0.2 * np.arange(count), 1.0
    v0 = np.zeros((count, 6))
    v0[0, :2] = velocity
    return _runner(body, options, q0.ravel(), v0.ravel(), _down())


def links(options: Options) -> Runner:
    """Return two links of 0.5 m that fall, turning, against a wall with the ball at their end."""
    link = (
        '<joint type="hinge" axis="0 1 0"/>'
        '<geom type="capsule" size="0.02" fromto="0 0 0 0.5 0 0" contype="0" conaffinity="0"/>'
    )
    body = (
        '<geom type="plane" size="9 9 1" pos="0.55 0 0" zaxis="-1 0 0"/>'
        f'<body>{link}<body pos="0.5 0 0">{link}<joint type="hinge" axis="0 0 1"/>'
        '<geom size="0.05" pos="0.5 0 0" mass="0.2"/></body></body>'
    )
    return _runner(body, options, np.array([-1.0, 1.8, 0.1]), np.zeros(3), _down())


@dataclass(frozen=True)
class ContactState:
    """What MuJoCo's solver was given in the present state, and what it found.

    Attributes:
        problem: the same step for the course's models.
        weight: inverse weights of the contacts' bodies, (n, 2).
        force: `efc_force` (m,); `reference`, `compliance`: `efc_aref`, `efc_R`.
        iterations: that the solver took.
    """

    problem: Problem
    weight: Array
    force: Array
    reference: Array
    compliance: Array
    iterations: int


def contact_state(runner: Runner) -> ContactState | None:
    """Return the contacts of the present state (`mj_forward` is called).

    It returns None where nothing touches.

    Raises:
        ValueError: for a model with other constraints, or contacts of several kinds.
    """
    mujoco = library()
    model, data = runner.model, runner.data
    mujoco.mj_forward(model, data)
    if not data.ncon or not data.nefc:
        return None
    # Contacts beyond the margin have no rows in the solver (their address is -1).
    contacts = [c for c in data.contact if c.efc_address >= 0]
    dims = {int(c.dim) for c in contacts}
    if len(dims) != 1 or np.any(data.efc_type[: data.nefc] < 5):
        raise invalid("runner", sorted(dims), "a model with contacts of one condim and no more")
    (d,) = dims
    # Our problem is dense; MuJoCo stores J sparse for large models.
    J = np.zeros((data.nefc, model.nv))
    if mujoco.mj_isSparse(model):
        mujoco.mju_sparse2dense(
            J, data.efc_J, data.efc_J_rownnz, data.efc_J_rowadr, data.efc_J_colind
        )
    else:
        J[:] = np.asarray(data.efc_J).reshape(data.nefc, model.nv)
    mu = np.array([c.friction[: d - 1] for c in contacts]).reshape(len(contacts), d - 1)
    pyramid = model.opt.cone == mujoco.mjtCone.mjCONE_PYRAMIDAL and d > 1
    jacobian = np.empty((len(contacts), d, model.nv))
    for i, contact in enumerate(contacts):
        rows = J[contact.efc_address :]
        if pyramid:
            # The pyramid's edges are n +- mu t: their mean is the normal, their difference the
            # tangent.
            jacobian[i, 0] = 0.5 * (rows[0] + rows[1])
            for j in range(d - 1):
                jacobian[i, j + 1] = (rows[2 * j] - rows[2 * j + 1]) / (2.0 * mu[i, j])
        else:
            jacobian[i] = rows[:d]
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    v, dt = data.qvel.copy(), model.opt.timestep
    # v + dt * qacc_smooth is the velocity that the step would have without contact.
    problem = Problem(
        mass, jacobian, v, v + dt * data.qacc_smooth, np.array([c.dist for c in contacts]), mu, dt
    )
    bodies = np.array([model.geom_bodyid[c.geom] for c in contacts])
    return ContactState(
        problem,
        # MuJoCo's approximate diagonal of the contacts' matrix, which R follows unless diagexact.
        model.body_invweight0[bodies].sum(axis=1),
        data.efc_force[: data.nefc].copy(),
        data.efc_aref[: data.nefc].copy(),
        data.efc_R[: data.nefc].copy(),
        int(data.solver_niter[0]),
    )


def iterations(runner: Runner, steps: int) -> int:
    """Return how many iterations the solver takes over `steps` steps from the start."""
    mujoco = library()
    runner.reset()
    taken = 0
    for _ in range(steps):
        mujoco.mj_step(runner.model, runner.data)
        # Iterations of the main island; islands are off in these models.
        taken += int(runner.data.solver_niter[0])
    return taken
