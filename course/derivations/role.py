"""Claims of chapter 0: how old the information behind a command is, and what that costs."""

import numpy as np

from course.derivations import Symbol, claim

SYMBOLS = {
    "T": Symbol("period of the producer [s]"),
    "T1": Symbol("period of the first stage [s]"),
    "T2": Symbol("period of the second stage [s]"),
    "C": Symbol("execution [s]"),
    "C1": Symbol("execution of the first stage [s]"),
    "C2": Symbol("execution of the second stage [s]"),
    "d": Symbol("depth of the queue", 1.0, 20.0),
    "p": Symbol("share of samples lost", 0.01, 0.9),
    "r": Symbol("relative difference of the two clocks", 1e-6, 1e-2),
    "A": Symbol("age [s]"),
}


def _ages(stages, rng, runs=200, per_run=5):
    """Return ages that event simulations with random phases show once queues are full [s]."""
    from course.role import simulate

    start = 3 * sum((s.period or 0) + s.execution for s in stages)
    # Losses lengthen the transient.
    start /= (1 - max(s.lost for s in stages)) ** 3
    return np.array(
        [
            simulate(stages, rng.random(len(stages)), k, 2 * start).age(
                rng.uniform(start, 2 * start, per_run)
            )
            for k in range(runs)
        ]
    )


def _at_read(period, phase, seconds=60.0, depth=1, camera=1 / 30):
    """Return the ages at which a reader with this period gets images of a 30 Hz camera [s]."""
    from course.role import Stage, simulate

    run = simulate(
        [Stage("camera", 1e-6, camera), Stage("reader", 1e-6, period, depth)],
        [0.0, phase],
        0,
        seconds,
    )
    return (run.published - run.captured)[2:]


def _even(expression, over, width):
    """Return the mean of an expression over a wait that is spread evenly from 0 to a width."""
    import sympy

    return sympy.simplify(sympy.integrate(expression, (over, 0, width)) / width)


@claim(
    "A pipeline is as late as its stages take: add up their executions.",
    "That is the least age. Each clock of its own adds half a period in the mean: {formula} for "
    "two stages that read the newest value. With pictures at {camera_hz:.0f} Hz, {see_ms:.0f} ms "
    "to see, a planner at {plan_hz:.0f} Hz that takes {plan_ms:.0f} ms and a loop at {loop_hz:.0f} "
    "Hz it is {mean_ms:.1f} ms in place of {sum_ms:.1f}; simulated moments give "
    "{simulated_ms:.1f}, none beyond the bound, which is {bound_ms:.1f}.",
    ask=(
        "Two stages with clocks of their own read the newest value. The mean age behind the "
        "command in force?",
        "A, mean = C1 + C2 + (T1 + T2)/2",
        {
            "C1 + C2": "That is the least.",
            "C1 + C2 + T1 + T2": "That is the bound above.",
            "C1 + C2 + T1/2": "The command is held for the second period.",
        },
    ),
    source="A. Davare and others, Period optimization for hard real-time systems, DAC 2007",
)
def chain_age(result):
    import sympy

    from course.role import Stage, age

    C1, C2, T1, T2, w = sympy.symbols("C1 C2 T1 T2 w", positive=True)
    result.formula = C1 + C2 + _even(w, w, T1) + _even(w, w, T2)
    chain = (
        Stage(
            "see",
            result.input("see_ms", 45) / 1000,
            1 / result.input("camera_hz", 30),
            1,
            "pipelined",
        ),
        Stage("plan", result.input("plan_ms", 60) / 1000, 1 / result.input("plan_hz", 10)),
        Stage("act", 2e-4, 1 / result.input("loop_hz", 1000)),
    )
    report, observed = age(chain), _ages(chain, result.rng)
    result.measure("sum_ms", 1000 * report.least)
    result.measure("mean_ms", 1000 * report.mean)
    result.measure("bound_ms", 1000 * report.greatest)
    result.measure("simulated_ms", 1000 * observed.mean(), 0.02)
    result.statement = "The closed form, and event simulation at random phases and moments."
    # Standard error of the simulated mean; five of them are allowed.
    error = report.std / np.sqrt(len(observed))
    result.statement_holds(abs(observed.mean() - report.least) < 5 * error)
    result.correction_holds(
        abs(observed.mean() - report.mean) < 5 * error,
        report.least <= observed.min(),
        observed.max() <= report.greatest,
    )


