"""Stable-Baselines3's interface of vector environments around those of `course.vector_env`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from course.check import refused

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv

NEEDED = "this needs Stable-Baselines3: pip install 'stable-baselines3>=2.9'"


def rows(infos: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """The infos of a vector environment as one dict for each of its `count` environments."""
    found: list[dict[str, Any]] = [{} for _ in range(count)]
    for key, value in infos.items():
        if key.startswith("_") and key[1:] in infos:
            continue
        each: Any = rows(value, count) if isinstance(value, dict) else value
        for i in np.flatnonzero(infos[f"_{key}"]):
            found[i][key] = each[i].item() if isinstance(each[i], np.generic) else each[i]
    return found


def vec_env(envs: Any) -> VecEnv:
    """A `VecEnv` that steps `envs`, to train with Stable-Baselines3.

    What it returns is what the library's `DummyVecEnv` returns over single environments. Attributes
    and methods are those of each environment where `envs` has environments, else its own.

    Args:
        envs: a `gymnasium.vector.VectorEnv` with `autoreset_mode="SameStep"`, which is how the
            library resets.

    Raises:
        ImportError: without Stable-Baselines3.
        ValueError: for another autoreset mode.
    """
    try:
        from stable_baselines3.common.vec_env import VecEnv
    except ImportError as error:
        raise ImportError(NEEDED) from error
    mode = envs.metadata["autoreset_mode"].value
    if mode != "SameStep":
        raise refused("autoreset_mode", mode, "'SameStep': a VecEnv shows the next episode's start")

    class Adapter(VecEnv):
        def __init__(self) -> None:
            spaces = envs.single_observation_space, envs.single_action_space
            super().__init__(envs.num_envs, *spaces)

        def reset(self) -> Any:
            if any(options != self._options[0] for options in self._options):
                raise refused("options", self._options, "the same for all environments")
            options = self._options[0] or None
            observations, infos = envs.reset(seed=self._seeds, options=options)
            self.reset_infos = rows(infos, self.num_envs)
            self._reset_seeds()
            self._reset_options()
            return observations

        def step_async(self, actions: Any) -> None:
            self.actions = actions

        def step_wait(self) -> Any:
            observations, rewards, over, late, infos = envs.step(self.actions)
            dones, found = over | late, rows(infos, self.num_envs)
            for i, info in enumerate(found):
                if dones[i]:
                    last = {**info.pop("final_info"), "terminal_observation": info.pop("final_obs")}
                    self.reset_infos[i], found[i] = info, last
                found[i]["TimeLimit.truncated"] = bool(late[i] and not over[i])
            return observations, rewards.astype(np.float32), dones, found

        def close(self) -> None:
            envs.close()

        def get_images(self) -> Any:
            return envs.render()

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            if hasattr(envs, "get_attr"):
                found = envs.get_attr(attr_name)
            else:
                found = [getattr(envs, attr_name)] * self.num_envs
            return [found[i] for i in self._get_indices(indices)]

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            values = self.get_attr(attr_name)
            for i in self._get_indices(indices):
                values[i] = value
            envs.set_attr(attr_name, values)

        def env_method(self, method_name: str, *args: Any, indices: Any = None, **keywords: Any):
            if [*self._get_indices(indices)] != [*range(self.num_envs)]:
                raise refused("indices", indices, "None: a method is called in all of them")
            return list(envs.call(method_name, *args, **keywords))

        def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
            chosen: Iterable[int] = self._get_indices(indices)
            if not hasattr(envs, "call"):
                return [False for _ in chosen]
            # Gymnasium writes an environment with its wrappers: <Outer<Inner<Name instance>>>.
            written = envs.call("__str__")
            return [f"<{wrapper_class.__name__}<" in written[i] for i in chosen]

    return Adapter()
