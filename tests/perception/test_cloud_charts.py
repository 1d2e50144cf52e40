"""What the charts of pictures and clouds show, on smaller sizes."""

import numpy as np
import pytest

from course import charts
from course.charts.perception import clouds


def test_depth_noise_follows_its_law_where_noise_hides_the_steps():
    law, remaining, share = charts.build("depth_noise", pictures=3, places=5)
    for series in law.series[:2]:
        assert np.abs(np.array(series.y) / series.expected - 1.0).max() < 0.03
    coarse = law.series[2]
    assert np.abs(np.array(coarse.y) / coarse.expected - 1.0).max() > 0.05
    (measured,) = remaining.series
    assert np.abs(np.array(measured.y) - measured.expected).max() < 0.02
    assert abs(measured.y[0]) > 0.2 > 0.05 > abs(measured.y[-1])
    for series in share.series:
        assert np.abs(np.array(series.y) / series.expected - 1.0).max() < 0.3


@pytest.mark.slow
def test_a_part_is_lost_where_the_tolerance_reaches_it():
    lost, false = charts.build(
        "lost_parts", heights=(0.004, 0.008, 0.02, 0.04), distances=(0.5, 1.0), pictures=2
    )
    limit = lost["3 sigma(z)"].y
    careful = lost["3 sigma, 12"].y
    assert all(0.9 * k < h < 4.0 * k for h, k in zip(careful, limit, strict=True))
    assert lost["10 mm, 50"].y[0] >= 0.02 > lost["4 mm"].y[0]
    # Within the noise the table itself falls into clusters.
    assert false["4 mm"].y[1] > 5.0 and max(false["3 sigma"].y) < 1.0
    stages = clouds.counts(0.008, 0.5, 0.01, 50, 0.005, 0.02, np.random.default_rng(0))
    assert stages["pixels"] > 100 and stages["above"] < 50 and stages["clustered"] == 0


def test_refits_find_what_the_law_of_draws_misses():
    (panel,) = charts.build("ransac_draws", trials=150)
    bare, one, two = (np.array(panel[name].y) for name in ("no refit", "one refit", "two"))
    assert np.all(bare < 0.85) and bare[0] < 0.5
    assert np.all(one > bare) and two.mean() > one.mean() > bare.mean() + 0.05


@pytest.mark.prove
def test_every_step_is_timed_beside_its_library():
    steps, growth = charts.build("cloud_speed", repeats=1, sizes=(300, 600, 1200))
    assert len(steps["library"].x) == 8 and min(steps["library"].x) > 0.0
    assert [series.key for series in growth.series] == ["course", "Open3D"]
