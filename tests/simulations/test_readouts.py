"""What a reader is told about the numbers below a picture, and of recordings."""

import base64
import gzip
import json
import re
from typing import Any

import numpy as np
import pytest

from course.simulations import declaration
from course.simulations import pen as draw
from course.simulations.model import Experiment, Model
from tests.budget import sampled
from tests.simulations.models import WALK


def first_pictures(name: str) -> list[draw.Picture]:
    """The first picture of each preset of a recorded simulation, from its recording."""
    films = json.loads(declaration.recording(name).read_text("utf-8"))["films"]
    pictures = []
    for film in films.values():
        size = film["sizes"][0]
        data = gzip.decompress(base64.b64decode(film["data"]))
        planes = np.frombuffer(data, np.uint8, 4 * size).reshape(4, size)
        steps = np.ascontiguousarray(planes.T).view(np.int32)[:, 0]
        exact = steps == 1 - 2**31
        numbers = np.where(steps == -(2**31), np.nan, steps / declaration.GRID)
        numbers[exact] = np.frombuffer(data, float, exact.sum(), 4 * size)
        pictures.append(draw.Picture(declaration.model(name).paper, numbers))
    return pictures


def shown(model: Model) -> set[str]:
    """The names of all numbers that a model shows: each preset, each choice and each switch."""
    chosen = [(name, f) for name, f in model.controls.panel() if f.choices or f.switch]
    settings = [{name: end} for name, field in chosen for end in field.ends]
    names: set[str] = set()
    for values in [dict(preset.values) for preset in model.presets.values()] + settings:
        names |= set(Experiment(model, **values).picture().numbers)
    return names


def unexplained(names: set[str], model: Model) -> list[str]:
    """Those without a sentence that says what they mean."""
    return sorted(name for name in names if not model.readouts.get(name, "").endswith("."))


@pytest.mark.slow
@pytest.mark.parametrize("name", sampled(declaration.names(), 2))
def test_every_readout_has_a_tooltip(name: str) -> None:
    model = declaration.model(name)
    if declaration.is_live(name):
        names = shown(model)
    else:
        names = {each for picture in first_pictures(name) for each in picture.numbers}
    assert names
    assert unexplained(names, model) == [], f"add them to READOUTS of {name}"
    assert set(model.readouts) <= {*model.paper.words.entries}, "no such readout"
    assert declaration.declaration(name)["paper"]["readouts"] == model.readouts


def test_a_readout_without_a_tooltip_is_found() -> None:
    assert unexplained(shown(WALK), WALK) == ["place"]


# What only a reader with a running simulation can do.
HANDS_ON = re.compile(r"\b(drag|click|pull|slider|turn (it|the)|pick part|try )", re.I)


@pytest.mark.parametrize("name", list(declaration.RECORDED))
def test_a_recording_never_asks_for_a_hand(name: str) -> None:
    """Notes, names of presets, titles and all words in the pictures."""
    declared = declaration.declaration(name)
    texts = [declared["title"], declared["paper"]["label"], *declared["paper"]["words"]]
    texts += declared["paper"]["readouts"].values()
    for preset in declared["presets"]:
        texts += [preset["name"], preset["note"]]
    assert [text for text in texts if HANDS_ON.search(text)] == []


def test_a_recorded_note_takes_the_place_of_the_live_one(monkeypatch: Any) -> None:
    name = "pipeline"
    model = declaration.model(name)
    notes = {preset["name"]: preset["note"] for preset in declaration.declaration(name)["presets"]}
    for key, preset in model.presets.items():
        assert notes[key] == (preset.recorded or preset.note)
    assert any(preset.recorded for preset in model.presets.values())
    live = declaration.declaration("contact.touch")["presets"]
    assert [each["note"] for each in live] == [
        preset.note for preset in declaration.model("contact.touch").presets.values()
    ]


# A click chooses the nearest of several things: both coordinates count, and nothing is dragged.
CHOSEN_BY_A_CLICK = {"role.stack", "middleware", "interview"}


@pytest.mark.parametrize(
    "name", [n for n in declaration.names() if declaration.model(n).drag is not None]
)
def test_whoever_lets_a_finger_scroll_drags_nothing_up_or_down(name: str) -> None:
    model = declaration.model(name)
    if model.upright or name in CHOSEN_BY_A_CLICK:
        return
    assert model.drag is not None
    xmin, xmax, ymin, ymax = model.paper.window
    run = Experiment(model)
    for x in np.linspace(xmin, xmax, 9):
        controls = []
        for y in np.linspace(ymin, ymax, 5):
            made, state = run.controls.copy(), run.state.copy()
            model.drag(made, state, x, y)
            controls.append(made.tobytes())
        assert len(set(controls)) == 1, x
