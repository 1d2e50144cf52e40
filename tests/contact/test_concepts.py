"""Chapter 2's small simulations against closed forms: what they show is what must come out."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import contact
from course.charts.contact.limits import step_limit
from course.contact import scenes
from course.contact.soft import Softness
from course.oracles.mujoco import contact as mujoco_contact
from course.simulations import pen as draw
from course.simulations.contact import (
    friction_cone,
    half_axes,
    penalty_spring,
    simplex,
    soft_contact,
    stopping_distance,
    sweeps,
)
from course.simulations.model import Experiment
from tests.budget import examples


def number(experiment, name):
    """A number as it is printed below the picture."""
    text = experiment.picture().numbers[name].split()[0].strip("°%")
    return float(text.replace("\N{MINUS SIGN}", "-"))


def at_values(rectangle, values, x, y):
    """The point of the window where an area shows the values (x, y)."""
    return draw.values_at(values, rectangle, x, y)


# --- friction cone --------------------------------------------------------------------------------

pulls = {
    "friction": st.floats(0.0, 1.0),
    "size": st.floats(0.0, 25.0),
    "direction": st.floats(-180.0, 180.0),
    "rise": st.floats(0.0, 45.0),
}


def from_rest(**values):
    """Contact force on the block and its acceleration in the first step (x, y) [m/s^2]."""
    run = Experiment(friction_cone.MODEL, **values)
    run.advance(friction_cone.STEP)
    return np.array(run.state["force"]), np.array(run.state["v"]) / friction_cone.STEP


@pytest.mark.prove
@examples(60)
@given(st.fixed_dictionaries(pulls))
def test_the_force_balances_the_pull_or_lies_on_the_cone(values):
    force, rate = from_rest(**values)
    mass, gravity = friction_cone.MASS, friction_cone.GRAVITY
    along, rise = math.radians(values["direction"]), math.radians(values["rise"])
    flat = values["size"] * math.cos(rise) * np.array([math.cos(along), math.sin(along)])
    normal = mass * gravity - values["size"] * math.sin(rise)
    limit = values["friction"] * normal
    assert force[2] == pytest.approx(normal, rel=1e-9)
    size = np.linalg.norm(flat)
    friction = -flat if size <= limit else -flat * (limit / size)
    assert np.allclose(force[:2], friction, rtol=0.0, atol=1e-9)
    assert np.allclose(rate, (flat + friction) / mass, rtol=0.0, atol=1e-9)


def test_the_force_is_that_of_the_chapters_solver():
    rng = np.random.default_rng(3)
    for _ in range(5):
        values = {"friction": rng.uniform(0.1, 1.0), "size": rng.uniform(5.0, 25.0)}
        values |= {"direction": rng.uniform(-180.0, 180.0), "rise": rng.uniform(0.0, 45.0)}
        force, _ = from_rest(**values)
        block = scenes.block(friction=values["friction"], mass=friction_cone.MASS)
        problem = block.problem(friction_cone.STEP)
        controls = friction_cone.CONTROLS.new(**values)
        pushed = friction_cone.STEP / friction_cone.MASS * np.array(friction_cone.pull_of(controls))
        problem = problem.moved(problem.velocity, problem.free + pushed, problem.gap)
        impulse = contact.solve("coulomb", problem).impulses[0]
        truth = impulse[[1, 2, 0]] / friction_cone.STEP
        assert np.allclose(force, truth, rtol=0.0, atol=1e-6)


def test_a_block_that_slides_is_braked_against_its_motion_and_stops():
    run = Experiment(friction_cone.MODEL, size=20.0, friction=0.3)
    run.advance(0.4)
    speed = math.hypot(*run.state["v"])
    assert speed > 0.5
    run.set(size=0.0)
    assert math.hypot(*run.state["v"]) == speed
    run.advance(0.9 * speed / (0.3 * friction_cone.GRAVITY))
    assert math.hypot(*run.state["v"]) == pytest.approx(0.1 * speed, abs=0.05)
    run.advance(0.3)
    assert math.hypot(*run.state["v"]) < 1e-12
    assert run.picture().numbers["contact"] == "sticks"


@pytest.mark.parametrize("angle", [0.0, 20.0, 45.0, 70.0, 90.0, -135.0, 163.0])
def test_a_pyramid_reaches_as_far_as_its_sides(angle):
    x, y = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    inner, outer = friction_cone.PYRAMIDS
    assert friction_cone.pyramid_limit(inner, x, y) == pytest.approx(1.0 / (abs(x) + abs(y)))
    assert friction_cone.pyramid_limit(outer, x, y) == pytest.approx(1.0 / max(abs(x), abs(y)))


def test_the_preset_of_the_pyramid_lies_between_cone_and_pyramid():
    run = Experiment(friction_cone.MODEL)
    run.choose("A pyramid around the cone")
    pull = run.controls["size"]
    assert number(run, "limit μ × normal") < pull < number(run, "limit of pyramid")
    names = {
        name: Experiment(friction_cone.MODEL, **preset.values)
        for name, preset in friction_cone.MODEL.presets.items()
    }
    modes = {name: each.picture().numbers["contact"] for name, each in names.items()}
    assert modes["It sticks"] == "sticks" and modes["It slides"] == "slides"


# --- complementarity ------------------------------------------------------------------------------


@pytest.mark.slow
@examples(60)
@given(st.floats(-2.0, 11.0), st.floats(-1.0, 6.0))
def test_a_drag_to_anywhere_leaves_the_pair_on_a_half_axis(x, y):
    run = Experiment(half_axes.MODEL)
    run.drag(x, y)
    gap, force = half_axes.rigid_pair(run.state["along"])
    assert gap >= 0.0 and force >= 0.0 and gap * force == 0.0
    assert number(run, "gap × force") == 0.0


def test_the_point_and_the_ball_follow_the_pointer():
    run = Experiment(half_axes.MODEL)
    plane = half_axes._PLANE, half_axes._VALUES
    run.drag(*at_values(*plane, 25.0, 1.0))
    assert half_axes.rigid_pair(run.state["along"]) == pytest.approx((0.025, 0.0))
    run.drag(*at_values(*plane, 3.0, 12.0))
    assert half_axes.rigid_pair(run.state["along"]) == pytest.approx((0.0, 12.0))
    run.drag(*at_values(*plane, -30.0, -2.0))  # neither is allowed there
    assert half_axes.rigid_pair(run.state["along"]) == (0.0, 0.0)
    scene = half_axes._SCENE, half_axes._VIEW
    run.drag(*at_values(*scene, 0.0, 1000.0 * half_axes.RADIUS + 18.0))
    assert half_axes.rigid_pair(run.state["along"]) == pytest.approx((0.018, 0.0))


@examples(40)
@given(st.floats(-1.0, 1.0), st.floats(500.0, 20_000.0))
def test_the_penalty_carries_the_same_force_in_an_overlap(along, stiffness):
    gap, force = half_axes.rigid_pair(along)
    soft, push = half_axes.penalty_pair(along, stiffness)
    assert push == pytest.approx(force, rel=1e-12, abs=1e-12)
    assert soft == pytest.approx(gap - force / stiffness, abs=1e-15)


def test_the_hand_goes_down_and_up_by_itself_and_visits_both_half_axes():
    run = Experiment(half_axes.MODEL)
    pairs = []
    for _ in range(200):
        run.advance(0.05)
        pairs.append(half_axes.rigid_pair(run.state["along"]))
    gaps, forces = np.array(pairs).T
    assert gaps.max() > 0.8 * half_axes.GAP and forces.max() > 0.8 * half_axes.PRESS
    assert np.all(gaps * forces == 0.0)


# --- sweeps of projected Gauss-Seidel -------------------------------------------------------------


@pytest.mark.parametrize("ratio", [0.25, 1.0, 4.0, 20.0])
def test_the_stack_is_the_chapters_tower(ratio):
    controls = sweeps.CONTROLS.new(ratio=ratio)
    problem = scenes.tower([sweeps.LOWER, ratio * sweeps.LOWER]).problem(sweeps.STEP)
    A, b = sweeps.delassus(controls)
    assert np.allclose(A, problem.delassus, rtol=1e-12)
    assert np.allclose(b, problem.offset, rtol=0.0, atol=1e-12)
    impulses = contact.solve("lcp", problem).impulses[:, 0]
    assert np.allclose(sweeps.solution(controls), impulses, rtol=1e-9)


@pytest.mark.parametrize("ratio", [0.25, 1.0, 4.0, 20.0])
@pytest.mark.parametrize("order", [0, 1])
def test_the_error_falls_by_the_largest_eigenvalue_of_a_sweep(ratio, order):
    run = Experiment(sweeps.MODEL, ratio=ratio, order=order)
    A, _ = sweeps.delassus(run.controls)
    # The masses m and r m: A = [[1, -1], [-1, 1 + 1 / r]] / m, so the factor is r / (1 + r).
    assert sweeps.contraction(A) == pytest.approx(ratio / (1.0 + ratio), rel=1e-12)
    visited = A[::-1, ::-1] if order else A
    iteration = -np.linalg.solve(np.tril(visited), np.triu(visited, 1))
    largest = np.abs(np.linalg.eigvals(iteration)).max()
    run.advance(5 * sweeps._PACE)
    error = run.state["error"][: run.state["sweeps"] + 1]
    assert run.state["sweeps"] == 5
    assert np.allclose(error[2:] / error[1:-1], largest, rtol=1e-8)
    assert number(run, "factor, measured") == number(run, "factor, predicted")


def test_sweeps_end_at_the_exact_impulses_and_none_follows_the_last():
    run = Experiment(sweeps.MODEL, ratio=0.5)
    run.advance(100.0)
    assert run.state["sweeps"] == sweeps.LAST
    run.press("ArrowRight")
    assert run.state["sweeps"] == sweeps.LAST
    assert np.allclose(run.state["impulse"], sweeps.solution(run.controls), rtol=1e-12)
    assert np.abs(run.state["velocity"]).max() < 1e-12


def test_a_key_makes_one_sweep_and_the_velocities_are_those_of_the_impulses():
    run = Experiment(sweeps.MODEL, order=1)
    for k in range(1, 4):
        run.press("ArrowRight")
        A, b = sweeps.delassus(run.controls)
        assert run.state["sweeps"] == k
        assert np.allclose(run.state["velocity"], A @ run.state["impulse"] + b, atol=1e-14)


# --- stopping distances ---------------------------------------------------------------------------


@pytest.mark.prove
@pytest.mark.parametrize("pyramid", [stopping_distance.INSIDE, stopping_distance.AROUND])
@pytest.mark.parametrize("angle", [0.0, 17.0, 45.0, 80.0, -100.0, 160.0])
def test_a_pyramids_block_goes_where_the_solver_takes_it(pyramid, angle):
    """Steps of the linear complementarity problem err by the order of the step."""
    values = {"pyramid": pyramid, "direction": angle, "speed": 1.0, "friction": 0.5}
    controls, around = stopping_distance.CONTROLS.new(**values), pyramid == stopping_distance.AROUND
    direction, dt = math.radians(angle), 0.002
    start = (math.cos(direction), math.sin(direction))
    run = scenes.run(scenes.block(0.0, 0.5, start), "lcp", dt, 160, edges=4, around=around)
    assert np.abs(run.v[:2, -1]).max() < 1e-9  # it has stopped
    for k in (0, 40, 80, 160):
        here = stopping_distance.pyramid_position(controls, direction, k * dt)
        assert np.allclose(run.q[:2, k], here, rtol=0.0, atol=2.0 * dt), (k, here)
    assert np.allclose(run.q[:2, -1], stopping_distance.stop(controls, direction), atol=2.0 * dt)


def test_the_cones_block_stops_where_the_solver_stops_it():
    controls = stopping_distance.CONTROLS.new(speed=1.0, friction=0.5)
    run = scenes.run(scenes.block(0.0, 0.5, (0.6, 0.8)), "coulomb", 0.002, 120)
    far = stopping_distance.cone_distance(controls, math.inf)
    assert far == pytest.approx(1.0 / (2.0 * 0.5 * stopping_distance.GRAVITY), rel=1e-12)
    assert np.allclose(run.q[:2, -1], (0.6 * far, 0.8 * far), atol=0.004)


@examples(40)
@given(st.floats(-180.0, 180.0), st.floats(0.5, 4.0), st.floats(0.1, 1.0))
def test_stops_form_a_square_outside_the_circle_and_a_diamond_inside_it(angle, speed, friction):
    """With v^2 = vx^2 + vy^2 the integrals are (v^2, 2 vx vy) and (vx^2, vy^2), over 2 mu g."""
    for pyramid in (stopping_distance.INSIDE, stopping_distance.AROUND):
        values = {"pyramid": pyramid, "direction": angle, "speed": speed, "friction": friction}
        run = Experiment(stopping_distance.MODEL, **values)
        x, y = map(abs, stopping_distance.stop(run.controls, math.radians(angle)))
        far = speed**2 / (2.0 * friction * stopping_distance.GRAVITY)
        twice = math.sin(2.0 * math.radians(angle)) ** 2
        if pyramid == stopping_distance.INSIDE:
            assert max(x, y) == pytest.approx(far, rel=1e-9)
            ratio = math.sqrt(1.0 + twice)
        else:
            assert x + y == pytest.approx(far, rel=1e-9)
            ratio = math.sqrt(1.0 - 0.5 * twice)
        assert math.hypot(x, y) / far == pytest.approx(ratio, rel=1e-9)
        assert number(run, "pyramid / cone") == pytest.approx(ratio, abs=6e-4)


def test_a_drag_launches_towards_the_pointer_from_the_start():
    run = Experiment(stopping_distance.MODEL)
    run.advance(0.3)
    place = stopping_distance._SCENE, stopping_distance._view(run.controls)
    run.drag(*at_values(*place, -0.3, 0.3))
    assert run.controls["direction"] == pytest.approx(135.0) and run.state["time"] == 0.0
    run.press("ArrowLeft")
    assert run.controls["direction"] == pytest.approx(136.0)


# --- GJK and EPA ----------------------------------------------------------------------------------


def posed(rng, **values):
    """A random pose of B, mostly near A, and the vertices of B."""
    shape = int(rng.integers(3))
    values = {
        "shape": shape,
        "turn": rng.uniform(-180.0, 180.0),
        "position": rng.uniform(-simplex._REACH, simplex._REACH, 2),
    } | values
    return simplex.CONTROLS.new(**values), simplex.B_SHAPES[values["shape"]]


@pytest.mark.prove
def test_the_result_is_the_distance_or_the_depth_of_the_chapter():
    rng = np.random.default_rng(8)
    a, signs = contact.points(simplex.A_SHAPE[:2]), set()
    for _ in range(150):
        controls, vb = posed(rng)
        pose = np.append(controls["position"], math.radians(controls["turn"]))
        truth = contact.distance(a, np.zeros(3), contact.points(vb[:2]), pose)
        result = simplex.result(controls, vb)
        assert result[0] == pytest.approx(float(truth.distance), abs=1e-12)
        assert np.allclose(result[3:] - result[1:3], truth.distance * truth.normal, atol=1e-9)
        signs.add(float(np.sign(result[0])))
    assert signs == {-1.0, 1.0}


def test_concentric_and_touching_shapes_have_a_depth_too():
    """The origin then lies on GJK's first edge, or on the boundary of the difference."""
    a = contact.points(simplex.A_SHAPE[:2])
    for shape, vb in enumerate(simplex.B_SHAPES):
        for turn in (-180.0, -90.0, 0.0, 90.0):
            for position in ((0.0, 0.0), (0.2, 0.0), (0.0, -0.3)):
                controls = simplex.CONTROLS.new(shape=shape, turn=turn, position=position)
                pose = np.append(position, math.radians(turn))
                truth = contact.distance(a, np.zeros(3), contact.points(vb[:2]), pose)
                assert simplex.result(controls, vb)[0] == pytest.approx(truth.distance, abs=1e-12)


