"""One test for all simulations: whatever is set, played or dragged, there is a sound picture."""

import itertools
import re
import subprocess
import sys
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from course.simulations import painter
from course.simulations import pen as draw
from course.simulations.model import Experiment, recorded
from course.simulations.painter import film, to_png
from tests.budget import PROVE, examples
from tests.simulations.models import MODELS, WALK

pytestmark = pytest.mark.slow


def assert_sound(experiment):
    """Everything is finite, and the picture is a list of items with readable numbers."""
    model = experiment.model
    for record, declared in (
        (experiment.controls, model.controls),
        (experiment.state, model.state),
    ):
        for name in declared.fields:
            assert np.isfinite(record[name]).all(), name
    model.controls.set(
        experiment.controls, **{name: experiment.controls[name] for name in model.controls.fields}
    )
    picture = experiment.picture()
    assert list(draw.decode(picture))
    gaps = [item.points for item in draw.decode(picture) if item.kind == draw.LINE]
    assert np.isnan(picture.data).sum() == sum(np.isnan(points).sum() for points in gaps)
    assert not np.isinf(picture.data).any()
    assert picture.numbers and not re.search(r"\bnan\b", picture.text)
    return picture


# Models of which each start replays: the long tier tries all of their controls.
EXPENSIVE = (
    "A point learns to reach a disc",
    "One policy, two arms",
    "The whole pipeline: see, plan, control, move",
    "Faults that can be combined",
    "A table under a depth camera",
)


def test_the_expensive_models_are_there():
    assert {*EXPENSIVE} <= {getattr(param.values[0], "title", "") for param in MODELS}


@pytest.mark.parametrize("model", MODELS)
def test_every_control_at_both_ends_and_every_preset(model):
    runs = [{}, *(dict(preset.values) for preset in model.presets.values())]
    runs += [{name: end} for name, field in model.controls.panel() for end in field.ends]
    # All controls and presets in the long tier; here every second one, the first settings of some.
    if not PROVE:
        runs = runs[:2] if model.title in EXPENSIVE else runs[::2]
    for k, values in enumerate(runs):
        experiment = Experiment(model, **values)
        # A second run of the same is compared once; in the long tier always where that is cheap.
        twice = k == 0 or (PROVE and model.title not in EXPENSIVE)
        again = Experiment(model, **values) if twice else experiment
        first = assert_sound(experiment)
        # Each end is shown and moves; every second one goes on, and in the long tier each.
        for seconds in (0.0, 0.04, 1.5) if PROVE or k % 2 == 0 else (0.0, 0.04):
            experiment.advance(seconds)
            if again is not experiment:
                again.advance(seconds)
            assert_sound(experiment)
        assert experiment.picture().data.tobytes() == again.picture().data.tobytes(), values
        experiment.start()
        assert experiment.picture().data.tobytes() == first.data.tobytes(), values
    for name, field in model.controls.panel():
        if not field.choices and not field.switch:
            for wrong in (field.low - field.step, field.high + field.step, np.nan, "x", None):
                with pytest.raises(ValueError, match=name):
                    model.controls.new(**{name: wrong})


@pytest.mark.prove
@pytest.mark.parametrize("model", MODELS)
def test_a_preset_is_encoded_for_both_painters(model):
    for name, preset in model.presets.items():
        experiment = Experiment(model)
        experiment.choose(name)
        experiment.advance(0.7)
        assert preset.note
        assert to_png(experiment.picture(), 0.3).startswith(b"\x89PNG")
        tables = model.paper.words.entries, model.paper.colours.entries
        assert all(isinstance(entry, str) for table in tables for entry in table)
    with pytest.raises(ValueError, match="preset"):
        experiment.choose("no such")


@pytest.mark.parametrize("model", MODELS)
def test_a_drag_to_anywhere_leaves_a_sound_picture(model):
    xmin, xmax, ymin, ymax = model.paper.window
    places = [
        (x, y)
        for x in (xmin - 100.0, xmin, 0.5 * (xmin + xmax), xmax)
        for y in (ymin, 0.5 * (ymin + ymax), ymax, ymax + 100.0)
    ]
    # One in each row and column; all of them in the long tier.
    for x, y in places if PROVE else places[::5]:
        experiment = Experiment(model)
        experiment.advance(0.3)
        before = experiment.picture().data.tobytes()
        experiment.grab(xmin + 0.3 * (xmax - xmin), ymin + 0.3 * (ymax - ymin))
        experiment.drag(x, y)
        same = assert_sound(experiment).data.tobytes() == before
        assert same == (model.drag is None)
        experiment.advance(0.1)
        assert_sound(experiment)


