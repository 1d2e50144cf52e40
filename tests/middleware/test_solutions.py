"""The worked answers of chapter 10 against tables by words, exact sums and simulated clocks."""

import importlib.util
import math
from fractions import Fraction
from itertools import pairwise, product
from math import comb
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.middleware import qos
from course.oracles import cyclonedds
from drills import cards
from solutions import middleware as solutions
from tests.budget import examples
from tests.optional import REQUIRED

dds = pytest.mark.skipif(
    importlib.util.find_spec("cyclonedds") is None and not REQUIRED,
    reason="nothing was run on Cyclone DDS: pip install -e '.[oracles]'",
)


def rngs():
    return st.integers(0, 2**32 - 1).map(np.random.default_rng)


# --- quality of service ---------------------------------------------------------------------------

# What a reader is served by, word by word (OMG, DDS 1.4, 2.2.3).
SERVED = {
    "best effort": ("best effort", "reliable"),
    "reliable": ("reliable",),
    "volatile": ("volatile", "transient local", "transient", "persistent"),
    "transient local": ("transient local", "transient", "persistent"),
    "transient": ("transient", "persistent"),
    "persistent": ("persistent",),
    "none": ("none", "slow", "quick"),
    "slow": ("slow", "quick"),
    "quick": ("quick",),
    "automatic": ("automatic", "by participant", "by topic"),
    "by participant": ("by participant", "by topic"),
    "by topic": ("by topic",),
    "by reception": ("by reception", "by source"),
    "by source": ("by source",),
    "shared": ("shared",),
    "exclusive": ("exclusive",),
}
TIME = {"none": 0.0, "slow": 0.5, "quick": 0.2}
WORDS = (
    ("best effort", "reliable"),
    ("volatile", "transient local", "transient", "persistent"),
    ("none", "slow", "quick"),
    ("automatic", "by participant", "by topic"),
    ("none", "slow", "quick"),
    ("by reception", "by source"),
    ("shared", "exclusive"),
)


def number(place: int, word: str) -> float:
    return TIME.get(word, float(WORDS[place].index(word)))


def test_compatible_is_the_table_by_words_for_every_pair():
    """Each policy by every pair of its words, beside a draw of all the others."""
    rng = np.random.default_rng(0)
    for place, words in enumerate(WORDS):
        for pair in product(words, words):
            for _ in range(5):
                ends = [[str(rng.choice(other)) for other in WORDS] for _ in range(2)]
                ends[0][place], ends[1][place] = pair
                fails = [o not in SERVED[r] for o, r in zip(*ends, strict=True)]
                expected = [*fails[:3], fails[3] or fails[4], *fails[5:]]
                offered, requested = ([number(*p) for p in enumerate(end)] for end in ends)
                assert solutions.compatible(offered, requested).tolist() == expected


ENTRIES = (
    "reliability",
    "durability",
    "deadline",
    "liveliness",
    "liveliness_lease_duration",
    "destination_order",
    "ownership",
)
ALL = qos.ORDERS | qos.SAME


@dds
def test_compatible_is_cyclones_verdict():
    """Random pairs: heard if nothing fails, and the policy that the event names is among ours."""
    rng, pairs = np.random.default_rng(3), []
    for _ in range(60):
        common = [float(rng.integers(len(words))) for words in WORDS]
        ends = [list(common), list(common)]
        for place in rng.choice(7, 2, replace=False):
            ends[rng.integers(2)][place] = float(rng.integers(len(WORDS[place])))
        for end in ends:
            end[2], end[4] = ((0.0, 0.5, 0.2)[int(end[place])] for place in (2, 4))
        pairs.append(ends)

    def profile(end: list[float]) -> qos.QoS:
        values: dict[str, Any] = dict(zip(ENTRIES, end, strict=True))
        values |= {name: ALL[name][int(values[name])] for name in ALL}
        values |= {name: values[name] or math.inf for name in qos.TIMES}
        return qos.QoS(**values)

    result = cyclonedds.verdicts([(profile(o), profile(r)) for o, r in pairs])
    names = [*ENTRIES[:4], *ENTRIES[5:]]
    silent = 0
    for pair, verdict in zip(pairs, result, strict=True):
        failing = np.array(names)[solutions.compatible(*pair) == 1]
        assert verdict.matched == (not failing.size)
        assert verdict.matched or verdict.reader in failing
        silent += not verdict.matched
    assert 15 < silent < 45