def test_corners_that_touch_have_the_distance_zero_and_a_sound_picture():
    corner = simplex.A_SHAPE[:2, 0] - simplex.B_SHAPES[1][:2, 2]
    run = Experiment(simplex.MODEL, shape=1, turn=0.0, position=corner)
    for _ in range(4):
        picture = run.picture()
        assert not np.isinf(picture.data).any()
        run.advance(simplex._PACE)
    assert picture.numbers["algorithm"] == "done"
    assert number(run, "signed distance") == 0.0


def test_the_nearest_point_comes_nearer_with_every_iteration_and_the_bound_holds():
    rng = np.random.default_rng(9)
    for _ in range(30):
        controls, vb = posed(rng)
        pair = simplex.pair_of(controls, vb)
        iterations, expansions = simplex.counts(controls, vb)
        steps = [simplex.gjk(vb, pair, k) for k in range(iterations + 1)]
        cores = np.array([each[3] for each in steps])
        assert np.all(np.diff(cores) <= 1e-12) and steps[-1][5] == iterations
        if expansions < 0:
            assert max(each[4] for each in steps[1:]) <= cores[-1] + 1e-12
            s, share, n = steps[-1][:3]
            assert np.linalg.norm(simplex.nearest(s, share, n)[:2]) == pytest.approx(cores[-1])


