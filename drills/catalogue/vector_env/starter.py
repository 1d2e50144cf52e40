import numpy as np


class VectorizedEnv:
    """n environments stepped as one, with auto-reset."""

    def __init__(self, env_fn, num_envs):
        self.num_envs = num_envs
        self.envs = [env_fn() for _ in range(num_envs)]

    def reset(self, seed=None):
        """Reset every environment, environment i with seed + i.

        Returns: observations (n, 3), infos (list of n dicts).
        """
        observations = np.zeros((self.num_envs, 3))
        infos = [{} for _ in range(self.num_envs)]
        return observations, infos

    def step(self, actions):
        """Step every environment; start a finished one again.

        Returns: observations (n, 3), rewards (n,), terminated (n,), truncated (n,), infos (list).
        """
        observations = np.zeros((self.num_envs, 3))
        rewards = np.zeros(self.num_envs)
        terminated = np.zeros(self.num_envs, dtype=bool)
        truncated = np.zeros(self.num_envs, dtype=bool)
        infos = [{} for _ in range(self.num_envs)]
        return observations, rewards, terminated, truncated, infos

    def _auto_reset(self, i):
        """Start the next episode of environment i."""

    def close(self):
        """Close every environment."""
