"""A `Chain` as a MuJoCo model, and a MuJoCo model, from MJCF or URDF, as a `Chain`.

MuJoCo parses both formats, so no text is read or written here. It orders bodies depth first, so a
tree's joints may come in another order there: `addresses` says where each one is.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import finite, invalid, one_of, vector
from course.kinematics.chain import HERE, Chain, compose, invert, turn_to
from course.oracles.mujoco.kit import ALWAYS_OFF, CONTACT_OFF, library
from course.rigid_body.quaternion import to_matrix
from course.rigid_body.spatial import DOWNWARDS, inertia_tensor

Array = NDArray[np.float64]


def model(chain: Chain, gravity: ArrayLike = DOWNWARDS) -> Any:
    """Return the same arm as an `MjModel`, without contacts, constraints, motors and sensors.

    Joints are named by their number in the chain, the tip is a site. Limits are written down, but
    nothing enforces them, as the constraint solver is off.

    Args:
        chain: the arm.
        gravity: in the world, shape (3,) [m/s^2].
    """
    mujoco = library()
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = vector("gravity", gravity, (3,), unit="m/s^2")
    for flag in (*ALWAYS_OFF, *CONTACT_OFF):
        spec.option.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag.upper()}"))
    bodies: list[Any] = []
    for i in range(chain.n):
        before = spec.worldbody if chain.parent[i] < 0 else bodies[chain.parent[i]]
        pose, inertia = chain.placement[:, i], chain.inertia[:, :, i]
        body = before.add_body(name=f"link {i}", pos=pose[:3], quat=pose[3:])
        body.explicitinertial, body.mass, body.ipos = True, chain.mass[i], chain.centre[:, i]
        # MuJoCo's order: the diagonal, then xy, xz, yz.
        body.fullinertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
        kind = mujoco.mjtJoint.mjJNT_SLIDE if chain.slides[i] else mujoco.mjtJoint.mjJNT_HINGE
        joint = body.add_joint(name=f"joint {i}", type=kind, axis=(0.0, 0.0, 1.0))
        joint.armature = chain.armature[i]
        # Damping may be a polynomial in MuJoCo; the first coefficient is the linear one.
        joint.damping = [chain.damping[i], *np.zeros(len(np.atleast_1d(joint.damping)) - 1)]
        joint.limited = int(np.isfinite(chain.lower[i]) and np.isfinite(chain.upper[i]))
        if joint.limited:
            joint.range = chain.lower[i], chain.upper[i]
        bodies.append(body)
    bodies[-1].add_site(name="tip", pos=chain.tool[:3], quat=chain.tool[3:])
    return spec.compile()


def addresses(model: Any, chain: Chain) -> NDArray[np.int64]:
    """Return where the chain's joints are in `qpos` and `qvel` of `model(chain)`, shape (n,)."""
    # By name, because MuJoCo orders bodies depth first.
    return np.array([model.joint(f"joint {i}").dofadr[0] for i in range(chain.n)])


def _named(model: Any, kind: str, i: int) -> str:
    return f"{kind} {getattr(model, kind)(i).name or i!r}"


def _check(model: Any) -> None:
    """Raise for what a chain lacks, by its name."""
    mujoco = library()
    if model.ntendon:
        raise invalid("model", _named(model, "tendon", 0), "an arm without tendons")
    if model.neq:
        result = mujoco.mjtEq(int(model.eq_type[0])).name.removeprefix("mjEQ_").lower()
        raise invalid(
            "model",
            f"equality {model.equality(0).name or 0!r} ({result})",
            "an arm without closed loops",
        )
    if model.nflex:
        raise invalid("model", _named(model, "flex", 0), "an arm of rigid bodies")
    # Actuators would add torques that the chain does not know.
    if model.nu:
        rule = "an arm without actuators: pass their torques to forward_dynamics"
        raise invalid("model", _named(model, "actuator", 0), rule)
    for name in ("density", "viscosity"):
        if getattr(model.opt, name):
            rule = "0: a chain moves through no fluid"
            raise invalid(f"option {name} of the model", getattr(model.opt, name), rule)
    for i in np.flatnonzero(~np.isfinite(model.body_mass)).tolist():
        raise invalid(f"mass of {_named(model, 'body', i)}", model.body_mass[i], "finite [kg]")
    hinge, slide = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
    for i in range(model.njnt):
        name, kind, dof = _named(model, "joint", i), int(model.jnt_type[i]), model.jnt_dofadr[i]
        if kind not in (hinge, slide):
            result = mujoco.mjtJoint(kind).name.removeprefix("mjJNT_").lower()
            raise invalid("model", f"{name}, a {result} joint", "joints that turn or slide")
        if model.jnt_range[i, 0] > model.jnt_range[i, 1]:  # MuJoCo takes it for no limit
            raise invalid(f"range of {name}", model.jnt_range[i], "limits that do not cross")
        if model.body_jntnum[model.jnt_bodyid[i]] > 1:
            raise invalid("model", f"{name} beside another of its body", "one joint a body")
        # A spring or dry friction would be a force that the chain's dynamics does not have.
        if model.jnt_stiffness[i] or model.dof_frictionloss[dof] or model.qpos0[dof]:
            raise invalid("model", f"{name} with a spring, dry friction or ref", "none of these")
        if np.any(model.dof_dampingpoly[dof]):
            raise invalid("model", f"{name} with damping that is not linear", "linear damping")
    for i in range(model.nbody):
        if model.body_gravcomp[i]:
            raise invalid("model", f"{_named(model, 'body', i)} with gravcomp", "none")
        if model.body_plugin[i] >= 0:
            raise invalid("model", f"{_named(model, 'body', i)} with a plugin", "none")


