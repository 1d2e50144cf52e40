"""Work against precision, on methods whose errors are known in advance."""

import math
import time
from dataclasses import replace
from importlib.metadata import version
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from course.measure import timing, work_precision
from course.measure.figure import draw
from course.measure.work_precision import (
    Method,
    Result,
    WorkPrecision,
    machine,
    max_norm,
    measure,
)

pytestmark = pytest.mark.smoke


STEPS = [0.5 / 2**k for k in range(7)]


def _decay(order, calls=None):
    """y' = -y over one second with the Taylor method of the given order: a real convergence."""

    def run(h):
        if calls is not None:
            calls.append((order, h))
        n = round(1.0 / h)
        factor = sum((-h) ** k / math.factorial(k) for k in range(order + 1))
        y = 1.0
        for _ in range(n):
            y *= factor
        return Result([y], n * order)

    return Method(f"order {order}", run, STEPS)


TRUTH = [math.exp(-1.0)]


def _measured(methods, **options):
    options: dict[str, Any] = {
        "reference_check": [1.0 / math.e],
        "repeats": 2,
        "sample_time": 1e-5,
        **options,
    }
    return measure(methods, TRUTH, **options)


@pytest.mark.parametrize("order", [1, 2, 4])
def test_observed_order(order):
    chart = _measured([_decay(order)])
    assert chart.observed_order(f"order {order}") == pytest.approx(order, abs=0.1)


def test_observed_order_ignores_saturation_and_floor():
    def run(h):
        error = min(0.3, h**2 + 1e-9)
        return Result([TRUTH[0] + error], 1.0 / h)

    steps = [2.0**-k for k in range(0, 24)]
    chart = _measured([Method("bent", run, steps)])
    assert chart.observed_order("bent") == pytest.approx(2.0, abs=0.02)


def test_observed_order_of_noise_is_not_an_order():
    rng = np.random.default_rng(3)

    def run(h):
        return Result([TRUTH[0] + 1e-12 * rng.uniform(0.9, 1.1)], 1.0 / h)

    assert math.isnan(_measured([Method("flat", run, STEPS)]).observed_order("flat"))


def test_pick_is_the_cheapest_that_is_good_enough():
    chart = _measured([_decay(1), _decay(4)], tolerance=1e-4)
    by_count = chart.pick(by="count")
    # Order 4 needs h = 1/4 (error about 1e-5) at 16 evaluations; order 1 never gets there.
    assert (by_count.name, by_count.point.parameter) == ("order 4", 0.25)
    assert by_count.point.error <= 1e-4
    assert chart.pick(1e-17) is None
    assert chart.pick(1.0, by="count").name == "order 1"
    with pytest.raises(ValueError, match="by must be"):
        chart.pick(by="colour")
    with pytest.raises(ValueError, match="tolerance"):
        _measured([_decay(1)]).pick()


def test_failures_stay_as_failures():
    def diverges(h):
        if h > 0.3:
            return Result([math.nan], 1.0)
        if h > 0.2:
            return Result([1e6], 1.0)
        if h > 0.1:
            raise FloatingPointError("lost")
        return Result([TRUTH[0] + h], 1.0 / h)

    chart = _measured([Method("bad", diverges, [0.4, 0.25, 0.15, 0.05])], failed_above=10.0)
    points = chart.curve("bad").points
    assert [bool(p.failure) for p in points] == [True, True, True, False]
    assert all(p.cost(by) == math.inf for p in points[:3] for by in ("time", "count"))
    assert all(p.error == math.inf for p in points[:3])
    assert "not finite" in points[0].failure
    assert "above" in points[1].failure
    assert "lost" in points[2].failure
    assert len(chart.curve("bad").valid_points()) == 1
    assert chart.table().count("failed:") == 3


