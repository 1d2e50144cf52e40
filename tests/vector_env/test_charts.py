"""What the chart of the vector environments says, on smaller settings."""

import time
from functools import partial

import numpy as np
import pytest

from course.charts import build
from course.charts import vector_env as chart


def test_batches_beat_gymnasiums_loop() -> None:
    """Aims are 5 and 100 at N = 256 on the clock; these are ratios of processor time, with room."""
    names = (chart.CLOSED, chart.BATCH, chart.SYNC)
    chosen = {name: chart.CONTENDERS[name] for name in names}
    rates = chart.measure_rates(chosen, (64,), 5, 0.005, time.process_time)
    assert chart.ratio(rates, chart.BATCH, (chart.SYNC,), 64) > 1.5
    assert chart.ratio(rates, chart.CLOSED, (chart.SYNC,), 64) > 20.0


def test_runge_kutta_meets_the_tolerance_with_one_step_and_euler_needs_many() -> None:
    def error(name, substeps):
        return chart.tip_error(partial(chart.ACCURACY[name][1], substeps=substeps), 8)

    closed, rk4, euler = chart.ACCURACY
    coarse = error(closed, 1)
    assert coarse < 0.1 * chart.TOLERANCE
    assert error(rk4, 1) == pytest.approx(coarse, rel=1e-6)
    assert error(closed, 2) == pytest.approx(coarse / 16, rel=0.3)
    first, second = (error(euler, s) for s in (8, 16))
    assert first / second == pytest.approx(2.0, abs=0.3) and second > chart.TOLERANCE


def test_the_chart_has_every_contender_at_every_size_it_is_asked_for() -> None:
    speed, accuracy, cost = build(
        "vector_env", sizes=(1, 2), substeps=(1, 2), busy=(0, 4000), repeats=1
    )
    assert [s.label for s in speed.series] == [*chart.CONTENDERS]
    assert all(s.x == [1, 2] and min(s.low) > 0.0 for s in speed.series)
    closed, rk4, _ = accuracy.series
    assert closed.tags == ["1", "2"] and closed.y == pytest.approx(rk4.y, rel=1e-6)
    assert [len(s.y) for s in cost.series] == [2, 2, 2] and len(cost.lines) == 1


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
    (cost,), (loop,), (processes,) = (found[name] for name in ("cost", "loop", "processes"))
    assert processes > loop > cost
    assert chart.predicted_crossing(loop, processes, 4, 2, cost) > cost
