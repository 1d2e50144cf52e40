"""A point in the plane that is pushed to a disc: the smallest task of reinforcement learning.

The question: how much of the best that is possible does a learner get? So the scene is the smallest
whose best is known exactly: a point at rest, an acceleration of at most 1 m/s^2 along each axis,
held for a step of 50 ms, velocity first (semi-implicit Euler); the episode ends in a disc of 5 cm
around the goal. Whatever the accelerations, after k steps the point is in a box of half-width
dt^2 k (k + 1) / 2 around where it would have drifted, and everywhere in that box it can be. The
least number of steps is that of the first box that meets the disc, and of a prize of 1 that many
steps away, discounted, nobody gets more than 0.99^(steps - 1).

Left out: drag, walls, noise, size. The task has no tolerance to lose by that; it is its own truth.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
from gymnasium import Env, spaces
from gymnasium.vector import AutoresetMode
from numba import types
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, one_of, positive, vector
from course.compiled import MATRIX, VECTOR, compiled
from course.vector_env.arrays import ArrayVectorEnv, Ids, Moved
from course.vector_env.interface import checked_batch, earlier_limit

Array = NDArray[np.float64]

DT, RADIUS, MAX_STEPS, DISCOUNT = 0.05, 0.05, 100, 0.99  # s, m, steps, of the prize a step
NEAR, BONUS = 0.5, 0.02  # m around the goal, and what a step in there pays, of "hover" and "once"
METADATA: dict[str, Any] = {"render_modes": []}
REWARDS = ("sparse", "distance", "potential", "hover", "once")


def plan(paths: ArrayLike, *, radius: float = RADIUS, dt: float = DT) -> tuple[Any, Array]:
    """Return the least number of steps into the disc, and a first acceleration that needs no more.

    Held for all of these steps it gets there; asked for anew at every step it is the best policy.

    Args:
        paths: observations of `PointReach`, in metres: goal minus point and velocity, (n, 4).
        radius: of the disc [m].
        dt: step [s].

    Returns:
        Steps from 1 on, whole numbers (n,), and actions (n, 2) [m/s^2].
    """
    distance, speed = np.split(vector("paths", paths, (None, 4)), 2, axis=1)
    steps, result = np.zeros(len(distance), dtype=np.int64), np.zeros((len(distance), 2))
    remaining, k = np.arange(len(distance)), 0
    while remaining.size:
        k += 1
        # Reachable set after k steps of semi-implicit Euler: a square of this half width.
        half = 0.5 * dt * dt * k * (k + 1)
        # What drifting leaves to cover, clipped to that square: the nearest point within reach.
        desired = distance[remaining] - dt * k * speed[remaining]
        aimed = np.clip(desired, -half, half)
        other = np.hypot(*(desired - aimed).T) < radius
        # Held for k steps, this share of the full acceleration ends at that point.
        steps[remaining[other]], result[remaining[other]] = k, aimed[other] / half
        remaining = remaining[~other]
    return steps, result


def optimum(
    paths: ArrayLike,
    reward: str = "sparse",
    *,
    bonus: float = BONUS,
    max_steps: int = MAX_STEPS,
    **disc: float,
) -> Array:
    """Return the highest return that an episode can have, from its start.

    The prize is 1, discounted by 0.99.

    "sparse": 0.99^(least steps - 1). "potential" adds the first distance in every episode that
    reaches the disc. "once" adds the bonus. With "hover" an end put off by a step loses 1 - 0.99
    of the prize and wins a bonus: either it pays to go at once, or to wait outside the disc until
    the last step.

    Args:
        paths: first observations, points at rest, shape (n, 4) [m].
        reward: one of these four; the best return for "distance" has no closed form.
        max_steps: time limit of the task.
        bonus: reward at the goal.
        **disc: `radius` and `dt` of the task.
    """
    least, _ = plan(paths, **disc)
    prize = DISCOUNT ** (least - 1.0)
    kind = one_of("reward", reward, ("sparse", "potential", "hover", "once"))
    if kind == "hover":
        # For both ends the geometric sum of the bonus, and the discounted prize; the better one
        # counts.
        ends = np.stack([least, np.full_like(least, max_steps)])
        worth = bonus * (1.0 - DISCOUNT**ends) / (1.0 - DISCOUNT) + DISCOUNT ** (ends - 1.0)
        return worth.max(axis=0)
    first = np.hypot(*np.asarray(paths, dtype=float)[:, :2].T)
    return prize + {"sparse": 0.0, "potential": first, "once": bonus}[kind]


# --- compiled -------------------------------------------------------------------------------------


def _observe(p, v, goal, numbers, i, row):
    """Write the observation of environment i; its distance to the goal [m]."""
    unit, offset = numbers[6], numbers[7]
    x, y = goal[0, i] - p[0, i], goal[1, i] - p[1, i]
    row[0], row[1] = offset + unit * x, offset + unit * y
    row[2], row[3] = offset + unit * v[0, i], offset + unit * v[1, i]
    return np.sqrt(x * x + y * y)


_look_at = numba.extending.register_jitable(_observe)


@numba.extending.register_jitable
def move_points(p, v, goal, steps, actions, numbers):
    """Step N points in place; observations, rewards, terminations, truncations."""
    dt, radius, limit, kind, prize, bonus = numbers[:6]
    n = p.shape[1]
    observations, rewards = np.empty((n, 4)), np.empty(n)
    terminated, truncated = np.empty(n, np.bool_), np.empty(n, np.bool_)
    for i in range(n):
        # The distance before the move, for the potential.
        before = np.sqrt((goal[0, i] - p[0, i]) ** 2 + (goal[1, i] - p[1, i]) ** 2)
        # Semi-implicit Euler; the action is clipped to -1 to 1 on each axis.
        for j in range(2):
            v[j, i] += dt * min(1.0, max(-1.0, np.float64(actions[i, j])))
            p[j, i] += dt * v[j, i]
        distance = _look_at(p, v, goal, numbers, i, observations[i])
        steps[i] += 1
        other = distance < radius
        reward = prize if other else 0.0
        if kind == 1.0:  # distance
            reward -= distance
        elif kind == 2.0:  # potential: minus the distance, and 0 where the episode has ended
            # Potential-based shaping, gamma phi' - phi with phi = -distance (Ng, Harada and
            # Russell, 1999).
            reward += before - (0.0 if other else DISCOUNT * distance)
        elif kind >= 3.0 and distance < NEAR:  # hover at every step, once at the first
            reward += bonus if kind == 3.0 or steps[i] == 1 else 0.0
        rewards[i], terminated[i], truncated[i] = reward, other, steps[i] >= limit
    return observations, rewards, terminated, truncated


@numba.extending.register_jitable
def start_points(draws, ids, p, v, goal, steps, numbers):
    """Put the points `ids` at rest; their observations. Four draws from [0, 1) each.

    Point and goal are uniform in a square of 2 m; with a bonus for being near the goal is uniform
    over the ring between the disc and NEAR.
    """
    observations = np.empty((ids.size, 4))
    for k in range(ids.size):
        i = ids[k]
        for j in range(2):
            p[j, i], v[j, i] = 2.0 * draws[k, j] - 1.0, 0.0
            goal[j, i] = 2.0 * draws[k, 2 + j] - 1.0
        if numbers[3] >= 3.0:
            # Uniform in the ring between the disc's radius and NEAR.
            inner = numbers[1] ** 2
            length = np.sqrt(inner + draws[k, 2] * (NEAR**2 - inner))
            goal[0, i] = p[0, i] + length * np.cos(2.0 * np.pi * draws[k, 3])
            goal[1, i] = p[1, i] + length * np.sin(2.0 * np.pi * draws[k, 3])
        steps[i] = 0
        _look_at(p, v, goal, numbers, i, observations[k])
    return observations


_FLAGS, _COUNTS = types.Array(numba.bool_, 1, "C"), types.Array(numba.int64, 1, "C")
_ACTIONS = types.Array(numba.float32, 2, "C")
_STATE = (MATRIX, MATRIX, MATRIX, _COUNTS)


@functools.cache
def kernels() -> tuple[Any, Any]:
    """Return the compiled functions: move, start."""
    moved = types.Tuple((MATRIX, VECTOR, _FLAGS, _FLAGS))
    return (
        compiled(move_points, moved(*_STATE, _ACTIONS, VECTOR)),
        compiled(start_points, MATRIX(MATRIX, _COUNTS, *_STATE, VECTOR)),
    )


# --- environments ---------------------------------------------------------------------------------


class PointTask:
    """N points and their goals; the arguments are those of `PointReach`.

    Attributes:
        p, v, goal: positions [m], velocities [m/s] and goals [m], each (2, N).
        steps: of the running episode, (N,).
    """

    def __init__(
        self,
        n: int,
        reward: str = "sparse",
        *,
        max_steps: int = MAX_STEPS,
        radius: float = RADIUS,
        dt: float = DT,
        prize: float = 1.0,
        bonus: float = BONUS,
        unit: float = 1.0,
        offset: float = 0.0,
    ) -> None:
        kind = REWARDS.index(one_of("reward", reward, REWARDS))
        self.numbers = np.array(
            [
                positive("dt", dt, unit="s"),
                finite("radius", radius, 1e-3, 0.4, unit="m"),
                count("max_steps", max_steps, 1),
                kind,
                finite("prize", prize),
                finite("bonus", bonus, 0.0),
                positive("unit", unit),
                finite("offset", offset),
            ]
        )
        self.p, self.v, self.goal = np.zeros((3, 2, n))
        self.steps = np.zeros(n, dtype=np.int64)
        self._step, self._put = kernels()

    def start(self, ids: Ids, generators: Sequence[np.random.Generator]) -> Array:
        """Place new points and goals for `ids`; return their observations, (len(ids), 4)."""
        # A generator for each environment: its starts do not depend on the others.
        draws = np.array([generator.random(4) for generator in generators])
        return self._put(draws, ids, self.p, self.v, self.goal, self.steps, self.numbers)

    def move(self, actions: NDArray[Any]) -> Moved:
        """Advance all points by one step."""
        return self._step(self.p, self.v, self.goal, self.steps, actions, self.numbers)


class PointReach(Env[Array, NDArray[np.float32]]):
    """A point that is pushed to a disc, one episode at a time.

    Observation (4,): goal minus point [m] and velocity [m/s], each times `unit` plus `offset`.
    Action (2,): acceleration along x and y [m/s^2]; beyond 1 it stays at 1. Terminated inside the
    disc at the end of a step, truncated after `max_steps`; the last info has "is_success".

    Rewards, each with the `prize` for reaching the disc: "sparse" nothing else; "distance" minus
    the distance [m]; "potential" the discounted difference of minus the distance, 0 at the end
    (chapter 8's `shaped`); "hover" a `bonus` for every step within 0.5 m of the goal, where the
    episode then starts; "once" that bonus for the first step only.
    """

    metadata = METADATA

    def __init__(self, reward: str = "sparse", **task: Any) -> None:
        """Make the task.

        Args:
            reward: one of `REWARDS`.
            **task: `max_steps`, `radius` of the disc [m], `dt` [s], `prize`, `bonus`, and `unit`
                and `offset` of the observations, which change what a learner sees and nothing else.
        """
        self.task = PointTask(1, reward, **task)
        # As far and as fast as pushing one way for a whole episode takes it.
        dt, limit, unit, offset = self.task.numbers[[0, 2, 6, 7]]
        largest = unit * np.array([2.0 + 0.5 * dt * dt * limit * (limit + 1.0), dt * limit])
        bound = np.repeat(largest, 2)
        self.observation_space = spaces.Box(offset - bound, offset + bound, dtype=np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (2,), np.float32)
        self._row = spaces.Box(-1.0, 1.0, (1, 2), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Return a random point at rest and a random goal. There are no options."""
        super().reset(seed=seed)
        return self.task.start(np.zeros(1, np.intp), [self.np_random])[0], {}

    def step(self, action: ArrayLike) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Push for one step."""
        observed, rewards, over, late = self.task.move(checked_batch(self._row, [action]))
        info = {"is_success": bool(over[0])} if over[0] or late[0] else {}
        return observed[0], float(rewards[0]), bool(over[0]), bool(late[0]), info


class PointReachVector(ArrayVectorEnv):
    """N points in arrays, moved by one compiled call; the same results as N of `PointReach`."""

    def __init__(
        self,
        num_envs: int = 1,
        reward: str = "sparse",
        *,
        max_steps: int = MAX_STEPS,
        max_episode_steps: int | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **task: Any,
    ) -> None:
        """Make the points; see `PointReach`, and `course.vector_env` for autoreset and limits."""
        task["max_steps"] = earlier_limit(max_steps, max_episode_steps)
        self.task = PointTask(count("num_envs", num_envs, 1), reward, **task)
        super().__init__(PointReach(reward, **task), num_envs, autoreset_mode)

    def _start(self, ids: Ids, generators: list[np.random.Generator]) -> Array:
        return self.task.start(ids, generators)

    def _move(self, actions: NDArray[Any]) -> Moved:
        return self.task.move(actions)

    def _final_info(
        self, finished: NDArray[np.bool_], terminations: NDArray[np.bool_]
    ) -> dict[str, Any]:
        return {"is_success": terminations.copy()}
