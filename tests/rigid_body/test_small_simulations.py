"""Chapter 1's small simulations against closed forms: what they show is what must come out."""

import math

import numpy as np
import pytest

from course.rigid_body import oscillator, problems, quaternion
from course.simulations import simulation
from course.simulations.model import Experiment
from course.simulations.rigid_body import (
    double_cover,
    flip,
    free_body,
    gimbal,
    spring,
    top,
    tunnelling,
    turning,
)


def after(model, seconds, **values):
    experiment = Experiment(model, **values)
    experiment.advance(seconds)
    return experiment


def number(experiment, name):
    """A number as it is printed below the picture."""
    return float(
        experiment.picture().numbers[name].split()[0].strip("°").replace("\N{MINUS SIGN}", "-")
    )


def test_a_simulation_is_had_by_its_name():
    for name, model in (("top", top.MODEL), ("gimbal", gimbal.MODEL)):
        panel = simulation(name)
        assert panel.model is model
        panel.close()
    with pytest.raises(ValueError, match="name"):
        simulation("spinning_plate")


# --- turning freely -------------------------------------------------------------------------------


@pytest.mark.parametrize("tilt", [10.0, 40.0])
def test_the_free_brick_follows_jacobi(tilt):
    now = after(free_body.MODEL, 5.0, tilt=tilt).state
    start = after(free_body.MODEL, 0.0, tilt=tilt).state
    rates = 4.0 * math.sin(math.radians(tilt)), 4.0 * math.cos(math.radians(tilt))
    truth = problems.tumble(tuple(free_body.MOMENTS[0]), rates).truth
    (first, _), (then, omega) = truth(0.0), truth(5.0)
    np.testing.assert_allclose(now["omega"], omega, atol=1e-6)
    # Both have L along the world's z; they differ by a turn about it that stays.
    turn = quaternion.product(start["q"], quaternion.conjugate(first))
    assert quaternion.angle_between(now["q"], quaternion.product(turn, then)) < 1e-6
    assert abs(turn[1]) + abs(turn[2]) < 1e-12


def test_the_momentum_of_a_free_body_stays_and_its_rate_does_not():
    for body in range(4):
        experiment = after(free_body.MODEL, 4.0, body=body)
        q, omega = experiment.state["q"], experiment.state["omega"]
        momentum = quaternion.rotate(q, free_body.MOMENTS[body] * omega)
        assert abs(momentum[0]) + abs(momentum[1]) < 1e-7
        first, now = experiment.state["past"][4:7, 0], quaternion.rotate(q, omega)
        moved = np.degrees(np.arccos(first @ now / np.linalg.norm(first) / np.linalg.norm(now)))
        assert number(experiment, "ω has moved by") == pytest.approx(moved, abs=0.06)
        assert (moved < 0.01) == (free_body.BODIES[body] == "cube")


def test_the_axis_of_a_plate_circles_l_at_l_over_i1():
    one, other = (after(free_body.MODEL, t, body="plate", tilt=25.0).state for t in (0.0, 0.4))
    moments = free_body.MOMENTS[1]
    third = [quaternion.rotate(state["q"], np.array([0.0, 0, 1])) for state in (one, other)]
    before, now = (math.atan2(axis[1], axis[0]) for axis in third)
    length = np.linalg.norm(moments * one["omega"])
    assert (now - before) % (2 * math.pi) == pytest.approx(0.4 * length / moments[0], abs=1e-6)


def test_a_push_grows_at_the_rate_of_theory_about_the_middle_axis_only():
    for push in (-6.0, -3.0):
        experiment = after(flip.MODEL, 0.8, push=push)
        i1, i2, i3 = flip.MOMENTS
        rate = 6.0 * math.sqrt((i2 - i1) * (i3 - i2) / (i1 * i3))
        assert experiment.state["growth"] == pytest.approx(rate, rel=2e-3)
        assert number(experiment, "growth, in theory") == pytest.approx(rate, abs=1e-3)
    for axis in (0, 2):
        state = after(flip.MODEL, 6.0, axis=axis).state
        past = turning.recent(state)[1:4]
        assert state["flips"] == 0 and np.abs(np.delete(past, axis, 0)).max() < 3 * 0.01 * 6.0


