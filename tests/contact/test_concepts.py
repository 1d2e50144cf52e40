"""Chapter 2's small simulations against closed forms: what they show is what must come out."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import contact
from course.contact import scenes
from course.simulations import pen as draw
from course.simulations.contact import friction_cone, half_axes
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
    names = {name: Experiment(friction_cone.MODEL, **preset.values)
             for name, preset in friction_cone.MODEL.presets.items()}  # fmt: skip
    modes = {name: each.picture().numbers["contact"] for name, each in names.items()}
    assert modes["It sticks"] == "sticks" and modes["It slides"] == "slides"


# --- complementarity ------------------------------------------------------------------------------


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