def chain(model: Any, tip: str | None = None) -> Chain:
    """Return a MuJoCo model as a chain, its joints in MuJoCo's order with the tip's joint last.

    Bodies without a joint become part of the link that carries them. What a chain lacks and what
    would move it is rejected: springs, dry friction, actuators, plugins of bodies, a fluid around
    the arm. Geometry is omitted, and with it contacts.

    Args:
        model: an `MjModel`, such as `mujoco.MjModel.from_xml_path` reads from MJCF or URDF.
        tip: name of a site on a link that carries no other; default: "tip" if there is such a site,
            else the frame of the last body.

    Raises:
        ValueError: for a joint that neither turns nor slides, two joints of a body, a spring, dry
            friction, a tendon, a closed loop, an actuator, a plugin, a density or viscosity that is
            not 0, a tip elsewhere: it names the one it found.
    """
    _check(model)
    n = int(model.njnt)
    if not n:
        raise invalid("model", "without a joint", "one joint or more")
    # Of each body: the joint that carries it, and its frame in the frame of that joint.
    carrier, within = [-1], [np.array(HERE)]
    parent, placement = [], np.empty((7, n))
    mass, first, second = np.zeros(n), np.zeros((3, n)), np.zeros((3, 3, n))
    last = 0
    # Bodies welded to each other are one link: their inertias are summed in the link's frame.
    for b in range(1, model.nbody):
        before = int(model.body_parentid[b])
        pose = np.concatenate([model.body_pos[b], model.body_quat[b]])
        here, joint = compose(within[before], pose), carrier[before]
        if model.body_jntnum[b]:
            i = int(model.body_jntadr[b])
            turn = np.concatenate([model.jnt_pos[i], turn_to(model.jnt_axis[i])])
            parent.append(joint)
            placement[:, i] = compose(here, turn)
            # From here on poses are relative to the joint's own frame.
            here, joint, last = invert(turn), i, b
        carrier.append(joint)
        within.append(here)
        if joint >= 0:
            inner = np.concatenate([model.body_ipos[b], model.body_iquat[b]])
            centre = compose(here, inner)
            R, m, c = to_matrix(centre[3:]), model.body_mass[b], centre[:3]
            mass[joint] += m
            # First and second moments add up over welded bodies; centres and central inertias do
            # not.
            first[:, joint] += m * c
            # Parallel-axis theorem, with respect to the frame of the joint.
            moments = R @ np.diag(model.body_inertia[b]) @ R.T
            second[:, :, joint] += moments + m * (c @ c * np.eye(3) - np.outer(c, c))
    carried, tool = _tool(model, tip, carrier, within, last)
    if carried < 0 or carried in parent:
        result = "the world" if carried < 0 else _named(model, "joint", carried)
        raise invalid("tip", f"on the link of {result}", "on a link that carries no other")
    order = [i for i in range(n) if i != carried] + [carried]
    limited, dofs = model.jnt_limited.astype(bool), model.jnt_dofadr
    # Back from first and second moments to centre of mass and central inertia.
    centre = first / np.maximum(mass, 1e-300)
    square = np.sum(centre**2, axis=0) * np.eye(3)[:, :, None]
    inertia = second - mass * (square - centre[:, None] * centre[None])
    return Chain(
        parent=[order.index(parent[i]) if parent[i] >= 0 else -1 for i in order],
        placement=placement[:, order],
        mass=mass[order],
        centre=centre[:, order],
        inertia=inertia[:, :, order],
        slides=(model.jnt_type == int(library().mjtJoint.mjJNT_SLIDE))[order],
        lower=np.where(limited, model.jnt_range[:, 0], -np.inf)[order],
        upper=np.where(limited, model.jnt_range[:, 1], np.inf)[order],
        armature=model.dof_armature[dofs][order],
        damping=model.dof_damping[dofs][order],
        tool=tool,
    )