def test_failures_are_on_the_chart():
    def diverges(h):
        return Result([math.inf], 1.0)

    chart = _measured([_decay(2), Method("bad", diverges, [0.4, 0.2])], tolerance=1e-3)
    for panel, by in zip(chart.panels(), ("count", "time"), strict=True):
        assert [s.failed for s in panel.series] == [0, 2, 0]
        assert panel.series[1].label == "bad, 2 of 2 failed"
        assert panel.lines == [("y", 1e-3, "tolerance 0.001 -")]
        pick = chart.pick(by=by)
        assert panel.series[2].x == [pick.point.cost(by)]
        assert panel.series[2].tags == ["pick: order 2"]
    assert chart.panels()[0].footer == chart.machine and machine() in chart.machine
    assert "mujoco" in chart.machine and machine(libraries=["scipy"]).endswith(version("scipy"))


def test_a_failed_run_stands_at_the_cost_of_its_steps():
    def run(h):
        return Result([math.inf if h > 0.1 else TRUTH[0] + h], 3.0 / h)

    methods = [_decay(2), Method("bad", run, [0.4, 0.2, 0.1])]
    chart = _measured(methods, tolerance=1e-3, duration=1.0)
    by_count, by_time = chart.panels()
    assert by_count.series[1].failed_at == pytest.approx([7.5, 15.0])
    time = chart.curve("bad").points[-1].time
    assert by_time.series[1].failed_at == pytest.approx([time / 4, time / 2])
    # A setting that is no step says nothing about the cost.
    assert _measured(methods, tolerance=1e-3).panels()[0].series[1].failed_at == []


def test_a_chart_of_counts_alone_has_one_panel_with_names():
    (panel,) = replace(_measured([_decay(2)]), counts_only=True).panels()
    assert panel.legend and panel.x == "force evaluations"


def test_styles_on_the_chart():
    other = Method("library", _decay(2).run, STEPS, style="oracle", key="rk4")
    chart = _measured([_decay(1), other]).with_method(
        Method("mine", _decay(4).run, STEPS, style="yours")
    )
    figure = draw(chart.panels(), figure=Figure())
    left, right = figure.axes
    lines = {line.get_label(): line for line in left.lines}
    assert lines["order 1"].get_linestyle() == "-"
    assert lines["library"].get_linestyle() == "--"
    assert lines["library"].get_markerfacecolor() == "none"
    assert lines["mine"].get_color() == "black"
    assert lines["mine"].get_linewidth() >= 2.5
    assert lines["order 1"].get_color() == right.lines[0].get_color()
    (across, *_) = right.collections
    assert len(across.get_paths()) == len(STEPS)


def test_the_floor_of_the_reference_is_shown_where_errors_reach_it():
    fine = Method("fine", lambda h: Result([TRUTH[0] + h * 1e-10], 1.0 / h), [1.0, 0.1])
    options = {"reference_check": [TRUTH[0] + 5e-11], "tolerance": 1e-3}
    (span,) = _measured([fine], **options).panels()[0].spans
    assert span[1] < 1e-11 and span[2] == pytest.approx(5e-11, rel=1e-3)
    assert _measured([_decay(1)], **options).panels()[0].spans == ()


def test_a_wrong_reference_is_refused():
    with pytest.raises(ValueError, match="reference_check must be"):
        measure([_decay(4)], TRUTH, reference_check=[TRUTH[0] + 1e-6], repeats=1)
    # Good enough for a tolerance of 1e-3 all the same, and then it says how good it is.
    chart = measure(
        [_decay(4)], TRUTH, reference_check=[TRUTH[0] + 1e-6], repeats=1, tolerance=1e-3
    )
    assert chart.reference_uncertainty == pytest.approx(1e-6)
    with pytest.raises(ValueError, match="finite"):
        measure([_decay(4)], TRUTH, reference_check=[math.nan], repeats=1)


