"""The compiled robot: its functions against the worked answers, its outcomes against the plain one.

The worked answers and the NumPy code of the world are the independent truth here.
"""

from typing import Any

import numpy as np
import pytest

from course.pipeline.robot_parts import FUNCTIONS, clearance, nearest, on_a_face
from drills.robot import cell as scene
from drills.robot import engine, stages
from drills.robot.compiled import DRIVEN, engine_of, render
from drills.robot.engine import Engine
from drills.robot.holders import course_part
from drills.robot.inside import Robot
from drills.robot.levels import CELL, exact_world, level
from drills.robot.parts import load_part
from drills.robot.play import Played, gather, play
from drills.robot.promises import promises_of
from drills.robot.report import compare, summarise
from drills.robot.slots import NAMES, SLOTS
from drills.robot.twin import imperfect_world
from tests.budget import PROVE
from tests.drills.robot.robots import parts_with, played

pytestmark = pytest.mark.slow
FEW = 6
# Each slot is swapped alone: all of those tasks in the long tier.
SWAPPED = FEW if PROVE else 2
# Largest difference of a result, where it is not rounding alone: the finite turn of a step of ICP
# acts about another point, and an edge is searched down to a gap of 1 nm.
LOOSE = {"point_to_plane_step": 2e-3, "edge_check": 1e-6}


@pytest.fixture(scope="module", name="calls")
def the_calls() -> dict[str, list[tuple[Any, ...]]]:
    """Arguments of every slot's calls in two tasks of level 5, a few for each slot."""
    robot = Robot(parts_with(), level(5), exact_world(), 3, 0.0)
    calls: dict[str, list[tuple[Any, ...]]] = {name: [] for name in NAMES}
    call = robot.bench.call

    def recorded(name: str, *args: Any) -> Any:
        if len(calls[name]) < 60:
            calls[name].append(args)
        return call(name, *args)

    robot.bench.call = recorded  # type: ignore[method-assign]
    for number in range(2):
        robot.play(number)
    return calls


@pytest.mark.parametrize("slot", sorted(FUNCTIONS))
def test_a_compiled_part_answers_like_the_worked_answer(
    slot: str, calls: dict[str, list[tuple[Any, ...]]]
) -> None:
    plain = load_part(course_part(slot))
    assert calls[slot]
    for args in calls[slot]:
        expected, result = plain(*args), FUNCTIONS[slot](*args)
        pair = isinstance(expected, tuple)
        for a, b in zip(
            expected if pair else (expected,), result if pair else (result,), strict=True
        ):
            a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
            if slot == "plane_ransac" and a.shape == (4,):
                b = b * np.sign(a[:3] @ b[:3])  # either side of the plane may be its front
            size = 1.0 + float(np.max(np.abs(a), initial=0.0))
            np.testing.assert_allclose(b, a, atol=LOOSE.get(slot, 1e-8) * size)


@pytest.mark.parametrize("slot", sorted(FUNCTIONS))
def test_a_compiled_part_breaks_no_promise(
    slot: str, calls: dict[str, list[tuple[Any, ...]]]
) -> None:
    promise, returns = promises_of(slot, "course"), {s.name: s.returns for s in SLOTS}[slot]
    for args in calls[slot][:20]:
        result = FUNCTIONS[slot](*args)
        several = result if len(returns) > 1 else (result,)
        values = tuple(
            np.asarray(v, dtype=float) if s else float(v)
            for v, s in zip(several, returns, strict=True)
        )
        if slot == "point_to_plane_step":
            continue  # the promise asks for the turn about the mean of the points
        assert promise(args, values if len(returns) > 1 else values[0]) == ""


def test_the_compiled_camera_shows_the_same_picture() -> None:
    for number in range(8):
        task = scene.make_task(CELL, level(5), 1, number)
        seconds = 0.4 * number
        expected = scene.render(CELL, level(5), task, number, seconds)
        np.testing.assert_allclose(
            render(CELL, level(5), task, number, seconds), expected, rtol=1e-12, atol=1e-9
        )


def test_the_compiled_clearances_are_the_same() -> None:
    rng = np.random.default_rng(0)
    q = rng.uniform(-3.0, 3.0, (500, 2))
    posts = np.column_stack((rng.uniform(-1.0, 1.0, (4, 2)), rng.uniform(0.02, 0.1, 4)))
    np.testing.assert_allclose(
        clearance(CELL.lengths, posts, q), scene.clearance(CELL.lengths, posts, q), atol=1e-12
    )
    assert np.all(np.isinf(clearance(CELL.lengths, np.zeros((0, 3)), q[:3])))


