"""Networks and the normaliser against closed forms and finite differences."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from course.learning import (
    Diverged,
    Normaliser,
    fit,
    flatten,
    load,
    network,
    predict,
    tensor,
    weights,
)
from course.learning.network import length
from tests.budget import examples


def test_the_length_of_a_gradient_is_exact_and_depends_on_no_order():
    """A float32 dot product is off in the seventh digit, by another amount on each CPU."""
    rng = np.random.default_rng(0)
    for n in (1, 700, 100_003):
        gradient = (10.0 ** rng.uniform(-6.0, 2.0, n) * rng.normal(size=n)).astype(np.float32)
        exact = math.sqrt(math.fsum(float(x) ** 2 for x in gradient))
        assert length(gradient) == pytest.approx(exact, rel=1e-14)
        assert length(gradient[::-1]) == pytest.approx(exact, rel=1e-14)
    assert length(np.full(2, 3e38, dtype=np.float32)) > 4e38  # whose squares are beyond float32


@pytest.mark.parametrize("activation", ["tanh", "relu", "silu"])
def test_a_network_is_what_its_weights_say(activation):
    net = network([3, 5, 4, 2], 1, activation=activation, last=0.1)
    rows = np.random.default_rng(0).normal(size=(7, 3))
    f: dict[str, Any] = {
        "tanh": np.tanh,
        "relu": lambda x: np.maximum(x, 0),
        "silu": lambda x: x / (1 + np.exp(-x)),
    }
    x, remaining = rows, weights(net).astype(float)
    for a, b in ((3, 5), (5, 4), (4, 2)):
        W, remaining = remaining[: a * b].reshape(b, a), remaining[a * b :]
        x, remaining = x @ W.T + remaining[:b], remaining[b:]
        # Orthogonal: rows or columns of one length, at right angles.
        small = W @ W.T if b <= a else W.T @ W
        np.testing.assert_allclose(small, small[0, 0] * np.eye(len(small)), atol=1e-5)
        x = f[activation](x) if b != 2 else x
    np.testing.assert_allclose(predict(net, rows), x, atol=1e-5)
    assert small[0, 0] == pytest.approx(0.01)


def test_a_seed_is_a_network_and_nothing_else_is_drawn():
    before = torch.random.get_rng_state()
    one, same, other = (weights(network([2, 8, 1], seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0.1
    np.testing.assert_array_equal(weights(load(network([2, 8, 1], 9), one)), one)
    assert torch.equal(torch.random.get_rng_state(), before)


def test_weights_in_one_vector_learn_as_in_many():
    nets = [network([3, 8, 1], 2), network([3, 8, 1], 2)]
    flat = flatten(nets[0])
    optimisers = [torch.optim.Adam([flat], 0.01), torch.optim.Adam(nets[1].parameters(), 0.01)]
    x = tensor(np.random.default_rng(1).normal(size=(20, 3)))
    for _ in range(30):
        for net, optimiser in zip(nets, optimisers, strict=True):
            flat.grad.zero_() if net is nets[0] else optimiser.zero_grad()
            (net(x).sin() ** 2).mean().backward()
            optimiser.step()
    np.testing.assert_allclose(weights(nets[0]), weights(nets[1]), rtol=1e-5, atol=1e-7)


@pytest.mark.slow
def test_a_line_is_found_and_a_loss_that_explodes_keeps_the_last_good_weights():
    rng = np.random.default_rng(3)
    x = rng.normal(size=(200, 2))
    y = tensor(x @ [[2.0], [-1.0]] + 0.5)
    inputs, net = tensor(x), network([2, 1], 0)
    report = fit(net, lambda i: ((net(inputs[i]) - y[i]) ** 2).mean(), 200, seed=0, rate=0.05)
    np.testing.assert_allclose(weights(net), [2.0, -1.0, 0.5], atol=1e-3)
    assert report[-1] < 1e-5 * report[0]
    calls = []

    def bad(i):
        calls.append(weights(net))
        return (net(inputs[i]) ** 2).mean() * (np.inf if len(calls) == 4 else 1.0)

    with pytest.raises(Diverged, match="step 3 of"):
        fit(net, bad, 200, seed=0, rate=0.05)
    np.testing.assert_array_equal(weights(net), calls[2])


@examples(30)
@given(st.lists(st.integers(1, 40), min_size=1, max_size=6), st.integers(0, 10**6))
def test_batches_one_by_one_are_all_rows_at_once(sizes, seed):
    rng = np.random.default_rng(seed)
    rows = rng.normal(rng.uniform(-50, 50, 3), rng.uniform(0.1, 20, 3), (sum(sizes), 3))
    running = Normaliser.blank(3)
    for part in np.split(rows, np.cumsum(sizes)[:-1]):
        running.update(part)
    np.testing.assert_allclose(running.mean, rows.mean(axis=0), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(running.variance, rows.var(axis=0), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(running.undo(running(rows)), rows, rtol=1e-9, atol=1e-9)


def test_a_column_that_never_changes_is_refused_and_far_ones_are_cut():
    with pytest.raises(ValueError, match=r"variance of values\[:, 1\] must be .*, got 0.0"):
        Normaliser.of([[1.0, 4.0], [2.0, 4.0]])
    with pytest.raises(ValueError, match=r"values\[1, 0\] must be .*, got nan"):
        Normaliser.of([[1.0, 4.0], [np.nan, 5.0]])
    blank = Normaliser.blank(2)
    np.testing.assert_allclose(blank([[3.0, -70.0]]), [[3.0, -10.0]], rtol=1e-6)


@pytest.mark.parametrize(
    ("call", "report"),
    [
        (lambda: network([3], 0), "sizes must be"),
        (lambda: network([3, 0], 0), r"sizes must be .*, got 0"),
        (lambda: network([3, 1], -1), r"seed must be .*, got -1"),
        (lambda: network([3, 1], 0, activation="sin"), r"activation must be .*, got 'sin'"),
        (lambda: load(network([3, 1], 0), [1.0]), r"values.shape must be .*, got \(1,\)"),
        (lambda: fit(network([3, 1], 0), lambda i: i.sum(), 0, seed=0), r"rows must be .*, got 0"),
    ],
)
def test_bad_input(call, report):
    with pytest.raises(ValueError, match=report):
        call()
