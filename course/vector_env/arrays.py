"""Vector environments whose states are arrays, stepped by one call for all of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from gymnasium import Env
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from course.vector_env.interface import AutoresettingVectorEnv
from course.vector_env.sequential import Batch

Ids = NDArray[np.intp]
Moved = tuple[
    NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]
]  # observations, rewards, terminations, truncations


class ArrayVectorEnv(AutoresettingVectorEnv, ABC):
    """Autoreset, seeds and infos over a batch; a subclass says how it starts and moves.

    Every environment has a generator of its own, seeded as a single environment's is, so what
    happens in one does not depend on the others.

    Attributes:
        generators: one for each environment; made at the first reset.
    """

    def __init__(
        self, env: Env[Any, Any], num_envs: int, autoreset_mode: AutoresetMode | str
    ) -> None:
        """Take over the spaces.

        Args:
            env: a single environment of the kind, for its spaces and metadata.
            num_envs: how many, at least 1.
            autoreset_mode: see `course.vector_env`.
        """
        self._adopt(env, num_envs, autoreset_mode)
        # Made at the first reset, which brings the seeds.
        self.generators: list[np.random.Generator | None] = [None] * self.num_envs
        self._observations: NDArray[np.float64] | None = None

    @abstractmethod
    def _start(self, ids: Ids, generators: list[np.random.Generator]) -> NDArray[np.float64]:
        """Put these environments to new starts, each drawn from its generator.

        Returns:
            Their first observations, (len(ids), ...).
        """

    @abstractmethod
    def _move(self, actions: Any) -> Moved:
        """Step all environments.

        Returns:
            Observations, rewards, terminations and truncations, new arrays of num_envs rows.
        """

    def _final_info(
        self, finished: NDArray[np.bool_], terminations: NDArray[np.bool_]
    ) -> dict[str, Any]:
        """Return the last infos of episodes that just finished, arrays of num_envs rows."""
        return {}

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict]:
        """Start new episodes; arguments and results as for `VectorizedEnv.reset`."""
        self._assert_open()
        ids, seeds, _ = self._plan_reset(seed, options)
        if self._observations is None:
            self._observations = np.empty(
                self.observation_space.shape or (), dtype=self.observation_space.dtype
            )
        for i in ids:
            # Without a seed the generator goes on where it was, as Gymnasium prescribes.
            if seeds[i] is not None or self.generators[i] is None:
                self.generators[i], _ = seeding.np_random(seeds[i])
        self._over[ids], self._begun[ids] = False, True
        self._observations[ids] = self._begin(ids)
        return self._observations.copy(), {}

    def _begin(self, ids: Ids) -> NDArray[np.float64]:
        drawn_from = [g for i in ids if (g := self.generators[i]) is not None]
        return self._start(ids, drawn_from)

    def step(self, actions: Any) -> Batch:
        """Step every environment once; arguments and results as for `VectorizedEnv.step`.

        Raises:
            ValueError: for the wrong number, shape or kind of actions.
            ResetNeeded: before the first reset.
        """
        self._assert_open()
        if self._observations is None:
            raise ResetNeeded("call reset before step")
        observations, rewards, terminations, truncations = self._move(
            self._checked_actions(actions)
        )
        infos: dict[str, Any] = {}
        # NEXT_STEP: this step is the reset of those that ended in the last one.
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and self._over.any():
            # Their action is not used: what the kernel did to them is overwritten.
            ids = np.flatnonzero(self._over)
            observations[ids] = self._begin(ids)
            rewards[ids], terminations[ids], truncations[ids] = 0.0, False, False
        finished = terminations | truncations
        if finished.any():
            last = self._final_info(finished, terminations)
            masked = {}
            for key, value in last.items():
                # Gymnasium's vector infos: each array with a mask `_key` of the rows that are set.
                masked[key], masked[f"_{key}"] = value, finished.copy()
            # SAME_STEP: keep the last observation for bootstrapping before it is overwritten.
            if self.autoreset_mode is AutoresetMode.SAME_STEP:
                ids = np.flatnonzero(finished)
                final = np.full(self.num_envs, None, dtype=object)
                for i in ids:
                    final[i] = observations[i].copy()
                infos = {
                    "final_obs": final,
                    "_final_obs": finished.copy(),
                    "final_info": masked,
                    "_final_info": finished.copy(),
                }
                observations[ids] = self._begin(ids)
            else:
                infos = masked
        self._over = finished
        # A copy: the caller may change what it gets, and a partial reset still needs these rows.
        self._observations = observations.copy()
        return observations, rewards, terminations, truncations, infos
