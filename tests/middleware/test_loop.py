"""The periodic loop: order and counts on its own clock, permission and restoring on this system."""

import gc
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from course.derivations.middleware.timing import Clock
from course.middleware import inversion, loop


def ran(periods: int, work: dict[int, int], usual: int = 100_000, wake: int = 15_000, **more):
    """A loop of 1 ms whose work takes `usual` ns, but in the periods that `work` names."""
    clock, calls = Clock(lambda: 1e-9 * wake), []

    def step(k: int) -> None:
        calls.append((k, clock.ns))
        clock.ns += work.get(k, usual)

    return loop.run(step, 1e-3, periods, now=clock.now, sleep=clock.sleep, **more), calls


def test_an_absolute_loop_does_not_drift_and_a_relative_one_does():
    record, calls = ran(1000, {})
    assert record.release.tolist() == [k for k, _ in calls] == list(range(1000))
    assert record.skipped == 0
    assert np.allclose(record.lateness[1:], 15e-6, rtol=0, atol=1e-12)
    record, _ = ran(1000, {}, relative=True)
    drift = np.diff(record.lateness)[1:]
    assert np.allclose(drift, 115e-6, rtol=0, atol=1e-12)  # work and wake-up, each period anew


@pytest.mark.parametrize(
    ("took", "missed"), [(900_000, 0), (985_000, 0), (1_000_000, 1), (3_500_000, 3), (5_985_000, 5)]
)
def test_periods_that_are_over_are_skipped_not_bunched(took: int, missed: int):
    """Ends at k * 1 ms + 15 us + took: the next release at or after that one is the next to run."""
    record, calls = ran(20, {4: took})
    expected = [k for k in range(20) if not 4 < k <= 4 + missed]
    assert record.release.tolist() == [k for k, _ in calls] == expected
    assert record.skipped == missed
    starts = np.array([t for _, t in calls])
    assert np.all((starts - 1_000_000_000) % 1_000_000 <= 15_000)  # in phase again at once
    assert np.all(np.diff(starts) >= 985_000)  # and never two in a row


@pytest.mark.prove
def test_what_was_granted_is_what_the_system_says_and_all_is_restored():
    gc.unfreeze()  # what was set aside when the tests were collected
    before = loop.given(), gc.isenabled(), gc.get_freeze_count()
    core = min(os.sched_getaffinity(0))
    with loop.urgent(core=core, priority=20) as granted:
        assert granted.cores == tuple(os.sched_getaffinity(0)) == (core,)
        assert not gc.isenabled() and granted.quiet
        fifo = os.sched_getscheduler(0) == os.SCHED_FIFO
        assert (granted.scheduler == "fifo") == fifo == ("fifo" not in granted.denied)
        assert granted.priority == (20 if fifo else 0)
        assert granted.locked == ("lock" not in granted.denied)
    assert (loop.given(), gc.isenabled(), gc.get_freeze_count()) == before


@pytest.mark.prove
def test_a_refusal_is_told_and_the_loop_runs_all_the_same(monkeypatch):
    def refuse(*_) -> None:
        raise PermissionError(1, "Operation not permitted")

    for name in ("sched_setscheduler", "setpriority"):
        monkeypatch.setattr(os, name, refuse)
    with loop.urgent(core=10_000, nice=-20) as granted:
        record = loop.run(lambda k: None, 1e-3, 3)
    assert {"fifo", "nice", "core"} <= set(granted.denied)
    assert granted.scheduler == "other" and "not permitted" in granted.denied["fifo"]
    assert record.release[0] == 0 and record.skipped + len(record.release) == 3


@pytest.mark.prove
def test_collections_are_counted():
    record = loop.run(lambda k: gc.collect() if k == 1 else None, 1e-3, 3)
    assert record.collections >= (1 in record.release)


@pytest.mark.prove
def test_a_loop_among_busy_processes_counts_every_period():
    result = loop.among_busy(("default", "SCHED_FIFO"), busy=1, periods=100, work=1e-5)
    for row in result:
        assert np.all(np.diff(row.record.release) > 0)
        assert len(row.record.release) + row.record.skipped == 100
        assert list(row.quantiles) == sorted(row.quantiles)
        assert row.granted.scheduler == "fifo" or row.name == "default" or row.granted.denied
    assert loop.given()[0] == "other"


def test_inheritance_decides_who_is_done_first():
    without, held = inversion.measure(False), inversion.measure(True)
    assert (without.theory, held.theory) == (pytest.approx(0.12), 0.02)
    if without.denied:  # no permission: it says so, and measured nothing
        assert np.isnan(without.wait) and without.order == () and held.denied
        return
    assert without.order == ("middle", "high", "low")
    assert held.order == ("high", "middle", "low")
    # No less than the work that it has to wait for, whatever else the machine does.
    assert without.wait >= without.theory and held.wait >= 0.9 * held.theory


def test_processes_that_are_refused_end_without_a_word(tmp_path: Path):
    """A core that no machine has is refused everywhere, whatever the permissions are."""
    script = tmp_path / "refused.py"
    script.write_text(
        "from course.middleware import inversion\nif __name__ == '__main__':\n"
        "    print(inversion.measure(True, core=100_000).denied)\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.startswith("SCHED_FIFO was refused")
    # Python could not close memory that a lock still pointed into, and said so for each child.
    assert "BufferError" not in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("call", "report"),
    [
        (lambda: loop.run(print, 0.0, 1), r"period must be .*, got 0.0"),
        (lambda: loop.run(print, 1e-3, 0), r"periods must be .*, got 0"),
        (lambda: loop.urgent(scheduler="batch").__enter__(), r"scheduler must be .*, got 'batch'"),
        (lambda: loop.urgent(priority=100).__enter__(), r"priority must be .*, got 100"),
        (lambda: loop.among_busy(("none",)), r"name must be .*, got 'none'"),
        (lambda: inversion.measure(True, middle=2.0), r"middle must be .*, got 2.0"),
    ],
)
def test_bad_input(call, report):
    with pytest.raises(ValueError, match=report):
        call()
