"""Claims of chapter 10: deadlines, locks, executors and loops, as promised and as they are."""

from itertools import cycle, permutations

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "u": Symbol("utilization of the first task", 0.05, 0.95),
    "T": Symbol("period of the loop [s]"),
    "C": Symbol("work in each period [s]"),
    "L": Symbol("time by which a wake-up is late [s]"),
    "J": Symbol("greatest lateness [s]"),
    "v": Symbol("velocity of the joint [rad/s]"),
}


@claim(
    "Tasks that use more of a core than Liu and Layland's bound miss their deadlines.",
    "By rate, for tasks that can be interrupted, it suffices and is not needed: with {load:.0%}, "
    "above the bound of {bound:.1%}, {meet:.0%} of {sets:.0f} random sets of {n:.0f} tasks met all "
    "deadlines, and periods that divide one another do up to a full core. Beside one task that "
    "uses u, another is safe up to {formula} whatever its period. Callbacks of an executor, which "
    "can't be interrupted, missed with {two:.0%}, below the bound for two.",
    ask=(
        "Two tasks under rate-monotonic priorities, of which one uses the share u of the core. Up "
        "to which share of the other is no deadline missed, whatever the periods?",
        "U, share = (1 - u)/(1 + u)",
        {
            "1 - u": "That is a full core, for periods that divide one another.",
            "2*(sqrt(2) - 1) - u": "That is Liu and Layland's sum, which promises less.",
            "ln(2) - u": "That is the sum for many tasks.",
            "(1 - u)^2": "Both shares plus 1, multiplied, may be 2.",
        },
    ),
    source="Liu and Layland, 1973; Bini, Buttazzo and Buttazzo, A hyperbolic bound, 2001",
)
def liu_layland_says_no(result):
    import sympy

    from course.middleware.executor import Work, respond
    from course.middleware.schedule import breakdown, liu_layland, random_sets, response_times

    # Hyperbolic bound of Bini and Buttazzo for two tasks: (u + 1) (x + 1) <= 2.
    u, x = sympy.symbols("u x", positive=True)
    result.formula = sympy.factor(sympy.solve(sympy.Eq((u + 1) * (x + 1), 2), x)[0])
    n, sets = int(result.input("n", 4)), int(result.input("sets", 1000))
    load = result.input("load", 0.85)
    bound = result.measure("bound", liu_layland(n))
    # The load is above the bound, so the bound alone would reject every one of these sets.
    C, T = random_sets(n, load, sets, result.rng)
    meet = result.measure("meet", np.isfinite(response_times(C, T)).all(axis=0).mean(), 0.15)

    def safe(share, other, ratios):
        """Return whether two tasks meet their deadlines at all these ratios of periods.

        Both orders are tried: either task may have the shorter period.
        """
        pairs = [
            (np.array([share, other]), np.stack([np.ones_like(ratios), ratios])),
            (np.array([other, share]), np.stack([np.ones_like(ratios), ratios])),
        ]
        return all(np.isfinite(response_times(a[:, None] * t, t)).all() for a, t in pairs)

    ratios, shares = np.linspace(1.0, 3.0, 801), result.rng.uniform(0.05, 0.9, 12)
    report = [(float(a), float(result.formula.subs(u, a))) for a in shares]
    # The worst ratio of periods of all: there a little more is too much.
    worst = [np.append(ratios, [1.0 + a, 1.0 + b]) for a, b in report]
    short, long = Work("control", 1e-3, 0.02), Work("camera", 0.025, 1 / 30, "subscription")
    two = result.measure("two", sum(w.execution / w.period for w in (short, long)))
    # The camera's callback begins 2 ms before control is released, and nothing interrupts it.
    waits = respond([short, long], "timers first", 1, (0.1, 0.0), 0.2)["control"].max()
    result.statement = "Exact response times of random sets, and of pairs at 800 ratios of periods."
    result.statement_holds(meet < 0.01)
    result.correction_holds(
        meet > 0.5,
        load > bound,
        two < liu_layland(2),
        bool(waits > short.period),
        # From 0.1 % below to 1 % above the formula, checked with exact response times.
        all(safe(a, b * 0.999, r) for (a, b), r in zip(report, worst, strict=True)),
        not any(safe(a, b * 1.01, r) for (a, b), r in zip(report, worst, strict=True)),
        abs(float(breakdown([0.1, 0.2, 0.4], [1.0, 2.0, 4.0])) - 1.0) < 1e-6,
    )