# --- a cache --------------------------------------------------------------------------------------


@examples(100)
@given(rngs(), st.integers(1, 4), st.sampled_from((0, 2, 5, 9)))
def test_each_message_has_the_fate_that_its_own_rule_gives(rng, depth, lifespan):
    """Message by message, without a cache, in whole numbers, so that times coincide."""
    stamps = np.sort(rng.integers(0, 30, 15))
    arrivals = stamps + rng.integers(0, 6, 15)
    order = np.argsort(arrivals, kind="stable")
    stamps, arrivals = stamps[order], arrivals[order]
    reads = np.unique(rng.integers(0, 40, 5))
    ends = stamps + lifespan if lifespan else np.full(15, 99)
    accepted, window = arrivals < ends, np.searchsorted(reads, arrivals)
    taken: list[list[int]] = [[] for _ in reads]
    dropped = 0
    for k in np.flatnonzero(accepted & (window < len(reads))).tolist():
        later = [j for j in range(k + 1, 15) if accepted[j] and window[j] == window[k]]
        crowd = [sum(ends[i] > arrivals[j] for i in [k, *later] if i < j) for j in later]
        if any(n >= depth and arrivals[j] < ends[k] for j, n in zip(later, crowd, strict=True)):
            dropped += 1
        elif reads[window[k]] < ends[k]:
            taken[window[k]].append(k)
    result = solutions.keep_last(stamps, arrivals, reads, depth, lifespan)
    assert [[k for k in row if k >= 0] for row in result[0].tolist()] == taken
    assert result[1] == dropped


@dds
@pytest.mark.parametrize("depth", [1, 3, 8])
def test_the_cache_takes_what_cyclones_takes(depth):
    rng = np.random.default_rng(depth)
    arrivals, reads = np.arange(20), np.sort(rng.choice(20, 5, replace=False)) + 0.5
    with cyclonedds.participant() as member:
        topic = cyclonedds.Topic(member)
        writer = topic.writer(qos.QoS())
        reader, taken, edges = topic.reader(qos.QoS(depth=depth)), [], [-1.0, *reads]
        for low, high in pairwise(edges):
            topic.write(writer, *(int(k) for k in arrivals if low < k < high))
            taken.append(cyclonedds.take(reader))
    result, dropped = solutions.keep_last(arrivals, arrivals, reads, depth, 0.0)
    assert [[k for k in row if k >= 0] for row in result.tolist()] == taken
    assert dropped == int(reads[-1] + 0.5) - sum(map(len, taken))


# --- fragments ------------------------------------------------------------------------------------


def exact_rounds(n: int, p: Fraction) -> Fraction:
    """Mean rounds by first-step analysis: from i missing, a binomial number stays missing."""
    mean = [Fraction(0)]
    for i in range(1, n + 1):
        stays = [comb(i, j) * p**j * (1 - p) ** (i - j) for j in range(i + 1)]
        mean.append((1 + sum(stays[j] * mean[j] for j in range(i))) / (1 - stays[i]))
    return mean[n]


@examples(30)
@given(st.integers(1, 12), st.integers(1, 9), st.integers(1, 300), st.data())
def test_rounds_and_loss_are_those_of_exact_fractions(n, tenths, payload, data):
    size = (n - 1) * payload + data.draw(st.integers(1, payload))
    p = Fraction(tenths, 10)
    lost, rounds, sent = solutions.fragment_loss(size, payload, tenths / 10)
    np.testing.assert_allclose(lost, float(1 - (1 - p) ** n), rtol=1e-12)
    np.testing.assert_allclose(rounds, float(exact_rounds(n, p)), rtol=1e-12)
    np.testing.assert_allclose(sent, float(n / (1 - p)), rtol=1e-12)


@examples(30)
@given(st.integers(1, 2000), st.integers(3, 15))
def test_a_good_link_keeps_its_digits(n, exponent):
    """The first terms of the binomial series, in fractions of the very number that goes in."""
    loss = 10.0**-exponent
    p = Fraction(loss)
    series = sum((-1) ** (k + 1) * comb(n, k) * p**k for k in range(1, 30))
    second = sum((-1) ** (k + 1) * comb(n, k) * p ** (2 * k) for k in range(1, 8))
    lost, rounds, _ = solutions.fragment_loss(n, 1, loss)
    np.testing.assert_allclose(lost, float(series), rtol=1e-12)
    np.testing.assert_allclose(rounds, float(1 + series + second + n * p**3), rtol=1e-7)


