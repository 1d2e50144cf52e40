"""One timer for all that is compared: warmed up, interleaved, with its spread and a gate.

A busy moment of the machine hits everything that runs in the same round alike, so rounds are
interleaved and the figures are medians and quartiles over the rounds. Between two rounds the timer
computes for 2 ms by itself: where it did not get nine tenths of a core, something else ran too, and
the round is taken again, a limited number of times. What could not be measured undisturbed says so.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from course.check import count, finite

Sampler = Callable[[int], float]
"""n -> seconds that n calls took."""

_PROBE = 2e-3  # s
_UNDISTURBED = 0.9  # share of a core


@dataclass(frozen=True)
class Timing:
    """Seconds of one call.

    Attributes:
        median, low, high: median and quartiles over the rounds [s].
        best: the least [s]; nearest to what the call costs alone.
        calls: how many calls one sample held.
        busy: share of the rounds in which the machine had other work, whatever was tried.
    """

    median: float
    low: float
    high: float
    best: float
    calls: int = 1
    busy: float = 0.0


def calls(
    function: Callable[..., Any], *args: Any, clock: Callable[[], float] = time.perf_counter
) -> Sampler:
    """Return a sampler that calls a function again and again.

    Args:
        function: what is timed, called with `args`.
        *args: its arguments.
        clock: `time.perf_counter`, or `time.process_time` for what computes in this process alone:
            that one does not count what other processes do.
    """

    def sampler(n: int) -> float:
        # One clock reading for many calls: its resolution and cost are divided by their number.
        start = clock()
        for _ in range(n):
            function(*args)
        return clock() - start

    return sampler


def batches(
    function: Callable[[int], Any], clock: Callable[[], float] = time.perf_counter
) -> Sampler:
    """Return a sampler of a function that repeats by itself.

    function(n) does n units in one call.
    """

    def sampler(n: int) -> float:
        start = clock()
        function(n)
        return clock() - start

    return sampler


def interleaved(
    samplers: Sequence[Sampler],
    *,
    repeats: int = 5,
    sample: float = 1e-3,
    at_most: int = 10**9,
    patience: float = 1.0,
    warm: bool = False,
    warm_up: float = 0.0,
) -> list[Timing]:
    """Time all of them in turn, round after round.

    Args:
        samplers: what is timed, see `calls` and `batches`.
        repeats: rounds that count, at least 1; each takes one sample of every sampler.
        sample: about how long one sample should take [s]; short calls are repeated inside it.
        at_most: calls that one sample may hold.
        patience: how many disturbed rounds may be taken again, as a multiple of `repeats`. When it
            is used up, the least disturbed rounds count.
        warm: whether each has been called before. Otherwise a first call, which may compile and
            fills caches, is made and not counted.
        warm_up: samplers whose call takes less than this [s] are called once, uncounted, right
            before each sample. What ran in between has emptied the caches, and a short call would
            pay for that.

    Returns:
        A `Timing` for each, in order.

    Raises:
        ValueError: for numbers out of range.
    """
    count("repeats", repeats, 1)
    count("at_most", at_most, 1)
    finite("sample", sample, 0.0, unit="s")
    finite("patience", patience, 0.0)
    finite("warm_up", warm_up, 0.0, unit="s")
    if not warm:
        for sampler in samplers:
            sampler(1)
    counts = [_calls_in(sampler, sample, at_most) for sampler in samplers]
    # Whether a call is short is measured on a call that follows another one of the same sampler.
    again = [warm_up > 0.0 and min(sampler(1), sampler(1)) < warm_up for sampler in samplers]
    rounds: list[tuple[float, list[float]]] = []  # (share of a core, seconds of a call each)
    # Probe how much of a core this process gets, between rounds: disturbed rounds are repeated.
    before = core_share()
    # The budget of rounds includes those that may be repeated.
    allowed = repeats + math.floor(patience * repeats)
    while len(rounds) < allowed and sum(s >= _UNDISTURBED for s, _ in rounds) < repeats:
        seconds = []
        for sampler, n, cold in zip(samplers, counts, again, strict=True):
            if cold:
                sampler(1)
            seconds.append(sampler(n) / n)
        after = core_share()
        # A round counts as undisturbed only if the probes before and after it both got their core.
        rounds.append((min(before, after), seconds))
        before = after
    # Prefer undisturbed rounds; a stable sort keeps the others in order.
    rounds.sort(key=lambda row: min(row[0], _UNDISTURBED), reverse=True)  # stable: the early ones
    counted = rounds[:repeats]
    busy = sum(s < _UNDISTURBED for s, _ in counted) / repeats
    # Robust statistics: disturbances only lengthen a time, so means would be biased.
    columns = np.array([row for _, row in counted]).reshape(repeats, len(counts))
    low, median, high = np.percentile(columns, [25.0, 50.0, 75.0], axis=0)
    best = columns.min(axis=0)
    return [
        Timing(float(median[i]), float(low[i]), float(high[i]), float(best[i]), n, busy)
        for i, n in enumerate(counts)
    ]


class Ratio(NamedTuple):
    """Median and quartiles of a ratio over pairs of samples that were taken one after the other."""

    median: float
    low: float
    high: float

    def __str__(self) -> str:
        median, low, high = (f"{float(f'{x:.2g}'):g}" for x in self)
        return f"{median} times (quartiles {low} to {high})"


def pairwise_ratios(
    samplers: Sequence[Sampler], *, pairs: int = 15, sample: float = 1e-3, patience: float = 3.0
) -> list[Ratio]:
    """Return the time of each later sampler over that of the first, of interleaved rounds.

    The samples of a round are taken within a few hundredths of a second, so that other work on the
    machine slows all of them. A ratio of two medians compares different moments.

    Args:
        samplers: the first is the denominator.
        pairs: rounds.
        sample: about the time of one sample [s].
        patience: how often a disturbed round may be taken again.
    """
    # A ratio within each round, then quartiles over rounds: slow drifts of the machine cancel.
    rows = []
    for k in range(count("pairs", pairs, 1)):
        first, *others = interleaved(
            samplers, repeats=1, sample=sample, patience=patience, warm=k > 0
        )
        rows.append([other.median / first.median for other in others])
    low, median, high = np.percentile(rows, [25.0, 50.0, 75.0], axis=0)
    return [Ratio(*map(float, row)) for row in zip(median, low, high, strict=True)]


def core_share() -> float:
    """Return the share of a core that this thread got while it computed for 2 ms, from 0 to 1."""
    # Thread time over wall time: below 1 something else ran on this core.
    wall, own = time.perf_counter(), time.thread_time()
    while (passed := time.perf_counter() - wall) < _PROBE:
        pass
    return min(1.0, (time.thread_time() - own) / passed)


def _calls_in(sampler: Sampler, sample: float, at_most: int) -> int:
    """Return how many calls fill a sample, tried with more and more of them."""
    # Grow the number of calls by at least 2 and at most 100 times, as the first timings are noisy.
    n = 1
    while (took := sampler(n)) < 0.5 * sample and n < at_most:
        desired = n * sample / max(took, 1e-9)
        n = min(at_most, max(2 * n, math.ceil(min(desired, 100.0 * n))))
    return n
