"""What the charts of contact geometry show, on smaller sizes: exponents, errors, limits."""

import numpy as np
import pytest

from course import charts
from course.charts.contact import geometry


def test_the_broad_phase_has_the_exponents_of_theory():
    counts, times = charts.build(
        "broad_phase", sizes=(100, 1000, 3000), mujoco=100, brute=100, repeats=1
    )
    for kind, theory in geometry.THEORY.items():
        series = counts[f"tests, {geometry.WORDS[kind]}"]
        assert np.polyfit(np.log(series.x), np.log(series.y), 1)[0] == pytest.approx(
            theory, abs=0.05
        )
        assert series.y == pytest.approx(series.expected, rel=0.3)
    pairs = counts["pairs"]
    assert np.polyfit(np.log(pairs.x), np.log(pairs.y), 1)[0] == pytest.approx(1.0, abs=0.1)
    swaps = counts["swaps"]
    assert 1.5 < np.polyfit(np.log(swaps.x), np.log(swaps.y), 1)[0] < 1.9
    assert {series.key for series in times.series} == {
        "sweep and prune",
        "kept order",
        "uniform grid",
        "brute force",
        "MuJoCo",
    }


@pytest.mark.prove
def test_the_narrow_phase_is_exact_where_coal_is_not():
    apart, inside, boxes = charts.build("narrow_phase", count=50, repeats=1, boxes=100)
    for rival in ("Coal, one call for all", "Coal, a call a pair"):
        assert len(apart[rival].x) == len(inside[rival].x) == 10
    assert np.max(boxes["GJK and EPA"].y) < 1e-14
    assert np.max(boxes["Coal, default tolerance"].y) > 1e-8


@pytest.mark.prove
def test_walls_leak_by_two_limits():
    (panel,) = charts.build("tunnelling_limit", steps=(1e-3, 2e-3), grid=27, phases=2)
    speeds = 400.0 ** (1 / 26)
    checked = panel["checked once a step"]
    assert (np.array(checked.y) >= checked.expected).all()
    assert (np.array(checked.y) < checked.expected * speeds**2).all()
    assert np.isinf(panel["advanced to the impact"].y).all()
    (_, soft, _), *_ = panel.lines
    for speed in panel["MuJoCo, default"].y:
        assert soft / speeds < speed < soft * speeds
    slow, fast = panel["MuJoCo, speculative"].y
    assert np.isfinite(slow)
    assert np.isinf(fast)
