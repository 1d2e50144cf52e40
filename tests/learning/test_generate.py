"""Samplers on mixtures whose fields are known, then the same samplers with trained networks."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import optimize, stats

from course.learning import (
    Mixture,
    TwoWays,
    denoise,
    diffusion_policy,
    flow_policy,
    integrate,
    linear,
    mix,
)
from tests.budget import examples

TWO = Mixture(np.array([0.5, 0.5]), np.array([[-1.0], [1.0]]), np.array([0.1, 0.1]))


def drawn_mixture(rng, parts, size):
    weights = rng.dirichlet(np.full(parts, 2.0))
    return Mixture(weights, rng.normal(0, 2, (parts, size)), rng.uniform(0.2, 1.0, parts))


def order(errors, steps):
    return -np.polyfit(np.log(steps), np.log(errors), 1)[0]


# --- exact fields ---------------------------------------------------------------------------------


@examples(15)
@given(st.integers(1, 4), st.floats(0.1, 0.9), st.integers(0, 2**31))
def test_the_field_is_the_mean_given_the_sample(parts, time, seed):
    """What squared error is smallest for: no line in the exact field betters it on draws."""
    rng = np.random.default_rng(seed)
    made = drawn_mixture(rng, parts, 2)
    clean, noise = made.draw(20_000, rng), rng.standard_normal((20_000, 2))
    x = time * clean + (1.0 - time) * noise
    means = made.expect(x, time, 1.0 - time)
    assert np.allclose(time * means[0] + (1.0 - time) * means[1], x, atol=1e-9)
    observed = np.column_stack((np.ones(len(x)), x, means[0]))
    for mean, truth in zip(means, (clean, noise), strict=True):
        remaining = truth - mean  # uncorrelated with whatever is a function of x
        law = linear(observed, remaining)
        gain = 1.0 - np.sum((remaining - law(observed, rng)) ** 2) / np.sum(remaining**2)
        assert gain < 40.0 / len(x)
    a, s = mix(time)
    assert a**2 + s**2 == pytest.approx(1.0) and np.allclose(
        made.clean(x, time), made.expect(x, float(a), float(s))[0]
    )


@examples(25)
@given(st.integers(1, 4), st.integers(1, 3), st.integers(0, 2**31))
def test_one_step_is_the_mean_whatever_the_data(parts, size, seed):
    rng = np.random.default_rng(seed)
    made, noise = drawn_mixture(rng, parts, size), rng.standard_normal((50, size))
    mean = made.weights @ made.means
    assert np.allclose(integrate(made.velocity, noise, 1, "euler"), mean, atol=1e-12)
    assert np.allclose(denoise(made.clean, noise, 1, rng, eta=seed % 2), mean, atol=1e-12)


def test_solvers_have_their_order_on_the_exact_map():
    """In one dimension a flow keeps the order of samples: it maps quantile to quantile."""
    made = Mixture(np.array([0.3, 0.7]), np.array([[-1.0], [1.0]]), np.array([0.4, 0.5]))
    noise = np.linspace(-2.0, 2.0, 41)

    def below(x, share):
        return made.weights @ stats.norm.cdf(x, made.means[:, 0], made.deviations) - share

    exact = np.array([optimize.brentq(below, -9, 9, (stats.norm.cdf(z),), 1e-13) for z in noise])
    steps = np.array([20, 40, 80, 160])
    for solver, expected in (("euler", 1.0), ("heun", 2.0), ("rk4", 4.0)):
        ends = [integrate(made.velocity, noise[:, None], n, solver)[:, 0] for n in steps]
        errors = [np.sqrt(np.mean((end - exact) ** 2)) for end in ends]
        assert order(errors, steps) == pytest.approx(expected, abs=0.15), solver
    rng = np.random.default_rng(0)
    ends = [denoise(made.clean, noise[:, None], n, rng)[:, 0] for n in steps]
    errors = [np.sqrt(np.mean((end - exact) ** 2)) for end in ends]
    assert order(errors, steps) == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("eta", [0.0, 1.0])
def test_a_diffusion_ends_in_the_distribution_it_began_from(eta):
    rng = np.random.default_rng(2)
    made = Mixture(np.array([0.3, 0.7]), np.array([[-1.0], [1.0]]), np.array([0.2, 0.2]))
    end = denoise(made.clean, rng.standard_normal((20_000, 1)), 200, rng, eta)
    assert np.mean(end < 0.0) == pytest.approx(0.3, abs=0.02)
    for side, centre in ((end < 0.0, -1.0), (end > 0.0, 1.0)):
        assert end[side].mean() == pytest.approx(centre, abs=0.02)
        assert end[side].std() == pytest.approx(0.2, rel=0.06)
    fixed = np.zeros((20, 1))
    spread = np.ptp(denoise(made.clean, fixed, 20, rng, eta))
    assert (spread > 0.1) if eta else (spread == 0.0)  # DDIM draws nothing on the way


# --- trained --------------------------------------------------------------------------------------

WAYS = TwoWays()
SHOWN = WAYS.demonstrate(100, 0)
STATES, CHUNKS = SHOWN.states[:, 0], SHOWN.actions


def driven(policy, seed=5, number=500):
    """Sides of whole chunks, and the chunks."""
    rng = np.random.default_rng(seed)
    start = WAYS.starts(number, rng)
    chunks = policy(start, rng)
    path = start[:, None] + np.concatenate((np.zeros((number, 1, 2)), np.cumsum(chunks, 1)), 1)
    return WAYS.sides(path), chunks


@pytest.fixture(scope="module")
def flow():
    return flow_policy(STATES, CHUNKS, 0, width=64, steps=1500, rate=3e-3)


@pytest.fixture(scope="module")
def diffusion():
    return diffusion_policy(STATES, CHUNKS, 0, width=64, steps=1500, rate=3e-3)


@pytest.mark.prove
def test_trained_policies_pass_on_both_sides_as_the_data_do(flow, diffusion):
    remaining = np.sum(WAYS.sides(SHOWN.states) > 0)
    for policy in (replace(flow, solver="heun"), diffusion, replace(diffusion, solver="ddpm")):
        side, chunks = driven(policy)
        assert chunks.shape == (500, 16, 2) and np.mean(side != 0) > 0.85
        table = [[np.sum(side > 0), np.sum(side < 0)], [remaining, 100 - remaining]]
        assert stats.fisher_exact(table).pvalue > 1e-3


@pytest.mark.prove
def test_with_one_step_they_are_the_mean_and_hit_the_obstacle(flow, diffusion):
    """The error left is how well the network was fitted, a fraction of the spread of the data."""
    for policy in (flow, diffusion, replace(diffusion, solver="ddpm")):
        side, chunks = driven(replace(policy, steps=1))
        assert np.mean(side != 0) < 0.15
        deviation = np.sqrt(np.mean((chunks - CHUNKS.mean(axis=0)) ** 2))
        assert deviation < 0.45 * np.sqrt(np.mean((CHUNKS - CHUNKS.mean(axis=0)) ** 2))
        again = driven(replace(policy, steps=10))[1]
        assert again.std() > 1.2 * chunks.std()


@pytest.mark.slow
@pytest.mark.parametrize("make", [flow_policy, diffusion_policy])
def test_what_is_drawn_depends_on_the_state(make):
    """One normal action for each state: its mean is a line, its deviation 0.3."""
    rng = np.random.default_rng(3)
    x = rng.uniform(-1.0, 1.0, (2000, 1))
    y = 2.0 * x + 0.3 * rng.standard_normal(x.shape)
    policy = make(x, y, 0, width=32, sampled=50, steps=500, rate=3e-3)
    at = np.repeat([[-0.8], [0.0], [0.8]], 1500, axis=0)
    drawn = policy(at, rng).reshape(3, 1500)
    assert drawn.mean(axis=1) == pytest.approx([-1.6, 0.0, 1.6], abs=0.12)
    assert drawn.std(axis=1) == pytest.approx(0.3, rel=0.15)


def test_bad_input_is_refused_by_name():
    noise, rng = np.zeros((3, 1)), np.random.default_rng(0)
    for call, report in (
        (partial(integrate, TWO.velocity, noise, 0), "steps must be a positive integer, got 0"),
        (partial(integrate, TWO.velocity, noise, 5, "ddim"), "solver must be one of"),
        (partial(denoise, TWO.clean, noise, 5, rng, 2.0), "eta must be a number from 0 to 1"),
        (
            partial(denoise, TWO.clean, noise * np.nan, 5, rng),
            r"noise\[0, 0\] must be a finite number",
        ),
        (partial(Mixture, np.array([0.5, 0.6]), TWO.means, TWO.deviations), "sum of weights"),
        (partial(Mixture, TWO.weights, TWO.means, np.array([0.1])), "deviations.shape"),
        (partial(flow_policy, STATES, CHUNKS, 0, solver="ddim", steps=1), "solver must be one of"),
        (
            partial(diffusion_policy, STATES, CHUNKS, 0, sampled=0, steps=1),
            "sampled must be a positive integer",
        ),
    ):
        with pytest.raises(ValueError, match=report):
            call()
