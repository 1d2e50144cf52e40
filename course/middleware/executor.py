"""Who runs which callback when, and how long a callback waits: at most, and on the bus.

Sources: D. Casini and others, Response-time analysis of ROS 2 processing chains under
reservation-based scheduling, ECRTS 2019; T. Blass and others, A ROS 2 response-time analysis
exploiting starvation freedom and execution-time variance, RTSS 2021.
"""

import math
import threading
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import GeneratorType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.check import count, invalid, one_of, positive, vector
from course.middleware.bus import (
    START,
    Bus,
    Callback,
    Future,
    Group,
    Link,
    Sample,
    drive,
    nanoseconds,
)
from course.middleware.qos import QoS
from course.role import Stage, Trace, age

KINDS = ("timer", "subscription", "service", "client")  # the order in a ready set
ORDERS = ("ready set", "timers first", "fifo")


@dataclass(eq=False)
class Run:
    """One run of a callback: its event came, it started, it ended [ns]; end 0: not yet."""

    callback: Callback
    release: int
    start: int
    end: int = 0


class Executor:
    """Runs callbacks on a number of threads; one runs to its end before its thread takes another.

    Args:
        threads: in virtual time, numbers; in real time, threads.
        order: "ready set": what is ready is collected only when nothing of the last collection is
            left to run, and each callback in it runs once, timers before readers, services and
            clients, of a kind in the order in which they were made (since Eloquent, 2019).
            "timers first": the same, but timers are looked at before every run (before 2019).
            "fifo": what came first runs first (the events executor, 2023).

    Attributes:
        log: every run, in the order of their starts.
        running, blocked: runs that have not ended, and those of them that wait for an answer.
    """

    def __init__(self, bus: Bus, threads: int = 1, order: str = "ready set") -> None:
        self.bus, self.threads = bus, count("threads", threads, 1)
        self.order = one_of("order", order, ORDERS)
        self.callbacks: list[Callback] = []
        self.log: list[Run] = []
        self.running: list[Run] = []
        self.blocked: dict[Run, Future] = {}
        self._ready: list[Callback] = []
        self._woken = False
        bus.executors.append(self)

    def add(self, callback: Callback) -> None:
        """Add a callback to those that this executor runs."""
        self.callbacks.append(callback)
        # A stable sort: within a kind the order of creation decides, as in a ROS 2 wait set.
        self.callbacks.sort(key=lambda c: KINDS.index(c.kind))

    def ready(self, callback: Callback | None = None) -> None:
        """Look for something to run after an event, once all else at this time has come."""
        if self.bus.real:
            with self.bus.lock:
                self.bus.changed.notify_all()
        elif not self._woken:
            self._woken = True
            # At the same time, but after all arrivals: rank START is the last.
            self.bus.push(self.bus.ns, START, self._dispatch)

    def responses(self, name: str) -> NDArray[np.float64]:
        """Return the response times of all completed runs of the callbacks of this name [s].

        A response time lasts from the event to the end of the callback.
        """
        runs = (run for run in self.log if run.callback.name == name and run.end)
        return 1e-9 * np.array([run.end - run.release for run in runs], float)

    def holder(self, group: Group) -> Run | None:
        """Return the run for which the callbacks of a group wait."""
        return next((run for run in self.running if run.callback.group is group), None)

    def _begin(self) -> tuple[Run, tuple] | None:
        """Take what is next; None: nothing can run now."""
        # A reader may have nothing to give, since its samples expired: then the next callback is
        # tried.
        while (callback := self._pick()) is not None:
            release = callback.oldest()
            given = callback.take()
            if given is not None and release is not None:
                run = Run(callback, release, self.bus.tick())
                self.running.append(run)
                self.log.append(run)
                return run, given
        return None

    def _pick(self) -> Callback | None:
        if len(self.running) >= self.threads:
            return None
        # Mutual exclusion: a group that is not reentrant runs one callback at a time.
        waiting = [
            c
            for c in self.callbacks
            if c.oldest() is not None and (c.group.reentrant or not self.holder(c.group))
        ]
        # FIFO: the callback whose event has waited longest.
        if self.order == "fifo" or not waiting:
            return min(waiting, key=lambda c: c.oldest() or 0, default=None)
        if self.order == "timers first" and waiting[0].kind == "timer":
            return waiting[0]
        # Ready set: collect all ready callbacks, run each once, then collect again (Casini et al.,
        # 2019).
        if not any(c in waiting for c in self._ready):
            # The collection holds what is ready now, including callbacks whose group is held.
            self._ready = [c for c in self.callbacks if c.oldest() is not None]
        picked = next(c for c in self._ready if c in waiting)
        self._ready.remove(picked)
        return picked

    def _dispatch(self) -> None:
        self._woken = False
        while (begun := self._begin()) is not None:
            run, given = begun
            # A function has already run by its return; a generator runs on the bus's time.
            steps = run.callback.function(*given)
            if type(steps) is GeneratorType:
                drive(self.bus, steps, partial(self._finish, run), partial(self._block, run))
            else:
                self._finish(run)

    def _finish(self, run: Run, _: Any = None) -> None:
        run.end = self.bus.tick()
        self.running.remove(run)
        self.ready()

    def _block(self, run: Run, future: Future | None) -> None:
        if future is None:
            self.blocked.pop(run, None)
        else:
            self.blocked[run] = future

    def start(self) -> list[threading.Thread]:
        """Start its threads, and return them, for as long as the bus runs in real time.

        A callback that waits for an answer when it ends will never continue.
        """
        threads = [threading.Thread(target=self._work, daemon=True) for _ in range(self.threads)]
        for thread in threads:
            thread.start()
        return threads

    def _work(self) -> None:
        bus = self.bus
        while True:
            with bus.lock:
                begun = None
                # Threads wait on the bus's condition: any event may have made a callback ready.
                while bus.real and begun is None:
                    begun = self._begin()
                    if begun is None:
                        bus.changed.wait()
                if begun is None:
                    return
                run, given = begun
            # Outside the lock: callbacks of several threads run at the same time.
            steps, value = run.callback.function(*given), None
            while type(steps) is GeneratorType:
                try:
                    request = steps.send(value)
                except StopIteration:
                    break
                # A thread that waits for an answer does no other work: this is how executors
                # deadlock.
                if isinstance(request, Future):
                    with bus.lock:
                        self._block(run, request)
                        while bus.real and not request.done:
                            bus.changed.wait()
                        if not request.done:
                            return
                        self._block(run, None)
                    value = request.value
                else:
                    time.sleep(request)
                    value = None
            with bus.lock:
                self._finish(run)


