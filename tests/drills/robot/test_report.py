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
        n,
        np.ones(n, dtype=bool),
        0.9,
        1.0,
        seconds,
        0.001 * seconds,
        zero,
        zero[:, 0],
        (np.zeros(2), 0.0),
        zero[:, 0],
    )


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
    from drills import json_store

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


def test_a_stated_number_of_tasks_is_enough_and_half_of_it_is_not() -> None:
    for rate, threshold in ((1.0, 0.95), (0.97, 0.9), (0.9, 0.85)):
        n = report.tasks_needed(rate, threshold)
        assert n is not None
        # Wilson's interval by its definition: the shares at two standard errors of themselves.
        for tasks, enough in ((n, True), (n // 2, False)):
            share = int(rate * tasks) / tasks
            at_the_mark = 1.96 * np.sqrt(threshold * (1.0 - threshold) / tasks)
            assert (share - threshold > at_the_mark) == enough
    assert report.tasks_needed(0.9, 0.9) is None and report.tasks_needed(0.5, 0.9) is None


def test_a_short_run_does_not_hide_a_long_one() -> None:
    from drills.robot.history import versions

    def run(robot: str, tasks: int, at: str) -> dict[str, Any]:
        return {"robot": robot, "level": 2, "tasks": tasks, "at": at}

    runs = [run("a", 200, "1"), run("b", 20, "2"), run("a", 20, "3"), run("b", 20, "4")]
    shown = [(one["robot"], one["tasks"], one["at"]) for one in versions(runs, 2)]
    assert shown == [("a", 200, "1"), ("b", 20, "4")]
