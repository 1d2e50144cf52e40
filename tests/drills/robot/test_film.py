"""The animation: the part is in the gripper from grip to release; the lesson is a failure."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from drills.robot import cell as scene
from drills.robot import film
from drills.robot.levels import CELL, level
from drills.robot.play import gather
from tests.drills.robot.robots import robot
from tools import gallery

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
    # All that moves stays inside the canvas, the elbow at the start as well.
    width, height = map(int, re.findall(r'<canvas width="(\d+)" height="(\d+)"', html)[0])
    x0, scale, y0, _ = map(int, re.findall(r"\[(\d+) \+ (\d+) \* x, (\d+) - (\d+) \* y\]", html)[0])
    for angles in films[0]["q"]:
        elbow = CELL.lengths[0] * np.array([math.cos(angles[0]), math.sin(angles[0])])
        for x, y in (elbow, scene.tip_of(CELL.lengths, np.array(angles))):
            assert 0 < x0 + scale * x < width and 0 < y0 - scale * y < height
    assert all(name in html for _, name in film.LEGEND.values())
    assert films[0]["grip"] == grip and films[0]["release"] == release


def test_the_picture_of_the_home_page_shows_the_course_s_robot(tmp_path: Path) -> None:
    gallery.robot_picture(tmp_path / "new.png")
    new, stored = (
        np.asarray(Image.open(path).convert("L"), dtype=float)
        for path in (tmp_path / "new.png", gallery.ROBOT)
    )
    assert new.shape == stored.shape and np.mean(np.abs(new - stored) > 60.0) < 0.01


@pytest.mark.prove
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
