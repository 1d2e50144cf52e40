"""What every vector environment here has in common: spaces, seeds, checked actions, autoreset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from gymnasium import Env, Space, spaces
from gymnasium.error import ClosedEnvironmentError, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from course.check import count, invalid, one_of


def checked_mode(mode: AutoresetMode | str) -> AutoresetMode:
    """Return the autoreset mode asked for, given as a member or as its value in text."""
    name = mode.value if isinstance(mode, AutoresetMode) else mode
    return AutoresetMode(one_of("autoreset_mode", name, [known.value for known in AutoresetMode]))


def earlier_limit(max_steps: int, max_episode_steps: int | None) -> int:
    """Return the number of steps after which an episode is truncated.

    `gymnasium.make_vec` passes the limit of the specification as `max_episode_steps`, where
    `gymnasium.make` wraps a `TimeLimit` around an environment with a limit of its own: the earlier
    of the two truncates, so it does here.
    """
    limit = count("max_steps", max_steps, 1)
    if max_episode_steps is None:
        return limit
    return min(limit, count("max_episode_steps", max_episode_steps, 1))


def checked_batch(space: Space[Any], actions: Any, name: str = "actions") -> Any:
    """Return `actions` as a fresh batch of `space`'s shapes and dtypes.

    Args:
        space: the batched space.
        actions: what the caller handed in. Numbers may be of another dtype of the same kind or a
            lower one: float64 for float32 is rounded, whole numbers may stand for floats.
        name: what the error calls it.

    Raises:
        ValueError: for another number of actions, another shape or kind of number, or a NaN.
    """
    # Composite spaces are checked item by item, so that the error names the item.
    if isinstance(space, spaces.Dict):
        if not isinstance(actions, Mapping) or set(actions) != set(space.spaces):
            got = sorted(actions) if isinstance(actions, Mapping) else type(actions).__name__
            raise invalid(f"{name}.keys()", got, f"{sorted(space.spaces)}")
        return {k: checked_batch(s, actions[k], f"{name}[{k!r}]") for k, s in space.items()}
    if isinstance(space, spaces.Tuple):
        if not isinstance(actions, Sequence) or len(actions) != len(space.spaces):
            raise invalid(name, actions, f"a tuple of {len(space.spaces)}")
        pairs = zip(space.spaces, actions, strict=True)
        return tuple(checked_batch(s, a, f"{name}[{i}]") for i, (s, a) in enumerate(pairs))
    # Only the environment can judge actions of a space without a fixed shape or dtype.
    if space.shape is None or space.dtype is None:
        return actions
    array = np.asarray(actions)
    if array.shape != space.shape:
        raise invalid(
            f"{name}.shape",
            array.shape,
            f"{space.shape}: one row for each of {space.shape[0]} environments",
        )
    # The same kind or a lower one: an integer may stand for a float, never the other way round.
    if not np.can_cast(array.dtype, space.dtype, "same_kind"):
        raise invalid(f"{name}.dtype", array.dtype, f"{space.dtype}")
    # A new array of the space's dtype, which later changes by the caller do not reach.
    batch = np.array(array, dtype=space.dtype, order="C")
    # A NaN makes the sum NaN. So does inf - inf; then the slower look tells the two apart.
    if batch.dtype.kind == "f" and not batch.sum() < np.inf and np.isnan(batch).any():
        where = np.argwhere(np.isnan(batch))[0]
        raise invalid(f"{name}{where.tolist()}", np.nan, "a number")
    return batch


class AutoresettingVectorEnv(VectorEnv):
    """Spaces, seeds and checks; a subclass brings the environments."""

    autoreset_mode: AutoresetMode
    _over: NDArray[np.bool_]  # whose episode the last step has ended
    _begun: NDArray[np.bool_]  # which have been reset at least once

    def _adopt(self, env: Env[Any, Any], num_envs: int, mode: AutoresetMode | str) -> None:
        """Take over the spaces and metadata of one environment, for `num_envs` of them."""
        self.num_envs = count("num_envs", num_envs, 1)
        self.autoreset_mode = checked_mode(mode)
        # Gymnasium's wrappers read the mode from the metadata.
        self.metadata = {**env.metadata, "autoreset_mode": self.autoreset_mode}
        self.render_mode = env.render_mode
        self._over = np.zeros(self.num_envs, dtype=np.bool_)
        self._begun = np.zeros(self.num_envs, dtype=np.bool_)
        self.single_observation_space = env.observation_space
        self.single_action_space = env.action_space
        self.observation_space = batch_space(env.observation_space, self.num_envs)
        self.action_space = batch_space(env.action_space, self.num_envs)

    def _assert_open(self) -> None:
        if self.closed:
            raise ClosedEnvironmentError(f"{type(self).__name__} is closed")

    def _checked_actions(self, actions: Any) -> Any:
        # In DISABLED mode the caller resets; a step beyond the end of an episode has no meaning.
        if self.autoreset_mode is AutoresetMode.DISABLED and self._over.any():
            ids = np.flatnonzero(self._over).tolist()
            raise ResetNeeded(f"reset environments {ids}: their episodes are over")
        return checked_batch(self.action_space, actions)

    def _plan_reset(
        self, seed: Any, options: dict[str, Any] | None
    ) -> tuple[NDArray[np.intp], list[int | None], dict[str, Any] | None]:
        """Return which environments to reset, the seed of each, and the remaining options.

        As in Gymnasium: an int s seeds environment i with s + i, and options["reset_mask"] picks
        the environments.

        Raises:
            ValueError: for a seed or a mask of another form.
            ResetNeeded: the mask leaves out an environment that was never reset.
        """
        n = self.num_envs
        seeds: list[int | None]
        # Without a seed every environment continues with its own generator.
        if seed is None:
            seeds = [None] * n
        elif isinstance(seed, int | np.integer) and not isinstance(seed, bool):
            seeds = [int(seed) + i for i in range(n)]
        elif isinstance(seed, Sequence | np.ndarray) and not isinstance(seed, str):
            seeds = [None if s is None else count("seed", s) for s in seed]
        else:
            raise invalid("seed", seed, f"None, an int or a list of {n}")
        if len(seeds) != n:
            raise invalid("seed", seed, f"a list of {n}, one for each environment")
        if seeds[0] is not None:
            count("seed", seeds[0])
        # Without a mask the reset is for all of them.
        if options is None or "reset_mask" not in options:
            return np.arange(n), seeds, options
        mask = np.asarray(options["reset_mask"])
        if mask.shape != (n,) or mask.dtype != np.bool_ or not mask.any():
            raise invalid("options['reset_mask']", mask, f"{n} bools, one of them True")
        # A partial reset keeps the other rows, so they have to exist.
        if not (mask | self._begun).all():
            raise ResetNeeded("options['reset_mask'] picks some before all were reset once")
        rest = {k: v for k, v in options.items() if k != "reset_mask"}
        return np.flatnonzero(mask), seeds, rest


def _with_own_arrays(info: dict[str, Any]) -> dict[str, Any]:
    """Return `info` with arrays of its own; other objects are handed on as they are."""
    return {
        k: _with_own_arrays(v)
        if isinstance(v, dict)
        else v.copy()
        if isinstance(v, np.ndarray)
        else v
        for k, v in info.items()
    }


class Lane:
    """One environment and its autoreset."""

    def __init__(self, env: Env[Any, Any], mode: AutoresetMode) -> None:
        self.env = env
        self._mode = mode
        self._over = False

    def reset(self, seed: int | None, options: dict[str, Any] | None) -> tuple[Any, dict[str, Any]]:
        """Start an episode."""
        self._over = False
        return self.env.reset(seed=seed, options=options)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any], Any]:
        """Advance by one step, with the reset that belongs to it.

        Returns:
            Observation, reward, terminated, truncated, info; and (last observation, last info) of
            an episode whose place the first observation of the next one has taken, else None.
        """
        # NEXT_STEP: the last step ended the episode, so this one resets and ignores its action.
        if self._over:
            self._over = False
            observation, info = self.env.reset()
            return observation, 0.0, False, False, info, None
        observation, reward, terminated, truncated, info = self.env.step(action)
        final = None
        if terminated or truncated:
            if self._mode is AutoresetMode.SAME_STEP:
                # Copies: an environment may write its next observation into the same array.
                final = deepcopy(observation), _with_own_arrays(info)
                observation, info = self.env.reset()
            # With NEXT_STEP the next call of `step` resets; with DISABLED the caller does.
            self._over = self._mode is AutoresetMode.NEXT_STEP
        return observation, float(reward), bool(terminated), bool(truncated), info, final


def check_spaces(env: Env[Any, Any], observation: Any, action: Any, index: int) -> None:
    """Refuse an environment whose spaces are not the first one's."""
    if env.observation_space != observation or env.action_space != action:
        raise invalid(
            f"the spaces of environment {index}",
            (env.observation_space, env.action_space),
            f"those of the first, {(observation, action)}",
        )