def deadlocks(bus: Bus) -> list[str]:
    """Return why runs that wait for an answer will never get it, empty if all may get theirs.

    A request to a service that nobody served is lost, whatever the executors do.

    An answer needs its server's callback to run, then its client's. One of them is stuck if its
    group is held, or all threads of its executor are, by runs that are stuck themselves; who is not
    is struck off until nobody is left who can go on.
    """
    # Every blocked run is suspected first; the fixed point of removals is the set that is stuck.
    stuck = {run: future for each in bus.executors for run, future in each.blocked.items()}

    def hindrance(needed: Callback) -> str:
        executor = needed.node.executor
        if not isinstance(executor, Executor):
            return ""
        held = executor.holder(needed.group)
        if held and held in stuck and not needed.group.reentrant:
            return f"{needed.group.name}, held by {_name(held.callback)}"
        if sum(run in stuck for run in executor.running) < executor.threads:
            return ""
        return "a thread, all held by " + ", ".join(_name(r.callback) for r in executor.running)

    while True:
        # Remove runs that can proceed until none is left; what remains waits for itself.
        free = [
            run
            for run, future in stuck.items()
            if not future.unserved and not any(map(hindrance, future.needs))
        ]
        if not free:
            break
        for run in free:
            del stuck[run]
    reasons = []
    for run, future in stuck.items():
        if future.unserved:
            reasons.append(
                f"{_name(run.callback)} waits for the service {future.unserved!r}, which nobody "
                "served when it was called: wait for the service first"
            )
            continue
        reasons += [
            f"{_name(run.callback)} waits for {_name(need)}, which needs {hindrance(need)}"
            for need in future.needs
            if hindrance(need)
        ]
    return reasons


def _name(callback: Callback) -> str:
    if callback.kind == "timer":  # it has no name of its own
        return f"the timer of {callback.node.name}"
    return f"{callback.kind} {callback.name} of {callback.node.name}"


# --- How long a callback waits, at most -----------------------------------------------------------


