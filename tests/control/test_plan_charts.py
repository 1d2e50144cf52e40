"""What the charts of tracking, plans and logs show, on smaller sizes."""

import numpy as np
import pytest

from course.charts import build
from course.charts.control import plans, tracking


def test_laws_that_follow_and_what_a_wrong_model_does_to_them() -> None:
    errors = {
        (name, model): [tracking.error(tracking.LAWS[name](model, dt), dt) for dt in (8e-3, 4e-3)]
        for name in ("computed torque", "half-sample preview", "adaptive law")
        for model in (tracking.ARM, tracking.WRONG)
    }
    plain, ahead = (errors[n, tracking.ARM] for n in ("computed torque", "half-sample preview"))
    assert plain[0] / plain[1] == pytest.approx(2.0, abs=0.1)
    assert ahead[0] / ahead[1] == pytest.approx(4.0, abs=0.3)
    wrong = errors["computed torque", tracking.WRONG][0]
    assert errors["adaptive law", tracking.WRONG][0] < 0.01 * wrong


def test_both_libraries_follow_as_the_compiled_loop_does() -> None:
    dt, gains = 8e-3, (np.full(2, tracking.KP), np.full(2, tracking.KD))
    rows = np.array(tracking.motion(dt * (np.arange(50) + 0.5)))
    ends = [follow(rows, *gains, dt)() for follow in tracking.FOLLOW.values()]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-13)
    law = tracking.LAWS["half-sample preview"](tracking.ARM, dt)
    q0, v0 = ends[0][0], rows[1, :, 0] - 0.5 * dt * rows[2, :, 0]
    run = tracking.track(tracking.ARM, law, rows, dt, 50 * dt, state=(q0, v0))
    np.testing.assert_allclose(run.q.T, ends[0], atol=1e-13)


def test_where_the_limit_binds_on_one_side_a_plan_saves_nothing() -> None:
    saving, times = build("mpc_where", points=4, samples=(10, 20), repeats=1)
    few, more = saving.series
    assert few.y[0] == pytest.approx(1.0, abs=1e-9) and 1.2 < few.y[-1] < more.y[-1]
    assert len(times.series) == 2


def test_a_pendulum_swings_up_with_tries_and_foresight() -> None:
    tries, ahead = build("swing_up", samples=(2, 64), ahead=(4, 20), seeds=3)
    for panel in (tries, ahead):
        assert panel.series[0].y[0] < 0.5 < panel.series[0].y[1]


def test_rollouts_are_mujocos_and_answers_scipys() -> None:
    rates, answers = build(
        "control_speed", plans=(8,), samples=20, sizes=(4,), systems=5, repeats=1
    )
    assert float(rates.notes[0].split()[-2]) < 1e-12
    assert len(answers.series) == 4
    system = plans.drawn(np.random.default_rng(1), 6)
    assert plans.residual(system, plans.lqr(*system).P) < 1e-12
