"""Tracking: steady gains from Riccati's equation, consistency, age, the gate."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from scipy.stats import chi2

from course.perception.track import _GATES, Tracker, averaged_error, steady_gains
from tests.budget import examples

R = np.diag([1e-3, 1e-3, 0.02]) ** 2


@given(st.floats(-4.0, 2.0))
@examples(60)
def test_steady_gains_are_those_of_riccati(power):
    """Its predicted covariance P solves the equation; the gain is P H' / (H P H' + R)."""
    index = 10.0**power
    F, G = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.5], [1.0]])
    P = solve_discrete_are(F.T, np.array([[1.0], [0.0]]), index**2 * G @ G.T, np.eye(1))
    alpha, beta = steady_gains(index)
    assert abs(alpha - P[0, 0] / (P[0, 0] + 1.0)) < 1e-12 / min(1.0, index)
    assert abs(beta - P[0, 1] / (P[0, 0] + 1.0)) < 1e-12 / min(1.0, index)
    assert (
        0.0 < alpha < 1.0 and abs(beta - 2.0 * (2.0 - alpha) + 4.0 * math.sqrt(1.0 - alpha)) < 1e-7
    )


def test_the_filter_settles_at_the_steady_gains():
    T, sigma = 1 / 30, 1e-3
    index = 0.5 * T**2 / sigma
    full = Tracker((0.5, 2.0), gate=np.inf)
    for k in range(400):
        full.update(k * T, np.zeros(3), sigma**2 * np.eye(3))
    before = full.state.copy()
    full.update(400 * T, np.array([sigma, 0.0, 0.0]), sigma**2 * np.eye(3))
    alpha, beta = steady_gains(index)
    assert abs((full.state - before)[0] / sigma - alpha) < 1e-12
    assert abs((full.state - before)[3] * T / sigma - beta) < 1e-12
    # The steady filter then does the same, with the same covariance.
    steady = Tracker((0.5, 2.0), gate=np.inf, gains=(alpha, beta))
    steady.state, steady.covariance, steady.stamp = before, full.covariance, 399 * T
    steady.update(400 * T, np.array([sigma, 0.0, 0.0]), sigma**2 * np.eye(3))
    assert np.abs(steady.state[:2] - full.state[:2]).max() < 1e-12


def flight(rng, T, steps, acceleration, speed):
    """Truth of the filter's own model: states, (steps, 6)."""
    x = np.concatenate((np.zeros(3), speed * rng.standard_normal(3)))
    rows = [x]
    for _ in range(steps):
        a = acceleration * rng.standard_normal(3)
        x = np.concatenate((x[:3] + T * x[3:] + 0.5 * T * T * a, x[3:] + T * a))
        rows.append(x)
    return np.array(rows)


@pytest.mark.prove
@pytest.mark.parametrize("delay", [0.0, 0.1])
def test_the_covariance_of_a_prediction_is_what_happens(delay):
    """400 tracks; a prediction over the picture's age is as good as it says."""
    rng = np.random.default_rng(1)
    T, steps, ahead = 0.05, 12, round(delay / 0.05)
    a, v = np.array([0.5, 0.5, 2.0]), np.array([0.3, 0.3, 1.0])
    squares = []
    for _ in range(400):
        truth = flight(rng, T, steps + ahead, a, v)
        tracker = Tracker((0.5, 2.0), (0.3, 1.0), gate=np.inf)
        for k in range(steps):
            tracker.update(k * T, truth[k, :3] + np.sqrt(np.diag(R)) * rng.standard_normal(3), R)
        last = tracker.stamp
        x, P = tracker.state, tracker.covariance
        for j in range(ahead):  # the model's accelerations change with each period
            tracker.state, tracker.covariance = tracker._at(last + (j + 1) * T)
            tracker.stamp = last + (j + 1) * T
        x, P = tracker.predict(last + ahead * T)
        e = x - truth[steps - 1 + ahead, :3]
        squares.append(e @ np.linalg.solve(P, e))
    low, high = chi2.ppf((1e-3, 1.0 - 1e-3), 3 * 400) / 400
    assert low < np.mean(squares) < high


