"""Chapter 2's simulation: its geometry, its two models, and what each preset shows."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course import contact
from course.simulations import simulation
from course.simulations.contact import touch
from course.simulations.contact.touch import (
    CONTROLS,
    FIXED,
    GRAVITY,
    HAND,
    HOLD,
    MASS,
    MODEL,
    MOVING,
    PLACE,
    RECOVERY,
    SLIP,
)
from course.simulations.model import Experiment
from tests.budget import examples

PENALTY, CONSTRAINT = 0, 1


def chosen(preset, **values):
    experiment = Experiment(MODEL)
    experiment.choose(preset)
    if values:
        experiment.set(**values)
    return experiment


def forces(experiment, seconds, dt=0.005):
    """Forces after each few steps, (samples, models, (normal, along))."""
    result = []
    for _ in range(round(seconds / dt)):
        experiment.advance(dt)
        result.append(np.array(experiment.state["force"]))
    return np.array(result)


def shape(half):
    """The shape of the chapter with these half sides and radius."""
    return contact.sphere(half[2], dim=2) if half[2] > 0.0 else contact.box(half[:2])


def test_a_panel_begins_with_the_preset_that_is_asked_for():
    panel = simulation("touch", "Slip")
    assert panel.controls["hand"][0] == MODEL.presets["Slip"].values["hand"][0]
    panel.close()
    with pytest.raises(ValueError, match="preset"):
        simulation("touch", "Bounce")


@pytest.mark.parametrize("fixed", range(len(FIXED)))
@pytest.mark.parametrize("moving", range(len(MOVING)))
def test_the_gap_and_the_normal_are_those_of_the_chapter(fixed, moving):
    rng = np.random.default_rng(10 * fixed + moving)
    controls = CONTROLS.new(fixed=fixed, moving=moving)
    at = rng.uniform(-1.9, 1.9, (2, 400))
    still, poses = np.append(PLACE[fixed], 0.0), np.vstack((at, np.zeros(400)))
    truth = contact.distance(
        shape(FIXED[fixed]), np.tile(still[:, None], 400), shape(MOVING[moving]), poses
    )
    result = np.array([touch.touch(controls, x, y) for x, y in at.T])
    assert np.ptp(np.sign(result[:, 0])) == 2.0  # some apart, some in each other
    assert np.allclose(result[:, 0], truth.distance, rtol=0.0, atol=1e-12)
    assert np.allclose(result[:, 1:].T, truth.normal, rtol=0.0, atol=1e-9)


def test_below_the_cone_the_constraint_stays_and_the_penalty_creeps():
    """Hand and friction balance: HAND (hand - x) = (mu f_n / SLIP + HOLD) v."""
    now = chosen("Stick")
    now.advance(0.5)  # both have settled
    start, force = np.array(now.state["bodies"]), np.array(now.state["force"])
    mu, hand = now.controls["friction"], now.controls["hand"][0]
    rate = HAND / (mu * force[PENALTY, 0] / SLIP + HOLD)
    share = abs(force[PENALTY, 1]) / (mu * force[PENALTY, 0])
    assert 0.01 < share < 0.95
    assert start[PENALTY, 2] == pytest.approx(SLIP * share, rel=0.02)
    assert abs(force[CONSTRAINT, 1]) < 0.95 * mu * force[CONSTRAINT, 0]
    now.advance(0.5)
    end = now.state["bodies"]
    assert np.abs(end[CONSTRAINT] - start[CONSTRAINT]).max() < 1e-12
    remaining = (hand - end[PENALTY, 0]) / (hand - start[PENALTY, 0])
    assert remaining == pytest.approx(math.exp(-0.5 * rate), rel=0.02)


def test_above_it_both_slide_on_the_edge_of_the_cone():
    now = chosen("Slip")
    now.advance(0.05)
    mu = now.controls["friction"]
    for normal, along in now.state["force"]:
        # Pulled to the right: friction acts to the left, and the tangent points to the right.
        assert normal > 0.0 and along == pytest.approx(-mu * normal, rel=1e-12)
    assert (now.state["bodies"][:, 2] > 0.1).all()


@examples(8)
@given(st.floats(0.0, 1.5), st.floats(1e3, 5e4))
def test_the_penalty_rests_just_below_its_limit_and_not_above(zeta, stiffness):
    """Hand and contact are springs and dampers, both from the old velocity."""
    controls = CONTROLS.new(stiffness=stiffness, zeta=min(zeta, 2.0), friction=0.0)
    omega = math.sqrt((stiffness + HAND) / MASS)
    damper = 2.0 * zeta * math.sqrt(stiffness * MASS) + HOLD
    ratio = damper / (2.0 * MASS * omega)
    limit = 2.0 * (math.sqrt(1.0 + ratio**2) - ratio) / omega
    rest = 0.2 - (MASS * GRAVITY) / (stiffness + HAND)
    for share, stays in ((0.97, True), (1.03, False)):
        body, force = np.array([0.0, rest + 1e-6, 0.0, 0.0]), np.zeros(2)
        farthest = 0.0
        for k in range(1500):
            touch.step(controls, share * limit, PENALTY, body, force)
            if k >= 1400:
                farthest = max(farthest, abs(body[1] - rest))
        assert (farthest < 1e-5) == stays, (share, farthest)


def test_an_explosion_of_the_penalty_leaves_the_constraint_at_rest():
    now = chosen("Explosion")
    heights = []
    for _ in range(100):
        now.advance(0.02)
        heights.append(np.array(now.state["bodies"][:, 1]))
    thrown = np.array(heights)[20:]
    assert np.ptp(thrown[:, PENALTY]) > 0.05
    assert np.ptp(thrown[:, CONSTRAINT]) < 1e-12


def test_only_a_damper_that_may_pull_pulls():
    assert forces(chosen("Pull-back"), 0.5)[:, PENALTY, 0].min() < -1.0
    assert forces(chosen("Pull-back", pull=False), 0.5)[:, PENALTY, 0].min() == 0.0


@examples(12)
@given(
    st.floats(-1.0, 1.0),
    st.floats(-0.5, 1.0),
    st.floats(-5.0, 5.0),
    st.floats(0.0, 2.0),
    st.floats(0.0, 1.5),
)
def test_no_contact_pulls_without_the_switch(x, y, speed, zeta, friction):
    now = Experiment(
        MODEL, start=(x, 0.5, speed, -abs(speed)), hand=(x, y), zeta=zeta, friction=friction
    )
    result = forces(now, 0.5)
    assert result[:, :, 0].min() >= 0.0
    assert (np.abs(result[..., 1]) <= friction * result[..., 0] + 1e-9).all()


def test_the_penalty_passes_the_thin_wall():
    now = chosen("Tunnelling")
    now.advance(1.0)
    assert now.state["bodies"][PENALTY, 0] > PLACE[2][0] + FIXED[2][0]


@examples(12)
@given(st.floats(1.0, 100.0), st.floats(0.5, 40.0), st.floats(-1.0, -0.2))
def test_the_constraint_never_passes_it(speed, timestep, x):
    now = chosen("Tunnelling", start=(x, 0.3, speed, 0.0), timestep=timestep)
    near = PLACE[2][0] - FIXED[2][0] - MOVING[0][2]
    for _ in range(50):
        now.advance(0.02)
        # A gap that closes within the step is closed to rounding, not passed.
        assert now.state["bodies"][CONSTRAINT, 0] <= near + 1e-9


@pytest.mark.parametrize("model", [PENALTY, CONSTRAINT])
def test_nothing_acts_across_a_gap_that_stays_open(model):
    controls = CONTROLS.new(hand=(0.0, 0.8))
    body, force = np.array([0.0, 0.8, 0.3, -1.0]), np.ones(2)
    touch.step(controls, 0.005, model, body, force)
    assert not force.any()
    assert body[3] == pytest.approx(-1.0 + 0.005 * (HOLD / MASS - GRAVITY), abs=1e-14)


def test_a_share_of_an_overlap_is_taken_back_in_each_step():
    controls = CONTROLS.new(friction=0.0, hand=(0.0, -1.6))
    body, force = np.array([0.0, 0.1, 0.0, 0.0]), np.zeros(2)
    depth = -touch.touch(controls, 0.0, 0.1)[0]
    for k in range(1, 6):
        touch.step(controls, 0.005, CONSTRAINT, body, force)
        assert -touch.touch(controls, body[0], body[1])[0] == pytest.approx(
            depth * (1.0 - RECOVERY) ** k, rel=1e-9
        )


def test_a_drag_beyond_the_picture_keeps_the_hand_within_its_limits():
    controls, state = CONTROLS.new(), MODEL.state.new()
    assert MODEL.drag is not None
    for x, y in ((1e3, -1e3), (-1e3, 1e3)):
        MODEL.drag(controls, state, x, y)
        assert np.abs(controls["hand"]).max() <= 1.6
