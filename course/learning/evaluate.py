"""How good is a policy: one episode in each environment, from starts that all policies share.

An episode that ends soon is counted as often as one that takes long only where every environment
plays one. Taking the first episodes to finish, as a loop over environments that reset themselves
does by itself, prefers short ones (`first_finished`): of slow failures it hears last.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, vector
from course.learning.ppo import finite_rows

Array = NDArray[np.float64]


class Episodes(NamedTuple):
    """Episodes, in the order of the environments (or in that in which they finished), each (e,).

    Attributes:
        returns: sums of rewards, discounted.
        steps: whole numbers.
        success: whether it ended by a termination, not by the clock.
    """

    returns: Array
    steps: NDArray[np.int64]
    success: NDArray[np.bool_]


def evaluate(
    policy: Callable[[Any], Any], envs: Any, starts: int | list[int] = 0, *, discount: float = 0.99
) -> Episodes:
    """Return one episode in each environment.

    Args:
        policy: observations (n, d) -> actions (n, a). It is not trained, nor are its statistics.
        envs: a `gymnasium.vector.VectorEnv` whose episodes end.
        starts: seed of the first environment, the next ones follow; or a list of one each.
        discount: of a reward for each step that it comes later.

    Raises:
        ValueError: for actions of the wrong shape, and for an observation, a reward or an action
            that is no finite number; it names environment and step.
    """
    n = envs.num_envs
    worth, steps, success = np.zeros(n), np.zeros(n, dtype=np.int64), np.zeros(n, dtype=bool)
    for _, i, *episode in _finished(policy, envs, starts, discount):
        if not steps[i]:  # later episodes of this environment don't count
            worth[i], steps[i], success[i] = episode
        if steps.all():
            return Episodes(worth, steps, success)
    raise AssertionError("unreachable: episodes go on until each environment had one")


def first_finished(
    policy: Callable[[Any], Any],
    envs: Any,
    episodes: int,
    starts: int | list[int] = 0,
    *,
    discount: float = 0.99,
) -> Episodes:
    """Return the trap: the first `episodes` to finish in environments that reset themselves.

    Arguments as for `evaluate`; `episodes` is how many.
    """
    rows = []
    for _, _, *episode in _finished(policy, envs, starts, discount):
        rows.append(episode)
        if len(rows) == count("episodes", episodes, 1):
            break
    worth, steps, success = zip(*rows, strict=True)
    return Episodes(np.array(worth), np.array(steps), np.array(success))


def _finished(policy: Any, envs: Any, starts: Any, discount: float) -> Any:
    """Yield every episode as it finishes: step, environment, return, steps, success.

    Without end.
    """
    n, step = envs.num_envs, 0
    gamma = finite("discount", discount, 0.0, 1.0)
    mode = envs.metadata["autoreset_mode"].value
    worth, length, over = np.zeros(n), np.zeros(n, dtype=np.int64), np.zeros(n, dtype=bool)
    observed, _ = envs.reset(seed=starts)
    finite_rows("observation", observed, step)
    while True:
        # Environments that do not reset themselves receive a mask of the episodes that are over.
        if mode == "Disabled" and over.any():
            observed, _ = envs.reset(options={"reset_mask": over})
        actions = np.asarray(policy(observed))
        if actions.shape != envs.action_space.shape:
            raise invalid("policy(observations).shape", actions.shape, envs.action_space.shape)
        finite_rows("action", actions, step)
        observed, rewards, ended, late, _ = envs.step(actions)
        finite_rows("observation", observed, step)
        finite_rows("reward", rewards, step)
        # With "NextStep" the step after an end only resets.
        real = ~over if mode == "NextStep" else np.ones(n, dtype=bool)
        # Rewards are discounted from the start of their own episode.
        worth += np.where(real, gamma**length * rewards, 0.0)
        length += real
        over, step = ended | late, step + 1
        for i in np.flatnonzero(over):
            yield step, i, float(worth[i]), int(length[i]), bool(ended[i])
            worth[i], length[i] = 0.0, 0


class Band(NamedTuple):
    """Interquartile mean over seeds and its interval, each of the shape of one seed's scores."""

    middle: Array
    low: Array
    high: Array


def band(scores: ArrayLike, seed: int = 0, *, draws: int = 2_000, share: float = 0.95) -> Band:
    """Return what scores of several seeds say of the method: interquartile mean, bootstrapped.

    A quarter of the seeds is left out at each end, so that one lucky or stuck seed decides
    nothing (Agarwal et al., Deep reinforcement learning at the edge of the statistical precipice,
    2021).

    Args:
        scores: a row for each seed, (seeds, ...), three seeds or more.
        seed: of the draws.
        draws: bootstrap samples, each of as many seeds, with replacement.
        share: of the draws' means that the interval holds.
    """
    rows = vector("scores", scores)
    if rows.ndim < 1 or len(rows) < 3:
        raise invalid("scores.shape", rows.shape, "(seeds, ...), three seeds or more")

    def middle(table: Array) -> Array:
        """Return the mean of the middle half along the second axis, its ends counted in part."""
        n = table.shape[1]
        # The interquartile mean: a quarter of the weight is cut at each end, the seeds there in
        # part.
        weight = np.clip(np.arange(1, n + 1) - 0.25 * n, 0.0, 1.0)
        weight = np.minimum(weight, weight[::-1])
        return np.moveaxis(np.sort(table, axis=1), 1, -1) @ (weight / weight.sum())

    # Percentile bootstrap: the seeds are drawn with replacement.
    picks = np.random.default_rng(seed).integers(len(rows), size=(draws, len(rows)))
    ends = np.quantile(middle(rows[picks]), [0.5 - 0.5 * share, 0.5 + 0.5 * share], axis=0)
    return Band(middle(rows[None])[0], ends[0], ends[1])
