"""Without any exercise: the planner of docs/howto/robot_planner.md in the robot, and sweeps."""

import importlib.util
import subprocess
import sys
from concurrent.futures import Executor, ProcessPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from course.measure.sweep import sweep
from drills.robot.holders import course_part
from drills.robot.levels import level
from drills.robot.play import play
from drills.robot.records import Command, Tick
from drills.robot.slots import FUNCTIONS, NAMES, Part
from drills.robot.sweeps import evaluate
from drills.robot.tables import call_file
from tests.budget import ROOT
from tests.drills.place import Place, a_place
from tests.optional import skip
from tests.site.test_howto import blocks

__all__ = ["a_place"]

pytestmark = pytest.mark.slow
JOBS = [{"level": number, "seed": seed, "tasks": 2} for number in (1, 5) for seed in (0, 1)]


@pytest.fixture(name="planner")
def the_planner(place: Place) -> Path:
    text, *_ = blocks(ROOT / "docs" / "howto" / "robot_planner.md", "python")
    path = place.folder / "planner.py"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.prove
def test_the_documented_planner_moves_the_robot(place: Place, planner: Path) -> None:
    data = place.json(
        "robot", "run", "--no-libraries", "--level", "5", "--tasks", "6", "--own", f"plan={planner}"
    )
    assert data["success"] == 1.0 and data["named"] == []


def test_the_documented_functions_are_those_that_can_be_replaced() -> None:
    text = (ROOT / "docs" / "howto" / "robot_planner.md").read_text(encoding="utf-8")
    assert all(f"`{name}`" in text for name in FUNCTIONS)


def test_a_stage_s_call_can_be_repeated(tmp_path: Path) -> None:
    """Records with arrays and a function in them become code that runs."""
    texts = {
        "control": "def control(command):\n    return command.q / 0 * [1.0]\n",
        "move": "def move(tick):\n    return tick.acceleration(tick.q)[:1], tick.v\n",
    }
    messages = {"control": "inf]", "move": "yours:    (array(["}
    for name, text in texts.items():
        path = tmp_path / f"my_{name}.py"
        path.write_text(text, encoding="utf-8")
        part = Part(name, "yours", text, name, str(path))
        failure = play([*map(course_part, NAMES), part], level(1), 1).failure
        assert failure is not None and failure.part == name
        program = tmp_path / "again.py"
        program.write_text(call_file(part, failure.text, failure.call), encoding="utf-8")
        done = subprocess.run([sys.executable, program], cwd=ROOT, capture_output=True, text=True)
        assert messages[name] in done.stdout, done
        record = {"control": Command, "move": Tick}[name]
        assert f"import {record.__name__}\n" in program.read_text(encoding="utf-8")


@pytest.mark.prove
@pytest.mark.parametrize(
    ("name", "result", "kind"),
    (
        ("move", "(request.q[:1], request.v)", "wrong shape"),
        ("control", "request.q[0]", "wrong shape"),
        ("gains", "[[50.0, 50.0]]", "wrong type"),
        ("estimate", "([0, 0], [0, 0])", "wrong type"),
        ("reach", "[0.3, float('nan')]", "wrong shape"),
        ("reach", "[[0.3, float('nan')]]", "not finite"),
        ("plan", "([[0, 0]], 1.0, [[0, 0]], [[0, 0]], [[0, 0], [0, 0]])", "wrong shape"),
        ("perceive", "'here'", "wrong type"),
    ),
)
def test_a_wrong_result_of_a_stage_is_named(name: str, result: str, kind: str) -> None:
    text = f"def {name}(request):\n    return {result}\n"
    part = Part(name, "yours", text, name, f"{name}.py")
    failure = play([*map(course_part, NAMES), part], level(1), 1).failure
    assert failure is not None and (failure.part, failure.kind) == (name, kind), failure


@pytest.mark.prove
def test_a_sweep_in_processes_is_the_sweep_here() -> None:
    here = sweep(evaluate, JOBS)
    assert len({row.cycle for row in here}) == len(JOBS)
    with ProcessPoolExecutor(2) as executor:
        assert sweep(evaluate, JOBS, executor) == here


@pytest.mark.optional
def test_a_sweep_on_dask_is_the_sweep_here() -> None:
    if importlib.util.find_spec("distributed") is None:
        skip("The robot's sweep did not run on Dask: distributed is not installed.")
    from distributed import Client

    with Client(processes=False, n_workers=1, threads_per_worker=2, dashboard_address=None) as one:
        executor: Executor = one.get_executor()
        assert sweep(evaluate, JOBS[:2], executor) == sweep(evaluate, JOBS[:2])


@pytest.mark.prove
def test_a_sweep_takes_the_imperfect_arm_and_own_functions(planner: Path) -> None:
    exact = evaluate(2, 0, 3)
    assert evaluate(2, 0, 3, gap=0.5).distance > 2.0 * exact.distance
    mine = evaluate(2, 0, 3, own=(f"plan={planner}",))
    assert mine.failure == "" and mine.cycle != exact.cycle
    assert np.isfinite(mine.distance)
