"""What a number of tries costs: days on the robot and on a computer, and what breaks meanwhile.

Nothing moves by itself here: all is arithmetic on the sliders. The cost of a step is the figure
that this course measures (chart `throughput`); the rest is for the reader to set.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider

CONTROLS = Record(
    tries=slider("Tries, 10 to the", 4.0, 1.0, 7.0, 0.25),
    seconds=slider("A try takes", 10.0, 1.0, 60.0, 1.0, "s", 0),
    reset=slider("and its reset", 20.0, 0.0, 120.0, 5.0, "s", 0),
    robots=slider("Robots", 1, 1, 20, 1),
    breaks=slider("Damage in 1000 tries", 2.0, 0.0, 20.0, 0.5, decimals=1),
    step=slider("A step costs", 100.0, 1.0, 1000.0, 1.0, "µs", 0),
    rate=slider("Steps a second", 500.0, 100.0, 2000.0, 100.0, "Hz", 0),
    cores=slider("Cores", 2, 1, 64, 1),
)
STATE = Record(time=Field(0.0, unit="s"), mark=Field((0.0, 0.0)))


@register_jitable
def days(controls):
    """Return what the tries take and break.

    Days on the robots and on the computer, tries a day of both, damages on the robots, and the
    seconds in which one core computes a try.
    """
    # Robots and cores work in parallel; resets take time on the robots only, in simulation they are
    # free.
    real = (controls["seconds"] + controls["reset"]) / controls["robots"]
    alone = controls["seconds"] * controls["rate"] * controls["step"] * 1e-6
    computed = alone / controls["cores"]
    tries = 10.0 ** controls["tries"]
    return (
        tries * real / 86_400.0,
        tries * computed / 86_400.0,
        86_400.0 / real,
        86_400.0 / computed,
        tries * controls["breaks"] / 1000.0,
        alone,
    )


def initial(controls, state):
    """Set up nothing to prepare."""
    state["mark"][:] = 0.0


def advance(state, controls, seconds):
    """Advance the time, with which the ring around the chosen point grows and shrinks."""
    state["time"] += seconds


TITLE = "What a number of tries costs"
word, colour = draw.words_table(), draw.colours_table()
_X, _Y, _HEAD, _ROBOT, _COMPUTED = word(
    "tries, powers of ten",
    "days, powers of ten",
    "time that this number of tries takes",
    "on the robot",
    "in simulation",
)
_REAL, _SIM, _A_DAY, _STEPS, _BROKEN, _ALONE, _DAYS, _WEEK, _SECONDS = word(
    "on the robot",
    "in simulation",
    "tries a day, robot",
    "tries a day, simulated",
    "damages expected",
    "a try on one core",
    " days",
    "a week",
    " s",
)
_AREA, _VIEW = (1.0, 8.3, 0.75, 4.45), (1.0, 7.0, -6.0, 6.0)


def drag(controls, state, x, y):
    """Handle a drag: the number of tries is where the pointer is."""
    result = draw.values_at(_AREA, _VIEW, x, y)
    controls["tries"] = min(max(result[0], 1.0), 7.0)
    state["mark"][0], state["mark"][1] = controls["tries"], min(max(result[1], -6.0), 6.0)


def frame(pen, state, controls):
    """Draw both lines over the number of tries, and the chosen number."""
    real, computed, a_day, here, broken, alone = days(controls)
    draw.area(pen, _AREA, _VIEW)
    draw.axes(pen, _X, _Y, _HEAD, 6, 6)
    # Days are proportional to tries, so on logarithmic axes both lines have slope 1 through the
    # chosen point.
    for k in range(2):
        value = math.log10(max(computed if k else real, 1e-9))
        ends = np.array([1.0, 7.0])
        ink = draw.BLUE if k else draw.ORANGE
        draw.curve(pen, ends, value + ends - controls["tries"], ink, 2.4)
        draw.spot(pen, controls["tries"], value, 0.05 + 0.01 * math.sin(3.0 * state["time"]), ink)
        draw.text(
            pen,
            6.9,
            value + 6.9 - controls["tries"],
            _COMPUTED if k else _ROBOT,
            ink,
            13.0,
            draw.RIGHT,
            draw.TOP,
            0.0,
            -34.0,
        )
    # One week, as a line to compare with.
    draw.segment(pen, 1.0, math.log10(7.0), 7.0, math.log10(7.0), draw.GREY, 1.2, 1.0, 5.0, 4.0)
    draw.text(pen, 1.1, math.log10(7.0), _WEEK, draw.GREY, 12.0, draw.LEFT, draw.BOTTOM)
    draw.spot(pen, state["mark"][0], state["mark"][1], 0.04, draw.NONE, draw.GREY, 1.0)
    draw.window(pen)
    draw.reading(pen, _REAL, real, 2, _DAYS)
    draw.reading(pen, _SIM, computed, 4, _DAYS)
    draw.reading(pen, _A_DAY, a_day, 0)
    draw.reading(pen, _STEPS, here, 0)
    draw.reading(pen, _ALONE, alone, 3, _SECONDS)
    draw.reading(pen, _BROKEN, broken, 1)


PRESETS = {
    "Ten thousand grasps": Preset(
        {},
        "One robot that is reset by hand, and two cores. The cost of a step is a guess for an arm "
        "that touches things. Measure it in your own scene: a single body needs a few "
        "microseconds, and rendered images can take milliseconds.",
    ),
    "A million, with cameras": Preset(
        {"tries": 6.0, "step": 1000.0, "cores": 16},
        "An image is rendered in every step. The computer needs days, the robot about a year.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "on the robot": (
        "Time that the tries take on the real robot, with their resets but without repairs."
    ),
    "in simulation": "Time that the same number of tries takes in the simulation.",
    "tries a day, robot": "Tries that one day on the real robot allows.",
    "tries a day, simulated": "Tries that one day of computing allows.",
    "a try on one core": "Time in which one core computes all steps of a try.",
    "damages expected": "Expected damages of the robot, for the number of tries at the dots.",
}

MODEL = Model(
    TITLE,
    PAPER,
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    drag,
    live_drag=True,
    readouts=READOUTS,
    upright=False,
)