def test_epas_polygon_is_convex_grows_and_holds_the_origin():
    rng = np.random.default_rng(10)
    grown = 0
    for _ in range(30):
        controls, vb = posed(rng, position=rng.uniform(-0.3, 0.3, 2))
        pair = simplex.pair_of(controls, vb)
        s, _, n = simplex.gjk(vb, pair, 1000)[:3]
        expansions = simplex.counts(controls, vb)[1]
        assert expansions >= 0
        areas = []
        for k in range(expansions + 1):
            polygon, count, made, ended = simplex.epa(vb, pair, s, n, k)
            assert made == k and ended == (k == expansions)
            x, y = polygon[:count, 0], polygon[:count, 1]
            turns = x * np.roll(y, -1) - y * np.roll(x, -1)
            assert turns.min() > -1e-12  # the origin is on the inner side of every edge
            areas.append(0.5 * turns.sum())
        assert np.all(np.diff(areas) > 0.0)
        grown += expansions > 1
    assert grown > 10


def test_the_outline_is_the_hull_of_all_differences():
    from scipy.spatial import ConvexHull

    rng = np.random.default_rng(11)
    for _ in range(30):
        controls, vb = posed(rng)
        pair = simplex.pair_of(controls, vb)
        x, y = simplex.outline(pair, vb)
        b = np.array(simplex._turned(pair, vb))
        every = (simplex.A_SHAPE[:2, :, None] - b[:, None, :]).reshape(2, -1).T
        hull = ConvexHull(every)
        assert 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)) == pytest.approx(hull.volume)
        assert np.all(hull.equations[:, :2] @ np.array([x, y]) + hull.equations[:, 2:] < 1e-12)


