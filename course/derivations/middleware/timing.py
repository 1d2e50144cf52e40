"""Claims of chapter 10: executors, callbacks and loops, as promised and as they are."""

from itertools import cycle

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "T": Symbol("period of the loop [s]"),
    "C": Symbol("work in each period [s]"),
    "L": Symbol("time by which a wake-up is late [s]"),
    "J": Symbol("greatest lateness [s]"),
    "v": Symbol("velocity of the joint [rad/s]"),
}


@claim(
    "ROS 2 is not real-time by default.",
    "It is not, because its executors do not interrupt a callback. On one thread, a control "
    "callback of {control_ms:.0f} ms ended up to {worst_ms:.1f} ms after it was due, next to an "
    "image callback of {camera_ms:.0f} ms. For these two, the bound is the sum of both in each of "
    "three execution orders, one of which runs timers first. With a thread and a group of its own "
    "it took {own_ms:.0f} ms. That thread still needs a real-time priority and locked memory.",
    source="Casini and others, ECRTS 2019; ROS 2 documentation, About executors, Jazzy 2024",
)
def not_real_time_by_default(result):
    from course.middleware.executor import ORDERS, Work, bounds, respond

    short, long = (1e-3 * result.input(*x) for x in (("control_ms", 1), ("camera_ms", 25)))
    works = [Work("control", short, 0.05), Work("camera", long, 1 / 30, "subscription")]
    apart = [works[0], Work("camera", long, 1 / 30, "subscription", "own")]
    # The worst case depends on the phase, so the maximum is taken over 40 of them.
    phases = np.linspace(0.0, 1 / 3, 40)
    observed = {
        order: max(
            respond(works, order, phases=(x, 0.0), seconds=0.2)["control"].max() for x in phases
        )
        for order in ORDERS
    }
    own = max(
        respond(apart, order, 2, (x, 0.0), 0.2)["control"].max()
        for x in phases[:10]
        for order in ORDERS
    )
    worst = result.measure("worst_ms", 1e3 * max(observed.values()), 0.02)
    result.measure("own_ms", 1e3 * own, 0.01)
    report = [1e3 * bounds(works, order)["control"] for order in ORDERS]
    result.statement = "Three orders of an executor on the bus, 40 phases, and their bounds."
    result.statement_holds(all(x > 0.9 * (short + long) for x in observed.values()))
    # The simulated worst case must stay below the analytical bound of each order.
    result.correction_holds(
        all(worst <= x + 1e-6 for x in report),
        bool(own < 1.01 * short),
        max(report) < 1e3 * (short + long) + 1e-6,
    )


class Clock:
    """A clock that moves when somebody sleeps or works; wake-ups are late by what is drawn [s]."""

    def __init__(self, late):
        self.ns, self.late = 1_000_000_000, late

    def now(self):
        """Return the time [ns]."""
        return self.ns

    def sleep(self, seconds):
        """Advance by a sleep [s] and its random lateness."""
        self.ns += round(1e9 * (seconds + self.late()))

    def work(self, seconds):
        """Advance by the duration of some work [s]."""
        self.ns += round(1e9 * seconds)


def looped(late, work, periods=1000, relative=False, period=1e-3):
    """Return when the work of a loop began on such a clock [s], and its record."""
    from course.middleware import loop

    clock, begun = Clock(late), list[float]()

    def step(_):
        begun.append(1e-9 * (clock.ns - 1_000_000_000))
        clock.work(work)

    record = loop.run(step, period, periods, relative=relative, now=clock.now, sleep=clock.sleep)
    return np.array(begun), record


