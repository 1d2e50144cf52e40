"""Proximal policy optimisation (Schulman et al., arXiv 1707.06347, 2017), every detail a setting.

One iteration: the policy acts in all environments for some steps; each action is compared with what
the critic expected (generalised advantages); then some epochs of minibatches make the better
actions likelier, clipped where they have become so already.

The two ends of an episode are kept apart: after a termination there is nothing, after a truncation
there is the value of the last observation, which was seen and is not in the next row. Statistics of
the normalisers are those of all environments, and stay while a batch is collected and used.

What is meant to make it fast (not profiled): the environments are one compiled call, the critic
judges all rows at once after the rollout, log-probabilities come from the noise that was drawn, an
epoch is shuffled once, and all weights are one vector.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, invalid, positive, vector
from course.learning.network import (
    Diverged,
    Normaliser,
    flatten,
    length,
    network,
    pytorch,
)
from course.libraries import one_thread

Array = NDArray[np.float64]

# An update has gone wrong if it moves the policy by a KL divergence above this [nats]. Progress
# takes about 0.01 in an iteration, and at 1000 a mean action is 45 standard deviations off.
RUNAWAY = 1e3


@dataclass(frozen=True)
class Settings:
    """Every detail, so that each can be turned off.

    Attributes:
        horizon: steps of each environment in an iteration.
        epochs, minibatches: passes over a batch, and the parts of each.
        rate, anneal: of Adam, and whether it falls to 0 along a straight line.
        discount, trace: gamma and lambda of the advantages.
        clip: the ratio of probabilities counts between 1 - clip and 1 + clip; infinite: off.
        entropy, value_weight: of the two losses beside the objective.
        longest_gradient: a longer one is cut to this length; infinite: off.
        most_kl: mean KL divergence [nats] after which no further epoch is begun; infinite: off.
        hidden: sizes of the layers, of the actor's and of the critic's network.
        spread: standard deviation of the first actions.
        normalise_observations, normalise_advantages, scale_rewards: to a deviation of 1.
        bootstrap: value what comes after the clock ran out; else it counts as an end.
        shared: one normaliser for all environments; else one for each, which is a trap.
        crossing: learn also from the step that resets, of "NextStep"; a trap too.
    """

    horizon: int = 32
    epochs: int = 5
    minibatches: int = 8
    rate: float = 3e-3
    anneal: bool = True
    discount: float = 0.99
    trace: float = 0.95
    clip: float = 0.2
    entropy: float = 0.0
    value_weight: float = 0.5
    longest_gradient: float = 0.5
    most_kl: float = math.inf
    hidden: tuple[int, ...] = (16, 16)
    spread: float = 1.0
    normalise_observations: bool = True
    normalise_advantages: bool = True
    scale_rewards: bool = True
    bootstrap: bool = True
    shared: bool = True
    crossing: bool = False

    def __post_init__(self) -> None:
        for name in ("horizon", "epochs", "minibatches"):
            count(name, getattr(self, name), 1)
        for name in ("discount", "trace"):
            finite(name, getattr(self, name), 0.0, 1.0)
        for name in ("rate", "spread"):
            positive(name, getattr(self, name))
        for name in ("entropy", "value_weight"):
            finite(name, getattr(self, name), 0.0)
        for name in ("clip", "longest_gradient", "most_kl"):
            limit = getattr(self, name)
            if isinstance(limit, str) or np.ndim(limit) or not limit > 0.0:
                raise invalid(name, limit, "a positive number, infinite to leave out")
        if not isinstance(self.hidden, tuple | list):
            raise invalid("hidden", self.hidden, "a tuple of layer widths, such as (16, 16)")
        for i, width in enumerate(self.hidden):
            count(f"hidden[{i}]", width, 1)


def gae(
    rewards: ArrayLike,
    values: ArrayLike,
    following: ArrayLike,
    terminated: ArrayLike,
    truncated: ArrayLike,
    discount: float = 0.99,
    trace: float = 0.95,
) -> Array:
    """Return generalised advantage estimates (Schulman et al., 2016, eq. 16).

    Each is the sum of the critic's temporal-difference errors up to the end of the episode,
    discounted by gamma lambda. Source: High-dimensional continuous control using generalized
    advantage estimation.

    Args:
        rewards: reward of each step, (T,) or (T, N).
        values: value of the observation before each step, same shape.
        following: value of the observation after it: of a last one the episode's own, not that of
            the next one's start. Not used after a termination.
        terminated: whether the episode ended in a terminal state with this step.
        truncated: whether a time limit cut the episode off after this step.
        discount: gamma, from 0 to 1.
        trace: lambda, from 0 to 1.

    Returns:
        The advantages; with `values` added they are the critic's targets.

    Raises:
        ValueError: for shapes that differ, and for a number that is used and is not finite.
    """
    gamma, lam = finite("discount", discount, 0.0, 1.0), finite("trace", trace, 0.0, 1.0)
    reward = vector("rewards", rewards, (None,), (None, None))
    value = vector("values", values)
    next_value = np.asarray(following, dtype=float)
    final, cut_off = np.asarray(terminated, dtype=bool), np.asarray(truncated, dtype=bool)
    for name, each in (
        ("values", value),
        ("following", next_value),
        ("terminated", final),
        ("truncated", cut_off),
    ):
        if each.shape != reward.shape:
            raise invalid(f"{name}.shape", each.shape, f"{reward.shape}, as of the rewards")
    # Not used after a termination, where it may be anything.
    next_value = vector("following", np.where(final, 0.0, next_value))
    # Temporal-difference errors: a termination has no future, a truncation has one.
    delta = reward + gamma * next_value - value
    # Either end of an episode stops the sum; they differ only in the value that follows.
    weight = gamma * lam * ~(final | cut_off)
    advantages = np.zeros_like(delta)
    ahead = np.zeros(reward.shape[1:])
    # Backwards: each advantage is its error plus the decayed advantage of the next step.
    for t in range(len(reward) - 1, -1, -1):
        ahead = delta[t] + weight[t] * ahead
        advantages[t] = ahead
    return advantages


@register_jitable
def clipped_objective(ratio: Array, advantage: Array, clip: float = 0.2) -> tuple[Array, Array]:
    """Return the clipped objective of each action (eq. 7), to be made large, and its slope.

    The smaller of ratio * advantage and the same with the ratio kept near 1: what has become
    likelier is not rewarded further, what was a mistake to make unlikely is corrected.

    Args:
        ratio: of the action's probability to the one it was drawn with.
        advantage: same shape.
        clip: the ratio counts between 1 - clip and 1 + clip.

    Returns:
        The objective and its derivative by the ratio.
    """
    # Pessimistic bound: the smaller of the free and the clipped objective.
    free = ratio * advantage
    held = np.clip(ratio, 1.0 - clip, 1.0 + clip) * advantage
    # Where the clipped term is the smaller one it does not depend on the ratio: its slope is 0.
    return np.minimum(free, held), np.where(free <= held, advantage, 0.0)


class ActorCritic:
    """A Gaussian policy and its critic: observations (n, d) in, mean actions (n, a) out.

    Attributes:
        actor, critic: networks, (n, d) -> (n, a) and (n, 1).
        log_std: logarithm of the actions' standard deviations, a parameter (a,).
        normaliser: of the observations.
        flat: all weights, see `flatten`.
    """

    def __init__(self, inputs: int, actions: int, seed: int, settings: Settings, n: int) -> None:
        """Create networks for a number of inputs and actions, and for `n` environments."""
        torch, hidden = pytorch(), settings.hidden
        # Small weights in the last layer: the first policy acts near 0 and explores by its spread.
        self.actor = network((inputs, *hidden, actions), seed, last=0.01)
        self.critic = network((inputs, *hidden, 1), seed + 1)
        start = torch.full((actions,), math.log(settings.spread))
        self.log_std = torch.nn.Parameter(start)
        self.normaliser = Normaliser.blank(inputs if settings.shared else n * inputs)
        self.flat = flatten(self.actor, self.critic, self.log_std)

    def to_rows(self, observations: Array) -> Any:
        """Return observations (..., n, d) as the networks take them, a float32 tensor (rows, d)."""
        d = observations.shape[-1]
        # Unshared statistics have columns of their own for each environment.
        scaled = self.normaliser(observations.reshape(-1, self.normaliser.mean.size))
        return pytorch().from_numpy(scaled.reshape(-1, d).astype(np.float32))

    def __call__(self, observations: Array, *, scaled: bool = False) -> NDArray[np.float32]:
        """Return the most likely actions, (n, a).

        `scaled` where the observations are so already.
        """
        torch = pytorch()
        with torch.inference_mode():
            rows = torch.from_numpy(observations) if scaled else self.to_rows(observations)
            return self.actor(rows).numpy()

    def copy(self) -> ActorCritic:
        """Return one that no further iteration changes."""
        twin = copy.copy(self)
        twin.actor, twin.critic, twin.log_std = copy.deepcopy(
            (self.actor, self.critic, self.log_std)
        )
        twin.normaliser = copy.copy(self.normaliser)
        # Deep copies are no views of the old vector: give them one of their own.
        twin.flat = flatten(twin.actor, twin.critic, twin.log_std)
        return twin


@dataclass(frozen=True)
class Iteration:
    """What one iteration did.

    Attributes:
        steps: of the environments, so far.
        policy: as it is now; later iterations change it (`policy.copy()`).
        returns, lengths, terminated: of the episodes that ended, (e,): sums of rewards, steps, and
            whether the end was a termination.
        kl: mean KL divergence of the policy that acted from the policy as it is now [nats].
        clipped: share of the actions whose ratio ended outside of 1 - clip to 1 + clip.
        value_loss: mean squared error of the critic, in its own units, before the update; NaN if
            the batch had only steps that reset.
        spread: mean standard deviation of the actions.
    """

    steps: int
    policy: ActorCritic
    returns: Array
    lengths: NDArray[np.int64]
    terminated: NDArray[np.bool_]
    kl: float
    clipped: float
    value_loss: float
    spread: float


class Batch(NamedTuple):
    """What all environments did in an iteration, (T, N, ...)."""

    observations: Array  # (T + 1, N, d)
    means: Array
    noise: Array  # in standard deviations
    rewards: Array
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    valid: NDArray[np.bool_]  # False where the step was the reset of "NextStep"
    cut: list[tuple[int, Array]]  # where the clock cut an episode: t, and the last rows (N, d)
    ended: list[tuple[float, int, bool]]


class Runner:
    """Environments that go on where the last batch left them."""

    def __init__(self, envs: Any, seed: int, settings: Settings) -> None:
        mode = envs.metadata["autoreset_mode"].value
        if mode == "Disabled":
            raise invalid("autoreset_mode", mode, "'SameStep' or 'NextStep'")
        self.envs, self.same_step, self.settings = envs, mode == "SameStep", settings
        self.rng, self.steps, n = np.random.default_rng((seed, 9)), 0, envs.num_envs
        self.last = np.asarray(envs.reset(seed=seed)[0], dtype=float)
        if self.last.ndim != 2:
            raise invalid("observations.shape", self.last.shape, "(environments, numbers)")
        self.over, self.total, self.length = np.zeros(n, bool), np.zeros(n), np.zeros(n, int)
        # Rewards are scaled by the deviation of their discounted sum so far.
        self.worth, self.scale = np.zeros(n), Normaliser.blank(1 if settings.shared else n)

    def collect(self, policy: ActorCritic) -> Batch:
        """Act for `horizon` steps."""
        T, n, space = self.settings.horizon, self.envs.num_envs, self.envs.single_action_space
        noise = self.rng.normal(size=(T, n, *space.shape))
        batch = Batch(
            np.empty((T + 1, *self.last.shape)),
            np.empty_like(noise),
            noise,
            np.empty((T, n)),
            np.zeros((T, n), bool),
            np.zeros((T, n), bool),
            np.ones((T, n), bool),
            [],
            [],
        )
        # Act, and store means and noise: log-probabilities then need no second forward pass.
        spread = np.exp(policy.log_std.detach().numpy().astype(float))
        for t in range(T):
            batch.observations[t], batch.means[t] = self.last, policy(self.last)
            actions = batch.means[t] + spread * noise[t]
            if not math.isfinite(actions.sum()):
                raise Diverged("the policy's actions are no finite numbers: lower the rate")
            # What the environment cannot do is cut here; what was drawn is what is learned from.
            sent = np.clip(actions, space.low, space.high).astype(np.float32)
            observed, rewards, over, late, infos = self.envs.step(sent)
            finite_rows("observation", observed, self.steps + t)
            finite_rows("reward", rewards, self.steps + t)
            if not self.same_step:
                # After an end the next step of "NextStep" only resets, and teaches nothing.
                batch.valid[t] = ~self.over
            elif late.any():
                # "SameStep" has reset already: the last observation of the old episode is in
                # `infos`.
                after = np.array(observed, dtype=float)
                for i in np.flatnonzero(late):
                    after[i] = infos["final_obs"][i]
                batch.cut.append((t, after))
            batch.rewards[t], batch.terminated[t], batch.truncated[t] = rewards, over, late
            self.last, self.over = np.asarray(observed, dtype=float), over | late
            self.total += rewards
            self.length += batch.valid[t]
            for i in np.flatnonzero(self.over):
                batch.ended.append((float(self.total[i]), int(self.length[i]), bool(over[i])))
                self.total[i], self.length[i] = 0.0, 0
        batch.observations[T] = self.last
        self.steps += T
        return batch

    def scaled(self, batch: Batch) -> Array:
        """Return the rewards in units of the deviation of what they come to, (T, N)."""
        if not self.settings.scale_rewards:
            return batch.rewards
        sums = np.empty_like(batch.rewards)
        for t in range(len(sums)):
            # Discounted sum of rewards so far, whose deviation is the unit of the rewards.
            self.worth = self.settings.discount * self.worth + batch.rewards[t]
            sums[t] = self.worth
            # The end of an episode begins a new sum.
            self.worth = self.worth * ~(batch.terminated[t] | batch.truncated[t])
        self.scale.update(sums.reshape(-1, self.scale.mean.size))
        return batch.rewards / np.sqrt(self.scale.variance + 1e-8)


def finite_rows(name: str, rows: Any, step: int) -> None:
    """Raise ValueError with environment and step if a number of some rows is not finite."""
    # One sum tells whether all is finite; the rows are searched only if it is not.
    if not math.isfinite(np.sum(rows)):
        bad = ~np.isfinite(np.asarray(rows, dtype=float)).reshape(len(rows), -1).all(axis=1)
        if bad.any():
            i = int(np.argmax(bad))
            raise invalid(f"{name} of environment {i} at step {step}", rows[i], "finite numbers")


class Table(NamedTuple):
    """The rows that are learned from, float32: an epoch shuffles all of them at once."""

    observations: Any  # (rows, d), as the networks take them
    actions: Any  # (rows, a)
    log_prob: Any  # of the action when it was drawn, but for a constant, (rows, 1)
    advantages: Any
    targets: Any


def judged(batch: Batch, rewards: Array, policy: ActorCritic, settings: Settings) -> Table:
    """Return the rows of a batch with their advantages; the critic judges all of them at once."""
    T, n = rewards.shape
    with pytorch().inference_mode():
        # One more row than steps: the last observation, for the value that follows the last step.
        observed = policy.to_rows(batch.observations)
        values = policy.critic(observed).numpy().astype(float).reshape(T + 1, n)
        if not np.isfinite(values).all():
            raise Diverged("the critic's values are not finite: lower the rate")
        # The value after a step is that of the next row, except where the clock cut an episode off:
        # there the last observation of the old episode counts.
        following = values[1:].copy()
        for t, after in batch.cut:
            last = policy.critic(policy.to_rows(after)).numpy()[:, 0]
            following[t] = np.where(batch.truncated[t], last, following[t])
    over, late = batch.terminated, batch.truncated
    # Without bootstrapping the clock's end counts as a termination.
    if not settings.bootstrap:
        over, late = over | late, np.zeros_like(late)
    advantages = gae(rewards, values[:-1], following, over, late, settings.discount, settings.trace)
    log_std = policy.log_std.detach().numpy()
    columns = (
        observed[: T * n].numpy(),
        batch.means + np.exp(log_std) * batch.noise,
        log_density(batch.noise, log_std),
        advantages,
        advantages + values[:-1],
    )
    # Rows of the step that only resets are dropped.
    retained = (batch.valid | settings.crossing).reshape(-1)
    return Table(*(c.reshape(T * n, -1)[retained].astype(np.float32) for c in columns))


def log_density(noise: Array, log_std: Array) -> Array:
    """Return the log-density, (..., 1), of actions in deviations (..., a), up to a constant."""
    return -0.5 * (noise * noise).sum(axis=-1, keepdims=True) - log_std.sum()


def slopes(policy: ActorCritic, part: Table, settings: Settings) -> float:
    """Return the loss of a minibatch; its gradient is in `policy.flat.grad`.

    By hand as far as the networks' outputs, where some numbers an action are left of it; from there
    on PyTorch's.
    """
    torch = pytorch()
    policy.flat.grad.zero_()
    observed, count_of = torch.from_numpy(part.observations), len(part.observations)
    mean, value = policy.actor(observed), policy.critic(observed)
    log_std = policy.log_std.detach().numpy()
    std = np.exp(log_std)
    # Log-probability ratio of the new policy to the one that acted.
    deviation = (part.actions - mean.detach().numpy()) / std
    ratio = np.exp(log_density(deviation, log_std) - part.log_prob)
    gain, slope = clipped_objective(ratio, part.advantages, settings.clip)
    error = value.detach().numpy() - part.targets
    # Gradient of the clipped objective by log-probability, of the value loss by the value; the
    # networks' own gradients follow by backpropagation.
    push = -slope * ratio / count_of  # by the logarithm of the probability
    pull = (2.0 * settings.value_weight / count_of) * error
    torch.autograd.backward(
        (mean, value), (torch.from_numpy(push * deviation / std), torch.from_numpy(pull))
    )
    # The log-density has the derivative deviation^2 - 1 with respect to log_std, the entropy 1.
    policy.log_std.grad += torch.from_numpy(
        (push * (deviation * deviation - 1.0)).sum(0) - settings.entropy
    )
    losses = settings.value_weight * (error * error).mean() - gain.mean()
    return float(losses - settings.entropy * log_std.sum())


def improve(
    policy: ActorCritic, table: Table, optimiser: Any, rng: np.random.Generator, settings: Settings
) -> tuple[float, float]:
    """Run the epochs of an iteration (Schulman et al., 2017, algorithm 1) and update the policy.

    Args:
        policy: the one that acted; its weights are changed in place.
        table: the rows of the batch, with advantages and targets of the critic.
        optimiser: of `policy.flat`.
        rng: shuffles the rows, once an epoch.
        settings: epochs, minibatches, clip and limits. A table with fewer rows than `minibatches`,
            since steps that reset were dropped, is split into single rows; without any row there
            is no update.

    Returns:
        KL(old || new), the divergence of the policy that acted from the updated one, averaged over
        the rows [nats]; and the share of the actions whose probability ratio ended outside of
        1 - clip to 1 + clip.

    Raises:
        Diverged: for a loss that is not finite, and for a KL divergence above `RUNAWAY`. The policy
            then has the weights again with which it acted.
    """
    rows = len(table.observations)
    if not rows:
        return 0.0, 0.0
    # A view: `slopes` fills it, and clipping it in place clips what the optimiser uses.
    torch, gradient = pytorch(), policy.flat.grad.numpy()
    weights = policy.flat.detach().clone()
    # The policy that acted, from which the KL divergence is measured.
    old_mean = policy(table.observations, scaled=True)
    old_log_std = policy.log_std.detach().numpy().copy()
    # Advantages are normalised over the batch, once, not by minibatch.
    if settings.normalise_advantages:
        mean, std = table.advantages.mean(), table.advantages.std()
        table = table._replace(advantages=(table.advantages - mean) / (std + 1e-8))
    for epoch in range(settings.epochs):
        # Shuffle once an epoch; minibatches are then slices, none of them empty.
        order = rng.permutation(rows)
        parts = min(settings.minibatches, rows)
        shuffled = (np.array_split(x[order], parts) for x in table)
        for part in zip(*shuffled, strict=True):
            loss = slopes(policy, Table(*part), settings)
            gradient_norm = length(gradient)
            # A loss that is not finite is noticed before the optimiser spoils the weights.
            if not math.isfinite(loss + gradient_norm):
                with torch.no_grad():
                    policy.flat.copy_(weights)
                raise Diverged(
                    f"the loss is {loss}, its gradient {gradient_norm} long: lower the rate"
                )
            # Clip the gradient's norm (Pascanu, Mikolov and Bengio, 2013).
            if gradient_norm > settings.longest_gradient:
                gradient *= settings.longest_gradient / gradient_norm
            optimiser.step()
        # The KL divergence costs a pass over the batch, so it is computed only where it is needed:
        # after each epoch if it may stop the iteration, and after the last one in any case.
        if epoch == settings.epochs - 1 or settings.most_kl < math.inf:
            new_mean = policy(table.observations, scaled=True)
            new_log_std = policy.log_std.detach().numpy()
            # KL(old || new) between Gaussians in closed form. `ratio` is the mean square of the old
            # actions around the new mean, over the new variance: 1 for an unchanged policy.
            second_moment = (old_mean - new_mean) ** 2 + np.exp(2.0 * old_log_std)
            ratio = second_moment * np.exp(-2.0 * new_log_std)
            kl = float((new_log_std - old_log_std + 0.5 * ratio - 0.5).sum(axis=1).mean())
            if not kl < RUNAWAY:
                with torch.no_grad():
                    policy.flat.copy_(weights)
                cure = "lower the rate, raise the spread, or set most_kl"
                raise Diverged(
                    f"an iteration moved the policy by a KL divergence of {kl:.3g}: {cure}"
                )
            # Early stopping: the policy has moved as far as its data are good for.
            if kl > settings.most_kl:
                break
    # Ratios of the updated policy to the one that acted, on the actions of the batch.
    deviation = (table.actions - new_mean) * np.exp(-new_log_std)
    ratio = np.exp(log_density(deviation, new_log_std) - table.log_prob)
    return kl, float(np.mean(np.abs(ratio - 1.0) > settings.clip))


def ppo(
    envs: Any, settings: Settings | None = None, *, steps: int, seed: int = 0
) -> Iterator[Iteration]:
    """Learn, and yield after each iteration, so that the caller can stop.

    Args:
        envs: a `gymnasium.vector.VectorEnv` with numbers for observations and actions, whose
            autoreset is "SameStep" or "NextStep".
        settings: every detail; the usual ones by default.
        steps: of all environments together; whole iterations are run, at least one.
        seed: of the environments, the weights and all that is drawn.

    Yields:
        An `Iteration` each.

    Raises:
        ValueError: for environments that are no vector of them or have no continuous actions, a
            batch of a single row, minibatches that don't divide the batch, an observation or a
            reward that is not finite (the message names environment and step), an observation that
            never changes.
        Diverged: for a loss or an action that is not finite, and for an iteration that moves the
            policy by a KL divergence above `RUNAWAY`; the policy that was yielded last has the last
            good weights.
    """
    torch, settings = pytorch(), settings or Settings()
    if not isinstance(settings, Settings):
        raise invalid("settings", settings, "a Settings, or None for the usual ones")
    space: Any = getattr(envs, "single_action_space", None)
    if not all(hasattr(envs, name) for name in ("num_envs", "metadata", "reset", "step")):
        raise invalid("envs", envs, "a gymnasium.vector.VectorEnv")
    if not hasattr(space, "low") or len(space.shape) != 1:
        raise invalid("envs.single_action_space", space, "a Box with one axis")
    T, n = settings.horizon, envs.num_envs
    count("steps", steps, 1)
    if T * n < 2:
        allowed = "2 or more: raise the horizon, or use more environments"
        raise invalid("horizon * environments", T * n, allowed)
    if T * n % settings.minibatches:
        allowed = f"a number that divides the batch of {T} * {n} steps"
        raise invalid("minibatches", settings.minibatches, allowed)
    runner = Runner(envs, count("seed", seed), settings)
    inputs, outputs = runner.last.shape[1], space.shape[0]
    policy = ActorCritic(inputs, outputs, seed, settings, n)
    optimiser = torch.optim.Adam([policy.flat], settings.rate, eps=1e-5, fused=True)
    rounds = max(1, steps // (T * n))
    for k in range(rounds):
        # Numbers that run away are looked for, and told by `Diverged`.
        with one_thread(), np.errstate(all="ignore"):
            # The rate falls linearly to 0 over all iterations.
            if settings.anneal:
                optimiser.param_groups[0]["lr"] = settings.rate * (1.0 - k / rounds)
            batch = runner.collect(policy)
            table = judged(batch, runner.scaled(batch), policy, settings)
            error = table.advantages
            kl, clipped = improve(policy, table, optimiser, runner.rng, settings)
            # Statistics change after the update, so that one iteration sees one normalisation.
            if settings.normalise_observations:
                rows = batch.observations[:T].reshape(-1, policy.normaliser.mean.size)
                policy.normaliser.update(rows)
                policy.normaliser.check("observations")
        columns = np.array(batch.ended, dtype=float).reshape(-1, 3).T
        yield Iteration(
            (k + 1) * T * n,
            policy,
            columns[0],
            columns[1].astype(int),
            columns[2] > 0.0,
            kl,
            clipped,
            float(np.mean(error**2)) if error.size else math.nan,
            float(policy.log_std.detach().exp().mean()),
        )
