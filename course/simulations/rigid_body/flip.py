"""The flip about the middle axis: a spin that no disturbance leaves alone."""

import math

import numpy as np
from numba.extending import register_jitable

from course.rigid_body.quaternion import rotate
from course.simulations import pen as draw
from course.simulations import space
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider
from course.simulations.rigid_body import turning

SIDES = np.array([1.6, 1.0, 0.35])  # of a box of 12 kg [m]
MOMENTS = I1, I2, I3 = np.sum(SIDES**2) - SIDES**2  # rising [kg m^2]
_MODE = np.array([math.sqrt((I3 - I2) * I3), 0.0, -math.sqrt((I2 - I1) * I1)])  # what only grows
_SHARE_OF_MODE = float(0.5 * np.linalg.norm(_MODE) / _MODE[0])  # in a push about axis 1
AXES = ("1, smallest moment", "2, middle moment", "3, largest moment")

CONTROLS = Record(
    axis=menu("Spin about axis", AXES, 1),
    spin=slider("Spin", 6.0, 2.0, 10.0, 0.1, "rad/s", 1),
    push=slider("log10 of push", -2.0, -6.0, -0.5, 0.1, "", 1),  # aside, over the spin
    **space.camera(0.6, 0.25),
)
STATE = Record(
    growth=Field(0.0, unit="1/s"),  # of the part that only grows, while it is small
    flips=Field(0),
    flipped=Field(0.0, unit="s"),  # when it turned over last
    between=Field(0.0, unit="s"),  # the last two flips, if there were two
    **turning.TURNING,
)


@register_jitable
def rate_in_theory(spin):
    """Return the rate at which a disturbance of a middle-axis spin grows, in theory [1/s]."""
    return spin * math.sqrt((I2 - I1) * (I3 - I2) / (I1 * I3))


def initial(controls, state):
    """Set up spinning about an axis, with a push about another one."""
    omega = np.zeros(3)
    omega[2 if controls["axis"] == 0 else 0] = 10.0 ** controls["push"]
    omega[controls["axis"]] = 1.0
    turning.start(state, MOMENTS, controls["spin"] * omega)


def advance(state, controls, seconds):
    """Turn on, sample by sample, and watch the disturbance and the flips."""
    axis, small = controls["axis"], controls["spin"] * 10.0 ** controls["push"] / _MODE[0]
    while seconds > 0.0:
        before = state["omega"][axis]
        turning.turn(state, MOMENTS, min(turning.STEP * turning.SAMPLE, seconds))
        seconds -= turning.STEP * turning.SAMPLE
        omega, time = state["omega"], turning.STEP * state["steps"]
        # The growth of the unstable mode is measured only while it is small: Euler's equations are
        # linear about the middle axis until ω1 reaches a tenth of the spin.
        if time > 0.0 and abs(omega[0]) < 0.1 * abs(omega[1]) and state["flips"] == 0:
            # The decaying mode has the same components with one sign changed, so this sum cancels
            # it; clipping keeps the logarithm finite.
            part = omega[0] / _MODE[0] + omega[2] / _MODE[2]
            state["growth"] = math.log(max(part, 1e-300) / small) / time
        # The spin about the chosen axis, in the body frame, changes its sign: the body has turned
        # over (intermediate axis theorem, the Dzhanibekov effect).
        if before * omega[axis] < 0.0:
            state["between"], state["flipped"] = time - state["flipped"], time
            state["flips"] += 1


TITLE = "The flip about the middle axis"
word, colour = draw.Table(*turning.word.entries), draw.Table(*turning.colour.entries)  # its own
_L, _OMEGA, _NONE, _S, _PER_S = word("L", "ω", "\N{EM DASH}", " s", " /s")
_ASIDE, _T, _SHARE = word("rate about the other two axes", "time [s]", "log10(rate / spin)")
_TIME, _GROWTH, _IN_THEORY = word("time", "growth, measured", "growth, in theory")
_FLIPS, _BETWEEN, _MEASURED, _LAW = word("flips", "between two flips", "measured", "in theory")
_NAMES = word("1", "2", "3")[0]
_SCENE, _STRIP, _LOG = (0.1, 5.3, 0.1, 4.6), (6.35, 8.8, 3.25, 4.5), (6.35, 8.8, 0.95, 2.05)


