"""Promises: faults in a slot are named; the faults are the typical mistakes of its exercise."""

import numpy as np
import pytest

from drills import cards
from drills.exercise import of as exercise_of
from drills.robot.levels import level
from drills.robot.play import Played, play
from drills.robot.report import Summary, diagnose, summarise
from drills.robot.slots import NAMES
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


def test_faults_are_named() -> None:
    shown, right, missed = sample(5)
    assert shown == 5 and right >= 4, missed


@pytest.mark.prove
def test_at_least_95_of_100_faults_are_named() -> None:
    shown, right, missed = sample(100)
    assert shown == 100 and right >= 95, missed