@dataclass(frozen=True)
class Work:
    """A callback that computes for `execution` [s], at most once a `period` [s].

    kind: of its event, "timer" or "subscription" (of depth 1). group: its exclusive group; "": it
    is in a reentrant one.
    """

    name: str
    execution: float
    period: float
    kind: str = "timer"
    group: str = "default"

    def __post_init__(self) -> None:
        positive(f"execution of {self.name}", self.execution, unit="s")
        positive(f"period of {self.name}", self.period, unit="s")
        one_of(f"kind of {self.name}", self.kind, KINDS[:2])


def bounds(works: Sequence[Work], order: str = "ready set", threads: int = 1) -> dict[str, float]:
    """Return the longest response time of each callback [s]; infinite where none is found.

    With S the sum of all executions:

    - fifo: S, as of each callback one event waits at most; on top the longest execution of those
      that come again within it, as one may run while its next event waits.
    - ready set: what is left of the collection that runs, without the callback itself; of the next
      one, those before it; its own. One that can't come again within two collections counts once.
    - timers first, of a timer: the longest run that has begun, and what is due of the timers before
      it (fixed priorities without preemption); of a reader, the ready set of readers, and timers.
    - with a thread for each group, a group waits for itself only, for a busy period at most.

    ValueError: for fewer threads than groups, but for one thread.
    """
    one_of("order", order, ORDERS)
    groups: dict[str, list[Work]] = {}
    for work in works:
        groups.setdefault(work.group or f"alone: {work.name}", []).append(work)
    if 1 < count("threads", threads, 1) < len(groups):
        raise invalid("threads", threads, f"1, or at least one for each of {len(groups)} groups")
    if threads == 1:
        return _single(sorted(works, key=lambda w: KINDS.index(w.kind)), order)
    # A reentrant callback may overlap with itself: the busy-period analysis covers runs within
    # their period only.
    long = [w.name for w in works if not w.group and w.execution > w.period]
    if long:
        raise invalid("reentrant callbacks", long, "executions up to the period")
    result: dict[str, float] = {}
    if order == "fifo":
        for group in groups.values():
            result |= _single(group, order)
        return result
    for group in groups.values():
        # With a thread for each group, only callbacks of the same group delay each other.
        S = sum(w.execution for w in group)
        # Busy period of the group: the least fixed point of its own demand.
        busy = _least(S, 0.0, group, lambda w, x: math.ceil(x / w.period - 1e-9))
        result |= {w.name: busy for w in group}
    return result


def _single(works: Sequence[Work], order: str) -> dict[str, float]:
    S, result = sum(w.execution for w in works), dict[str, float]()
    if order == "fifo":
        R, before = S, 0.0
        while R > before:  # what comes again before it has ended may run and wait at once
            again = max((w.execution for w in works if w.period < R), default=0.0)
            R, before = S + again, R
        return {w.name: R for w in works}
    timers = [w for w in works if w.kind == "timer" and order == "timers first"]
    for i, timer in enumerate(timers):
        # Not preemptive: a lower callback that has just begun blocks for its whole execution.
        begun = max(w.execution for w in works if w not in timers[:i])
        result[timer.name] = _start(begun, 0.0, timers[:i]) + timer.execution
    rest = [w for w in works if w not in timers]
    S = sum(w.execution for w in rest)
    late = max(result.values(), default=0.0)
    for i, work in enumerate(rest):
        # Its event may just miss a ready set: it waits for that set, and for its turn in the next.
        two = 2.0 * S - work.execution
        start = S - work.execution + sum(w.execution for w in rest[:i] if timers or w.period <= two)
        for base in (start, max(start, S)):  # the second: it runs itself when its event comes
            result[work.name] = _start(base, late, timers) + work.execution
            if result[work.name] <= work.period:
                break
    return result


def _start(base: float, late: float, before: Sequence[Work]) -> float:
    """Return the least x that holds `base` and all runs of what goes before in [-late, x]."""
    return _least(base, base, before, lambda w, x: math.floor((x + late) / w.period + 1e-9) + 1)


def _least(x: float, base: float, works: Sequence[Work], runs: Callable) -> float:
    """Return the least fixed point of x = base + sum of C runs(x) from x on.

    Infinite where there is none.
    """
    # At a utilization of 1 or more the demand never falls behind the time: no fixed point.
    if sum(w.execution / w.period for w in works) >= 1.0 or math.isinf(base):
        return math.inf
    while (more := base + sum(w.execution * runs(w, x) for w in works)) > x + 1e-12:
        x = more
    return x


