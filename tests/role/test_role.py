"""The closed forms against event simulation, and that against a grid of time, written apart."""

from collections import deque
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import role
from course.cards import predict
from course.role import CHAIN, STACK, Edge, Stage, age, check_stack, cost, simulate, spend
from tests.budget import examples

TICK = 2.0**-12  # of the grid [s]


def on_a_grid(stages, offsets, ticks):
    """The chain, tick by tick in whole numbers: (published, captured) of the last stage.

    Each stage is a machine: what waits for it, the jobs under way, and when it is free. A tick is
    cut into as many parts as there are stages, and each clock keeps to its own part.
    """
    n = len(stages)
    waiting: list[deque[int]] = [deque(maxlen=s.depth) for s in stages]
    jobs: list[list[tuple[int, int]]] = [[] for _ in stages]
    last: list[int | None] = [None] * n
    until, out = [-1] * n, []
    T = [s.period and n * round(s.period / TICK) for s in stages]
    C = [n * round(s.execution / TICK) for s in stages]
    for moment in range(n * ticks):
        for k, stage in enumerate(stages):
            done = [job for job in jobs[k] if job[0] == moment]
            jobs[k] = [job for job in jobs[k] if job[0] > moment]
            for _, captured in done:
                if k + 1 == n:
                    out.append((moment, captured))
                else:
                    waiting[k + 1].append(captured)
            on_time = (moment - n * offsets[k] - k) % T[k] == 0 if T[k] else bool(waiting[k])
            if T[k] and moment < n * offsets[k] + k:
                continue
            busy = until[k] > moment and stage.overload != "pipelined"
            if not on_time or busy:
                if stage.overload == "skip" and not T[k]:
                    waiting[k].clear()
                continue
            if k and waiting[k]:
                last[k] = waiting[k].popleft()
            sample = last[k] if k else moment
            if sample is not None:
                jobs[k].append((moment + C[k], sample))
            until[k] = moment + C[k]
    return np.array(out, float).reshape(-1, 2).T * TICK / n


@st.composite
def chains(draw):
    """Two or three stages whose periods are whole ticks, with their offsets in ticks."""
    stages = []
    for k in range(draw(st.integers(2, 3))):
        rule = draw(st.sampled_from(("", "skip", "pipelined", "queue") if k else ("", "skip")))
        clock = k == 0 or (rule != "queue" and draw(st.booleans()))
        T = draw(st.integers(7, 90))
        C = draw(st.integers(1, T if not rule else 2 * T))
        if not clock and not rule:
            rule = "skip"
        deep = draw(st.integers(1, 4)) if clock or rule == "queue" else 1
        stages.append(Stage(f"stage {k}", C * TICK, T * TICK if clock else None, deep, rule))
    return stages, [draw(st.integers(0, 6)) for _ in stages]


@examples(20)
@given(chains())
def test_events_happen_when_a_grid_of_time_says_so(drawn):
    stages, offsets = drawn
    n, ticks = len(stages), 400
    phases = [
        (o + k / n) * TICK / s.period if s.period else 0.0
        for k, (s, o) in enumerate(zip(stages, offsets, strict=True))
    ]
    result = simulate(stages, phases, seconds=2 * ticks * TICK)
    published, captured = on_a_grid(stages, offsets, ticks)
    # Where results overtake one another the newest counts; the grid's order of equals is its own.
    end = (ticks - 1 - 0.5 / n) * TICK  # between two times of the grid, of TICK / n
    times = np.arange(0.25, n * (ticks - 1), 0.5) * TICK / n
    index = np.searchsorted(published, times, side="right")
    newest = np.append(np.nan, np.maximum.accumulate(captured))
    assert (result.published < end).sum() == (published < end).sum()
    np.testing.assert_allclose(result.age(times), times - newest[index], atol=1e-9)


def ages(stages, rng, runs, per_run=20):
    """Ages at random times of runs with random phases, once queues are full: (runs, per_run)."""
    retained = np.prod([1.0 - s.lost for s in stages])  # until something has come through
    start = 3.0 * sum(s.period or s.execution for s in stages) * max(s.depth for s in stages)
    start *= 1.0 if retained == 1.0 else 5.0 / retained
    result = []
    for seed in range(runs):
        run = simulate(stages, rng.random(len(stages)), seed, 2.0 * start)
        result.append(run.age(rng.uniform(start, 2.0 * start, per_run)))
    return np.array(result)


