"""Tunnelling in motion: a ball is looked at once a step, and the wall stands between two looks."""

import numpy as np
from numba.extending import register_jitable

from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider, switch
from course.simulations.rigid_body.turning import whole_steps

RADIUS = 0.05  # of the ball [m]
_FROM, _TO, _SEEN, _PAUSE = -1.0, 0.8, 1.5, 0.7  # m, m, m flown in a second of yours, s
_ROOM = 1200  # samples of a shot

CONTROLS = Record(
    speed=slider("Speed v", 40.0, 2.0, 100.0, 1.0, "m/s", 0),
    timestep=slider("Timestep", 10.0, 1.0, 20.0, 0.5, "ms", 1),
    wall=slider("Wall", 20.0, 5.0, 200.0, 5.0, "mm", 0),
    sweep=switch("sweep: test the way between two steps", False),
    seed=slider("Seed of the shots", 1, 0, 99, 1),
)
STATE = Record(
    seed=Field(np.uint64(0), shape=(1,)),
    centre=Field(0.0, shape=(_ROOM,), unit="m"),  # of the ball, at the steps of this shot
    samples=Field(0),
    hit=Field(0),
    owed=Field(0.0, unit="s"),  # of your time
    pause=Field(0.0, unit="s"),  # left before the next shot
    shots=Field(0),
    missed=Field(0),
    share=Field(0.0),  # missed, of 1000 phases of the step
)


@register_jitable
def detects(before, now, controls):
    """Return whether a step finds the wall, whose front is at 0; of numbers or arrays."""
    # A swept test covers the whole interval from the position before to the one now (continuous
    # collision detection); otherwise only the end of the step counts.
    first = before if controls["sweep"] != 0 else now
    return (now >= -RADIUS) & (first <= 1e-3 * controls["wall"] + RADIUS)


@register_jitable
def shoot(controls, state, path):
    """Put the ball at its start; where the wall falls in a step is drawn anew."""
    phase = np.empty(1)
    splitmix.uniform(state["seed"], phase)
    state["centre"][0] = _FROM - phase[0] * path
    state["samples"], state["hit"], state["pause"] = 1, 0, _PAUSE
    state["shots"] += 1


def initial(controls, state):
    """Set up the first shot and count hits over a thousand phases of the step.

    The state receives the share of phases in which the wall is detected.
    """
    state["seed"][0] = controls["seed"]
    distance = 1e-3 * controls["timestep"] * controls["speed"]
    # The last look before the wall; if the next is beyond it, so are all others.
    x = -RADIUS - distance * (np.arange(1000) + 0.5) / 1000.0
    # Overlaps last for D = ball + wall, so a step of length v h misses 1 - D / (v h) of all phases.
    state["share"] = 1.0 - np.mean(detects(x, x + distance, controls))
    shoot(controls, state, distance)


def advance(state, controls, seconds):
    """Advance the simulation.

    Steps in slow motion: every ball flies past in the same time of yours.
    """
    distance = 1e-3 * controls["timestep"] * controls["speed"]
    x = state["centre"]
    for _ in range(whole_steps(state, seconds, distance / _SEEN)):
        # After a hit or a miss the picture stays for a while, then the next shot starts.
        n = state["samples"]
        if state["hit"] != 0 or x[n - 1] > _TO:
            state["pause"] -= distance / _SEEN
            if state["pause"] < 0.0:
                shoot(controls, state, distance)
            continue
        x[n], state["samples"] = x[n - 1] + distance, n + 1
        # Discrete detection at the end of a step; a ball that passes the wall without overlap has
        # tunnelled.
        state["hit"] = int(detects(x[n - 1], x[n], controls))
        state["missed"] += int(state["hit"] == 0 and x[n] > _TO)
        if state["hit"] != 0 and controls["sweep"] != 0:
            # A swept test knows the time of impact: the ball is put where it touches the wall.
            x[n] = -RADIUS


TITLE = "Tunnelling in motion"
word, colour = draw.words_table(), draw.colours_table()
(_STONE,) = colour("#b9a88c")
_X, _RATIO, _M, _PERCENT = word("x [m]", "v h / D", " m", " %")
_LOOKS, _MISS = word("where the ball is at each step", "share missed")
_CURVE, _HERE = word("theory", "1000 shots, counted")
_SAID = word("on its way", "found", "missed: it went through")[0]
_WAY, _D, _SHOTS, _MISSED = word("v h, per step", "D = ball + wall", "shots", "missed")
_SHARE, _THEORY = word("missed, of 1000", "1 − D / (v h)")
_FLIGHT, _CHART = (0.5, 8.8, 3.1, 4.45), (0.9, 5.2, 0.6, 2.2)


