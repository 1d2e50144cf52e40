"""Chapter 1's small simulations against closed forms: what they show is what must come out."""

import math

import numpy as np
import pytest

from course.rigid_body import oscillator, problems, quaternion
from course.rigid_body.integrators import INTEGRATORS
from course.simulations import pen as draw
from course.simulations import simulation
from course.simulations.model import Experiment
from course.simulations.rigid_body import (
    double_cover,
    flip,
    force_evaluations,
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


@pytest.mark.prove
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


# --- where an integrator evaluates the force ------------------------------------------------------

STEPS = [INTEGRATORS[name] for name in oscillator.METHODS]
PHASES = range(-180, 180, 15)


def step_shown(**values):
    return Experiment(force_evaluations.MODEL, **values)


def evaluations(experiment):
    """x + i v / omega at each evaluation."""
    n = experiment.state["count"]
    return experiment.state["evaluated"][0, :n] + 1j * experiment.state["evaluated"][1, :n]


def as_complex(state):
    return complex(*state)


@pytest.mark.parametrize("method", range(6))
@pytest.mark.parametrize("omega_h", [0.1, 1.2, 1.4])
@pytest.mark.parametrize("phase", [-180.0, 45.0, 180.0])
def test_the_step_that_is_drawn_is_that_of_the_integrator(method, omega_h, phase):
    experiment = step_shown(method=method, omega_h=omega_h, phase=phase)
    # In other units of time: a spring of 6 rad/s.
    omega, h = 6.0, omega_h / 6.0
    angle = math.radians(phase)
    q, v, params = np.cos([angle]), omega * np.sin([angle]), np.array([omega, 0.0])
    step, law = STEPS[method].step, problems.oscillator_acceleration
    end_q, end_v = step(q, v, law, h, params)
    np.testing.assert_allclose(experiment.state["end"], [end_q[0], end_v[0] / omega], atol=1e-12)
    half_q, half_v = step(*step(q, v, law, 0.5 * h, params), law, 0.5 * h, params)
    np.testing.assert_allclose(
        experiment.state["halves"], [half_q[0], half_v[0] / omega], atol=1e-12
    )
    # The ring of the picture over time stands there too.
    view = (-0.1 * omega_h, 1.1 * omega_h, -force_evaluations._HIGH, force_evaluations._HIGH)
    rings = [
        draw.values_at(force_evaluations._LEFT, view, *item.points[:, 0])
        for item in draw.decode(experiment.picture())
        if item.kind == draw.DISC and item.style[1] == draw.NONE
    ]
    assert any(np.allclose(ring, (omega_h, end_q[0]), atol=1e-9) for ring in rings)


@pytest.mark.parametrize("method", range(6))
def test_the_largest_step_stays_inside_the_picture(method):
    largest = force_evaluations.CONTROLS.fields["omega_h"].high
    left, right, *_ = force_evaluations._RIGHT
    ring = 1.3 * force_evaluations._DOT * 2.0 * force_evaluations._HIGH / (right - left)
    for phase in range(-180, 180, 5):
        shown = step_shown(method=method, omega_h=largest, phase=float(phase))
        start = evaluations(shown)
        tips = start - 1j * force_evaluations._ARROW * start  # of the rates, y' = -i y
        points = np.concatenate([start, tips])
        assert max(abs(points.real).max(), abs(points.imag).max()) < force_evaluations._HIGH
        assert np.abs(shown.state["end"]).max() + ring < force_evaluations._HIGH


@pytest.mark.parametrize("method", range(6))
def test_each_evaluation_is_drawn_at_its_time(method):
    # A second coordinate moves with speed 1: it is the clock that the method itself uses.
    times = []

    def law(q, v, params):
        times.append(q[1])
        return np.array([-q[0], 0.0])

    STEPS[method].step(np.array([0.6, 0.0]), np.array([0.8, 1.0]), law, 0.7, np.zeros(1))
    fractions = force_evaluations.FRACTIONS[method]
    drawn = [0.7 * fractions[min(k, 3)] for k in range(len(times))]
    np.testing.assert_allclose(times, drawn, atol=1e-6)  # the Jacobian's differences move it a bit


@pytest.mark.parametrize("phase", [-120.0, 0.0, 45.0])
def test_evaluations_are_where_the_formulas_put_them(phase):
    h, y = 1.2, np.exp(1j * math.radians(phase))
    # With y = x + i v / omega the exact rate is -i y.
    middle = y - 0.5j * h * y
    stages = [y, middle, y - 0.5j * h * middle, y - 1j * h * (y - 0.5j * h * middle)]
    expected = {0: [y], 1: [y], 3: stages[:2], 5: stages}
    for method, states in expected.items():
        np.testing.assert_allclose(
            evaluations(step_shown(method=method, phase=phase)), states, atol=1e-12
        )
        shown = step_shown(method=method, phase=phase)
        assert number(shown, "force evaluations") == len(states)
    verlet = step_shown(method=2, phase=phase)
    assert verlet.picture().numbers["force evaluations"] == "2 (1 reused)"
    assert evaluations(verlet)[1].real == pytest.approx(verlet.state["end"][0], abs=1e-12)
    implicit = step_shown(method=4, phase=phase)
    halfway = 0.5 * (y + as_complex(implicit.state["end"]))
    assert evaluations(implicit)[-1] == pytest.approx(halfway, abs=1e-6)
    assert 4 <= number(implicit, "force evaluations") <= 7


def test_errors_of_a_step_are_those_of_the_series():
    h, y = 1.2, np.exp(1j * math.radians(45.0))
    z = -1j * h
    factors = {0: 1 + z, 3: 1 + z + z**2 / 2, 4: (1 + z / 2) / (1 - z / 2)}
    factors[5] = 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24
    for method, factor in factors.items():
        shown = step_shown(method=method)
        error = (factor - np.exp(z)) * y
        assert number(shown, "error of the step") == pytest.approx(abs(error), abs=6e-5)
        assert number(shown, "error in position") == pytest.approx(error.real, abs=6e-5)


@pytest.mark.parametrize("method", range(6))
def test_two_half_steps_show_the_order(method):
    for phase in PHASES:
        shown = step_shown(method=method, omega_h=0.1, phase=float(phase))
        theory = number(shown, "ratio for small ω h")
        assert theory == 2 ** STEPS[method].order
        assert number(shown, "ratio of the errors") == pytest.approx(theory, rel=0.1)


def test_what_the_presets_say_of_the_end_of_the_step():
    def sizes(method):
        ends = [step_shown(method=method, phase=float(phase)).state["end"] for phase in PHASES]
        return np.array([abs(as_complex(end)) for end in ends])

    assert sizes(0).min() > 1.1
    assert sizes(1).min() < 0.9 and sizes(1).max() > 1.1
    np.testing.assert_allclose(sizes(4), 1.0, atol=1e-12)
    for phase in PHASES:
        errors = [
            force_evaluations.error_of(shown.controls, shown.state["end"])
            for shown in (step_shown(method=method, phase=float(phase)) for method in range(6))
        ]
        assert errors[5] < 0.5 * min(errors[:5])
    *named, (_, order) = force_evaluations.PRESETS.items()
    assert [name.lower() for name, _ in named] == [step.label.lower() for step in STEPS]
    assert [preset.values.get("method", 0) for _, preset in named] == list(range(6))
    assert STEPS[order.values["method"]].order == 4


def test_playing_shows_the_evaluations_in_turn():
    def drawn(experiment):
        blue = [
            item
            for item in draw.decode(experiment.picture())
            if item.kind == draw.DISC and item.style[1] == draw.BLUE
        ]
        return (len(blue) - 1) // 2  # one is in the key; each stands in both pictures

    experiment = step_shown(method=5)
    assert drawn(experiment) == 4
    experiment.advance(0.5 * force_evaluations._PACE)
    sequence = [drawn(experiment)]
    for _ in range(8):
        experiment.advance(force_evaluations._PACE)
        sequence.append(drawn(experiment))
    assert sequence == [1, 2, 3, 4, 4, 4, 4, 1, 2]


def test_the_start_is_dragged_around_the_circle():
    experiment = step_shown()
    left, right, bottom, top = force_evaluations._RIGHT
    experiment.drag(0.5 * (left + right), top)
    assert experiment.controls["phase"] == 90.0
    experiment.drag(0.5 * (left + right), 0.5 * (bottom + top))
    assert -180.0 <= experiment.controls["phase"] <= 180.0
    experiment.drag(left, 0.5 * (bottom + top))
    assert abs(experiment.controls["phase"]) == 180.0
    assert evaluations(experiment)[0] == pytest.approx(-1.0, abs=1e-12)


# --- tunnelling -----------------------------------------------------------------------------------


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
