"""The environments of this drill, and the rollouts; imported in the child as `given`."""

import numpy as np


class Walk:
    """A walk in the plane that ends by itself, by the clock, or by both at once."""

    def __init__(self, ends, clock):
        self.ends, self.clock = ends, clock
        self.observation = np.zeros(3)
        self.rng: np.random.Generator | None = None
        self.closed = 0

    def reset(self, seed=None):
        """Start an episode whose length is sampled; the observation array is reused."""
        if seed is not None or self.rng is None:
            self.rng = np.random.default_rng(seed)
        self.steps = 0
        self.length = int(self.rng.integers(1, self.ends + 1))
        self.observation[:] = self.rng.normal(size=3)
        return self.observation, {"length": self.length}

    def step(self, action):
        """Move by the action; report the end and the time limit, even both at once."""
        self.steps += 1
        self.observation[:2] += np.asarray(action, dtype=float)
        assert self.rng is not None, "reset() comes first"
        self.observation[2] += self.rng.normal()
        reward = float(self.observation[0] - self.observation[1])
        info = {"steps": self.steps}
        over, late = self.steps >= self.length, self.steps >= self.clock
        return self.observation, reward, over, late, info

    def close(self):
        """Count the calls, so that a missing or a second one shows."""
        self.closed += 1


class Factory:
    """Builds environments and remembers them."""

    def __init__(self, ends, clock):
        self.ends, self.clock = ends, clock
        self.built = []

    def __call__(self):
        """Return a new walk and remember it."""
        self.built.append(Walk(self.ends, self.clock))
        return self.built[-1]


def factory(ends, clock):
    """Return a factory of walks that the child remembers."""
    return Factory(ends, clock)


def closings(factory):
    """Return how often each environment of the factory was closed."""
    return [env.closed for env in factory.built]


def rollout(envs, actions):
    """Return everything that the steps return, handed over at the end: what changed later shows."""
    return [envs.step(row) for row in actions]


def drive(num_envs, actions):
    """Return the mean reward of a rollout."""
    from submission import VectorizedEnv

    envs = VectorizedEnv(Factory(5, 4), num_envs)
    envs.reset(seed=0)
    return float(np.mean([envs.step(row)[1] for row in actions]))
