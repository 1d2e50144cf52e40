"""Sweeps: the same anywhere, none lost by another's failure, and on where they were."""

import os
import signal
import sys
import time
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.measure.sweep import JobsFailed, sweep
from tests import optional
from tests.budget import examples

JOBS = [{"seed": seed, "size": size} for seed in range(4) for size in (2, 5)]


def draw(seed: int, size: int) -> float:
    """Depends on its arguments only."""
    return float(np.random.default_rng((seed, size)).normal(size=size).sum())


def logged(seed: int, log: str, bad: tuple[int, ...] = ()) -> int:
    with open(log, "a", encoding="utf-8") as file:
        file.write(f"{seed}\n")
    if seed in bad:
        raise ZeroDivisionError(f"seed {seed} is unlucky")
    return seed**2


def deadly(seed: int, trap: str) -> int:
    """The third job kills its worker, the first time."""
    time.sleep(0.05)
    if seed == 2 and not Path(trap).exists():
        Path(trap).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return seed**2


def ran(log: Path) -> list[int]:
    return sorted(int(line) for line in log.read_text().split())


def test_the_same_results_here_in_threads_and_in_processes():
    here = sweep(draw, JOBS)
    assert here == [draw(**job) for job in JOBS]
    executors: list[Executor] = [
        ThreadPoolExecutor(3),
        ProcessPoolExecutor(1),
        ProcessPoolExecutor(2),
    ]
    for executor in executors:
        with executor:
            assert sweep(draw, JOBS, executor) == here


@examples(15)
@given(st.sets(st.integers(0, 7)), st.booleans())
def test_a_failure_names_its_arguments_and_loses_no_other(tmp_path_factory, bad, threads):
    folder = tmp_path_factory.mktemp("sweep")
    log, saved = folder / "log", folder / "saved"
    jobs = [{"seed": s, "log": str(log), "bad": tuple(sorted(bad))} for s in range(8)]
    report: list[tuple[int, ...]] = []
    with ThreadPoolExecutor(3) as pool:
        executor = pool if threads else None
        if bad:
            with pytest.raises(JobsFailed, match=f"{len(bad)} of 8 jobs failed") as raised:
                sweep(logged, jobs, executor, saved=saved, progress=lambda *p: report.append(p))
            assert f"seed={min(bad)}" in str(raised.value) and "is unlucky" in str(raised.value)
            assert set(raised.value.errors) == bad
            assert raised.value.results == [None if s in bad else s**2 for s in range(8)]
        else:
            sweep(logged, jobs, executor, saved=saved, progress=lambda *p: report.append(p))
    assert report == [(k, 8) for k in range(1, 9)]
    assert ran(log) == list(range(8))
    # Asked again, only what failed runs again.
    log.write_text("")
    if bad:
        with pytest.raises(JobsFailed):
            sweep(logged, jobs, saved=saved)
    assert ran(log) == sorted(bad)


def test_an_interrupted_sweep_goes_on_where_it_was(tmp_path):
    log, saved = tmp_path / "log", tmp_path / "saved"
    jobs = [{"seed": s, "log": str(log)} for s in range(6)]

    def stop(done: int, jobs: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep(logged, jobs, saved=saved, progress=stop)
    assert ran(log) == [0, 1, 2]
    assert sweep(logged, jobs, saved=saved) == [s**2 for s in range(6)]
    assert ran(log) == list(range(6))
    # A file that was being written when the light went out is beside it, not in its place.
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith("saved")] == ["saved"]
    with pytest.raises(ValueError, match=r"saved must be .*, got 'a file of .*logged'"):
        sweep(draw, JOBS, saved=saved)


def test_a_worker_that_is_killed(tmp_path):
    """Processes of this machine give up then; what is done is kept, a new pool does the rest."""
    saved = tmp_path / "saved"
    jobs = [{"seed": s, "trap": str(tmp_path / "trap")} for s in range(8)]
    with ProcessPoolExecutor(2) as pool:
        with pytest.raises(JobsFailed, match="sweep again with a new one") as raised:
            sweep(deadly, jobs, pool, saved=saved)
    assert 2 in raised.value.errors
    with ProcessPoolExecutor(2) as pool:
        assert sweep(deadly, jobs, pool, saved=saved) == [s**2 for s in range(8)]


@pytest.mark.prove
@pytest.mark.optional
def test_a_worker_of_a_cluster_is_killed_and_nobody_notices(tmp_path):
    """Dask gives the jobs of a lost worker to another one."""
    try:
        from distributed import Client, LocalCluster
    except ImportError:
        optional.skip("sweeps were NOT tried on a cluster: pip install -e '.[cluster]'")
    jobs = [{"seed": s, "trap": str(tmp_path / "trap")} for s in range(12)]
    with (
        LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster,
        Client(cluster) as client,
        client.get_executor() as executor,
    ):
        assert sweep(deadly, jobs, executor) == [s**2 for s in range(12)]
        assert sweep(draw, JOBS, executor) == [draw(**job) for job in JOBS]
    assert (tmp_path / "trap").exists()


def test_bad_input_and_progress(capsys, monkeypatch):
    with pytest.raises(ValueError, match=r"two of \{seed=1, size=2\}"):
        sweep(draw, [{"seed": 1, "size": 2}, {"size": 2, "seed": 1}])
    monkeypatch.setenv("COURSE_QUIET", "0")
    assert sweep(draw, []) == []
    many = [{"seed": s, "size": 1} for s in range(20)]
    sweep(draw, many)
    assert capsys.readouterr().err == ""  # in a notebook it would look like a warning
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    sweep(draw, many)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "2 of 20 jobs" and lines[-1] == "20 of 20 jobs" and len(lines) == 10
