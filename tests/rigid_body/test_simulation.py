"""Chapter 1's simulation: the pure model at both ends of every control, its presets, its panel."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.rigid_body.planar import FLIGHT_COEFFICIENT
from course.simulations.canvas import Pointer, encode
from course.simulations.panel import Panel
from course.simulations.rigid_body import (
    FLAT,
    MASS,
    MENU,
    PRESETS,
    SLIDERS,
    TUMBLING,
    Controls,
    advance,
    drag,
    energies,
    frame,
    initial,
    numbers,
    preview,
    reference,
    scene_axes,
    simulation,
)
from tests.budget import examples


def after(seconds, controls):
    return advance(initial(controls), controls, seconds)


def total(state, controls):
    return float(energies(state.box, controls.gravity)[2])


def assert_sound(state, controls):
    assert np.isfinite(state.box).all() and np.isfinite(state.history).all()
    picture = frame(state, controls)
    header, data = encode(picture)
    assert data and "nan" not in str(header).lower() and "inf" not in str(header["items"])
    assert "nan" not in picture.text


ends = st.fixed_dictionaries(
    {name: st.sampled_from([slider.low, slider.high]) for name, slider in SLIDERS.items()}
    | {
        "integrator": st.sampled_from(sorted(FLIGHT_COEFFICIENT)),
        "resolve_impacts": st.booleans(),
        "start": st.sampled_from([TUMBLING, FLAT]),
    }
)


@examples(60)
@given(ends)
def test_every_combination_of_ends_stays_finite(values):
    controls = Controls(**values)
    assert_sound(after(1.5, controls), controls)


@pytest.mark.parametrize("name", SLIDERS)
@pytest.mark.parametrize("end", ["low", "high"])
def test_each_control_at_each_end_for_ten_seconds(name, end):
    value = getattr(SLIDERS[name], end)
    controls = Controls(**{name: value})
    state = after(10.0, controls)
    assert_sound(state, controls)
    step = SLIDERS[name].step
    with pytest.raises(ValueError, match=name):
        Controls(**{name: value + (step if end == "high" else -step)})


@pytest.mark.parametrize(
    "bad",
    [{"gravity": np.nan}, {"integrator": "euler"}, {"start": (0, 0, 0, 0, 0, 0)},
     {"start": (0, 1, 0)}, {"start": (0, np.nan, 0, 0, 0, 0)}],
)  # fmt: skip
def test_bad_controls_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        Controls(**bad)


def test_defaults_of_the_panel():
    c = Controls()
    assert (c.gravity, c.restitution, c.timestep) == (9.8, 0.70, 2.0)
    assert set(MENU.values()) == set(FLIGHT_COEFFICIENT)
    with pytest.raises(ValueError, match="seconds"):
        advance(initial(c), c, -1.0)


def test_gravity_changes_the_fall():
    # Before the first impact: h = h0 - g t (t + dt) / 2 with semi-implicit Euler.
    for gravity in (1.0, 9.8, 20.0):
        controls = Controls(gravity=gravity)
        fallen = TUMBLING[1] - after(0.3, controls).box[1]
        assert fallen == pytest.approx(gravity * 0.3 * 0.302 / 2, abs=1e-9)
    assert after(3.0, Controls(gravity=0.0)).box[1] == TUMBLING[1]


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.7, 1.0])
def test_restitution_sets_the_bounce_height(restitution):
    controls = Controls(
        restitution=restitution, integrator="velocity_verlet", start=(0.0, 2.2, 0, 0, 0, 0)
    )
    # A flat drop of 2 m: it hits at sqrt(2 h / g) and rises to e^2 h.
    fall = np.sqrt(2 * 2.0 / 9.8)
    state = after(fall * (1.0 + restitution) + 0.002, controls)
    assert state.box[1] - 0.2 == pytest.approx(2.0 * restitution**2, abs=1e-4)


def test_the_box_rotates_and_friction_slows_it():
    assert abs(after(0.5, Controls()).box[2] - TUMBLING[2]) > 0.4
    sliding = (0.0, 0.2, 0.0, 1.0, 0.0, 0.0)
    smooth = after(0.5, Controls(friction=0.0, start=sliding)).box[3]
    rough = after(0.05, Controls(friction=0.3, start=sliding, integrator="rk4")).box[3]
    assert smooth == pytest.approx(1.0)
    assert rough == pytest.approx(1.0 - 0.3 * 9.8 * 0.05, abs=1e-6)


def test_timestep_and_integrator_change_the_flight():
    # Free fall from rest for t: the drop is g t^2/2 + (c - 1/2) g h t.
    for name, c in FLIGHT_COEFFICIENT.items():
        for ms in (2.0, 20.0, 50.0):
            controls = Controls(timestep=ms, integrator=name)
            drop = TUMBLING[1] - after(0.3, controls).box[1]
            expected = 9.8 * (0.3**2 / 2 + (c - 0.5) * 1e-3 * ms * 0.3)
            assert drop == pytest.approx(expected, abs=1e-9)


def test_every_control_changes_the_picture():
    base = Controls()
    picture = encode(frame(initial(base), base))
    for change in (
        {"gravity": 9.9}, {"restitution": 0.71}, {"timestep": 2.5}, {"friction": 0.1},
        {"integrator": "rk4"}, {"resolve_impacts": False}, {"start": FLAT},
    ):  # fmt: skip
        other = replace(base, **change)
        assert encode(frame(initial(other), other)) != picture, change


def test_time_in_pieces_is_the_same_time():
    controls = Controls(timestep=3.5)
    state = initial(controls)
    for _ in range(100):
        state = advance(state, controls, 0.0173)
    whole = after(1.73, controls)
    assert state.steps == whole.steps == 494
    assert state.box == pytest.approx(whole.box, abs=1e-12)
    assert state.owed == pytest.approx(1.73 - 494 * 0.0035, abs=1e-9)


def test_advance_leaves_its_input_alone_and_remembers_ten_seconds():
    controls = Controls()
    state = initial(controls)
    box = state.box.copy()
    later = advance(state, controls, 14.0)
    assert (state.box == box).all() and state.steps == 0
    assert later.history[0, -1] == pytest.approx(14.0)
    assert later.history[0, 0] == pytest.approx(4.0)
    assert later.history[1] + later.history[2] == pytest.approx(later.history[3])


def test_the_path_drawn_is_the_path_taken():
    for controls in (Controls(), PRESETS["Exact flight, late impacts"].controls):
        path = preview(controls)
        for k in (5, path.shape[1] // 2, path.shape[1] - 1):
            state = after(path[0, k], controls)
            assert state.box[:3] == pytest.approx(path[1:4, k], abs=1e-9)
            assert total(state, controls) == pytest.approx(path[4, k], abs=1e-9)
        assert path[0, -1] >= 3.0 - 1e-9


def test_the_reference_keeps_the_energy_of_an_elastic_box():
    for name in ("Explicit Euler gains energy", "Exact flight, late impacts"):
        energy = reference(PRESETS[name].controls)[4]
        assert np.ptp(energy) < 1e-6 * energy[0]


# Each preset shows its failure, and what it blames is the cause: mended, the failure goes.


def change(controls, seconds=10.0):
    state = after(seconds, controls)
    return total(state, controls) / state.energy - 1.0


@pytest.mark.parametrize(
    ("name", "sign"), [("Explicit Euler gains energy", 1), ("Semi-implicit Euler loses energy", -1)]
)
def test_first_order_flight_changes_energy_by_g2_h2_over_2_per_step(name, sign):
    controls = PRESETS[name].controls
    gained = MASS * (9.8 * 0.02) ** 2 / 2 * 500
    state = after(10.0, controls)
    assert total(state, controls) - state.energy == pytest.approx(sign * gained, rel=0.05)
    assert abs(change(replace(controls, integrator="velocity_verlet"))) < 1e-9
    assert state.unresolved == 0
    assert sign * (state.peak - 2.5) >= 0.0


def test_exact_flight_does_not_help_where_impacts_are_late():
    controls = PRESETS["Exact flight, late impacts"].controls
    assert FLIGHT_COEFFICIENT[controls.integrator] == 0.5
    assert change(controls) > 0.2
    assert abs(change(replace(controls, resolve_impacts=True))) < 1e-9


def test_a_big_step_finds_the_box_deep_in_the_ground():
    controls = PRESETS["50 ms steps: deep in the ground"].controls
    deep = after(10.0, controls).deepest
    assert deep > 0.2  # more than half of the box
    assert after(10.0, replace(controls, timestep=2.0)).deepest < 0.02
    assert after(10.0, replace(controls, resolve_impacts=True)).deepest == 0.0
    assert numbers(after(10.0, controls), controls)["deepest in ground"] == f"{1e3 * deep:.1f} mm"


def test_late_impacts_never_come_to_rest():
    controls = PRESETS["Late impacts: never at rest"].controls
    early, late = after(20.0, controls), after(30.0, controls)
    assert late.impacts > early.impacts + 50
    assert early.history[1].max() > 1e-3  # it still moves
    calm = after(20.0, replace(controls, resolve_impacts=True))
    assert calm.history[1].max() == 0.0
    assert calm.impacts < 50


def test_without_rest_speed_impacts_have_no_end():
    controls = PRESETS["No rest speed: endless impacts"].controls
    state = after(10.0, controls)
    assert state.impacts > 10_000 and state.unresolved > 100
    mended = after(10.0, replace(controls, rest_speed=0.01))
    assert mended.impacts < 100 and mended.unresolved == 0


def test_the_default_box_comes_to_rest_with_only_losses():
    state = after(10.0, Controls())
    assert (state.box[3:] == 0.0).all()
    assert np.diff(state.history[3]).max() <= 1e-12


# The picture and the panel


def test_numbers_agree_with_the_state():
    controls = Controls()
    state = after(1.0, controls)
    said = numbers(state, controls)
    kinetic, potential, both = energies(state.box, 9.8)
    assert said["time"] == "1.000 s"
    assert said["kinetic"] == f"{kinetic:.3f} J" and said["potential"] == f"{potential:.3f} J"
    assert said["energy change"].startswith("\N{MINUS SIGN}") and said["total"] == f"{both:.3f} J"
    assert numbers(initial(controls), controls)["energy change"] == "+0.00 %"
    still = Controls(gravity=0.0, start=(0.0, 1.0, 0.0, 0.0, 0.0, 0.0))
    assert numbers(initial(still), still)["energy change"] == "\N{EN DASH}"
    assert_sound(initial(still), still)


def test_the_box_is_always_in_the_picture():
    controls = replace(PRESETS["Explicit Euler gains energy"].controls, timestep=50.0,
                       start=(0.0, 2.5, 0.3, 5.0, 0.0, 1.0))  # fmt: skip
    state = initial(controls)
    for _ in range(40):
        state = advance(state, controls, 0.5)
        (x0, x1), (y0, y1) = (
            scene_axes(state, controls).x_values,
            scene_axes(state, controls).y_values,
        )
        assert x0 < state.box[0] < x1 and y0 < state.box[1] < y1
        axes = scene_axes(state, controls)
        left, right, bottom, top = axes.rectangle
        assert (x1 - x0) / (right - left) == pytest.approx((y1 - y0) / (top - bottom))


def test_dragging_puts_the_box_under_the_pointer_and_above_the_ground():
    controls = Controls()
    state = initial(controls)
    x, y = scene_axes(state, controls).place((1.0, 1.5))
    moved = drag(controls, state, Pointer("move", float(x), float(y)))
    assert moved.start[:2] == pytest.approx((1.0, 1.5))
    below = drag(controls, state, Pointer("move", float(x), -3.0))
    assert below.start[1] > 0.2


@pytest.fixture
def panel():
    made = simulation()
    yield made
    made.close()


def test_a_slider_starts_anew_with_another_picture(panel):
    panel.advance(0.5)
    before = panel.canvas.frame
    panel.inputs["gravity"].value = 5.0
    assert panel.controls == Controls(gravity=5.0)
    assert panel.state.steps == 0
    assert panel.canvas.frame.numbers["potential"] == "12.500 J"
    assert encode(panel.canvas.frame) != encode(before)


def test_inputs_have_the_limits_of_the_model(panel):
    for name, slider in SLIDERS.items():
        widget = panel.inputs[name]
        assert (widget.min, widget.max, widget.step) == (slider.low, slider.high, slider.step)
        assert widget.value == getattr(Controls(), name)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_set_every_input(panel, name):
    panel.choose(name)
    assert panel.controls == PRESETS[name].controls
    for field, widget in panel.inputs.items():
        assert widget.value == getattr(panel.controls, field)
    with pytest.raises(ValueError, match="preset"):
        panel.choose("no such")


def test_what_a_notebook_keeps_of_the_panel(panel):
    assert repr(panel) == repr(simulation())
    assert repr(panel).startswith("Rigid body simulator: bouncing box\n  time: 0.000 s")
    data, _ = panel._repr_mimebundle_()
    assert data["text/plain"] == repr(panel) and data["image/png"]


async def _play(panel: Panel, watched: bool) -> tuple[int, int]:
    if watched:  # a browser that draws every frame at once
        sent = []
        panel.canvas.send = lambda content, buffers=None: sent.append(content)
        panel.canvas._handle_custom_msg({"type": "ready"}, [])
    panel.play()
    other_work = 0
    for _ in range(200):
        await asyncio.sleep(0.005)
        other_work += 1
        if watched:
            panel.canvas._handle_custom_msg({"type": "drawn", "id": sent[-1]["id"]}, [])
        if panel.state.steps > 50:
            break
    steps = panel.state.steps
    panel.pause()
    await asyncio.sleep(0.05)
    assert not panel.playing
    still = panel.state.steps
    await asyncio.sleep(0.1)
    assert panel.state.steps == still
    return steps, other_work


def test_play_lets_time_run_beside_other_work_until_paused(panel):
    steps, other_work = asyncio.run(_play(panel, watched=True))
    assert steps > 50 and other_work > 3


def test_play_waits_while_nobody_looks(panel):
    steps, _ = asyncio.run(_play(panel, watched=False))
    assert steps == 0


def test_closing_ends_the_task():
    async def run():
        made = simulation()
        made.play()
        task = made._task
        assert task is not None
        made.close()
        await asyncio.sleep(0.05)
        return task.done()

    assert asyncio.run(run())


def test_play_without_an_event_loop_says_so(panel):
    with pytest.raises(RuntimeError, match="no running event loop"):
        panel.play()