@st.composite
def timings(draw):
    """Chains that `age` answers for: clocks, starts on arrival, full queues, lost samples."""
    stages, before = [], 0.0
    for k in range(draw(st.integers(1, 4))):
        T = draw(st.floats(0.002, 0.15))
        C = T * draw(st.floats(0.05, 0.7))
        clock = k == 0 or draw(st.booleans())
        rule = "" if clock else "queue"
        # A queue on a producer of nearly the reader's rate takes long to fill.
        deep = draw(st.integers(1, 5)) if clock and k and abs(T - before) > 0.25 * T else 1
        jitter, lost = C * draw(st.sampled_from((0.0, 0.3))), draw(st.sampled_from((0.0, 0.4)))
        if not clock and C > 0.5 * before:
            C, jitter = 0.5 * before, 0.0
        stages.append(Stage(f"stage {k}", C, T if clock else None, deep, rule, jitter, lost))
        before = T if clock else before
    return stages


@pytest.mark.prove
@examples(25)
@given(timings(), st.integers(0, 99))
def test_no_age_leaves_its_bounds_and_the_mean_is_the_predicted(stages, seed):
    try:
        predicted = age(stages)
    except ValueError as problem:  # only what the docstring names
        assert any(w in str(problem) for w in ("lost", "rule for overload", "full at times"))
        return
    result = ages(stages, np.random.default_rng(seed), 60)
    assert predicted.least - 1e-9 <= result.min() and result.max() <= predicted.greatest + 1e-9
    error = result.mean(axis=1).std() / np.sqrt(len(result)) + 1e-9
    assert abs(result.mean() - predicted.mean) < 5.0 * error
    assert 0.6 < result.std() / predicted.std < 1.6


def test_the_example_of_the_chapter():
    """Camera and perception 30 Hz and 45 ms, planner 10 Hz and 60 ms, loop 1 kHz and 0.2 ms."""
    C, T = 0.045 + 0.060 + 0.0002, 1 / 30 + 0.1 + 0.001
    predicted = age(CHAIN)
    assert (predicted.least, predicted.mean, predicted.greatest) == pytest.approx(
        (C, C + T / 2, C + T), rel=1e-12
    )  # Davare and others, 2007: C + T
    result = ages(CHAIN, np.random.default_rng(1), 600, 2)
    assert abs(result.mean() - predicted.mean) < 5 * predicted.std / np.sqrt(600)
    assert result.std() == pytest.approx(predicted.std, rel=0.1)
    assert cost(predicted, 0.3).held == pytest.approx(0.3 * (C + T / 2))


def triggered(rule="", C=0.02, depth=1):
    return Stage("triggered", C, None, depth, rule)


def test_a_start_on_arrival_loses_its_wait_and_the_first_one_stays():
    camera = Stage("camera", 0.01, 1 / 30)
    chain = [camera, triggered(), triggered(C=0.005)]
    clocked = [camera, Stage("b", 0.02, 0.04), Stage("c", 0.005, 0.01)]
    assert age(chain).mean == pytest.approx(0.035 + 1 / 60)
    assert age(chain).waits == pytest.approx((0.0, 0.0, 1 / 60))
    assert age(clocked).mean == pytest.approx(0.035 + 1 / 60 + 0.02 + 0.005)


def test_locked_rates_keep_the_wait_of_their_start():
    """10 and 30 Hz from one clock: at each read the picture is equally old, for ever."""
    camera, planner = Stage("camera", 0.01, 1 / 30), Stage("planner", 1e-6, 0.1)
    read_ages = []
    for phase in (0.02, 0.12, 0.31, 0.7):
        run = simulate([camera, planner], [0.5, phase], seconds=60.0)
        at_read = run.published[5:] - 1e-6 - run.captured[5:]
        assert np.ptp(at_read) < 1e-9
        read_ages.append(at_read[0])
        assert 0.01 <= at_read[0] < 0.01 + 1 / 30
    assert np.ptp(read_ages) > 0.01


