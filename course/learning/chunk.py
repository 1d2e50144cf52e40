"""Chunks of actions: an autoencoder that draws them, and the ways to carry them out.

The autoencoder is what ACT (Zhao et al., Learning fine-grained bimanual manipulation with low-cost
hardware, 2023) adds to cloning: a code z for what differs between demonstrations of one state. ACT
puts it in a transformer, as it sees four cameras; here a state is two numbers, so that there is
nothing to attend to and a multilayer perceptron does.

An executor turns a policy of chunks (N, H, a) into one of single actions (N, a) that remembers.
`roll` resets it; elsewhere call `reset()` before each episode.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from course.check import count, finite, invalid, positive
from course.learning.clone import Policy, fitted, normals, prepared
from course.learning.network import network, predict, tensor
from course.learning.tasks import Act, Array
from course.libraries import pytorch


@dataclass
class Coded(Policy):
    """A policy with a code; `replace(policy, zero=True)` takes it as 0, as ACT runs.

    Attributes:
        latent: numbers in the code.
        zero: whether the code is 0 instead of drawn.
    """

    latent: int = 2
    zero: bool = False

    def __call__(self, states: ArrayLike, rng: np.random.Generator) -> Array:
        """Return actions for states (N, d), shape (N, *shape)."""
        rows = self.inputs(states)
        # ACT acts with the mean of the prior, which is a code of 0.
        code = rng.standard_normal((len(rows), self.latent)) * (not self.zero)
        return self.done.undo(self.draw(rows, code)).reshape(len(rows), *self.shape)


def chunk_policy(
    states: ArrayLike,
    actions: ArrayLike,
    seed: int,
    *,
    latent: int = 2,
    beta: float = 0.03,
    width: int = 64,
    zero: bool = False,
    **how: Any,
) -> Coded:
    """Return a conditional variational autoencoder of actions (Sohn, Lee and Yan, 2015).

    An encoder sees state and action and says mean and deviation of the code, a decoder sees state
    and code. The loss is the decoder's squared error plus `beta` times the divergence of the codes
    from a standard normal distribution, from which they are drawn when there is no action to see.

    Args:
        states: shape (n, d).
        actions: shape (n, a), or chunks (n, H, a).
        seed: of weights, codes and batches.
        width: of the two hidden layers of each network.
        latent: dimension of a code.
        zero: whether the code is 0 instead of sampled when the policy acts.
        beta: weight of the divergence; as it grows the code carries less information, and the
            policy becomes the mean.
        how: `steps`, `batch`, `rate` and `clip` of `fit`.
    """
    blank, x, y = prepared(states, actions)
    positive("beta", beta)
    torch, size, d = pytorch(), y.shape[1], x.shape[1]
    encoder = network(
        (d + size, width, width, 2 * count("latent", latent, 1)), seed, activation="silu", last=0.1
    )
    decoder = network((d + latent, width, width, size), seed + 1, activation="silu")
    inputs, desired, randn = tensor(x), tensor(y), normals(seed)

    def loss(pick: Any) -> Any:
        rows, clean = inputs[pick], desired[pick]
        # Reparameterisation trick: the code is mean + deviation times noise, so gradients reach
        # both.
        mean, spread = encoder(torch.cat((rows, clean), 1)).split(latent, 1)  # log of the variance
        code = mean + (0.5 * spread).exp() * randn(mean.shape)
        text = decoder(torch.cat((rows, code), 1))
        # Divergence of the code's distribution from a standard normal, in closed form.
        divergence = 0.5 * (mean.square() + spread.exp() - spread - 1.0).sum(1).mean()
        return (text - clean).square().mean() + beta * divergence

    def draw(rows: Array, code: Array) -> Array:
        return predict(decoder, np.concatenate((rows, code), axis=1))

    policy = Coded(blank.inputs, blank.done, blank.shape, draw, latent=latent, zero=zero)
    both = torch.nn.ModuleList([decoder, encoder])
    fitted(policy, both, loss, len(x), seed=seed, **how)
    return policy


# --- executors ------------------------------------------------------------------------------------


@dataclass
class Executor:
    """What carries out chunks: remembers the last ones, the newest last, and how far it is.

    Attributes:
        policy: states (N, d), generator -> chunks (N, H, a).
    """

    policy: Act
    made: deque[Array] = field(default_factory=deque, init=False, repr=False)
    step: int = field(default=0, init=False, repr=False)

    def reset(self) -> None:
        """Begin an episode."""
        self.made.clear()
        self.step = 0

    def plan(self, states: Array, rng: np.random.Generator, least: int) -> None:
        """Request new chunks of at least `least` steps, and store them."""
        chunk = np.asarray(self.policy(states, rng), dtype=float)
        if chunk.ndim != 3 or chunk.shape[0] != len(states) or chunk.shape[1] < least:
            raise invalid("chunk.shape", chunk.shape, f"({len(states)}, {least} or more, a)")
        if self.made and self.made[-1].shape != chunk.shape:
            was = f"{self.made[-1].shape} as before, until reset()"
            raise invalid("chunk.shape", chunk.shape, was)
        self.made.append(chunk)


@dataclass
class Commit(Executor):
    """Carry out the first `executed` steps of a chunk without a look, then ask for the next."""

    executed: int = 1

    def __post_init__(self) -> None:
        count("executed", self.executed, 1)

    def __call__(self, states: Array, rng: np.random.Generator) -> Array:
        """Return actions (N, a) for states (N, d)."""
        k = self.step % self.executed
        if k == 0:
            self.made.clear()
            self.plan(states, rng, self.executed)
        # The number of runs may not change while a chunk is carried out.
        if len(self.made[0]) != len(states):
            raise invalid("states.shape", np.shape(states), f"{len(self.made[0])} rows, or reset()")
        self.step += 1
        return self.made[0][:, k]


@dataclass
class Ensemble(Executor):
    """Ask at each step and take the mean of what all chunks say of it (ACT, 2023, sec. IV).

    Attributes:
        decay: weights are exp(-decay i), i = 0 for the oldest chunk: the new comes in slowly.
    """

    decay: float = 0.01

    def __post_init__(self) -> None:
        finite("decay", self.decay)

    def __call__(self, states: Array, rng: np.random.Generator) -> Array:
        """Return actions (N, a) for states (N, d)."""
        self.plan(states, rng, 1)
        # A chunk that is older than it is long says nothing of this step.
        if len(self.made) > self.made[0].shape[1]:
            self.made.popleft()
        old = len(self.made)
        # Weights of temporal ensembling: exp(-decay i), the oldest chunk first, as in ACT.
        weights = np.exp(-self.decay * np.arange(old))
        # Chunk i was planned `old - 1 - i` steps ago, so that is its action for this step.
        report = [chunk[:, old - 1 - i] for i, chunk in enumerate(self.made)]
        return np.tensordot(weights / weights.sum(), np.array(report), axes=1)


@dataclass
class Delayed(Executor):
    """At each step act on the state `delay` steps ago: the chunk's one action for that time.

    It observes at every step as a policy of single actions does, but acts on an older observation
    as a chunk does. Comparing the two shows how much of a chunk's effect comes from the older
    observation alone. For the first steps it follows the first chunk.
    """

    delay: int = 1

    def __post_init__(self) -> None:
        count("delay", self.delay)

    def __call__(self, states: Array, rng: np.random.Generator) -> Array:
        """Return actions (N, a) for states (N, d)."""
        self.plan(states, rng, self.delay + 1)
        # The oldest chunk that is kept was planned `delay` steps ago.
        if len(self.made) > self.delay + 1:
            self.made.popleft()
        return self.made[0][:, len(self.made) - 1]
