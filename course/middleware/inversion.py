"""Priority inversion on the running system: three processes, one core, one lock.

The low one holds the lock, the high one wants it, the middle one wants nothing but the core. With
an ordinary lock the high one waits for both; if the lock hands its waiter's priority to its holder,
for the holder only. Source: Sha, Rajkumar and Lehoczky, Priority inheritance protocols, 1990; POSIX
pthread_mutexattr_setprotocol.
"""

from __future__ import annotations

import ctypes
import os
import time
from dataclasses import dataclass
from multiprocessing.shared_memory import SharedMemory
from typing import Any

from course.check import POSITIVE, finite
from course.middleware.loop import become, compute
from course.middleware.transport import UNGUARDED, elsewhere, no_answer

PRIORITIES = {"low": 10, "middle": 20, "high": 30}
_PROCESS_SHARED, _INHERIT, _PATIENCE = 1, 1, 10.0  # pthread.h, pthread.h, s


@dataclass(frozen=True)
class Inversion:
    """What was measured.

    Attributes:
        wait: of the high process for the lock [s]; NaN where the system denied it.
        theory: the same, if nobody else had the core [s].
        order: who was done when, first to last.
        denied: why nothing was measured, or "".
    """

    wait: float
    theory: float
    order: tuple[str, ...]
    denied: str = ""


def measure(
    inherit: bool, holds: float = 0.02, middle: float = 0.1, core: int | None = None
) -> Inversion:
    """Let them run once.

    Args:
        inherit: whether the holder of the lock runs at the priority of who waits for it.
        holds: processor time for which the low one holds the lock [s], at most a second.
        middle: processor time of the middle one [s], at most a second: nobody ordinary runs on that
            core meanwhile.
        core: that all three share; by default the last that this process may use.

    Returns:
        The wait; where SCHED_FIFO is not permitted, the reason.
    """
    # Longer ones would reach the time limit of the lock, and the limit would be the measured wait.
    finite("holds", holds, POSITIVE, 1.0, unit="s")
    finite("middle", middle, 0.0, 1.0, unit="s")
    # Without inheritance the high process waits for the middle one too, which never touches the
    # lock: unbounded priority inversion.
    theory = holds + (0.0 if inherit else middle)
    if not hasattr(os, "sched_setaffinity"):
        return Inversion(float("nan"), theory, (), "this system has no SCHED_FIFO")
    # On several cores they would run in parallel, and nothing would have to wait.
    core = max(os.sched_getaffinity(0)) if core is None else core
    processes = elsewhere()
    shared = SharedMemory(create=True, size=256)
    report: Any = processes.SimpleQueue()
    gates = {name: processes.Semaphore(0) for name in PRIORITIES}
    children = [
        processes.Process(
            target=_run_process, args=(role, shared.name, gates, report, core, seconds), daemon=True
        )
        for role, seconds in (("low", holds), ("middle", middle), ("high", 0.0))
    ]
    try:
        _make_lock(shared, inherit)
        for child in children:
            child.start()
        ready = [_next_report(report, children) for _ in children]  # each says what it was refused
        rejected = next((text for text in ready if text), "")
        if rejected:
            return Inversion(float("nan"), theory, (), rejected)
        # The low process starts first, takes the lock, and releases the two others itself.
        gates["low"].release()
        done = sorted(_next_report(report, children) for _ in children)
        (wait,) = (waited for _, name, waited in done if name == "high")
        return Inversion(wait, theory, tuple(name for _, name, _ in done))
    finally:
        for child in children:
            if child.pid:
                child.kill()
                child.join()
        shared.close()
        shared.unlink()


def _next_report(report: Any, children: list[Any]) -> Any:
    """Return the next report of a child: what `_run_process` puts.

    Raises:
        RuntimeError: a child died before it reported.
        TimeoutError: there is none in time.
    """
    deadline = time.monotonic() + 2.0 * _PATIENCE
    # Polling with a deadline: `get` would wait for ever on a child that died.
    while report.empty():
        if any(child.exitcode not in (None, 0) for child in children):
            raise RuntimeError(UNGUARDED)
        if time.monotonic() > deadline:
            raise no_answer("the three processes", 2.0 * _PATIENCE)
        time.sleep(0.005)
    return report.get()


def _make_lock(shared: SharedMemory, inherit: bool) -> None:
    """Make a pthread mutex in shared memory; its size is 40 bytes on 64-bit Linux."""
    # The attribute type is opaque: 64 bytes are more than any libc uses.
    libc, attributes = ctypes.CDLL(None), ctypes.create_string_buffer(64)
    libc.pthread_mutexattr_init(attributes)
    libc.pthread_mutexattr_setpshared(attributes, _PROCESS_SHARED)
    libc.pthread_mutexattr_setprotocol(attributes, _INHERIT if inherit else 0)
    lock = ctypes.c_char.from_buffer(shared.buf)  # type: ignore[arg-type]
    libc.pthread_mutex_init(ctypes.byref(lock), attributes)


def _run_process(
    role: str,
    memory_name: str,
    gates: dict[str, Any],
    report: Any,
    core: int,
    seconds: float,
) -> None:
    """Run one of the three processes; the gates open in the order low, high, middle.

    It reports twice: "" or why SCHED_FIFO was refused, then when it was done [s], its role, and its
    wait for the lock [s].
    """
    libc = ctypes.CDLL(None)
    shared = SharedMemory(memory_name)
    lock = ctypes.c_char.from_buffer(shared.buf)  # type: ignore[arg-type]
    # An absolute time limit on the lock, so that a failed experiment ends.
    limit = (ctypes.c_long * 2)(int(time.time() + _PATIENCE), 0)
    try:
        os.sched_setaffinity(0, {core})
        become(PRIORITIES[role])
    except OSError as error:
        report.put(f"SCHED_FIFO was refused: {error}")
        del lock  # it points into the memory, which Python closes when the process ends
        shared.close()
        return
    report.put("")
    if not gates[role].acquire(timeout=_PATIENCE):
        return
    start = time.monotonic()
    if role == "middle":
        compute(seconds)
    else:
        libc.pthread_mutex_timedlock(ctypes.byref(lock), limit)
        waited = time.monotonic() - start
        if role == "low":
            # The holder computes with the lock; the middle process preempts it unless it has
            # inherited the high priority.
            gates["high"].release()  # which runs at once, until it waits for the lock
            gates["middle"].release()
            compute(seconds)
        libc.pthread_mutex_unlock(ctypes.byref(lock))
    report.put((time.monotonic(), role, waited if role == "high" else 0.0))
    time.sleep(_PATIENCE)  # until it is ended: leaving takes time on the core, too
