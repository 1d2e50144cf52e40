"""The hopper of chapter 7: its physics, its filter against least squares, its bound, the judge."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.stats import chi2

from course import charts
from course.perception.hopper import CONTACT, GRAVITY, hop_bound, hop_filter, hop_logs
from drills.cards import card
from drills.catalogue.hopper_filter.exercise import chi_squared_band
from drills.grader import attempt
from drills.verify import in_this_process
from solutions.perception import hopper_filter


def logs(seed, count, **changed):
    return hop_logs(np.random.default_rng(seed), count, **changed)


def errors(log, answer):
    return answer - np.column_stack((log.height, log.velocity))


def test_a_hopper_falls_freely_in_flight_and_conserves_energy_over_a_vertical_hop():
    for log in logs(1, 10, reach=0.0):
        flight = ~(log.stance[1:] | log.stance[:-1])
        fall = np.diff(log.velocity)[flight]
        np.testing.assert_allclose(fall, -GRAVITY * log.dt, atol=1e-9)
        energy = (GRAVITY * log.height + 0.5 * log.velocity**2)[~log.stance]
        assert np.ptp(energy) < 1e-3 * energy[0]
        assert 2 <= np.sum(np.diff(log.stance.astype(int)) == 1) <= 5


def test_sensors_report_what_they_say():
    """The mean force of an interval, the leg's length in stance, its rest length in flight."""
    away = []
    for log in logs(2, 40):
        truth = np.where(log.stance, np.hypot(log.height, log.offset), log.rest)
        away.append((log.length - truth) / log.noise[1])
        bias = log.force[1:] - GRAVITY - np.diff(log.velocity) / log.dt
        assert np.std(bias) == pytest.approx(log.noise[0], rel=0.2)
        assert np.mean(log.contact != log.stance) > 0.01
    assert np.mean(away) == pytest.approx(0.0, abs=0.05)
    assert np.std(away) == pytest.approx(1.0, abs=0.05)
    right = logs(3, 4, late=0, wrong=0.0)
    assert all(np.array_equal(log.contact, log.stance) for log in right)


def test_a_filter_of_a_linear_log_is_weighted_least_squares():
    """Without an offset all is linear: batch least squares over all noises is the truth."""
    (log,) = logs(4, 1, reach=0.0, samples=80, late=0, wrong=0.0)
    used = np.flatnonzero(log.contact)
    assert used.size > 5
    n, dt = len(log.force), log.dt

    def whitened(z):
        x, w, rows = z[:3] * log.spread + log.start, log.noise[0] * z[3:], []
        h, v = x[:2]
        for i in range(n):
            if i:
                a = log.force[i] - GRAVITY - x[2] - w[i - 1]
                h, v = h + dt * v + 0.5 * dt * dt * a, v + dt * a
            if i in used:
                rows.append((log.length[i] - h) / log.noise[1])
        return np.concatenate((z, rows)), np.array([h, v])

    zero = np.zeros(n + 2)
    residual, end = whitened(zero)
    J = np.array([whitened(e)[0] - residual for e in np.eye(n + 2)]).T
    E = np.array([whitened(e)[1] - end for e in np.eye(n + 2)]).T
    information = J.T @ J
    best = end - E @ np.linalg.solve(information, J.T @ residual)
    states, covariances = hop_filter(log, "flag")
    np.testing.assert_allclose(states[-1], best, atol=1e-8)
    np.testing.assert_allclose(covariances[-1], E @ np.linalg.solve(information, E.T), rtol=1e-5)
    np.testing.assert_allclose(hop_bound(log), covariances, rtol=1e-9)


def test_the_slope_of_the_leg_is_its_derivative():
    """The covariance after one exact reading says which slope the filter used."""
    (log,) = logs(5, 1, samples=2)
    height, offset = 0.5, 0.2
    one = log._replace(
        force=np.array([30.0, 30.0]),
        offset=np.array([offset, offset]),
        contact=np.ones(2),
        length=np.full(2, np.hypot(height, offset)),
        start=np.array([height, 0.0, 0.0]),
    )
    P = hop_filter(one, "flag")[1][0, 0, 0]
    slope = approx_fprime(np.array([height]), lambda h: np.hypot(h[0], offset))[0]
    prior = log.spread[0] ** 2
    assert P == pytest.approx(1.0 / (1.0 / prior + slope**2 / log.noise[1] ** 2), rel=1e-6)


