"""Fits of signals of different kinds, and least squares on logs recorded under feedback."""

from dataclasses import replace

import numpy as np
import pytest

from course.charts.sim_to_real import logs
from course.charts.sim_to_real.logs import FREE, GUESS, TRUTH
from course.sim_to_real import Log, fit
from course.sim_to_real.identify import arm
from course.sim_to_real.signals import (
    SpeedLoop,
    angles_and_rates,
    regression,
    speed_output_error,
    spin,
    weighted,
    weighted_covariance,
    with_instrument,
)

TRUE = np.array(list(TRUTH.values()))


def clean():
    """Return a log of angles and speeds without noise."""
    quiet = logs.record(noise=0.0)
    blank = Log(quiet.times, np.zeros((4, quiet.times.size)), quiet.command)
    truth = {name: np.array([value]) for name, value in TRUTH.items()}
    return replace(blank, measured=angles_and_rates(truth, blank)[..., 0])


def test_the_angles_are_those_of_the_arm_and_the_speeds_their_derivatives():
    log = clean()
    truth = {name: np.array([value]) for name, value in TRUTH.items()}
    assert log.measured[:2] == pytest.approx(arm(truth, log)[..., 0], abs=1e-14)
    # The torque is held, so that central differences are wrong by second order only.
    rates = np.gradient(log.measured[:2], log.dt, axis=1)
    assert log.measured[2:, 1:-1] == pytest.approx(rates[:, 1:-1], abs=2e-2)


def test_without_noise_any_weights_give_the_truth():
    result = fit(*weighted(angles_and_rates, clean(), (1e-3, 2e-3, 0.5, 0.1)), GUESS, FREE)
    assert result.value == pytest.approx(TRUE, rel=1e-6)


def test_a_signal_with_almost_no_weight_does_not_count():
    log = clean()
    error = 1e-3 * np.random.default_rng(0).standard_normal(log.measured.shape)
    noisy = replace(log, measured=log.measured + error)
    both = fit(*weighted(angles_and_rates, noisy, (1e-3, 1e-3, 1e5, 1e5)), GUESS, FREE)
    alone = fit(arm, replace(noisy, measured=noisy.measured[:2]), GUESS, FREE)
    assert both.value == pytest.approx(alone.value, rel=1e-5)


def test_the_covariance_is_that_of_the_linear_estimate_with_all_matrices_written_out():
    rng = np.random.default_rng(1)
    slope = rng.standard_normal((3, 7, 2))
    noise, scale = rng.uniform(0.1, 3.0, (2, 3))
    J = slope.reshape(21, 2)
    W, S = (np.diag(np.repeat(x, 7)) for x in (scale**-2.0, noise**2))
    gain = np.linalg.solve(J.T @ W @ J, J.T @ W)
    assert weighted_covariance(slope, noise, scale) == pytest.approx(gain @ S @ gain.T, rel=1e-12)
    bound = np.linalg.inv(J.T @ np.linalg.inv(S) @ J)
    assert weighted_covariance(slope, noise, noise) == pytest.approx(bound, rel=1e-12)
    # Gauss, Markov and Aitken: no other weights have a smaller variance in any direction.
    more = weighted_covariance(slope, noise, scale) - bound
    assert np.linalg.eigvalsh(more).min() > -1e-12


def test_a_log_obeys_the_law_of_motion_and_the_controller():
    loop = SpeedLoop(inertia=0.2, gain=3.0, noise=0.0)
    measured, sent = loop.record(50, 1, np.random.default_rng(0))
    assert loop.inertia * np.diff(measured[0]) / loop.dt == pytest.approx(sent[0], abs=1e-12)
    # Without noise feedback has nothing to correct.
    assert sent[0] == pytest.approx(loop.plan(50), abs=1e-12)
    loop = replace(loop, noise=0.1)
    measured, sent = loop.record(50, 1, np.random.default_rng(0))
    quiet = replace(loop, noise=0.0).record(50, 1, np.random.default_rng(0))[0]
    feedback = loop.gain * (quiet - measured)[0, :-1]
    assert sent[0] == pytest.approx(loop.plan(50) + feedback, abs=1e-12)


def test_regression_is_least_squares_and_output_error_the_fit_of_the_course():
    loop = SpeedLoop()
    measured, sent = loop.record(400, 1, np.random.default_rng(2))
    slope, *_ = np.linalg.lstsq(sent.T, np.diff(measured[0]) / loop.dt, rcond=None)
    assert regression(measured, sent, loop.dt) == pytest.approx(slope, rel=1e-10)
    log = Log(np.linspace(0.0, 400 * loop.dt, 401), measured, sent)
    result = fit(spin, log, {"mobility": 5.0}, {"mobility": (0.1, 100.0)})
    assert speed_output_error(measured, sent, loop.dt) == pytest.approx(result.value, rel=1e-6)


@pytest.mark.parametrize("seed", range(6))
def test_the_bias_is_that_of_the_formula(seed):
    rng = np.random.default_rng(seed)
    loop = SpeedLoop(
        inertia=rng.uniform(0.05, 0.3),
        gain=rng.uniform(0.5, 20.0),
        noise=rng.uniform(0.02, 0.1),
        disturbance=rng.uniform(0.0, 1.0),
    )
    measured, sent = loop.record(2000, 300, rng)
    error = regression(measured, sent, loop.dt) - 1.0 / loop.inertia
    sure = 5.0 * error.std() / np.sqrt(300) + 0.02 * loop.bias(2000)
    assert error.mean() == pytest.approx(loop.bias(2000), abs=sure)
    assert loop.bias(2000) > sure


def test_what_is_not_biased():
    rng = np.random.default_rng(3)
    loop = SpeedLoop()
    true = 1.0 / loop.inertia
    measured, sent = loop.record(2000, 300, rng)
    planned = loop.plan(2000)
    unbiased = [
        speed_output_error(measured, sent, loop.dt),
        with_instrument(measured, sent, planned, loop.dt),
    ]
    for changed in ({"gain": 0.0}, {"noise": 0.0, "disturbance": 1.0}):
        other = replace(loop, **changed)
        assert other.bias(2000) == 0.0
        unbiased.append(regression(*other.record(2000, 300, rng), loop.dt))
    for value in unbiased:
        assert abs(value.mean() - true) < 5.0 * value.std() / np.sqrt(300)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"inertia": 0.0}, "inertia"),
        ({"gain": -1.0}, "gain"),
        ({"gain": 100.0}, "gain"),
        ({"noise": -0.1}, "noise"),
        ({"disturbance": np.nan}, "disturbance"),
        ({"dt": 0.0}, "dt"),
    ],
)
def test_bad_loops(changed, message):
    with pytest.raises(ValueError, match=message):
        SpeedLoop(**changed)


def test_bad_scales():
    with pytest.raises(ValueError, match="scale"):
        weighted(angles_and_rates, clean(), (1.0, 1.0))
    with pytest.raises(ValueError, match="scale"):
        weighted(angles_and_rates, clean(), (1.0, 1.0, 0.0, 1.0))
    with pytest.raises(ValueError, match="noise"):
        weighted_covariance(np.ones((2, 3, 1)), (1.0, -1.0), (1.0, 1.0))