def test_the_time_between_two_flips_is_half_a_period_of_the_elliptic_functions():
    from scipy.special import ellipk

    start = after(flip.MODEL, 0.0).state["omega"]
    (i1, i2, i3), energy = flip.MOMENTS, np.sum(flip.MOMENTS * start**2)
    square = np.sum((flip.MOMENTS * start) ** 2)
    if square < energy * i2:  # the first axis is the one that L keeps to
        i1, i3 = i3, i1
    pace = math.sqrt((i3 - i2) * (square - energy * i1) / (i1 * i2 * i3))
    m = (i2 - i1) * (energy * i3 - square) / ((i3 - i2) * (square - energy * i1))
    state = after(flip.MODEL, 10.0).state
    sample = turning.STEP * turning.SAMPLE
    assert state["flips"] >= 2
    assert state["between"] == pytest.approx(2 * ellipk(m) / pace, abs=1.5 * sample)


# --- the top --------------------------------------------------------------------------------------


@pytest.mark.parametrize("moments", [0, 1, 2])
def test_the_top_nods_as_the_elliptic_function_says(moments):
    values = {"moments": moments, "spin": 80.0 if moments == 0 else 15.0, "tilt": 30.0}
    state = after(top.MODEL, 1.0, **values).state
    inertia = top.I1, float(top.RATIOS[moments]) * top.I1
    past = state["past"][:, : state["samples"]]
    for time, height in past[[0, 9]][:, ::20].T:
        truth = problems.top_height_truth(time, inertia, 1.0, math.radians(30), values["spin"])
        assert height == pytest.approx(truth, abs=5e-5)


@pytest.mark.slow
def test_the_upright_top_stands_above_the_critical_spin_and_not_below():
    for moments, ratio in enumerate(top.RATIOS):
        edge = top.critical(ratio * top.I1)
        for share, stands in ((1.05, True), (0.95, False)):
            values = {"moments": moments, "spin": share * edge, "tilt": 1.0}
            state = after(top.MODEL, 4.0, **values).state
            lowest = state["past"][9, : state["samples"]].min()
            assert (math.degrees(math.acos(lowest)) < 10.0) == stands


def test_equal_moments_have_no_gyroscopic_term_and_the_top_stands():
    experiment = after(top.MODEL, 2.0, moments=1, spin=60.0)
    assert number(experiment, "ω × I ω") == 0.0
    assert experiment.state["past"][9, : experiment.state["samples"]].min() > math.cos(0.7)
    assert after(top.MODEL, 2.0, moments=1, spin=0.0).state["past"][9].min() < -0.9


# --- angles and quaternions -----------------------------------------------------------------------


def test_the_lost_axis_is_the_one_that_the_rings_turn_about_worst():
    for yaw, pitch, roll in np.random.default_rng(4).uniform(-1.5, 1.5, (30, 3)):
        E = quaternion.euler_zyx_rate_matrix(pitch, roll)
        remaining, values, _ = np.linalg.svd(E)
        world = quaternion.rotate(quaternion.from_euler_zyx(yaw, pitch, roll), remaining[:, 2])
        axes = gimbal.axes_of(yaw, pitch, roll)
        assert abs(world @ axes[3]) == pytest.approx(1.0, abs=1e-9)
        assert values[2] == pytest.approx(math.sqrt(1 - abs(math.sin(pitch))))
        # The rings' axes are what the columns of E are in the world.
        for k in range(3):
            column = quaternion.rotate(quaternion.from_euler_zyx(yaw, pitch, roll), E[:, k])
            np.testing.assert_allclose(column, axes[k], atol=1e-12)


def test_at_90_degrees_no_ring_turns_about_the_lost_axis():
    for pitch in (90.0, -90.0):
        axes = gimbal.axes_of(0.4, math.radians(pitch), 1.1)
        assert np.abs(axes[:3] @ axes[3]).max() < 1e-12
        assert number(Experiment(gimbal.MODEL, pitch=pitch), "weakest turn") == 0.0
    assert number(Experiment(gimbal.MODEL, pitch=60.0), "weakest turn") == 0.3660


