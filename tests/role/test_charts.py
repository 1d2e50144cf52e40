"""The charts of chapter 0 at small sizes: theory on both sides of each limit."""

import numpy as np
import pytest

from course import charts
from course.role import CHAIN, age


@pytest.mark.slow
def test_more_phases_come_nearer_and_the_closed_form_is_there() -> None:
    (panel,) = charts.build("age_precision", runs=(3, 100), repeats=3, reference=256)
    few, more = panel["event simulation"].y
    assert more < few and more < 5 * age(CHAIN).std / np.sqrt(100)
    assert panel["closed form"].y[0] < 1e-3 < few
    assert panel["closed form"].x[0] < panel["event simulation"].x[0]


def test_each_limit_is_where_theory_puts_it() -> None:
    locked, drift, queue, overload = charts.build("age_limits", phases=9, seconds=12.0, beats=1.2)
    one = locked["10 Hz"]
    assert one.y == pytest.approx(one.expected, abs=1e-6) and np.ptp(one.y) > 0.02
    assert np.ptp(locked["9.73"].y) < 0.2 * np.ptp(one.y)
    tooth = drift["30 Hz"]
    error = np.abs(np.asarray(tooth.y) - tooth.expected)
    assert np.mean(np.minimum(error, 1 / 30 - error) < 1e-4) > 0.99
    for label in ("reader at 9.7", "reader at 33"):
        assert queue[label].y == pytest.approx(queue[label].expected, abs=2e-3)
    grows = overload["queue without"]
    assert grows.y == pytest.approx(grows.expected, abs=5e-3)
    below = np.asarray(grows.x) < 1.0
    assert np.max(np.abs(np.asarray(grows.y)[below])) < 1e-6 < np.min(np.asarray(grows.y)[~below])
