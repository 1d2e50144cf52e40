"""The policies of two ways on record, for pages that cannot wait; `python -m course.learning`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.check import one_of
from course.learning.chunk import chunk_policy
from course.learning.clone import Policy, clone
from course.learning.generate import diffusion_policy, flow_policy
from course.learning.network import load, weights
from course.learning.tasks import TwoWays, windows

RECORD = Path(__file__).with_name("two_ways.npz")
CHUNK, DEMONSTRATIONS, SEED = 8, 100, 0
HEADS: dict[str, Callable[..., Policy]] = {
    "mean": partial(clone, rate=1e-3, steps=1000),
    "mixture": partial(clone, head="mixture", modes=5, rate=2e-3, steps=2000),
    "flow": partial(flow_policy, width=64, rate=2e-3, steps=4000),
    "diffusion": partial(diffusion_policy, width=64, rate=2e-3, steps=4000),
    "autoencoder": partial(chunk_policy, latent=1, beta=0.1, rate=2e-3, steps=1500),
}


def remake(name: str, **how: int) -> Policy:
    """Return a policy of chunks of 8 steps, fitted anew in a few seconds.

    Args:
        name: of `HEADS`.
        how: other arguments of `fit`.
    """
    states, chunks = windows(TwoWays().demonstrate(DEMONSTRATIONS, SEED), CHUNK)
    return HEADS[one_of("name", name, HEADS)](states, chunks, SEED, **how)


def recorded(name: str) -> Policy:
    """Return the same with its weights on record: built by one step of the fit, then loaded."""
    # A single step builds the normalisers and the network, whose weights are then replaced.
    policy = remake(name, steps=1)
    load(policy.net, stored_weights(name))
    return policy


def stored_weights(name: str) -> NDArray[np.float32]:
    """Return the weights on record of one of `HEADS`, (n,), in the order of `network.weights`."""
    with np.load(RECORD) as stored:
        return stored[one_of("name", name, HEADS)]


def write_record() -> None:
    """Fit all of them anew, some ten seconds of one core."""
    made: dict[str, Any] = {name: weights(remake(name).net) for name in HEADS}
    np.savez_compressed(RECORD, **made)
