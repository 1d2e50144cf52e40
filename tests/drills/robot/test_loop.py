"""The robot's loop: tasks that do not depend on the parts, and a budget that adds up."""

import math

import numpy as np
import pytest

from drills.exercise import of as exercise_of
from drills.robot import cell as scene
from drills.robot.cell import World
from drills.robot.holders import course_part
from drills.robot.levels import CELL, LEVELS, level
from drills.robot.report import compare, summarise
from drills.robot.slots import SLOTS, STAGES
from tests.budget import sampled
from tests.drills.robot.robots import played, robot

pytestmark = pytest.mark.slow
FEW = 4


@pytest.mark.parametrize("number", sampled(range(1, 6), 4))
def test_the_course_s_parts_solve_each_level_and_break_no_promise(number: int) -> None:
    result = played(number, FEW)
    assert result.success.all(), result.why
    assert result.breaches == () and result.failure is None
    assert (result.processor > 0.0).all()


@pytest.mark.prove
@pytest.mark.parametrize("number", (1, 3, 5))
def test_the_shares_of_the_stages_add_up_to_the_error(number: int) -> None:
    result = played(number, FEW)
    np.testing.assert_allclose(result.budget.sum(axis=1), result.error, atol=1e-12)
    assert result.budget.shape == (FEW, len(STAGES), 2)


@pytest.mark.prove
def test_with_perfect_sensing_the_grasp_is_as_exact_as_a_tick() -> None:
    """From rest, an arm at its largest planned acceleration moves so far in one tick."""
    result = played(1, FEW)
    a1, a2 = CELL.accelerations
    l1, l2 = CELL.lengths
    bound = 0.5 * CELL.tick**2 * (a1 * (l1 + l2) + a2 * l2)
    assert np.hypot(*result.grasp.T).max() < bound
    assert np.hypot(*result.budget[:, STAGES.index("perception")].T).max() < 0.1 * bound


@pytest.mark.prove
def test_the_part_slides_as_far_as_the_closed_form_says() -> None:
    """It falls for sqrt(2 h / g cos); gravity pulls it down the slope; it stops on landing."""
    result = played(1, FEW)
    fall = math.sqrt(2.0 * CELL.drop / (9.81 * math.cos(CELL.tilt)))
    down = 0.5 * CELL.gravity * fall**2
    physics = result.budget[:, STAGES.index("physics")]
    np.testing.assert_allclose(physics[:, 0], 0.0, atol=1e-9)
    # Time stepping lands up to one step of 1 ms late, at g sin t; the arm brings a little speed.
    np.testing.assert_allclose(physics[:, 1], -down, atol=1e-3 * CELL.gravity * fall + 5e-5)


@pytest.mark.prove
def test_tasks_and_noise_are_the_same_whatever_the_parts_are() -> None:
    slow = course_part("trapezoid").source.replace(
        "    ramp = v / a\n", "    v = 0.5 * v\n    ramp = v / a\n"
    )
    assert slow != course_part("trapezoid").source
    first, second = played(2, 2), played(2, 2, trapezoid=slow)
    assert (second.seconds > first.seconds).all()
    # A still part, seen by the same noise in the first images and found in the same position.
    np.testing.assert_array_equal(first.signals[:, 0], second.signals[:, 0])
    np.testing.assert_array_equal(first.signals[:, 6], second.signals[:, 6])
    for number in (0, 1):
        task = scene.make_task(CELL, level(5), 3, number)
        again = scene.make_task(CELL, level(5), 3, number)
        for a, b in zip(task, again, strict=True):
            np.testing.assert_array_equal(a, b)
        image, other = (scene.render(CELL, level(5), task, 7, 0.3) for _ in range(2))
        np.testing.assert_array_equal(image, other)


def test_levels_differ_in_noise_and_not_in_the_scene() -> None:
    for number in range(3):
        first, second = (scene.make_task(CELL, level(n), 0, number) for n in (1, 3))
        np.testing.assert_array_equal(first.part, second.part)
        np.testing.assert_array_equal(first.posts, second.posts)


@pytest.mark.prove
@pytest.mark.parametrize(("slot", "library"), (("lqr", "scipy"), ("rigid_fit", "scipy")))
def test_an_equivalent_part_changes_nothing_beyond_its_interval(slot: str, library: str) -> None:
    from drills.robot import libraries

    part = libraries.part(slot, library)
    assert part is not None
    before, after = (summarise(r) for r in (played(2, 6), played(2, 6, **{slot: part.source})))
    change = compare(before, after)
    for value, low, high in change:
        assert low - 1e-6 <= 0.0 <= high + 1e-6 and abs(value) < 1e-6


@pytest.mark.prove
def test_every_slot_is_called_and_timed() -> None:
    one = robot(5)
    called = set()
    for number in range(FEW):
        one.play(number)
        called |= set(one.bench.counts)
    assert called == {slot.name for slot in SLOTS}


def test_thresholds_fall_as_levels_get_harder() -> None:
    limits = [one.threshold for one in LEVELS[:5]]
    assert limits == sorted(limits, reverse=True) and min(limits) > 0.5


@pytest.mark.prove
def test_the_imperfect_arm_shows_in_control_and_physics() -> None:
    from drills.robot.twin import imperfect_world

    exact, twin = (summarise(played(2, FEW, world=w)) for w in (None, imperfect_world(0.5)))
    for stage in ("control", "physics"):
        i = STAGES.index(stage)
        assert twin.rms[i] > exact.rms[i]


NO_FRICTION = "def friction_torque(v, coulomb, viscous, transition):\n    return 0.0 * v\n"


@pytest.mark.prove
def test_with_friction_compensation_the_arm_moves_as_one_without_friction() -> None:
    """With perfect sensing the arm is on its reference, so all of its friction is cancelled."""
    smooth = World(CELL.lengths, CELL.masses)
    first = played(1, FEW, world=smooth, friction_torque=NO_FRICTION)
    second = played(1, FEW)
    np.testing.assert_array_equal(first.seconds, second.seconds)
    np.testing.assert_allclose(first.error, second.error, atol=5e-5)


@pytest.mark.prove
@pytest.mark.parametrize("number", (1, 5))
def test_the_friction_term_matters_and_its_sign_more(number: int) -> None:
    """The steady lag is M^-1 friction / kp: some millimetres at the tip, twice with the sign."""
    solution = course_part("friction_torque").source
    slips = {slip.name: slip.text(solution) for slip in exercise_of("friction_torque").slips}
    reversed_sign = slips["friction_itself"]
    right = summarise(played(number, FEW))
    uncompensated = summarise(played(number, FEW, friction_torque=NO_FRICTION))
    wrong = summarise(played(number, FEW, friction_torque=reversed_sign))
    i = STAGES.index("control")
    assert uncompensated.rms[i] > right.rms[i] + 1e-3
    assert wrong.rms[i] > 1.5 * uncompensated.rms[i]
    assert right.rate == 1.0 and wrong.rate < 1.0
