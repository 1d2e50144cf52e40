"""What chapter 4 says of its charts, on smaller settings: theory against what was measured."""

import numpy as np
import pytest

from course import charts


def slope(series) -> float:
    return float(np.polyfit(np.log(series.x), np.log(series.y), 1)[0])


def test_differences_lose_digits_on_both_sides_of_the_step_that_theory_names() -> None:
    left, right = charts.build(
        "jacobian_precision", steps=tuple(np.logspace(-14, -1, 14)), repeats=1
    )
    for name in ("forward", "central"):
        measured, theory = np.asarray(left[name].y), left[name].expected
        assert np.all(measured < 3 * theory) and np.all(theory[-4:] < 3 * measured[-4:])
        assert 0 < int(np.argmin(measured)) < measured.size - 1
        assert np.all(theory < 300 * measured)
    assert max(left["complex step"].y[:5]) < 1e-14
    wrong = {series.label: series.y[0] for series in right.series}
    assert wrong["analytic"] < 1e-14 and wrong["autograd"] < 1e-14
    assert wrong["forward"] > 1e3 * wrong["complex step"]


def test_the_null_space_drifts_with_the_square_and_one_step_mends_it() -> None:
    (panel,) = charts.build("null_space_step", steps=(0.01, 0.02, 0.05, 0.1), postures=60)
    exact, mended, damped = panel.series
    assert exact.y == pytest.approx(exact.expected, rel=0.02)
    assert [round(slope(s), 1) for s in panel.series] == pytest.approx([2, 4, 1], abs=0.15)
    assert np.all(mended.y < 1e-2 * np.asarray(exact.y)) and np.all(damped.y > exact.y)


def test_damping_keeps_the_joints_within_their_speed_where_theory_says() -> None:
    left, right = charts.build("damping_map", nx=41, ny=31, dampings=(1e-3, 1e-2, 0.1))
    grid, needed = left.grid, np.asarray(left.series[0].y)
    # One cell of the map beside the theory on either side.
    high, low = (np.interp(np.log(needed), np.log(grid.y), range(grid.y.size)) + d for d in (1, -1))
    for i, column in enumerate(grid.values.T):
        rows = np.arange(grid.y.size)
        assert np.all(column[rows > high[i]] <= 1)
        if needed[i] > 1e-3:
            assert np.all(column[rows < low[i]] > 1)
    assert grid.values[grid.y > left.series[1].y[0]].max() <= 1
    assert grid.values.max() > 3
    for series in right.series:
        assert series.y[-1] > 5 * series.y[0]
