"""Evaluation against the exact optimum, the bias of the first to finish, bands against SciPy."""

import numpy as np
import pytest
from scipy import stats

from course.learning import Settings, band, evaluate, first_finished
from course.oracles import sb3
from course.vector_env import PointReachVector, VectorizedEnv
from course.vector_env.point import PointReach, optimum, plan
from tests.learning import needs_stable_baselines3

MODES = ("SameStep", "NextStep", "Disabled")


def best(observed):
    return plan(observed)[1].astype(np.float32)


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_the_best_policy_gets_the_optimum_in_every_mode(mode):
    envs = PointReachVector(60, autoreset_mode=mode)
    starts = envs.reset(seed=7)[0]
    got = evaluate(best, envs, 7)
    np.testing.assert_allclose(got.returns, optimum(starts), rtol=1e-12)
    np.testing.assert_array_equal(got.steps, plan(starts)[0])
    assert got.success.all()
    loop = VectorizedEnv(PointReach, 60, autoreset_mode=mode)
    np.testing.assert_array_equal(evaluate(best, loop, 7).returns, got.returns)
    np.testing.assert_array_equal(evaluate(best, envs, [7 + i for i in range(60)]).steps, got.steps)
    still = evaluate(lambda observed: np.zeros((60, 2), np.float32), envs, 7, discount=1.0)
    assert not still.success.any() and np.all(still.steps == 100) and not still.returns.any()


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_the_first_to_finish_are_the_quick_ones(mode):
    """Goals to the left are not tried for; an episode that fails takes three times as long."""

    def half(observed):
        return np.where(observed[:, :1] > -0.3, best(observed), 0.0).astype(np.float32)

    n = 200
    true = evaluate(half, PointReachVector(n, autoreset_mode=mode), 0)
    report = first_finished(half, PointReachVector(n, autoreset_mode=mode), n, 0)
    assert len(report.returns) == n
    share = true.success.mean()
    assert 0.4 < share < 0.85
    # In the time in which the slow ones are still going, places of quick ones are taken anew.
    assert report.success.mean() > share + 0.1
    # Every episode has its own steps only, not the one that resets.
    envs = PointReachVector(8, max_steps=10, autoreset_mode=mode)
    still = first_finished(lambda observed: np.zeros((8, 2), np.float32), envs, 40, 0)
    assert np.all(still.steps == 10)


def test_a_band_is_the_middle_half_and_holds_the_truth_as_often_as_it_says():
    rng = np.random.default_rng(0)
    table = rng.normal(size=(8, 3))
    np.testing.assert_allclose(band(table).middle, stats.trim_mean(table, 0.25), rtol=1e-12)
    held = 0
    for k in range(200):
        got = band(rng.normal(2.0, 1.0, 20), k, draws=400)
        assert got.low <= got.middle <= got.high
        held += int(got.low <= 2.0 <= got.high)
    assert stats.binomtest(held, 200, 0.92).pvalue > 1e-3
    # One stuck seed of ten moves it little.
    stuck = np.append(np.full(9, 0.9), 0.0)
    assert band(stuck).middle == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("call", "report"),
    [
        (lambda envs: evaluate(lambda s: s[:, :1], envs), r"policy\(observations\).shape must be"),
        (lambda envs: evaluate(lambda s: s[:, :2] * np.nan, envs), "action of environment 0 at st"),
        (lambda envs: evaluate(best, envs, discount=1.5), r"discount must be .*, got 1.5"),
        (lambda envs: first_finished(best, envs, 0), r"episodes must be .*, got 0"),
        (lambda envs: band([1.0, 2.0]), r"scores.shape must be .*, got \(2,\)"),
        (lambda envs: band([1.0, np.nan, 2.0]), r"scores\[1\] must be .*, got nan"),
    ],
)
def test_bad_input(call, report):
    with pytest.raises(ValueError, match=report):
        call(PointReachVector(3))


@pytest.mark.prove
@pytest.mark.optional
def test_settings_are_those_of_the_library():
    """The curve of Stable-Baselines3 starts where ours does and climbs as ours does."""
    needs_stable_baselines3()
    settings = Settings(rate=3e-3, epochs=5, hidden=(16, 16))
    judge = PointReachVector(128)
    mean = optimum(judge.reset(seed=10**6)[0]).mean()
    envs = PointReachVector(64, "potential", autoreset_mode="SameStep")
    curve = sb3.ppo(
        envs,
        settings,
        lambda policy: evaluate(policy, judge, 10**6).returns.mean() / mean,
        steps=61_440,
        seed=0,
        every=10,
    )
    assert curve.steps.tolist() == [20_480, 40_960, 61_440]
    assert np.all(np.diff(curve.seconds) > 0.0)
    assert curve.scores[0] < 0.4 and 0.5 < curve.scores[-1] <= 1.0
    with pytest.raises(ValueError, match=r"shared must be .*, got False"):
        sb3.ppo(envs, Settings(shared=False), lambda policy: 0.0, steps=1, seed=0)