def frame(pen, state, controls):
    """Draw the looks at the ball and the wall; the share that is missed over the way of a step."""
    n, x, wall = state["samples"], state["centre"], 1e-3 * controls["wall"]
    distance, wide = 1e-3 * controls["timestep"] * controls["speed"], 2.0 * RADIUS + wall
    # What the text says and its colour: on its way, found, or missed.
    text = 1 if state["hit"] != 0 else 2 * (x[n - 1] > _TO)
    ink = (draw.BLUE, draw.GREEN, draw.RED)[text]
    draw.chart(pen, _FLIGHT, (-1.15, 1.25, -0.2, 0.2), _X, 0, _LOOKS, 8, 0)
    draw.box(pen, 0.0, wall, -0.2, 0.2, _STONE, draw.INK, 1.0)
    # Where the ball was evaluated, as pale discs: a gap wider than D can pass over the wall.
    draw.curve(pen, x[:n], 0.0 * x[:n], draw.BLUE, 1.2, 0.6)
    draw.spots(pen, x[: n - 1], 0.0 * x[: n - 1], RADIUS, draw.BLUE, draw.BLUE, 1.0, 0.25)
    draw.spot(pen, x[n - 1], 0.0, RADIUS, ink)
    draw.chart(pen, _CHART, (0.0, 10.0, 0.0, 1.0), _RATIO, 0, _MISS, 5, 4)
    ratio = np.linspace(0.0, 10.0, 201)
    # 1 - D / (v h) is negative for steps shorter than D, which never miss.
    draw.theory(pen, ratio, np.maximum(0.0, 1.0 - 1.0 / np.maximum(ratio, 1e-3)))
    draw.spot(pen, min(distance / wide, 10.0), state["share"], 0.16, draw.RED)
    draw.window(pen)
    draw.text(pen, 8.8, 4.62, _SAID + text, ink, 14.0, draw.RIGHT)
    draw.theory_key(pen, 5.6, 1.9, _CURVE)
    draw.spot(pen, 5.75, 1.6, 0.08, draw.RED)
    draw.text(pen, 5.98, 1.6, _HERE, draw.INK, 11.5)
    draw.reading(pen, _WAY, distance, 3, _M)
    draw.reading(pen, _D, wide, 3, _M)
    draw.reading(pen, _SHARE, 100.0 * state["share"], 1, _PERCENT)
    draw.reading(pen, _THEORY, 100.0 * max(0.0, 1.0 - wide / distance), 1, _PERCENT)
    draw.reading(pen, _SHOTS, state["shots"], 0)
    draw.reading(pen, _MISSED, state["missed"], 0)


PRESETS = {
    "A fast ball": Preset(
        {},
        "In one step the ball flies more than three times D: most are before the wall at one "
        "look and beyond it at the next. Which ones is luck.",
    ),
    "Just slow enough": Preset(
        {"speed": 12.0}, "v h = D: some look always falls into the wall. Raise v by a little."
    ),
    "Swept": Preset({"sweep": True}, "The way between two looks is tested: no wall is too thin."),
    "A shorter step": Preset(
        {"timestep": 2.0},
        "Now v h is less than D, and no shot is missed. For a bullet of 10 mm at 1000 m/s and a "
        "foil, the step must be as short as 10 µs.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "v h, per step": "Distance that the ball moves in one step: speed times step size.",
    "D = ball + wall": (
        "Diameter of the ball plus thickness of the wall: positions within this distance overlap."
    ),
    "missed, of 1000": (
        "Fraction of 1000 shots, at equally spaced phases of the step, for which no step ended in "
        "an overlap."
    ),
    "1 − D / (v h)": "The same fraction according to theory.",
    "shots": "Shots fired so far.",
    "missed": "Shots that went through the wall unnoticed.",
}

MODEL = Model(TITLE, PAPER, CONTROLS, STATE, PRESETS, initial, advance, frame, readouts=READOUTS)
