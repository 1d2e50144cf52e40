"""What the charts of poses show, on smaller sizes."""

import numpy as np
import pytest

from course import charts
from course.charts.perception import neglected


def test_a_prism_comes_home_from_half_its_period():
    home, steps = charts.build("icp_basin", turns=15, points=300)
    for n in (3, 4, 6):
        series = home[f"{n} sides"]
        x, end = np.array(series.x), np.abs(series.y)
        assert np.all(end[x < 0.85 * 180 / n] < 3.0)
        assert np.all(np.abs(end[x > 1.15 * 180 / n] - 360 / n) < 3.0)
    assert np.median(steps["points"].y) > 3.0 * np.median(steps["planes"].y)


@pytest.mark.prove
def test_closest_points_are_sure_and_rays_are_honest():
    panel, shared = charts.build("pose_covariance", runs=20)
    assert np.abs(np.array(panel["along the rays"].y) - 1.0).max() < 0.5
    assert max(panel["closest points"].y) > 10.0
    assert np.all(np.diff(shared["six directions"].y) > 0.5)


def test_a_residual_does_not_tell_what_see_through_tells():
    residual, through = charts.build("silently_wrong", turns=4)
    assert max(residual["cut off"].y) < 1.5 * max(residual["right"].y)
    assert max(residual["cut off"].x) > 0.02
    assert max(through["right"].y) < 0.012 and min(through["quarter turn"].y) > 0.2
    assert min(through["scale 1 % off"].x) > 5e-3 and max(through["scale 1 % off"].y) < 0.012


def test_averages_lag_and_predictions_say_their_error():
    mean, late = charts.build("tracking", runs=200)
    for series in mean.series:
        assert np.abs(np.array(series.y) / series.expected - 1.0).max() < 0.25
    assert late["last pose"].y[-1] > 3.0 * late["predicted"].y[-1]
    ratio = np.array(late["predicted"].y) / np.array(late["error that the filter expects"].y)
    assert np.all((ratio > 0.3) & (ratio < 1.3))


@pytest.mark.prove
def test_what_a_picture_leaves_out_is_below_what_the_gripper_needs(monkeypatch):
    known = neglected.known_part()
    assert known.check() == []
    assert all(effect.measured() > 0.0 for effect in known.left_out)
    scene = neglected.scene(neglected.YAWS[1], neglected.ASIDE[1])
    for empty in ("DISTORTED", "SPEED", "DAZZLED"):
        monkeypatch.setattr(neglected, empty, 0.0)
    for view in (neglected.through_a_lens, neglected.moving, neglected.dazzled):
        assert np.allclose(view(scene, 1), neglected.plain(scene, 1), atol=1e-12), view.__name__
    monkeypatch.setattr(neglected, "DISTORTED", 40.0)  # nobody has calibrated it
    assert neglected.change(neglected.through_a_lens) > known.tolerance.value