@claim(
    "Who polls twice as often gets data half as old.",
    "How old the newest value is depends on how often it is made: {formula} at a moment of your "
    "own. Readers at {slow_hz:.0f} and at {fast_hz:.0f} Hz get pictures of {camera_hz:.0f} Hz that "
    "are {slow_ms:.1f} and {fast_ms:.1f} ms old. Polling shortens only how long its own answer is "
    "in force.",
    ask=(
        "A producer of period T takes C. How old is its newest value in the mean, for somebody "
        "who looks at any time?",
        "A, mean = C + T/2",
        {
            "T/2": "Its execution is part of the age.",
            "C + T": "That is the bound above.",
            "C": "That is the least, just after it came.",
        },
    ),
)
def polling_makes_fresh(result):
    import sympy

    C, T, w = sympy.symbols("C T w", positive=True)
    result.formula = _even(C + w, w, T)
    camera = 1 / result.input("camera_hz", 30)

    def read(rate):
        return np.mean([_at_read(1 / rate, x, 5.0).mean() for x in result.rng.random(20)])

    slow, fast = read(result.input("slow_hz", 47)), read(result.input("fast_hz", 94))
    result.measure("slow_ms", 1000 * slow, 0.05)
    result.measure("fast_ms", 1000 * fast, 0.05)
    result.statement = "Age at the moment of reading, of two readers of one camera."
    result.statement_holds(fast < 0.75 * slow)
    report = result.formula.subs({C: 1e-6, T: camera})
    result.correction_holds(abs(slow / report - 1) < 0.05, abs(fast / report - 1) < 0.05)


@claim(
    "How late a stack reacts and how old its data is are spread alike.",
    "Seen over time they are one distribution: an event at e is answered later than e + x exactly "
    "if the command at e + x is older than x. Mean {age_ms:.1f} and {reaction_ms:.1f} ms over "
    "{events:.0f} moments of a run with jitter and losses; the equivalence failed {failed:.0f} "
    "times.",
    source="M. Guenzel and others, On the equivalence of maximum reaction time and maximum data "
    "age for cause-effect chains, ECRTS 2023",
)
def reaction_is_age(result):
    from dataclasses import replace

    from course.role import CHAIN, simulate

    chain = [replace(s, jitter=0.3 * s.execution, lost=0.2) for s in CHAIN]
    run = simulate(chain, result.rng.random(3), 1, 400.0)
    events = result.rng.uniform(5, 390, result.input("events", 20_000))
    x = result.rng.uniform(0, 0.6, events.size)
    # The equivalence, event by event, not only in distribution.
    failed = np.sum((run.reaction(events) > x) != (run.age(events + x) > x))
    old, late = run.age(events), run.reaction(events)
    result.measure("age_ms", 1000 * old.mean(), 0.02)
    result.measure("reaction_ms", 1000 * late.mean(), 0.02)
    result.measure("failed", failed)
    apart = np.abs(np.quantile(old, (0.1, 0.5, 0.9)) / np.quantile(late, (0.1, 0.5, 0.9)) - 1)
    result.statement = "Both times at drawn moments of one event simulation."
    result.statement_holds(apart.max() < 0.02)
    result.correction_holds(failed < 1)


