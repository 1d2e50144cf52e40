"""A cup carried upright: the projection, the walk on the manifold, and the tilt between states."""

import math
import re

import numpy as np
import pytest

from course import charts, planning
from course.charts.planning import constraints
from course.kinematics import panda, tip
from course.planning import check_path, manifold
from course.rigid_body.quaternion import to_matrix

ARM = panda()


def upright(world, rng):
    while True:
        q = manifold.constrain_config(world, rng.uniform(*world.bounds))
        if q is not None:
            return q


@pytest.fixture(scope="module")
def world():
    return planning.shelf("open").world


def test_the_tilt_is_the_angle_of_the_rotated_axis(world) -> None:
    rng = np.random.default_rng(0)
    for q in rng.uniform(world.bounds[0], world.bounds[1], (20, 7)):
        u = to_matrix(tip(ARM, q)[3:]) @ np.array(manifold.CUP)
        assert manifold.tilt(ARM, q) == pytest.approx(math.acos(u[2]), abs=1e-9)


def test_a_projection_is_upright_within_the_limits_and_idempotent(world) -> None:
    rng = np.random.default_rng(1)
    done = 0
    for q in rng.uniform(world.bounds[0], world.bounds[1], (200, 7)):
        p = manifold.constrain_config(world, q)
        if p is None:
            continue
        done += 1
        assert manifold.tilt(ARM, p) <= 1.01 * manifold.PROJECTED
        assert (p >= world.bounds[0]).all() and (p <= world.bounds[1]).all()
        again = manifold.constrain_config(world, p)
        assert again is not None and np.array_equal(again, p)
    assert done > 40


def test_a_small_projection_is_nearly_the_nearest_upright_configuration(world) -> None:
    """SciPy minimises the distance under the same constraint, without any Jacobian of ours."""
    from scipy.optimize import minimize

    rng = np.random.default_rng(2)
    for _ in range(5):
        q = upright(world, rng) + 0.05 * rng.normal(size=7)
        p = manifold.constrain_config(world, q)
        if p is None:
            continue
        best = minimize(
            lambda x, q=q: np.sum((x - q) ** 2),
            q,
            constraints={"type": "eq", "fun": lambda x: manifold.cup_axis(ARM, x)[:2]},
            method="SLSQP",
            options={"ftol": 1e-14},
        ).x
        nearest = np.linalg.norm(best - q)
        # Newton's point differs from the nearest one by the square of the distance.
        assert nearest - 1e-6 <= np.linalg.norm(p - q) <= nearest * (1.0 + 2.0 * nearest) + 1e-6


def test_the_tilt_along_a_chord_stays_below_its_bound_and_is_of_second_order(world) -> None:
    medians = []
    for step in (0.4, 0.1, 0.025):
        a, b = constraints.chords(step, 60, 3)
        bound = manifold.chord_tilt(a, b) + manifold.PROJECTED
        largest = np.zeros(a.shape[1])
        for t in np.linspace(0.0, 1.0, 41):
            largest = np.maximum(largest, manifold.tilt(ARM, a + t * (b - a)))
        assert np.all(largest <= bound)
        medians.append(np.median(largest))
    orders = np.log(np.array(medians[:-1]) / medians[1:]) / math.log(4.0)
    assert np.all(np.abs(orders - 2.0) < 0.3)


@pytest.mark.slow
def test_an_extension_walks_towards_its_target_upright_and_free(world) -> None:
    rng = np.random.default_rng(4)
    moved = 0
    for _ in range(30):
        begin, target = upright(world, rng), rng.uniform(*world.bounds)
        states, _ = manifold.constrained_extend(world, begin, target)
        path = np.vstack((begin, states))
        distances = np.linalg.norm(path - target, axis=1)
        # Each step as long as `step` and the tilt's bound let it be before its projection, which
        # takes away nine tenths of its progress at most: the walk never creeps.
        total = np.abs(path - target).sum(axis=1)[:-1]
        share = 0.9 * math.sqrt(8.0 * math.sin(manifold.TILT)) / total
        tried = np.minimum(np.minimum(manifold.STEP, distances[:-1]), share * distances[:-1])
        assert np.all(-np.diff(distances) >= (manifold.PROGRESS - 1e-9) * tried)
        if len(states) and planning.state_free(world, begin):
            moved += 1
            assert check_path(world, path.T)
            assert np.max(manifold.tilt(ARM, path.T)) <= 1.01 * manifold.PROJECTED
    assert moved >= 3


