"""The panel: inputs that follow the model, time that runs while somebody looks."""

import asyncio
import base64
import html
from dataclasses import replace

import numpy as np
import pytest

from course.simulations import simulation
from course.simulations.model import Experiment, recorded
from course.simulations.panel import Panel
from course.simulations.record import Field, Record
from course.simulations.rigid_body import MODEL as BOX
from tests.budget import PROVE
from tests.simulations.models import MODELS, WALK


@pytest.fixture
def panel():
    made = Panel(WALK)
    yield made
    made.close()


def test_an_input_starts_anew_unless_it_is_live(panel):
    panel.advance(0.5)
    before, x = panel.canvas.frame, float(panel.state["x"])
    panel.inputs["tail"].value = False
    assert panel.state["x"] == x != 0.0
    assert panel.canvas.frame.data.size < before.data.size
    panel.inputs["seed"].value = 7
    assert panel.controls["seed"] == 7 and panel.state["x"] == 0.0
    assert panel.canvas.frame.numbers == {"place": "+0.00 m"}
    panel.advance(0.5)
    panel.reset()
    assert panel.state["x"] == 0.0 and panel.controls["seed"] == 7


def test_a_pointer_drags_and_keys_play_and_reset(panel):
    panel.canvas._handle_custom_msg({"type": "move", "x": 2.0, "y": 1.0}, [])
    assert panel.state["x"] == 2.0 and panel.canvas.frame.numbers == {"place": "+2.00 m"}
    panel.canvas._handle_custom_msg({"type": "key", "key": "r"}, [])
    assert panel.state["x"] == 0.0


@pytest.mark.prove
@pytest.mark.parametrize("model", MODELS)
def test_inputs_have_the_limits_of_the_model_and_follow_it(model):
    panel = Panel(model)
    for name, field in model.controls.panel():
        widget = panel.inputs[name]
        if not field.choices and not field.switch:
            assert (widget.min, widget.max, widget.step) == (field.low, field.high, field.step)
    presets = list(model.presets)
    for name in [*(presets if PROVE else presets[:2]), presets[0]]:
        panel.choose(name)
        expected = model.controls.new(**model.presets[name].values)
        assert panel.controls.tobytes() == expected.tobytes()
        assert html.escape(model.presets[name].note) in panel._note.value
        for field, widget in panel.inputs.items():
            assert widget.value == expected[field]
    with pytest.raises(ValueError, match="preset"):
        panel.choose("no such")
    assert repr(panel) == repr(Panel(model)) == panel.canvas.frame.text
    data, _ = panel._repr_mimebundle_()
    assert data["text/plain"] == repr(panel) and data["image/png"]
    panel.close()


def test_the_saved_picture_is_of_the_moment_that_the_page_names():
    from course.simulations.painter import to_png

    made = simulation("bouncing_box", still=0.2)
    experiment = Experiment(BOX)
    experiment.choose(next(iter(BOX.presets)))
    experiment.advance(0.2)
    saved = base64.b64decode(made._repr_mimebundle_()[0]["image/png"])
    assert saved == to_png(experiment.picture())
    assert saved != to_png(experiment.later(3.0))
    made.close()
    with pytest.raises(ValueError, match="still"):
        simulation("bouncing_box", still=-1.0)


def test_a_recorded_model_says_so(panel):
    model = recorded("R", WALK.paper, {"A walk": ("It drifts.", [panel.canvas.frame.data])}, 0.1)
    made = Panel(model)
    assert "Recorded" in made._note.value and "Recorded" not in panel._note.value
    made.close()


def test_it_goes_on_in_the_page_and_comes_back():
    panel, sent = Panel(BOX), []
    panel.canvas.send = lambda content, buffers=None: sent.append((content, buffers))
    panel.set(gravity=3.0)
    panel.advance(0.4)
    panel.canvas._handle_custom_msg({"type": "runs", "where": "page"}, [])
    report, records = sent[-1]
    assert report == {"type": "records", "preset": "Default drop"}
    assert records == [panel.controls.tobytes(), panel.state.tobytes()]
    # The page goes on, with another preset.
    page = Experiment(BOX)
    page.take(*records)
    page.choose("No rest speed: endless impacts")
    page.advance(0.7)
    back = [page.controls.tobytes(), memoryview(page.state.tobytes())]
    content = {"type": "runs", "where": "kernel", "preset": "No rest speed: endless impacts"}
    panel.canvas._handle_custom_msg(content, back)
    assert panel.state.tobytes() == page.state.tobytes()
    assert panel.canvas.frame.numbers == page.picture().numbers
    assert panel.inputs["rest_speed"].value == 0.0
    assert panel._preset.value == content["preset"] and "endless" not in panel._note.value
    # What makes no sense changes nothing.
    steep = page.model.controls.new()
    steep["gravity"] = np.nan
    for wrong in ([b"", b""], [back[0]], [], [steep.tobytes(), back[1]]):
        other = content | {"preset": "no such"}
        panel.canvas._handle_custom_msg(other, wrong)
        assert panel.state.tobytes() == page.state.tobytes()
        assert panel._preset.value == content["preset"]
    panel.close()