def test_no_pair_of_shapes_needs_more_steps_than_the_slider_has():
    rng = np.random.default_rng(12)
    for _ in range(100):
        controls, vb = posed(rng)
        assert sum(simplex.counts(controls, vb)) + 1 <= simplex.LAST
    run = Experiment(simplex.MODEL)
    assert run.picture().numbers["signed distance"] == "not yet"
    run.advance(100.0)
    assert run.picture().numbers["algorithm"] == "done"
    assert number(run, "signed distance") == number(run, "upper bound")
    run.choose("Overlapping: GJK, then EPA")
    run.advance(100.0)
    assert number(run, "signed distance") == -number(run, "lower bound") < 0.0


def test_a_drag_in_either_picture_moves_b():
    run = Experiment(simplex.MODEL)
    run.drag(*at_values(simplex._LEFT, simplex._LEFT_VIEW, -0.6, 0.5))
    assert run.controls["position"] == pytest.approx((-0.6, 0.5))
    run.drag(*at_values(simplex._RIGHT, simplex._RIGHT_VIEW, -0.6, 0.5))
    assert run.controls["position"] == pytest.approx((0.6, -0.5))


# --- penalty: spring, damper and step -------------------------------------------------------------


def test_a_fine_step_follows_the_closed_form_of_the_damped_oscillator():
    """From the first touch at the speed v0 until the force ends, about the depth of rest."""
    stiffness, zeta, drop = 10_000.0, 0.2, 0.05
    run = Experiment(
        penalty_spring.MODEL, stiffness=stiffness, zeta=zeta, height=1000.0 * drop, timestep=0.2
    )
    gravity, omega = penalty_spring.GRAVITY, math.sqrt(stiffness / penalty_spring.MASS)
    speed, rest = math.sqrt(2.0 * gravity * drop), gravity / omega**2
    damped = omega * math.sqrt(1.0 - zeta**2)
    t = np.linspace(0.0, math.pi / damped, 20_000)
    # depth - rest = e^(-zeta omega t) (-rest cos + c sin), with the speed v0 at t = 0.
    c = (speed - zeta * omega * rest) / damped
    depth = rest + np.exp(-zeta * omega * t) * (-rest * np.cos(damped * t) + c * np.sin(damped * t))
    path = run.state["path"]
    assert -path[0].min() == pytest.approx(depth.max(), rel=5e-3)
    assert number(run, "deepest") == pytest.approx(1000.0 * depth.max(), abs=0.1)
    peak = (stiffness * depth + penalty_spring.damper(run.controls) * np.gradient(depth, t)).max()
    assert path[2].max() == pytest.approx(peak, rel=0.01)


