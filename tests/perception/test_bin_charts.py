"""What the charts of small and large parts show, on smaller sizes."""

import numpy as np
import pytest

from course import charts
from course.charts.perception import bins


@pytest.mark.slow
def test_small_parts_are_lost_as_neighbours_and_found_again_by_the_cures():
    retained, best = charts.build("small_parts", sizes=(0.012, 0.02, 0.04), pictures=2)
    small = {stage: retained[stage].y[0] for stage in bins.STAGES}
    assert small["pixels"] > small["voxels"] > small["above the plane"] > 0
    # Nothing is left: no mean of a small part has 50 neighbours.
    assert np.isnan(small["clustered"]) and retained["clustered"].y[-1] > 50
    least = dict(zip(best.series[0].y, best.series[0].x, strict=True))
    assert least["as in a tutorial"] == 40.0 and least["and 5 pictures from 0.5 m"] == 12.0
    assert least["tolerance 3 sigma"] == 40.0 > least["3 sigma, 0.2 pi (eps/v)^2"]


@pytest.mark.slow
def test_only_what_fits_the_shape_is_right_and_only_an_outside_length_tells_scale():
    shift, turn = charts.build("large_parts", turns=4, model=1500)
    mm = {series.label: dict(zip(bins.SHORT, series.y, strict=True)) for series in shift.series}
    assert mm["centroid"]["right"] > 20 > 5 > mm["box along them"]["right"] > 0.3
    assert max(mm["locate"][x] for x in ("right", "touch", "hidden")) < 1.0
    assert min(mm["box along the table"]["touch"], mm["ICP, shape"]["touch"]) > 2
    for cause, least in (("twin", 30), ("scale", 5), ("tilt", 10)):
        assert min(row[cause] for row in mm.values()) > (least if cause != "scale" else 0)
        assert mm["locate"][cause] > least
    axes = dict(zip(bins.SHORT, turn["principal axes"].y, strict=True))
    assert axes["hidden"] > 3.0 * axes["right"] > 3.0
    (message,) = (note for note in shift.notes if note.startswith("cut off"))
    assert "found" not in message
