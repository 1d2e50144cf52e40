"""The reaching task of `course.vector_env.reach` with MuJoCo moving the arm, single and in a batch.

Observation, reward and ends are the task's own; MuJoCo computes the motion alone. What the task has
not is switched off: contacts and constraints, gravity, springs, sensors, actuators (the torques go
in as applied forces, which costs less), automatic reset.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.check import count, one_of
from course.kinematics.two_link import LIMITS, TwoLink
from course.oracles.mujoco.kit import ALWAYS_OFF, CONTACT_OFF, MUJOCO_INTEGRATORS, library
from course.vector_env.arrays import Ids, Moved
from course.vector_env.reach import (
    CONTROL_STEP,
    ReachVector,
    SingleReach,
)

Array = NDArray[np.float64]

_OFF = " ".join(f'{flag}="disable"' for flag in (*ALWAYS_OFF, *CONTACT_OFF, "gravity", "spring"))
# The numbers in it are only there to compile; `_fields` has the arm's. Without contacts MuJoCo
# works in next to no memory; by default it takes megabytes for each of a thousand environments.
_XML = (
    '<mujoco><compiler angle="radian"/><size memory="64K"/>'
    '<option timestep="{step:.17g}" integrator="{integrator}">'
    f"<flag {_OFF}/></option><worldbody>"
    '<body><joint type="hinge" axis="0 0 1"/><inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/>'
    '<body pos="1 0 0"><joint type="hinge" axis="0 0 1"/>'
    '<inertial pos="1 0 0" mass="1" diaginertia="1 1 1"/></body></body></worldbody></mujoco>'
)


def _model(integrator: str, substeps: int) -> Any:
    count("substeps", substeps, 1)
    one_of("integrator", integrator, MUJOCO_INTEGRATORS)
    text = _XML.format(step=CONTROL_STEP / substeps, integrator=integrator)
    return library().MjModel.from_xml_string(text)


def _fields(arm: TwoLink) -> dict[str, Array]:
    """Return the fields of MuJoCo's model that an arm sets: world, first link, second link."""
    (m1, m2), (l1, l2), (i1, i2) = arm.masses, arm.lengths, arm.inertias
    return {
        "body_mass": np.array([0.0, m1, m2]),
        "body_inertia": np.array([[0.0] * 3, [i1] * 3, [i2] * 3]),
        "body_ipos": np.array([[0.0] * 3, [0.5 * l1, 0.0, 0.0], [0.5 * l2, 0.0, 0.0]]),
        "body_pos": np.array([[0.0] * 3, [0.0] * 3, [l1, 0.0, 0.0]]),
        "dof_damping": np.array(arm.damping),
    }


class MujocoArmReach(SingleReach):
    """The reaching task on MuJoCo's arm."""

    def __init__(
        self,
        arm: TwoLink | None = None,
        *,
        integrator: str = "RK4",
        substeps: int = 1,
        **task: Any,
    ) -> None:
        """Make the model.

        Args:
            arm: its parameters.
            integrator: one of MuJoCo's.
            substeps: MuJoCo's steps in a control step.
            **task: `max_steps` and `render_mode`, see `SingleReach`.
        """
        super().__init__(arm, **task)
        mujoco = library()
        self.substeps = substeps
        self.model = _model(integrator, substeps)
        self.data = mujoco.MjData(self.model)
        for name, value in _fields(self.parameters).items():
            getattr(self.model, name)[:] = value
        mujoco.mj_setConst(self.model, self.data)
        self._step = mujoco.mj_step
        self._limits = np.array(self.parameters.torques)
        # Views of MuJoCo's own memory, made once.
        self._qpos, self._qvel = self.data.qpos, self.data.qvel
        self._torque = self.data.qfrc_applied

    def _placed(self) -> None:
        self._qpos[:], self._qvel[:] = self.task.q[:, 0], self.task.v[:, 0]

    def _move(self, actions: NDArray[Any]) -> Moved:
        self._torque[:] = self._limits * actions[0].clip(-1.0, 1.0)
        self._step(self.model, self.data, self.substeps)
        self.task.q[:, 0], self.task.v[:, 0] = self._qpos, self._qvel
        return self.task.judge(actions)


