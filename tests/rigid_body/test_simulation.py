"""Chapter 1's simulation: its motion, its presets and its picture against what must come out."""

import numpy as np
import pytest

from course.rigid_body.planar import FLIGHT_COEFFICIENT
from course.simulations import pen as draw
from course.simulations.model import Experiment
from course.simulations.rigid_body.bouncing_box import (
    CONTROLS,
    FLAT,
    MASS,
    MENU,
    MODEL,
    PRESETS,
    TUMBLING,
    energies,
    scene,
)


def after(seconds, controls=None, **values):
    """The state after so many seconds, with these controls."""
    experiment = Experiment(MODEL, **{**(controls or {}), **values})
    experiment.advance(seconds)
    return experiment.state


def height(state):
    return state["box"][1, 0]


def total(state, gravity=9.8):
    return float(energies(state["box"][:, 0], gravity)[2])


def history(state):
    return state["history"][:, : state["samples"]]


def test_it_starts_with_semi_implicit_euler():
    controls = CONTROLS.new()
    assert list(MENU)[controls["integrator"]] == "semi-implicit Euler"
    assert set(MENU.values()) == set(FLIGHT_COEFFICIENT)


def test_gravity_changes_the_fall():
    # Before the first impact: h = h0 - g t (t + dt) / 2 with semi-implicit Euler.
    for gravity in (1.0, 9.8, 20.0):
        fallen = TUMBLING[1] - height(after(0.3, gravity=gravity))
        assert fallen == pytest.approx(gravity * 0.3 * 0.302 / 2, abs=1e-9)
    assert height(after(3.0, gravity=0.0)) == TUMBLING[1]


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.7, 1.0])
def test_restitution_sets_the_bounce_height(restitution):
    # A flat drop of 2 m: it hits at sqrt(2 h / g) and rises to e^2 h.
    fall = np.sqrt(2 * 2.0 / 9.8)
    state = after(
        fall * (1.0 + restitution) + 0.002,
        restitution=restitution,
        integrator="velocity Verlet",
        start=(0.0, 2.2, 0, 0, 0, 0),
    )
    assert height(state) - 0.2 == pytest.approx(2.0 * restitution**2, abs=1e-4)


def test_the_box_rotates_and_friction_slows_it():
    assert abs(after(0.5)["box"][2, 0] - TUMBLING[2]) > 0.4
    sliding = (0.0, 0.2, 0.0, 1.0, 0.0, 0.0)
    smooth = after(0.5, friction=0.0, start=sliding)["box"][3, 0]
    rough = after(0.05, friction=0.3, start=sliding, integrator="RK4")["box"][3, 0]
    assert smooth == pytest.approx(1.0)
    assert rough == pytest.approx(1.0 - 0.3 * 9.8 * 0.05, abs=1e-6)


def test_timestep_and_integrator_change_the_flight():
    # Free fall from rest for t: the drop is g t^2/2 + (c - 1/2) g h t.
    for shown, name in MENU.items():
        for ms in (2.0, 20.0, 50.0):
            drop = TUMBLING[1] - height(after(0.3, timestep=ms, integrator=shown))
            expected = 9.8 * (0.3**2 / 2 + (FLIGHT_COEFFICIENT[name] - 0.5) * 1e-3 * ms * 0.3)
            assert drop == pytest.approx(expected, abs=1e-9)


def test_every_control_changes_the_picture():
    picture = Experiment(MODEL).picture().data.tobytes()
    for change in (
        {"gravity": 9.9},
        {"restitution": 0.71},
        {"timestep": 2.5},
        {"friction": 0.1},
        {"integrator": "RK4"},
        {"resolve_impacts": False},
        {"start": FLAT},
    ):
        assert Experiment(MODEL, **change).picture().data.tobytes() != picture, change


def test_time_in_pieces_is_the_same_time():
    pieces = Experiment(MODEL, timestep=3.5)
    for _ in range(100):
        pieces.advance(0.0173)
    whole = after(1.73, timestep=3.5)
    assert pieces.state["steps"] == whole["steps"] == 494
    assert pieces.state["box"] == pytest.approx(whole["box"], abs=1e-12)
    assert pieces.state["owed"] == pytest.approx(1.73 - 494 * 0.0035, abs=1e-9)


