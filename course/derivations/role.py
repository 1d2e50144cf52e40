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
    "d1": Symbol("delay of the question [s]"),
    "d2": Symbol("delay of the answer [s]"),
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
    "Each stage runs on a clock of its own. Then the command in force is, on average, as old as "
    "the sum of the execution times.",
    "That is the least possible age. Each stage with a clock of its own adds half a period on "
    "average: {formula} for two stages that read the newest value. With images at "
    "{camera_hz:.0f} Hz, {see_ms:.0f} ms for perception, a planner at {plan_hz:.0f} Hz that needs "
    "{plan_ms:.0f} ms and a loop at {loop_hz:.0f} Hz, the mean age is {mean_ms:.1f} ms instead of "
    "{sum_ms:.1f}. In {runs:.0f} simulated runs with random phases the mean is "
    "{simulated_ms:.1f} ms, with a standard error of at most {error_ms:.1f} ms, and no age is "
    "above the bound of {bound_ms:.1f} ms. If all clocks keep exact time, the mean of a run "
    "depends on its start: in such runs it lay between {locked_least_ms:.0f} and "
    "{locked_most_ms:.0f} ms.",
    ask=(
        "Two stages with clocks of their own read the newest value. What is the mean age of the "
        "information behind the command that is in force?",
        "A, mean = C1 + C2 + (T1 + T2)/2",
        {
            "C1 + C2": "That is the least age.",
            "C1 + C2 + T1 + T2": "That is the upper bound.",
            "C1 + C2 + T1/2": "The command also stays in force for the second period.",
        },
    ),
    source="A. Davare and others, Period optimization for hard real-time systems, DAC 2007",
)
def chain_age(result):
    import sympy

    from course.role import Stage, age, simulate

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

    def settled(phase):
        """Return the mean age in one run whose clocks never drift [s]."""
        run = simulate(chain, (0.0, phase, 0.0), 0, 15.0)
        return run.age(np.linspace(3.0, 13.0, 10_001)).mean()

    periods = sum(stage.period for stage in (chain[0], chain[2]) if stage.period is not None)
    # Rates of 3 to 1 to 100 keep their phases: one mean for each start of the robot.
    means = [settled(x) for x in np.linspace(0.0, 1.0, 60, endpoint=False)]
    result.measure("locked_least_ms", 1000 * min(means), 0.02)
    result.measure("locked_most_ms", 1000 * max(means), 0.02)
    result.statement = "The closed form, and simulated runs at random phases and moments."
    # Standard error of the simulated mean, as if one run gave one age; five of them are allowed.
    error = report.std / np.sqrt(len(observed))
    result.measure("runs", len(observed))
    result.measure("error_ms", 1000 * error)
    result.statement_holds(abs(observed.mean() - report.least) < 5 * error)
    result.correction_holds(
        abs(observed.mean() - report.mean) < 5 * error,
        report.least <= observed.min(),
        observed.max() <= report.greatest,
        # Only the wait for the image is fixed by the phase; the plan still ages for its period.
        0.02 < max(means) - min(means) < periods,
    )