@claim(
    "In the long run the mean wait is half a period, whatever the two rates.",
    "Clocks divided down from one another keep the phase they start with: at {fast_hz:.0f} and "
    "{slow_hz:.0f} Hz from one clock the age at reading stayed at {low_ms:.1f} ms in one run and "
    "at {high_ms:.1f} in another, to {moved_ms:.0e} ms over a minute.",
)
def long_run_mean(result):
    slow, camera = 1 / result.input("slow_hz", 10), 1 / result.input("fast_hz", 30)
    low, high = (_at_read(slow, phase, camera=camera) for phase in (0.02, 0.3))
    result.measure("low_ms", 1000 * low.mean(), 1e-3)
    result.measure("high_ms", 1000 * high.mean(), 1e-3)
    result.measure("moved_ms", 1000 * max(np.ptp(low), np.ptp(high)) + 1e-9, 0.5)

    def right(period, phase):
        return abs(_at_read(period, phase, 600.0).mean() / (camera / 2) - 1) < 0.1

    draws, phases = result.rng.uniform(0.03, 0.1, 10), result.rng.uniform(0, 0.3, 10)
    result.statement = "Age at reading for periods in and out of a whole ratio, ten minutes each."
    # If n periods of the reader are whole ones of the producer there are n ages at reading, evenly
    # spaced, and their mean is off by up to T / (2 n).
    apart = [right(*x) for x in zip(draws, phases, strict=True)] + [right(1.7 * camera, 0.3)]
    # Rational ratios with small denominators keep their phase for ever.
    locked = [right(n * camera, x) for n in (1, 1.5, 2, 50) for x in phases]
    result.statement_holds(
        right(slow, 0.02),
        inside=apart,
        outside=locked,
        only_if="no small number of the reader's periods is a whole number of the producer's",
    )
    result.correction_holds(
        np.ptp(low) < 1e-9, np.ptp(high) < 1e-9, abs(high.mean() - low.mean()) > 0.005
    )


@claim(
    "Two boards set to the same rate run in step.",
    "Their quartz clocks differ. At {ppm:.0f} parts in a million the age at reading is a sawtooth "
    "as high as the period, {high_ms:.1f} ms at {rate_hz:.0f} Hz, and one tooth takes {formula}, "
    "{beat_s:.0f} s: too slow for a test on the bench.",
    ask=(
        "Two clocks of period T differ by the share r. How long until their phase has gone "
        "once round?",
        "beat = T/r",
        {
            "T*r": "That is the shift in one period.",
            "1/r": "That is the number of periods.",
            "T/(2*r)": "A whole period has to be gained.",
        },
    ),
)
def same_rate_in_step(result):
    import sympy

    T, r, n = sympy.symbols("T r n", positive=True)
    result.formula = T * sympy.solve(sympy.Eq(n * T * r, T), n)[0]
    period, drift = 1 / result.input("rate_hz", 30), 1e-6 * result.input("ppm", 100)
    old = _at_read(period * (1 + drift), 0.3, 800.0)
    # Time between two jumps of the sawtooth.
    teeth = period * (1 + drift) * np.diff(np.flatnonzero(np.abs(np.diff(old)) > 0.5 * period))
    result.measure("beat_s", teeth.mean(), 1e-3)
    result.measure("high_ms", 1000 * np.ptp(old), 0.01)
    result.statement = "800 s of two drifting clocks, event by event."
    result.statement_holds(np.ptp(old) < 0.1 * period)
    result.correction_holds(
        abs(teeth.mean() / float(result.formula.subs({T: period, r: drift})) - 1) < 1e-3,
        abs(np.ptp(old) / period - 1) < 0.01,
    )


@claim(
    "A deeper queue is safer: nothing is lost.",
    "Behind a producer that is faster it is always full, and its reader gets the oldest: {formula} "
    "is added. At {fast_hz:.0f} Hz into {slow_hz:.0f}, depth {deep:.0f} reads {deep_ms:.0f} ms old "
    "data where depth 1 reads {newest_ms:.0f}, and still {lost:.0%} of the samples are lost.",
    ask=(
        "A queue keeps the last d of a producer of period T and feeds a slower reader. What "
        "does it add to the age?",
        "(d - 1)*T",
        {
            "d*T": "At depth 1 it adds nothing.",
            "(d - 1)*T/2": "It is full at every reading, not half full.",
            "d*T/2": "It is full at every reading; at depth 1 it adds nothing.",
        },
    ),
)
def deep_queue(result):
    import sympy

    from course.role import read

    d, T, k = sympy.symbols("d T k", positive=True)
    result.formula = sympy.factor(sympy.summation(T, (k, 1, d - 1)))
    camera, period = 1 / result.input("fast_hz", 30), 1.003 / result.input("slow_hz", 10)
    deep = result.input("deep", 10)
    full, newest = (_at_read(period, 0.1, 60.0, n)[40:].mean() for n in (deep, 1))
    # Which sample each reading gets: those never read are lost.
    index = read(np.arange(3000) * camera, np.arange(900) * period, deep)
    result.measure("deep_ms", 1000 * full, 0.02)
    result.measure("newest_ms", 1000 * newest, 0.05)
    result.measure("lost", 1 - np.unique(index).size / (index[-1] + 1), 0.02)
    result.statement = "Age at reading with both depths, and how many samples are ever read."
    result.statement_holds(np.unique(index).size > index[-1])
    report = result.formula.subs({d: deep, T: camera})
    result.correction_holds(abs((full - newest) / report - 1) < 1e-3)


