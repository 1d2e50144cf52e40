"""The compiled forward passes against PyTorch's, with the same weights and random numbers."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from course.learning import Drawn, load, network, predict, recorded, weights
from course.learning.forward import mixture_sample, perceptron
from course.learning.recorded import HEADS
from course.simulations import splitmix
from course.simulations.learning import two_ways

pytestmark = pytest.mark.slow


class Replay:
    """Random numbers that another one has drawn, as a policy of PyTorch asks for them."""

    def __init__(self, seed: int, rows: int, autoencoder: bool) -> None:
        state, normal, uniform = (
            np.array([seed], np.uint64),
            np.empty(16 * rows),
            np.empty(5 * rows),
        )
        splitmix.normal(state, normal)
        splitmix.uniform(state, uniform)
        self.normal = normal.reshape(rows, 16)[:, : 1 if autoencoder else 16]
        self.uniform = uniform.reshape(rows, 5)

    def standard_normal(self, size: Any) -> Any:
        assert self.normal.shape == tuple(size)
        return self.normal

    def gumbel(self, size: Any) -> Any:
        assert self.uniform.shape == tuple(size)
        return -np.log(-np.log1p(-self.uniform))


@pytest.mark.parametrize(("hidden", "outputs"), [(4, 1), (64, 16), (7, 3), (16, 165)])
def test_a_network_computes_what_pytorch_does(hidden: int, outputs: int) -> None:
    rows = np.random.default_rng(1).normal(0.0, 2.0, (9, 5))
    net = network((5, hidden, hidden, outputs), 3, activation="silu")
    # Offsets start at 0, where a forgotten one would not show.
    values = weights(net) + np.float32(0.1)
    result = perceptron(rows, values, hidden, outputs)
    np.testing.assert_allclose(result, predict(load(net, values), rows), rtol=2e-5, atol=2e-5)


@pytest.mark.parametrize("sampled", [1, 7])
@pytest.mark.parametrize("name", HEADS)
def test_a_policy_of_the_page_acts_as_the_one_on_record(name: str, sampled: int) -> None:
    states = np.random.default_rng(2).uniform((-0.1, -0.4), (1.0, 0.4), (40, 2))
    policy = recorded(name)
    if isinstance(policy, Drawn):
        policy = replace(policy, steps=sampled)
    replay: Any = Replay(11, 40, name == "autoencoder")
    desired = policy(states, replay)
    head = tuple(HEADS).index(name)
    result = two_ways.chunk(head, states, sampled, np.array([11], np.uint64))
    np.testing.assert_allclose(result.reshape(40, 8, 2), desired, rtol=0.0, atol=2e-5)
    assert np.ptp(result, axis=0).max() > 0.02


def test_samples_of_a_mixture_have_its_weights_means_and_deviations() -> None:
    n, rng = 40_000, np.random.default_rng(3)
    # Weights 1 to 3; means -1 and 2; deviations of softplus, 0.02 above it.
    row = np.array([0.0, np.log(3.0), -1.0, -2.0, 2.0, 1.0])
    out = np.tile(row, (n, 1))
    gumbel, normal = rng.gumbel(size=(n, 2)), rng.standard_normal((n, 1))
    drawn = mixture_sample(out, 2, gumbel, normal)[:, 0]
    first = np.log1p(np.exp(-2.0)) + 0.02
    second = np.log1p(np.exp(1.0)) + 0.02
    assert drawn.mean() == pytest.approx(0.25 * -1.0 + 0.75 * 2.0, abs=0.04)
    expected = 0.25 * (first**2 + 1.0) + 0.75 * (second**2 + 4.0) - 1.25**2
    assert drawn.var() == pytest.approx(expected, rel=0.03)
