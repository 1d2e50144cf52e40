"""What the charts of speed against accuracy show, on smaller sizes."""

import re
from pathlib import Path

import pytest

from course import charts
from course.charts.perception import precision

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
def test_a_coarse_grid_is_cheap_and_biased():
    for panel in charts.build("pose_precision", voxels=(0.008, 0.03), pictures=2, repeats=1):
        for name in ("shape", "cloud", "Open3D", "small_gicp"):
            fine, coarse = panel[name].y[:2]
            assert fine < 0.5e-3 and coarse > 2.0 * fine
            assert panel[name].x[0] > panel[name].x[1]
        pick = next(s for s in panel.series if s.key == "chosen")
        assert pick.y[0] <= 2e-3 and "30 mm" in pick.tags[0]


@pytest.mark.slow
def test_the_same_chain_finds_the_same_parts():
    (panel,) = charts.build("frame_speed", pictures=2)
    right = [int(note.split(" right")[0].split()[-3]) for note in panel.notes[:3]]
    assert min(right) >= 5
    assert len(panel["course"].x) == len(panel["Open3D"].x) == 6


def test_a_linear_fit_of_inverse_depth_has_no_offset():
    angle, bias = charts.build("plane_precision", draws=(100,), thin=(16, 1), pictures=8, repeats=1)
    last = {series.label: series.y[-1] for series in angle.series}
    assert last["inverse depth"] < 0.5 * last["SVD of points"]
    assert last["RANSAC, refit"] < 0.5 * last["RANSAC"]
    assert bias["SVD of points"].y[-1] > 0.1 > 0.04 > abs(bias["inverse depth"].y[-1])


def test_the_page_names_the_size_of_the_measured_frame():
    """It said 640 x 480 once, four times as many pixels as were measured."""
    page = (ROOT / "notebooks" / "source" / "07_perception.py").read_text(encoding="utf-8")
    (size,) = re.findall(r"three boxes on a table in (\d+ x \d+) pixels", page)
    assert size == f"{precision.FRAME.width} x {precision.FRAME.height}"


def test_models_are_spaced_like_the_grid():
    """Open3D builds the tree of its target at each call: 16,000 points only cost it time."""
    assert precision.model_points(0.004) == pytest.approx(3950, rel=0.02)
    assert precision.model_points(0.03) == 500
