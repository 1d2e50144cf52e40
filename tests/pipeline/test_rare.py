"""Shares of rare failures that are known, by both ways to sample, and where one deceives."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from course.measure.success import wilson
from course.pipeline.rare import cross_entropy, plain

SHARE = 4.9e-4


def one_side(x):
    return 0.8 * x[0] + 0.6 * x[1] - norm.isf(SHARE)


def either_side(x):
    return np.abs(x[0]) - norm.isf(SHARE / 2.0)


def repeats(severity, count=60, **options):
    return [cross_entropy(severity, 6, np.random.default_rng(k), **options) for k in range(count)]


@pytest.mark.parametrize(
    ("severity", "share"),
    [(one_side, SHARE), (lambda x: np.sum(x**2, axis=0) - 22.0, float(chi2.sf(22.0, 6)))],
)
def test_with_a_proposal_that_is_wide_enough_it_is_right(severity, share):
    result = repeats(severity, least=1.0)
    shares, errors = np.array([(one.share, one.error) for one in result]).T
    deviation = shares.std(ddof=1) / np.sqrt(shares.size)
    assert abs(shares.mean() - share) < 4.0 * deviation
    assert np.mean(np.abs(shares - share) < 2.0 * errors) > 0.7
    assert plain(severity, 6, 400_000, np.random.default_rng(1)).share == pytest.approx(
        share, rel=0.25
    )


def test_it_takes_a_small_part_of_the_runs_that_plain_sampling_takes():
    result = repeats(one_side, 20, least=1.0)
    error = np.std([one.share for one in result], ddof=1)
    plain_runs = SHARE * (1.0 - SHARE) / error**2
    assert result[0].runs == 2500
    assert plain_runs > 40.0 * result[0].runs
    few = plain(one_side, 6, 2500, np.random.default_rng(0))
    assert few.error > 5.0 * error or few.share == 0.0


def test_a_second_way_to_fail_that_no_round_has_met_is_missing():
    result = repeats(either_side, least=1.0)
    lost = [one for one in result if one.share + 3.0 * one.error < SHARE]
    whole = [one for one in result if one not in lost]
    assert len(lost) > 0
    assert np.mean([one.share for one in lost]) == pytest.approx(SHARE / 2.0, rel=0.3)
    assert np.median([one.effective for one in lost]) > np.median([one.effective for one in whole])


def test_weights_are_bounded_where_part_of_the_draws_is_plain():
    rng = np.random.default_rng(2)
    result = cross_entropy(one_side, 6, rng, rounds=0, last=100_000, defence=1.0)
    same = plain(one_side, 6, 100_000, np.random.default_rng(3))
    assert result.share == pytest.approx(same.share, abs=6.0 * same.error)
    assert result.effective == pytest.approx(result.share * 100_000)
    half = cross_entropy(one_side, 6, rng, least=1.0, defence=0.5)
    assert half.heaviest * half.share * 1500 <= 2.0 + 1e-9
    with pytest.raises(ValueError, match="elite"):
        cross_entropy(one_side, 6, rng, elite=0.0)


def test_no_failure_in_the_sample_is_not_a_share_of_zero_for_certain():
    """Wilson's interval of `course.measure` is the truth: 0 of 1000 may be 0.38 %."""

    def never(x):
        return np.full(x.shape[1], -1.0)

    one = plain(never, 6, 1000, np.random.default_rng(0))
    assert (one.share, one.low) == (0.0, 0.0)
    assert one.high == pytest.approx(float(wilson(0, 1000)[1]))
    assert one.error == pytest.approx(one.high / 1.96, rel=1e-3)
    # Of the runs of a proposal only those of the first round are sampled as the world does it.
    other = cross_entropy(never, 6, np.random.default_rng(0))
    assert (other.share, other.low) == (0.0, 0.0)
    assert other.high == pytest.approx(float(wilson(0, 250)[1]))
    defended = cross_entropy(never, 6, np.random.default_rng(0), defence=0.5, last=1500)
    assert defended.high == pytest.approx(float(wilson(0, 1000)[1]))


@pytest.mark.parametrize("failures", [1, 3, 40, 1000])
def test_the_interval_of_plain_sampling_is_wilsons(failures):
    def severity(x):
        return np.where(np.arange(x.shape[1]) < failures, 1.0, -1.0)

    one = plain(severity, 2, 1000, np.random.default_rng(0))
    low, high = (float(end) for end in wilson(failures, 1000))
    assert (one.low, one.high) == (pytest.approx(low), pytest.approx(high))
    assert one.error > 0.0


def test_a_share_never_exceeds_one_and_bad_severities_are_rejected():
    def always(x):
        return np.ones(x.shape[1])

    for seed in range(20):
        assert cross_entropy(always, 6, np.random.default_rng(seed)).share <= 1.0
    for severity, words in (
        (lambda x: np.where(x[0] > 1.0, np.nan, x[0]), r"severity must be .*, got nan"),
        (lambda x: 1.0, "shape of the severities"),
    ):
        for method in (
            lambda s: plain(s, 2, 100, np.random.default_rng(0)),
            lambda s: cross_entropy(s, 2, np.random.default_rng(0)),
        ):
            with pytest.raises(ValueError, match=words):
                method(severity)
