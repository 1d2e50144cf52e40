"""Sampled plans against the mean that theory gives, and what must never win."""

import numpy as np
import pytest

from course.control.sampling import cem, mppi, predictive, shifted

METHODS = [mppi, cem, predictive]


def test_mppi_is_the_mean_of_the_tilted_normal():
    """exp(-(a u^2 / 2 + c u) / t) times a normal about u0 is a normal: its mean, and its voices."""
    a, c, t, s, u0, K = 3.0, -1.0, 2.0, 0.7, 0.5, 200_000

    def rollout(plans):
        return 1e6 + (0.5 * a * plans**2 + c * plans).sum(axis=(1, 2))

    plan = np.full((2, 2), u0)
    result = mppi(rollout, plan, np.random.default_rng(0), samples=K, spread=s, temperature=t)
    truth = (u0 - s**2 * c / t) / (1.0 + s**2 * a / t)
    assert result.plan == pytest.approx(
        np.full((2, 2), truth), abs=6.0 * s / np.sqrt(result.voices)
    )
    # voices / K = E[w]^2 / E[w^2], for each of the four inputs by itself.
    u = np.linspace(u0 - 8 * s, u0 + 8 * s, 20001)
    density = np.exp(-0.5 * ((u - u0) / s) ** 2)
    w = np.exp(-(0.5 * a * u**2 + c * u) / t)
    share = (density @ w) ** 2 / ((density @ w**2) * density.sum())
    assert result.voices / K == pytest.approx(share**4, rel=0.05)


def test_the_best_try_wins_as_the_temperature_falls():
    def rollout(plans):
        return ((plans - 0.4) ** 2).sum(axis=(1, 2))

    cold = mppi(rollout, np.zeros((3, 1)), np.random.default_rng(3), temperature=1e-9)
    best = predictive(rollout, np.zeros((3, 1)), np.random.default_rng(3))
    np.testing.assert_allclose(cold.plan, best.plan, atol=1e-12)
    assert cold.voices == pytest.approx(1.0)
    assert cold.cost == best.cost


@pytest.mark.parametrize("method", METHODS)
def test_a_constant_in_the_cost_changes_nothing_and_a_seed_says_all(method):
    def plans(extra, seed=5):
        return method(
            lambda p: extra + (p**2).sum(axis=(1, 2)), np.ones((4, 2)), np.random.default_rng(seed)
        ).plan

    np.testing.assert_allclose(plans(0.0), plans(2.0**20), atol=1e-8)
    np.testing.assert_array_equal(plans(0.0), plans(0.0))
    assert np.abs(plans(0.0) - plans(0.0, 6)).max() > 1e-3


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("failed", [np.nan, np.inf])
def test_a_rollout_that_fails_never_wins(method, failed):
    def rollout(plans):
        cost = ((plans + 2.0) ** 2).sum(axis=(1, 2))
        cost[plans[:, 0, 0] < 0.0] = failed  # where the cost would be lowest
        return cost

    plan = np.full((2, 1), 0.5)
    result = method(rollout, plan, np.random.default_rng(1), samples=200)
    assert result.plan[0, 0] > 0.0 and result.cost < np.inf and result.voices >= 1.0
    lost = method(lambda p: np.full(len(p), failed), plan, np.random.default_rng(1))
    np.testing.assert_array_equal(lost.plan, plan)
    assert lost.cost == np.inf and lost.voices == 0.0


@pytest.mark.parametrize("method", METHODS)
def test_no_try_and_no_plan_leaves_the_limits(method):
    tried = []

    def rollout(plans):
        tried.append(plans)
        return -np.abs(plans).sum(axis=(1, 2))

    result = method(
        rollout, np.zeros((5, 2)), np.random.default_rng(2), spread=[3.0, 9.0], limit=[0.5, 2.0]
    )
    for plans in (*tried, result.plan[None]):
        assert (np.abs(plans) <= [0.5, 2.0]).all()
    assert np.abs(tried[0][:, :, 1]).max() == 2.0


def test_cem_takes_the_first_of_equal_tries():
    """Counts of successes tie often. An unstable sort picks other elites on another CPU."""
    observed = []

    def rollout(tries):
        observed.append(tries.copy())
        return np.arange(len(tries)) % 4 / 4.0

    result = cem(
        rollout, np.zeros((3, 2)), np.random.default_rng(1), samples=64, rounds=1, elites=8
    )
    assert np.array_equal(result.plan, observed[0][:32:4].mean(axis=0))


def test_cem_finds_the_lowest_point_and_predictive_never_gets_worse():
    goal = np.random.default_rng(0).normal(size=(3, 2))

    def rollout(plans):
        return ((plans - goal) ** 2).sum(axis=(1, 2))

    result = cem(rollout, np.zeros((3, 2)), np.random.default_rng(1), samples=300, rounds=12)
    assert np.abs(result.plan - goal).max() < 1e-2
    plan, costs, rng = np.zeros((3, 2)), [], np.random.default_rng(1)
    for _ in range(60):
        plan, cost, _ = predictive(rollout, plan, rng, spread=0.3)
        costs.append(cost)
        assert cost == rollout(plan[None])[0]
    assert (np.diff(costs) <= 0.0).all() and costs[-1] < 0.1 * costs[0]


def test_a_weak_motor_swings_a_pendulum_up():
    """A third of the torque of gravity: it has to swing back first. theta is 0 upright."""
    dt, limit = 0.1, 9.81 / 3.0

    def move(q, v, u):
        for _ in range(2):
            v = v + 0.5 * dt * (9.81 * np.sin(q) + u)
            q = q + 0.5 * dt * v
        return q, v

    def success(samples, horizon, seed):
        rng, plan, q, v = np.random.default_rng(seed), np.zeros((horizon, 1)), np.pi, 0.0
        for _ in range(70):

            def rollout(plans, q=q, v=v):
                a, b, cost = np.full(len(plans), q), np.full(len(plans), v), np.zeros(len(plans))
                for k in range(horizon):
                    a, b = move(a, b, plans[:, k, 0])
                    cost += 1.0 - np.cos(a) + 0.02 * b**2
                return cost

            result = mppi(
                rollout, plan, rng, samples=samples, spread=limit, temperature=0.5, limit=limit
            )
            q, v = move(q, v, result.plan[0, 0])
            plan = shifted(result.plan)
        return abs(np.sin(q)) < 0.3 and np.cos(q) > 0.0 and abs(v) < 1.0

    assert all(success(256, 20, seed) for seed in range(3))
    # Who looks three samples ahead never lets it swing back; who tries twice finds nothing.
    assert not any(success(256, 3, seed) for seed in range(3))
    assert not all(success(2, 20, seed) for seed in range(3))


def cheap(plans):
    return np.zeros(len(plans))


RNG, PLAN = np.random.default_rng(0), np.zeros((3, 1))
BAD = {
    "plan": lambda: mppi(cheap, [0.0], RNG),
    "spread": lambda: mppi(cheap, PLAN, RNG, spread=0.0),
    "temperature": lambda: mppi(cheap, PLAN, RNG, temperature=0.0),
    "samples": lambda: mppi(cheap, PLAN, RNG, samples=1),
    "limit": lambda: mppi(cheap, PLAN, RNG, limit=-1.0),
    "elites": lambda: cem(cheap, PLAN, RNG, elites=65),
    "rounds": lambda: cem(cheap, PLAN, RNG, rounds=0),
    r"rollout\(plans\)": lambda: predictive(lambda p: np.zeros(3), PLAN, RNG),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(name):
    with pytest.raises(ValueError, match=rf"^{name}[ .\[].*must be"):
        BAD[name]()