@claim(
    "No task answers later than when all are released at once.",
    "So it is for tasks that are in time, can be interrupted and never wait: the "
    "response times of the analysis were those of a run from that moment in all {sets:.0f} random "
    "sets, and {later:.0f} of {tried:.0f} runs with other phases were later. With locks or a late "
    "release the terms for blocking and jitter come on top.",
    source="Liu and Layland, 1973; Audsley and others, 1993",
)
def critical_instant(result):
    from course.middleware.schedule import random_sets, response_times, run

    sets = int(result.input("sets", 400))
    C, T = random_sets(4, 0.85, sets, result.rng)
    # Audsley's fixed-point iteration on one side, a simulation of the schedule on the other.
    text = response_times(C, T)
    meets = np.isfinite(text)
    first = run(C, T, 2.0)
    equal = np.abs(first.longest - text)[meets].max() < 1e-9
    # Random phases try to break the claim: a single later answer would.
    phases = [run(C, T, 2.0, phase=result.rng.random(T.shape) * T).longest for _ in range(5)]
    later = [np.any((observed > first.longest + 1e-9) & meets, axis=0).sum() for observed in phases]
    result.measure("later", sum(later))
    result.measure("tried", sum(observed.shape[1] for observed in phases))
    held = response_times(C, T, 1e-3)
    result.statement = "The analysis, runs from the critical instant, and runs with other phases."
    result.statement_holds(sum(later) == 0)
    late = np.zeros_like(T)
    # Release jitter of half a period on the first task, which the plain analysis doesn't know.
    late[0] = 0.5 * T[0]
    output, ran = response_times(C, T, jitter=late), run(C, T, 2.0, jitter=late).longest
    # The runs exceed the critical instant's response, but not the analysis that has the jitter
    # term.
    result.correction_holds(
        bool(equal),
        bool(np.array_equal(first.late == 0, meets)),
        bool(np.any((ran > first.longest + 1e-9)[1:] & meets[1:])),
        not np.any((ran > output + 1e-9) & np.isfinite(output)),
        bool(np.all(held >= text)),
        meets.mean() > 0.5,
    )


@claim(
    "Among fixed priorities none does better than the shorter period first.",
    "Where each deadline is the period, each can be interrupted, nobody waits or is released late, "
    "and all can come at once: of {sets:.0f} random sets of four tasks {some:.0f} were in time "
    "under some order and all of these by rate. In an order that knows nothing of periods "
    "{wrong:.0%} of them were. Deadlines shorter than periods want the shorter deadline first.",
    source="Liu and Layland, 1973; Leung and Whitehead, 1982",
)
def by_rate_is_best(result):
    from course.middleware.schedule import random_sets, response_times

    C, T = random_sets(4, 0.85, int(result.input("sets", 400)), result.rng, ratio=20.0)
    orders = [list(order) for order in permutations(range(4))]
    # Exhaustive: all 24 orders, so "none does better" is checked and not sampled.
    good = np.array([np.isfinite(response_times(C[o], T[o])).all(axis=0) for o in orders])
    some = good.any(axis=0)
    result.measure("some", some.sum(), 0.1)
    wrong = result.measure("wrong", good[:, some].mean(), 0.2)
    # A slow task with an early deadline is in time in front of a quicker one, and not behind it.
    late = response_times([0.3, 0.2], [1.0, 2.0])[1], response_times([0.2, 0.3], [2.0, 1.0])
    # Some tasks are released up to 0.6 of a period late, which breaks the optimality of the order.
    J = T * np.where(result.rng.random(T.shape) < 0.3, 0.6, 0.0)
    jitter = np.array(
        [np.isfinite(response_times(0.8 * C[o], T[o], 0.0, J[o])).all(axis=0) for o in orders]
    )
    result.statement = "Exact response times in all 24 orders of priority."
    result.statement_holds(bool(np.array_equal(good[0], some)))
    result.correction_holds(
        wrong < 0.8,
        some.sum() > 100,
        jitter[0].sum() < jitter.any(axis=0).sum(),
        bool(late[0] > 0.25),
        bool(late[1][0] < 0.25),
        bool(np.isfinite(late[1][1])),
    )