@claim(
    "If you poll twice as often, the data that you get are half as old.",
    "Over all phases, the mean age of the newest value depends on how often it is produced, not on "
    "how often it is read: {formula} at a random moment. Readers at {slow_hz:.0f} and "
    "{fast_hz:.0f} Hz got images of a {camera_hz:.0f} Hz camera that were {slow_ms:.1f} and "
    "{fast_ms:.1f} ms old. Polling faster shortens two other times: the time until the reader "
    "notices a new value, and the time for which its own result stays in force.",
    ask=(
        "A producer with period T needs the time C for each value. How old is its newest value on "
        "average, for somebody who looks at a random moment?",
        "A, mean = C + T/2",
        {
            "T/2": "Its execution is part of the age.",
            "C + T": "That is the upper bound.",
            "C": "That is the least age, just after the value has come.",
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
    "In overload, the rule queue (start as soon as free, with the newest waiting input) gives "
    "younger results on average than the rule skip (wait for the next fresh input). The inputs are "
    "regular, and the execution time is constant.",
    "With queue, the input has already waited. If the planner of this chapter's chain "
    "always needs exactly {plan_ms:.0f} ms, the wait is {exact_wait_ms:.0f} ms on average, and the "
    "mean age of the "
    "command is {exact_ms:.0f} ms. If this time varies a little, the wait is half of the "
    "interval between poses, {wait_ms:.0f} ms, and the mean age is {free_ms:.0f} ms. In both cases "
    "the planner keeps {free_cores:.1f} cores busy. Skip is better, because the "
    "next input is fresh: {skip_ms:.0f} ms "
    "with {skip_cores:.1f} cores. We tried {ratios:.0f} ratios of execution time to input "
    "interval. At each of them, skip gave results that were younger or equally old.",
)
def start_when_free(result):
    from dataclasses import replace

    from course.role import CHAIN, Stage, age, load, simulate

    see, plan, act = CHAIN
    chains = {
        rule: (see, replace(plan, period=None, overload=rule), act) for rule in ("skip", "queue")
    }
    for rule, name in (("skip", "skip"), ("queue", "free")):
        result.measure(f"{name}_ms", 1000 * age(chains[rule]).mean)
        result.measure(f"{name}_cores", load(chains[rule]) - load([see]) - 0.2)
    result.measure("wait_ms", 1000 * age(chains["queue"]).waits[0])

    def commanded(jitter):
        """Return the mean age of the command if the planner starts when it is free [s]."""
        busy = replace(chains["queue"][1], jitter=jitter)
        runs = [simulate((see, busy, act), (0.0, 0.0, x), 0, 92.0) for x in (0.1, 0.3, 0.5, 0.7)]
        # 90 s are 300 cycles of nine images, which take as long as five plans.
        return np.mean([run.age(np.linspace(1.0, 91.0, 100_003)).mean() for run in runs])

    exact, varied = commanded(0.0), commanded(0.1 * plan.execution)
    assumed = age(chains["queue"])
    result.measure("plan_ms", 1000 * plan.execution)
    result.measure("exact_ms", 1000 * exact, 5e-3)
    result.measure("exact_wait_ms", 1000 * (exact - assumed.mean + assumed.waits[0]), 0.05)

    def observed(rule, execution, depth=1):
        """Return the mean age of a slow stage's result behind a camera of one second [s]."""
        camera, slow = Stage("camera", 1e-6, 1.0), Stage("slow", execution, None, depth, rule)
        run = simulate([camera, slow], [0.0, 0.0], 0, 1300.0)
        return run.age(np.linspace(50.0, 1250.0, 200_003)).mean()

    # Of execution and interval: random ones, and small fractions, at which the waits repeat.
    n = int(result.input("ratios", 30))
    drawn = np.append(result.rng.uniform(1.02, 4.0, n - 10), np.round(np.linspace(1.1, 3.8, 10), 1))
    skipped, free = (np.array([observed(rule, x) for x in drawn]) for rule in ("skip", "queue"))
    result.statement = "Mean ages of both rules by event simulation, at many ratios."
    result.statement_holds(np.all(free < skipped))
    expected = 0.5 + 1.5 * drawn[: n - 10]
    result.correction_holds(
        np.all(skipped <= free + 0.01),
        # The closed form for executions that vary; five waits, 0 to 0.8 intervals, if they do not.
        abs(varied - assumed.mean) < 1e-3,
        abs(exact - (assumed.mean - 0.2 * assumed.waits[0])) < 1e-3,
        np.mean(free - skipped) > 0.1,
        # The closed forms: a fresh input every ceil(C / T) periods, or half a period of waiting.
        np.max(np.abs(skipped / (drawn + 0.5 * np.ceil(drawn)) - 1)) < 2e-3,
        abs(np.mean(free[: n - 10] - expected)) < 0.05,
    )


@claim(
    "Over a long run, the reaction time to events at random moments and the data age at random "
    "moments have the same distribution, if older data never replace newer data.",
    "If the robot has not yet reacted to an event after a fifth of a second, its command rests on "
    "information that is older than that, and the other way round. The same is true for any time. "
    "Over {events:.0f} moments of a run with jitter and losses the means were {age_ms:.1f} and "
    "{reaction_ms:.1f} ms, and the equivalence failed {failed:.0f} times. Where parallel workers "
    "overtook one another and the last result counted, even if it was the older one, the "
    "equivalence failed at {overtaken:.0%} of the moments.",
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
    # Parallel workers that overtake, and a reader that takes what came last, not what is newest.
    born = 0.1 * np.arange(4000)
    came = born + result.rng.uniform(0.03, 0.57, born.size)
    order = np.argsort(came)
    came, content = came[order], born[order]
    moments, late_by = result.rng.uniform(5, 390, 2000), result.rng.uniform(0, 0.6, 2000)
    in_force = content[np.searchsorted(came, moments + late_by, side="right") - 1]
    # The first result that came with an image taken after the event.
    answered = np.array([came[np.argmax(content >= e)] for e in moments])
    wrong = np.mean((answered > moments + late_by) != (moments > in_force))
    overtaken = result.measure("overtaken", wrong, 0.2)
    difference = np.abs(np.quantile(old, (0.1, 0.5, 0.9)) / np.quantile(late, (0.1, 0.5, 0.9)) - 1)
    result.statement = "Both times at random moments of one simulated run."
    result.statement_holds(difference.max() < 0.02)
    result.correction_holds(failed < 1, overtaken > 0.02)


@claim(
    "In the long run the newest result has waited half of the producer's period on average when it "
    "is read, whatever the rates of producer and reader.",
    "Rates of nearly 3 to 1 need minutes to hours for that. Rates of exactly 3 to 1 from one clock "
    "keep the phase with which they start, however long the run is. With a camera at "
    "{fast_hz:.0f} Hz and a reader at {slow_hz:.0f} Hz, the age at reading stayed at {low_ms:.1f} "
    "ms in one run and at {high_ms:.1f} ms in another, to within {moved_ms:.0e} ms over a minute.",
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
    # So near such a ratio that the phase moves by less than a period in ten minutes.
    crawling = [right(n * camera * (1 + 1e-6), x) for n in (1, 3) for x in phases]

    def dropped(period, share=0.3, frames=20_000):
        """Return whether the mean is right if a camera loses this share of its images."""
        arrived = camera * np.flatnonzero(result.rng.random(frames) > share)
        read = np.arange(arrived[0], arrived[-1], period)
        ages = read - arrived[np.searchsorted(arrived, read, side="right") - 1]
        return abs(ages.mean() / (np.diff(arrived).mean() / 2) - 1) < 0.1

    # Chosen to break it: some gaps are longer, and more readings fall into a long gap.
    dropping = [dropped(period) for period in draws]

    def going_round(turns):
        """Return whether the mean is right if the phase goes round this often in ten minutes."""
        return [right(n * camera * (1 + turns * camera / 600), x) for n in (1, 3) for x in phases]

    result.statement_holds(
        right(slow, 0.02),
        inside=apart + going_round(10.5),
        # Chosen to break it: a phase that takes thousands of values, but not evenly.
        outside=locked + crawling + going_round(1.5) + dropping,
        only_if="the producer's period is constant, and during the run the phase between the two "
        "clocks spreads evenly over it",
    )
    result.correction_holds(
        np.ptp(low) < 1e-9,
        np.ptp(high) < 1e-9,
        abs(high.mean() - low.mean()) > 0.005,
        not all(crawling),
    )


@claim(
    "The clocks of two computers keep the same phase if both are set to the same rate, even "
    "without synchronisation.",
    "Each computer has a quartz of its own, and the two differ slightly. With a difference "
    "of {ppm:.0f} parts in a million the age at reading is a sawtooth as high as a period, "
    "{high_ms:.1f} ms at {rate_hz:.0f} Hz. One tooth takes {formula}, here "
    "{beat_s:.0f} s, so a short test on the bench does not show it.",
    ask=(
        "Two clocks with period T differ by the relative amount r. After what time has their "
        "phase gone round once?",
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
    "A clock that is set over the network by one round trip is off by at most half the round trip, "
    "if both clocks run at the same rate meanwhile.",
    "The question takes d1 and the answer d2. The estimate assumes that both take the same time, "
    "so it is off by half their difference, {formula}. In {n:.0f} exchanges with random delays the "
    "error reached {share:.0%} of half the round trip, and never more. The fastest of {tries:.0f} "
    "exchanges is the best one to believe: with these delays its error was {best_us:.0f} "
    "microseconds in the median, that of a single exchange {single_us:.0f}. If the rates differ by "
    "{ppm:.0f} parts in a million and the answer comes after {held_s:.0f} s, {drift_us:.0f} "
    "microseconds come on top.",
    ask=(
        "One computer asks another for the time. The question takes d1, the answer d2. From this "
        "exchange it estimates how far the other clock is ahead of its own, and assumes that both "
        "take the same time. By how much is the estimate too large?",
        "(d1 - d2)/2",
        {
            "(d1 + d2)/2": "That is the bound: half of the round trip.",
            "d1 - d2": "The round trip is halved.",
            "0": "Only if both ways take the same time.",
        },
    ),
    source="D. Mills and others, Network Time Protocol version 4, RFC 5905, 2010, section 8",
)
def round_trip_sets_a_clock(result):
    import sympy

    d1, d2, t0, offset, held = sympy.symbols("d1 d2 t0 offset held", positive=True)
    # Stamps of the asking clock at both ends, of the answering clock, ahead by the offset, between.
    t1 = t0 + d1 + offset
    t2 = t1 + held
    t3 = t0 + d1 + held + d2
    estimate = ((t1 - t0) + (t2 - t3)) / 2
    result.formula = sympy.factor(sympy.simplify(estimate - offset))
    n, tries = int(result.input("n", 20_000)), int(result.input("tries", 8))
    # Delays of a local network with other traffic: a least time, and a queue that is rarely long.
    forth, back = 1e-4 + result.rng.exponential(3e-4, (2, n, tries))
    ahead = result.rng.uniform(-1.0, 1.0, (n, 1))
    sent = result.rng.uniform(0.0, 100.0, (n, tries))
    arrived = sent + forth + ahead
    answered = arrived + result.rng.uniform(0.0, 1e-3, (n, tries))
    received = answered - ahead + back
    error = 0.5 * ((arrived - sent) + (answered - received)) - ahead
    trip = (received - sent) - (answered - arrived)
    best = np.abs(error)[np.arange(n), np.argmin(trip, axis=1)]
    result.measure("share", np.max(np.abs(error) / (0.5 * trip)), 0.02)
    result.measure("single_us", 1e6 * np.median(np.abs(error)), 0.05)
    result.measure("best_us", 1e6 * np.median(best), 0.05)
    # An answering clock that is fast: the offset has moved on when the answer is there.
    fast, waits = 1e-6 * result.input("ppm", 100), result.input("held_s", 10)

    def late(d1, d2):
        """Return the error at the end of an exchange with a fast clock, and half the trip [s]."""
        t1, t2, t3 = d1, d1 + waits, d1 + waits + d2
        estimate = 0.5 * ((1 + fast) * t1 + (1 + fast) * t2 - t3)
        return abs(estimate - fast * t3), 0.5 * (d1 + d2)

    drift, half = late(1e-4, 1e-4)
    result.measure("drift_us", 1e6 * drift, 1e-3)
    result.statement = "Four time stamps of each of many exchanges, with delays drawn for each way."
    rounding = 1e-12  # of stamps of about a hundred seconds
    result.statement_holds(np.all(np.abs(error) <= 0.5 * trip + rounding))
    law = sympy.lambdify((d1, d2), result.formula)(forth, back)
    result.correction_holds(
        np.max(np.abs(error - law)) < rounding,
        np.median(best) < 0.5 * np.median(np.abs(error)),
        drift > 2.0 * half,
    )


@claim(
    "A producer is faster than its reader, and both are regular. Then a deeper queue is safer, "
    "because no sample is lost.",
    "The queue fills up and stays full, and the reader gets its oldest sample. That adds {formula} "
    "to the age. Between {fast_hz:.0f} Hz and a reader at {slow_hz:.0f} Hz, a queue of depth "
    "{deep:.0f} gives data that are {deep_ms:.0f} ms old, a queue of depth 1 gives "
    "{newest_ms:.0f} ms. And {lost:.0%} of the samples are lost all the same.",
    ask=(
        "A queue holds the last d samples of a producer with period T. Its reader is slower and "
        "takes the oldest one. How much older is it than the newest sample?",
        "(d - 1)*T",
        {
            "d*T": "With depth 1 it is the newest sample itself.",
            "(d - 1)*T/2": "The queue is full at every reading, not half full.",
            "d*T/2": "The queue is always full, and with depth 1 there is no older sample.",
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

    def stays_full(times, ratio):
        """Return how often a reader that is slower by this ratio finds the queue full."""
        ticks = np.arange(0.5 * times[-1], times[-1], ratio * camera)
        oldest, latest = (read(times, np.append(0.0, ticks), n)[100:] for n in (deep, 1))
        return np.mean(latest - oldest == deep - 1)

    regular, chance = camera * np.arange(4000), np.cumsum(result.rng.exponential(camera, 4000))
    result.statement = "Age at reading with both depths, and how many samples are ever read."
    result.statement_holds(np.unique(index).size > index[-1])
    report = result.formula.subs({d: deep, T: camera})
    result.correction_holds(
        abs((full - newest) / report - 1) < 1e-3,
        all(stays_full(regular, x) == 1 for x in (1.05, 1.7, 3.0)),
        # Samples that come at random leave gaps: barely faster is not enough then.
        stays_full(chance, 1.05) < 0.8,
    )


@claim(
    "A queue carries a stage through a lasting overload.",
    "It helps only in a short burst. If a stage needs C and samples come every T < C, the age of "
    "its results grows in a queue without a limit, by {formula} seconds per second: by {slope:.3f} "
    "at a load of {load:.0%}, and not at all just below full load. A limit stops the growth, but "
    "the queue then drops samples.",
    ask=(
        "Samples come every T into a queue without a limit, and each takes C > T. How fast does "
        "the age of the finished results grow, in seconds per second?",
        "rate = 1 - T/C",
        {
            "C/T - 1": "That is the growth per second of samples, not per second of time.",
            "T/C": "That is the share of the samples that is finished.",
            "C - T": "That is the growth from one sample to the next.",
        },
    ),
)
def queue_carries_overload(result):
    import sympy

    from course.role import Stage, simulate

    C, T, k = sympy.symbols("C T k", positive=True)
    result.formula = sympy.expand((C * (k + 1) - T * k - C) / (C * k))  # sample k ends at C (k + 1)

    def slope(execution, depth=10_000, skip=9):
        stages = [Stage("s", 1e-6, 0.1), Stage("slow", execution, None, depth, "queue")]
        run = simulate(stages, [0.0, 0.0], 0, 100.0)
        # Slope of the age over time, after the first samples.
        return np.polyfit(run.published[skip:], (run.published - run.captured)[skip:], 1)[0]

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
        abs(slope(busy, 10, 200)) < 1e-3,
    )


@claim(
    "If one sample in ten is lost, the newest one is a tenth older on average.",
    "It is older than that, because a random moment falls into a long gap more often than into a "
    "short one. If samples are lost independently, the mean wait since the newest becomes "
    "{formula}. That is {times:.2f} times as long if {share:.0%} are lost, and {many:.1f} times if "
    "{half:.0%} are.",
    ask=(
        "A producer with period T loses each sample with probability p, independently. How long "
        "ago, on average, was the newest sample produced?",
        "w, wait = T*(1 + p)/(2*(1 - p))",
        {
            "T/(2*(1 - p))": "A random moment falls into long gaps more often.",
            "T*(1 + p)/2": "Several losses can follow one another.",
            "T/2": "That is the wait without losses.",
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
    "Jitter that leaves the mean execution times as they are does not change the mean age over all "
    "phases, if no result overtakes another and each stage is always free when it has to start.",
    "A late result makes the data older for a moment, an early one makes them newer, and on "
    "average both cancel. (Delays without early results raise the mean execution time, and the "
    "mean age by as much.) With jitter of {jitter:.0%} of each execution time the mean moved by at "
    "most {moved:.1%}. The least age and the bound move apart, by {wider_ms:.0f} ms on each side. "
    "If parallel workers can overtake one another, the mean age falls, because the newest result "
    "counts: by {fallen:.0%} with jitter of {wild:.0%}. Locked clocks keep one phase, and at some "
    "phases jitter moves the mean by {locked:.0%}: a result that came just in time then often "
    "comes too late.",
)
def jitter_leaves_the_mean(result):
    from dataclasses import replace

    from course.role import CHAIN, Stage, age, simulate

    share = result.input("jitter", 0.3)
    shaken = [replace(s, jitter=share * s.execution) for s in CHAIN]
    observed, report = _ages(shaken, result.rng, 600, 2), age(CHAIN)
    result.measure("moved", abs(observed.mean() / report.mean - 1) + 1e-3, 0.5)
    result.measure("wider_ms", 1000 * (age(shaken).greatest - report.greatest))
    camera = Stage("camera", 0.3, 0.1, 1, "pipelined")
    wild = replace(camera, jitter=result.input("wild", 0.9) * camera.execution)
    fallen = 1 - _ages([wild], result.rng, 200).mean() / age([camera]).mean
    result.measure("fallen", fallen, 0.1)

    def settled(stages, phase):
        """Return the mean age in one long run, with the planner's phase against the camera."""
        run = simulate(stages, (0.0, phase, 0.0), 1, 60.0)
        return run.age(np.linspace(5.0, 55.0, 20_001)).mean()

    # The chain's camera and planner have rates of 3 to 1: their phase never moves.
    phases = np.linspace(0.0, 1.0, 30, endpoint=False)
    locked = max(abs(settled(shaken, x) / settled(CHAIN, x) - 1) for x in phases)
    result.measure("locked", locked, 0.2)
    result.statement = "600 runs of the chapter's chain with jitter in all executions."
    result.statement_holds(abs(observed.mean() - report.mean) < 5 * report.std / np.sqrt(600))
    result.correction_holds(
        age(shaken).least <= observed.min(),
        observed.max() <= age(shaken).greatest,
        fallen > 0.1,
        locked > 0.05,
    )


@claim(
    "A loop through a camera is fast if its last stage runs at 1 kHz.",
    "It is only as fast as its information is fresh. With a constant age A, the loop "
    "x' = -k x(t - A) is stable for k < {formula}. With the mean age behind this chapter's "
    "camera, {age_ms:.0f} ms, "
    "that is {told:.1f} rad/s or {hz:.1f} Hz, although the last stage runs at {rate_hz:.0f} Hz. An "
    "age that swings between 0 and twice its mean A allows less, only 1/A.",
    ask=(
        "A loop integrates its error, which it sees A late: x' = -k x(t - A). An integrator turns "
        "a swing by a quarter of a cycle. Below which gain k is the loop stable?",
        "k < pi/(2*A)",
        {
            "1/A": "There it oscillates already, but it is still stable.",
            "pi/A": "The integrating plant itself turns the phase by a quarter of a turn.",
            "2/A": "That is the limit of Euler's method for x' = -k x.",
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

    # One slow sampler and nothing else: the age runs from 0 to twice its mean.
    swinging = np.arange(behind.size) % round(2 * age(CHAIN).mean / step)

    def grows(gain, ages=behind):
        x = np.ones(400 + ages.size)
        for n, late in enumerate(ages, 399):
            x[n + 1] = x[n] - gain * step * x[n - late]
        # Growing if the end swings more than the beginning.
        return np.abs(x[-2000:]).max() > np.abs(x[2000:4000]).max()

    result.measure("age_ms", 1000 * age(CHAIN).mean)
    result.measure("told", report)
    result.measure("hz", report / (2 * np.pi))
    result.statement = "The loop driven by the ages of an event simulation, on both sides of k."
    result.statement_holds(not grows(2 * np.pi * 50))
    sampled = 1 / age(CHAIN).mean
    result.correction_holds(
        not grows(0.9 * report),
        grows(1.1 * report),
        not grows(0.9 * sampled, swinging),
        grows(1.1 * sampled, swinging),
    )
