"""What the charts of chapter 10 say is in what they measured: their stored series are read."""

import re

import numpy as np
import pytest

from course import charts
from course.middleware import schedule
from course.middleware.transport import expected_loss


@pytest.mark.prove
def test_messages_are_lost_as_theory_says_on_the_bus():
    lost, turns = charts.build("lost_fragments", messages=1500, sent=40)
    for panel, wide in ((lost, 4.0), (turns, None)):
        for series in panel.series:
            if series.theory is None:
                continue
            if wide:
                share = np.array(series.expected)
                spread = wide * np.sqrt(share * (1.0 - share) / 1500)
                assert (np.abs(series.y - share) <= spread + 1e-12).all(), series.label
            else:
                np.testing.assert_allclose(series.y, series.expected, rtol=0.05)
    assert 0.2 < lost["socket"].y[1] < 0.75  # 40 messages, .47 expected
    assert expected_loss(627, 1e-3) > 5.0 * expected_loss(627, 1e-4)


def test_exact_analysis_is_what_runs_and_bounds_are_below_it():
    tests, broken = charts.build("task_sets", sets=60, seconds=2.0)
    exact = np.array(tests["exact"].y)
    assert exact.tolist() == np.array(tests["run"].y).tolist()
    for sooner, later in (("Liu and Layland", "hyperbolic"), ("hyperbolic", "exact")):
        assert (np.array(tests[sooner].y) <= np.array(tests[later].y)).all()
    assert exact[0] == 1.0 and exact[-1] < 0.3
    assert (np.array(broken["random sets"].low) >= broken["Liu and Layland"].y).all()
    (stored, _) = charts.stored("task_sets")
    assert stored["exact"].y == stored["run"].y
    assert np.all(
        np.array(stored["exact"].y)[np.array(stored["exact"].x) < schedule.liu_layland(5)] == 1.0
    )


def test_a_lock_waits_for_the_middle_task_unless_priority_is_handed_on():
    (panel,) = charts.stored("lock_waits")
    x = np.array(panel["none"].x)
    np.testing.assert_allclose(panel["none"].y, 20.0 + x, atol=0.1)
    for protocol in ("inheritance", "ceiling"):
        np.testing.assert_allclose(panel[protocol].y, 20.0, atol=0.1)
    observed = [series for series in panel.series if series.label.startswith("this system")]
    for series in observed:  # where the system permitted it
        theory = 20.0 + x * ("none" in series.label)
        assert (np.array(series.y) > theory - 0.5).all()
        assert (np.array(series.y) < 1.3 * theory + 5.0).all()


def test_no_order_of_one_thread_spares_control_the_cameras_callback():
    (panel,) = charts.build("executor_waits", cameras=(0.005, 0.02), phases=4)
    for order in ("ready set", "timers first", "fifo"):
        waits = np.array(panel[order].y)
        assert (waits <= np.array(panel["ready set"].expected) + 1e-6).all()
        assert (waits > np.array([5.0, 20.0])).all()
    np.testing.assert_allclose(panel["a thread"].y, 1.0, atol=1e-6)


def test_the_stored_loops_are_in_the_order_of_what_they_were_granted():
    busy, waits = charts.stored("loop_lateness")
    worst = [busy[name].y[-1] for name in ("default", "niceness -20")]
    late = [
        np.mean(np.array(busy[name].y) > 1.0) for name in ("default", "niceness -20", "SCHED_FIFO")
    ]
    assert max(worst) > 1.0 and late[0] > late[1] > late[2]
    x, y = np.array(waits["sleep for"].x), np.array(waits["sleep for"].y)
    assert np.polyfit(x, y, 1)[0] > 0.1  # its work alone is 0.1 ms
    assert abs(np.polyfit(x, waits["sleep until"].y, 1)[0]) < 0.02


def test_the_type_of_a_payload_and_not_the_wire_costs_most():
    (panel,) = charts.stored("round_trips")
    at = {
        name: dict(zip(panel[name].x, panel[name].y, strict=True))
        for name in (
            "threads",
            "Unix",
            "shared",
            "zenoh",
            "Cyclone DDS, reliable",
            "Cyclone DDS, sequence",
        )
    }
    big = 921_600
    assert at["Cyclone DDS, sequence"][big] > 5.0 * at["Cyclone DDS, reliable"][big]
    assert at["shared"][big] < at["Unix"][big] < at["zenoh"][big]
    assert all(costs[big] > at["threads"][big] for name, costs in at.items() if name != "threads")


def test_the_oldest_sample_is_depth_less_one_periods_old():
    (panel,) = charts.stored("queue_ages")
    for name in ("bus", "Cyclone DDS"):
        np.testing.assert_array_equal(panel[name].y, np.array(panel[name].x) - 1.0)
    np.testing.assert_array_equal(panel["all are taken"].y, 0.0)
    (text,) = (r for r in charts.read("queue_ages").splitlines() if r.startswith("all are"))
    assert re.findall(r"(\d+) \((\d+)\)", text) == [("0", "0")] * 5  # its own theory, not another's


def test_every_row_of_the_matrix_agrees_with_cyclone():
    first, *rows = charts.read("qos_verdicts").splitlines()
    result = re.match(r"(\d+) of (\d+) rows agree", first)
    assert result and result[1] == result[2] == str(len(rows)) and len(rows) >= 40
    assert {row.split(":")[0] for row in rows} >= {
        "reliability",
        "durability",
        "deadline",
        "liveliness",
        "ownership",
        "destination_order",
        "depth",
        "late joiner",
        "lifespan",
        "several",
    }


def test_sending_again_pays_only_on_a_short_way():
    (panel,) = charts.build("late_or_lost", paths=(1e-3, 2e-2), seconds=8.0)
    again, lost = np.array(panel["sent again"].y), np.array(panel["lost"].y)
    assert again[0] < 0.5 * lost[0] and again[1] > 3.0 * lost[1]
