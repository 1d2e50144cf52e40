"""The vector environment that steps its environments one after the other."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from gymnasium import Env
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import concatenate, create_empty_array, iterate
from numpy.typing import NDArray

from course.check import count, invalid
from course.vector_env.interface import AutoresettingVectorEnv, Lane, check_spaces

Batch = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


class VectorizedEnv(AutoresettingVectorEnv):
    """`num_envs` environments of any kind, stepped in a loop.

    What comes back is new at every call; nothing of it changes later.

    Attributes:
        envs: the environments.
    """

    def __init__(
        self,
        env_fn: Callable[[], Env[Any, Any]],
        num_envs: int,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Build the environments.

        Args:
            env_fn: builds one; called `num_envs` times.
            num_envs: how many, at least 1.
            autoreset_mode: see `course.vector_env`.

        Raises:
            ValueError: for an env_fn that is no function, that hands out the same environment twice
                or environments with unequal spaces; for a num_envs below 1.
        """
        count("num_envs", num_envs, 1)
        if not callable(env_fn):
            raise invalid("env_fn", env_fn, "a function that builds an environment")
        self.envs: list[Env[Any, Any]] = []
        try:
            for i in range(num_envs):
                env = env_fn()
                # A function that returns the same object would step one environment several times.
                if any(env is other for other in self.envs):
                    raise invalid("env_fn()", "the same", "a new environment at every call")
                self.envs.append(env)
                first = self.envs[0]
                check_spaces(env, first.observation_space, first.action_space, i)
            self._adopt(self.envs[0], num_envs, autoreset_mode)
        except BaseException:
            # Close those that were built before the error goes on to the caller.
            self.close()
            raise
        self._lanes = [Lane(env, self.autoreset_mode) for env in self.envs]
        self._latest: list[Any] = [None] * num_envs

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict]:
        """Start new episodes.

        Args:
            seed: None, an int s (environment i gets s + i), or a list of one int or None each.
            options: handed to every environment, but for "reset_mask" (bools, one for each
                environment), which picks those to reset.

        Returns:
            Observations (num_envs, ...), infos.
        """
        self._assert_open()
        ids, seeds, options = self._plan_reset(seed, options)
        infos: dict[str, Any] = {}
        for i in ids:
            self._latest[i], info = self._lanes[i].reset(seeds[i], options)
            infos = self._add_info(infos, info, i)
        self._over[ids], self._begun[ids] = False, True
        return self._observations(), infos

    def step(self, actions: Any) -> Batch:
        """Step every environment once; the mode says what becomes of those that are over.

        Args:
            actions: one for each environment, (num_envs, ...).

        Returns:
            Observations, rewards, terminations, truncations (num_envs, ...), infos.

        Raises:
            ValueError: for the wrong number, shape or kind of actions.
            ResetNeeded: in the mode DISABLED, if an environment that is over was not reset.
        """
        self._assert_open()
        batch = self._checked_actions(actions)
        rewards = np.empty(self.num_envs)
        terminations = np.empty(self.num_envs, dtype=np.bool_)
        truncations = np.empty(self.num_envs, dtype=np.bool_)
        infos: dict[str, Any] = {}
        for i, action in enumerate(iterate(self.action_space, batch)):
            try:
                result = self._lanes[i].step(action)
            except Exception as error:
                # A note says which environment it was and leaves the type of the exception alone.
                error.add_note(f"raised by environment {i} of {self.num_envs}")
                raise
            self._latest[i], rewards[i], terminations[i], truncations[i], info, final = result
            # SAME_STEP: the last observation of the old episode travels in the infos.
            if final is not None:
                infos = self._add_info(infos, {"final_obs": final[0], "final_info": final[1]}, i)
            infos = self._add_info(infos, info, i)
        self._over = terminations | truncations
        return self._observations(), rewards, terminations, truncations, infos

    def _observations(self) -> Any:
        space = self.single_observation_space
        # Into a new array every time, so that nothing returned earlier changes.
        empty: Any = create_empty_array(space, self.num_envs, fn=np.zeros)
        return concatenate(space, self._latest, empty)

    def render(self) -> tuple[Any, ...]:
        """Return what each environment renders."""
        return self.call("render")

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of every environment, or read an attribute, through its wrappers."""
        self._assert_open()
        # All are looked up first, so that a missing attribute fails before any call.
        result = [env.get_wrapper_attr(name) for env in self.envs]
        return tuple(item(*args, **kwargs) if callable(item) else item for item in result)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of every environment."""
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every environment: a list of one value each, or one value for all."""
        self._assert_open()
        for env, value in zip(self.envs, spread(values, self.num_envs), strict=True):
            env.set_wrapper_attr(name, value)

    def close_extras(self, **kwargs: Any) -> None:
        """Close every environment, also when one of them raises."""
        # All are closed first; then the first error is raised, if there was one.
        errors = []
        for env in self.envs:
            try:
                env.close()
            except Exception as error:
                errors.append(error)
        if errors:
            self.closed = True
            raise errors[0]


def spread(values: Any, num_envs: int) -> list[Any]:
    """Return `values` as one for each environment."""
    spread_out = list(values) if isinstance(values, list | tuple) else [values] * num_envs
    if len(spread_out) != num_envs:
        raise invalid("len(values)", len(spread_out), f"{num_envs}, one for each environment")
    return spread_out
