"""What the charts of chapter 9 say is in what they measured, built small or read from the store."""

import numpy as np
import pytest
from scipy.stats import norm

from course import charts
from course.charts.learning import reinforced, two_ways
from course.learning import Mixture, accumulated, evaluate
from course.vector_env import PointReachVector
from course.vector_env.point import plan
from tests.learning import needs_stable_baselines3


@pytest.mark.prove
def test_many_ways_ranks_them_upside_down_and_keeps_the_shares() -> None:
    error, priced, remaining = charts.build("many_ways", n=300, held=200, repeats=1)
    mean, mixture, nearest = (error[name] for name in ("mean", "mixture", "nearest"))
    assert mean.x[0] < mixture.x[0] and mean.x[0] < nearest.x[0]
    assert mean.y[0] < 0.05 and mixture.y[0] > 0.8 and nearest.y[0] == 1.0
    for name in ("flow", "diffusion"):
        assert np.all(np.diff(error[name].x) > 0.0) and np.all(np.diff(error[name].y) > 0.0)
        assert priced[name].y == error[name].y
    assert (
        remaining.series[0].y[0] == "demonstrations"
        and remaining.spans[0][1] < 0.48 < remaining.spans[0][2]
    )


@pytest.mark.prove
def test_errors_compound_as_the_formulas_say() -> None:
    cost, law, growth, _ = charts.build(
        "compounding", n=20_000, horizons=(5, 20, 80), points=16, circle=10
    )
    for series in cost.series:
        assert np.allclose(series.y, series.expected, rtol=0.1)
    assert law.grid is not None
    inside = law.grid.within()
    assert np.all(inside <= (np.outer(law.grid.y, law.grid.x) < 0.45))
    assert np.all(inside >= (np.outer(law.grid.y, law.grid.x) < 0.2))
    for series, a in zip(growth.series, (0.9, 1.0, 1.05), strict=True):
        assert np.allclose(series.expected, accumulated(a, 1.0, 20)[[4, 19]], rtol=1e-9)


@pytest.mark.prove
def test_samplers_have_their_orders_and_the_nets_their_floor() -> None:
    exact, driven = charts.build("samplers", n=1000, runs=100, fit=300, counts=(1, 2, 10, 40, 160))
    for label, order in (("Euler", 1.0), ("DDIM", 1.0), ("Heun", 2.0)):
        y = exact[label].y
        assert np.log(y[-2] / y[-1]) / np.log(4.0) == pytest.approx(order, abs=0.3)
    assert exact["Euler"].y[0] == pytest.approx(exact.lines[0][1], rel=1e-6)
    assert exact["flow net"].y[-1] > 3.0 * exact["Heun"].y[-1]
    assert driven["flow, Euler"].y[0] < 0.5 < driven["flow, Euler"].y[-1]
    mixture = Mixture(np.array([0.3, 0.7]), np.array([[-1.0], [2.0]]), np.array([0.2, 0.5]))
    x = two_ways.quantiles(mixture, np.array([0.1, 0.6]))
    below = 0.3 * norm.cdf((x + 1.0) / 0.2) + 0.7 * norm.cdf((x - 2.0) / 0.5)
    assert np.allclose(below, [0.1, 0.6])


@pytest.mark.prove
@pytest.mark.slow
def test_looking_often_jitters_and_looking_rarely_drifts() -> None:
    _, cures, turns, drift = charts.build(
        "commit_or_react", n=300, fit=2, noises=(0.0, 0.05), executed=(1, 2, 8)
    )
    y = turns.series[0].y
    assert y[0] > y[1] > y[2] == 0.0
    measured = drift["simulated"]
    assert np.allclose(measured.y, measured.expected, rtol=0.1)
    assert cures["2 executed"].y[1] > max(cures["8 executed"].y[1], 0.2)


def test_learners_are_judged_by_the_optimum() -> None:
    tasks: list[dict] = [{}, {"offset": 10.0}, {"unit": 3.0, "radius": 0.1}]
    for task in tasks:

        def perfect(observed: np.ndarray, task: dict = task) -> np.ndarray:
            paths = (observed - task.get("offset", 0.0)) / task.get("unit", 1.0)
            return plan(paths, radius=task.get("radius", 0.05))[1]

        assert reinforced.test(perfect, **task) == pytest.approx(1.0, abs=1e-6)
    result = reinforced.searched(0, 2)
    again = reinforced.searched(0, 1)
    assert result.scores[0] == again.scores[0] and result.steps[0] == again.steps[0]


