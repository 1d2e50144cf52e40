"""VAMP against the course: the same spheres among the same obstacles, and the chart of both.

VAMP has no wheel, so that no make target installs it: the tests that call it carry a condition of
their own instead of the marker `optional`, and run wherever somebody has built it.
"""

import importlib.util
import re

import numpy as np
import pytest

from course import charts, contact
from course.charts.planning.vamp_comparison import alike, balls
from course.oracles import vamp
from course.planning import capsule_arm, clearance, scenes, shelf, state_free

needs_vamp = pytest.mark.skipif(
    importlib.util.find_spec("vamp") is None,
    reason="VAMP was NOT compared: it is not installed (pip install 'vamp-planner>=0.6.4')",
)
MARGIN = 1e-4  # m; single precision decides nearer than that


def obstacles(rng: np.random.Generator) -> list:
    """Return spheres, upright boxes and capsules before the arm."""
    result = []
    for k in range(9):
        place = np.append(rng.uniform([-0.7, -0.7, 0.1], [0.7, 0.7, 1.0]), [1.0, 0.0, 0.0, 0.0])
        turn = rng.normal(size=4)
        if np.hypot(place[0], place[1]) > 0.3:
            shape = (
                contact.sphere(0.08),
                contact.box(rng.uniform(0.03, 0.1, 3)),
                contact.capsule(0.03, 0.1),
            )[k % 3]
            if k % 3 != 1:  # a box stays along the axes
                place[3:] = turn / np.linalg.norm(turn)
            result.append((shape, place))
    return result


@needs_vamp
@pytest.mark.parametrize("seed", range(4))
def test_states_are_judged_alike_where_the_clearance_is_not_marginal(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = capsule_arm(obstacles(rng), None, vamp.spheres())
    other, alone = vamp.Arm(world), vamp.Arm()
    counts = np.zeros(2, int)
    for q in rng.uniform(world.bounds[0], world.bounds[1], (600, 7)):
        gap = clearance(world, q)
        # VAMP also rejects an arm that touches itself, which this world ignores.
        if abs(gap) > MARGIN and alone.state_free(q):
            assert other.state_free(q) == state_free(world, q) == (gap > 0.0)
            counts[int(gap > 0.0)] += 1
    assert counts.min() > 20


@needs_vamp
def test_an_edge_is_judged_by_its_points() -> None:
    rng, world = np.random.default_rng(0), balls(20, 0)
    other, alone = vamp.Arm(world), vamp.Arm()
    judged = np.zeros(2, int)
    for _ in range(400):
        a, b = rng.uniform(world.bounds[0], world.bounds[1], (2, 7))
        b = a + (b - a) * 1.5 / np.linalg.norm(b - a)
        # VAMP's points: batches of 8 over the whole edge, at the spacing of its planners.
        count = vamp.LANES * np.ceil(1.5 / vamp.spacing() / vamp.LANES)
        points = a + (b - a) * np.arange(1, count + 1)[:, None] / count
        gaps = np.array([clearance(world, q) for q in points])
        if abs(gaps.min()) > MARGIN and alone.path_free(alone.path(a, b)):
            free = other.path_free(other.path(a, b))
            assert free == (gaps.min() > 0.0)
            judged[int(free)] += 1
    assert judged.min() > 10


@needs_vamp
def test_validate_motion_has_eight_points_on_a_short_edge() -> None:
    rng, world = np.random.default_rng(1), balls(20, 0)
    other, alone = vamp.Arm(world), vamp.Arm()
    judged = np.zeros(2, int)
    for _ in range(600):
        a, b = rng.uniform(world.bounds[0], world.bounds[1], (2, 7))
        points = a + (b - a) * np.arange(1, 9)[:, None] / 8
        gaps = np.array([clearance(world, q) for q in points])
        short = np.linalg.norm(b - a) < 8.0 and all(alone.state_free(q) for q in points)
        if short and abs(gaps.min()) > MARGIN:
            free = other.edge_free(a, b)
            assert free == (gaps.min() > 0.0)
            judged[int(free)] += 1
    assert judged.min() > 10


@needs_vamp
def test_a_plan_joins_start_and_goal_by_edges_that_vamp_calls_free() -> None:
    world, rng = balls(5, 3), np.random.default_rng(0)
    other = vamp.Arm(world)
    ends = [
        q for q in rng.uniform(world.bounds[0], world.bounds[1], (60, 7)) if other.state_free(q)
    ][:6]
    for start, goal in zip(ends[::2], ends[1::2], strict=True):
        answer = other.plan(start, goal, other.planner(7))
        assert answer.path is not None and answer.seconds > 0.0 and answer.nodes >= 2
        np.testing.assert_allclose(answer.path[:, [0, -1]].T, (start, goal), atol=1e-6)
        assert other.path_free(other.path(*answer.path.T))


@needs_vamp
def test_edges_that_are_timed_are_judged_alike() -> None:
    world = balls(10, 1)
    free, hit, checked, different = alike(world, 10, 0)
    assert len(free) == len(hit) == 10 and different <= 0.02 * checked
    assert all(clearance(world, a) > 0.0 for a, _ in free + hit)


def test_the_stored_chart_shows_what_the_page_says() -> None:
    edges, plans, missed = charts.stored("vamp_comparison")
    for kind in ("free", "colliding"):
        theirs = np.asarray(edges[f"VAMP, {kind}"].y)
        assert np.all(theirs > 0.0) and np.all(edges[f"batches of 32, {kind}"].y > theirs)
    assert plans.series[0].label == "VAMP" and len(plans.series) == 3
    assert max(missed["its planners"].x) < 1.0 and max(missed["its planners"].y) == 0.0
    x, y = (np.asarray(v) for v in (missed["validate_motion"].x, missed["validate_motion"].y))
    assert max(y[x < 0.9]) == 0.0 and np.all(y[x > 1.5] > 0.2)
    key = charts.read("vamp_comparison")
    worst = re.search(r"^validate_motion.* at most (\S+) standard errors", key, re.M)
    assert worst and float(worst[1]) < 4.0
    assert re.findall(r"^\d+ balls: (\d+) verdicts", key, re.M) == ["0"] * len(
        edges["VAMP, free"].x
    )
    solved = re.findall(r"^plan, .* (\d+) of (\d+) solved", key, re.M)
    assert len(solved) == 3 and all(some == every for some, every in solved)


@needs_vamp
def test_bad_input() -> None:
    with pytest.raises(ValueError, match="capsule arm"):
        vamp.Arm(scenes.gap(0.1).world)
    turned = np.array([0.5, 0.0, 0.5, np.cos(0.3), 0.0, 0.0, np.sin(0.3)])
    with pytest.raises(ValueError, match="rotated box"):
        vamp.Arm(capsule_arm([(contact.box([0.1, 0.1, 0.1]), turned)]))
    arm = vamp.Arm(shelf("open").world)
    with pytest.raises(ValueError, match="q"):
        arm.state_free(np.zeros(6))
    with pytest.raises(ValueError, match="skipped"):
        arm.planner(-1)
