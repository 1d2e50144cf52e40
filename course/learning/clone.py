"""Behaviour cloning: fit the actions of a demonstrator, and what is done where that drifts off.

A policy is a function (states (N, d), generator) -> actions, of the shape of one action of its data
after N: (N, a) for single actions, (N, H, a) for chunks. States are what the policy sees.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from course.check import count, invalid, one_of, vector
from course.learning.network import Diverged, Normaliser, fit, network, predict, tensor
from course.learning.tasks import Act, Array, Task, roll
from course.libraries import pytorch

LEAST = 0.02  # deviation of a head, in deviations of the data: below it the likelihood has no top


@dataclass
class Policy:
    """A policy out of data, which it knows normalised.

    Attributes:
        inputs: normaliser of states.
        done: normaliser of flattened actions.
        shape: of one action, (a,) or (H, a).
        draw: normalised states (N, d), generator -> normalised actions, flattened (N, ...); kinds
            that can be told how to draw hand it something else than the generator.
        net: the module that was fitted, if one was.
        losses, seconds: of each step of the fit, and processor time of it [s].
    """

    inputs: Normaliser
    done: Normaliser
    shape: tuple[int, ...]
    draw: Callable[..., Array]
    net: Any = None
    losses: Array = field(default_factory=lambda: np.zeros(0))
    seconds: float = 0.0

    def __call__(self, states: ArrayLike, rng: np.random.Generator) -> Array:
        """Return actions for states (N, d), shape (N, *shape)."""
        drawn = self.draw(self.inputs(states), rng)
        return self.done.undo(drawn).reshape(len(drawn), *self.shape)


def prepared(states: ArrayLike, actions: ArrayLike) -> tuple[Policy, Array, Array]:
    """Return a policy that can't draw yet, and its data normalised: (n, d) and flattened (n, ...).

    Raises:
        ValueError: for fewer than two rows, rows that disagree, no finite number, or a column
            without variance.
    """
    x = vector("states", states, (None, None))
    y = vector("actions", actions, (len(x), None), (len(x), None, None))
    if len(x) < 2:
        raise invalid("demonstrated steps", len(x), "two or more")
    tables, each = (x, y.reshape(len(y), -1)), []
    for name, table in zip(("states", "actions"), tables, strict=True):
        normal = Normaliser.blank(table.shape[1])
        # A data set to learn from is normalised, but never clipped.
        normal.limit = math.inf
        normal.update(table)
        normal.check(name)
        each.append(normal)
    blank = Policy(each[0], each[1], y.shape[1:], lambda rows, rng: rows)
    return blank, each[0](tables[0]), each[1](tables[1])


def fitted(policy: Policy, net: Any, loss: Callable[[Any], Any], rows: int, **how: Any) -> Policy:
    """Return the policy once its network is fitted (`fit` has the other arguments).

    Raises:
        Diverged: its `policy` is the policy with the last good weights.
    """
    # Processor time, which other programs on the machine do not lengthen.
    began = time.process_time()
    policy.net = net
    try:
        policy.losses = fit(net, loss, rows, **how)
    except Diverged as stop:
        stop.policy = policy
        raise
    policy.seconds = time.process_time() - began
    return policy


def normals(seed: int) -> Callable[..., Any]:
    """Return standard normal numbers as tensors of a shape, from a generator of their own."""
    torch = pytorch()
    random = torch.Generator().manual_seed(seed)
    return partial(torch.randn, generator=random)


# --- heads ----------------------------------------------------------------------------------------


def clone(
    states: ArrayLike,
    actions: ArrayLike,
    seed: int,
    *,
    head: str = "mean",
    modes: int = 2,
    width: int = 64,
    **how: Any,
) -> Policy:
    """Return behaviour cloning with one of three heads.

    "mean" is fitted by squared error. "gaussian" draws from a normal distribution whose mean and
    deviations depend on the state, "mixture" from several with weights (Bishop, Mixture density
    networks, 1994), both fitted by likelihood. No deviation is below 0.02 of the data's.

    Args:
        states: shape (n, d).
        actions: shape (n, a), or chunks (n, H, a).
        seed: of weights and batches.
        head: what the network predicts: "mean", "gaussian" or "mixture".
        modes: components of the mixture.
        width: of the two hidden layers.
        how: `steps`, `batch`, `rate` and `clip` of `fit`.
    """
    policy, x, y = prepared(states, actions)
    modes = {"mean": 0, "gaussian": 1, "mixture": count("modes", modes, 1)}[
        one_of("head", head, ("mean", "gaussian", "mixture"))
    ]
    torch, size = pytorch(), y.shape[1]
    outputs = modes * (1 + 2 * size) if modes else size
    net = network((x.shape[1], width, width, outputs), seed, activation="silu")
    inputs, desired = tensor(x), tensor(y)

    def parts(out: Any) -> tuple[Any, Any, Any]:
        """Return logarithms of weights (n, m), means and deviations (n, m, size)."""
        means, raw = out[:, modes:].reshape(-1, modes, 2, size).unbind(2)
        # Softplus keeps deviations positive, the floor keeps the likelihood bounded.
        deviations = torch.nn.functional.softplus(raw) + LEAST
        return torch.log_softmax(out[:, :modes], 1), means, deviations

    def loss(pick: Any) -> Any:
        out = net(inputs[pick])
        if not modes:
            return (out - desired[pick]).square().mean()
        weight, mean, deviation = parts(out)
        # Negative log-likelihood of the mixture, up to a constant, by a stable log-sum-exp.
        difference = (desired[pick][:, None] - mean) / deviation
        return (
            -torch.logsumexp(weight - (0.5 * difference**2 + deviation.log()).sum(2), 1).mean()
            / size
        )

    def draw(rows: Array, rng: np.random.Generator) -> Array:
        out = predict(net, rows)
        if not modes:
            return out
        weight, mean, deviation = (np.asarray(p) for p in parts(torch.from_numpy(out)))
        # The Gumbel-max trick samples a component from the log-weights.
        which = np.argmax(weight + rng.gumbel(size=weight.shape), axis=1)
        row = np.arange(len(rows))
        return mean[row, which] + deviation[row, which] * rng.standard_normal((len(rows), size))

    policy.draw = draw
    return fitted(policy, net, loss, len(x), seed=seed, **how)


def nearest(states: ArrayLike, actions: ArrayLike) -> Policy:
    """Return the action taken in the nearest state of the data, the first of several.

    Nothing is fitted.
    """
    policy, x, y = prepared(states, actions)

    def draw(rows: Array, rng: np.random.Generator) -> Array:
        # Brute force over normalised states, so that no unit decides what is near.
        return y[np.argmin(np.square(rows[:, None] - x).sum(axis=2), axis=1)]

    policy.draw = draw
    return policy


@dataclass(frozen=True)
class Linear:
    """A linear law, action = -gain state.

    Attributes:
        gain: shape (a, d).
        rank: of the states it was fitted to; below d the data leave directions open.
    """

    gain: Array
    rank: int

    def __call__(self, states: Array, rng: np.random.Generator) -> Array:
        """Return actions (N, a) for states (N, d)."""
        return -np.asarray(states) @ self.gain.T


def linear(states: ArrayLike, actions: ArrayLike) -> Linear:
    """Return the least-squares linear law of states (n, d) and actions (n, a).

    Where the data leave gains undetermined it is the one of least norm.
    """
    x = vector("states", states, (None, None))
    y = vector("actions", actions, (len(x), None))
    if len(x) < 2:
        raise invalid("demonstrated steps", len(x), "two or more")
    # Least squares by the singular value decomposition, without directions that the data lack.
    left, sizes, right = np.linalg.svd(x, full_matrices=False)
    rank = int(np.sum(sizes > 1e-10 * sizes[0]))
    solved = right[:rank].T @ ((left[:, :rank].T @ y) / sizes[:rank, None])
    return Linear(-solved.T, rank)


# --- asked where the learner goes -----------------------------------------------------------------


class Round(NamedTuple):
    """A round of `dagger`: the policy, and the states (n, d) and labels (n, a) it was taught."""

    policy: Act
    states: Array
    labels: Array


def dagger(
    task: Task,
    expert: Act,
    learn: Callable[[Array, Array], Act],
    starts: Callable[[int, np.random.Generator], Array],
    steps: int,
    rng: np.random.Generator,
    *,
    number: int = 20,
    rounds: int = 5,
    injected: float = 0.0,
    label_noise: float = 0.0,
) -> Iterator[Round]:
    """Yield the rounds of DAgger, dataset aggregation (Ross, Gordon and Bagnell, 2011).

    In the first round the expert drives, which is plain cloning. After that the learner drives, the
    expert labels each state with its own action, and a policy is trained from scratch on all data
    so far (the paper's beta is 1, 0, 0, ...). Source: A reduction of imitation learning and
    structured prediction to no-regret online learning.

    Args:
        learn: states (n, d), labels (n, a) -> policy, such as `linear` or a `partial` of `clone`.
        starts: how many, generator -> states, as the tasks have it.
        task: the dynamics.
        expert: states (n, d) -> actions (n, a), the labels.
        steps: of a run.
        number: runs in a round.
        rounds: rounds after the first.
        rng: source of the starts and of the noise.
        injected: noise on the expert's actions in the first round, which its labels don't have.
        label_noise: deviation of what is written down; the expert does what it means.

    Yields:
        Each round; stop whenever you like.

    Raises:
        ValueError: for a label that is not finite, naming the round; what came before stands.
    """
    count("rounds", rounds)
    states, labels = np.zeros((0, 0)), np.zeros((0, 0))
    driver = expert
    for turn in range(rounds + 1):
        # The expert drives the first round, the learner all others.
        noise = 0.0 if turn else injected
        ran = roll(task, driver, starts(number, rng), steps, rng, injected=noise)
        # The expert labels every visited state, also those that the learner reached.
        met = ran.states[:, :-1].reshape(number * steps, -1)
        message = vector(f"label of round {turn}", expert(met, rng), (len(met), None))
        report = message + label_noise * rng.standard_normal(message.shape)
        # Aggregate: the policy is fitted to all rounds together.
        states = np.concatenate((states, met)) if turn else met
        labels = np.concatenate((labels, report)) if turn else report
        driver = learn(states, labels)
        yield Round(driver, states, labels)
