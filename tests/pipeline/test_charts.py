"""What the charts of chapter 11 say is in what they measured: their stored series are read."""

import numpy as np
import pytest

from course import charts
from course.charts.pipeline import swaps
from course.charts.pipeline.parts import NAMES
from course.pipeline import Scenario, Settings, Stages, move, run_many, theory
from course.pipeline.blame import FAULTS, contracts_alone


def test_means_add_up_and_a_share_lies_between_first_and_last():
    vectors, every, owned = charts.stored("error_budget")
    tip = [vectors["move"].x[-1], vectors["move"].y[-1]]
    whole = [vectors["together"].x[0], vectors["together"].y[0]]
    assert np.hypot(*np.subtract(tip, whole)) < 1.0
    for series in every.series:
        np.testing.assert_allclose(series.y, series.x, rtol=0.12, atol=0.1)
    assert owned["perception"].low[1] > owned["age"].high[1]
    assert owned["control"].x[2] < 0.0 < owned["control"].low[1]
    for series in owned.series:
        assert min(series.x[0], series.x[2]) - 0.1 <= series.x[1] <= max(series.x) + 0.1


def test_every_library_is_within_the_paired_band():
    for panel in charts.stored("swap_matrix")[:2]:
        assert len(panel.series) == 7
        # The control is our own motion through Python: the same numbers, so no difference at all.
        assert list(panel.series[-1].x) == [0.0]
        for series in panel.series:
            assert series.low[0] <= 0.0 <= series.high[0] or abs(series.x[0]) < 1e-3, series.label


def test_pictures_and_their_two_numbers_end_alike():
    measured, stated = charts.stored("two_numbers")
    for path in ("along", "across"):
        np.testing.assert_allclose(measured[path].y, measured[path].x, atol=0.2)
        widths = [np.ptp(stated[path].x), np.ptp(stated[path].y)]
        assert widths[0] > 1.3 * widths[1]


@pytest.mark.prove
def test_the_arms_own_limit_is_that_of_theory_and_energy_tells_before_the_tip():
    _, limits, answer, energy = charts.stored("step_map")
    for series in limits.series:
        assert len(series.y) == 5 and np.all(np.diff(series.y) < 0.0)
    small = charts.build("step_map", points=3, tested=2, seeds=1)[1]
    for series in small.series:
        np.testing.assert_allclose(series.y, series.expected, rtol=0.005)
    for series in energy.series:
        won, x = np.array(series.y), np.array(series.x)
        assert won[x < 0.95].max() < 1e-4 and won[x > 1.2].min() > 0.003
        assert np.array(answer[series.label].y)[(x > 1.0) & (x < 1.5)].min() > 0.8


@pytest.mark.slow
def test_the_gain_of_looking_again():
    small = charts.build("look_and_move", at_most=8, chains=100, looks=600)
    measured = np.array(small[0]["measured"].y)
    np.testing.assert_allclose(measured, [theory.look_limit(k) for k in range(9)], rtol=2e-3)
    for series in small[1].series:
        np.testing.assert_allclose(series.y, series.expected, rtol=0.12)


def test_without_the_true_target_nobody_finds_what_perception_did():
    """What a robot's own record holds names a stage that broke its word, and no wrong place."""
    named, *_ = charts.stored("whose_fault")
    series = named["without the true target"]
    blind = dict(zip(map(str, series.y), series.x, strict=True))
    for fault in FAULTS:
        assert blind[fault.name] == (0.0 if fault.stage == "perceive" else 1.0)
    text = charts.read("whose_fault")
    assert "contracts alone: 200 of 200" in text and "true target: 140 of 200" in text
    few = contracts_alone(2, FAULTS[:1] + FAULTS[6:7])
    assert few.tolist() == [[2, 2], [0, 2]]


def test_contracts_first_are_right_more_often_and_need_fewer_replays():
    named, replays, first, _ = charts.stored("whose_fault")
    assert list(first.rows) == [f.name for f in FAULTS]
    right = [first.tick_names[int(column)] for column in first["right"].x]
    assert right == [NAMES[f.stage] for f in FAULTS] and set(first["right"].tags) == {"20"}
    assert not len(first["wrong"].x) and np.mean(named["last error"].x) < 0.6
    assert np.mean(replays["contracts first"].x) < 0.7 * np.mean(replays["replays only"].x)


def test_what_a_filter_and_a_step_of_the_planner_do():
    success, plans, _, late = charts.stored("noise_and_filter")
    at = list(success["with the filter"].x).index(50.0)
    assert success["with the filter"].low[at] > 0.8 > 0.3 > success["without"].y[at]
    assert plans["without"].y[at] > 30.0 * plans["with the filter"].y[at]
    dear, cheap = late["20 us"], late["1 us"]
    assert dear.y[-1] > dear.y[0] and max(cheap.y) < max(dear.y)


def test_the_narrow_proposal_deceives_and_the_wide_one_does_not():
    ranks, price, alarm, width = charts.build("rare_failure", repeats=40, plainly=5)
    deviation = {name: np.array(alarm[name].x) for name in ("narrow proposal", "width at least 1")}
    assert (
        np.mean(deviation["narrow proposal"] < -3.0)
        > 0.05
        > np.mean(deviation["width at least 1"] < -3.0)
    )
    assert price["narrow proposal, true"].y[0] > 2.0 * price["narrow proposal, reported"].y[0]
    assert price["width at least 1, true"].y[0] < 1.5 * price["width at least 1, reported"].y[0]
    assert np.array(width["narrow proposal"].x).min() < 0.9 and len(ranks.series) == 2


@pytest.mark.prove
def test_our_own_motion_through_python_is_beside_the_library():
    """The same function, called as a library is: the same motion, and the price of the call."""
    motion, times = charts.build("pipeline_speed", steps=(4e-3, 2e-3), seeds=1, widths=(160,))
    (ours, called, theirs) = motion.series
    assert (ours.label, called.label, theirs.label) == ("ours", swaps.PYTHON, "MuJoCo moves")
    np.testing.assert_allclose(called.y, ours.y, rtol=1e-9)
    assert "our motion through Python" in times.series[0].y
    pair = [Stages(move=step) for step in (move, swaps.through_python)]
    one, other = (run_many(Scenario(), Settings(), [3], stages)[0] for stages in pair)
    np.testing.assert_allclose(one.log, other.log, atol=1e-10)


def test_both_physics_meet_and_the_calls_from_python_take_the_time():
    """MuJoCo's motion takes about as long as our own does, once both are called from Python."""
    motion, times = charts.stored("pipeline_speed")
    for series in motion.series:
        assert np.all(np.diff(series.y) < 0.0)
    cost = {series.label: np.array(series.x) for series in motion.series}
    assert np.all(cost[swaps.PYTHON] > 10.0 * cost["ours"])
    ratio = cost["MuJoCo moves"] / cost[swaps.PYTHON]
    assert np.all((0.5 < ratio) & (ratio < 2.0))
    # One run each, as ratios to the compiled one: the last row is the control of all others.
    swapped = charts.stored("swap_matrix")[2]
    assert 0.5 < swapped["MuJoCo moves"].x[0] / swapped.series[-1].x[0] < 2.0
    (bars,) = times.series
    assert bars.x[0] > 100.0
    # "About a hundred to a thousand times as much", says the page of runs with rendered images.
    rendered = bars.x[0] / np.array(bars.x[3:])
    assert 100.0 < rendered.min() < 200.0 and 700.0 < rendered.max() < 1500.0
