"""Promises: faults in a slot are named; the faults are the typical mistakes of its exercise."""

import math

import numpy as np
import pytest

from drills import cards
from drills.exercise import of as exercise_of
from drills.robot.levels import level
from drills.robot.parts import load_part
from drills.robot.play import Played, play
from drills.robot.promises import friction_torque, friction_torque_rule
from drills.robot.report import Summary, diagnose, summarise
from drills.robot.slots import NAMES, Part
from tests.drills.robot.robots import parts_with

pytestmark = pytest.mark.slow
TASKS = 4


def faults() -> list[tuple[str, str, str]]:
    """Slot, name of the mistake, text."""
    result = []
    for name in NAMES:
        solution = cards.card(name).solution_text()
        for slip in exercise_of(name).slips:
            result.append((name, slip.name, slip.text(solution)))
    return result


def changes(before: Summary, after: Summary) -> bool:
    """Whether a fault shows in this cell: an outcome differs by more than 10 um or two ticks."""
    if not np.array_equal(before.success, after.success):
        return True
    moved = np.abs(after.distance - before.distance)
    later = np.abs(after.seconds - before.seconds)
    return bool(np.nanmax(moved) > 1e-5 or np.nanmax(later) > 0.009)


def named(slot: str, text: str, healthy: Summary, tasks: int) -> tuple[str, bool]:
    """Who is named, and whether the fault shows at all."""
    result: Played = play(parts_with(**{slot: text}), level(5), tasks)
    if result.failure is not None:
        return result.failure.part, True
    mine = summarise(result)
    diagnosis = diagnose(result, mine, healthy)
    return (diagnosis[0].part if diagnosis else ""), bool(diagnosis) or changes(healthy, mine)


def sample(count: int) -> tuple[int, int, list[str]]:
    """How many faults of a seeded sample show, how many are named, and which are not."""
    # A healthy robot in the sandbox, as those with a fault are: there all parts are plain text.
    whole = parts_with(lqr=cards.card("lqr").solution_text())
    healthy = summarise(play(whole, level(5), TASKS))
    every = faults()
    order = np.random.default_rng(7).permutation(len(every))
    shown, right, missed = 0, 0, []
    for i in order:
        if shown == count:
            break
        slot, mistake, text = every[int(i)]
        blamed, shows = named(slot, text, healthy, TASKS)
        shown += shows
        right += shows and blamed == slot
        if shows and blamed != slot:
            missed.append(f"{slot}/{mistake}: {blamed}")
    return shown, right, missed


@pytest.mark.prove
def test_faults_are_named() -> None:
    shown, right, missed = sample(5)
    assert shown == 5 and right >= 4, missed


@pytest.mark.prove
def test_at_least_95_of_100_faults_are_named() -> None:
    shown, right, missed = sample(100)
    assert shown == 100 and right >= 95, missed


def friction_calls() -> list[tuple[np.ndarray, np.ndarray, np.ndarray, float]]:
    """Arguments as the robot has them, from rest to the largest rates, in both directions."""
    rng = np.random.default_rng(3)
    rates = np.concatenate((rng.uniform(-0.2, 0.2, (20, 2)), rng.uniform(-2.5, 2.5, (20, 2))))
    return [(v, np.array([1.0, 0.25]), np.array([0.5, 0.1]), 0.05) for v in (*rates, np.zeros(2))]


def test_friction_is_held_to_its_limits_whatever_the_curve() -> None:
    """A line up to the transition speed is friction too, but not the exercise's."""
    for v, coulomb, viscous, transition in friction_calls():
        args, x = (v, coulomb, viscous, transition), v / transition
        exact = coulomb * np.array([math.tanh(value) for value in x]) + viscous * v
        assert friction_torque(args, exact) == friction_torque_rule(args, exact) == ""
        line = coulomb * np.clip(x, -1.0, 1.0) + viscous * v
        assert friction_torque(args, line) == ""
        if np.any(np.abs(np.clip(x, -1.0, 1.0) - np.tanh(x)) > 1e-6):
            assert "tanh" in friction_torque_rule(args, line)
        if np.any(v):
            assert "along with the motion" in friction_torque(args, -exact)
            assert friction_torque_rule(args, exact + 1e-6)
            assert "at most Coulomb" in friction_torque(args, exact + 0.3 * np.sign(v))
            assert "both cancelled" in friction_torque(args, exact - 0.3 * coulomb * np.tanh(x))


def test_every_typical_mistake_with_friction_breaks_a_promise() -> None:
    """Save those that show only at a transition speed of zero, which this arm has not."""
    solution = cards.card("friction_torque").solution_text()
    unbroken = set()
    for slip in exercise_of("friction_torque").slips:
        text = slip.text(solution)
        part = load_part(Part("friction_torque", "yours", text, "friction_torque", "x.py"))
        broken = [friction_torque_rule(args, np.asarray(part(*args))) for args in friction_calls()]
        if not any(broken):
            unbroken.add(slip.name)
    assert unbroken == {
        "zero_transition_has_no_friction",
        "full_friction_at_rest",
        "whole_numbers",
    }


@pytest.mark.prove
@pytest.mark.parametrize(
    "slip", ("friction_itself", "coulomb_missing", "viscous_missing", "sign_for_the_transition")
)
def test_a_robot_names_a_wrong_friction_term(slip: str) -> None:
    texts = {
        s.name: s.text(cards.card("friction_torque").solution_text())
        for s in exercise_of("friction_torque").slips
    }
    whole = parts_with(lqr=cards.card("lqr").solution_text())
    healthy = summarise(play(whole, level(5), 2))
    assert named("friction_torque", texts[slip], healthy, 2)[0] == "friction_torque"
