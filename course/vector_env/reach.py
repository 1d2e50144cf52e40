"""A two-link arm that reaches for a point, as a closed-form model: one environment or N in a batch.

The question: how much reward does a policy collect on its way, and does it get there? So the scene
is the smallest that moves the tip as it should: two uniform rods in a horizontal plane (gravity
does no work there), viscous friction in the joints, torques that are held for one control step of
20 ms and stop at the motors' limits. The equations of motion are chapter 4's
(`course.kinematics.two_link`).

One step of the classical Runge-Kutta method of chapter 1 a control step moves the tip to within
about 0.1 mm of the exact motion, where 2 mm, a tenth of the target's radius, would do; the chart
`vector_env` has the measured figures.

The single environment is the batch with one column: the same compiled code.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from gymnasium import Env, spaces
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from numba import types
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, invalid, one_of
from course.compiled import MATRIX, compiled
from course.kinematics.two_link import LENGTHS, TwoLink, acceleration
from course.rigid_body.integrators import rk4
from course.vector_env.arrays import ArrayVectorEnv, Ids, Moved
from course.vector_env.interface import checked_batch, earlier_limit
from course.vector_env.picture import reach_picture

Array = NDArray[np.float64]

CONTROL_STEP = 0.02  # s
RADIUS = 0.02  # m, of the target
EFFORT_COST = 0.01  # reward per unit of squared action
MAX_STEPS = 100  # control steps until an episode is cut off
METADATA: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / CONTROL_STEP)}
REACH_FAR, REACH_NEAR = 0.95, 0.05  # m/m and m: how far the targets keep off the workspace's edges


def table(arms: TwoLink | Sequence[TwoLink], num_envs: int) -> Array:
    """Return the parameters of `num_envs` arms, shape (13, num_envs).

    Give one arm for all, or one for each.
    """
    each = [arms] * num_envs if isinstance(arms, TwoLink) else list(arms)
    if len(each) != num_envs or not all(isinstance(arm, TwoLink) for arm in each):
        raise invalid("arms", arms, f"a TwoLink or {num_envs} of them")
    # Each arm is checked once, however many environments share it.
    for arm in set(each):
        if arm.payload or arm.gravity:
            raise invalid("(payload, gravity)", (arm.payload, arm.gravity), "(0, 0) in this task")
    return np.ascontiguousarray(np.concatenate([arm.column() for arm in each], axis=1))


# --- compiled -------------------------------------------------------------------------------------


@register_jitable
def _observe(q, v, target, arm, i, row):
    """Write the observation of environment i into `row`; its distance to the target [m]."""
    c1, s1, c2, s2 = np.cos(q[0, i]), np.sin(q[0, i]), np.cos(q[1, i]), np.sin(q[1, i])
    # Tip by forward kinematics, with the addition theorems for the sum of both angles.
    dx = arm[5, i] * c1 + arm[6, i] * (c1 * c2 - s1 * s2) - target[0, i]
    dy = arm[5, i] * s1 + arm[6, i] * (s1 * c2 + c1 * s2) - target[1, i]
    row[0], row[1], row[2], row[3] = c1, s1, c2, s2
    row[4], row[5], row[6], row[7] = v[0, i], v[1, i], dx, dy
    return np.sqrt(dx * dx + dy * dy)


@register_jitable
def _judge(q, v, target, steps, actions, arm, limit):
    n = q.shape[1]
    observations, rewards = np.empty((n, 8)), np.empty(n)
    terminated, truncated = np.empty(n, np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        distance = _observe(q, v, target, arm, i, observations[i])
        # The reward counts the torque that acted, not the one that was asked for.
        a1, a2 = _held(actions[i, 0]), _held(actions[i, 1])
        rewards[i] = -distance - EFFORT_COST * (a1 * a1 + a2 * a2)
        steps[i] += 1
        terminated[i], truncated[i] = distance < RADIUS, steps[i] >= limit
    return observations, rewards, terminated, truncated


@register_jitable
def _held(action):
    return min(1.0, max(-1.0, np.float64(action)))


def _move_arms(q, v, target, steps, actions, arm, limit, substeps):
    """Step N arms in place; the torques stop at their limits. Returns what `_judge` returns."""
    # The torque is held during the control step, so it travels with the parameters.
    for i in range(q.shape[1]):
        arm[11, i] = arm[7, i] * _held(actions[i, 0])
        arm[12, i] = arm[8, i] * _held(actions[i, 1])
    x, w = q, v
    # Classical Runge-Kutta steps, with the torques held through the whole control step.
    for _ in range(substeps):
        x, w = rk4(x, w, acceleration, CONTROL_STEP / substeps, arm)
    # The state belongs to the task, so it is updated in place.
    q[:], v[:] = x, w
    return _judge(q, v, target, steps, actions, arm, limit)


def _judge_arms(q, v, target, steps, actions, arm, limit):
    """Return observations, rewards and ends of N arms that have been moved by somebody else."""
    return _judge(q, v, target, steps, actions, arm, limit)


def _start_arms(draws, ids, q, v, target, steps, arm):
    """Put the arms `ids` to a random posture at rest, with a random target; their observations.

    Four draws from [0, 1) each: both angles over a full turn, then the target, uniform over the
    area of the ring that the tip can reach.
    """
    observations = np.empty((ids.size, 8))
    for k in range(ids.size):
        i = ids[k]
        # In a fixed order of draws, so that one arm of a batch starts as a single one does.
        for j in range(2):
            q[j, i] = np.pi * (2.0 * draws[k, j] - 1.0)
            v[j, i] = 0.0
        # Targets keep off the edges of the workspace, where the arm is stretched or folded:
        # singular.
        near = abs(arm[5, i] - arm[6, i]) + REACH_NEAR
        far = REACH_FAR * (arm[5, i] + arm[6, i])
        # The square of the radius is uniform, and so the target over the area.
        radius = np.sqrt(near * near + draws[k, 2] * (far * far - near * near))
        angle = 2.0 * np.pi * draws[k, 3]
        target[0, i], target[1, i] = radius * np.cos(angle), radius * np.sin(angle)
        steps[i] = 0
        _observe(q, v, target, arm, i, observations[k])
    return observations


_FLAGS = types.Array(numba.bool_, 1, "C")
_COUNTS = types.Array(numba.int64, 1, "C")
_VECTOR = types.Array(numba.float64, 1, "C")
_ACTIONS = types.Array(numba.float32, 2, "C")
_MOVED = types.Tuple((MATRIX, _VECTOR, _FLAGS, _FLAGS))
_STATE = (MATRIX, MATRIX, MATRIX, _COUNTS)


@functools.cache
def kernels() -> tuple[Any, Any, Any]:
    """Return the compiled functions: move, judge, start."""
    return (
        compiled(_move_arms, _MOVED(*_STATE, _ACTIONS, MATRIX, numba.int64, numba.int64)),
        compiled(_judge_arms, _MOVED(*_STATE, _ACTIONS, MATRIX, numba.int64)),
        compiled(_start_arms, MATRIX(MATRIX, _COUNTS, *_STATE, MATRIX)),
    )


# --- environments ---------------------------------------------------------------------------------


class ReachTask:
    """The part of the task that does not depend on who moves the arm.

    Attributes:
        q, v: joint angles [rad] and their rates, (2, N).
        target: the targets [m], (2, N).
        steps: control steps of the running episode, (N,).
        arm: the parameters, see `TwoLink.column`, (13, N).
    """

    def __init__(self, parameters: Array, max_steps: int) -> None:
        n = parameters.shape[1]
        self.arm = parameters
        self.max_steps = count("max_steps", max_steps, 1)
        self.q, self.v, self.target = np.zeros((2, n)), np.zeros((2, n)), np.zeros((2, n))
        self.steps = np.zeros(n, dtype=np.int64)
        self._move, self._judge, self._start = kernels()

    def start(self, ids: Ids, generators: Sequence[np.random.Generator]) -> Array:
        """Draw new postures and targets for `ids`; return their observations, (len(ids), 8)."""
        draws = np.array([generator.random(4) for generator in generators])
        return self._start(draws, ids, self.q, self.v, self.target, self.steps, self.arm)

    def move(self, actions: NDArray[Any], substeps: int) -> Moved:
        """Move the closed-form arms, and judge."""
        return self._move(
            self.q, self.v, self.target, self.steps, actions, self.arm, self.max_steps, substeps
        )

    def judge(self, actions: NDArray[Any]) -> Moved:
        """Judge arms whose q and v somebody else has brought up to date."""
        return self._judge(
            self.q, self.v, self.target, self.steps, actions, self.arm, self.max_steps
        )

    def picture(self, i: int) -> NDArray[np.uint8]:
        """Return TwoLink i and its target, see `reach_picture`."""
        return reach_picture(self.q[:, i], self.target[:, i], self.arm[LENGTHS, i], RADIUS)


def reach_spaces() -> tuple[Any, Any]:
    """Return spaces of a single observation and a single action."""
    # Sines and cosines lie in [-1, 1]; the other components are declared without a bound.
    bound = np.array([1.0, 1.0, 1.0, 1.0, np.inf, np.inf, np.inf, np.inf])
    return (
        spaces.Box(-bound, bound, dtype=np.float64),
        spaces.Box(-1.0, 1.0, (2,), dtype=np.float32),
    )


class SingleReach(Env[Array, NDArray[np.float32]]):
    """A reaching environment; a subclass moves the arm.

    Observation (8,): cos q1, sin q1, cos q2, sin q2, the joints' rates [rad/s], and the way from
    the target to the tip, x and y [m]. Action (2,): torques as shares of their limits; beyond 1
    they stay at the limit. Reward: minus the distance [m], minus 0.01 times the squared action.
    Terminated when the tip is within 2 cm of the target at the end of a control step; truncated
    after `max_steps` of them. The last info of an episode has "is_success".
    """

    metadata = METADATA

    def __init__(
        self,
        arm: TwoLink | None = None,
        *,
        max_steps: int = MAX_STEPS,
        render_mode: str | None = None,
    ) -> None:
        """Make the arm.

        Args:
            arm: its parameters.
            max_steps: control steps of 20 ms until the episode is truncated.
            render_mode: "rgb_array" for pictures; None for none.
        """
        self.render_mode = one_of("render_mode", render_mode, (None, *METADATA["render_modes"]))
        self.parameters = arm or TwoLink()
        self.task = ReachTask(table(self.parameters, 1), max_steps)
        self.observation_space, self.action_space = reach_spaces()
        self._row = spaces.Box(-1.0, 1.0, (1, 2), dtype=np.float32)
        self._only = np.zeros(1, dtype=np.intp)
        self._started = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Return a random posture at rest and a random target. There are no options."""
        super().reset(seed=seed)
        self._started = True
        observation = self.task.start(self._only, [self.np_random])[0]
        self._placed()
        return observation, {}

    def step(self, action: ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Advance the arm by one control step.

        Raises:
            ValueError: for an action that is not two numbers.
            ResetNeeded: before the first reset.
        """
        if not self._started:
            raise ResetNeeded("call reset before step")
        array = np.asarray(action)
        if array.shape != (2,):
            raise invalid("action.shape", array.shape, "(2,)")
        observations, rewards, terminated, truncated = self._move(
            checked_batch(self._row, array[None], "action")
        )
        reached, late = bool(terminated[0]), bool(truncated[0])
        info = {"is_success": reached} if reached or late else {}
        return observations[0], float(rewards[0]), reached, late, info

    def render(self) -> Any:
        """Return the arm and its target as they are now, (300, 300, 3); None without a render mode.

        Raises:
            ResetNeeded: before the first reset.
        """
        if not self._started:
            raise ResetNeeded("call reset before render")
        return None if self.render_mode is None else self.task.picture(0)

    def _placed(self) -> None:
        """Called when the task has put the arm somewhere."""

    def _move(self, actions: NDArray[Any]) -> Moved:
        raise TypeError("this class moves nothing: use ArmReach or MujocoArmReach")


class ArmReach(SingleReach):
    """The reaching task on the closed-form arm."""

    def __init__(self, arm: TwoLink | None = None, *, substeps: int = 1, **task: Any) -> None:
        """Make the arm.

        Args:
            arm: its parameters.
            substeps: Runge-Kutta steps in a control step.
            **task: `max_steps` and `render_mode`, see `SingleReach`.
        """
        super().__init__(arm, **task)
        self.substeps = count("substeps", substeps, 1)

    def _move(self, actions: NDArray[Any]) -> Moved:
        return self.task.move(actions, self.substeps)


class ReachVector(ArrayVectorEnv):
    """N reaching environments in arrays; a subclass moves the arms."""

    def __init__(
        self,
        num_envs: int = 1,
        arms: TwoLink | Sequence[TwoLink] | None = None,
        *,
        max_steps: int = MAX_STEPS,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Make the arms.

        Args:
            num_envs: how many, at least 1.
            arms: the parameters, for all or one each.
            max_steps: control steps of 20 ms until an episode is truncated.
            max_episode_steps: the same, as `gymnasium.make_vec` passes it; the smaller one counts,
                as it does under Gymnasium's `TimeLimit`.
            render_mode: "rgb_array" for pictures; None for none.
            autoreset_mode: see `course.vector_env`.
        """
        count("num_envs", num_envs, 1)
        limit = earlier_limit(max_steps, max_episode_steps)
        self.task = ReachTask(table(arms or TwoLink(), num_envs), limit)
        super().__init__(SingleReach(render_mode=render_mode), num_envs, autoreset_mode)

    def _start(self, ids: Ids, generators: list[np.random.Generator]) -> Array:
        return self.task.start(ids, generators)

    def _final_info(
        self, finished: NDArray[np.bool_], terminations: NDArray[np.bool_]
    ) -> dict[str, Any]:
        return {"is_success": terminations.copy()}

    def render(self) -> Any:
        """Return what each environment renders, as in `SingleReach.render`."""
        if self._observations is None:
            raise ResetNeeded("call reset before render")
        if self.render_mode is None:
            return None
        return tuple(self.task.picture(i) for i in range(self.num_envs))


class ArmReachVector(ReachVector):
    """N closed-form arms, each with its own parameters, moved by one compiled call.

    The same results as `VectorizedEnv` over `ArmReach`, bit for bit.
    """

    def __init__(
        self,
        num_envs: int = 1,
        arms: TwoLink | Sequence[TwoLink] | None = None,
        *,
        substeps: int = 1,
        **task: Any,
    ) -> None:
        """Make the arms.

        Args:
            num_envs: how many, at least 1.
            arms: the parameters, for all or one each.
            substeps: Runge-Kutta steps in a control step.
            **task: `max_steps`, `render_mode` and `autoreset_mode`, see `ReachVector`.
        """
        self.substeps = count("substeps", substeps, 1)
        super().__init__(num_envs, arms, **task)

    def _move(self, actions: NDArray[Any]) -> Moved:
        return self.task.move(actions, self.substeps)