async def _play(panel: Panel, watched: bool) -> tuple[float, int]:
    if watched:  # a browser that draws every frame at once
        sent = []
        panel.canvas.send = lambda content, buffers=None: sent.append(content)
        panel.canvas._handle_custom_msg({"type": "ready"}, [])
    panel.play()
    other_work = 0
    for _ in range(12_000 if watched else 200):
        await asyncio.sleep(0.005)
        other_work += 1
        if watched:
            panel.canvas._handle_custom_msg({"type": "drawn", "id": sent[-1]["id"]}, [])
        if panel.state["x"] > 0.1 and other_work > 3:
            break
    missing = float(panel.state["x"])
    panel.pause()
    await asyncio.sleep(0.05)
    assert not panel.playing
    still = float(panel.state["x"])
    await asyncio.sleep(0.1)
    assert panel.state["x"] == still
    return missing, other_work


def test_play_lets_time_run_beside_other_work_until_paused(panel):
    missing, other_work = asyncio.run(_play(panel, watched=True))
    assert missing > 0.1 and other_work > 3


@pytest.mark.slow
def test_play_waits_while_nobody_looks(panel):
    missing, _ = asyncio.run(_play(panel, watched=False))
    assert missing == 0.0


def test_closing_ends_the_task():
    async def run():
        made = Panel(WALK)
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


def in_portions():
    """A model whose place takes three portions, and the places that were reached in the others."""
    portions = []

    def initial(controls, state):
        state["x"], state["remaining"] = 1.0, 2

    def complete(controls, state):
        state["x"] += 1.0
        state["remaining"] -= 1
        portions.append(float(state["x"]))

    def drag(controls, state, x, y):
        initial(controls, state)

    def press(controls, state, key):
        initial(controls, state)

    def advance(state, controls, seconds):
        if state["remaining"] == 0:
            initial(controls, state)

    state = Record(**WALK.state.fields, remaining=Field(0))
    made = replace(WALK, state=state, initial=initial, complete=complete, drag=drag)
    return replace(made, advance=advance, press=press), portions


def test_a_program_waits_until_all_portions_are_done():
    model, portions = in_portions()
    experiment = Experiment(model)
    calls = [
        experiment.start,
        lambda: experiment.set(seed=3),
        lambda: experiment.choose("Jump"),
        lambda: experiment.advance(0.1),
        lambda: experiment.drag(1.0, 1.0),
        lambda: experiment.press("+"),
    ]
    for k, call in enumerate(calls):
        call()
        assert experiment.state["x"] == 3.0 and len(portions) == 2 * (k + 2)
        assert experiment.remaining == 0 and not experiment.complete()
    assert len(portions) == 2 * (len(calls) + 1)
    experiment.in_portions = True
    experiment.start()
    assert experiment.state["x"] == 1.0 and experiment.remaining == 2
    unfinished = experiment.controls.tobytes(), experiment.state.tobytes()
    experiment.in_portions = False
    experiment.take(*unfinished)  # a page that had two portions left
    assert experiment.state["x"] == 3.0 and experiment.remaining == 0


def test_portions_need_a_place_in_the_state():
    with pytest.raises(ValueError, match="remaining"):
        replace(WALK, complete=lambda controls, state: None)


def test_a_slider_shows_the_first_portion_and_the_others_follow_between_messages():
    model, portions = in_portions()
    made = Panel(model)
    assert made.state["x"] == 3.0  # a cell waits until all is there
    portions.clear()

    async def run():
        made.inputs["seed"].value = 7
        assert made.state["x"] == 1.0 and made.canvas.frame.numbers == {"place": "+1.00 m"}
        while made.state["x"] < 3.0:
            await asyncio.sleep(0.002)
        await asyncio.sleep(0.02)
        assert made._completing is None and made.canvas.frame.numbers == {"place": "+3.00 m"}
        # Two changes in a row share what completes the second.
        made._preset.value = "Jump"
        made.inputs["seed"].value = 8
        assert made.state["x"] == 1.0
        while made._completing is not None:
            await asyncio.sleep(0.002)
        assert portions == [2.0, 3.0, 2.0, 3.0]
        # So do a pointer and a key, and time that runs.
        for message in ({"type": "move", "x": 2.0, "y": 1.0}, {"type": "key", "key": "+"}):
            made.canvas._handle_custom_msg(message, [])
            assert made.state["x"] == 1.0
            while made._completing is not None:
                await asyncio.sleep(0.002)
            assert made.state["x"] == 3.0

    asyncio.run(run())
    made.inputs["seed"].value = 9  # without an event loop nobody could complete it
    assert made.state["x"] == 3.0
    made.close()
