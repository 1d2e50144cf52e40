"""Each part alone beside its prediction, the sum beside the whole, and who owns how much."""

import math
from dataclasses import replace

import numpy as np
import pytest

from course.middleware import run_chain
from course.perception.track import steady_gains
from course.pipeline import Scenario, Settings, repair, run_many, theory
from course.pipeline.budget import Budget, budget, predicted
from course.pipeline.run import errors
from course.role import Stage
from course.sim_to_real.transfer import subsets

SCENE, PARTS = Scenario(), ("perceive", "age", "control")
PLANNED = repair(Settings(), "plan")


@pytest.fixture(scope="module")
def measured():
    return budget(SCENE, PLANNED, range(60), PARTS)


@pytest.mark.prove
def test_each_part_alone_and_all_together_are_what_was_predicted(measured):
    for some in subsets(PARTS):
        (mean, deviation), (report, covariance) = measured.mean(some), measured.moments[some]
        n = measured.errors[some].shape[1]
        chance = np.maximum(deviation, math.sqrt(covariance[0, 0] / n))
        assert np.all(np.abs(mean - report) < 4.0 * chance + 2e-4), some
        if "perceive" in some:
            assert np.abs(measured.errors[some] - report[:, None]).max() < 4e-4
        else:
            ratio = measured.errors[some].var(axis=1, ddof=1) / np.diag(covariance)
            assert np.all((ratio > 0.5) & (ratio < 1.7)), some
    everything = predicted(SCENE, repair(PLANNED, *PARTS))
    assert not everything[0].any() and not everything[1].any()


def test_the_error_that_chapter_11_predicts_of_age_is_speed_times_the_age_on_the_bus():
    scene = Scenario(velocity=(-0.02, 0.015), seconds=3.0)
    settings = Settings(noise=0.0, bias=(0.0, 0.0), filtered=False, frame=0.1, latency=0.15)
    late, fresh = (predicted(scene, s)[0] for s in (settings, repair(settings, "age")))
    speed, times = np.array(scene.velocity), np.random.default_rng(0).uniform(1.0, 90.0, 50_000)
    bus = run_chain([Stage("camera", 0.15, 0.1, overload="pipelined")], [0.3], 0, 91.0)
    assert np.allclose(late - fresh, -speed * bus.age(times).mean(), rtol=0.003)


@pytest.mark.prove
def test_the_signed_parts_add_up_and_the_squares_do_not(measured):
    gap, deviation = measured.gap()
    assert np.all(np.abs(gap) < 4.0 * deviation + 3e-4)
    squares, shares = measured.squares(), measured.shares(60)
    whole = squares[frozenset()]
    assert sum(share for share, _, _ in shares.values()) == pytest.approx(
        whole - squares[measured.only()], rel=1e-9
    )
    for share, low, high in shares.values():
        assert low <= share <= high
    alone = sum(squares[measured.only(part)] for part in PARTS)
    assert abs(alone / whole - 1.0) > 0.01
    assert shares["perceive"][0] > 0.8 * whole


@pytest.mark.parametrize(
    "change",
    [
        {"kp": 60.0},
        {"kd": 3.0},
        {"latency": 0.4},
        {"frame": 0.2},
        {"filtered": False},
        {"phase": 0.02},
        {"carried": True},
    ],
)
def test_the_prediction_follows_the_settings(change):
    """With hardly any noise, so that a few runs show the mean to a tenth of a millimetre."""
    for ideal in ((), ("control",)):
        settings = repair(replace(PLANNED, noise=1e-5, **change), *ideal)
        observed = errors(run_many(SCENE, settings, range(3))).mean(axis=1)
        assert np.abs(observed - predicted(SCENE, settings)[0]).max() < 4e-4, ideal


def test_a_tilted_table_is_part_of_the_prediction():
    scene, settings = replace(SCENE, tilt=0.06), replace(PLANNED, noise=1e-5)
    observed = errors(run_many(scene, settings, [0]))[:, 0]
    report = predicted(scene, settings)[0]
    level = predicted(SCENE, settings)[0]
    assert np.linalg.norm(report - level) > 4e-3
    assert np.linalg.norm(observed - report) < 0.1 * np.linalg.norm(report - level)


def test_a_filter_that_is_not_settled_becomes_the_settled_one():
    lam = 0.05
    pull, gain = theory.settling(400, 1.0, 1.0, lam)
    assert gain == pytest.approx(theory.filter_gain(*steady_gains(lam)), rel=1e-3)
    assert abs(pull) < 1e-6  # the speed has been learnt
    # A prior that is far too narrow never lets go: the mean of all places, half the way behind.
    pull, gain = theory.settling(100, 0.1, 1e-6, 0.0)
    assert pull == pytest.approx(-0.5 * 9.9, rel=1e-4)
    assert gain == pytest.approx(0.01, rel=1e-4)
    # And with keep it is the arm's low pass of pictures that are taken as they are.
    raw = theory.settling(300, 0.1, 1e9, 1e9, math.exp(-0.1 / 0.33))
    assert raw[1] == pytest.approx(theory.low_pass(0.1, 0.33), rel=1e-6)


def test_orders_and_bands_of_a_budget_made_by_hand():
    """Two parts of 3 mm that point against each other, and one of 4 mm across."""
    parts = {"a": (3e-3, 0.0), "b": (-3e-3, 0.0), "c": (0.0, 4e-3)}
    held = {
        some: np.sum([at for name, at in parts.items() if name not in some], axis=0)
        .reshape(-1, 1)
        .repeat(5, axis=1)
        * np.ones((2, 5))
        if len(some) < 3
        else np.zeros((2, 5))
        for some in subsets(parts)
    }
    made = Budget(
        tuple(parts), held, {some: (x[:, 0], np.zeros((2, 2))) for some, x in held.items()}
    )
    assert {name: round(1e6 * s, 9) for name, (s, *_) in made.shares(5).items()} == {
        "a": 0.0,
        "b": 0.0,
        "c": 16.0,
    }
    assert made.orders() == []
    assert np.allclose(made.gap()[0], 0.0)
    assert made.rms(frozenset()) == pytest.approx((4e-3, 4e-3))


def test_what_cannot_be_predicted_or_compared_is_refused():
    with pytest.raises(ValueError, match="law"):
        predicted(SCENE, Settings(law="computed_torque"))
    with pytest.raises(ValueError, match="overrun"):
        predicted(SCENE, Settings(overrun="queue"))
    # At 50 ms the arm rattles between its motors' limits: no formula says where.
    unstable = Settings(physics=0.05, control=0.05)
    with pytest.raises(ValueError, match=r"physics must be .*stability limit.*, got 0.05"):
        predicted(SCENE, unstable)
    with pytest.raises(ValueError, match="physics"):
        budget(SCENE, unstable, range(2), ("age",))
    assert np.isfinite(predicted(SCENE, repair(unstable, "move"))[0]).all()
    with pytest.raises(ValueError, match="two or more runs"):
        budget(SCENE, PLANNED, [0], ("age",))


def test_a_picture_that_arrives_in_the_last_step_is_too_late_for_it():
    """A thirtieth of a second: the last but one is what an ideal arm stands at."""
    case = repair(replace(PLANNED, noise=0.0, bias=(0.0, 0.0), frame=1.0 / 30.0), "control")
    observed = errors(run_many(SCENE, case, [0]))[:, 0]
    assert np.abs(observed - predicted(SCENE, case)[0]).max() < 5e-5
