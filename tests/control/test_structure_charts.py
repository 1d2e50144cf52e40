"""What the charts of the structures around PID and of the adaptive law show, with fewer points."""

from functools import partial

import numpy as np
import pytest

from course.charts import build
from course.charts.control import structures as chart
from course.control.adaptive import adaptation_limit
from course.control.sampled import growth, held, joint_system


@pytest.mark.prove
def test_the_feed_forward_leaves_a_tenth_and_the_predictor_goes_furthest() -> None:
    tracking, load = build("loop_structures", points=8)
    # The same loop, with 90 % of the torque known beforehand.
    plain, helped = tracking["PD"], tracking["PD + feed-forward"]
    assert helped.x == plain.x
    np.testing.assert_allclose(helped.y, 0.1 * np.array(plain.y), rtol=0.01)
    assert max(tracking["predictor + feed-forward"].x) > max(tracking["observer"].x)
    # The further a predictor predicts, the more the unknown torque misleads it.
    level = [
        np.exp(np.interp(np.log(0.3), np.log(one.x), np.log(one.y)))
        for one in (helped, tracking["predictor, half"], tracking["predictor + feed-forward"])
    ]
    assert level == sorted(level)
    # At equal noise the observer rejects a load better than PD, and the predictor no better.
    noise = 0.5

    def at(label: str) -> float:
        one = load[label]
        return float(np.exp(np.interp(np.log(noise), np.log(one.x), np.log(one.y))))

    assert at("observer with delay") < 0.5 * at("PD")
    assert at("predictor, half") > at("PD")
    plain = next(one for one in load.series if one.label == "predictor")
    assert np.exp(np.interp(np.log(noise), np.log(plain.x), np.log(plain.y))) > at("PD")


@pytest.mark.slow
def test_a_faster_predictor_stands_less_and_a_high_notch_harms() -> None:
    predictor, notch = build("structure_limits", points=5)
    longest, shortest = predictor["longest"].y, predictor["shortest"].y
    assert (np.diff(longest) < 0.0).all() or longest[0] == 3.0
    assert longest[-1] - shortest[-1] < 0.1 * (longest[0] - shortest[0])
    shares, gains = np.array(notch["with"].x), np.array(notch["with"].y)
    plain = chart.elastic_limit(None)
    assert (gains[shares < 1.0] > plain).all()
    assert (gains[(shares > 1.1) & (shares < 2.0)] < plain).all()


@pytest.mark.prove
def test_each_cure_bounds_or_slows_the_drift() -> None:
    drift, price = build("adaptive_cures", seconds=12.0, seeds=10)
    uncured = drift["none"].y
    for name in ("dead zone", "projection", "leakage"):
        assert max(drift[name].y) < 0.2 * max(uncured)
    assert max(drift["normalisation"].y) < 0.3 * max(uncured)
    # Early the drift is the predicted one.
    at = np.array(drift["none"].x)
    early = at < 2.0
    assert drift["none"].theory is not None
    known = drift["none"].theory(at[early])
    assert np.array(uncured)[early] == pytest.approx(known, rel=0.15)
    assert price["projection"].y[0] < price["dead zone"].y[0]


@pytest.mark.prove
@pytest.mark.slow
@pytest.mark.parametrize(("dt", "regressor"), [(1e-3, 1.0), (5e-3, 3.0)])
def test_an_adaptive_law_settles_below_the_computed_limit_and_grows_above(dt, regressor) -> None:
    limit = adaptation_limit(chart.DAMP, chart.B, dt)
    for share, settles in ((0.98, True), (1.02, False)):
        size = np.abs(chart.adapting_speed(share * limit, regressor, dt))
        assert (size[-500:].max() < size[:500].max()) == settles
    run = partial(chart.adapting_speed, regressor=regressor, dt=dt)
    assert chart.largest_adaptation(run, limit) == pytest.approx(limit, rel=0.005)


def differenced(product: float, dt: float) -> float:
    """Return the growth per sample of the whole joint that adapts its load, by its matrix."""
    plant = held(*joint_system(chart.J, chart.B), dt)
    # The state is (angle, rate, last angle, estimated torque); the set-point is 0.
    error, rate = np.array([-1.0, 0.0, 0.0, 0.0]), np.array([-1.0, 0.0, 1.0, 0.0]) / dt
    s = rate + chart.SLOPE * error
    torque = chart.SLOPE * (chart.J * rate + chart.B * error) + chart.DAMP * s
    torque[3] += 1.0
    matrix = np.zeros((4, 4))
    matrix[:2, :2] = plant.transition
    matrix[:2] += np.outer(np.ravel(plant.now), torque)
    matrix[2, 0] = 1.0
    matrix[3] = dt * product * s
    matrix[3, 3] += 1.0
    return growth(matrix)


@pytest.mark.prove
@pytest.mark.slow
def test_with_differences_the_limit_of_adaptation_is_that_of_their_loop() -> None:
    dt = 5e-3
    limit = chart.largest_adaptation(
        partial(chart.adapting_joint, dt=dt), adaptation_limit(chart.DAMP, chart.B, dt)
    )
    assert differenced(0.98 * limit, dt) < 1.0 < differenced(1.02 * limit, dt)


@pytest.mark.prove
def test_the_chart_of_adaptation_shows_both_sides_of_its_limit() -> None:
    sides, limits = build("adaptation_limits", points=2)
    above, below = (np.abs(one.y) for one in sides.series)
    assert below[-100:].max() < 0.5 < 2.0 < above[-100:].max()
    for one in limits.series[:2]:
        np.testing.assert_allclose(one.y, limits.series[0].expected, rtol=0.005)
    assert (np.array(limits.series[2].y) < 0.8 * limits.series[0].expected).all()
