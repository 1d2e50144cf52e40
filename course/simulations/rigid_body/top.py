"""A heavy top, and what holds it up: gravity's torque turns its angular momentum sideways."""

import math

import numpy as np
from numba.extending import register_jitable

from course.rigid_body.integrators import rk4
from course.rigid_body.problems import nutation_limits, top_acceleration, top_energy
from course.rigid_body.quaternion import cross, exp, rotate
from course.simulations import pen as draw
from course.simulations import space
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider
from course.simulations.rigid_body.turning import whole_steps

I1, WEIGHT = 0.02, 1.0  # about the tip [kg m^2]; m g l [N m]
RATIOS = np.array([0.2, 1.0, 1.6])  # I3 / I1
STEP, _SAMPLE, _PAST = 0.002, 5, 400  # s, steps, samples

CONTROLS = Record(
    moments=menu("Moments", ("slim: I3 = I1 / 5", "equal: I3 = I1", "flat: I3 = 1.6 I1")),
    spin=slider("Spin", 80.0, 0.0, 120.0, 1.0, "rad/s", 0),
    tilt=slider("Tilt at release", 30.0, 1.0, 90.0, 1.0, "°", 0),
    **space.camera(0.5, 0.3),
)
STATE = Record(
    q=Field(0.0, shape=(4,)),
    omega=Field(0.0, shape=(3,), unit="rad/s"),  # in the body frame
    steps=Field(0),
    owed=Field(0.0, unit="s"),
    turned=Field(0.0, unit="rad"),  # about the vertical
    past=Field(0.0, shape=(4, 2 * _PAST)),  # time and the axis of the samples
    samples=Field(0),
)


@register_jitable
def critical(i3):
    """The spin above which the upright top stands (Goldstein, sec. 5.7) [rad/s]."""
    return 2.0 * math.sqrt(I1 * WEIGHT) / i3


def initial(controls, state):
    """Released with the axis at rest."""
    state["q"][:] = exp(np.array([math.radians(controls["tilt"]), 0.0, 0.0]))
    state["omega"][2] = controls["spin"]
    state["past"][1:, 0] = rotate(state["q"], np.array([0.0, 0.0, 1.0]))
    state["samples"] = 1


def advance(state, controls, seconds):
    """Turn on."""
    params = np.array([I1, I1, RATIOS[controls["moments"]] * I1, WEIGHT])
    past, up = state["past"], np.array([0.0, 0.0, 1.0])
    for _ in range(whole_steps(state, seconds, STEP)):
        q, omega = rk4(state["q"], state["omega"], top_acceleration, STEP, params)
        state["q"][:] = q
        state["omega"][:] = omega
        state["steps"] += 1
        if state["steps"] % _SAMPLE == 0:
            state["samples"] = n = draw.remember(past, state["samples"], STEP * state["steps"])
            past[1:, n - 1] = x, y, _ = rotate(q, up)
            a, b = past[1, n - 2], past[2, n - 2]
            state["turned"] += math.atan2(a * y - b * x, a * x + b * y)


TITLE = "A top, and what holds it up"
word, colour = draw.words_table(), draw.colours_table()
_PALE, _DARK, _POST = space.shades(colour, "#e3c9a0", "#b9803f", "#b8bec4")
_CORNERS, _INDEX = space.lathe(
    [(0.02, 0.0), (0.05, 0.1), (0.05, 0.5), (0.5, 0.6), (0.5, 0.75), (0.05, 0.85), (0.05, 1.0)], 16
)
_FILLS = np.where(np.arange(len(_INDEX)) % 4 < 2, _PALE, _DARK)
_FOOT, _FEET = space.lathe([(0.3, -1.1), (0.04, -1.0), (0.03, 0.0)], 12)
_L, _TORQUE, _FALLS, _TILTS, _T, _DEGREES, _LIMIT, _SPIN, _CRITICAL = word(
    "L", "torque of the weight: where L goes", "weight", "tilt", "time [s]", "[°]",
    "limits in theory", "spin [rad/s]", "stands upright above ",
)  # fmt: skip
_TIME, _PRECESSION, _STEADY, _TERM, _ENERGY, _S, _NM, _J, _RATE = word(
    "time", "turns at", "fast-top theory", "ω × I ω", "energy", " s", " N m", " J", " rad/s"
)
_SCENE, _STRIP, _BAR = (0.1, 5.6, 0.1, 4.6), (6.35, 8.8, 2.55, 4.5), (6.35, 8.8, 0.8, 1.1)