def test_the_stamp_is_that_of_the_picture():
    """A part at 0.2 m/s, seen 100 ms late: stamped when taken no error, when it arrived 20 mm."""
    late = []
    for shift in (0.0, 0.1):
        tracker = Tracker((0.01, 0.01))
        for k in range(60):
            tracker.update(0.03 * k + shift, (0.2 * 0.03 * k, 0.0, 0.0), R)
        now = 0.03 * 59 + 0.1
        late.append(0.2 * now - tracker.predict(now)[0][0])
    assert abs(late[0]) < 1e-4 and abs(late[1] - 0.02) < 1e-4


def test_a_turn_is_the_same_after_its_period():
    tracker = Tracker(period=math.pi)
    for k in range(10):
        assert tracker.update(0.1 * k, (0.0, 0.0, 0.3 + math.pi * (k % 2)), R)
    assert abs(tracker.state[2] - 0.3) < 1e-9


def test_a_gate_locks_itself_out_without_patience():
    """After a jump every picture is right and none is taken, until the track starts anew."""
    taken = {}
    for patience in (0, 5):
        tracker = Tracker((0.05, 0.1), patience=patience)
        for k in range(60):
            tracker.update(0.03 * k, (0.0, 0.0, 0.0), R)
        taken[patience] = [tracker.update(0.03 * k, (0.5, 0.0, 0.0), R) for k in range(60, 90)]
        far = abs(tracker.predict(2.7)[0][0] - 0.5)
        assert far > 0.4 if patience == 0 else far < 1e-3
    assert not any(taken[0]) and taken[5].index(True) == 4 and all(taken[5][4:])


def test_the_gate_refuses_one_in_a_thousand():
    assert np.abs(chi2.sf(_GATES, (1, 2, 3)) - 1e-3).max() < 1e-5


def test_what_is_not_seen_is_not_learned():
    tracker = Tracker()
    tracker.update(0.0, np.zeros(3), R)
    blind = R.copy()
    blind[2, 2] = np.inf
    before = tracker._at(0.1)[1][2, 2]
    assert tracker.update(0.1, (1e-3, 0.0, 1.0), blind)
    assert tracker.state[2] == 0.0 and abs(tracker.covariance[2, 2] - before) < 1e-15


@given(st.integers(0, 1000), st.floats(0.0, 0.2))
@examples(5)
def test_the_mean_of_pictures_lags(seed, speed):
    rng = np.random.default_rng(seed)
    sigma, T, k = 1e-3, 1 / 30, 4
    z = speed * T * np.arange(k) + sigma * rng.standard_normal((4000, k))
    error = np.sqrt(np.mean((z.mean(axis=1) - speed * T * (k - 1)) ** 2))
    assert abs(error / averaged_error(k, sigma, T, speed) - 1.0) < 0.06


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda t: t.update(0.5, np.zeros(3), R), "stamp"),
        (lambda t: t.predict(0.5), "stamp"),
        (lambda t: Tracker().predict(0.0), "after the first update"),
        (lambda t: Tracker().update(0.0, np.zeros(3), np.diag([1.0, 1.0, np.inf])), "finite for"),
        (lambda t: t.update(1.5, (0.0, np.nan, 0.0), R), "z"),
        (lambda t: t.update(1.5, np.zeros(3), -R), "positive variances"),
        (lambda t: Tracker((-1.0, 1.0)), "acceleration"),
        (lambda t: steady_gains(0.0), "index"),
        (lambda t: averaged_error(0, 1.0, 1.0, 1.0), "k"),
    ],
)
def test_bad_input_is_named(call, words):
    tracker = Tracker()
    tracker.update(1.0, np.zeros(3), R)
    with pytest.raises(ValueError, match=words):
        call(tracker)
