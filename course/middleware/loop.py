"""A periodic loop on the running system: when it woke, what it skipped, and what it was granted.

Release k of a loop is at start + k * period, whatever happened before. A loop that sleeps for a
period after its work instead is late by its work and its wake-up time once more in each period.
Times are taken from the clock in whole nanoseconds. Sources: J. W. S. Liu, Real-Time Systems, 2000,
sec. 3.3 (releases); sched(7) and mlockall(2) of the Linux manual (what is asked for).
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from course.check import count, one_of, positive

MCL_CURRENT, MCL_FUTURE = 1, 2  # sys/mman.h


@dataclass(frozen=True)
class Record:
    """What a loop did.

    Attributes:
        release: the index of each period that ran, shape (n,), rising.
        lateness: from the release to the start of the work, shape (n,) [s]; of a relative loop from
            where an ideal clock would have started it.
        skipped: periods that were over, or begun, before there was time for them.
        faults: page faults of this process meanwhile, those without and those with reading a disk.
        collections: runs of the garbage collector meanwhile.
    """

    release: NDArray[np.int64]
    lateness: NDArray[np.float64]
    skipped: int
    faults: int
    collections: int


def run(
    work: Callable[[int], object],
    period: float,
    periods: int,
    *,
    relative: bool = False,
    now: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], object] = time.sleep,
) -> Record:
    """Call work(k) at start + k * period for the k below `periods`, those that are past left out.

    A loop that is late by several periods runs once and goes on with the next release that is
    still to come, in phase: no bunch of calls, and no drift.

    Args:
        work: called with the index of the period.
        period: between releases [s].
        periods: how many releases there are, at least 1; that is when the loop ends.
        relative: sleep for a period after each work instead, as loops are often written. Then each
            call is made, `periods` in all.
        now: the clock [ns].
        sleep: function that waits for a time [s].

    Returns:
        What was run when.
    """
    step, last = round(1e9 * positive("period", period, unit="s")), count("periods", periods, 1)
    release = np.zeros(last, np.int64)
    late = np.zeros(last)
    before = _burden()
    start = now()
    k = n = 0
    while k < last:
        # Absolute releases (start + k period) do not drift; a relative sleep adds every lateness to
        # the next period.
        wait = start + k * step - now() if not relative else step * (k > 0)
        if wait > 0:
            sleep(1e-9 * wait)
        release[n], late[n] = k, 1e-9 * (now() - start - k * step)
        n += 1
        work(k)
        # The first release that is not past yet: rounded up.
        k = k + 1 if relative else max(k + 1, -((start - now()) // step))
    faults, collections = (a - b for a, b in zip(_burden(), before, strict=True))
    return Record(release[:n], late[:n], last - n, faults, collections)


# Page faults and collections are the usual causes of outliers in lateness.
def _burden() -> tuple[int, int]:
    import resource

    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_minflt + usage.ru_majflt, sum(s["collections"] for s in gc.get_stats())


# --- What is asked for, and what is granted -------------------------------------------------------


@dataclass(frozen=True)
class Granted:
    """What the system has given, read back from it; `denied` says why the rest was not.

    Attributes:
        scheduler: "other" or "fifo".
        priority: of SCHED_FIFO, 0 under "other".
        nice: from -20, the most urgent, to 19; without meaning under "fifo".
        cores: on which this process may run.
        locked: whether its memory stays in memory.
        quiet: whether the garbage collector is off, and what there was is left alone.
        denied: the system's reason, by what was requested.
    """

    scheduler: str
    priority: int
    nice: int
    cores: tuple[int, ...]
    locked: bool
    quiet: bool
    denied: dict[str, str] = field(default_factory=dict)


@contextlib.contextmanager
def urgent(
    *,
    scheduler: str = "fifo",
    priority: int = 50,
    nice: int = 0,
    core: int | None = None,
    lock: bool = True,
    quiet: bool = True,
) -> Iterator[Granted]:
    """Ask the system for what a real-time loop needs, and undo it at the end.

    The undoing assumes an ordinary process: afterwards it has the ordinary scheduler again, none of
    its memory is locked, and the collector treats all objects alike. An ordinary user may raise
    `nice` but not lower it again; then it stays raised.

    Args:
        scheduler: "fifo": runs whenever it can, before all ordinary processes; or "other".
        priority: of SCHED_FIFO, 1 to 99.
        nice: of an ordinary process, -20 to 19; 0 changes nothing.
        core: the only one to run on; None asks for nothing.
        lock: keep the pages of this process in memory, so that none is fetched in a period.
        quiet: switch the garbage collector off, and set aside what there is (`gc.freeze`).

    Yields:
        What was granted. A refusal is no error: it stands in `denied`.
    """
    one_of("scheduler", scheduler, ("fifo", "other"))
    count("priority", priority, 1, 99)
    rejected: dict[str, str] = {}
    libc = ctypes.CDLL(None, use_errno=True)

    def only(*cores: int) -> None:
        os.sched_setaffinity(0, cores)

    def polite(value: int) -> None:
        os.setpriority(os.PRIO_PROCESS, 0, value)

    # mlockall: pages that are swapped out or not yet mapped would cost a page fault in the loop.
    def locked(flags: int) -> None:
        if libc.mlockall(flags):
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))

    # The exit stack undoes whatever was granted, in reverse order, also after an error.
    with contextlib.ExitStack() as stack:

        def ask(name: str, call: Callable[[], object], undo: Callable[[], object]) -> bool:
            try:
                call()
            except (OSError, AttributeError, ValueError) as error:
                rejected[name] = str(error)
                return False
            stack.callback(undo)
            return True

        if quiet:
            # Off: no collection starts by itself. Frozen: one that the loop asks for does not
            # traverse the objects that exist now.
            was = gc.isenabled()
            gc.collect()
            gc.freeze()
            stack.callback(gc.unfreeze)
            gc.disable()
            stack.callback(gc.enable if was else gc.disable)
        if core is not None:
            cores = given()[3]
            ask("core", lambda: only(core), lambda: only(*cores))
        held = lock and ask("lock", lambda: locked(MCL_CURRENT | MCL_FUTURE), libc.munlockall)
        if nice:
            old = os.getpriority(os.PRIO_PROCESS, 0)

            def lower() -> None:
                with contextlib.suppress(PermissionError):
                    polite(old)

            ask("nice", lambda: polite(nice), lower)
        if scheduler == "fifo":
            ask("fifo", lambda: become(priority), lambda: become(0))  # 0: the ordinary scheduler
        # The scheduler, the priority and the cores are read back: a request may be granted in part.
        yield Granted(*given(), held, quiet, rejected)


def become(priority: int = 0) -> None:
    """Put this process under SCHED_FIFO, or with priority 0 back under the ordinary scheduler."""
    kind = os.SCHED_FIFO if priority else os.SCHED_OTHER
    os.sched_setscheduler(0, kind, os.sched_param(priority))


def given() -> tuple[str, int, int, tuple[int, ...]]:
    """Return scheduler, priority, niceness and cores of this process, as the system says."""
    nice = os.getpriority(os.PRIO_PROCESS, 0)
    if not hasattr(os, "sched_getscheduler"):
        return "other", 0, nice, ()
    fifo = os.sched_getscheduler(0) == os.SCHED_FIFO
    priority = os.sched_getparam(0).sched_priority
    return "fifo" if fifo else "other", priority, nice, tuple(sorted(os.sched_getaffinity(0)))


# --- The loop among busy processes ----------------------------------------------------------------


@dataclass(frozen=True)
class Tried:
    """One row of the table: what was asked for, what was granted, what came of it.

    Attributes:
        name: the requested policy.
        granted: the policy in force, read back from the system.
        record: of the loop.
        quantiles: lateness of half, of 99 % and of all of the periods that ran [s].
    """

    name: str
    granted: Granted
    record: Record
    quantiles: tuple[float, float, float]


ASKED: dict[str, dict[str, object]] = {
    "default": {"scheduler": "other", "lock": False, "quiet": False},
    "niceness -20": {"scheduler": "other", "nice": -20, "lock": False, "quiet": False},
    "SCHED_FIFO": {"scheduler": "fifo", "priority": 50},
}


def among_busy(
    names: Sequence[str] = tuple(ASKED),
    *,
    busy: int = 4,
    period: float = 1e-3,
    periods: int = 1500,
    work: float = 1e-4,
) -> list[Tried]:
    """Run a loop that computes for `work` [s] in each period while other processes compute.

    Args:
        names: rows of `ASKED`, each a run of its own.
        busy: processes that compute meanwhile; they end with the run, and by themselves.
        period: of the loop [s].
        periods: of each run.
        work: processor time in each period [s].
    """
    result = []
    for name in names:
        one_of("name", name, ASKED)
    # Other processes compete for the cores: on an idle machine every scheduler looks good.
    with crowd(busy, 20.0 + 4.0 * len(names) * period * periods):
        for name in names:
            with urgent(**ASKED[name]) as granted:  # type: ignore[arg-type]
                record = run(lambda k: compute(work), period, periods)
            late = tuple(np.quantile(record.lateness, (0.5, 0.99, 1.0)).tolist())
            result.append(Tried(name, granted, record, late))
    return result


def compute(seconds: float) -> None:
    """Compute until this thread has used so much processor time [s]."""
    # Processor time, so that a preempted thread still computes for the full duration.
    end = time.thread_time() + seconds
    while time.thread_time() < end:
        pass


@contextlib.contextmanager
def crowd(busy: int, seconds: float) -> Iterator[None]:
    """Start processes that compute, at most for a given time [s]; none is left at the end."""
    spin = f"import time\nend = time.monotonic() + {seconds}\nwhile time.monotonic() < end: pass"
    children = [
        subprocess.Popen([sys.executable, "-S", "-c", spin]) for _ in range(count("busy", busy))
    ]
    try:
        time.sleep(0.2 if busy else 0.0)  # until they run
        yield
    finally:
        for child in children:
            child.kill()
        for child in children:
            child.wait()
