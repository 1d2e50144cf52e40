"""The models of the chapters that are there, and a small one that uses what they don't."""

from typing import Any

import numpy as np
import pytest

from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.declaration import model, names
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider, switch

WORDS, COLOURS = draw.words_table(), draw.colours_table()
PLACE, NAMES, METRES = WORDS("place"), WORDS("drift", "jump"), WORDS(" m")
VIOLET = COLOURS("#7700aa")


def initial(controls: Any, state: Any) -> None:
    state["seed"][0] = controls["seed"]


def advance(state: Any, controls: Any, seconds: float) -> None:
    step = np.empty(1)
    if controls["walk"] == 0:
        splitmix.uniform(state["seed"], step)
    else:
        splitmix.normal(state["seed"], step)
    state["x"] += seconds * controls["speed"] * step[0]


def frame(pen: Any, state: Any, controls: Any) -> None:
    draw.area(pen, (1.0, 8.0, 1.0, 4.0), (-5.0, 5.0, 0.0, 1.0))
    draw.axes(pen, PLACE[0], NAMES[0], NAMES[1])
    draw.segment(pen, -4.0, 0.2, 4.0, 0.2, draw.PURPLE, 14.0, 1.0, 30.0, 20.0)
    draw.disc(pen, 0.3, VIOLET[0], draw.INK)
    draw.point(pen, state["x"], 0.5)
    draw.box(pen, -5.0, -4.0, 0.0, 0.1, draw.FAINT)
    if controls["tail"]:
        draw.arrow(pen, state["x"], 0.5, state["x"] + 1.0, 0.6, draw.RED)
    draw.window(pen)
    draw.text(pen, 1.0, 4.5, NAMES[0] + controls["walk"])
    draw.reading(pen, PLACE[0], state["x"], draw.SIGNED + 2, METRES[0])


def drag(controls: Any, state: Any, x: float, y: float) -> None:
    state["x"] = x


WALK = Model(
    "A walk",
    draw.Paper("A walk", WORDS, COLOURS),
    Record(
        speed=slider("Speed", 1.0, 0.0, 2.0, 0.1, "m/s", live=True),
        seed=slider("Seed", 1, 0, 99, 1),
        walk=menu("Walk", ("drift", "jump")),
        tail=switch("with a tail", True, live=True),
    ),
    Record(x=Field(0.0, unit="m"), seed=Field(np.uint64(0), shape=(1,))),
    {"Drift": Preset({}, "It drifts."), "Jump": Preset({"walk": "jump"}, "It jumps.")},
    initial,
    advance,
    frame,
    drag,
    live_drag=True,
)


MODELS: list[Any] = [pytest.param(WALK, id="walk")]
for _name in names():
    _mark = pytest.mark.topic(_name.partition(".")[0])
    MODELS.append(pytest.param(model(_name), id=_name, marks=_mark))