def test_a_link_that_is_drawn_loses_and_repeats_as_computed():
    rng, n, p, runs = np.random.default_rng(7), 626, 1e-3, 4000
    tries = rng.geometric(1.0 - p, (runs, n))  # of each fragment until it arrives
    lost, rounds, sent = solutions.fragment_loss(921_600 - 1000, 1472, p)
    for drawn, computed in (
        (tries.max(axis=1) > 1, lost),
        (tries.max(axis=1), rounds),
        (tries.sum(axis=1), sent),
    ):
        assert abs(drawn.mean() - computed) < 4.0 * drawn.std() / np.sqrt(runs)


# --- response times -------------------------------------------------------------------------------


def clocked(C, T, D, blocked: int, level: int) -> int:
    """Response of the first job of a task, microsecond by microsecond; all are released at once.

    A less important task has taken the processor just before, for `blocked`.
    """
    remaining, held, now = [0] * (level + 1), blocked, 0
    while True:
        for i in range(level + 1):
            remaining[i] += C[i] if now % T[i] == 0 and (i < level or now == 0) else 0
        if held:
            held -= 1
        else:
            remaining[next(i for i in range(level + 1) if remaining[i])] -= 1
        now += 1
        if not remaining[level]:
            return now if now <= D[level] else -1
        if now > D[level]:
            return -1


