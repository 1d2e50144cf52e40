"""Layouts of a batch against each other, against MuJoCo, and lanes in contact against theory."""

import numpy as np
import pytest

from course import charts
from course.charts.sim_to_real import layouts
from course.kinematics.two_link import TwoLink
from course.oracles.mujoco import reach

pytestmark = pytest.mark.slow


def test_layouts_hold_the_same_numbers_in_other_places():
    arms = layouts.start(64)
    for make, stride in ((layouts.structures, 8 * layouts.NUMBERS), (layouts.blocks, 8)):
        memory = make(arms, 16)
        assert memory.shape == (4, 17, 16) and memory.strides[2] == stride
        np.testing.assert_array_equal(layouts.flat(memory), arms)
        assert not np.shares_memory(memory, arms)
    with pytest.raises(ValueError, match="width"):
        layouts.blocks(arms, 7)


@pytest.mark.prove
def test_a_step_is_the_same_in_all_layouts_and_in_mujoco():
    between, theirs = layouts.disagreement(256)
    assert between < 1e-14 and theirs < 1e-13


def test_rollout_repeats_the_batch():
    arms = layouts.start(8)
    given = TwoLink(), arms[:2], arms[2:4], arms[-2:], layouts.STEP
    step = reach.stepper(*given)
    for _ in range(5):
        last = step()
    np.testing.assert_allclose(reach.rollout(*given, 5)(), last, atol=1e-13)


@pytest.mark.prove
def test_the_light_pass_turns_by_the_rates():
    arms = layouts.start(32)
    for make, contiguous in ((layouts.structures, False), (layouts.blocks, True)):
        memory = make(arms, 8)
        layouts.kernels(contiguous)[1](memory, 0.5)
        moved = layouts.flat(memory)
        np.testing.assert_allclose(moved[:2], arms[:2] + 0.5 * arms[2:4], atol=1e-15)
        np.testing.assert_array_equal(moved[2:], arms[2:])


def test_lanes_occupied_by_contact():
    contact = np.zeros(64, dtype=bool)
    contact[[3, 40, 41]] = True
    assert layouts.executed(contact, 32) == pytest.approx(64 / 3)
    assert layouts.executed(contact, 1) == 1.0
    assert layouts.executed(np.sort(contact), 32) == pytest.approx(32 / 3)
    assert layouts.expected(0.01, 1) == pytest.approx(1.0)


def test_the_stored_chart_agrees_with_its_theory():
    step, light, width, wasted = charts.stored("batch_layout")
    assert {s.label for s in step.series} >= {"blocks of arrays", "mujoco.batch", "mujoco.rollout"}
    for group in layouts.GROUPS:
        series = wasted[f"groups of {group}"]
        theory = [layouts.expected(p, group) for p in series.x]
        assert np.allclose(series.y, theory, rtol=0.2)
    # A call per arm is slower than any batch of many, and blocks of one than blocks of hundreds.
    blocks = dict(zip(step["blocks of arrays"].x, step["blocks of arrays"].y, strict=True))
    alone = dict(zip(step["a call per arm"].x, step["a call per arm"].y, strict=True))
    assert alone[256] > 2.0 * blocks[256]
    assert width["blocks of arrays"].y[0] > 2.0 * min(width["blocks of arrays"].y)
    assert light["array of structures"].y[-1] > light["structure of arrays"].y[-1]
