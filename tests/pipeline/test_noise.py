"""Noise that is not white and Gaussian, against its theory, and what the contracts say to it."""

import math

import numpy as np
import pytest
from scipy.stats import kstest, norm, t

from course.pipeline import Scenario, Settings, repair, run, successes
from course.pipeline.blame import contracts
from course.pipeline.noise import (
    Noise,
    alarms_of_frames,
    alarms_of_mean,
    blocked,
    run_many_with,
    run_with,
    segment_distance,
    variance_of_mean,
)
from course.pipeline.stages import Sight

N = 400_000


def sample(noise, n=N, axes=2, seed=0):
    rng = np.random.default_rng(seed)
    return noise.shape(rng.standard_normal((n, axes)), rng)


def correlation(x, lag):
    return float(np.mean(x[lag:] * x[:-lag]) / np.mean(x**2))


@pytest.mark.prove
@pytest.mark.parametrize(
    ("noise", "margin"),
    [(Noise(), 0.01), (Noise(tails=3.0), 0.1), (Noise(tails=8.0), 0.01), (Noise(memory=0.9), 0.03)],
)
def test_the_variance_is_that_of_the_settings(noise, margin):
    assert np.var(sample(noise)) == pytest.approx(1.0, rel=margin)


@pytest.mark.prove
@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9])
def test_the_autocorrelation_is_a_power_of_the_memory(memory):
    x = sample(Noise(memory=memory), axes=1)[:, 0]
    for lag in (1, 2, 5, 20):
        assert correlation(x, lag) == pytest.approx(memory**lag, abs=0.02)


def test_the_first_frame_has_the_variance_of_all_others():
    samples = sample(Noise(memory=0.9), n=3, axes=100_000)
    assert np.var(samples, axis=1) == pytest.approx(np.ones(3), rel=0.02)


def test_tails_are_those_of_a_scaled_student_t_on_each_axis():
    x = sample(Noise(tails=3.0), n=20_000)
    for column in x.T:
        assert kstest(column * math.sqrt(3.0), t(3.0).cdf).pvalue > 1e-3
        assert kstest(column, norm.cdf).pvalue < 1e-6
    assert abs(correlation(x[:, 0], 1)) < 0.03


def test_plain_noise_leaves_a_run_as_it_was():
    first, second = (
        run(Scenario(), Settings(), seed=4),
        run_with(Scenario(), Settings(), Noise(), 4),
    )
    assert np.array_equal(first.log, second.log)


@pytest.mark.parametrize("memory", [0.0, 0.3, 0.9])
def test_the_variance_of_the_mean_is_that_of_the_covariance_matrix(memory):
    n = 40
    matrix = memory ** np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    assert variance_of_mean(n, memory) == pytest.approx(matrix.sum() / n, rel=1e-12)


def test_alarm_rates_are_those_of_sampled_noise():
    n, runs = 195, 4000
    heavy = sample(Noise(tails=3.0), n, 2 * runs, 1).reshape(n, runs, 2)
    share = np.mean(np.abs(heavy).max(axis=(0, 2)) > 6.0)
    assert share == pytest.approx(alarms_of_frames(n, 3.0), abs=0.04)
    alike = sample(Noise(memory=0.9), n, 2 * runs, 2).reshape(n, runs, 2)
    share = np.mean(np.abs(alike.mean(axis=0)).max(axis=1) * math.sqrt(n) > 5.0)
    assert share == pytest.approx(alarms_of_mean(n, 0.9), abs=0.04)
    assert alarms_of_frames(n) < 1e-5
    assert alarms_of_mean(n) < 1e-5


@pytest.mark.prove
def test_contracts_raise_false_alarms_as_often_as_the_closed_forms_say():
    scene, settings, runs = Scenario(), Settings(), 60
    for noise, what, rate in (
        (Noise(tails=3.0), "covariance", alarms_of_frames(195, 3.0)),
        (Noise(memory=0.9), "bias", alarms_of_mean(195, 0.9)),
    ):
        records = run_many_with(scene, settings, noise, range(runs))
        alarms = sum(any(what in one.what for one in contracts(r, settings)) for r in records)
        assert abs(alarms - runs * rate) < 3.5 * math.sqrt(runs * rate * (1.0 - rate))


@pytest.mark.slow
def test_memory_costs_successes_and_tails_do_not():
    rates = [
        successes(run_many_with(Scenario(), Settings(), noise, range(30))).mean()
        for noise in (Noise(), Noise(tails=3.0), Noise(memory=0.9))
    ]
    assert min(rates[:2]) > 0.8
    assert rates[2] < 0.6


def densely(a, b, c, d):
    """The distance of two segments, by 400 points on each."""
    share = np.linspace(0.0, 1.0, 400)[:, None]
    p, q = a + share * (b - a), c + share * (d - c)
    return np.hypot(*(p[:, None] - q[None]).transpose(2, 0, 1)).min()


def test_the_distance_of_segments_is_that_of_their_points():
    rng = np.random.default_rng(5)
    for points in rng.uniform(-1.0, 1.0, (60, 4, 2)):
        assert segment_distance(*points) == pytest.approx(densely(*points), abs=0.01)


def test_the_arm_blocks_a_camera_behind_it_and_not_one_beside_it():
    # The first link lies along x from 0 to 0.5; its radius is 2 cm.
    for camera, target, expected in (
        ((0.25, -0.5), (0.25, 0.3), True),
        ((0.25, 0.9), (0.25, 0.3), False),
        ((-0.5, 0.3), (0.25, 0.3), False),
        # Vertical lines that pass the base at 3 cm and at 1 cm.
        ((-0.03, -0.5), (-0.03, 0.3), False),
        ((-0.01, -0.5), (-0.01, 0.3), True),
    ):
        sight = Sight(0, 0, np.array(target), np.array([0.0, 0.5]), np.zeros(2), 1.0)
        assert blocked(np.array(camera), sight, Scenario()) == expected, camera


@pytest.mark.slow
def test_a_hidden_target_gives_no_estimate_and_no_alarm():
    noise, settings = Noise(camera=(0.8, 0.7)), Settings()
    records = run_many_with(Scenario(), settings, noise, range(6))
    for record in records:
        hidden = [math.isinf(np.asarray(p.covariance)[0, 0]) for p in record.pictures]
        assert 0.2 < np.mean(hidden) < 0.5
        assert len(record.estimates) == len(hidden) - sum(hidden)
        assert not contracts(record, settings)
    ideal = run_with(Scenario(), repair(settings, "perceive"), noise, 0)
    assert len(ideal.estimates) == len(ideal.pictures)


@pytest.mark.parametrize(
    "wrong", [{"tails": 2.0}, {"tails": math.nan}, {"memory": 1.0}, {"memory": -0.1}]
)
def test_impossible_noise_is_rejected(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Noise(**wrong)


def test_an_ideal_age_keeps_the_law_of_the_noise():
    settings, noise = repair(Settings(), "age"), Noise(memory=0.9)
    record = run_with(Scenario(), settings, noise, 1)
    assert correlation(record.timetable.draws[:, 0], 1) > 0.7
