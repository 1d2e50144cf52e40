"""The chart of gradients through a bounce: how wrong each is, never how long it takes."""

import numpy as np
import pytest

from course.charts import build
from course.charts.rigid_body import gradients
from course.oracles.mujoco import box
from course.rigid_body.integrators import STANDARD_GRAVITY


@pytest.mark.parametrize("height", [0.8, 1.0, 1.3])
def test_the_closed_form_is_the_derivative_of_the_run_from_event_to_event(height):
    assert gradients.event_differences(height) == pytest.approx(
        gradients.exact_gradient(height), abs=1e-8
    )


def test_a_contact_with_a_smooth_onset_bounces_as_wanted():
    reference = box.soft_reference(0.6, 4.0, 0.02, 0.05)
    height = 4.0**2 / (2.0 * STANDARD_GRAVITY)
    runner = box.ball_drop(height, 1e-4, reference, onset=0.05, gravity=STANDARD_GRAVITY)
    speed = runner.samples(7000).v[0]
    assert -speed.max() / speed.min() == pytest.approx(0.6, rel=0.03)  # gravity acts as well


def test_the_product_of_mujocos_step_derivatives_is_that_of_its_run():
    reference = box.soft_reference(0.6, 4.4, 0.02, 0.05)
    runner = box.ball_drop(1.0, 2e-3, reference, onset=0.05, gravity=STANDARD_GRAVITY)
    for height in (0.97, 1.0, 1.04):
        chain = gradients.mujoco_chain(runner, height)
        assert chain == pytest.approx(
            gradients.mujoco_differences(runner, 1e-7, height), rel=1e-3, abs=1e-3
        )


@pytest.mark.slow
def test_only_impact_times_make_the_derivative_exact():
    (panel,) = build(
        "gradient_precision",
        steps=(8e-3, 4e-3, 2e-3),
        differences=(1e-2, 3e-2, 0.1),
        starts=6,
        repeats=1,
    )
    assert panel["course, impact times, autograd"].y[0] < 1e-12
    assert panel["course, impact times, two runs"].y[0] < 1e-8
    truth = np.mean([gradients.exact_gradient(z) for z in np.linspace(1.0, 1.05, 20)])
    # At the end of a step, with the ball put on the floor: 0. MuJoCo's one-step bounce: 1.
    assert np.allclose(panel["course, end of step"].y, truth, atol=0.03)
    assert np.allclose(panel["MuJoCo, impulse, step"].y, 1.0 - truth, atol=0.03)
    assert min(panel["MuJoCo, soft, step"].y) > 0.1
    wide = panel["MuJoCo, impulse, two runs"].y
    assert wide[-1] < 0.03 and wide[-1] < 0.5 * wide[0]