def frame(pen, state, controls):
    """The top on its post, its vectors and the path of its axis; tilt, spin and numbers."""
    q, omega, past = state["q"], state["omega"], state["past"]
    i3, spin, n = RATIOS[controls["moments"]] * I1, controls["spin"], state["samples"]
    past, zero, axis = past[:, max(0, n - _PAST) : n], np.zeros(3), rotate(q, np.array([0.0, 0, 1]))
    momentum = rotate(q, np.array([I1, I1, i3]) * omega)
    torque = WEIGHT * cross(axis, np.array([0.0, 0.0, -1.0]))
    eye = space.look(pen, _SCENE, controls, 1.5)
    space.faces(pen, eye, _FOOT, _FEET, np.full(len(_FEET), _POST))
    space.trail(pen, eye, 1.02 * past[1:], draw.BLUE, 1.6, 0.35, 0.0, 0.0, -1.0)
    space.faces(pen, eye, rotate(q, _CORNERS), _INDEX, _FILLS)
    space.trail(pen, eye, 1.02 * past[1:], draw.BLUE, 1.8, 0.9, 0.0, 0.0, 1.0)
    tip = 1.35 * momentum / max(math.sqrt(np.sum(momentum * momentum)), 0.02)
    space.arrow(pen, eye, zero, tip, draw.INK, 3.0, 12.0, _L)
    space.arrow(pen, eye, tip, tip + 0.7 * torque, draw.RED, 3.0, 12.0)
    space.arrow(pen, eye, 0.68 * axis, 0.68 * axis - np.array([0.0, 0.0, 0.6]), draw.GREEN, 2.5)
    cosines = nutation_limits((I1, i3), WEIGHT, math.radians(controls["tilt"]), spin)
    limits = np.degrees(np.arccos(cosines[:2]))
    draw.area(pen, _STRIP, (past[0, 0], past[0, 0] + 4.0, 0.0, min(1.2 * limits[0], 180.0)))
    draw.axes(pen, _T, _DEGREES, _TILTS, 4, 4)
    for k in range(2):
        draw.segment(pen, 0.0, limits[k], 1e4, limits[k], draw.INK, 1.3, 0.8, 5.0, 4.0)
    draw.curve(
        pen,
        past[0],
        np.degrees(np.arccos(np.minimum(np.maximum(past[3], -1.0), 1.0))),
        draw.BLUE,
        2.0,
    )
    draw.area(pen, _BAR, (0.0, 120.0, 0.0, 1.0))
    draw.axes(pen, _SPIN, 0, 0, 4, 0)
    draw.box(pen, 0.0, spin, 0.0, 1.0, draw.GREEN if spin > critical(i3) else draw.ORANGE)
    draw.window(pen)
    x = _BAR[0] + critical(i3) / 120.0 * (_BAR[1] - _BAR[0])
    draw.segment(pen, x, 0.72, x, 1.2, draw.INK, 2.5)
    side = draw.LEFT if x < 7.5 else draw.RIGHT
    draw.text(pen, x, 1.22, _CRITICAL, draw.INK, 11.5, side, draw.BOTTOM)
    draw.number(pen, critical(i3), 1)
    draw.key(pen, 0.2, 4.75, _TORQUE, draw.RED, 3.0)
    draw.key(pen, 3.9, 4.75, _FALLS, draw.GREEN, 3.0)
    draw.key(pen, 7.3, 4.75, _LIMIT, draw.INK, 1.3, 0.8, 5.0, 4.0)
    term = cross(omega, np.array([I1, I1, i3]) * omega)
    time = STEP * state["steps"]
    draw.reading(pen, _TIME, time, 2, _S)
    draw.reading(pen, _PRECESSION, state["turned"] / max(time, 1e-9), 2, _RATE)
    draw.reading(pen, _STEADY, WEIGHT / (i3 * max(spin, 1.0)), 2, _RATE)
    draw.reading(pen, _TERM, math.sqrt(np.sum(term * term)), 3, _NM)
    draw.reading(pen, _ENERGY, top_energy(q, omega, np.array([I1, I1, i3, WEIGHT])), 4, _J)


PRESETS = {
    "A fast top": Preset(
        {}, "The weight pulls down, its torque points sideways, and L follows the torque: the tip "
        "of the black arrow goes where the red one points. The axis nods on the way."),
    "Equal moments: still it stands": Preset(
        {"moments": 1, "spin": 60.0}, "With I1 = I3 the gyroscopic term ω × I ω is zero, and the "
        "top stands. Not the term holds it, L does."),
    "Upright, 5 % too slow": Preset(
        {"spin": 67.0, "tilt": 1.0}, "Below the critical spin the upright top falls far aside, "
        "rises again and repeats."),
    "Upright, 5 % above": Preset({"spin": 75.0, "tilt": 1.0}, "Above it the axis stays near."),
    "No spin": Preset({"spin": 0.0}, "Without spin there is no L to turn, and L grows sideways."),
}  # fmt: skip

PAPER = draw.Paper(TITLE, word, colour)
MODEL = Model(TITLE, PAPER, CONTROLS, STATE, PRESETS, initial, advance, frame, **space.ORBIT)