def respond(
    works: Sequence[Work],
    order: str = "ready set",
    threads: int = 1,
    phases: Sequence[float] = (),
    seconds: float = 10.0,
) -> dict[str, NDArray[np.float64]]:
    """Simulate callbacks on the bus and return their response times [s].

    Arguments are those of `bounds`.

    Args:
        works: the callbacks.
        order: which of several ready callbacks runs first.
        threads: of the executor.
        phases: of each one's first event, shares of its period; all at once where there are none.
        seconds: simulated time [s].
    """
    bus = Bus()
    executor = Executor(bus, threads, order)
    # Every callback of an exclusive group shares one `Group`; the unnamed one is reentrant.
    groups = {w.group: Group(w.group, not w.group) for w in works}
    for k, work in enumerate(works):
        node, source = bus.node(work.name, executor), bus.node("source")
        phase = phases[k] if phases else 0.0

        def compute(*_: Sample, seconds: float = work.execution):
            yield seconds

        if work.kind == "timer":
            node.timer(work.period, compute, phase, groups[work.group])
        else:
            node.reader(work.name, compute, QoS(depth=1), group=groups[work.group])
            out = source.writer(work.name)
            source.timer(work.period, lambda out=out: (out.publish(None), None)[1], phase)
    bus.run(seconds)
    return {work.name: executor.responses(work.name) for work in works}


# --- Chapter 0 on the bus -------------------------------------------------------------------------


def run_chain(
    stages: Sequence[Stage], phases: Sequence[float], seed: int = 0, seconds: float = 10.0
) -> Trace:
    """Run chapter 0's chain as nodes on the bus.

    Each stage is a node, each queue a reader's keep-last cache, each loss a link's.

    Args:
        stages: as for `course.role.simulate`, whose rules these are.
        phases: of the first starts, as shares of each period, shape (n,).
        seed: as for `course.role.simulate`.
        seconds: simulated time [s].

    Returns:
        When each command came into force, and when its measurement was taken, for `Trace.age`.
    """
    age(
        [replace(stage, lost=0.0, jitter=0.0) for stage in stages]
    )  # raises; loss and jitter are allowed here
    shares = vector("phases", phases, (len(stages),))
    bus, arrived = Bus(seed), list[tuple[float, float]]()
    for k in range(len(stages)):
        _stage(bus, stages, k, shares[k])
    command = bus.node("actuator")
    command.reader(
        f"{len(stages)}",
        lambda sample: arrived.append((bus.now, sample.value)),
        LOSSY,
        Link(loss=stages[-1].lost),
    )
    bus.run(seconds)
    published, captured = np.array(arrived, float).reshape(-1, 2).T
    # Commands may overtake each other with jitter: the newest capture so far is in force.
    return Trace(published, np.maximum.accumulate(captured))


LOSSY = QoS("best_effort", depth=1)


def _stage(bus: Bus, stages: Sequence[Stage], k: int, phase: float) -> None:
    """Make a stage a node: it reads topic k, and writes to topic k + 1 when a capture was made."""
    stage, until, newest = stages[k], 0, -math.inf
    waits = stage.period or stage.overload == "queue"
    node = bus.node(stage.name, Executor(bus) if stage.overload == "queue" else None)
    out = node.writer(f"{k + 1}", LOSSY)

    def work(sample: Sample | None = None) -> Generator:
        nonlocal until, newest
        # Still busy with the last one: this start is skipped.
        if stage.overload != "pipelined" and bus.ns < until - 1:  # a period may round up
            return
        if inbox and not sample:
            sample = inbox.take()
        # The newest measurement seen so far: a late older one does not replace it.
        newest = captured = max(newest, sample.value if sample else newest) if k else bus.now
        seconds = stage.execution
        if stage.jitter:
            seconds += stage.jitter * bus.rng.uniform(-1.0, 1.0)
        until = bus.ns + nanoseconds(seconds)
        yield seconds
        if captured > -math.inf:
            out.publish(captured)

    inbox = None
    if k:
        qos, link = replace(LOSSY, depth=stage.depth if waits else 1), Link(loss=stages[k - 1].lost)
        inbox = node.reader(f"{k}", None if stage.period else work, qos, link)
    if stage.period:
        node.timer(stage.period, work, phase)