def high_waits(protocol, section, middle, between):
    """Return how long a high task waits for a low one's section, with tasks between them [s]."""
    from course.middleware.schedule import run

    n = between + 2
    # The low task takes the lock at 0, the high one asks for it 1 us later, the others come after
    # that: the order that inverts priorities.
    observed = run(
        [0.01] + [middle] * between + [section],
        [60.0] * n,
        60.0,
        phase=[1e-6] + [2e-6] * between + [0.0],
        section=[0.01] + [0.0] * between + [section],
        lock=[0] + [-1] * between + [0],
        protocol=protocol,
    )
    return float(observed.longest[0]) - 0.01


@claim(
    "A task of high priority waits for a lock no longer than a lower one holds it.",
    "A lock that hands nothing on also lets it wait for all between: for a section of "
    "{section_ms:.0f} ms and tasks of {middle_ms:.0f} ms, {one_ms:.0f} ms with one of them and "
    "{five_ms:.0f} ms with five. With inheritance or a ceiling it is {held_ms:.0f} ms, and "
    "what computes above it comes on top: {top_ms:.0f} ms below one more of those. On Linux "
    "Python's locks and std::mutex have neither.",
    source="Sha, Rajkumar and Lehoczky, Priority inheritance protocols, 1990",
)
def inversion_is_bounded(result):
    from course.middleware.schedule import run

    section, middle = (1e-3 * result.input(*x) for x in (("section_ms", 20), ("middle_ms", 100)))

    def bounded(protocol, hold, between, count):
        return high_waits(protocol, float(hold), float(between), int(count)) < hold + 1e-6

    one, five = (high_waits("none", section, middle, n) for n in (1, 5))
    kinds = ("inheritance", "ceiling")
    held = [high_waits(kind, section, middle, 5) for kind in kinds]
    result.measure("one_ms", 1e3 * one, 1e-3)
    result.measure("five_ms", 1e3 * five, 1e-3)
    result.measure("held_ms", 1e3 * max(held), 1e-3)
    top = [
        run(
            [middle, 0.01, section],
            [60.0] * 3,
            60.0,
            phase=[2e-6, 1e-6, 0.0],
            section=[0.0, 0.01, section],
            lock=[-1, 0, 0],
            protocol=kind,
        ).longest[1]
        - 0.01
        for kind in kinds
    ]
    result.measure("top_ms", 1e3 * max(top), 1e-3)
    # From one to six tasks in between: with an unbounded inversion the wait must grow with them.
    drawn = result.rng.uniform((0.001, 0.01, 1.0), (0.1, 0.5, 6.99), (8, 3))
    result.statement = "Three to eight tasks and a lock on one simulated core."
    result.statement_holds(
        one < section + 1e-6,
        only_if="the lock hands on the priority of who waits, or has a ceiling, its "
        "holder waits for no other, and nobody is above",
        inside=[bounded(kind, *x) for x in drawn for kind in kinds],
        outside=[bounded("none", *x) for x in drawn] + [bool(x < section + 1e-6) for x in top],
    )
    result.correction_holds(
        abs(one - section - middle) < 1e-4,
        abs(five - section - 5 * middle) < 1e-4,
        all(x < section + 1e-6 for x in held),
    )


