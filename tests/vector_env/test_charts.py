"""What the chart of the vector environments says, on smaller settings."""

from functools import partial

import numpy as np
import pytest

from course.charts import vector_env as chart


def test_batches_beat_gymnasiums_loop() -> None:
    """Aims are 5 and 100 beside the MuJoCo arm at N = 256; the bounds leave room for a busy day."""
    chosen = [c for c in chart.CONTENDERS if c.name in (chart.CLOSED, chart.BATCH, chart.SYNC)]
    rates = chart.measure_rates(chosen, (chart.COMPARED_AT,), 15, 0.005)
    assert {rate.n for rate in rates} == {chart.COMPARED_AT}
    assert chart.ratio(rates, chart.BATCH, (chart.SYNC,)) > 1.5
    assert chart.ratio(rates, chart.CLOSED, (chart.SYNC,)) > 30.0
    assert all(rate.low <= rate.steps_per_second <= rate.high for rate in rates)


def test_runge_kutta_meets_the_tolerance_with_one_step_and_euler_needs_many() -> None:
    closed, rk4, euler = (chart.ACCURACY[name] for name in chart.ACCURACY)
    errors = [chart.tip_error(partial(chart._turned, make, 1), 8) for make in (closed, rk4)]
    assert errors[0] < 0.1 * chart.TOLERANCE
    assert errors[1] == pytest.approx(errors[0], rel=1e-6)
    assert chart.tip_error(lambda n: closed(n, 2), 8) == pytest.approx(errors[0] / 16, rel=0.3)
    coarse, fine = (chart.tip_error(partial(chart._turned, euler, s), 8) for s in (8, 16))
    assert coarse / fine == pytest.approx(2.0, abs=0.3) and fine > chart.TOLERANCE


def test_the_truth_is_converged() -> None:
    assert chart.tip_error(lambda n: chart.ArmReachVector(n, substeps=32)) < 1e-9


def test_where_two_curves_cross() -> None:
    cost = np.geomspace(1e-6, 1e-3, 13)
    loop, processes = 8 * cost, 4 * cost + 2e-4
    assert chart.crossing(cost, loop, processes) == pytest.approx(5e-5, rel=0.05)
    assert chart.crossing(cost, loop, loop * 2.0) is None
    assert chart.predicted_crossing(0.0, 2e-4, 8, 2, 0.0) == pytest.approx(5e-5)
    assert chart.predicted_crossing(2e-4, 1e-4, 8, 2, 1e-6) == 1e-6


def test_processes_lose_where_an_environment_costs_nothing() -> None:
    found = chart.cost_of_processes((0,), n=4, repeats=5)
    assert found["processes"][0] > found["loop"][0]
    assert found["predicted"] > found["cost"][0] and found["measured"] is None