@pytest.mark.prove
def test_the_planner_keeps_the_cup_upright_with_the_proof_and_not_without() -> None:
    """A long step without the proof tilts the cup beyond the tolerance; with the proof no step."""
    world = planning.shelf("open").world
    tilts = {True: [0.0], False: [0.0]}
    for k in range(8):
        start, goal = constraints.carried("open", k)
        for proved in tilts:
            allowed = manifold.TILT if proved else 0.5 * math.pi
            plan = manifold.cbirrt(world, start, goal, step=1.6, allowed=allowed, rng=k)
            if plan.path is not None:
                assert check_path(world, plan.path, start, goal)
                tilts[proved].append(constraints.tilted(plan.path))
    assert len(tilts[True]) > 6
    assert max(tilts[True]) < math.degrees(manifold.TILT) + 1e-3 < max(tilts[False])


def test_a_seed_gives_one_answer_and_bad_input_an_error(world) -> None:
    start, goal = constraints.carried("open", 0)
    one, other = (manifold.cbirrt(world, start, goal, rng=3) for _ in range(2))
    assert one.path is not None and other.path is not None
    assert np.array_equal(one.path, other.path)
    with pytest.raises(ValueError, match="start must be"):
        manifold.cbirrt(world, start + 0.1, goal)
    with pytest.raises(ValueError, match="allowed must be"):
        manifold.cbirrt(world, start, goal, allowed=2.0)
    with pytest.raises(ValueError, match=r"world\.kind must be"):
        manifold.constrain_config(planning.plane([[0, 0], [1, 1]]), [0.0, 0.0])


def test_the_chart_says_that_the_tilt_grows_with_the_square_of_the_step() -> None:
    tilts, times = charts.stored("upright_cup")
    single, worst, bound = (
        np.array(tilts[name].y) for name in ("random edge, median", "paths, worst", "bound")
    )
    x = np.array(tilts["bound"].x)
    small = x <= 0.2
    orders = np.diff(np.log(single[small])) / np.diff(np.log(x[small]))
    assert np.all(np.abs(orders - 2.0) < 0.2)
    assert np.all(worst <= bound) and worst[0] < constraints.TOLERATED < worst[-1]
    assert times["ours, tilt proved"].y[-1] > 0.85


def test_the_chart_has_upright_paths_and_ompl_where_it_solves_most() -> None:
    text = charts.read("upright_cup")
    rows = re.findall(
        r"^(ours.+|OMPL, range.+): median (\S+) ms, (\d+) of (\d+) solved, "
        r"worst tilt (\S+) degrees; (\d+) of (\d+) paths collide",
        text,
        re.M,
    )
    ours = {name: rest for name, *rest in rows if name.startswith("ours")}
    assert float(ours["ours, tilt proved"][3]) <= constraints.TOLERATED
    assert all(int(rest[4]) == 0 for rest in ours.values())
    # The setting that solves the most queries; of those that solve as many, the least median.
    others = {
        name: (-int(solved), float(middle))
        for name, middle, solved, *_ in rows
        if name.startswith("OMPL")
    }
    assert len(others) == len(constraints.RANGES) * len(constraints.SPACINGS)
    (best,) = re.findall(r"^drawn of OMPL's is (.+) rad, which", text, re.M)
    assert others[f"OMPL, {best}"] == min(others.values())