def frame(pen, state, controls):
    """Draw the body, its rates, its disturbance; numbers."""
    q, spin, zero = state["q"], controls["spin"], np.zeros(3)
    past, unit = turning.recent(state), 0.9 / spin  # ω ends below the tip of L
    eye = space.camera_view(pen, _SCENE, controls, 1.5)
    half, axis = 0.5 * SIDES[controls["axis"]], rotate(q, np.eye(3)[controls["axis"]])
    turning.body(pen, eye, q, SIDES)
    # The path of the tip of ω in the world: Poinsot's herpolhode, in the plane across L.
    space.trail(pen, eye, unit * past[4:7], draw.RED, 1.2, 0.5)
    now, name = unit * rotate(q, state["omega"]), _NAMES + controls["axis"]
    space.arrow(pen, eye, half * axis, (half + 0.35) * axis, draw.GREY, 2.0, 9.0, name)
    space.arrow(pen, eye, zero, np.array([0.0, 0.0, 1.4]), draw.INK, 3.0, 12.0, _L)
    space.arrow(pen, eye, zero, now, draw.RED, 4.0, 12.0)
    x, y, _ = space.project(eye, 0.75 * now)
    draw.text(pen, x, y, _OMEGA, draw.RED, 13.0, draw.LEFT, draw.MIDDLE, 9.0, 0.0, 0.0, 1.0)
    turning.rates(pen, state, _STRIP, 1.2 * spin)
    # The disturbance is what the squared rate has besides the chosen axis, drawn on a logarithmic
    # scale, where exponential growth is a straight line.
    others = np.sum(past[1:4] ** 2, axis=0) - past[1 + controls["axis"]] ** 2
    start, push, middle = past[0, 0], controls["push"], controls["axis"] == 1
    draw.chart(pen, _LOG, (start, start + 6.0, push - 0.5, 0.3), _T, _SHARE, _ASIDE, 4, 3)
    if middle:
        # Only a share of the push lies in the growing mode, so the line in theory starts below the
        # push.
        low, slope = push + math.log10(_SHARE_OF_MODE), rate_in_theory(spin) / math.log(10.0)
        draw.theory(pen, np.array([0.0, 20.0]), np.array([low, low + 20.0 * slope]))
    # A sample without disturbance would be log10(0); the floor of 1e-30 lies far below the chart.
    draw.curve(pen, past[0], np.log10(np.sqrt(np.maximum(others, 1e-30)) / spin), draw.RED, 2.2)
    draw.window(pen)
    draw.key(pen, 6.4, 0.3, _MEASURED, draw.RED, 2.2)
    draw.theory_key(pen, 7.7, 0.3, _LAW)
    draw.reading(pen, _TIME, turning.STEP * state["steps"], 2, _S)
    draw.reading(pen, _GROWTH, state["growth"], 3, _PER_S, 0 if middle else _NONE)
    draw.reading(pen, _IN_THEORY, rate_in_theory(spin), 3, _PER_S, 0 if middle else _NONE)
    draw.reading(pen, _FLIPS, state["flips"], 0)
    draw.reading(pen, _BETWEEN, state["between"], 2, _S, 0 if state["flips"] > 1 else _NONE)


PRESETS = {
    "Middle axis: it flips": Preset(
        {}, "A push of a hundredth grows until the body turns over, again and again. L stays."
    ),
    "Largest moment: steady": Preset(
        {"axis": 2}, "The same push about the axis of the largest moment circles, never grows."
    ),
    "Smallest moment: steady": Preset(
        {"axis": 0}, "The axis of the smallest moment is as safe, while nothing takes energy."
    ),
    "A millionth: later, not never": Preset(
        {"push": -6.0}, "A push ten times smaller delays the flip by ln 10 over the growth."
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "time": "Simulated time since the start.",
    "growth, measured": (
        "Rate at which a small wobble grows, fitted to the motion: it grows by a factor e in one "
        "over this time."
    ),
    "growth, in theory": (
        "The same rate according to Euler's equations, linearised about the middle axis."
    ),
    "flips": "How often the body has turned over.",
    "between two flips": "Time between the last two flips.",
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
    **space.ORBIT,
    readouts=READOUTS,
)
