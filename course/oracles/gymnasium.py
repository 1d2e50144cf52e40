"""Gymnasium's own vector environments and checker, asked the questions of `course.vector_env`."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import TYPE_CHECKING, Any

from course.libraries import import_error

if TYPE_CHECKING:
    from gymnasium import Env
    from gymnasium.vector import AsyncVectorEnv, SyncVectorEnv


def _gymnasium() -> ModuleType:
    try:
        import gymnasium
        import gymnasium.vector
    except ImportError as error:
        raise import_error("Gymnasium", "pip install 'gymnasium>=1.4'", error) from error
    return gymnasium


def sync_vector_env(
    env_fn: Callable[[], Env[Any, Any]], num_envs: int, autoreset_mode: str = "NextStep"
) -> SyncVectorEnv[Any, Any]:
    """Return Gymnasium's loop over environments.

    Args:
        env_fn: builds one.
        num_envs: how many.
        autoreset_mode: "NextStep", "SameStep" or "Disabled".
    """
    vector = _gymnasium().vector
    return vector.SyncVectorEnv([env_fn] * num_envs, autoreset_mode=autoreset_mode)


def async_vector_env(
    env_fn: Callable[[], Env[Any, Any]], num_envs: int, autoreset_mode: str = "NextStep"
) -> AsyncVectorEnv[Any, Any]:
    """Return Gymnasium's vector environment with one process for each environment.

    Arguments are those of `sync_vector_env`.
    """
    vector = _gymnasium().vector
    return vector.AsyncVectorEnv([env_fn] * num_envs, autoreset_mode=autoreset_mode)


def wrapped(
    env_fn: Callable[[], Any], observation_size: int, action_size: int
) -> Callable[[], Env[Any, Any]]:
    """Return a builder of Gymnasium environments around plain ones, for its vector environments.

    Args:
        env_fn: builds a plain environment. Its `reset(seed)` and `step(action)` return what
            Gymnasium's do; its array of observations may be one buffer that every step overwrites.
        observation_size: length of an observation.
        action_size: length of an action; each component is in [-1, 1].

    Returns:
        A class without arguments, which `sync_vector_env` and `async_vector_env` take as `env_fn`.

    Raises:
        ImportError: if Gymnasium is missing; it says how to install it.
    """
    _gymnasium()  # with the sentence on how to install it, which the plain import below lacks
    import gymnasium
    import numpy as np

    class Wrapped(gymnasium.Env[Any, Any]):
        observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (observation_size,), np.float64)
        action_space = gymnasium.spaces.Box(-1.0, 1.0, (action_size,), np.float64)

        def __init__(self) -> None:
            self.inner = env_fn()

        def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
            observation, info = self.inner.reset(seed)
            # A copy: the plain environment may overwrite its buffer while a learner holds on to it.
            return observation.copy(), info

        def step(self, action: Any) -> Any:
            observation, *rest = self.inner.step(action)
            return observation.copy(), *rest

    return Wrapped


def check(env: Env[Any, Any]) -> list[str]:
    """Run Gymnasium's checks of a single environment.

    Returns:
        What it warns of, one sentence each.

    Raises:
        Exception: whatever the checker raises for an environment that breaks the interface.
    """
    import warnings

    _gymnasium()
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env)
    return [str(item.message) for item in caught]
