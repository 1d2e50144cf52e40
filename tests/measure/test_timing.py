"""The timer: rounds in turn, medians of what was undisturbed, on clocks that are made up."""

import time

import numpy as np
import pytest

from course.measure import timing

pytestmark = pytest.mark.smoke


@pytest.fixture
def quiet(monkeypatch):
    monkeypatch.setattr(timing, "core_share", lambda: 1.0)


def _costs(seconds, log=None, name=""):
    """A sampler whose calls take the given seconds, in turn and then the last one again."""
    rest = list(seconds)

    def sampler(n):
        if log is not None:
            log.append((name, n))
        return n * (rest.pop(0) if len(rest) > 1 else rest[0])

    return sampler


def test_rounds_are_interleaved_after_a_warm_up(quiet):
    log: list[tuple[str, int]] = []
    a, b = _costs([1.0], log, "a"), _costs([1.0], log, "b")
    timing.interleaved([a, b], repeats=3)
    assert [name for name, _ in log] == ["a", "b", "a", "b"] + ["a", "b"] * 3
    log.clear()
    timing.interleaved([a, b], repeats=3, warm=True)
    assert len(log) == 8


def test_a_short_call_is_made_once_more_before_each_sample(quiet):
    """Then it doesn't pay for the caches that a long one has emptied."""
    log: list[tuple[str, int]] = []
    long, short = _costs([1.0], log, "long"), _costs([1e-4], log, "short")
    timing.interleaved([long, short], repeats=3, sample=0.0, warm=True, warm_up=0.02)
    assert [name for name, _ in log[-9:]] == ["long", "short", "short"] * 3

    # Cold after the long call, whose samples come between: what is timed is warm.
    cold = [False]

    def other(n):
        cold[0] = True
        return n * 1.0

    def sensitive(n):
        took, cold[0] = (5e-3 if cold[0] else 0.0) + n * 1e-3, False
        return took

    def times(**options):
        return timing.interleaved([other, sensitive], sample=0.0, **options)[1].median

    assert times(warm_up=0.02) == pytest.approx(1e-3)
    assert times() == pytest.approx(6e-3)


def test_median_quartiles_and_best_are_of_the_rounds_alone(quiet):
    # The warm-up and the sizing take 9 s and 8 s, and are not counted.
    (result,) = timing.interleaved([_costs([9.0, 8.0, 1.0, 2.0, 3.0, 4.0, 5.0])], repeats=5)
    assert (result.low, result.median, result.high, result.best) == (2.0, 3.0, 4.0, 1.0)
    assert (result.calls, result.busy) == (1, 0.0)


def test_short_calls_fill_a_sample_and_no_more_than_most(quiet):
    log: list[tuple[str, int]] = []
    (result,) = timing.interleaved([_costs([1e-6], log)], sample=1e-3, repeats=2)
    assert 500 <= result.calls <= 2000 and log[-1][1] == result.calls
    assert result.median == pytest.approx(1e-6)
    (result,) = timing.interleaved([_costs([1e-6])], sample=1e-3, at_most=7)
    assert result.calls == 7
    # Below the clock's resolution a call seems to take no time at all.
    (result,) = timing.interleaved([lambda n: 0.0 if n < 1000 else 1.0], sample=1e-3)
    assert result.calls >= 1000


def test_a_disturbed_round_is_taken_again(monkeypatch):
    # Shares before the first round and after each: rounds 2 and 3 have a busy one at an end.
    shares = iter([1.0, 1.0, 0.5, 1.0, 0.95, 0.9, 0.2])
    monkeypatch.setattr(timing, "core_share", lambda: next(shares))
    (result,) = timing.interleaved([_costs([9.0, 9.0, 1.0, 50.0, 50.0, 2.0, 3.0])], repeats=3)
    assert (result.best, result.median, result.high, result.busy) == (1.0, 2.0, 2.5, 0.0)


def test_a_busy_machine_is_reported_and_waited_for_no_longer_than_patience(monkeypatch):
    log: list[tuple[str, int]] = []
    monkeypatch.setattr(timing, "core_share", lambda: 0.4)
    (result,) = timing.interleaved([_costs([1.0], log)], repeats=4, patience=0.5)
    assert result.busy == 1.0 and len(log) == 2 + 4 + 2
    log.clear()
    timing.interleaved([_costs([1.0], log)], repeats=4, patience=0.0)
    assert len(log) == 2 + 4


def test_the_probe_sees_a_core_that_is_shared(monkeypatch):
    assert 0.0 < timing.core_share() <= 1.0
    own = iter([0.0, 0.5e-3])
    monkeypatch.setattr(time, "thread_time", lambda: next(own))
    assert timing.core_share() <= 0.25


def test_clocks():
    # A sleep takes wall time, at least what it is to take, and hardly any processor time.
    assert timing.calls(time.sleep, 5e-3)(3) >= 15e-3
    assert timing.calls(time.sleep, 0.1, clock=time.process_time)(3) < 0.5 * 0.3
    counted: list[int] = []
    assert timing.batches(counted.append)(7) >= 0.0
    assert counted == [7]


@pytest.mark.parametrize(
    "wrong",
    [{"repeats": 0}, {"at_most": 0}, {"sample": np.nan}, {"patience": -1.0}, {"warm_up": -1.0}],
)
def test_numbers_out_of_range(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        timing.interleaved([lambda n: 1.0], **wrong)


def test_ratios_are_of_samples_of_one_round(quiet):
    """Each round is slower than the one before, for both alike: their ratio doesn't notice."""
    slower = [2.0**k for k in range(20)]
    first = _costs([1.0, 1.0, *slower])
    second = _costs([3.0, 3.0, *(3.0 * x for x in slower)])
    (ratio,) = timing.pairwise_ratios([first, second], pairs=5)
    assert ratio == pytest.approx((3.0, 3.0, 3.0))
    assert str(ratio) == "3 times (quartiles 3 to 3)"