@pytest.mark.parametrize("zeta", [0.0, 0.2, 0.7, 1.5])
def test_a_resting_contact_settles_below_the_step_limit_and_not_above(zeta):
    stiffness = 10_000.0
    limit = step_limit(zeta, "semi-implicit")
    omega, rest = math.sqrt(stiffness), penalty_spring.GRAVITY / stiffness
    for share, stays in ((0.97, True), (1.03, False)):
        values = {"stiffness": stiffness, "zeta": zeta, "timestep": 1000.0 * share * limit / omega}
        controls = penalty_spring.CONTROLS.new(**values)
        path = np.zeros((3, penalty_spring._MOST + 1))
        steps = penalty_spring.steps_of(controls["timestep"])
        height, farthest = -rest + 1e-9, 0.0
        velocity = 0.0
        for _ in range(40):  # each run of the simulation from where the last one ended
            penalty_spring.simulate_from(controls, controls["timestep"], height, velocity, path)
            height, velocity = path[0, steps], path[1, steps]
            farthest = np.abs(path[0, : steps + 1] + rest).max()
        assert (farthest < 1e-6) == stays, (share, farthest)
        run = Experiment(penalty_spring.MODEL, **values)
        expected = "stable" if stays else "unstable"
        assert run.picture().numbers["resting contact"] == expected
        assert number(run, "limit of ω h") == pytest.approx(limit, abs=6e-3)


