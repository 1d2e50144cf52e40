"""The late tool and the sure perception stage: closed forms of what each fault does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from course.interview.scenarios import late, sure
from course.interview.scenarios.programs import late as chain
from course.interview.scenarios.programs import sure as stage
from tests.budget import examples

SEEDS = st.integers(0, 2**32 - 1)


# --- The late tool --------------------------------------------------------------------------------


@pytest.mark.parametrize("cause", late.FAULTS)
@pytest.mark.parametrize("seed", range(3))
def test_the_lag_is_the_sum_of_the_delays(cause: str, seed: int) -> None:
    """Of a ramp: dead times, time constants, half of each holding time; a stall by its square."""
    one = late.line(cause, seed)
    hold = one.period * (1.0 + one.stall / one.every) / 2.0
    mean_stall = one.stall**2 / (2.0 * (one.every if one.stall else 1.0))
    images = (one.depth - 1) * one.vision
    # The filter works in steps of the loop: its lag on a ramp is that of a geometric series.
    share = np.exp(-one.period / one.tau)
    filtering = one.period * share / (1.0 - share)
    delay = one.transfer + images + one.frame / 2.0 + filtering + hold + mean_stall
    delay += one.buffer + one.servo
    # Where the clocks of camera, vision and loop meet is not part of the sum.
    clocks = one.vision + one.period + 2.0 * chain.TICK
    expected = 1e3 * one.speed * delay
    assert late.symptom(cause, seed, None) == pytest.approx(expected, abs=1e3 * one.speed * clocks)


@pytest.mark.parametrize("added", [0.02, 0.05])
def test_a_dead_time_adds_its_own_length_of_the_path(added: float) -> None:
    base = late.lags(late.NOMINAL).mean()
    for name in ("transfer", "buffer", "servo"):
        longer = replace(late.NOMINAL, **{name: getattr(late.NOMINAL, name) + added})
        more = late.lags(longer).mean() - base
        # What comes over the link waits for the next run of the vision node.
        slack = late.NOMINAL.vision if name == "transfer" else 0.05 * added
        expected = late.NOMINAL.speed * added
        assert abs(1e-3 * more - expected) <= late.NOMINAL.speed * slack, name


# --- The sure stage -------------------------------------------------------------------------------


@examples(40)
@given(SEEDS)
def test_a_stage_without_a_fault_finds_any_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = sure.scene(seed % 1000)
    box = scene.box.copy()
    box[:3, :3] = Rotation.random(random_state=seed % 2**31).as_matrix()
    box[:3, 3] += rng.uniform(-0.05, 0.05, 3)
    estimate, residual = stage.estimate(sure.STAGE, sure.CAMERA, replace(scene, box=box))
    assert np.abs(estimate - box).max() < 1e-9 and residual < 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_each_fault_misses_by_what_it_should(seed: int) -> None:
    """In the camera's frame: to the side in proportion, along the ray, or by the same."""
    where = sure.scene(seed)
    into = np.linalg.inv(where.hand @ sure.CAMERA.mount)
    centre = into[:3, :3] @ where.box[:3, 3] + into[:3, 3]
    for cause, (numbers, _) in sure.FAULTS.items():
        one = sure.stage(cause)
        missed = into[:3, :3] @ sure.miss(one, where)
        expected = {
            "shifted_middle": np.array([0.0, -sure.ERROR * centre[2] / sure.AWAY, 0.0]),
            "bent_mount": np.array([0.0, sure.ERROR, 0.0]),
            "old_pose": -into[:3, :3] @ where.moving * one.late,
            "other_end": into[:3, :3] @ where.box[:3, :3] @ [sure.ERROR, 0.0, 0.0],
            "other_origin": -into[:3, :3] @ where.box[:3, :3] @ [0.0, 0.0, sure.ERROR],
            "depth_scale": (one.gain - 1.0) * centre,
            "depth_offset": one.offset * centre / centre[2],
            "wrong_focal": np.array([centre[0] * (sure.CAMERA.focal / one.focal - 1.0), 0.0, 0.0]),
        }[cause]
        assert numbers and np.linalg.norm(missed - expected) < 0.12 * sure.ERROR, cause


def test_only_what_depends_on_the_scale_leaves_a_residual() -> None:
    residuals = {cause: sure.residual(cause, 0) for cause in sure.FAULTS}
    assert residuals["wrong_focal"] > 5.0 > residuals["depth_scale"] > 2.0
    assert max(residuals[c] for c in ("bent_mount", "old_pose", "other_end", "other_origin")) < 1.0