@examples(60)
@given(rngs(), st.integers(1, 5), st.sampled_from((0, 3)))
def test_response_times_are_those_of_a_clock_that_ticks(rng, n, held):
    T = rng.integers(4, 40, n)
    C = np.clip(rng.integers(0, (1.6 * T / n).astype(int) + 1), 1, T)
    D = np.maximum(rng.integers(T // 2, T + 1), C)
    B = rng.integers(0, held + 1, n)
    result = solutions.response_times(C, T, D, B).tolist()
    assert result == [clocked(C, T, D, int(B[i]), i) for i in range(n)]


def test_no_phases_are_worse_than_all_at_once():
    """A set just within its deadlines, with every offset of every task (Liu and Layland, 1973)."""
    C, T = [2, 2, 3], [5, 8, 16]
    worst = [0] * 3
    for offsets in product(range(5), range(8), range(16)):
        remaining, began = [0] * 3, [0] * 3
        for now in range(16, 120):
            for i in range(3):
                if now % T[i] == offsets[i]:
                    remaining[i], began[i] = C[i], now
            running = next((i for i in range(3) if remaining[i]), None)
            if running is not None:
                remaining[running] -= 1
                if not remaining[running]:
                    worst[running] = max(worst[running], now + 1 - began[running])
    assert solutions.response_times(C, T, T, [0] * 3).tolist() == worst


# --- a loop ---------------------------------------------------------------------------------------


@examples(60)
@given(rngs(), st.integers(1, 9), st.integers(-20, 20))
def test_a_loop_on_a_clock_that_ticks_asks_for_the_same_times(rng, period, start):
    """Nanosecond by nanosecond: it is busy, or it waits for a bell that rings once a period."""
    late, work = rng.integers(0, period, 8), rng.integers(0, 3 * period, 8)
    requested: list[int] = []
    missed: list[int] = []
    now, busy_until, received, i = start, start, 0, -1
    while i < 8:
        rings = (now - start) % period == 0
        if now < busy_until and rings and now > requested[-1]:
            received += 1  # nobody was there
        if now >= busy_until and rings and (not requested or now > requested[-1]):
            if i >= 0:
                missed.append(received)
            i, received = i + 1, 0
            if i < 8:
                requested.append(now)
                busy_until = now + int(late[i] + work[i])
        now += 1
    result = solutions.wake_ups(start, period, late, work)
    assert result[0].tolist() == requested and result[1].tolist() == missed


def test_a_relative_sleep_drifts_by_work_and_lateness_and_the_grid_does_not():
    n, period, late, work = 1000, 1_000_000, 15_000, 100_000
    requested, skipped = solutions.wake_ups(7, period, np.full(n, late), np.full(n, work))
    assert (np.diff(requested) == period).all() and not skipped.any()
    names: dict = {}
    exec(cards.card("wake_ups").starter(), names)
    drifting, _ = names["wake_ups"](7, period, np.full(n, late), np.full(n, work))
    assert (np.diff(drifting) == period + late + work).all()


# --- the hunt -------------------------------------------------------------------------------------


def a_day(rng, *, drift=0.0, every=0.01, late=0.0, save=0.0, gap=0.0, hand=0.0, work=0.02):
    """Arguments of a day, and what the drive is told, each tick from its own definition."""
    captured = 0.033 * np.arange(30) + 0.0031 + gap * (np.arange(30) > 15)
    place = 0.3 + drift * captured + hand * rng.normal(size=30)
    frames = np.column_stack((captured, captured + 0.0072, place))
    lateness, ticks = late * rng.random(150), 0.0097 + every * np.arange(int(1.4 / every))
    args = frames, np.array([[0.2, save]]), work, lateness, 0.01, 120.0, drift, ticks
    # An image is done at the latest of: any before it was received, and all since then are worked.
    done = [max(frames[j, 1] + (k - j + 1) * work for j in range(k + 1)) for k in range(30)]
    wakes, driven = 0.01 * np.arange(150) + lateness, []
    for tick in ticks:
        report = 0.0
        for now in wakes[wakes <= tick][::-1]:
            received = np.flatnonzero(np.array(done) <= now)
            if received.size and now - captured[received[-1]] <= 0.12:
                report = place[received[-1]] + drift * (now - captured[received[-1]])
                break
        driven.append(report)
    return args, np.array(driven)


DAYS: tuple[dict[str, float], ...] = (
    {},
    {"drift": 0.2, "late": 0.006},
    {"every": 0.03, "hand": 0.1},
    {"save": 0.2, "hand": 0.1},
    {"gap": 0.4, "drift": -0.2},
    {"work": 0.04, "hand": 0.1},
    {"drift": 0.1, "late": 0.003, "every": 0.025, "save": 0.1, "gap": 0.3},
)


@examples(5)
@given(rngs())
def test_each_command_is_the_one_of_its_own_definition(rng):
    for day in DAYS:
        args, driven = a_day(rng, **day)
        np.testing.assert_allclose(solutions.follow_part(*args), driven, atol=1e-12)


def test_the_starter_of_the_hunt_is_right_on_the_bench_and_only_there():
    names: dict = {}
    exec(cards.card("follow_part").starter(), names)

    def missed(**day: float) -> float:
        args, driven = a_day(np.random.default_rng(1), **day)
        return float(np.abs(names["follow_part"](*args) - driven).max())

    assert missed() < 1e-12
    days = {"drift": 0.2}, {"every": 0.03, "hand": 0.1}, {"save": 0.2, "hand": 0.1}
    assert min(missed(**day) for day in days) > 0.005


@pytest.mark.parametrize("seed", range(20))
def test_tasks_under_the_bound_meet_their_deadlines(seed):
    """Periods and times are integers: the processor is run slot by slot, all released at once."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 4))
    periods = np.sort(rng.choice([4, 5, 6, 8, 10, 12, 15], n, replace=False))
    executions = rng.integers(1, 4, n)
    load, bound, verdict = solutions.utilisation(executions, periods)
    remaining, missed, horizon = np.zeros(n, int), False, int(np.lcm.reduce(periods))
    for slot in range(horizon + 1):
        released = slot % periods == 0
        missed = missed or bool((remaining[released] > 0).any())
        remaining[released] = executions[released]
        if remaining.any():
            remaining[np.argmax(remaining > 0)] -= 1
    assert load == pytest.approx(
        float(sum(Fraction(int(c), int(t)) for c, t in zip(executions, periods, strict=True)))
    )
    assert (1.0 + bound / n) ** n == pytest.approx(2.0)
    if verdict:
        assert missed == (verdict < 0)


def test_the_bound_falls_to_the_logarithm_of_two():
    bounds = [solutions.utilisation([1.0] * n, [9.0] * n)[1] for n in (1, 2, 10000)]
    assert bounds == pytest.approx([1.0, 2.0 * (math.sqrt(2.0) - 1.0), math.log(2.0)], abs=1e-4)
