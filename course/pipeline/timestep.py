"""A reward that is paid by the step is another task at another step: one small chain, solved.

A walker has some way to go in continuous time. It walks, or it runs, which tires and may throw it,
or it gives up for a fee. What it does for best depends on the step if discount and reward are kept
a step; with gamma^(dt' / dt) and rewards a second it stays (Doya, Reinforcement learning in
continuous time and space, 2000).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from course.check import count, finite, positive
from course.sim_to_real.shaping import Process, policy_iteration

ACTIONS = ("walk", "run", "give up")


@dataclass(frozen=True)
class Way:
    """The task in continuous time.

    Attributes:
        seconds: of walking from start to goal.
        horizon: time constant of the discount [s].
        cost: of time, and what running adds to it [1/s].
        goal, fee: paid on arrival, and for giving up.
        fall: rate of falls while running [1/s]; a fall pays `hurt` and ends it.
        hurt: negative.
    """

    seconds: float = 0.2
    horizon: float = 1.0
    cost: float = 100.0
    effort: float = 60.0
    goal: float = 100.0
    fee: float = -10.0
    fall: float = 1.0
    hurt: float = -100.0


def chain(
    path: Way, dt: float, gamma: float | None = None, per_step: float | None = None
) -> Process:
    """Return the task at a step; the last two states are the goal, and an end without it.

    Args:
        path: the task.
        dt: step [s]; the path takes an integer number of them.
        gamma: discount a step; by default exp(-dt / horizon).
        per_step: factor from a cost a second to one a step; by default the discounted time of a
            step, horizon (1 - gamma), which is dt for a short one.
    """
    n = count("seconds / dt", round(path.seconds / positive("dt", dt, unit="s")), 1)
    # The discount and the cost of a step that belong to the same continuous horizon.
    selected = math.exp(-dt / path.horizon) if gamma is None else finite("gamma", gamma, 0.0, 1.0)
    paid = path.horizon * -math.expm1(-dt / path.horizon) if per_step is None else per_step
    P, R = np.zeros((n + 2, 3, n + 2)), np.zeros((n + 2, 3, n + 2))
    # Probability of a fall within a step, for falls at a constant rate (Poisson process).
    falls = -math.expm1(-path.fall * dt)
    for s in range(n):
        for a, (steps, cost) in enumerate(((1, path.cost), (2, path.cost + path.effort))):
            other = min(s + steps, n)
            P[s, a, other] = 1.0 - a * falls
            P[s, a, n + 1] = a * falls
            R[s, a] = -cost * paid
            R[s, a, n] += path.goal
            R[s, a, n + 1] += path.hurt
        P[s, 2, n + 1], R[s, 2, n + 1] = 1.0, path.fee
    P[n, :, n] = P[n + 1, :, n + 1] = 1.0
    return Process(P, R, selected, np.arange(n + 2) >= n)


def repeated(process: Process, times: int) -> Process:
    """Return the process in which each action is repeated `times` times."""
    P = process.transition.transpose(1, 0, 2)
    step = np.einsum("ijk,ijk->ji", process.transition, process.reward)
    paid, through = np.zeros(step.shape), np.broadcast_to(np.eye(P.shape[1]), P.shape)
    for k in range(count("times", times, 1)):
        # `through` is the transition after k repetitions, over which the rewards are discounted.
        paid = paid + process.gamma**k * np.einsum("aij,aj->ai", through, step)
        through = through @ P
    reward = np.repeat(paid.T[:, :, None], P.shape[1], axis=2)
    return Process(through.transpose(1, 0, 2), reward, process.gamma**times, process.terminal)


def prefers(process: Process, limit: int | None = None) -> tuple[str, float]:
    """Return what is best at the start, and what it is worth.

    Args:
        process: from `chain`.
        limit: steps after which an episode is cut off, None for never.
    """
    value = np.zeros(process.terminal.size) if limit else policy_iteration(process).value
    # With a limit, backward induction; without one a single greedy look at the optimal values.
    for _ in range(limit or 1):
        q = process.backup(value)
        value = q.max(axis=1)
    return ACTIONS[int(q[0].argmax())], float(value[0])
