"""An arm with one joint presses keys: a policy trained on a model and tried on a robot."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Number = float | Array


@dataclass(frozen=True)
class Robot:
    """The arm, its drive and its observer. A parameter may have one value for each arm of a batch.

    Attributes:
        inertia: about the joint [kg m^2].
        drag: torque per velocity [N m s/rad].
        friction: dry friction of the joint [N m].
        stiffness, damping: of a key, below its surface [N m/rad, N m s/rad].
        limit: largest torque of the drive [N m].
        zero: reading of the encoder at angle 0 [rad].
        delay: number of steps from a command to its torque.
        mean, std: statistics with which the observer scales the observations.
    """

    inertia: Number
    drag: float
    friction: Number
    stiffness: Number
    damping: float
    limit: float
    zero: float
    delay: int | NDArray[np.int64]
    mean: Array
    std: Array


@dataclass
class Log:
    """Angles [rad], velocities [rad/s] and commanded torques [N m] of a run, (steps, arms) each."""

    q: Array
    v: Array
    commanded: Array


STEP = 0.004  # s
LIMIT = 16.0  # N m
SURFACE = 0.4  # rad
SMOOTH = 0.02  # rad


def observe(target: Array, q: Array, v: Array) -> Array:
    """Return the observation, (5, arms): angle, speed, target, commanded depth, side."""
    ahead = np.tanh((target - q) / SMOOTH)
    return np.array([q, v, target, np.maximum(target - SURFACE, 0.0), ahead])


def poses(rng: np.random.Generator, count: int) -> tuple[Array, Array, Array]:
    """Return random targets, angles and velocities as in training, (count,) each."""
    target, q = rng.uniform(0.0, 1.0, (2, count))
    return target, q, rng.normal(0.0, 1.5, count)


def train(model: Robot, bandwidth: float) -> Array:
    """Return weights and offset of the linear policy that imitates an expert who knows the model.

    The expert compensates the key's force and the friction, and moves the arm like a critically
    damped spring of `bandwidth` [rad/s].
    """
    target, q, v = poses(np.random.default_rng(0), 2000)
    observation = observe(target, q, v)
    desired = model.inertia * (bandwidth**2 * (target - q) - 2.0 * bandwidth * v) + model.drag * v
    desired = desired + model.stiffness * observation[3] + model.friction * observation[4]
    scaled = (observation - model.mean) / model.std
    return np.linalg.lstsq(np.vstack((scaled, np.ones(2000))).T, desired, rcond=None)[0]


def torque(robot: Robot, weights: Array, target: Array, q: Array, v: Array) -> Array:
    """Return the torque that the policy commands on a robot [N m]."""
    scaled = (observe(target, q + robot.zero, v) - robot.mean) / robot.std
    return np.minimum(np.maximum(weights[:-1] @ scaled + weights[-1], -LIMIT), LIMIT)


def move(
    robot: Robot, ask: Callable[[int, Array, Array], Array], q: Array, v: Array, steps: int
) -> Log:
    """Run a robot from angle `q` and velocity `v` with the torques of `ask(step, q, v)`."""
    arms, waiting = np.arange(len(q)), np.zeros((int(np.max(robot.delay)), len(q)))
    log = Log(*(np.zeros((steps, len(q))) for _ in range(3)))
    queue = np.concatenate((waiting, log.commanded))
    drop = STEP * robot.friction / robot.inertia
    for i in range(steps):
        queue[i + len(waiting)] = log.commanded[i] = ask(i, q, v)
        given = queue[i + len(waiting) - robot.delay, arms]
        given = np.minimum(np.maximum(given, -robot.limit), robot.limit)
        depth = q - SURFACE
        key = (depth > 0.0) * np.maximum(robot.stiffness * depth + robot.damping * v, 0.0)
        v = v + STEP / robot.inertia * (given - key - robot.drag * v)
        v = v - np.minimum(np.maximum(v, -drop), drop)
        q = q + STEP * v
        log.q[i], log.v[i] = q, v
    return log


def press(robot: Robot, weights: Array, target: Array, steps: int) -> Log:
    """Press keys with the policy, starting at rest at angle 0."""
    rest = np.zeros(len(target))
    return move(robot, lambda _, q, v: torque(robot, weights, target, q, v), rest, rest, steps)


def success(log: Log, target: Array, width: Array, held: int) -> float:
    """Return the fraction of presses that stay within the width in the last `held` steps."""
    return float(np.mean(np.abs(log.q[-held:] - target).max(axis=0) < width))
