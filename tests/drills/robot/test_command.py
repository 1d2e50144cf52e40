"""`drills robot` as a learner meets it: slots fill as exercises are solved, and runs are stored."""

import ast
import csv
import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drills import cards
from drills.robot import libraries
from drills.robot.hidden import fault_of
from drills.robot.holders import course_part
from drills.robot.inside import Robot
from drills.robot.levels import exact_world, level
from drills.robot.loop import SIGNALS
from drills.robot.play import gather
from drills.robot.slots import NAMES, SLOTS, STAGES
from tests.budget import ROOT
from tests.drills.place import Place, a_place
from tests.optional import skip

__all__ = ["a_place"]

MINIMAL = ("back_project", "to_the_present", "two_link_ik", "trapezoid", "lqr", "verlet")


@pytest.fixture
def own(place: Place) -> Place:
    """A work folder with one solved exercise per stage."""
    for name in MINIMAL:
        place.run("start", name)
        (place.work / f"{name}.py").write_text(cards.card(name).solution_text(), encoding="utf-8")
        assert place.json("check", name)["verdict"] == "pass"
    return place


def test_an_empty_robot_is_the_course_s(place: Place) -> None:
    data = place.json("robot", "status")
    assert data["command"] == "robot" and data["action"] == "status"
    assert [slot["slot"] for slot in data["slots"]] == list(NAMES)
    assert {slot["holder"] for slot in data["slots"]} == {"course"} and data["passed"] == []
    answer = place.run("robot", "blame")
    assert answer.code == 2 and "takes one of: perception, estimation" in answer.err
    text = place.run("robot").out
    assert all(slot.name in text for slot in SLOTS) and f"0 of {len(SLOTS)}" in text
    assert max(map(len, text.splitlines())) <= 80


@pytest.mark.prove
def test_solved_exercises_fill_their_slots(own: Place) -> None:
    data = own.json("robot", "status")
    assert {s["slot"] for s in data["slots"] if s["holder"] == "yours"} == set(MINIMAL)
    file = own.work / "lqr.py"
    file.write_text(file.read_text(encoding="utf-8") + "\n# another line\n", encoding="utf-8")
    again = {slot["slot"]: slot for slot in own.json("robot", "status")["slots"]}
    assert again["lqr"]["changed"] and not again["verlet"]["changed"]
    # A file that was graded as wrong does not look like one that is right.
    right = file.read_text(encoding="utf-8")
    file.write_text(right.replace("return ", "return 2.0 * "), encoding="utf-8")
    assert own.json("check", "lqr")["verdict"] != "pass"
    assert "failed its last check" in own.run("robot").out
    file.write_text(right, encoding="utf-8")
    assert own.json("check", "lqr")["verdict"] == "pass"
    text = own.run("robot").out
    assert "failed its last" not in text and "changed since" not in text
    file.unlink()
    again = {slot["slot"]: slot for slot in own.json("robot", "status")["slots"]}
    assert again["lqr"]["holder"] == "course"


@pytest.mark.slow
def test_a_run_is_stored_and_a_replaced_part_is_compared(own: Place) -> None:
    done = own.run("robot", "run", "--no-libraries", "--level", "1", "--tasks", "4")
    assert "success" in done.out and "their sum" in done.out and "More tasks" in done.out
    assert max(map(len, done.out.splitlines())) <= 80
    file = own.work / "trapezoid.py"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("    ramp = v / a\n", "    v = 0.8 * v\n    ramp = v / a\n"))
    slower = own.run("robot", "run", "--no-libraries", "--level", "1", "--tasks", "4")
    assert "replaced trapezoid" in slower.out and "trapezoid broke a promise" in slower.out
    assert "Look at" not in slower.out
    data = json.loads((own.work / "robot.json").read_text(encoding="utf-8"))
    assert len(data["runs"]) == 2 and data["passed"] == {}
    past = own.json("robot", "history")
    assert [row["own"] for row in past["versions"]] == [6, 6]
    assert "same tasks and noise, with 95 %" in " ".join(slower.out.split())
    assert "the shortest time within the limits" in " ".join(slower.out.split())
    assert past["versions"][0]["cycle"] < past["versions"][1]["cycle"]
    assert Path(past["picture"]).stat().st_size > 5000