@claim(
    "A loop that sleeps for one period after its work runs at its rate.",
    "The sleep is added to the work and to the wake-up delay, so the rate is {formula}. With "
    "{work_us:.0f} us of work and {wake_us:.0f} us of wake-up delay it ran at {hz:.1f} instead of "
    "{asked:.0f} Hz, and fell behind by {drift_us:.0f} us in each period. A loop that sleeps until "
    "the next release stayed within {held_us:.0f} us of its releases.",
    ask=(
        "A loop works for C, then sleeps for T, and wakes up late by L each time. What is its "
        "rate?",
        "f, rate = 1/(T + C + L)",
        {
            "1/T": "That is a loop that sleeps until absolute times.",
            "1/(T + C)": "Three times pass in each cycle.",
            "1/(T - C - L)": "The loop is slower, not faster.",
            "1/(T + L)": "The loop also works before it sleeps.",
        },
    ),
    source="J. W. S. Liu, Real-Time Systems, 2000",
)
def relative_sleep(result):
    import sympy

    T, C, L, k = sympy.symbols("T C L k", positive=True)
    # k periods end at k (T + C + L), so the period is the derivative with respect to k.
    result.formula = 1 / sympy.simplify(sympy.diff(k * (T + C + L), k))
    work, wake = (1e-6 * result.input(*x) for x in (("work_us", 100), ("wake_us", 15)))
    requested = result.input("asked", 1000)

    def rate(work, wake, period, relative=True):
        # The first period has no sleep before it.
        begun = looped(lambda: wake, work, 1000, relative, period)[0][1:]
        return (begun.size - 1) / (begun[-1] - begun[0])

    begun, record = looped(lambda: wake, work, relative=True)
    result.measure("hz", rate(work, wake, 1.0 / requested), 1e-3)
    result.measure("drift_us", 1e6 * np.diff(record.lateness)[1:].mean(), 1e-3)
    held = looped(lambda: wake, work)[1]
    late = result.measure("held_us", 1e6 * held.lateness.max(), 1e-3)
    # Work and lateness from far below to above the period.
    drawn = result.rng.uniform((1e-4, 1e-6, 1e-3), (2e-3, 2e-4, 1e-2), (8, 3))
    result.statement = "The chapter's loop on a clock that only sleep and work move."
    result.statement_holds(abs(rate(work, wake, 1e-3) / requested - 1.0) < 1e-3)
    result.correction_holds(
        all(
            abs(
                rate(*map(float, x)) / float(result.formula.subs({C: x[0], L: x[1], T: x[2]})) - 1.0
            )
            < 1e-4
            for x in drawn
        ),
        late < 1e6 * wake + 1e-3,
        held.skipped == 0,
        begun.size == 1000,
        abs(rate(work, wake, 1e-3, relative=False) / requested - 1.0) < 1e-4,
    )


@claim(
    "A loop at 1 kHz with less than 1 ms of jitter is a good one.",
    "Such a jitter is a whole period. With start times uniformly random within it, the intervals "
    "between cycles were between {least_us:.0f} and {most_us:.0f} us. A velocity computed with the "
    "nominal period then has a root-mean-square error of {formula}: {wrong:.0%} of the velocity "
    "itself, and {fair:.1%} with a jitter of {good_us:.0f} us. A constant lateness causes no "
    "error; one that affects every other period causes {turns:.0%}. With the measured interval, "
    "the velocity is right.",
    ask=(
        "A loop of period T starts each cycle late by a random delay, independent of the others "
        "and uniform between 0 and J. It computes the velocity of a joint that moves at v as the "
        "change of its angle divided by T. "
        "What is the root-mean-square error?",
        "e, error = v*J/(sqrt(6)*T)",
        {
            "v*J/T": "That is the largest error.",
            "v*J/(sqrt(12)*T)": "Both ends of the interval are late.",
            "v*J/(sqrt(3)*T)": "The lateness is between 0 and J, not between -J and J.",
            "v*J/(2*T)": "The root mean square averages squared errors.",
        },
    ),
)
def jitter_below_a_period(result):
    import sympy

    T, J, v, x, y = sympy.symbols("T J v x y", positive=True)
    # Mean square of the difference of two independent uniform latenesses.
    square = sympy.integrate(sympy.integrate((x - y) ** 2, (x, 0, J)), (y, 0, J)) / J**2
    result.formula = sympy.simplify(v * sympy.sqrt(square) / T)
    good = 1e-6 * result.input("good_us", 20)

    def error(jitter, period=1e-3, periods=20_000, late=None):
        """Return the error of a velocity of 1 rad/s over the nominal period; intervals [s].

        Skipped periods are included.
        """
        late = late or (lambda: result.rng.uniform(0.0, jitter))
        begun, record = looped(late, 0.0, periods, period=period)
        intervals = np.diff(begun[1:])
        return np.sqrt(np.mean((intervals / period - 1.0) ** 2)), intervals, record.skipped

    wrong, intervals, skipped = error(0.99e-3)
    # The worst alternation: on time and almost a period late, in turn.
    other = cycle((0.0, 0.99e-3))
    turns = result.measure("turns", error(0.0, late=lambda: next(other))[0], 0.01)
    result.measure("wrong", wrong, 0.05)
    fair = result.measure("fair", error(good)[0], 0.1)
    result.measure("least_us", 1e6 * intervals.min(), 0.5)
    result.measure("most_us", 1e6 * intervals.max(), 0.05)
    drawn = [
        (float(a), float(b)) for a, b in result.rng.uniform((1e-4, 1e-3), (9e-4, 5e-3), (4, 2))
    ]
    result.statement = "The chapter's loop on a clock whose wake-ups are late by chance."
    result.statement_holds(bool(wrong < 0.05))
    result.correction_holds(
        all(
            # 3 % is several times the standard error of a root mean square of 20,000 samples.
            abs(error(j, t)[0] / float(result.formula.subs({J: j, T: t, v: 1})) - 1.0) < 0.03
            for j, t in drawn
        ),
        bool(fair < 0.02),
        skipped == 0,
        bool(turns > 2.0 * wrong),
        # A constant lateness cancels in the difference.
        bool(error(0.0, late=lambda: 0.99e-3)[0] < 1e-6),
        bool(intervals.max() > 1.9e-3),
        bool(intervals.min() < 1e-4),
    )