@claim(
    "A queue carries a stage over an overload.",
    "Over a short burst. If a stage takes C and samples come every T < C, the age of what it "
    "finishes grows by {formula} a second without end: {slope:.3f} s/s at {load:.0%} of what it "
    "can do, and not at all just below.",
    ask=(
        "Samples come every T into an endless queue, and each takes C > T. How fast does the "
        "age of what is finished grow, in seconds a second?",
        "rate = 1 - T/C",
        {
            "C/T - 1": "Per second of samples, not of time.",
            "T/C": "That is the share that is finished.",
            "C - T": "That is the growth from one sample to the next.",
        },
    ),
)
def queue_carries_overload(result):
    import sympy

    from course.role import Stage, simulate

    C, T, k = sympy.symbols("C T k", positive=True)
    result.formula = sympy.expand((C * (k + 1) - T * k - C) / (C * k))  # sample k ends at C (k + 1)

    def slope(execution):
        stages = [Stage("s", 1e-6, 0.1), Stage("slow", execution, None, 10_000, "queue")]
        run = simulate(stages, [0.0, 0.0], 0, 100.0)
        # Slope of the age over time, after the first samples.
        return np.polyfit(run.published[9:], (run.published - run.captured)[9:], 1)[0]

    busy = 0.1 * result.input("load", 1.25)
    result.measure("slope", slope(busy), 1e-3)
    result.statement = "Slope of the age of what is finished, a minute and more of overload."
    result.statement_holds(slope(0.101) < 1e-3)
    result.correction_holds(
        all(
            abs(slope(c) / float(result.formula.subs({C: c, T: 0.1})) - 1) < 0.01
            for c in result.rng.uniform(0.11, 0.4, 8)
        ),
        abs(slope(0.0999)) < 1e-6,
    )


@claim(
    "One sample in ten lost makes the wait for a fresh one a tenth longer.",
    "More than that: one looks more often into a long gap than into a short one. If each is lost "
    "for itself, the mean wait becomes {formula}, {times:.2f} times as long with a share of "
    "{share:g} lost, and {many:.1f} times with {half:g}.",
    ask=(
        "A producer of period T loses the share p of its samples, one by one. The mean wait "
        "behind the newest?",
        "w, wait = T*(1 + p)/(2*(1 - p))",
        {
            "T/(2*(1 - p))": "Long gaps are met more often than short ones.",
            "T*(1 + p)/2": "Losses can follow one another.",
            "T/2": "That is without losses.",
        },
    ),
)
def losses_add_up(result):
    import sympy

    from course.role import Stage

    T, p, n = sympy.symbols("T p n", positive=True)
    G = (1 - p) * n / (1 - p * n)  # generating function of the gap, in periods
    first, second = (sympy.diff(G, n, k).subs(n, 1) for k in (1, 2))
    result.formula = sympy.simplify(T * (second + first) / (2 * first))  # met by its length
    share, half = result.input("share", 0.1), result.input("half", 0.5)
    result.measure("times", float(result.formula.subs({T: 2, p: share})))
    result.measure("many", float(result.formula.subs({T: 2, p: half})))

    def wait(lost):
        return _ages([Stage("camera", 1e-6, 0.1, lost=lost)], result.rng, 400, 20).mean()

    result.statement = "Moments of a geometric gap by algebra, and simulated losses."
    result.statement_holds(wait(share) / wait(0.0) < 1.15)
    result.correction_holds(
        all(
            abs(wait(x) / float(result.formula.subs({T: 0.1, p: x})) - 1) < 0.06
            for x in (share, 0.3, half)
        )
    )


