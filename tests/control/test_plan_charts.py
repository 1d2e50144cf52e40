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
    assert float(rates.notes[-1].split()[-2]) < 1e-12  # of both rivals
    assert [series.label for series in rates.series] == ["course", "mujoco.batch", "mujoco.rollout"]
    assert "quartiles" in rates.notes[0] and "quartiles" in answers.notes[0]
    assert len(answers.series) == 4
    system = plans.drawn(np.random.default_rng(1), 6)
    assert plans.residual(system, plans.lqr(*system).P) < 1e-12


def test_laws_are_compared_at_equal_stiffness() -> None:
    """With a wrong model the law hardly matters; with the right one it decides."""
    right, wrong = build("equal_stiffness", gains=(100.0, 800.0))
    for panel, low, high in ((right, 100.0, 1000.0), (wrong, 0.5, 1.0)):
        ratio = np.array(panel["PD + gravity"].y) / panel["computed torque"].y
        assert low < ratio.min() and ratio.max() < high
    # The springs are those of the law: a small angle costs both the same torque at the start.
    stiff, damp = tracking.springs(tracking.WRONG, 800.0, 20.0)
    law = tracking.JointLaw("computed_torque", tracking.WRONG, 800.0, 20.0)
    still = np.array([0.0, 0.6]), np.zeros(2)
    torque = [
        law(*still, still[0] + push, np.zeros(2), np.zeros(2))
        for push in (np.zeros(2), np.array([0.0, 1e-3]))
    ]
    assert (torque[1] - torque[0])[1] == pytest.approx(1e-3 * stiff[1], rel=1e-6)
    assert np.divide(damp, stiff) == pytest.approx(20.0 / 800.0)