def control_misses(callback, start, own=False, count=1, threads=0):
    """Return whether a loop of 1 kHz that computes 0.1 ms misses its period beside callbacks [s].

    Args:
        callback: what each takes.
        start: how long after a release of the loop they come.
        own: the loop has a thread and a group of its own.
        count: how many such callbacks there are.
        threads: of the executor; 0 is one more than the loop shares.
    """
    from course.middleware.executor import Work, respond

    group = "theirs" if own else "default"
    others = [Work(f"{k}", callback, 0.05, "subscription", group) for k in range(count)]
    phases = [0.0] + [start / 0.05] * count
    works = [Work("control", 1e-4, 1e-3), *others]
    return bool(
        respond(works, "ready set", threads or 1 + own, phases, 0.2)["control"].max() > 1e-3
    )


@claim(
    "A callback of more than 1 ms makes a 1 kHz loop miss its period.",
    "A callback on another thread, in another group, does not, and one on the same thread does so "
    "only at certain moments: a callback of {long_ms:.1f} ms delayed the loop too much in "
    "{share:.0%} of all "
    "phases. Shorter callbacks can do it together: {several:.0f} of {short_ms:.1f} ms in a row "
    "made the loop miss its period {missed:.0f} of {tried:.0f} times, one alone never. What counts "
    "is the total time of everything that can run before the loop, plus the loop itself.",
)
def callback_over_a_period(result):
    # Callbacks that are barely longer than the period and begin barely before a release.
    drawn = result.rng.uniform((1.02e-3, 9e-4), (5e-3, 9.9e-4), (10, 2))
    inside, outside = (
        [control_misses(float(a), float(b), own) for a, b in drawn] for own in (False, True)
    )
    short, several = 1e-3 * result.input("short_ms", 0.5), int(result.input("several", 3))
    starts = result.rng.uniform(6e-4, 9.9e-4, int(result.input("tried", 8)))
    missed = result.measure("missed", sum(control_misses(short, x, count=several) for x in starts))
    # The control: one of the short callbacks at the same phases.
    alone = [control_misses(short, x) for x in starts]
    long, phases = 1e-3 * result.input("long_ms", 1.2), np.linspace(0.0, 1e-3, 50, endpoint=False)
    share = result.measure("share", np.mean([control_misses(long, x) for x in phases]), 0.1)
    # The same lengths, but early in the period: they end before the next release.
    early = result.rng.uniform((1.02e-3, 1.2e-4), (1.2e-3, 6e-4), (10, 2))
    result.statement = "An executor on the bus, callbacks between two releases of the loop."
    outside += [control_misses(float(a), float(b)) for a, b in early]
    # Chosen to break it: callbacks that end just too late or just in time, whenever they start.
    edges = result.rng.uniform(1.2e-4, 9.9e-4, 6)
    inside += [control_misses(1.91e-3 - float(x), float(x)) for x in edges]
    outside += [control_misses(1.89e-3 - float(x), float(x)) for x in edges]
    # A callback that is long enough may start early; a second thread does not help one group.
    inside += [control_misses(float(x), 2e-4) for x in result.rng.uniform(1.75e-3, 5e-3, 4)]
    inside += [control_misses(float(a), float(b), threads=2) for a, b in drawn[:4]]
    result.statement_holds(
        all(outside),
        only_if="both share a thread or an exclusive group, and the callback ends too late for the "
        "loop's work to end within its next period",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(missed == starts.size, not any(alone), not any(outside), share < 0.5)


def calling(
    threads, own=False, waits=True, work=0.0, seconds=3.5, apart=False, callers=1, serves=False
):
    """Return callbacks of a node that ask a service each second, on the bus.

    Args:
        threads: number of threads of the executor.
        own: the client has a group of its own; "reentrant": the common group is reentrant.
        waits: the callback waits for the answer; otherwise it returns and the answer continues it.
        work: execution time of the service [s].
        seconds: length of the run [s].
        apart: the node's other timer has a group of its own.
        callers: how many such callbacks there are, each further one in a group of its own.
        serves: the node itself serves the request, in its common group.

    Returns:
        How many answers came, who is stuck, and how often another timer of the node ran that is
        due each 0.1 s.
    """
    from course.middleware.bus import Bus, Group
    from course.middleware.executor import Executor, deadlocks

    bus, got, ticks = Bus(), list[int](), list[float]()
    node, server = bus.node("control", Executor(bus, threads)), bus.node("planner", Executor(bus))

    def serve(x):
        yield work
        return x

    (node if serves else server).service("plan", serve)
    node.group.reentrant = own == "reentrant"
    client = node.client("plan", Group("answers") if own is True else None)

    def ask():
        got.append((yield client.call(1)))

    # A generator waits inside the callback; `then` registers a continuation and returns at once.
    timer = ask if waits else lambda: client.call(1).then(got.append)
    for k in range(callers):
        node.timer(1.0, timer, group=Group(f"caller {k}") if k else None)
    node.timer(0.1, lambda: ticks.append(bus.now), group=Group("ticks") if apart else None)
    bus.run(seconds)
    return len(got), deadlocks(bus), len(ticks)


@claim(
    "A callback calls a service and waits for the reply. The reply has to be handled in the "
    "callback's own exclusive group. Enough threads make the reply arrive.",
    "Handling the reply is a callback too. In the caller's exclusive group it waits for the "
    "caller, however many threads there are: with {threads:.0f} threads {answers:.0f} "
    "replies arrived, and so with one. The cure is a group of its own or a reentrant one, together "
    "with one more thread than there are waiting callbacks: {enough:.0f} threads for one of them, "
    "{three:.0f} for two. A service of the same node must not be in the caller's group either. Or "
    "call asynchronously, and do not wait at all.",
    source="ROS 2 documentation, Using callback groups, Humble 2022",
)
def threads_cure_deadlock(result):
    threads = int(result.input("threads", 8))
    answers, stuck, _ = calling(threads)
    result.measure("answers", answers)
    enough = min(n for n in range(1, 5) if calling(n, own=True)[0] > 2)
    result.measure("enough", enough)
    # Two that wait hold two threads, and both hang.
    three = min(n for n in range(1, 6) if calling(n, own=True, callers=2, work=0.01)[0] > 2)
    result.measure("three", three)
    reentrant = min(n for n in range(1, 5) if calling(n, own="reentrant")[0] > 2)
    free = calling(1, waits=False)
    result.statement = "A timer's callback that asks a service, on the bus; who waits for whom."
    result.statement_holds(answers > 0)
    result.correction_holds(
        len(stuck) == 1,
        enough == 2,
        three == 3,
        bool(calling(1, own=True)[1]),
        free[0] > 2 and not free[1],
        not calling(2, own=True)[1],
        reentrant == enough,
        # The reply has a group of its own, but the request waits for the caller's.
        not calling(threads, own=True, serves=True)[0],
    )


@claim(
    "A service call blocks the other callbacks of its node.",
    "It blocks only those that need the exclusive group or the only free thread of the callback "
    "that waits, or of the service's own callback. (`await` in rclpy gives the "
    "thread back, but not the group.) While a service took "
    "{work_ms:.0f} ms of each second, another timer ran {held:.0f} of {due:.0f} times. It ran "
    "{free:.0f} times with an asynchronous call, and {apart:.0f} times in a group and on a thread"
    " of its own. When the same node also was the server, it ran {served:.0f} times, although no "
    "callback waited.",
)
def service_blocks(result):
    from course.middleware.bus import Bus
    from course.middleware.executor import Executor

    work = 1e-3 * result.input("work_ms", 800)

    def held(waits, work, apart=False):
        return calling(2, True, waits, float(work), 9.95, apart)[2]

    def served(work):
        """Return how often the timer ran where its own node serves, and nobody waits."""
        bus, ticks = Bus(), list[float]()
        node = bus.node("control", Executor(bus))

        def serve(x):
            yield float(work)
            return x

        node.service("plan", serve)
        client = node.client("plan")
        node.timer(1.0, lambda: (client.call(1), None)[1])
        node.timer(0.1, lambda: ticks.append(bus.now))
        bus.run(9.95)
        return len(ticks)

    due = result.measure("due", held(False, 0.001))
    ran = result.measure("held", held(True, work), 0.05)
    free = result.measure("free", held(False, work), 0.05)
    aside = result.measure("apart", held(True, work, True), 0.05)
    result.measure("served", served(work), 0.05)
    # Shares of a second that the service takes; from a quarter on, ticks must be lost.
    drawn = result.rng.uniform(0.25, 0.9, 8)
    # Chosen to break it: both are in one group, but it is reentrant and a thread is free.
    reentrant = [calling(2, "reentrant", True, float(x), 9.95)[2] < 0.9 * due for x in drawn[:4]]
    result.statement = "A node with two timers on the bus, ten seconds."
    result.statement_holds(
        free < 0.9 * due,
        only_if="they need the exclusive group of the callback that waits or of the service's own "
        "callback, or these callbacks occupy all threads (`await` in rclpy gives the thread back)",
        inside=[held(True, x) < 0.9 * due for x in drawn] + [served(x) < due for x in drawn],
        outside=[held(False, x) < 0.9 * due for x in drawn]
        + [held(True, x, apart=True) < 0.9 * due for x in drawn]
        + reentrant,
    )
    result.correction_holds(ran < 0.5 * due, free == due == aside)


def burdened(periods, litter, pages=0, **requested):
    """Record of a loop that leaves objects in cycles and takes new memory each period.

    Args:
        periods: length of the run.
        litter: how many objects.
        pages: how many pages of memory it writes to for the first time.
        **requested: options of `course.middleware.loop.urgent`.
    """
    import gc
    import mmap

    from course.middleware import loop

    retained, before, clock = [], gc.get_threshold(), Clock(lambda: 0.0)

    def work(_):
        for _ in range(litter):
            # A list that contains itself: only the cyclic collector can free it.
            ring: list = []
            ring.append(ring)
        if pages:
            retained.append(mmap.mmap(-1, 4096 * pages))
            # Writing one byte to each page forces the kernel to map it: a minor page fault.
            retained[-1][::4096] = bytes(pages)

    try:
        # CPython's long-time default thresholds, so that the count does not depend on the process.
        gc.set_threshold(700, 10, 10)
        with loop.urgent(lock=False, **requested):
            return loop.run(work, 1e-3, periods, now=clock.now, sleep=clock.sleep)
    finally:
        gc.set_threshold(*before)
        for one in retained:
            one.close()


@claim(
    "SCHED_FIFO alone makes a loop in Python real-time.",
    "The priority keeps ordinary processes away. Delays inside the program remain: in "
    "{periods:.0f} cycles that each left {litter:.0f} objects for the garbage collector, it ran "
    "{runs:.0f} times, and new memory caused page faults. With the collector switched off it ran "
    "{quiet:.0f} times. Memory has to be allocated and locked before the loop starts. And a "
    "process that has no permission for the priority runs without it.",
)
def fifo_makes_real_time(result):
    from course.middleware import loop

    periods, litter = int(result.input("periods", 200)), int(result.input("litter", 100))
    noisy = burdened(periods, litter, quiet=False)
    quiet = burdened(periods, litter, quiet=True)
    runs = result.measure("runs", noisy.collections, 0.3)
    result.measure("quiet", quiet.collections)
    fresh = burdened(20, 0, pages=64, quiet=True)
    # A core that does not exist: the request must be reported as denied and not ignored.
    with loop.urgent(core=100_000, lock=False, scheduler="other") as granted:
        rejected = list(granted.denied)
    result.statement = (
        "Under SCHED_FIFO where the system grants it; collections and faults counted."
    )
    result.statement_holds(noisy.collections == 0)
    result.correction_holds(
        runs > 10, quiet.collections == 0, fresh.faults > 10, rejected == ["core"]
    )


@claim(
    "A garbage collection in a Python node pauses the control loop.",
    "It does so only in the same Python process: all {here:.0f} collections that were counted "
    "while the loop ran were its own, and of as many in another process it counted {there:.0f}. "
    "Different processes share only the processor cores, and for these there are priorities. "
    "A thread of compiled code that needs no interpreter lock runs on during a collection.",
)
def gc_hits_the_loop(result):
    import subprocess
    import sys

    from course.middleware import loop

    def collections(apart, times):
        """Return what a loop counts in whose every period somebody collects once."""
        import gc

        code = "import gc; gc.collect(); print(sum(s['collections'] for s in gc.get_stats()))"
        theirs = []

        def work(_):
            if apart:
                # Another interpreter that certainly collects, and reports how often.
                done = subprocess.run(
                    [sys.executable, "-S", "-c", code], capture_output=True, check=True
                )
                theirs.append(int(done.stdout))
            else:
                gc.collect()

        clock = Clock(lambda: 0.0)
        with loop.urgent(scheduler="other", lock=False, quiet=True):
            record = loop.run(work, 1e-3, times, now=clock.now, sleep=clock.sleep)
        return record.collections, sum(theirs)

    def automatic(enabled):
        """Return the collections that garbage alone sets off: cycles, and nobody asks for any."""
        import gc

        def work(_):
            for _ in range(3000):
                cycle: list = []
                cycle.append(cycle)

        clock, before = Clock(lambda: 0.0), gc.isenabled()
        try:
            (gc.enable if enabled else gc.disable)()
            with loop.urgent(scheduler="other", lock=False, quiet=False):
                record = loop.run(work, 1e-3, 3, now=clock.now, sleep=clock.sleep)
        finally:
            (gc.enable if before else gc.disable)()
        return record.collections

    def compiled():
        """Return whether collections stop a thread of compiled code that holds no lock."""
        import gc
        import threading

        x = np.linspace(0.1, 1.0, 3_000_000)
        # Again if the thread had ended before a collection began.
        for _ in range(20):
            angle = np.zeros_like(x)
            thread, marks = threading.Thread(target=np.arctan2, args=(x, x, angle)), angle[::4096]
            thread.start()
            advanced = False
            while thread.is_alive() and not advanced:
                before = np.count_nonzero(marks)
                gc.collect()
                # More than it can compute between the call and the return.
                advanced = 0 < before < np.count_nonzero(marks) - 2
            thread.join()
            if advanced:
                return False
        return True

    here = result.measure("here", collections(False, 3)[0])
    other, theirs = collections(True, 3)
    result.measure("there", other)
    result.statement = "Collections counted by the chapter's loop, in its process and in another."
    result.statement_holds(
        other > 0,
        only_if="both are in the same Python process, the loop runs in the interpreter, and the "
        "collection is requested there or automatic collection is on",
        cases=True,
        # Chosen to break it: collections that nobody requests; then compiled code in the process.
        inside=[collections(False, n)[0] == n for n in (1, 5)] + [automatic(True) > 0],
        outside=[other > 0, automatic(False) > 0, compiled()],
    )
    result.correction_holds(other == 0, theirs >= 3, here == 3)
