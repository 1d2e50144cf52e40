"""A body that turns freely: its angular momentum stays, its angular velocity wanders."""

import math

import numpy as np
from numba.extending import register_jitable

from course.rigid_body.problems import tumble_energy
from course.rigid_body.quaternion import rotate
from course.simulations import pen as draw
from course.simulations import space
from course.simulations.model import Model, Preset
from course.simulations.record import Record, menu, slider
from course.simulations.rigid_body import turning

BODIES = ("brick", "plate", "rod", "cube")
SIDES = np.array([[1.5, 1.0, 0.4], [1.2, 1.2, 0.2], [0.4, 0.4, 1.6], [0.9, 0.9, 0.9]])  # [m]
MOMENTS = np.sum(SIDES**2, axis=1, keepdims=True) - SIDES**2  # of boxes of 12 kg [kg m^2]

CONTROLS = Record(
    body=menu("Body", BODIES),
    spin=slider("Spin |ω|", 4.0, 1.0, 8.0, 0.1, "rad/s", 1),
    tilt=slider("ω off axis 3", 40.0, 0.0, 90.0, 1.0, "°", 0),
    **space.camera(0.5, 0.3),
)
STATE = Record(**turning.TURNING)


def initial(controls, state):
    """Set up turning about an axis between the third and the first."""
    tilt = math.radians(controls["tilt"])
    omega = controls["spin"] * np.array([math.sin(tilt), 0.0, math.cos(tilt)])
    turning.start(state, MOMENTS[controls["body"]], omega)


def advance(state, controls, seconds):
    """Turn on."""
    turning.turn(state, MOMENTS[controls["body"]], seconds)


TITLE = "A free body: L stays, ω wanders"
# Tables of its own, so that its words have the same numbers whatever else is there.
word, colour = draw.Table(*turning.word.entries), draw.Table(*turning.colour.entries)
(_VIOLET,) = colour("#b5487f")  # no body rate has it
_L, _OMEGA, _THIRD = word("L", "ω", "axis 3")
_KEYS = word(
    "L: fixed in space",
    "ω: wanders",
    "space cone: where ω was, in space",
    "body cone: where ω was, in the body",
    "plane in which the tip of ω stays",
)[0]
_TIME, _ENERGY, _SIZE = word("time", "energy", "size of L")
_ANGLE, _MOVED = word("angle of ω and L", "ω has moved by")
_S, _J, _NMS, _DEG = word(" s", " J", " N m s", "°")
_SCENE, _STRIP = (0.1, 5.5, 0.1, 4.6), (6.35, 8.8, 3.0, 4.5)
_INKS = (draw.INK, draw.RED, draw.GREEN, _VIOLET, draw.GREY)


@register_jitable
def _fan(pen, eye, path, ink):
    """Draw a cone from the origin along a path (3, N)."""
    # The apex of the cone is the origin, as the first point of the polygon.
    cone = np.zeros((3, path.shape[1] + 1))
    cone[:, 1:] = path
    space.sheet(pen, eye, cone, ink, draw.NONE, 1.0, 0.13)
    space.trail(pen, eye, path, ink, 2.2)


def frame(pen, state, controls):
    """Draw the body, both vectors and both cones; rates and numbers."""
    q, omega, moments = state["q"], state["omega"], MOMENTS[controls["body"]]
    sides, past = SIDES[controls["body"]], turning.recent(state)
    momentum, spin = rotate(q, moments * omega), rotate(q, omega)
    length, unit = math.sqrt(np.sum(momentum * momentum)), 1.15 / controls["spin"]
    eye = space.camera_view(pen, _SCENE, controls, 1.35)
    # The invariable plane (Poinsot, 1834): the energy is ω · L / 2, so the height of the tip of ω
    # along L is constant.
    plane = space.circle(0.8)
    plane[2] = unit * np.sum(spin * momentum) / length
    space.sheet(pen, eye, plane, draw.GREY, draw.GREY, 1.0, 0.16)
    turning.body(pen, eye, q, sides)
    third = rotate(q, np.array([0.0, 0.0, 1.0]))
    space.arrow(
        pen,
        eye,
        0.5 * sides[2] * third,
        (0.5 * sides[2] + 0.3) * third,
        draw.GREY,
        1.5,
        8.0,
        _THIRD,
    )
    # Space cone: the path of ω in the world. Body cone: its path in the body, carried along by
    # today's attitude.
    _fan(pen, eye, unit * past[4:7], draw.GREEN)
    _fan(pen, eye, unit * rotate(q, past[1:4]), _VIOLET)
    # ω and L to scales of their own: L with one length, as it is constant.
    space.arrow(pen, eye, 0.0 * spin, 1.25 * momentum / length, draw.INK, 3.5, 13.0, _L)
    space.arrow(pen, eye, 0.0 * spin, unit * spin, draw.RED, 3.5, 13.0, _OMEGA)
    turning.rates(pen, state, _STRIP, 1.1 * controls["spin"])
    for k in range(5):
        draw.key(pen, 5.75, 1.6 - 0.27 * k, _KEYS + k, _INKS[k], 3.0)
    draw.reading(pen, _TIME, turning.STEP * state["steps"], 2, _S)
    draw.reading(pen, _ENERGY, tumble_energy(q, omega, moments), 4, _J)
    draw.reading(pen, _SIZE, length, 4, _NMS)
    draw.reading(pen, _ANGLE, turning.between(spin, momentum), 1, _DEG)
    draw.reading(pen, _MOVED, turning.between(spin, state["past"][4:7, 0]), 1, _DEG)


PRESETS = {
    "A brick": Preset(
        {},
        "No torque acts. L stays where it is, ω does not. But its tip stays in a plane, because "
        "L and the energy, half of ω · L, are both constant. Drag to look from elsewhere.",
    ),
    "A plate: two cones that roll": Preset(
        {"body": "plate", "tilt": 25.0},
        "Two moments are equal. ω circles L in space and axis 3 in the body, both at a steady "
        "rate: one cone rolls on the other, along ω.",
    ),
    "A rod": Preset(
        {"body": "rod", "tilt": 20.0},
        "A slim body: L leans far from ω, and the body cone rolls outside the space cone. For a "
        "plate the space cone is inside it.",
    ),
    "About its own axis": Preset(
        {"tilt": 0.0}, "About a principal axis L and ω are parallel, and only then does ω stay."
    ),
    "A cube": Preset(
        {"body": "cube"},
        "All moments are equal: L = I ω with a number I, so ω stays with L, whatever the axis.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "time": "Simulated time since the start.",
    "energy": "Kinetic energy of the rotation. Without a torque it is constant.",
    "size of L": "Magnitude of the angular momentum. Without a torque it is constant.",
    "angle of ω and L": "Angle between the angular velocity and the angular momentum.",
    "ω has moved by": "Angle between the angular velocity now and at the start, seen from outside.",
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