def test_the_presets_lie_on_both_sides_of_the_limit():
    sides = {}
    for name in penalty_spring.MODEL.presets:
        run = Experiment(penalty_spring.MODEL)
        run.choose(name)
        sides[name] = run.picture().numbers["resting contact"]
        forces = run.state["path"][2]
        assert (forces.min() < 0.0) == (name == "The damper pulls")
        tail = run.state["path"][0, : penalty_spring.steps_of(run.controls["timestep"]) + 1][-10:]
        assert (np.ptp(tail) < 1e-5) == (sides[name] == "stable"), name
    assert sides["Just below the limit"] == "stable" and sides["Just above the limit"] == "unstable"


def test_a_drag_sets_damping_ratio_and_step():
    run = Experiment(penalty_spring.MODEL)
    values = (*penalty_spring._ZETAS, *penalty_spring._SCALED)
    run.drag(*at_values(penalty_spring._BOTTOM, values, 0.6, 1.7))
    assert run.controls["zeta"] == pytest.approx(0.6)
    assert penalty_spring.scaled_step(run.controls) == pytest.approx(1.7)


# --- MuJoCo's soft contact ------------------------------------------------------------------------

SOFT = [
    {},
    {"time": 60.0, "ratio": 0.4, "height": 5.0},
    {"low": 0.05, "high": 0.95, "width": 15.0, "middle": 0.3, "power": 3.0},
    {"time": 4.0, "ratio": 1.5, "low": 0.6, "high": 0.6},
    {"low": 0.95, "high": 0.4, "width": 4.0, "power": 1.0},
]