def test_methods_run_interleaved(monkeypatch):
    monkeypatch.setattr(timing, "core_share", lambda: 1.0)
    calls: list[tuple[int, float]] = []
    methods = [_decay(1, calls), _decay(2, calls)]
    _measured(methods, repeats=3, sample_time=0.0)
    rounds = np.array_split(np.array([order for order, _ in calls]), 5)  # warm-up, sizing, 3 rounds
    for one in rounds:
        assert one.tolist() == [1] * len(STEPS) + [2] * len(STEPS)


def test_a_busy_machine_is_named_in_the_footer(monkeypatch):
    monkeypatch.setattr(timing, "core_share", lambda: 0.3)
    assert _measured([_decay(1)]).machine == machine() + "; busy in 100% of the rounds"


def test_time_is_the_time():
    def sleeps(h):
        time.sleep(h)
        return Result(TRUTH, 1.0)

    # A factor of fifty, so that a busy machine cannot turn the order round.
    chart = _measured([Method("sleep", sleeps, [0.05, 0.001])], repeats=3)
    slow, fast = chart.curve("sleep").points
    assert slow.low <= slow.time <= slow.high
    assert slow.time >= 0.05
    assert slow.time > fast.time >= 0.001


def test_the_least_time_is_drawn_where_it_is_asked_for(monkeypatch):
    result = timing.Timing(3.0, 2.0, 4.0, 1.0)
    monkeypatch.setattr(work_precision, "interleaved", lambda runs, **_: [result for _ in runs])
    for best, expected in ((False, (3.0, 2.0, 4.0)), (True, (1.0, 1.0, 4.0))):
        chart = _measured([_decay(4)], best=best)
        point = chart.curves[0].points[0]
        assert (point.time, point.low, point.high) == expected
        assert chart.machine.endswith("; least of 2 rounds") == best


def test_with_method_measures_beside_the_pick():
    base = _measured([_decay(1), _decay(2)], tolerance=1e-3)
    calls: list[tuple[int, float]] = []
    pick = base.pick()
    original = next(m for m in base._repeat["methods"] if m.name == pick.name)
    counted = Method("mine", _decay(2, calls).run, [pick.point.parameter], style="yours")
    chart = base.with_method(counted, repeats=4)
    assert [c.name for c in chart.curves] == ["order 1", "order 2", "mine"]
    assert [c.name for c in base.curves] == ["order 1", "order 2"]
    assert calls
    assert chart.ratio > 0.0
    assert math.isfinite(chart.ratio) and "times its time" in chart.table()
    with pytest.raises(ValueError, match="not on the chart yet"):
        chart.with_method(counted)
    hopeless = Method("hopeless", lambda h: Result([0.0], 1.0), [0.5], style="yours")
    assert base.with_method(hopeless).ratio == math.inf
    assert original.parameters == STEPS


def test_json_round_trip(tmp_path):
    def fails(h):
        return Result([math.nan], 1.0)

    chart = _measured([_decay(2), Method("bad", fails, [0.1])], tolerance=1e-3, question="How far?")
    path = tmp_path / "chart.json"
    chart.to_json(path)
    again = WorkPrecision.from_json(path)
    assert again == chart
    assert again.table() == chart.table()
    assert [p.name for p in tmp_path.iterdir()] == ["chart.json"]
    with pytest.raises(ValueError, match="this chart is from a file"):
        again.with_method(_decay(4))


def test_bad_input():
    with pytest.raises(ValueError, match="style"):
        Method("x", _decay(1).run, [0.1], style="theirs")
    with pytest.raises(ValueError, match="parameters"):
        Method("x", _decay(1).run, [0.1, -1.0])
    with pytest.raises(ValueError, match="different names"):
        _measured([_decay(1), _decay(1)])
    with pytest.raises(ValueError, match="same unit"):
        _measured([_decay(1), Method("x", _decay(2).run, STEPS, unit="collision checks")])
    with pytest.raises(ValueError, match=r"name must be one of"):
        _measured([_decay(1)]).curve("order 7")
    assert max_norm(np.array([1.0, 5.0]), np.array([1.5, 4.0])) == 1.0