@pytest.mark.prove
@pytest.mark.parametrize("model", MODELS)
def test_any_mixture_of_ends_stays_finite(model):
    ends = {name: st.sampled_from(field.ends) for name, field in model.controls.panel()}

    @examples(1 if model.title in EXPENSIVE else 8)
    @given(st.fixed_dictionaries(ends))
    def mixture(values):
        experiment = Experiment(model, **values)
        experiment.advance(1.5)
        assert_sound(experiment)

    mixture()


def test_what_is_live_acts_on_the_running_state():
    experiment = Experiment(WALK)
    experiment.advance(1.0)
    moved = float(experiment.state["x"])
    assert moved != 0.0
    experiment.set(speed=2.0, tail=False)
    assert experiment.state["x"] == moved and experiment.controls["speed"] == 2.0
    experiment.drag(3.0, 0.0)
    assert experiment.state["x"] == 3.0
    experiment.set(seed=5)
    assert experiment.state["x"] == 0.0
    with pytest.raises(ValueError, match="seconds"):
        experiment.advance(-1.0)


def test_another_seed_gives_other_frames():
    one, other = Experiment(WALK, seed=1), Experiment(WALK, seed=2)
    one.advance(1.0)
    other.advance(1.0)
    assert one.picture().data.tobytes() != other.picture().data.tobytes()


def test_recorded_pictures_are_shown_in_turn_and_the_last_one_stays():
    live, pictures = Experiment(WALK), []
    for _ in range(3):
        pictures.append(live.picture().data)
        live.advance(0.1)
    model = recorded("Recorded walk", WALK.paper, {"A walk": ("It drifts.", pictures)}, 0.1)
    shown = Experiment(model)
    for k in (0, 1, 2, 2):
        assert shown.picture().data.tobytes() == pictures[k].tobytes()
        shown.advance(0.1001)
    assert model.recorded and not WALK.recorded


@pytest.mark.prove
def test_a_film_shows_each_picture_as_it_is_drawn():
    made = film(WALK, 0.5, 10.0)
    assert made == film(WALK, 0.5, 10.0)
    shown: Any = Image.open(BytesIO(made))
    experiment = Experiment(WALK)
    experiment.choose(next(iter(WALK.presets)))
    assert (shown.n_frames, shown.info["duration"], shown.info["loop"]) == (5, 100, 0)
    for k in range(5):
        shown.seek(k)
        still = Image.open(BytesIO(to_png(experiment.picture(), 1.0)))
        frame, picture = (np.asarray(i.convert("RGB"), float) for i in (shown, still))
        away = np.abs(frame - picture).max(axis=-1)  # 63 colours for all shades of the letters
        assert (away > 40.0).mean() < 1e-3 and away.mean() < 1.0, k
        experiment.advance(0.1)
    with pytest.raises(ValueError, match="seconds"):
        film(WALK, 0.0)


@pytest.mark.prove
def test_models_need_no_widget_and_no_plot():
    code = (
        "import sys, course.simulations.rigid_body as r; from course.simulations.model import *;"
        "Experiment(r.MODEL).picture();"
        "print({'anywidget', 'ipywidgets', 'matplotlib'} & set(sys.modules))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.strip() == "set()", result.stderr


@pytest.mark.prove
@pytest.mark.parametrize("model", MODELS)
def test_no_word_is_cut(model: Any) -> None:
    """Words in the picture stay in it; below, names stay in their columns and values apart."""
    for preset in model.presets.values():
        experiment = Experiment(model, **preset.values)
        experiment.advance(0.5)
        page = painter._page(experiment.picture(), 1.0)
        page.draw()
        wide, high = page.get_width_height()
        for written in page.figure.axes[0].texts:
            box = written.get_window_extent()
            inside = box.x0 > -1.0 and box.x1 < wide + 1.0 and box.y1 < high + 1.0
            assert inside or not written.get_text(), written.get_text()
        below = [(t.get_text(), t.get_window_extent()) for t in page.figure.texts if t.get_text()]
        for words, box in below:
            assert words not in experiment.picture().numbers or box.width < painter._CELL[0] - 4.0
            assert box.x1 < wide - 4.0, words
        # A value may be wider than its column, where nothing stands beside it.
        for (words, box), (others, beside) in itertools.combinations(below, 2):
            assert not box.padded(1.0).overlaps(beside), (words, others)