@claim(
    "ROS 2 is not real-time by default.",
    "So it is: its executors don't interrupt a callback. One of {control_ms:.0f} ms for control "
    "ended up to {worst_ms:.1f} ms after its time beside one of {camera_ms:.0f} ms for pictures, "
    "the bound is the sum of both, in each of three orders; one of them has timers first. On a "
    "thread and in a group of its own it took {own_ms:.0f} ms; that thread still needs a priority "
    "and memory that is locked.",
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
    "A loop that sleeps for a period after its work runs at its rate.",
    "It sleeps on top of what it has done and of waking up late, and runs at {formula}: with "
    "{work_us:.0f} us of work and {wake_us:.0f} us of waking up at {hz:.1f} in place of "
    "{asked:.0f} Hz, further behind by {drift_us:.0f} us each period. One that sleeps until start "
    "plus a whole number of periods stays within {held_us:.0f} us of its times.",
    ask=(
        "A loop works for C, then sleeps for T, and wakes up L late each time. Its rate?",
        "f, rate = 1/(T + C + L)",
        {
            "1/T": "That is a loop on absolute times.",
            "1/(T + C)": "Waking up late adds up as well.",
            "1/(T - C - L)": "It is slower, not quicker.",
            "1/(T + L)": "The work comes before the sleep.",
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
    "That is a whole period: drawn evenly and anew each time, intervals were between "
    "{least_us:.0f} and {most_us:.0f} us. A velocity taken over the nominal period is then wrong "
    "by {formula} in the root mean square, {wrong:.0%} of the velocity itself, and by {fair:.1%} "
    "with a jitter of {good_us:.0f} us; lateness that stays the same does it no harm, every other "
    "period late {turns:.0%}. Taken over the measured interval it is right.",
    ask=(
        "A loop of period T begins each period late by what is drawn evenly between 0 and J. It "
        "takes the velocity of a joint that moves at v as the change of its angle over T. Root "
        "mean square of the error?",
        "e, error = v*J/(sqrt(6)*T)",
        {
            "v*J/T": "That is the greatest error.",
            "v*J/(sqrt(12)*T)": "Both ends of the interval are late.",
            "v*J/(sqrt(3)*T)": "Lateness is between 0 and J, not between -J and J.",
            "v*J/(2*T)": "Deviations are squared before they are averaged.",
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
        apart = np.diff(begun[1:])
        return np.sqrt(np.mean((apart / period - 1.0) ** 2)), apart, record.skipped

    wrong, apart, skipped = error(0.99e-3)
    # The worst alternation: on time and almost a period late, in turn.
    other = cycle((0.0, 0.99e-3))
    turns = result.measure("turns", error(0.0, late=lambda: next(other))[0], 0.01)
    result.measure("wrong", wrong, 0.05)
    fair = result.measure("fair", error(good)[0], 0.1)
    result.measure("least_us", 1e6 * apart.min(), 0.5)
    result.measure("most_us", 1e6 * apart.max(), 0.05)
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
        bool(apart.max() > 1.9e-3),
        bool(apart.min() < 1e-4),
    )


def control_misses(callback, start, own=False, count=1):
    """Return whether a loop of 1 kHz that computes 0.1 ms misses its period beside callbacks [s].

    Args:
        callback: what each takes.
        start: how long after a release of the loop they come.
        own: the loop has a thread and a group of its own.
        count: how many such callbacks there are.
    """
    from course.middleware.executor import Work, respond

    group = "theirs" if own else "default"
    others = [Work(f"{k}", callback, 0.05, "subscription", group) for k in range(count)]
    phases = [0.0] + [start / 0.05] * count
    works = [Work("control", 1e-4, 1e-3), *others]
    return bool(respond(works, "ready set", 2 if own else 1, phases, 0.2)["control"].max() > 1e-3)


@claim(
    "A callback of more than 1 ms makes a loop of 1 kHz miss its period.",
    "Not one on another thread, and not whenever it comes: one of {long_ms:.1f} ms did in "
    "{share:.0%} of all phases. And on one thread shorter ones do it together: {several:.0f} in a "
    "row of {short_ms:.1f} ms each did {missed:.0f} of {tried:.0f} times, one never. The sum of "
    "all that may stand in front of the loop counts, and the loop itself.",
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
    result.statement = (
        "An executor on the bus, the callback just in front of a release of the loop."
    )
    outside += [control_misses(float(a), float(b)) for a, b in early]
    result.statement_holds(
        all(outside),
        only_if="both wait for the same thread and it begins just before the loop is due",
        inside=inside,
        outside=outside,
    )
    result.correction_holds(missed == starts.size, not any(alone), not any(outside), share < 0.5)


def calling(threads, own=False, waits=True, work=0.0, seconds=3.5, apart=False, callers=1):
    """Return callbacks of a node that ask a service each second, on the bus.

    Args:
        threads: number of threads of the executor.
        own: the client has a group of its own; "reentrant": the common group is reentrant.
        waits: the callback waits for the answer; otherwise it returns and the answer continues it.
        work: execution time of the service [s].
        seconds: length of the run [s].
        apart: the node's other timer has a group of its own.
        callers: how many such callbacks there are, each further one in a group of its own.

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

    server.service("plan", serve)
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
    "More threads cure a service call that hangs inside a callback.",
    "Not by themselves: the answer is a callback too, and in the caller's group, where that is "
    "exclusive, it waits for the caller, with {threads:.0f} threads as with one: {answers:.0f} "
    "answers. A group of its own or a reentrant one, and a thread more than callbacks that wait at "
    "once, are a cure, {enough:.0f} for one and {three:.0f} for two; not to wait is one without "
    "any.",
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
    )


@claim(
    "A service call holds up the other callbacks of its node.",
    "Those that share group or thread with what waits for the answer, or makes it. While a service "
    "took {work_ms:.0f} ms of each second, another timer ran {held:.0f} times of {due:.0f}; where "
    "the callback returned and went on with the answer {free:.0f} times, and in a group and on a "
    "thread of its own {apart:.0f} times. Served in the same node it ran {served:.0f} times, "
    "though nobody waited.",
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
    result.statement = "A node with two timers on the bus, ten seconds."
    result.statement_holds(
        free < 0.9 * due,
        only_if="they share group or thread with what waits for the answer or makes it",
        inside=[held(True, x) < 0.9 * due for x in drawn] + [served(x) < due for x in drawn],
        outside=[held(False, x) < 0.9 * due for x in drawn]
        + [held(True, x, apart=True) < 0.9 * due for x in drawn],
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
    "Under SCHED_FIFO a loop in Python is real-time.",
    "The priority keeps ordinary processes away, and what stops a loop from within comes as "
    "before: in {periods:.0f} periods that left {litter:.0f} objects each the collector ran "
    "{runs:.0f} times, and new memory cost page faults. With the collector off it ran {quiet:.0f} "
    "times; memory has to be taken and locked before the loop. And the priority is asked for: who "
    "may not have it runs without.",
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
    "A garbage collection in a Python node hits the control loop.",
    "In its own interpreter: of {here:.0f} collections while the loop ran all were its own, and of "
    "as many in another process it counted {there:.0f}. What it shares with other processes is the "
    "core, and for that there are priorities.",
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

    here = result.measure("here", collections(False, 3)[0])
    other, theirs = collections(True, 3)
    result.measure("there", other)
    result.statement = "Collections counted by the chapter's loop, in its process and in another."
    result.statement_holds(
        other > 0,
        only_if="both are in one interpreter of Python, and somebody there asks for a collection "
        "or automatic collection is on",
        cases=True,
        inside=[collections(False, n)[0] == n for n in (1, 5)] + [automatic(True) > 0],
        outside=[other > 0, automatic(False) > 0],
    )
    result.correction_holds(other == 0, theirs >= 3, here == 3)