def parameters(controls):
    """MuJoCo's solref and solimp of these controls."""
    solimp = [float(controls[name]) for name in ("low", "high", "width", "middle", "power")]
    solimp[2] *= 1e-3
    return (1e-3 * float(controls["time"]), float(controls["ratio"])), tuple(solimp)


@pytest.mark.parametrize("values", SOFT)
def test_the_landing_is_that_of_the_chapter_and_of_mujoco(values):
    run = Experiment(soft_contact.MODEL, **values)
    solref, solimp = parameters(run.controls)
    height, steps = 1e-3 * run.controls["height"], soft_contact.STEPS
    path = run.state["path"]
    scene = scenes.ball_drop(float(height), soft_contact.MASS)
    ours = scenes.run(scene, "soft", soft_contact.STEP, steps, solref=solref, solimp=solimp)
    offset = ours.q[0, 0] - path[0, 0]
    assert np.allclose(ours.q[0] - offset, path[0], rtol=0.0, atol=1e-9)
    options = mujoco_contact.Options(soft_contact.STEP, condim=1, solref=solref, solimp=solimp)
    runner = mujoco_contact.tower(options, [soft_contact.MASS])
    runner.q0[:] = height
    for count in (60, steps):
        q, v = runner.run(count)
        assert q[0] == pytest.approx(path[0, count], abs=1e-8)
        assert v[0] == pytest.approx(path[1, count], abs=1e-6)


@pytest.mark.parametrize("ratio", [0.5, 1.0])
def test_of_constant_impedance_it_is_a_damped_oscillator(ratio):
    """Rest: (1 - d) g = d^2 k r; with k = 1 / (d T zeta)^2 this is (1 - d) g (T zeta)^2."""
    values = {"low": 0.8, "high": 0.8, "time": 20.0, "ratio": ratio, "height": 0.0}
    run = Experiment(soft_contact.MODEL, **values)
    rest = 0.2 * soft_contact.GRAVITY * (0.02 * ratio) ** 2
    assert -run.state["path"][0, -1] == pytest.approx(rest, rel=1e-6)
    assert run.state["path"][2, -1] == pytest.approx(soft_contact.GRAVITY, rel=1e-6)


@examples(40)
@given(
    st.floats(0.01, 0.99),
    st.floats(0.01, 0.99),
    st.floats(0.5, 20.0),
    st.floats(0.05, 0.95),
    st.floats(1.0, 6.0),
)
def test_the_curve_goes_through_the_points_that_can_be_dragged(low, high, width, middle, power):
    values = {"low": low, "high": high, "width": width, "middle": middle, "power": power}
    controls = soft_contact.CONTROLS.new(**values)
    depths = 1e-3 * np.array([0.0, middle * width, width, 2.0 * width])
    expected = [low, low + middle * (high - low), high, high]
    assert np.allclose(soft_contact.impedance(controls, -depths), expected, rtol=1e-9)
    softness = Softness(*parameters(controls))
    assert np.allclose(softness.impedance(-depths), expected, rtol=1e-9)


def test_each_handle_moves_what_it_stands_for():
    for which, name, to in ((0, "low", (0.0, 0.4)), (1, "high", (1.5, 0.7)), (2, "middle", None)):
        run = Experiment(soft_contact.MODEL)
        place = soft_contact._LEFT, soft_contact._left_view(run.controls)
        at = soft_contact.handle_position(run.controls, which)
        run.grab(*at_values(*place, *at))
        assert run.controls["handle"] == which
        run.drag(*at_values(*place, *(to or (0.25, 0.5))))
        assert run.controls[name] == pytest.approx(to[1] if to else 0.25)
        assert run.controls["width"] == pytest.approx(1.5 if which == 1 else 1.0)