@pytest.mark.parametrize("ppm", [100, 1000])
def test_clocks_that_drift_make_a_sawtooth(ppm):
    """Its height is one period T, its length T over the drift; the mean is right over a beat."""
    T = 1 / 30
    beat = T / (ppm * 1e-6)
    run = simulate(
        [Stage("camera", 0.001, T), Stage("reader", 1e-6, T * (1 + ppm * 1e-6))],
        [0.0, 0.3],
        seconds=2.2 * beat,
    )
    at_read = run.published - run.captured
    jumps = run.published[1:][np.abs(np.diff(at_read)) > 0.5 * T]
    assert np.diff(jumps) == pytest.approx(beat, rel=1e-3)
    assert np.ptp(at_read) == pytest.approx(T, rel=0.01)
    over = at_read[(run.published > jumps[0]) & (run.published <= jumps[0] + beat)]
    assert over.mean() == pytest.approx(0.001 + T / 2, rel=0.02)
    # Just inside one tooth the mean is wrong by up to half a period.
    assert abs(over[: over.size // 10].mean() - 0.001 - T / 2) > 0.4 * T


@pytest.mark.parametrize("depth", [1, 3, 10])
def test_a_queue_on_a_faster_producer_adds_its_depth_and_on_a_slower_one_nothing(depth):
    camera = Stage("camera", 0.001, 1 / 30)
    for period, behind in ((0.1, (depth - 1) / 30), (0.031, 0.0)):
        chain = [camera, Stage("reader", 1e-4, period, depth)]
        assert age(chain).waits[0] == pytest.approx(1 / 60 + behind)
        result = ages(chain, np.random.default_rng(depth), 100)
        # A reader a little faster than its producer empties the queue.
        assert result.mean() == pytest.approx(age(chain).mean, abs=0.01)


def test_overload_on_both_sides_of_its_limit():
    camera = Stage("camera", 0.001, 0.1)
    for C in (0.09, 0.11, 0.19, 0.21):  # skipping: whole periods of the camera
        chain = [camera, triggered("skip", C)]
        assert age(chain).mean == pytest.approx(0.001 + C + 0.05 * np.ceil(C / 0.1))
        assert ages(chain, np.random.default_rng(0), 40).mean() == pytest.approx(
            age(chain).mean, rel=0.02
        )
    for depth in (1, 4):  # always busy: a clock of its own execution, behind a full queue
        chain = [camera, triggered("queue", 0.1618, depth)]
        report = age(chain)
        assert report.mean == pytest.approx(0.001 + 0.1618 + 0.1 * (depth - 0.5) + 0.0809)
        result = ages(chain, np.random.default_rng(0), 40)
        assert result.mean() == pytest.approx(report.mean, rel=0.03)
        assert report.least - 1e-9 <= result.min() and result.max() <= report.greatest + 1e-9
    with pytest.raises(ValueError, match=r"time of triggered must be at most.*, got 0.11"):
        age([camera, triggered("", 0.11)])
    for C, grows in ((0.099, 0.0), (0.101, 1 - 0.1 / 0.101), (0.2, 0.5)):
        run = simulate([camera, triggered("queue", C, 10_000)], [0.0, 0.0], seconds=200.0)
        # Just before each new command, so that the sawtooth of the hold is left out.
        slope = np.polyfit(run.published[10:-5], (run.published - run.captured)[10:-5], 1)[0]
        assert slope == pytest.approx(grows, abs=1e-3)


@examples(20)
@given(timings(), st.integers(0, 99))
def test_reaction_time_has_the_distribution_of_the_age(stages, seed):
    """An event at e waits longer than x if and only if the command at e + x is older than x."""
    rng = np.random.default_rng(seed)
    try:
        age(stages)
    except ValueError:
        return
    run = simulate(stages, rng.random(len(stages)), seed, 12.0)
    events, x = rng.uniform(3.0, 5.0, 300), rng.uniform(0.0, 1.0, 300)
    assert ((run.reaction(events) > x) == (run.age(events + x) > x)).all()


def test_what_to_spend_on_is_what_helps():
    chain = (
        CHAIN[0],
        replace(CHAIN[1], depth=4),
        replace(CHAIN[2], execution=0.0015, overload="skip"),
    )
    options = {(o.stage, o.change): o for o in spend(chain)}
    assert options["planning", "newest value"].gain == pytest.approx(3 / 30)
    assert options["planning", "newest value"].load == 0.0
    assert options["control", "pipelined"].gain == pytest.approx(0.0005)
    assert options["control", "pipelined"].load == pytest.approx(1.5 - 0.75)
    more = options["perception", "twice the rate, more workers"]
    assert more.gain == pytest.approx(1 / 120 + 3 / 60)
    # The joint loop started by plans would leave the joints alone for a tenth of a second.
    offered = {(o.stage, o.change) for o in spend(CHAIN)}
    assert ("control", "twice the rate") in offered and ("control", "on arrival") not in offered
    assert role.missed(CHAIN) == []
    assert role.missed(chain) == ["torques"] == role.missed([replace(CHAIN[2], lost=0.01)])
    # Planning begins as soon as it is free: every 60 ms in place of 100, on the newest picture.
    assert options["planning", "on arrival: queue"].gain == pytest.approx(0.1 - 0.04 / 2 + 0.04)
    # 60 ms do not fit into 50: a second worker.
    twice = options["planning", "twice the rate, more workers"]
    assert twice.gain == pytest.approx(0.1 / 4)
    assert twice.load == pytest.approx(0.06 / 0.05 - 0.06 / 0.1)
    assert twice.stages[1].overload == "pipelined"
    rates = [o.gain / max(o.load, 1e-9) for o in spend(chain)]
    assert rates == sorted(rates, reverse=True)
    for option in options.values():
        assert age(chain).mean - age(option.stages).mean == pytest.approx(option.gain)


@pytest.mark.slow
def test_a_fresh_sample_is_better_than_one_that_has_waited():
    """A planner that skips is younger than one that starts when free, and needs less."""
    options = {o.change: o for o in spend(CHAIN) if o.stage == "planning"}
    skip, queue, workers = (options[f"on arrival: {x}"] for x in ("skip", "queue", "pipelined"))
    # No pose waits, and every second one is planned for: 1/15 s in place of 0.1.
    assert skip.gain == pytest.approx(1 / 60 + (0.1 - 1 / 15) / 2)
    assert skip.load == pytest.approx(0.06 * 15 - 0.06 * 10)
    assert workers.gain == pytest.approx(1 / 60 + (0.1 - 1 / 30) / 2)
    assert spend(CHAIN)[0] == skip and skip.gain > queue.gain and skip.load < queue.load
    rng = np.random.default_rng(5)
    for option in (skip, queue, workers):
        saved = ages(CHAIN, rng, 300).mean() - ages(option.stages, rng, 300).mean()
        # Camera and planner repeat after 0.3 s, where the formula of a queue is 3 ms off.
        assert saved == pytest.approx(option.gain, abs=0.008)


def test_cost_is_the_error_of_a_motion_seen_late():
    """A body with constant acceleration, seen through the chain: held, predicted, and unstamped."""
    speed, a = 0.3, 2.0
    delays = ages(CHAIN, np.random.default_rng(3), 300).ravel()
    error = delays * speed + a * delays**2 / 2  # moves from where it was seen, speed when seen
    expected = cost(age(CHAIN), speed, a)
    assert (error - speed * delays).mean() == pytest.approx(expected.predicted, rel=0.05)
    assert (speed * delays).mean() == pytest.approx(expected.held, rel=0.02)
    assert (speed * (delays - delays.mean())).std() == pytest.approx(expected.unstamped, rel=0.1)
    w, t = 2 * np.pi * 1.5, np.arange(200_000) * 1e-4
    late = np.angle(np.vdot(np.exp(1j * w * (t - 0.1)), np.exp(1j * w * t)))
    assert cost(0.1, 1.0, bandwidth=1.5).phase == pytest.approx(late, rel=1e-9)


def test_the_graph_is_whole_and_its_loops_run_through_the_robot():
    check_stack(STACK)
    for box in role.BOXES:
        into, out = role.around(box)
        assert into and out and {e.target for e in into} == {box} == {e.source for e in out}
    for edge in STACK:
        assert edge.bandwidth == edge.rate * edge.size
    image = role.around("perception")[0][0]
    assert image.bandwidth == 640 * 480 * 2 * 30
    # From the sensor to the torque the graph runs through the stages of the chain.
    assert [s.name for s in CHAIN] == ["perception", "planning", "control"]
    for reader, writer in zip(CHAIN[1:], CHAIN, strict=False):
        assert reader.name in [e.target for e in role.around(writer.name)[1]]
    rates = {e.flow: e.rate for e in STACK}
    assert rates["trajectory of 50 points"] == pytest.approx(1 / (CHAIN[1].period or np.nan))


@pytest.mark.parametrize(
    "bad, words",
    [
        (lambda: Stage("s", 0.0, 0.1), "execution time of s"),
        (lambda: Stage("s", 0.1, -0.1), "period of s"),
        (lambda: Stage("s", 0.1, np.nan), "period of s"),
        (lambda: Stage("s", 0.2, 0.1), r"time of s must be at most its period.*, got 0.2"),
        (lambda: Stage("s", 0.1, 0.2, depth=0), "depth of s"),
        (lambda: Stage("s", 0.1, 0.2, overload="hope"), "overload of s"),
        (lambda: Stage("s", 0.3, 0.2, overload="queue"), "overload of s"),
        (lambda: Stage("s", 0.1, 0.2, jitter=0.11), "jitter of s"),
        (lambda: Stage("s", 0.18, 0.1, overload="skip", jitter=0.05), "execution time of s"),
        (lambda: Stage("s", 0.1, 0.2, lost=1.0), "lost of s"),
        (lambda: age([]), "stages"),
        (lambda: age([triggered()]), "stages"),
        (lambda: age([Stage("a", 0.1, 0.2, lost=0.1), Stage("b", 0.1, 0.3, 2)]), "lost"),
        (lambda: age([Stage("a", 0.1, 0.2, jitter=0.1), triggered(C=0.1)]), "triggered"),
        (
            lambda: age([Stage("a", 0.15, 0.1, 1, "pipelined", 0.06)]),
            r"jitter up to a must be .*, got 0.06",
        ),
        (
            lambda: age([Stage("a", 0.05, 0.1, jitter=0.05), Stage("b", 1e-3, 0.104, 4)]),
            "to b must be",
        ),
        (
            lambda: age([Stage("a", 0.05, 0.1), Stage("b", 0.2, None, 3, "queue", 0.1)]),
            "of b must be",
        ),
        (
            lambda: age([Stage("a", 0.05, 0.1), Stage("b", 0.09, None, 1, "queue", 0.05)]),
            "of b must be",
        ),
        (lambda: simulate(CHAIN, [0.0, 0.0]), "phases"),
        (lambda: simulate(CHAIN, [0.0] * 3, seconds=0.0), "seconds"),
        (lambda: cost(-1.0, 1.0), "age"),
        (lambda: cost(0.1, -1.0), "speed"),
        (lambda: Edge("robot", "kitchen", "tea", 1.0, 1), r"box of tea must be .*, got 'kitchen'"),
        (lambda: Edge("robot", "control", "q", 0.0, 1), "rate of q"),
        (lambda: Edge("robot", "control", "q", 1.0, 1, 0), "depth of q"),
        (lambda: Edge("robot", "control", "q", 1.0, 1, 1, "firm"), "deadline of q"),
        (lambda: role.around("kitchen"), r"box must be .*, got 'kitchen'"),
        (lambda: check_stack(STACK[1:8]), "nothing into or out of"),
        (
            lambda: check_stack([*STACK, Edge("control", "planning", "status", 1.0, 8)]),
            "a loop among control, planning",
        ),
    ],
)
def test_bad_input_is_named(bad, words):
    with pytest.raises(ValueError, match=words):
        bad()


def test_the_opening_card_offers_the_ages_of_the_chain():
    """The numbers on its options follow the chain: all work, and all work plus half the periods."""
    work = sum(stage.execution for stage in CHAIN)
    waits = sum(stage.period or 0.0 for stage in CHAIN) / 2
    text = repr(predict("how_old_is_a_command"))
    assert f"{1000 * work:.0f} ms, because perception and planning take that long" in text
    assert f"{1000 * (work + waits):.0f} ms, because results also wait" in text