def test_after_a_full_turn_the_body_is_back_and_its_quaternion_is_not():
    once = after(double_cover.MODEL, 9.0, goal=360.0)
    assert (
        number(once, "w = cos(half)") == -1.0 and once.picture().numbers["angle from start"] == "0°"
    )
    twice = after(double_cover.MODEL, 20.0, goal=720.0)
    assert number(twice, "w = cos(half)") == 1.0 and twice.state["turned"] == 4 * math.pi


@pytest.mark.parametrize("goal", [90.0, 270.0])
def test_both_ways_end_at_one_attitude_and_make_a_full_turn_together(goal):
    paths = [
        after(double_cover.MODEL, 9.0, goal=goal, path=path).state["turned"] for path in (0, 1)
    ]
    ends = [quaternion.exp(turned * double_cover.AXIS) for turned in paths]
    np.testing.assert_allclose(ends[0], -ends[1], atol=1e-15)
    assert paths[0] - paths[1] == pytest.approx(2 * math.pi)
    shorter = int(np.argmin(np.abs(paths)))
    assert shorter == (0 if ends[0][0] > 0 else 1)


# --- in the plane ---------------------------------------------------------------------------------


@pytest.mark.parametrize("method", range(6))
def test_the_step_of_the_spring_is_the_matrix_derived_by_hand(method):
    for omega_h, zeta in ((0.3, 0.0), (1.1, 0.25), (2.3, 0.0)):
        experiment = Experiment(spring.MODEL, omega_h=omega_h, zeta=zeta, method=method)
        expected = oscillator.step_matrix(oscillator.METHODS[method], omega_h, zeta)
        np.testing.assert_allclose(experiment.state["matrix"], expected, atol=1e-12)
        modulus = np.abs(np.linalg.eigvals(expected)).max()
        assert number(experiment, "largest |eigenvalue|") == pytest.approx(modulus, abs=6e-5)


def test_the_patch_keeps_the_area_that_the_determinant_says():
    for method in range(6):
        experiment = after(spring.MODEL, 1.5, omega_h=0.4, method=method)
        shown = [number(experiment, name) for name in ("area of the patch", "determinant ^ steps")]
        assert experiment.state["steps"] == 22 and shown[0] == shown[1]
        assert (shown[0] == 1.0) == (method in (1, 2, 4))


def test_the_spring_leaves_all_bounds_just_beyond_two():
    for omega_h, bound in ((1.99, True), (2.01, False)):
        state = after(spring.MODEL, 60.0, omega_h=omega_h).state
        assert (np.abs(state["past"][1:, : state["samples"]]).max() < 50.0) == bound
    experiment = Experiment(spring.MODEL)
    experiment.drag(*(spring._SCALE[0] + 2.0 / 3.2 * 3.3, 2.3))
    assert experiment.controls["omega_h"] == pytest.approx(2.0)


def test_a_wall_is_missed_as_often_as_theory_says():
    for speed, timestep, wall in ((40.0, 10.0, 20.0), (12.0, 10.0, 20.0), (100.0, 20.0, 200.0)):
        values = {"speed": speed, "timestep": timestep, "wall": wall}
        experiment = Experiment(tunnelling.MODEL, **values)
        distance, wide = 1e-3 * speed * timestep, 0.1 + 1e-3 * wall
        assert experiment.state["share"] == pytest.approx(max(0.0, 1 - wide / distance), abs=1.1e-3)
        assert Experiment(tunnelling.MODEL, **values, sweep=True).state["share"] == 0.0


def test_the_shots_are_missed_in_proportion_and_never_when_swept():
    state = after(tunnelling.MODEL, 3000.0).state
    p, n = 0.7, int(state["shots"])
    assert n > 1000 and abs(state["missed"] - p * n) < 4 * math.sqrt(n * p * (1 - p))
    swept = after(tunnelling.MODEL, 300.0, sweep=True).state
    assert swept["shots"] > 100 and swept["missed"] == 0