@pytest.mark.parametrize("timestep", [2.0, 7.0, 6.67])
def test_at_least_ten_seconds_are_remembered(timestep):
    # 6.67 ms: the rounded time between two samples is the shortest.
    past = history(after(40.0, timestep=timestep))
    assert past[0, -1] == pytest.approx(40.0, abs=0.02)
    assert past[0, 0] <= past[0, -1] - 10.0
    assert past[1] + past[2] == pytest.approx(past[3])
    assert np.ptp(np.diff(past[0])) < 1e-9


def test_the_path_drawn_is_the_path_taken():
    for controls in ({}, PRESETS["Exact flight, late impacts"].values):
        state = after(0.0, controls)
        path = state["path"][:, : state["path_points"]]
        for k in (5, path.shape[1] // 2, path.shape[1] - 1):
            later = after(path[0, k], controls)
            assert later["box"][:, 0] == pytest.approx(path[1:7, k], abs=1e-9)
            assert total(later) == pytest.approx(path[7, k], abs=1e-9)
        assert path[0, -1] >= 3.0 - 1e-9


def test_the_reference_keeps_the_energy_of_an_elastic_box():
    for name in ("Explicit Euler gains energy", "Exact flight, late impacts"):
        state = after(0.0, PRESETS[name].values)
        energy = state["good"][7, : state["good_points"]]
        assert np.ptp(energy) < 1e-6 * energy[0]


# Each preset shows its failure, and what it blames is the cause: mended, the failure goes.


def change(controls, seconds=10.0, **values):
    state = after(seconds, controls, **values)
    return total(state) / state["energy"] - 1.0


@pytest.mark.parametrize(
    ("name", "sign"),
    [("Explicit Euler gains energy", 1), ("Semi-implicit Euler, bouncing", -1)],
)
def test_first_order_flight_changes_energy_by_g2_h2_over_2_per_step(name, sign):
    controls = PRESETS[name].values
    gained = MASS * (9.8 * 0.02) ** 2 / 2 * 500
    state = after(10.0, controls)
    assert total(state) - state["energy"] == pytest.approx(sign * gained, rel=0.05)
    assert abs(change(controls, integrator="velocity Verlet")) < 1e-9
    assert state["unresolved"] == 0
    assert sign * (state["peak"] - 2.5) >= 0.0


def test_exact_flight_does_not_help_where_impacts_are_late():
    controls = PRESETS["Exact flight, late impacts"].values
    assert FLIGHT_COEFFICIENT[MENU[controls["integrator"]]] == 0.5
    assert change(controls) > 0.2
    assert abs(change(controls, resolve_impacts=True)) < 1e-9


def test_a_big_step_finds_the_box_deep_in_the_ground():
    controls = PRESETS["50 ms steps: deep in the ground"].values
    assert after(10.0, controls)["deepest"] > 0.2  # more than half of the box
    assert after(10.0, controls, timestep=2.0)["deepest"] < 0.02
    assert after(10.0, controls, resolve_impacts=True)["deepest"] == 0.0


def test_late_impacts_never_come_to_rest():
    controls = PRESETS["Late impacts: never at rest"].values
    early, late = after(20.0, controls), after(30.0, controls)
    assert late["impacts"] > early["impacts"] + 50
    assert history(early)[1, -500:].max() > 1e-3  # it still moves
    calm = after(20.0, controls, resolve_impacts=True)
    assert history(calm)[1, -500:].max() == 0.0
    assert calm["impacts"] < 50


def test_without_rest_speed_impacts_have_no_end():
    controls = PRESETS["No rest speed: endless impacts"].values
    state = after(10.0, controls)
    assert state["impacts"] > 10_000 and state["unresolved"] > 100
    mended = after(10.0, controls, rest_speed=0.01)
    assert mended["impacts"] < 100 and mended["unresolved"] == 0


def test_the_default_box_comes_to_rest_with_only_losses():
    state = after(10.0)
    assert (state["box"][3:] == 0.0).all()
    assert np.diff(history(state)[3]).max() <= 1e-12


def test_a_start_in_the_ground_is_lifted_onto_it():
    for resolve in (True, False):
        state = after(0.0, start=(0.0, -1.0, 0.0, 0.0, 0.0, 0.0), resolve_impacts=resolve)
        assert height(state) == 0.2 and state["energy"] == pytest.approx(9.8 * 0.2)
        assert state["path"][2, 0] == 0.2


# The picture


def test_numbers_agree_with_the_state():
    experiment = Experiment(MODEL)
    assert experiment.picture().numbers["energy change"] == "+0.00 %"
    experiment.advance(1.0)
    text = experiment.picture().numbers
    kinetic, potential, both = energies(experiment.state["box"][:, 0], 9.8)
    assert text["time"] == "1.000 s"
    assert text["kinetic"] == f"{kinetic:.3f} J" and text["potential"] == f"{potential:.3f} J"
    assert text["energy change"].startswith("\N{MINUS SIGN}") and text["total"] == f"{both:.3f} J"
    still = Experiment(MODEL, gravity=0.0, start=(0.0, 1.0, 0.0, 0.0, 0.0, 0.0))
    assert still.picture().numbers["energy change"] == "\N{EN DASH}"
    deep = Experiment(MODEL, **PRESETS["50 ms steps: deep in the ground"].values)
    deep.advance(10.0)
    assert deep.picture().numbers["deepest in ground"] == f"{1e3 * deep.state['deepest']:.1f} mm"


def test_the_box_is_always_in_the_picture_and_where_it_is():
    controls = {**PRESETS["Explicit Euler gains energy"].values, "timestep": 50.0}
    experiment = Experiment(MODEL, **controls, start=(0.0, 2.5, 0.3, 5.0, 0.0, 1.0))
    for _ in range(40):
        experiment.advance(0.5)
        x0, x1, y0, y1 = scene(experiment.state)
        box = experiment.state["box"][:, 0]
        assert x0 < box[0] < x1 and y0 < box[1] < y1
        items = list(draw.decode(experiment.picture()))
        left, right, bottom, top = items[0].points.ravel()
        assert (x1 - x0) / (right - left) == pytest.approx((y1 - y0) / (top - bottom))
        shown = next(i for i in items if i.kind == draw.POLYGON and i.style[3] == 0.95)
        corners = np.array(
            draw.values_at((left, right, bottom, top), (x0, x1, y0, y1), *shown.points)
        )
        assert corners.mean(axis=1) == pytest.approx(box[:2])
        sides = np.linalg.norm(np.diff(corners, axis=1), axis=0)
        assert sides == pytest.approx([0.6, 0.4, 0.6])
        side = corners[:, 1] - corners[:, 0]
        assert side == pytest.approx([0.6 * np.cos(box[2]), 0.6 * np.sin(box[2])], abs=1e-9)


def test_the_bars_are_the_energies():
    experiment = Experiment(MODEL)
    experiment.advance(0.4)
    fills = {draw.RED: 0, draw.BLUE: 1, draw.GREEN: 2}
    bars = {
        fills[int(item.style[0])]: np.ptp(item.points[1])
        for item in draw.decode(experiment.picture())
        if item.kind == draw.POLYGON and item.style[0] in fills
    }
    now = energies(experiment.state["box"][:, 0], 9.8)
    assert [bars[k] / bars[2] for k in range(3)] == pytest.approx([e / now[2] for e in now])


def test_dragging_puts_the_box_under_the_pointer_and_above_the_ground():
    experiment = Experiment(MODEL)
    area = next(draw.decode(experiment.picture())).points.ravel()
    window = draw.values_at(scene(experiment.state), area, 1.0, 1.5)
    experiment.drag(*window)
    assert experiment.controls["start"][:2] == pytest.approx((1.0, 1.5))
    assert experiment.state["box"][:2, 0] == pytest.approx((1.0, 1.5))
    experiment.drag(window[0], -3.0)
    assert experiment.controls["start"][1] > 0.2
