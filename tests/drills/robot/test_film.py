"""The animation: the part is in the gripper from grip to release; the lesson is a failure."""

import json
import math

import numpy as np
import pytest

from drills.robot import cell as scene
from drills.robot import film
from drills.robot.levels import CELL, level
from drills.robot.play import gather
from tests.drills.robot.robots import robot

pytestmark = pytest.mark.slow


def test_the_part_moves_with_the_tip_and_ends_in_its_slot() -> None:
    one = robot(4)
    played = gather([one.play(number, filmed=True) for number in range(2)])
    task = scene.make_task(CELL, level(4), 0, 1)
    q = played.logs[1]
    part = film.path_of_part(task, played, 1, q)
    times = film.STEP * np.arange(len(q))
    grip, release = played.moments[1]
    held = (times >= grip) & (times < release - film.STEP)
    tips = np.array([scene.tip_of(CELL.lengths, row) for row in q])
    assert held.sum() > 20
    assert np.ptp(part[held] - tips[held], axis=0).max() < 1e-12
    assert np.hypot(*(part[held] - tips[held]).T).max() < CELL.cup
    assert math.dist(part[-1], task.slot) < CELL.tolerance
    html = film.film(played, level(4), 0, [1, 0])
    start = html.index("const films = ") + len("const films = ")
    films = json.loads(html[start : html.index(";\n", start)])
    assert [one["title"] for one in films] == ["task 1", "task 0"]
    assert len(films[0]["q"]) == len(films[0]["part"]) == len(q)


def test_the_lesson_is_the_worst_of_the_most_frequent_failure() -> None:
    one = robot(1)
    played = gather([one.play(number) for number in range(4)])
    error = played.error.copy()
    error[2] = [0.0, 0.5]
    assert film.lesson(played._replace(error=error)) == 2
    why = ("late", "missed", "missed", "")
    grasp = np.array([[0.9, 0.0], [0.1, 0.0], [0.2, 0.0], [0.0, 0.0]])
    lost = np.full((4, 2), np.nan)
    assert film.lesson(played._replace(why=why, grasp=grasp, error=lost)) == 2
