"""The tolerance as a control: the pick goes along, and the sentence says what it costs."""

import io
import math

import numpy as np
import pytest
from PIL import Image

from course import charts
from course.measure.work_precision import Curve, Point, WorkPrecision
from course.simulations.trade_off import Chart, TradeOff


def _curve(name: str, order: int, seconds: float, extra: bool = False) -> Curve:
    """A method of that order, its steps from 0.1 s down, its time and count in proportion."""
    steps = [0.1 / 2**k for k in range(6)]
    times = [seconds / h for h in steps]
    points = [Point(h, h**order, order / h, t, t, t) for h, t in zip(steps, times, strict=True)]
    return Curve(name, "ours", "force evaluations", tuple(points), extra=extra)


@pytest.fixture
def measured() -> WorkPrecision:
    curves = (_curve("low", 1, 1e-6), _curve("high", 4, 4e-6), _curve("other", 2, 1e-4, True))
    return WorkPrecision("Where?", "m", curves, 0.06, 0.0, math.inf, "here", duration=2.0)


def test_the_price_is_said_in_words(measured: WorkPrecision) -> None:
    # An error of 0.05 takes "low" half a step: 20 us of time, 20 evaluations, over two seconds.
    assert measured.price(0.06) == (
        "low at 50 ms: 10 us per simulated s; a tenth of the error would cost 2 times as much, "
        "with high."
    )
    assert measured.price(0.06, "count") == (
        "low at 50 ms: 10 force evaluations per simulated s; a tenth of the error would cost "
        "2 times as much, with high."
    )
    assert measured.price(5e-4).endswith("; a tenth of the error would cost 2 times as much.")
    # The error of the pick is a tenth already.
    assert measured.price(2e-3).endswith("; a tenth of the error costs no more.")


def test_at_both_ends_of_the_control(measured: WorkPrecision) -> None:
    low, high = measured.range()
    finest = (0.1 / 2**5) ** 4
    assert low < finest and high >= 0.1
    assert measured.price(low) == (
        f"Nothing here comes within {low:.2g} m: the smallest error is {finest:.1e} m, of high at "
        "3.12 ms."
    )
    assert measured.price(high).startswith("low at 100 ms: 5 us per simulated s; ")
    assert measured.price(2.0 * finest).endswith("; no run here has a tenth of that error.")
    for tolerance in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="tolerance"):
            measured.price(tolerance)
    failed = Point(0.1, math.inf, math.inf, math.inf, math.inf, math.inf, "it failed")
    empty = Curve("none", "ours", "steps", (failed,))
    nothing = WorkPrecision("Where?", "m", (empty,), 0.1, 0.0, math.inf, "here")
    assert nothing.price(0.1) == "No run worked."


@pytest.mark.slow
def test_the_picture_marks_the_tolerance_and_the_pick(measured: WorkPrecision) -> None:
    chart = Chart(measured)

    def pixels(tolerance: float) -> np.ndarray:
        return np.array(Image.open(io.BytesIO(chart.png(tolerance))))

    first, again = pixels(0.06), pixels(0.06)
    low, high = (pixels(value) for value in measured.range())
    assert np.array_equal(first, again)
    # At the low end there is no ring, and the line is below the axes: only curves are left.
    assert (low < 90).all(axis=2).sum() < (high < 90).all(axis=2).sum()
    changed = np.flatnonzero((first != high).any(axis=(1, 2)))
    assert np.ptp(changed) < 0.9 * first.shape[0]


def test_the_widget_follows_its_slider_and_its_switches(measured: WorkPrecision) -> None:
    shown = TradeOff(measured)
    assert repr(shown) == measured.price(0.06, "count")
    before = shown.picture.value
    for end in (shown.slider.min, shown.slider.max):
        shown.slider.value = 10.0**end
        assert measured.price(10.0**end) in shown.sentence.value
        assert shown.picture.value != before
    assert [*shown.switches] == ["other"]
    bundle = shown._repr_mimebundle_()
    assert bundle["text/plain"] == repr(shown) and "image/png" in bundle


@pytest.mark.prove
def test_a_switch_draws_a_curve_that_was_left_out() -> None:
    measured = WorkPrecision.from_json(charts.FOLDER / "work_precision_tumble.json")
    shown = TradeOff(measured)
    assert [*shown.switches] == [c.name for c in measured.curves if c.name not in measured.shown()]
    before = shown.picture.value
    shown.switches["explicit_euler"].value = True
    assert shown.picture.value != before
    lines = [len(ax.lines) for ax in shown._chart.figure.axes]
    assert lines > [len(ax.lines) for ax in Chart(measured).figure.axes]
    shown.switches["explicit_euler"].value = False
    assert shown.picture.value == before
