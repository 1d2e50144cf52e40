"""What the charts of the structures around PID and of the adaptive law show, with fewer points."""

import numpy as np
import pytest

from course.charts import build
from course.charts.control import structures as chart


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