@pytest.mark.prove
def test_the_worked_answer_reaches_the_bound_and_is_the_chapters():
    drawn, yours, least, nees = logs(6, 100), [], [], []
    for log in drawn:
        states, covariances = hopper_filter(*log.sensors)
        ours = hop_filter(log, "load and gate")
        np.testing.assert_allclose(states, ours[0], atol=1e-9)
        np.testing.assert_allclose(covariances, ours[1], atol=1e-12)
        away = errors(log, states)
        yours.append(np.mean(away[100:] ** 2, axis=0))
        least.append(np.mean(hop_bound(log)[100:, [0, 1], [0, 1]], axis=0))
        nees.append(away[-1] @ np.linalg.solve(covariances[-1], away[-1]))
    ratio = np.sqrt(np.mean(yours, axis=0) / np.mean(least, axis=0))
    assert np.all((ratio > 0.8) & (ratio < 1.2))
    assert chi2.ppf(1e-4, 200) < np.sum(nees) < chi2.ppf(1 - 1e-4, 200)


def test_the_judges_band_is_that_of_scipy():
    for degrees in (60, 84, 200):
        expected = chi2.ppf([1e-4, 1.0 - 1e-4], degrees)
        np.testing.assert_allclose(chi_squared_band(degrees), expected, rtol=5e-3)


@pytest.mark.slow
def test_no_estimate_is_decided_by_rounding():
    for log in logs(8, 10):
        more = 1.0 + 1e-12
        moved = log._replace(
            force=log.force * more,
            length=log.length * more,
            offset=log.offset * more,
            start=log.start * more,
            noise=log.noise * more,
            dt=log.dt * more,
        )
        for k in range(2):
            before, after = (hopper_filter(*one.sensors)[k] for one in (log, moved))
            np.testing.assert_allclose(before, after, atol=1e-7)


INFORMATION = """
import math
import numpy as np

def hopper_filter(force, length, offset, contact, start, spread, noise, rest, dt):
    # An information filter in height, velocity and bias; contact when the leg is short and loaded.
    x = np.array(start, dtype=float)
    Y = np.diag(1.0 / np.square(spread))
    F = np.eye(3); F[0, 1] = dt; F[0, 2] = -dt * dt / 2; F[1, 2] = -dt
    xs, Ps = [], []
    for i, f in enumerate(force):
        P = np.linalg.inv(Y)
        if i:
            g = np.array([dt * dt / 2, dt, 0.0])
            x = F @ x + g * (f - 9.81)
            P = F @ P @ F.T + noise[0] ** 2 * np.outer(g, g)
        Y = np.linalg.inv(P)
        if f - x[2] > 5.5 * math.hypot(noise[0], P[2, 2] ** 0.5):
            leg = math.hypot(x[0], offset[i])
            h = np.array([x[0] / leg, 0.0, 0.0])
            if abs(length[i] - leg) < 5.0 * math.sqrt(h @ P @ h + noise[1] ** 2):
                Y = Y + np.outer(h, h) / noise[1] ** 2
                x = x + np.linalg.solve(Y, h) * (length[i] - leg) / noise[1] ** 2
        xs.append(x[:2]); Ps.append(np.linalg.inv(Y)[:2, :2])
    return np.array(xs), np.array(Ps)
"""


@pytest.mark.prove
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("style", ["information filter", "flag, load and gate"])
def test_the_judge_accepts_other_right_styles(style, seed):
    graded = card("hopper_filter")
    text = INFORMATION
    if style != "information filter":
        text = graded.solution_text().replace("    if force[i]", "    if contact[i] and force[i]")
    report = attempt(graded, text, seed=seed, place=in_this_process).report
    assert report.passed, report.sentence


@pytest.mark.slow
def test_the_chart_separates_the_rules():
    height, consistency = charts.build("hopper_errors", logs=40)
    bound = height["Cramér-Rao bound"].y
    for rule in CONTACT[1:]:
        late = np.sqrt(np.mean(np.square(height[rule].y[100:]) / np.square(bound[100:])))
        assert late < 1.6 if "load" in rule else late > 4.0
        assert np.median(consistency[rule].y) < 2.0 if "load" in rule else True