@pytest.mark.prove
@pytest.mark.optional
def test_the_libraries_play_the_same_tasks_and_are_lines_of_the_chart(own: Place) -> None:
    if not any(libraries.installed(name) for name in ("ompl", "mujoco", "pinocchio", "open3d")):
        skip("The robot of libraries did not play: none is installed.")
    data = own.json("robot", "run", "--level", "2", "--tasks", "3")
    assert data["libraries"] == data["course"] == 1.0
    done = own.run("robot", "run", "--level", "2", "--tasks", "3")
    assert "yours minus the libraries'" in done.out and max(map(len, done.out.splitlines())) <= 80
    stored = json.loads((own.work / "robot.json").read_text(encoding="utf-8"))
    # Stored after the first run, and other parts than the course's.
    assert len(stored["libraries"]) == len(stored["course"]) == 1
    (theirs,), (ours,) = stored["libraries"].values(), stored["course"].values()
    assert theirs["seconds"] != ours["seconds"] or theirs["distance"] != ours["distance"]
    text = own.run("robot", "history").out
    assert max(map(len, text.splitlines())) <= 80
    rows = {line.split()[0]: line for line in text.splitlines() if line.strip()}
    assert all(f"{3:>7}   100.0 %" in rows[name] for name in ("course", "libraries"))


@pytest.mark.prove
def test_a_broken_promise_comes_with_the_expected_result(own: Place) -> None:
    file = own.work / "two_link_ik.py"
    text = file.read_text(encoding="utf-8")
    wrapped = "def two_link_ik(lengths, target):\n    return right(lengths, target) + 0.02\n"
    file.write_text(f"{text}\n\nright = two_link_ik\n\n\n{wrapped}", encoding="utf-8")
    out = own.run("robot", "run", "--no-libraries", "--level", "1", "--tasks", "2").out
    assert "two_link_ik broke a promise" in out and "expected result" in out
    assert max(map(len, out.splitlines())) <= 80
    call = out[out.index("  two_link_ik(np.array") :].partition(" repeats the call")[0]
    ast.parse(call.rpartition("\npython")[0].strip())
    done = subprocess.run(
        [sys.executable, own.work / "robot_call.py"], cwd=ROOT, capture_output=True, text=True
    )
    values = [
        np.array(re.findall(r"-?\d\.\d*(?:e-\d+)?", part), dtype=float)
        for part in done.stdout.split("yours:")
    ]
    np.testing.assert_allclose(values[1] - values[0], 0.02, atol=1e-6)


@pytest.mark.prove
def test_a_broken_part_is_named_with_its_call(own: Place) -> None:
    file = own.work / "two_link_ik.py"
    file.write_text("def two_link_ik(lengths, target):\n    return lengths / 0 * target[0]\n")
    data = own.json("robot", "run", "--no-libraries", "--level", "1", "--tasks", "3")
    assert data["failure"]["part"] == "two_link_ik" and data["exit"] == 1
    assert data["failure"]["call"].startswith("two_link_ik(np.array([0.5, 0.4])")
    assert (
        "stopped the robot"
        in own.run("robot", "run", "--no-libraries", "--level", "1", "--tasks", "3").out
    )


@pytest.mark.prove
@pytest.mark.optional
def test_ompl_can_hold_the_planner(place: Place) -> None:
    if importlib.util.find_spec("ompl") is None:
        skip("OMPL did not hold the planner: it is not installed.")
    done = place.json(
        "robot",
        "run",
        "--no-libraries",
        "--level",
        "1",
        "--tasks",
        "3",
        "--part",
        "rrt_connect=ompl",
    )
    assert done["success"] == 1.0 and done["named"] == []
    assert done["parts"]["rrt_connect"] == "ompl"


@pytest.mark.prove
def test_a_right_answer_of_a_notebook_becomes_a_part(place: Place) -> None:
    """As `drills.notebook.check` sends it; an answer that is in the folder stays as it is."""
    sent = ["check", "verlet", "--file", "-", "--rendered", "--called", "your cell"]
    wrong = "def verlet_step(q, v, a, acceleration, dt):\n    return q, v, a\n"
    right = cards.card("verlet").solution_text()
    place.json(*sent, text=wrong)
    file = place.work / "verlet.py"
    assert not file.exists()
    assert "drills robot run" in place.json(*sent, text=right)["html"]
    assert file.read_text(encoding="utf-8") == right
    place.json(*sent, text=right + "# again\n")
    assert file.read_text(encoding="utf-8") == right
    slots = {slot["slot"]: slot for slot in place.json("robot", "status")["slots"]}
    assert slots["verlet"]["holder"] == "yours"


@pytest.mark.slow
def test_a_stage_can_be_replaced_without_any_exercise(place: Place) -> None:
    text = """
import numpy as np

from drills.robot.records import Motion


def plan(route):
    return Motion(np.zeros((0, 2)), 0.0, np.zeros((0, 2)), np.zeros((0, 2)), np.zeros((0, 2)))
"""
    (place.folder / "mine.py").write_text(text)
    done = place.run(
        "robot", "run", "--no-libraries", "--level", "1", "--tasks", "2", "--own", "plan=mine.py"
    )
    assert "2 tasks failed: the planner found no way" in done.out


