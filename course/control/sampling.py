"""Plans by trying: MPPI, the cross-entropy method and predictive sampling over any rollout.

A rollout is a function from plans (K, N, m), K of them over N samples of m inputs, to their costs
(K,). A cost that is not finite counts as infinite: what a simulator gave up on is no winner. Each
function takes a plan and returns a better one; `shifted` moves it on by a sample for the next call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, invalid, positive, vector

Array = NDArray[np.float64]
Rollout = Callable[[Array], Array]


class Sampled(NamedTuple):
    """A plan (N, m), what it or the best of the tries cost, and how many tries had a say in it.

    With `voices` near 1 one try decides; near K the costs do. A plan that no try ended for comes
    back as it was, at infinite cost and with 0 voices.
    """

    plan: Array
    cost: float
    voices: float


def mppi(
    rollout: Rollout,
    plan: ArrayLike,
    rng: np.random.Generator,
    *,
    samples: int = 64,
    spread: ArrayLike = 1.0,
    temperature: float = 1.0,
    limit: ArrayLike = np.inf,
) -> Sampled:
    """Return model predictive path integral control (Williams, Aldrich and Theodorou, 2017).

    The new plan is the mean of normal tries about the old one with weights exp(-cost /
    temperature). The lowest cost is taken off first: it changes no weight, but without it all of
    them are 0 as soon as costs are some hundred temperatures.

    Args:
        rollout: see above.
        plan: the last one, shape (N, m).
        rng: who draws.
        samples: K, the old plan being one of them.
        spread: standard deviation, a number or (m,).
        temperature: in units of the cost; towards 0 the best try wins.
        limit: of each input both ways, a number or (m,).
    """
    plan, spread, limit = _checked(plan, spread, limit)
    temperature = positive("temperature", temperature)
    tries = _tries(plan, spread, limit, rng, count("samples", samples, 2))
    cost = _costs(rollout, tries)
    best = float(cost.min())
    # Every rollout failed: there is nothing to average.
    if best == np.inf:
        return Sampled(plan, best, 0.0)
    # Softmax of the costs. Subtracting the lowest one changes no weight, and they cannot all
    # underflow to zero.
    weights = np.exp(-(cost - best) / temperature)
    weights /= weights.sum()
    # Effective sample size: 1 over the sum of squared weights.
    return Sampled(np.tensordot(weights, tries, 1), best, float(1.0 / (weights @ weights)))


def cem(
    rollout: Rollout,
    plan: ArrayLike,
    rng: np.random.Generator,
    *,
    samples: int = 64,
    elites: int = 8,
    rounds: int = 3,
    spread: ArrayLike = 1.0,
    limit: ArrayLike = np.inf,
) -> Sampled:
    """Improve a plan with the cross-entropy method (Rubinstein, 1999).

    In rounds, mean and spread are refitted to the best samples.

    Arguments as for `mppi`; `elites` of the tries count, in each of `rounds`.
    """
    mean, spread, limit = _checked(plan, spread, limit)
    count("elites", elites, 1, count("samples", samples, 2))
    wide, best, voices = np.broadcast_to(spread, mean.shape), np.inf, 0.0
    for _ in range(count("rounds", rounds, 1)):
        tries = _tries(mean, wide, limit, rng, samples)
        cost = _costs(rollout, tries)
        # The elites, of which failed rollouts are never part. A stable sort makes ties
        # reproducible.
        chosen = np.argsort(cost, kind="stable")[:elites]
        chosen = chosen[cost[chosen] < np.inf]
        if not chosen.size:
            break
        # Refit mean and spread to the elites, coordinate by coordinate.
        mean, wide = tries[chosen].mean(axis=0), tries[chosen].std(axis=0)
        best, voices = min(best, float(cost[chosen[0]])), float(chosen.size)
    return Sampled(mean, best, voices)


def predictive(
    rollout: Rollout,
    plan: ArrayLike,
    rng: np.random.Generator,
    *,
    samples: int = 64,
    spread: ArrayLike = 1.0,
    limit: ArrayLike = np.inf,
) -> Sampled:
    """Improve a plan with predictive sampling (Howell and others, 2022).

    The result is the best sample, the old plan being one of them.

    So no plan is worse than the one before. Arguments as for `mppi`.
    """
    plan, spread, limit = _checked(plan, spread, limit)
    tries = _tries(plan, spread, limit, rng, count("samples", samples, 2))
    cost = _costs(rollout, tries)
    best = int(np.argmin(cost))
    return Sampled(tries[best], float(cost[best]), float(cost[best] < np.inf))


def shifted(plan: Array) -> Array:
    """Return the plan a sample later; its last command stays."""
    return np.concatenate([plan[1:], plan[-1:]])


def _checked(plan: ArrayLike, spread: ArrayLike, limit: ArrayLike) -> tuple[Array, Array, Array]:
    plan = vector("plan", plan, (None, None))
    shapes = ((), plan.shape[1:])
    wide = vector("spread", spread, *shapes, low=POSITIVE)
    top = np.asarray(limit, dtype=float)
    if top.shape not in shapes or not (top > 0.0).all():
        raise invalid("limit", limit, f"positive numbers, one or {plan.shape[1]}")
    return np.clip(plan, -top, top), wide, top


def _tries(plan: Array, spread: Array, limit: Array, rng: np.random.Generator, K: int) -> Array:
    noise = spread * rng.standard_normal((K, *plan.shape))
    # The first sample is the plan itself, so a step can always keep it.
    noise[0] = 0.0
    return np.asarray(np.clip(plan + noise, -limit, limit))


def _costs(rollout: Rollout, tries: Array) -> Array:
    with np.errstate(over="ignore", invalid="ignore"):  # a rollout may fail, and says so by NaN
        cost = np.array(rollout(tries), dtype=float)
    if cost.shape != tries.shape[:1]:
        raise invalid("rollout(plans).shape", cost.shape, f"one cost a plan, {tries.shape[:1]}")
    cost[~np.isfinite(cost)] = np.inf
    return cost
