"""Intervals that cover, and summaries that survive being stored."""

import json
from typing import Any

import numpy as np

from drills.robot import report, store
from drills.robot.slots import STAGES


def summary(seconds: np.ndarray) -> report.Summary:
    n = seconds.size
    zero = np.zeros((len(STAGES), 2))
    return report.Summary(
        n, np.ones(n, dtype=bool), 0.9, 1.0, seconds, 0.001 * seconds, zero, zero[:, 0],
        (np.zeros(2), 0.0), zero[:, 0],
    )  # fmt: skip


def test_the_interval_of_a_change_covers_the_true_change() -> None:
    """Of 400 pairs of robots 95 % cover; 91 % is four standard errors below."""
    rng, covered = np.random.default_rng(1), 0
    for _ in range(400):
        before = rng.normal(5.0, 1.0, 60)
        after = before + 0.2 + rng.exponential(0.3, 60) - 0.3
        _, low, high = report.compare(summary(before), summary(after)).seconds
        covered += low <= 0.2 <= high
    assert 0.91 * 400 <= covered <= 400


def test_what_both_robots_share_cancels() -> None:
    rng = np.random.default_rng(2)
    before = rng.normal(5.0, 1.0, 100)
    _, low, high = report.compare(summary(before), summary(before + 0.01)).seconds
    assert high - low < 1e-9 and abs(low - 0.01) < 1e-9


def test_tasks_that_one_did_not_finish_do_not_count() -> None:
    before = np.array([5.0, np.inf, 5.0, 6.0])
    after = np.array([5.5, 5.0, np.inf, 6.5])
    assert abs(report.compare(summary(before), summary(after)).seconds[0] - 0.5) < 1e-12


def test_a_summary_survives_being_stored() -> None:
    one = summary(np.array([5.0, np.inf]))._replace(success=np.array([True, False]))
    again = report.restored(json.loads(json.dumps(one.plain(), allow_nan=False)))
    np.testing.assert_array_equal(again.success, one.success)
    np.testing.assert_array_equal(again.seconds, one.seconds)
    assert again.low < 0.5 < again.high


def test_a_damaged_file_is_refused() -> None:
    from course import json_store

    contents: tuple[dict[str, Any], ...] = (
        {"runs": {}},
        {"graded": []},
        {"passed": {"1": 3}},
        {"runs": [1]},
    )
    for content in contents:
        try:
            store.FORM.parse(content)
        except json_store.Damaged:
            continue
        raise AssertionError(content)