def test_compiled_edges_end_where_the_worked_answer_s_do() -> None:
    plain, shares = load_part(course_part("edge_check")), []
    rng = np.random.default_rng(2)
    for _ in range(200):
        posts = np.column_stack((rng.uniform(-0.8, 0.8, (3, 2)), rng.uniform(0.02, 0.08, 3)))
        a, b = rng.uniform(-2.5, 2.5, (2, 2))
        args = (np.array(CELL.lengths), posts, a, b)
        shares.append(plain(*args))
        assert abs(FUNCTIONS["edge_check"](*args) - shares[-1]) < 1e-6
    assert sum(share == 1.0 for share in shares) > 20 < sum(0.0 < share < 1.0 for share in shares)


def test_the_compiled_matches_are_the_same() -> None:
    model, _, faces = stages.part_model(CELL)
    rng = np.random.default_rng(1)
    points = model[:, rng.integers(0, model.shape[1], 200)] + rng.normal(0.0, 0.004, (3, 200))
    np.testing.assert_array_equal(nearest(points, model), engine.nearest(points, model))
    ours, plain = (one(points, model, faces, 0.005) for one in (on_a_face, engine.on_a_face))
    np.testing.assert_array_equal(ours, plain)
    assert 0 < plain.sum() < plain.size


@pytest.mark.prove
@pytest.mark.parametrize("twin", (False, True))
def test_a_whole_motion_is_its_ticks(twin: bool) -> None:
    """Only the law and the integrator are compiled here, the rest is the plain robot."""
    world = imperfect_world(0.5) if twin else exact_world()
    parts = parts_with()
    plain = Robot(parts, level(4), world, 0, 0.0)
    whole = Robot(parts, level(4), world, 0, 0.0, engine=Engine(drive=engine_of(parts).drive))
    first, second = (
        gather([robot.play(number, filmed=True) for number in range(3)]) for robot in (plain, whole)
    )
    assert first.why == second.why
    np.testing.assert_array_equal(first.seconds, second.seconds)
    for number in range(3):
        np.testing.assert_allclose(first.logs[number], second.logs[number], atol=1e-9)
    assert (second.processor > 0.0).all()


@pytest.mark.prove
@pytest.mark.parametrize("number", (1, 3, 5))
def test_compiled_and_plain_robots_agree_task_by_task(number: int) -> None:
    """The stated interval of one task: 0.1 mm in the slot, no tick of the cycle, no outcome."""
    plain, compiled = played(number, FEW), play(parts_with(), level(number), FEW)
    assert compiled.failure is None and compiled.breaches == ()
    np.testing.assert_array_equal(plain.success, compiled.success)
    np.testing.assert_array_equal(plain.seconds, compiled.seconds)
    np.testing.assert_allclose(plain.error, compiled.error, atol=1e-4)
    np.testing.assert_allclose(plain.budget, compiled.budget, atol=1e-4)
    for value, low, high in compare(summarise(plain), summarise(compiled)):
        assert low - 1e-6 <= value <= high + 1e-6 and abs(value) < 1e-4


@pytest.fixture(scope="module", name="worked_answers")
def the_worked_robot() -> Played:
    """Tasks of a robot that has the worked answer in every slot, as plain Python."""
    return played(5, SWAPPED)


@pytest.mark.prove
@pytest.mark.parametrize("slot", sorted(FUNCTIONS))
def test_swapping_a_part_for_the_course_s_changes_no_outcome(
    slot: str, worked_answers: Played
) -> None:
    """One slot at a time: the worked answer, and the compiled function of its chapter."""
    one = Robot(
        parts_with(), level(5), exact_world(), 0, 0.0, engine=Engine({slot: FUNCTIONS[slot]})
    )
    after = gather([one.play(number) for number in range(SWAPPED)])
    assert after.failure is None and after.breaches == ()
    np.testing.assert_array_equal(after.success, worked_answers.success)
    # The interval of each change holds 0, or the change is rounding: below 0.1 mm, no tick.
    for value, low, high in compare(summarise(worked_answers), summarise(after)):
        assert low <= 0.0 <= high or abs(value) < 1e-4


def test_a_part_of_the_learner_s_is_never_run_here() -> None:
    with pytest.raises(ValueError, match="your lqr"):
        engine_of(parts_with(lqr="def lqr(A, B, Q, R): raise SystemExit"))


def test_a_library_that_moves_the_arm_is_called_at_each_tick() -> None:
    parts = [
        part._replace(holder="other") if part.slot in DRIVEN[:1] else part for part in parts_with()
    ]
    assert engine_of(parts).drive is None and engine_of(parts_with()).drive is not None
    assert "computed_torque" not in engine_of(parts).functions


def test_a_part_that_fails_in_this_process_is_named() -> None:
    broken = course_part("trapezoid")._replace(
        holder="other", source="def trapezoid(*args):\n    return 1 / 0\n"
    )
    parts = [broken if part.slot == "trapezoid" else part for part in parts_with()]
    result: Played = play(parts, level(1), 3)
    assert result.failure is not None and result.failure.part == "trapezoid"
    assert "ZeroDivisionError" in result.failure.text