class MujocoArmReachVector(ReachVector):
    """N arms in `mujoco.batch`, stepped on threads, each with its own model parameters.

    The same results as `VectorizedEnv` over `MujocoArmReach`, bit for bit, with any number of
    threads.

    Attributes:
        batch: MuJoCo's batch, for `batch.expand` and all else; call `batch.set_const()` after
            writing model fields.
    """

    def __init__(
        self,
        num_envs: int = 1,
        arms: TwoLink | Sequence[TwoLink] | None = None,
        *,
        threads: int = 0,
        integrator: str = "RK4",
        substeps: int = 1,
        **task: Any,
    ) -> None:
        """Make the batch.

        Args:
            num_envs: how many, at least 1.
            arms: the parameters, for all or one each.
            threads: that step, the caller's own counted; 0 for one a processor.
            integrator: one of MuJoCo's.
            substeps: MuJoCo's steps in a control step.
            **task: `max_steps`, `render_mode` and `autoreset_mode`, see `ReachVector`.
        """
        super().__init__(num_envs, arms, **task)
        count("threads", threads)
        mujoco = library()
        from mujoco import batch

        model = _model(integrator, substeps)
        own = None if arms is None or isinstance(arms, TwoLink) else [_fields(arm) for arm in arms]
        shared = _fields(arms if isinstance(arms, TwoLink) else TwoLink())
        if own is None:
            for name, value in shared.items():
                getattr(model, name)[:] = value
            mujoco.mj_setConst(model, mujoco.MjData(model))
        self.substeps = substeps
        self.batch = batch.Batch(model, num_envs, threads)
        if own is not None:
            for name in shared:
                self.batch.expand(name)[:] = np.array([fields[name] for fields in own])
            self.batch.set_const()
        self._qpos, self._qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._torque = self.batch.bind("qfrc_applied")
        self._limits = np.ascontiguousarray(self.task.arm[LIMITS].T)

    @property
    def threads(self) -> int:
        """How many threads step."""
        return int(self.batch.nthread)

    def _start(self, ids: Ids, generators: list[np.random.Generator]) -> Array:
        observations = super()._start(ids, generators)
        self._qpos[ids], self._qvel[ids] = self.task.q[:, ids].T, self.task.v[:, ids].T
        return observations

    def _move(self, actions: NDArray[Any]) -> Moved:
        np.multiply(self._limits, actions.clip(-1.0, 1.0), out=self._torque)
        self.batch.step(nstep=self.substeps)
        self.task.q[:], self.task.v[:] = self._qpos.T, self._qvel.T
        return self.task.judge(actions)


def stepper(arm: TwoLink, q: Array, v: Array, torques: Array, dt: float) -> Callable[[], Array]:
    """Return a function that advances N arms by one step of RK4 in `mujoco.batch`, on one thread.

    Args:
        arm: the parameters, the same for all.
        q: angles, shape (2, N) [rad]; v, rates, and torques [N m] have the same shape.
        v: see q.
        torques: see q.
        dt: the step [s].

    Returns:
        A function that moves the arms once and returns MuJoCo's own angles, shape (N, 2).
    """
    from mujoco import batch

    arms = batch.Batch(_arm_model(arm, dt), q.shape[1], 1)
    places = arms.bind("qpos")
    places[:], arms.bind("qvel")[:] = q.T, v.T
    arms.bind("qfrc_applied")[:] = torques.T

    def step() -> Array:
        arms.step(nstep=1)
        return np.asarray(places)

    return step


def rollout(
    arm: TwoLink, q: Array, v: Array, torques: Array, dt: float, steps: int
) -> Callable[[], Array]:
    """Return a function that runs N arms through `mujoco.rollout`, on one thread.

    Args:
        arm: the parameters, the same for all.
        q: angles, shape (2, N) [rad]; v, rates, and torques [N m] have the same shape.
        v: see q.
        torques: see q.
        dt: the step [s].
        steps: steps of RK4 in a call, which starts from q and v every time.

    Returns:
        A function that returns the last angles, shape (N, 2).
    """
    mujoco = library()
    from mujoco import rollout as tool

    mj = _arm_model(arm, dt)
    data, n = mujoco.MjData(mj), q.shape[1]
    # The first number of the state is the time.
    first = np.concatenate([np.zeros((1, n)), q, v]).T.copy()
    pushes = np.repeat(torques.T[:, None], steps, axis=1)
    # Preallocated, so that the timed call allocates nothing.
    states, pool = np.empty((n, steps, first.shape[1])), tool.Rollout(nthread=0)

    def run() -> Array:
        pool.rollout(
            mj,
            data,
            first,
            pushes,
            control_spec=mujoco.mjtState.mjSTATE_QFRC_APPLIED,
            state=states,
        )
        return np.asarray(states[:, -1, 1:3])

    return run


def _arm_model(arm: TwoLink, dt: float) -> Any:
    """Return the model of one arm that takes steps of `dt` with RK4."""
    mujoco, mj = library(), _model("RK4", 1)
    mj.opt.timestep = dt
    for name, value in _fields(arm).items():
        getattr(mj, name)[:] = value
    mujoco.mj_setConst(mj, mujoco.MjData(mj))
    return mj
