"""What the chart of the vector environments says, on smaller settings."""

import time
from functools import partial

import numpy as np
import pytest

from course.charts import build, stored
from course.charts import vector_env as chart
from course.measure import timing
from course.measure.timing import Timing
from course.vector_env import ArmReach, ArmReachVector, training
from tests.vector_env.test_vector_env import identical

pytestmark = pytest.mark.slow


@pytest.mark.prove
def test_batches_beat_gymnasiums_loop() -> None:
    """Aims are 5 and 100 at N = 256 on the clock; these are ratios of processor time, with room."""
    loop = chart.CONTENDERS[chart.SYNC]
    for name, least in ((chart.BATCH, 1.5), (chart.CLOSED, 20.0)):
        ratio = chart.paired_ratio(
            loop, chart.CONTENDERS[name], 64, 5, sample=0.005, clock=time.process_time
        )
        assert ratio.low <= ratio.median <= ratio.high and ratio.median > least


@pytest.mark.prove
def test_a_ratio_is_the_median_of_its_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the machine slows from pair to pair, both samples of a pair are slowed alike."""
    slowed = iter([1.0, 5.0, 2.0, 9.0, 3.0])

    def timed(samplers, **settings):
        factor = next(slowed)
        # The denominator, the fast contender, comes first.
        return [Timing(x * factor, x * factor, x * factor, x * factor) for x in (2.0, 8.0)]

    monkeypatch.setattr(timing, "interleaved", timed)
    contender = chart.CONTENDERS[chart.CLOSED]
    assert chart.paired_ratio(contender, contender, 1, 5) == (4.0, 4.0, 4.0)
    assert str(chart.Ratio(123.4, 118.0, 131.0)) == "120 times (quartiles 120 to 130)"


def test_runge_kutta_meets_the_tolerance_with_one_step_and_euler_needs_many() -> None:
    def error(name, substeps):
        return chart.tip_error(partial(chart.ACCURACY[name][1], substeps=substeps), 8)

    closed, rk4, euler = chart.ACCURACY
    coarse = error(closed, 1)
    assert coarse < 0.1 * chart.TOLERANCE
    assert error(rk4, 1) == pytest.approx(coarse, rel=1e-6)
    assert error(closed, 2) == pytest.approx(coarse / 16, rel=0.3)
    first, second = (error(euler, s) for s in (8, 16))
    assert first / second == pytest.approx(2.0, abs=0.3) and second > chart.TOLERANCE


@pytest.mark.prove
def test_the_chart_has_every_contender_at_every_size_it_is_asked_for() -> None:
    speed, accuracy, cost = build(
        "vector_env", sizes=(1, 2), substeps=(1, 2), busy=(0, 4000), repeats=1
    )
    assert [s.label for s in speed.series] == [*chart.CONTENDERS]
    assert all(s.x == [1, 2] and min(s.low) > 0.0 for s in speed.series)
    closed, rk4, _ = accuracy.series
    assert closed.tags == ["1", "2"] and closed.y == pytest.approx(rk4.y, rel=1e-6)
    assert [len(s.y) for s in cost.series] == [2, 2, 2]
    # On a machine without a free core the curves need not cross, and the panel says so.
    (note,) = cost.notes
    if not cost.lines:
        assert "did not meet" in note
        return
    # The crossing lies between the costs that were measured, and the note names it.
    ((_, measured, _),) = cost.lines
    assert cost.series[0].x[0] <= measured <= cost.series[0].x[-1] and f"{measured:.0f} us" in note


def test_the_truth_is_converged() -> None:
    assert chart.tip_error(lambda n: chart.ArmReachVector(n, substeps=32)) < 1e-9


def test_where_two_curves_cross() -> None:
    cost = np.geomspace(1e-6, 1e-3, 13)
    loop, processes = 8 * cost, 4 * cost + 2e-4
    assert chart.crossing(cost, loop, processes) == pytest.approx(5e-5, rel=0.05)
    assert chart.crossing(cost, loop, loop * 2.0) is None
    assert chart.predicted_crossing(0.0, 2e-4, 8, 2, 0.0) == pytest.approx(5e-5)
    assert chart.predicted_crossing(2e-4, 1e-4, 8, 2, 1e-6) == 1e-6


@pytest.mark.prove
def test_processes_lose_where_an_environment_costs_nothing() -> None:
    result = chart.cost_of_processes((0,), n=4, repeats=5)
    (cost,), (loop,), (processes,) = (result[name] for name in ("cost", "loop", "processes"))
    assert processes > loop > cost
    assert chart.predicted_crossing(loop, processes, 4, 2, cost) > cost


def test_the_prediction_is_as_good_as_its_time_of_waking() -> None:
    """With one time of waking for all costs all predict what is measured; a longer one predicts
    more, and what is measured lies between."""
    cost = np.geomspace(1e-6, 1e-3, 25)
    data = {"cost": cost, "loop": 8 * cost, "processes": 4 * cost + 2e-4}
    met = chart.crossing(data["cost"], data["loop"], data["processes"])
    assert chart.predicted_by_size(data, 8, 2) == pytest.approx(met, rel=0.01)
    data["processes"] = 4 * cost + np.linspace(1e-4, 6e-4, 25)
    met = chart.crossing(cost, data["loop"], data["processes"])
    each = chart.predicted_by_size(data, 8, 2)
    assert met is not None and 1.3 * each.min() < met < each.max() / 1.3


@pytest.mark.prove
def test_a_policy_learns_to_reach_within_seconds() -> None:
    """Judged on targets of its own; and the learning curve says so."""
    collected, reached = build("learning_curve_reach", seeds=3, generations=14)
    (score,), (share,) = collected.series, reached.series
    assert score.y[0] < -70.0 and score.y[-1] > score.y[0] + 30.0
    assert share.y[0] < 0.02 and share.y[-1] > 0.3
    assert np.all(np.array(score.low) <= score.y) and np.all(score.y <= np.array(score.high))
    by_hand = [panel.lines[0][1] for panel in (collected, reached)]
    assert -30.0 < by_hand[0] < -20.0 and 0.6 < by_hand[1] < 0.8
    again = training.train(1, 2)
    identical(training.train(1, 2), again)
    assert np.any(training.train(2, 2)[0][1:] != again[0][1:])


def test_a_policys_episode_is_a_single_environments() -> None:
    """What it collects until the episode ends, and not what the next one gives."""
    law = chart.BY_HAND
    collected, reached = training.play(np.concatenate([law, 0.0 * law]), 40, 5)
    for policy, total, share in zip((law[0], 0.0 * law[0]), collected, reached, strict=True):
        sums: list[float] = []
        ends: list[bool] = []
        for seed in range(40, 45):
            env, rewards, over = ArmReach(), 0.0, False
            row, _ = env.reset(seed=seed)
            while not over:
                expected = policy @ training.features(row[None])[0]
                row, reward, done, late, _ = env.step(np.clip(expected, -1.0, 1.0))
                rewards, over = rewards + reward, done or late
            sums.append(rewards)
            ends.append(done)
        assert total == pytest.approx(np.mean(sums), abs=1e-9) and share == np.mean(ends)
    assert reached[0] > reached[1]


def test_the_arm_that_is_copied_is_the_environment_and_is_judged_as_it_is() -> None:
    arm, envs, rng = chart.Arm(), ArmReachVector(20), np.random.default_rng(0)
    observed, _ = envs.reset(seed=3)
    for _ in range(20):
        actions = rng.uniform(-1.5, 1.5, (20, 2)).astype(np.float32)
        after, _, over, *_ = envs.step(actions)
        assert (
            np.allclose(arm.step(observed, actions.astype(float), rng), after, atol=1e-12)
            or over.any()
        )
        observed = after
    share = training.play(chart.BY_HAND, 0, 400)[1][0]
    assert arm.reached(arm.expert, 400) == pytest.approx(share, abs=0.1)
    copied, rewarded = stored("arm_learned")
    last = {series.label: series.y[-1] for series in copied.series}
    law = copied.lines[0][1]
    assert (
        last["cloned"] < last["cloned, wider network, longer training"] < law
        and last["DAgger"] < law
    )
    assert rewarded.series[0].y[-1] < min(last.values())