def read(text: str, tip: str | None = None) -> Chain:
    """Return a text of MJCF or URDF as a chain; what cannot be an arm is refused, body by body.

    MuJoCo judges a link together with all that is fixed to it, so that a negative mass hides in a
    greater one; here each link is judged alone.

    Args:
        text: the model.
        tip: as for `chain`.

    Raises:
        ValueError: for a text that MuJoCo refuses or warns about, two joints of one name, an
            impossible body, and what `chain` refuses.
    """
    mujoco, message = library(), list[str]()
    usual = mujoco.get_mju_user_warning()
    # Warnings are collected: a model that MuJoCo repairs with a warning is refused.
    mujoco.set_mju_user_warning(message.append)
    try:
        spec = mujoco.MjSpec.from_string(text)
    finally:
        mujoco.set_mju_user_warning(usual)
    if message:
        raise invalid("text", message[0], "one that MuJoCo reads without a warning")
    if "<robot" in text and not all(joint.name for joint in spec.joints):
        # MuJoCo takes the second of two names away.
        raise invalid("text", [joint.name for joint in spec.joints], "a name for each joint")
    for body in spec.bodies:
        if body.explicitinertial:
            finite(f"mass of body {body.name!r}", float(body.mass), 0.0, unit="kg")
            xx, yy, zz, xy, xz, yz = body.fullinertia
            if body.mass and np.isfinite(xx):  # else it was given by its principal moments
                inertia_tensor([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return chain(spec.compile(), tip)


def _tool(
    model: Any, tip: str | None, carrier: list[int], within: list[Array], last: int
) -> tuple[int, Array]:
    """Return the joint whose link carries the tip, and the tip's pose in its frame."""
    names = [model.site(i).name for i in range(model.nsite)]
    if tip is None and "tip" not in names:
        return carrier[last], within[last]
    name = "tip" if tip is None else tip
    if name not in names:
        raise invalid("tip", name, f"a site of the model: {', '.join(names) or 'it has none'}")
    site = model.site(name)
    body = int(site.bodyid[0])
    return carrier[body], compose(within[body], np.concatenate([site.pos, site.quat]))


def calls(chain: Chain, what: str, q: Array, v: Array, x: Array) -> Callable[[], Array]:
    """Return a function that asks about N states, one call of MuJoCo's for each.

    It gives the last answer, in MuJoCo's order of joints.

    Args:
        chain: the arm.
        what: "inverse" (x: accelerations), "forward" (x: torques) or "jacobian" of the tip.
        q: angles, shape (n, N).
        v: rates, shape (n, N).
        x: accelerations or torques, shape (n, N).
    """
    mujoco, mj = library(), model(chain)
    one_of("what", what, ("inverse", "forward", "jacobian"))
    data, at = mujoco.MjData(mj), np.argsort(addresses(mj, chain))
    # One contiguous row per state: the layout is prepared outside the timed function.
    rows = [list(np.ascontiguousarray(state[at].T)) for state in (q, v, x)]
    J = np.zeros((6, chain.n))

    def jacobians() -> Array:
        for here in rows[0]:
            data.qpos[:] = here
            # Only the stages that the Jacobian needs, not a whole forward pass.
            mujoco.mj_kinematics(mj, data)
            mujoco.mj_comPos(mj, data)
            mujoco.mj_jacSite(mj, data, J[:3], J[3:], 0)
        return J

    def dynamics() -> Array:
        ask = mujoco.mj_inverse if what == "inverse" else mujoco.mj_forward
        third = data.qacc if what == "inverse" else data.qfrc_applied
        for here, rate, given in zip(*rows, strict=True):
            data.qpos[:], data.qvel[:], third[:] = here, rate, given
            ask(mj, data)
        return np.array(data.qfrc_inverse if what == "inverse" else data.qacc)

    return jacobians if what == "jacobian" else dynamics


def moved(
    chain: Chain, q: Array, v: Array, tau: Array, gravity: ArrayLike, dt: float, steps: int
) -> Array:
    """Return joint positions after steps of MuJoCo's RK4 under constant torques, shape (n,)."""
    mujoco, mj = library(), model(chain, gravity)
    mj.opt.timestep, mj.opt.integrator = dt, mujoco.mjtIntegrator.mjINT_RK4
    data, at = mujoco.MjData(mj), addresses(mj, chain)
    # In the chain's order, whatever MuJoCo's is.
    data.qpos[at], data.qvel[at], data.qfrc_applied[at] = q, v, tau
    mujoco.mj_step(mj, data, steps)
    return np.array(data.qpos[at])


def follow(
    chain: Chain, motion: Array, kp: Array, kd: Array, dt: float, gravity: ArrayLike
) -> Callable[[], Array]:
    """Return a loop of computed torque with half-sample preview, `mj_inverse` and RK4 of `mj_step`.

    Args:
        chain: the arm, whose model is right.
        motion: q, v and a of the middle of each sample, shape (3, n, T); it starts half before.
        kp: gains on the angles, multiplied by the inertia matrix, shape (n,).
        kd: gains on the rates, likewise, shape (n,).
        dt: sample time [s].
        gravity: shape (3,) [m/s^2].

    Returns:
        A function that runs it and gives the joint positions, shape (T + 1, n).
    """
    mujoco, mj, half = library(), model(chain, gravity), 0.5 * dt
    mj.opt.timestep, mj.opt.integrator = dt, mujoco.mjtIntegrator.mjINT_RK4
    law, data = mujoco.MjData(mj), mujoco.MjData(mj)
    # The start goes half a sample back from the first reference.
    q0 = motion[0, :, 0] - half * motion[1, :, 0] + 0.5 * half**2 * motion[2, :, 0]
    start = q0, motion[1, :, 0] - half * motion[2, :, 0]

    def run() -> Array:
        places = np.empty((motion.shape[2] + 1, chain.n))
        data.qpos[:], data.qvel[:] = start
        for k in range(motion.shape[2]):
            places[k] = data.qpos
            q, v, a = motion[:, :, k]
            # Half-sample preview: state and reference at the middle of the hold.
            ahead = data.qpos + half * data.qvel + 0.5 * half**2 * a
            rate = data.qvel + half * a
            law.qpos[:], law.qvel[:] = ahead, rate
            # Computed torque with the gains inside of M.
            law.qacc[:] = a + kp * (q - ahead) + kd * (v - rate)
            mujoco.mj_inverse(mj, law)
            data.qfrc_applied[:] = law.qfrc_inverse
            mujoco.mj_step(mj, data)
        places[-1] = data.qpos
        return places

    return run


def thread_pool_rollouts(
    chain: Chain, plans: Array, dt: float, start: tuple[Array, Array], gravity: ArrayLike
) -> Callable[[], Array]:
    """Return a function that rolls out K plans of torques with `mujoco.rollout`, on one thread.

    One call in C++ for all plans and steps; arguments and result are those of `rollouts`.
    """
    mujoco, mj = library(), model(chain, gravity)
    from mujoco import rollout

    mj.opt.timestep, mj.opt.integrator = dt, mujoco.mjtIntegrator.mjINT_RK4
    data, kind = mujoco.MjData(mj), mujoco.mjtState.mjSTATE_FULLPHYSICS
    data.qpos[:], data.qvel[:] = start
    begin = np.zeros(mujoco.mj_stateSize(mj, kind))
    mujoco.mj_getState(mj, data, begin, kind)
    first = np.tile(begin, (len(plans), 1))
    # Preallocated, so that the timed call allocates no trajectories.
    states = np.empty((*plans.shape[:2], begin.size))
    torques, pool = np.ascontiguousarray(plans), rollout.Rollout(nthread=0)

    def run() -> Array:
        pool.rollout(
            mj,
            data,
            first,
            torques,
            control_spec=mujoco.mjtState.mjSTATE_QFRC_APPLIED,
            state=states,
        )
        return states[:, -1, 1 : 1 + mj.nq].copy()  # the first number is the time

    return run


def rollouts(
    chain: Chain, plans: Array, dt: float, start: tuple[Array, Array], gravity: ArrayLike
) -> Callable[[], Array]:
    """Return a function that rolls out K plans of torques with `mujoco.batch`, on one thread.

    Args:
        chain: the arm; one without branches, as its joints are taken in MuJoCo's order.
        plans: shape (K, T, n), each torque held for a step of RK4.
        dt: the step [s].
        start: (q, v), shape (n,) each.
        gravity: shape (3,) [m/s^2].

    Returns:
        What gives the last joint positions, shape (K, n).
    """
    mujoco, mj = library(), model(chain, gravity)
    from mujoco import batch

    mj.opt.timestep, mj.opt.integrator = dt, mujoco.mjtIntegrator.mjINT_RK4
    count = batch.Batch(mj, len(plans), 1)
    q, v, torque = (count.bind(name) for name in ("qpos", "qvel", "qfrc_applied"))
    # One contiguous block of torques per step.
    rows = np.ascontiguousarray(plans.transpose(1, 0, 2))

    def run() -> Array:
        count.state[:] = 0.0
        q[:], v[:] = start
        for row in rows:
            torque[:] = row
            count.step(nstep=1)
        return np.array(q)

    return run
