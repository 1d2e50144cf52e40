"""What the charts of small and large parts show, on smaller sizes."""

import numpy as np
import pytest

from course import charts
from course.charts.perception import bins
from course.charts.perception.poses import EYE


@pytest.mark.prove
def test_small_parts_are_lost_as_neighbours_and_found_again_by_the_cures():
    retained, best = charts.build("small_parts", sizes=(0.012, 0.02, 0.04), pictures=2)
    small = {stage: retained[stage].y[0] for stage in bins.STAGES}
    assert small["pixels"] > small["voxels"] > small["above the plane"] > 0
    # Nothing is left: no mean of a small part has 50 neighbours.
    assert small["clustered"] == 0.0 and retained["clustered"].y[-1] > 50
    least = dict(zip(best.series[0].y, best.series[0].x, strict=True))
    assert least["as in a tutorial"] == 40.0 and least["components, 5 images, 0.5 m"] == 12.0
    assert least["tolerance 3 sigma"] == 40.0 > least["3 sigma, 0.2 pi (eps/v)^2"]


@pytest.mark.prove
def test_only_what_fits_the_shape_is_right_and_only_an_outside_length_tells_scale():
    shift, turn = charts.build("large_parts", turns=4, model=1500)
    mm = {series.label: dict(zip(bins.SHORT, series.y, strict=True)) for series in shift.series}
    assert mm["centroid"]["alone"] > 20 > 5 > mm["box along principal axes"]["alone"] > 0.3
    assert max(mm["locate"][x] for x in ("alone", "touching", "hidden")) < 1.0
    assert min(mm["box along the table"]["touching"], mm["ICP, shape"]["touching"]) > 2
    for cause, least in (("twin", 30), ("scale 1 %", 5), ("camera 1°", 10)):
        assert min(row[cause] for row in mm.values()) > (least if cause != "scale 1 %" else 0)
        assert mm["locate"][cause] > least
    axes = dict(zip(bins.SHORT, turn["principal axes"].y, strict=True))
    assert axes["hidden"] > 3.0 * axes["alone"] > 3.0
    (message,) = (note for note in shift.notes if note.startswith("cut off"))
    assert "found" not in message


def test_the_limit_between_near_twins_is_a_number_of_pixels():
    """Of two pixels each, half as wide, the limit is half as far."""
    coarse, fine = (np.array(bins.twin_limits(camera, 0.8)) for camera in (EYE, bins.FINE))
    assert np.all(coarse[0] < coarse[1]) and np.allclose(coarse, 2.0 * fine)
    assert np.allclose(bins.twin_limits(EYE, 1.6), 2.0 * coarse)


@pytest.mark.prove
def test_near_twins_are_found_below_the_predicted_limit_and_not_above():
    for panel in charts.build("near_twins", differences=(0.001, 0.008), pictures=4):
        for name in bins.TWINS:
            assert list(panel[name].y) == [1.0, 0.0], (panel.title, name)