@claim(
    "Jitter of executions leaves the mean age as it is, if none overtakes another or is skipped.",
    "So it does: a late result is in force later, and its follower not the later for it. By "
    "{jitter:.0%} of each execution the mean moved by {moved:.1%}; the bounds move apart, by "
    "{wider_ms:.0f} ms on each side. Among parallel workers whose results overtake one another it "
    "falls, as the newest counts: by {fallen:.0%} with {wild:.0%}.",
)
def jitter_leaves_the_mean(result):
    from dataclasses import replace

    from course.role import CHAIN, Stage, age

    share = result.input("jitter", 0.3)
    shaken = [replace(s, jitter=share * s.execution) for s in CHAIN]
    observed, report = _ages(shaken, result.rng, 600, 2), age(CHAIN)
    result.measure("moved", abs(observed.mean() / report.mean - 1) + 1e-3, 0.5)
    result.measure("wider_ms", 1000 * (age(shaken).greatest - report.greatest))
    camera = Stage("camera", 0.3, 0.1, 1, "pipelined")
    wild = replace(camera, jitter=result.input("wild", 0.9) * camera.execution)
    fallen = 1 - _ages([wild], result.rng, 200).mean() / age([camera]).mean
    result.measure("fallen", fallen, 0.1)
    result.statement = "600 runs of the chapter's chain with jitter in all executions."
    result.statement_holds(abs(observed.mean() - report.mean) < 5 * report.std / np.sqrt(600))
    result.correction_holds(
        age(shaken).least <= observed.min(), observed.max() <= age(shaken).greatest, fallen > 0.1
    )


@claim(
    "A loop through a camera is fast once its last stage runs at 1 kHz.",
    "It is as fast as its information is young. An integrating plant under x' = -k x(t - A) is "
    "stable for k < {formula}: behind the chapter's camera, A = {age_ms:.0f} ms, up to {told:.1f} "
    "rad/s, that is {hz:.1f} Hz, at a rate of {rate_hz:.0f} Hz.",
    ask=(
        "x' = -k x(t - A). The largest stable k?",
        "k < pi/(2*A)",
        {
            "1/A": "There it swings already, and is stable still.",
            "pi/A": "The plant itself turns the phase by a quarter.",
            "2/A": "That is Euler's step on x' = -k x.",
        },
    ),
)
def rate_is_bandwidth(result):
    import sympy

    from course.role import CHAIN, age, simulate

    A, w = sympy.symbols("A w", positive=True)
    result.formula = sympy.solve(w * A - sympy.pi / 2, w)[0]  # j w = -k exp(-j w A)
    step = 1 / result.input("rate_hz", 1000)
    report = float(result.formula.subs(A, age(CHAIN).mean))
    run = simulate(CHAIN, result.rng.random(3), 0, 12.0)
    # The loop sees the state as old as the event simulation says, sample by sample.
    behind = np.rint(run.age(np.arange(400, 11_000) * step) / step).astype(int)

    def grows(gain):
        x = np.ones(400 + behind.size)
        for n, late in enumerate(behind, 399):
            x[n + 1] = x[n] - gain * step * x[n - late]
        # Growing if the end swings more than the beginning.
        return np.abs(x[-2000:]).max() > np.abs(x[2000:4000]).max()

    result.measure("age_ms", 1000 * age(CHAIN).mean)
    result.measure("told", report)
    result.measure("hz", report / (2 * np.pi))
    result.statement = "The loop driven by the ages of an event simulation, on both sides of k."
    result.statement_holds(not grows(2 * np.pi * 50))
    result.correction_holds(not grows(0.9 * report), grows(1.1 * report))