@pytest.mark.prove
@pytest.mark.optional
def test_learners_are_judged_by_the_optimum_and_beside_the_library() -> None:
    needs_stable_baselines3()
    by_steps, by_time = charts.build("learning_curves", steps=4096, points=2, seeds=3, rounds=2)
    for label in ("ours, 16", "ours, 64", "Stable-Baselines3"):
        assert list(by_steps[label].x) == [2048, 4096]
        assert np.all(np.diff(by_time[label].x) > 0.0)


@pytest.mark.prove
@pytest.mark.optional
def test_sac_learns_from_its_replay_buffer() -> None:
    """A small version of the chart; the score of random actions is below 0.1."""
    needs_stable_baselines3()
    (panel,) = charts.build(
        "off_policy", seeds=3, steps=3072, small=1024, large=2048, every=1024, hidden=(32,)
    )
    assert list(panel["SAC"].x) == [1024, 2048, 3072]
    assert list(panel["PPO, batches of 512"].x) == [1024]
    assert list(panel["PPO, batches of 2,048"].x) == [2048]
    for series in panel.series:
        assert all(0.0 <= y <= 1.0 + 1e-9 for y in series.y)
        assert np.all(np.array(series.low) <= series.y) and np.all(
            series.y <= np.array(series.high)
        )
    assert panel["SAC"].y[-1] > panel["PPO, batches of 2,048"].y[-1]


def test_the_stored_sac_is_far_ahead_of_ppo_at_equal_steps() -> None:
    (panel,) = charts.stored("off_policy")
    sac = panel["SAC"]
    for name in ("PPO, batches of 512", "PPO, batches of 2,048"):
        at_equal_steps = int(np.searchsorted(panel[name].x, sac.x[-1]))  # the first with as many
        assert sac.low[-1] > panel[name].high[at_equal_steps] + 0.1
    slow = panel["PPO, batches of 2,048"]
    assert slow.y[-1] > sac.y[-1]  # it does learn the task, with more steps
    caught_up = slow.x[int(np.argmax(np.array(slow.y) >= sac.y[-1]))]
    assert caught_up > 4 * sac.x[-1]


def test_a_first_policy_meets_the_disc_as_often_as_predicted() -> None:
    rng = np.random.default_rng(5)
    for radius in (0.05, 0.2):
        envs = PointReachVector(2000, "sparse", autoreset_mode="SameStep", radius=radius)
        ran = evaluate(lambda observed: rng.standard_normal((len(observed), 2)), envs, 3)
        assert ran.success.mean() == pytest.approx(reinforced.stumbles(radius), rel=0.5)


def test_the_stored_learners_show_what_each_detail_and_reward_does() -> None:
    usual, other = (
        dict(zip(p.series[0].y, p.series[0].x, strict=True))
        for p in charts.stored("details_that_matter")
    )
    whole, unscaled = usual.pop("complete PPO"), usual.pop("observations not normalised")
    broken = {"lambda 0", "one epoch", "4 hidden units", "discount 0.9"}
    assert {name for name, share in usual.items() if share < 0.9 * whole} == broken
    assert all(usual[name] < 0.85 * whole for name in broken) and 0.75 < unscaled / whole < 0.9
    first = charts.stored("details_that_matter")[0].series[0]
    assert (
        0.45
        < dict(zip(first.y, first.low, strict=True))["observations not normalised"] / whole
        < 0.6
    )
    rows = list(other)
    for whole, less in zip(rows[::2], rows[1::2], strict=True):
        assert other[less] < 0.85 * other[whole]
    curves, chance = charts.stored("rewards")
    assert curves["potential"].low[-1] > max(s.high[-1] for s in curves.series[1:])
    met = chance["random"]
    assert np.allclose(met.y, [reinforced.stumbles(r) for r in met.x], rtol=0.25)
