"""What is learned beside a model: the torques that it lacks, and what that buys where."""

import numpy as np
import pytest

from course.control.residual import Learned, fit, lacking, learn
from course.control.tracking import JointLaw, track
from course.kinematics import TwoLink
from tests.control.test_laws import ARM, GAINS, HEAVY, sweep


def test_what_a_log_lacks_is_the_difference_of_the_two_arms():
    law = JointLaw("computed_torque", ARM, *GAINS)
    worst = []
    for dt in (4e-3, 2e-3):
        x, torque = lacking(ARM, track(HEAVY, law, sweep, dt, 1.0))
        known = HEAVY.inverse_dynamics(*np.split(x, 3)) - ARM.inverse_dynamics(*np.split(x, 3))
        worst.append(np.abs(torque - known).max() / np.abs(torque).max())
    assert worst[1] < 1e-4
    assert worst[0] / worst[1] == pytest.approx(4.0, abs=0.5)
    # A run that diverges is used as far as it went; the same numbers come from a chain.
    wild = track(ARM, JointLaw("pd", ARM, 1e6, 0.0), sweep, 0.02, 1.0, 1, ([2.0, 1.0], [0.0, 0.0]))
    assert 0 < lacking(ARM, wild)[0].shape[1] < 50


def test_waves_fit_what_they_span_and_a_smooth_function_nearly():
    rng = np.random.default_rng(0)
    x = rng.normal(size=(6, 3000))
    drawn = fit(x, x[:2], np.random.default_rng(1), features=40)
    truth = rng.normal(size=(2, 40))
    same = fit(x, truth @ drawn.waves(x), np.random.default_rng(1), features=40, ridge=1e-15)
    assert same.weights == pytest.approx(truth, rel=1e-6, abs=1e-6)
    smooth = np.array([np.sin(x[0]) * x[4], x[2] ** 2])
    result = fit(x[:, :2000], smooth[:, :2000], rng, features=400, width=0.3, ridge=1e-9)
    remaining = result.weights @ result.waves(x[:, 2000:]) - smooth[:, 2000:]
    assert remaining.std() < 0.05 * smooth.std()
    assert result.waves(x[:, 7]) == pytest.approx(result.waves(x)[:, 7], abs=1e-12)


@pytest.mark.prove
def test_a_learned_law_tracks_where_it_was_trained_and_less_well_elsewhere():
    wrong = TwoLink(gravity=9.81)
    law = Learned(wrong, *GAINS)

    def run(law, size=1.0, dt=4e-3):
        return track(HEAVY, law, lambda t: [size * x for x in sweep(t)], dt, 4.0)

    def error(law, size=1.0):
        done = run(law, size)
        return np.abs(done.q[:, :-1] - done.setpoint)[:, 250:].max()

    laws = learn(law, run, np.random.default_rng(0))
    plain = run(JointLaw("computed_torque", wrong, *GAINS))
    np.testing.assert_allclose(run(laws[0]).q, plain.q, atol=1e-12)
    inside = error(laws[-1])
    assert inside < 0.02 * error(law)
    assert inside < error(laws[-1], 1.6)
    assert len(laws) == 6


X = np.random.default_rng(0).normal(size=(6, 9))


def collect(law):
    return track(ARM, law, sweep, 0.1, 1.0)


BAD = {
    "x": lambda: fit([1.0], X[:2], np.random.default_rng(0)),
    "torque": lambda: fit(X, X[:2, :5], np.random.default_rng(0)),
    r"x\.std": lambda: fit(0.0 * X, X[:2], np.random.default_rng(0)),
    "width": lambda: fit(X, X[:2], np.random.default_rng(0), width=0.0),
    "ridge": lambda: fit(X, X[:2], np.random.default_rng(0), ridge=-1.0),
    "features": lambda: fit(X, X[:2], np.random.default_rng(0), features=0),
    "rounds": lambda: learn(Learned(ARM, 1.0, 1.0), collect, np.random.default_rng(0), 0),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_named(name):
    with pytest.raises(ValueError, match=rf"^{name}[ .\[(].*must be"):
        BAD[name]()
