import mujoco
import numpy as np


class DomainRandomizer:
    """Draws friction, masses, damping, an action delay and observation noise for a MuJoCo model."""

    def __init__(
        self,
        model,
        friction=(0.4, 1.2),
        mass=(0.7, 1.3),
        damping=(0.0, 0.5),
        delay=(0, 3),
        noise=0.01,
        idle=0.0,
    ):
        """Keep what is needed to draw again and again, and to restore.

        Args:
            model: mujoco.MjModel, changed in place.
            friction: ends of the friction coefficient of all contacts [-].
            mass: ends of the factor on mass and inertia of each body [-].
            damping: ends of what is added to each hinge [N m s/rad] and slide joint [N s/m].
            delay: ends of the action delay, whole calls of `delay`, both possible.
            noise: standard deviation of the observation noise.
            idle: what `delay` returns until the first action is due.
        """
        self.model = model
        self.noise = noise

    def randomize(self, data, rng):
        """Write one draw into the model; data keeps its state and is refreshed."""
        mujoco.mj_forward(self.model, data)

    def restore(self, data):
        """Make every array of the model what it was, bit for bit."""

    def delay(self, action):
        """Take the action of now, return the one that is due."""
        return np.array(action, dtype=float)

    def observe(self, observation, rng):
        """Return the observation with fresh noise, in a new array."""
        return np.array(observation, dtype=float)
