"""Chapter 9's simulations: what each preset says is so, by what is judged."""

import numpy as np
import pytest

from course.learning import Diverged, Settings, evaluate, one_thread, ppo
from course.simulations.learning import point, simulation, two_ways
from course.simulations.model import Experiment
from course.vector_env import PointReachVector
from course.vector_env.point import DISCOUNT, RADIUS, optimum, plan

pytestmark = pytest.mark.slow


def run(preset, **values):
    """The experiment, and what is told of each iteration, by column."""
    experiment = Experiment(point.MODEL)
    experiment.choose(preset)
    experiment.set(**values)
    return experiment, experiment.state["told"].T


def test_the_potential_brings_all_to_the_disc_and_the_other_rewards_do_not():
    now, told = run("Potential")
    assert told[point.SUCCESS, -1] == 1.0 and 0.85 < told[point.SHARE, -1] < 1.0
    assert told[point.SUCCESS, 0] < 0.2 and np.all(told[point.RETURN] < now.state["best"])
    for name in ("The disc alone", "Minus the distance"):
        other, told = run(name)
        assert told[point.SUCCESS].max() < 0.25, name
    assert told[point.RETURN].max() < -20.0  # against a prize of 1
    assert "optimum: not known" in other.picture().text


def test_what_is_judged_is_one_episode_of_each_common_start():
    now, told = run("One epoch")
    settings = Settings(
        horizon=point.HORIZON, minibatches=4, hidden=(16, 16), rate=5e-3, epochs=1)  # fmt: skip
    envs = PointReachVector(point.POINTS, "potential", autoreset_mode="SameStep")
    test = PointReachVector(point.STARTS, "potential", autoreset_mode="Disabled")
    steps = point.ITERATIONS * point.POINTS * point.HORIZON
    with one_thread():
        *_, last = ppo(envs, settings, steps=steps)
        played = evaluate(last.policy, test, point.FIRST)
    assert told[point.SUCCESS, -1] == played.success.mean() < 0.5
    assert told[point.RETURN, -1] == pytest.approx(played.returns.mean())
    assert told[point.MOVED].mean() < 0.3 * run("Potential")[1][point.MOVED].mean()
    ways, ends = now.state["paths"][-1], now.state["steps"][-1]
    assert np.array_equal(ends, played.steps[: point.SHOWN])
    inside = np.hypot(*ways.transpose(1, 0, 2)) < RADIUS
    for i, end in enumerate(ends):
        assert inside[i, end] == now.state["there"][-1, i] and not inside[i, :end].any()


def test_the_ways_of_the_best_policy_take_the_least_steps():
    envs = PointReachVector(point.STARTS)
    starts, _ = envs.reset(seed=point.FIRST)
    played, ways = point.judged(lambda seen: plan(seen)[1].astype(np.float32), envs)
    assert np.array_equal(played.steps, plan(starts)[0])
    np.testing.assert_allclose(ways[:, :, 0], -starts[:, :2].T, atol=1e-15)
    assert np.all(np.hypot(*ways[:, :, -1]) < RADIUS)  # it stays where its episode ended
    assert played.returns == pytest.approx(optimum(starts))


def test_each_detail_left_out_costs_what_its_preset_says():
    whole = run("Potential")[1]
    assert run("Lambda 0")[1][point.SUCCESS].max() < 0.2
    short = run("Discount 0.9")[1]
    assert short[point.SUCCESS, 8] > whole[point.SUCCESS, 8] + 0.1
    assert short[point.SUCCESS, -1] < 0.95
    assert run("No reward scaling")[1][point.SUCCESS, -1] < 0.2
    assert run("No reward scaling", seed=1)[1][point.SUCCESS, -1] > 0.95


def test_hovering_is_paid_and_does_not_arrive():
    now, told = run("Hovering")
    assert told[point.RETURN, -1] > 1.4 * told[point.RETURN, 0] and told[point.SUCCESS, -1] < 0.3
    ways = np.hypot(*now.state["paths"][-1].transpose(1, 0, 2))
    assert np.all(ways[:, -1] < 0.5)  # within the circle
    assert told[point.RETURN, -1] == pytest.approx(
        0.02 * (1.0 - DISCOUNT**100) / (1.0 - DISCOUNT), rel=0.05)  # fmt: skip


def test_the_first_to_finish_read_more_than_is_true():
    told = run("First to finish")[1]
    excess = told[point.READ] - told[point.SUCCESS]
    assert excess.max() > 0.12 and excess.min() > -0.02
    assert told[point.READ, 17] == 1.0 and told[point.SUCCESS, 17] < 0.95


def test_a_run_that_diverges_keeps_its_last_picture(monkeypatch):
    def stopped(*arguments, **settings):
        iterations = ppo(*arguments, **settings)
        yield next(iterations)
        yield next(iterations)
        raise Diverged("too far")

    monkeypatch.setattr(point, "ppo", stopped)
    told, _, paths, *_ = point.learned.__wrapped__(5.0, 1, 3, point.POTENTIAL, 0, 0)
    assert np.array_equal(told[-1], told[1]) and not np.array_equal(told[1], told[0])
    assert np.array_equal(paths[-1], paths[1])


def test_a_drag_along_a_chart_shows_an_iteration_to_its_end():
    now, _ = run("Potential")
    left, right, low, _ = point._UPPER
    now.drag(left + (right - left) * 20.0 / point.ITERATIONS, low)
    assert "steps so far: 40960" in now.picture().text
    panel = simulation()
    assert "success" in repr(panel)
    panel.close()


@pytest.mark.parametrize(("preset", "values", "least", "most"), [
    ("The mean", {}, 0, 5), ("The mean", {"executed": 1}, 6, 25), ("A mixture", {}, 85, 100),
    ("A flow", {}, 75, 95), ("A flow in one step", {}, 10, 40),
    ("A flow in one step", {"sampled": 2}, 50, 75), ("Diffusion", {}, 70, 95),
    ("Noise, eight blind steps", {}, 10, 27), ("Noise, eight blind steps", {"executed": 2}, 28, 50),
])  # fmt: skip
def test_a_hundred_runs_pass_the_disc_as_their_preset_says(preset, values, least, most):
    now = Experiment(two_ways.MODEL)
    now.choose(preset)
    now.set(**values)
    side, ways = now.state["side"], now.state["ways"]
    assert least <= np.sum(side != 0) <= most
    if least > 50:  # both ways, nearly as often as they were shown
        assert abs(int(np.sum(side))) < 25
    # Whoever passed has no point within the disc and ends where the demonstrations do.
    good = ways[side != 0]
    assert np.all(np.hypot(good[..., 0] - 0.5, good[..., 1]) >= 0.2)
    assert np.all(np.hypot(good[:, -1, 0] - 1.0, good[:, -1, 1]) <= 0.15)