def test_misuse_says_what_to_do(place: Place) -> None:
    for arguments, message in (
        (["--part", "lqrr=course"], "Did you mean lqr?"),
        (["--part", "lqr=ompl"], "can be held by: yours, course, scipy"),
        (["--part", "lqr=yours"], "drills start lqr"),
        (["--own", "think=x.py"], "A file may replace one of"),
        (["--own", "plan=x.py"], "There is no file x.py"),
    ):
        done = place.run("robot", "run", "--no-libraries", "--level", "1", *arguments)
        assert done.code == 2 and message in done.err, done


@pytest.mark.prove
def test_the_hidden_fault_is_found_from_the_log(place: Place) -> None:
    """As a learner would: which two signals differ by more than others do."""
    row = 0
    for _ in range(3):
        path = place.json("robot", "run", "--no-libraries", "--level", "6", "--tasks", "10")["log"]
        stage = found_in(Path(path))
        answer = place.json("robot", "blame", stage)
        assert answer["right"], (stage, answer["stage"])
        row += 1
        assert answer["row"] == row and answer["passed"] == (row == 3)
    assert 6 in place.json("robot", "status")["passed"]
    assert place.run("robot", "blame", "control").code == 2


def found_in(path: Path) -> str:
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return suspect(
        {
            name: np.array([[float(row[f"{name}_{axis}"]) for axis in "xy"] for row in rows])
            for name in SIGNALS
        }
    )


@pytest.mark.prove
@pytest.mark.parametrize("stage", STAGES)
def test_a_fault_in_each_stage_shows_in_the_log(stage: str) -> None:
    for direction in (0.5, 2.8, 4.6):
        parts = [course_part(name) for name in NAMES]
        one = Robot(parts, level(6), exact_world(), 5, 0.0, (stage, direction))
        signals = gather([one.play(number) for number in range(4)]).signals
        assert suspect({name: signals[:, i] for i, name in enumerate(SIGNALS)}) == stage


def suspect(at: dict[str, Any]) -> str:
    links = {
        "perception": ("seen_at_grip", "part_at_grip"),
        # The camera sees the tip: tracking compensates what kinematics and control leave.
        "estimation": ("encoder_at_grip", "seen_at_grip"),
        "kinematics": ("reference_at_grip", "command_at_grip"),
        "planning": ("reference_at_release", "goal_at_release"),
        "control": ("encoder_at_release", "reference_at_release"),
    }
    sizes = {
        stage: float(np.hypot(*np.nanmedian(at[a] - at[b], axis=0)))
        for stage, (a, b) in links.items()
    }
    carried = at["part_at_grip"] - at["tip_at_grip"]
    slide = at["part_at_rest"] - at["tip_at_release"] - carried
    sizes["physics"] = abs(float(np.nanmedian(slide[:, 1])) + 0.0011)
    return max(sizes, key=lambda stage: sizes[stage])


def test_hidden_faults_are_spread_over_the_stages() -> None:
    count = {stage: 0 for stage in STAGES}
    for case in range(600):
        count[fault_of(case)[0]] += 1
    assert min(count.values()) > 60


# --- what a chapter changes -----------------------------------------------------------------------


@pytest.mark.prove
def test_a_chapter_s_part_is_compared_with_the_course_s(own: Place) -> None:
    """An own part that is slower on purpose: the cycle grows, on the same tasks and noise."""
    file = own.work / "trapezoid.py"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("    ramp = v / a\n", "    v = 0.8 * v\n    ramp = v / a\n"))
    data = own.json("robot", "compare", "--chapter", "5", "--level", "1", "--tasks", "4")
    assert [slot["holder"] for slot in data["slots"]] == ["course", "course", "course", "yours"]
    value, low, high = data["change"]["seconds"]
    assert 0.0 < low <= value <= high
    assert any("trapezoid" in line and "your" in line for line in data["lines"])
    # It is a comparison, and no run: nothing is stored.
    assert own.run("robot", "history").code == 2


@pytest.mark.prove
def test_the_chapters_without_slots_compare_worlds_and_levels(place: Place) -> None:
    twin = place.json("robot", "compare", "--chapter", "8", "--level", "1", "--tasks", "6")
    assert twin["slots"] == [] and twin["change"]["distance"][1] > 1e-3
    late = place.json("robot", "compare", "--chapter", "10", "--tasks", "6")
    assert late["change"]["seconds"][0] > 0.0
    assert "drills start" in place.run("robot", "compare", "--chapter", "4").out
    assert "drills start" in place.run("robot", "compare", "--chapter", "9").out


@pytest.mark.slow
def test_the_twin_is_stored_apart_from_the_exact_arm(place: Place) -> None:
    exact = place.json("robot", "run", "--no-libraries", "--level", "1", "--tasks", "6")
    twin = place.json(
        "robot", "run", "--no-libraries", "--level", "1", "--tasks", "6", "--twin", "--gap", "1"
    )
    assert exact["success"] == 1.0 and twin["success"] == 0.0 and not twin["counts"]
    assert len(place.json("robot", "history")["versions"]) == 1
