"""Claims of chapter 10: priorities, deadlines and locks, as schedules on one core have them."""

from itertools import permutations

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "u": Symbol("utilization of the first task", 0.05, 0.95),
}


@claim(
    "Tasks that use more of a core than Liu and Layland's bound miss their deadlines.",
    "For preemptible tasks with rate-monotonic priorities, the bound is sufficient and not "
    "necessary. At a utilization of {load:.0%}, above the bound of {bound:.1%}, {meet:.0%} of "
    "{sets:.0f} random sets of {n:.0f} tasks, with periods spread evenly in the logarithm over a "
    "factor of a hundred, met all deadlines. If the periods divide one another, "
    "even a full core is possible. Next to one task with utilization u, a second one is safe up to "
    "{formula}, whatever the periods. Callbacks of an executor, which cannot be preempted, missed "
    "deadlines at {two:.0%}, below the bound for two tasks.",
    ask=(
        "Two tasks have rate-monotonic priorities, and one has utilization u. Up to which "
        "utilization of the other is no deadline missed, whatever the periods?",
        "U, share = (1 - u)/(1 + u)",
        {
            "1 - u": "That is a full core, which is possible if the periods divide one another.",
            "2*(sqrt(2) - 1) - u": "That is Liu and Layland's sum, which guarantees less.",
            "ln(2) - u": "That is the sum for many tasks.",
            "(1 - u)^2": "The product of both utilizations plus 1 may be 2.",
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


def scheduled(execution, period, phase, end, order=None, cores=1):
    """Run preemptible tasks in whole units of time, and return each one's longest response.

    A response that is longer than the period is a missed deadline.

    Args:
        execution: C of each task.
        period: T of each task.
        phase: release of each task's first job.
        end: how long the tasks are released.
        order: tasks by priority, highest first; None runs the earliest deadline first.
        cores: of the machine; a job may move from one to another.
    """
    jobs: list[list[int]] = []
    longest = [0] * len(execution)
    for now in range(end):
        for k, (C, T, first) in enumerate(zip(execution, period, phase, strict=True)):
            if now >= first and (now - first) % T == 0:
                jobs.append([now + T if order is None else order.index(k), k, now, C])
        for job in sorted(jobs)[:cores]:
            job[3] -= 1
            if job[3] == 0:
                jobs.remove(job)
                longest[job[1]] = max(longest[job[1]], now + 1 - job[2])
    return longest


@claim(
    "Tasks with fixed priorities share one core and can be preempted. They share no lock, never "
    "pause to wait for "
    "something, are never released late and meet their deadlines. Then none has a longer response "
    "time than when all are released at once.",
    "In all {sets:.0f} random sets, a run from that moment gave the response times of the "
    "analysis, and {later:.0f} of {tried:.0f} runs with other phases gave a longer one. With locks "
    "or late releases (release jitter), a term for each is added. A task that pauses before it has "
    "finished, for instance to wait for a GPU, can delay the others longer. If the earliest "
    "deadline "
    "runs first, other phases can be worse.",
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
    # Earliest deadline first, a set whose longest response comes at other phases.
    works, periods = [2, 2, 2], [4, 8, 9]
    by_deadline = [scheduled(works, periods, x, 400) for x in ((0, 0, 0), (0, 5, 1))]
    # The runs exceed the critical instant's response, but not the analysis that has the jitter
    # term.
    result.correction_holds(
        bool(equal),
        bool(np.array_equal(first.late == 0, meets)),
        bool(np.any((ran > first.longest + 1e-9)[1:] & meets[1:])),
        not np.any((ran > output + 1e-9) & np.isfinite(output)),
        bool(np.all(held >= text)),
        meets.mean() > 0.5,
        any(b > a for a, b in zip(*by_deadline, strict=True)),
        all(x <= t for some in by_deadline for x, t in zip(some, periods, strict=True)),
    )


@claim(
    "If independent preemptible tasks on one core can all be released at once and have deadlines "
    "equal to their periods, no order of fixed priorities does better than a higher priority for "
    "the shorter period.",
    "Independent means that none waits for anything or is released late. Of {sets:.0f} random sets "
    "of four tasks, {some:.0f} were in time with some order of priorities, and all of these with "
    "the rate-monotonic one. On average over all orders, {wrong:.0%} of them were. If deadlines "
    "are shorter than periods, give the shorter deadline the higher priority. On two cores, or "
    "if releases can be late, another order can be better.",
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
    # Two cores: both quick tasks start first, and the slow one is late (Dhall and Liu, 1978).
    two = [0, 1, 2], [2, 0, 1]
    slow = [scheduled([2, 2, 11], [10, 10, 12], (0, 0, 0), 60, x, 2)[2] for x in two]
    result.statement = "Exact response times in all 24 orders of priority."
    result.statement_holds(bool(np.array_equal(good[0], some)))
    result.correction_holds(
        wrong < 0.8,
        some.sum() > 100,
        jitter[0].sum() < jitter.any(axis=0).sum(),
        bool(late[0] > 0.25),
        bool(late[1][0] < 0.25),
        bool(np.isfinite(late[1][1])),
        slow[1] <= 12 < slow[0],
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


def urgent_wait(work, sleep=0, waiting=0, first_come=False, peers=0, lent=0):
    """Run an inheriting lock in whole units of time, and return how long the high task waits.

    A low task has the lock at 0, when the high one asks for it. Nobody else needs the core.

    Args:
        work: that every task does under the lock.
        sleep: of the low task under the lock, after half of its work.
        waiting: tasks of middle priority that have waited for the lock since before 0.
        first_come: the lock goes to the one that has waited longest, not to the most urgent one.
        peers: tasks of the same priority that have waited since before 0, and therefore go first.
        lent: work of a middle task that wakes up at 1 with another lock, whose ceiling is above the
            high task; or of an interrupt.
    """
    queue = [*["middle"] * waiting, "high", *["peer"] * peers]
    holder, done, now = "low", 0, 0
    while holder != "high":
        now += 1
        if lent and now > 1:
            lent -= 1
            continue
        if holder == "low" and done == work // 2 and sleep:
            sleep -= 1
            continue
        done += 1
        if done == work:
            holder, done = queue.pop(0 if first_come else -1), 0
    return now


@claim(
    "A high-priority task waits for a lock at most for as long as the lower-priority holder "
    "computes under this lock.",
    "Without a protocol it also waits for every task of medium priority, because these keep the "
    "holder from computing. With {section_ms:.0f} ms of work under the lock and medium tasks of "
    "{middle_ms:.0f} ms, it waited {one_ms:.0f} ms with one of them and {five_ms:.0f} ms with "
    "five. With inheritance or a ceiling it waited {held_ms:.0f} ms. Tasks of still higher "
    "priority add their own time: with one of {middle_ms:.0f} ms above it, it waited "
    "{top_ms:.0f} ms. A holder that sleeps under the lock lengthens the wait, and so does another "
    "waiter that gets the lock first. On Linux, Python's locks and std::mutex use no such "
    "protocol.",
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
    work = [int(n) for n in result.rng.integers(2, 20, 8)]
    # From one to six tasks in between: with an unbounded inversion the wait must grow with them.
    drawn = result.rng.uniform((0.001, 0.01, 1.0), (0.1, 0.5, 6.99), (8, 3))
    result.statement = "Three to eight tasks and a lock on one simulated core."
    result.statement_holds(
        one < section + 1e-6,
        only_if="the lock uses priority inheritance or a ceiling and goes to the most urgent "
        "waiter first. Its holder waits for nothing, and no interrupt stops it. No other task of "
        "the same or a higher priority (its own, or lent by a lock) runs or waits for a lock",
        inside=[
            *(bounded(kind, *x) for x in drawn for kind in kinds),
            *(urgent_wait(n, waiting=n) <= n for n in work),
        ],
        outside=[
            *(bounded("none", *x) for x in drawn),
            *(bool(x < section + 1e-6) for x in top),
            *(urgent_wait(n, sleep=n) <= n for n in work),
            *(urgent_wait(n, waiting=1, first_come=True) <= n for n in work),
            # Chosen to break it: a task of the same priority waits already, and a middle task has
            # borrowed a higher priority from another lock.
            *(urgent_wait(n, peers=1) <= n for n in work),
            *(urgent_wait(n, lent=n) <= n for n in work),
        ],
    )
    result.correction_holds(
        abs(one - section - middle) < 1e-4,
        abs(five - section - 5 * middle) < 1e-4,
        all(x < section + 1e-6 for x in held),
        all(urgent_wait(n, sleep=1) > urgent_wait(n) for n in work),
        all(urgent_wait(n, waiting=1, first_come=True) > urgent_wait(n, waiting=1) for n in work),
    )
