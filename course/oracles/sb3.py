"""Stable-Baselines3: its interface around the course's vector environments, its PPO and its SAC."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from course.check import count, invalid, one_of
from course.libraries import import_error, one_thread

if TYPE_CHECKING:
    from stable_baselines3.common.vec_env import VecEnv


def rows(infos: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """Return the infos of a vector environment as one dict for each of its `count` environments."""
    result: list[dict[str, Any]] = [{} for _ in range(count)]
    for key, value in infos.items():
        if key.startswith("_") and key[1:] in infos:
            continue
        each: Any = rows(value, count) if isinstance(value, dict) else value
        for i in np.flatnonzero(infos[f"_{key}"]):
            result[i][key] = each[i].item() if isinstance(each[i], np.generic) else each[i]
    return result


def vec_env(envs: Any) -> VecEnv:
    """Return a `VecEnv` that steps `envs`, to train with Stable-Baselines3.

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
        install = "pip install 'stable-baselines3>=2.9'"
        raise import_error("Stable-Baselines3", install, error) from error
    mode = envs.metadata["autoreset_mode"].value
    if mode != "SameStep":
        raise invalid("autoreset_mode", mode, "'SameStep': a VecEnv shows the next episode's start")

    class Adapter(VecEnv):
        def __init__(self) -> None:
            spaces = envs.single_observation_space, envs.single_action_space
            super().__init__(envs.num_envs, *spaces)

        def reset(self) -> Any:
            if any(options != self._options[0] for options in self._options):
                raise invalid("options", self._options, "the same for all environments")
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
            # SB3 has one flag `done`; truncation is told apart in the info, for bootstrapping.
            dones, result = over | late, rows(infos, self.num_envs)
            for i, info in enumerate(result):
                # SB3 resets by itself: the info of the new episode and the last observation are
                # swapped.
                if dones[i]:
                    last = {**info.pop("final_info"), "terminal_observation": info.pop("final_obs")}
                    self.reset_infos[i], result[i] = info, last
                result[i]["TimeLimit.truncated"] = bool(late[i] and not over[i])
            return observations, rewards.astype(np.float32), dones, result

        def close(self) -> None:
            envs.close()

        def get_images(self) -> Any:
            return envs.render()

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            if hasattr(envs, "get_attr"):
                result = envs.get_attr(attr_name)
            else:
                result = [getattr(envs, attr_name)] * self.num_envs
            return [result[i] for i in self._get_indices(indices)]

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            values = self.get_attr(attr_name)
            for i in self._get_indices(indices):
                values[i] = value
            envs.set_attr(attr_name, values)

        def env_method(self, method_name: str, *args: Any, indices: Any = None, **keywords: Any):
            if [*self._get_indices(indices)] != [*range(self.num_envs)]:
                raise invalid("indices", indices, "None: a method is called in all of them")
            return list(envs.call(method_name, *args, **keywords))

        def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
            chosen: Iterable[int] = self._get_indices(indices)
            if not hasattr(envs, "call"):
                return [False for _ in chosen]
            # Gymnasium writes an environment with its wrappers: <Outer<Inner<Name instance>>>.
            written = envs.call("__str__")
            return [f"<{wrapper_class.__name__}<" in written[i] for i in chosen]

    return Adapter()


class Curve(NamedTuple):
    """A learner's progress: how good it is after its environment steps and processor time.

    Attributes:
        steps: shape (k,).
        seconds: processor time of learning, what judging takes left out, (k,) [s].
        scores: shape (k,).
    """

    steps: NDArray[np.int64]
    seconds: NDArray[np.float64]
    scores: NDArray[np.float64]


