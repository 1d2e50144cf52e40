"""What the charts of one joint's limits show, on smaller sizes: theory beside the measurement."""

import math

import numpy as np
import pytest

from course.charts import build
from course.charts.control import limits


@pytest.mark.slow
def test_delay_and_hold_are_theorys_and_the_simulator_hides_the_hold():
    late, steps = build("delay_limit", delays=5, steps=(1, 10))
    curve = late["the loop's matrix"]
    np.testing.assert_allclose(curve.y, curve.expected, rtol=1e-4)
    read, matrix = steps.series
    np.testing.assert_allclose(read.y, matrix.y, rtol=1e-5)
    assert read.y[0] > 1000 * steps.lines[0][1] and read.y[1] == pytest.approx(1111, rel=1e-3)


@pytest.mark.prove
def test_the_triangles_are_the_closed_forms_and_the_servo_has_others():
    loops, servo = build("pd_triangles", points=9)
    for series in loops.series[:3]:
        known = np.isfinite(series.y)
        result, theory = np.array(series.y)[known], series.expected[known]
        np.testing.assert_allclose(result, theory, rtol=1e-4, atol=1e-6)
        assert np.all(series.expected[~known] < 1e-6) and np.max(result) > 0.1
    kv = np.array(servo["MuJoCo Euler"].x)
    np.testing.assert_allclose(servo["MuJoCo Euler"].y, 4 - 2 * kv, atol=1e-4)
    np.testing.assert_allclose(servo["MuJoCo implicitfast"].y, 4 + 2 * kv, atol=1e-4)
    assert np.all(np.isinf(servo["MuJoCo discrete"].y))


def test_a_rate_pays_with_lag_or_with_noise():
    (panel,) = build("rate_estimates", samples=4000)
    difference, filtered, observer = panel.series
    assert difference.y[0] > max(filtered.y) > max(observer.y)
    for series in (filtered, observer):
        assert np.all(np.diff(series.x) > 0) and np.all(np.diff(series.y) < 0)


@pytest.mark.prove
@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_weak_motor_catches_up_to_the_arcsine(share):
    assert limits.edge_of_rest(share, linear=True) == pytest.approx(share, abs=1e-5)
    assert limits.edge_of_rest(share) == pytest.approx(math.asin(share), abs=1e-5)
    # linear: the fast mode alone decides, whatever the mixture of angle and speed
    inside, outside = 0.999 * share, 1.001 * share
    for q in (-0.5, 0.0, 0.7):
        assert limits.caught(q, inside - q, share, linear=True)
        assert not limits.caught(q, outside - q, share, linear=True)


def test_the_map_of_the_pendulum_has_its_edges():
    (panel,) = build("saturation_region", points=25)
    assert panel.grid is not None
    good = panel.grid.within()
    assert good[12, 12] and not good[-1, -1] and not good[0, 0]
    np.testing.assert_array_equal(good, good[::-1, ::-1])  # a pendulum has no better side


def test_ripple_stays_in_its_bound_and_only_unequal_friction_hunts():
    ripple, hunting = build("ripple_and_hunting", points=3)
    (series,) = ripple.series
    assert np.all(series.y <= 1.1 * series.expected) and series.y[0] > 0.3 * series.expected[0]
    still, integral = hunting.series
    assert max(still.y) == 0.0 and integral.y[0] < 0.1 and integral.y[1] > 5.0


@pytest.mark.slow
def test_the_rows_of_ziegler_and_nichols_and_what_to_do_instead():
    (panel,) = build("ziegler_nichols_rows", points=5)
    assert np.all(np.isfinite(panel["PID"].y)) and min(panel["PID"].y) > 0.5
    assert np.isinf(panel["PI"].y[0]) and np.isfinite(panel["PI"].y[-1])
    assert max(panel["PD, three equal poles"].y) < 0.01
    # three poles in one place, in the delay's own equation
    for delay in (0.1, 1.0):
        result = limits.placed(delay)
        D = delay * (1.0 + 1.0 / limits.SAMPLES)
        s = np.roots([D, D + 4.0, 2.0 + 2.0 / D]).max()
        value = s * s + s + (result.gains.kd * s + result.gains.kp) * math.exp(-s * D)
        assert abs(value) < 1e-12


@pytest.mark.prove
def test_the_first_peak_is_the_masss_and_the_walls_while_the_law_is_soft():
    (panel,) = build("contact_regimes", points=3)
    for series in panel.series:
        assert series.y[0] == pytest.approx(series.expected[0], rel=0.1)
        assert series.y[-1] > 1.2 * series.expected[-1]