def ppo(envs: Any, settings: Any, judge: Any, *, steps: int, seed: int, every: int = 1) -> Curve:
    """Return the library's PPO with the settings of ours.

    Same networks, same starts, same normalisers.

    It updates the normalisers at every step, ours once in an iteration; it normalises advantages in
    each minibatch; its Adam keeps each layer's weights apart. What ours has beside these settings
    (`shared`, `crossing`, `bootstrap`) has to be as by default, as the library knows no other.

    Args:
        envs: see `vec_env`.
        settings: `course.learning.ppo.Settings`, or an object with its fields.
        judge: function (policy) -> score, where policy(observations (n, d)) are mean actions.
        steps: of all environments together.
        seed: of weights, environments and all that is drawn.
        every: iterations between two scores.

    Returns:
        Its learning curve.
    """
    batch, venv = settings.horizon * envs.num_envs, vec_env(envs)
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecNormalize

    for name in ("shared", "crossing", "bootstrap"):
        one_of(name, getattr(settings, name), (name != "crossing",))
    wrapped = VecNormalize(
        venv,
        norm_obs=settings.normalise_observations,
        norm_reward=settings.scale_rewards,
        gamma=settings.discount,
        clip_reward=np.inf,
    )
    infinite = {math.inf: None}
    rows: list[tuple[int, float, float]] = []

    class Watch(BaseCallback):
        def _on_step(self) -> bool:
            return True

        def _on_rollout_start(self) -> None:  # after the update of the iteration before
            if self.num_timesteps and self.num_timesteps // batch % every == 0:
                self.record_progress()

        def record_progress(self) -> None:
            # Processor time without the judging: the clock is moved on by what a score takes.
            spent = time.process_time() - self.started

            def policy(observations: NDArray[Any]) -> NDArray[Any]:
                return self.model.predict(wrapped.normalize_obs(observations), deterministic=True)[
                    0
                ]

            rows.append((self.num_timesteps, spent, judge(policy)))
            self.started = time.process_time() - spent

        started = 0.0

    hidden, rate = list(settings.hidden), settings.rate
    with one_thread():
        model = PPO(
            "MlpPolicy",
            wrapped,
            seed=seed,
            device="cpu",
            n_steps=settings.horizon,
            learning_rate=(lambda remaining: rate * remaining) if settings.anneal else rate,
            # SB3 counts steps in a minibatch, ours the number of minibatches.
            batch_size=batch // settings.minibatches,
            n_epochs=settings.epochs,
            gamma=settings.discount,
            gae_lambda=settings.trace,
            # Infinity means "off" in our settings; PyTorch needs a finite number.
            clip_range=min(settings.clip, 1e9),
            ent_coef=settings.entropy,
            vf_coef=settings.value_weight,
            max_grad_norm=min(settings.longest_gradient, 1e9),
            target_kl=infinite.get(settings.most_kl, settings.most_kl),
            normalize_advantage=settings.normalise_advantages,
            policy_kwargs={
                "net_arch": {"pi": hidden, "vf": hidden},
                "activation_fn": torch.nn.Tanh,
                "log_std_init": math.log(settings.spread),
            },
        )
        watch = Watch()
        watch.started = time.process_time()
        model.learn(steps // batch * batch, callback=watch)
        if not rows or rows[-1][0] < model.num_timesteps:
            watch.record_progress()
    table = np.array(rows)
    return Curve(table[:, 0].astype(np.int64), table[:, 1], table[:, 2])


def sac(
    envs: Any,
    judge: Any,
    *,
    steps: int,
    seed: int,
    every: int,
    hidden: tuple[int, ...] = (64, 64),
    rate: float = 1e-3,
    batch: int = 128,
    first: int = 512,
    entropy: float = 0.01,
) -> Curve:
    """Return the learning curve of the library's SAC, soft actor-critic.

    SAC (Haarnoja et al., 2018) is off-policy: it stores every step in a replay buffer and learns
    from random samples of all of them, here with one gradient step for each environment step. What
    is not an argument has the library's default.

    Args:
        envs: see `vec_env`.
        judge: function (policy) -> score, where policy(observations (n, d)) are mean actions.
        steps: of all environments together.
        seed: of weights, environments and all that is sampled.
        every: environment steps between two scores.
        hidden: widths of the layers, of the actor's and of each critic's network.
        rate: of Adam.
        batch: steps in a gradient step.
        first: environment steps with random actions before the first gradient step.
        entropy: weight of the entropy at the start; the library's default of 1 is far above the
            rewards of the point, a few hundredths a step, and takes thousands of steps to fall.

    Returns:
        Its learning curve.
    """
    venv = vec_env(envs)
    count("every", every, 1)
    from stable_baselines3 import SAC
    from stable_baselines3.common.callbacks import BaseCallback

    rows: list[tuple[int, float, float]] = []

    class Watch(BaseCallback):
        def _on_step(self) -> bool:
            if self.num_timesteps // every > len(rows):
                self.record_progress()
            return True

        def record_progress(self) -> None:
            spent = time.process_time() - self.started

            def policy(observations: NDArray[Any]) -> NDArray[Any]:
                return self.model.predict(observations, deterministic=True)[0]

            rows.append((self.num_timesteps, spent, judge(policy)))
            self.started = time.process_time() - spent

        started = 0.0

    with one_thread():
        model = SAC(
            "MlpPolicy",
            venv,
            seed=seed,
            device="cpu",
            learning_rate=rate,
            batch_size=batch,
            learning_starts=first,
            ent_coef=f"auto_{entropy:g}",
            gradient_steps=-1,  # as many as steps were made in all environments
            policy_kwargs={"net_arch": list(hidden)},
        )
        watch = Watch()
        watch.started = time.process_time()
        model.learn(steps, callback=watch)
    table = np.array(rows)
    return Curve(table[:, 0].astype(np.int64), table[:, 1], table[:, 2])
