"""q and -q: one attitude, two quaternions, and two ways to go there."""

import math

import numpy as np

from course.rigid_body.quaternion import angle_between, exp, identity, rotate
from course.simulations import pen as draw
from course.simulations import space
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

AXIS = np.array([0.36, -0.48, 0.8])
_RATE = 1.2  # rad/s

CONTROLS = Record(
    goal=slider("Turn of q′", 360.0, 0.0, 720.0, 5.0, "°", 0),
    path=menu("Go straight from q", ("to q′", "to −q′")),
    **space.camera(0.4, 0.3),
)
STATE = Record(turned=Field(0.0, unit="rad"))


def initial(controls, state):
    """Set up nothing is turned yet: q = (1, 0, 0, 0)."""
    state["turned"] = 0.0


def advance(state, controls, seconds):
    """Turn at a steady rate along the great circle to q' or -q', and stop there."""
    # q and -q are one attitude, but -q lies a full turn of 2π back on the great circle of
    # quaternions.
    end = math.radians(controls["goal"]) - 2.0 * math.pi * controls["path"]
    remaining = end - state["turned"]
    state["turned"] += math.copysign(min(_RATE * seconds, abs(remaining)), remaining)


TITLE = "q and −q: one attitude, two quaternions"
word, colour = draw.words_table(), draw.colours_table()
_FILLS = np.array(
    space.shades(colour, "#c9d1d9", "#8fb3d9", "#c9d1d9", "#e6dcc4", "#c9d1d9", "#d9775b")
)
_CORNERS, _INDEX = space.box(1.5, 0.9, 0.3)
_NAMES = word("w", "x", "y", "z")[0]
_BARS = word("q now; in red where it goes")[0]
_AXIS, _TIP, _AIM = word("axis", "path of a corner", "where that corner ends")
_TURNED, _W, _SAME, _LEFT = word("turned by", "w = cos(half)", "angle from start", "angle to end")
_DOT, _DEG, _HALF = word("first q · last q", "°", "q on its circle: half the angle")
_SCENE, _PANEL, _ROUND = (0.1, 5.4, 0.1, 4.6), (6.35, 8.8, 2.75, 4.5), (6.85, 8.25, 0.5, 1.9)


def frame(pen, state, controls):
    """Draw the body and the path of its corner; the four components as bars and on their circle."""
    turned, q = state["turned"], exp(state["turned"] * AXIS)
    target = math.radians(controls["goal"]) - 2.0 * math.pi * controls["path"]
    end, zero, corner = exp(target * AXIS), np.zeros(3), np.array([0.75, 0.45, 0.15])
    eye = space.camera_view(pen, _SCENE, controls, 1.35)
    space.trail(pen, eye, np.outer(AXIS, np.array([-1.3, 0.0])), draw.GREY, 1.5, 1.0, 6.0, 4.0)
    # The path of one corner under all turns so far.
    path = np.zeros((3, 60))
    for k in range(60):
        path[:, k] = rotate(exp(turned * k / 59.0 * AXIS), 1.02 * corner)
    # The part of the path behind the body is drawn before it and paler, the other part after it.
    space.trail(pen, eye, path, draw.BLUE, 2.5, 0.35, 0.0, 0.0, -1.0)
    space.faces(pen, eye, rotate(q, _CORNERS), _INDEX, _FILLS, draw.GREY)
    space.trail(pen, eye, path, draw.BLUE, 2.5, 1.0, 0.0, 0.0, 1.0)
    space.dot(pen, eye, path[:, 59], draw.BLUE, 0.06)
    aim = rotate(end, 1.02 * corner)
    space.dot(pen, eye, aim, draw.RED, 0.045)
    space.arrow(pen, eye, zero, 1.3 * AXIS, draw.GREY, 2.0, 10.0, _AXIS)
    draw.chart(pen, _PANEL, (0.0, 4.0, -1.1, 1.1), 0, 0, _BARS, 0, 4)
    draw.segment(pen, 0.0, 0.0, 4.0, 0.0, draw.GREY, 1.2)
    # Components of q as filled bars; those of the end, q' or -q', as red frames.
    for k in range(4):
        draw.box(pen, k + 0.2, k + 0.6, 0.0, q[k], draw.ORANGE if k == 0 else draw.BLUE)
        draw.box(pen, k + 0.6, k + 0.8, 0.0, end[k], draw.NONE, draw.RED, 1.5)
        draw.text(pen, k + 0.5, -1.1, _NAMES + k, draw.INK, 13.0, draw.CENTRE, draw.TOP, 0.0, -4.0)
    # The great circle: q = (cos θ/2, sin θ/2 axis) runs at half the angle θ of the body.
    draw.area(pen, _ROUND, (-1.25, 1.25, -1.25, 1.25))
    draw.line(pen, draw.GREY, 1.5)
    circle = space.circle(1.0)
    draw.points(pen, circle[0], circle[1])
    draw.line(pen, draw.BLUE, 3.0)
    angle = np.linspace(0.0, 0.5 * turned, 60)
    draw.points(pen, np.cos(angle), np.sin(angle))
    draw.arrow(pen, 0.0, 0.0, math.cos(0.5 * turned), math.sin(0.5 * turned), draw.ORANGE, 2.5)
    draw.spot(pen, math.cos(0.5 * target), math.sin(0.5 * target), 0.09, draw.RED)
    draw.window(pen)
    draw.key(pen, 2.4, 4.75, _AIM, draw.RED, 4.0)
    draw.key(pen, 0.2, 4.75, _TIP, draw.BLUE, 3.0)
    draw.text(pen, 7.55, 2.08, _HALF, draw.INK, 11.5, draw.CENTRE)
    draw.reading(pen, _TURNED, math.degrees(turned), draw.SIGNED, _DEG)
    draw.reading(pen, _W, q[0], draw.SIGNED + 3)
    # Angles of rotation between attitudes, the same for q and -q (geodesic distance on SO(3)).
    draw.reading(pen, _SAME, math.degrees(angle_between(identity(), q)), 0, _DEG)
    draw.reading(pen, _LEFT, math.degrees(angle_between(q, end)), 0, _DEG)
    # With q = (1, 0, 0, 0) at the start, the dot product with the end is the scalar part of the
    # end; below 0 the chosen path is the longer one.
    draw.reading(pen, _DOT, end[0], draw.SIGNED + 3)


PRESETS = {
    "A full turn: q becomes −q": Preset(
        {},
        "After 360° the body stands as at the start, and every component has the other sign. "
        "The quaternion turns with half the angle.",
    ),
    "Two full turns": Preset(
        {"goal": 720.0}, "Only after 720° are the four numbers those of the start."
    ),
    "The long way": Preset(
        {"goal": 270.0}, "q · q′ is negative: the straight way from q to q′ turns by 270°."
    ),
    "The short way": Preset(
        {"goal": 270.0, "path": 1},
        "The same attitude, written as −q′: now the straight way turns by 90°, backwards. Before "
        "you interpolate, take the sign with q · q′ ≥ 0.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "turned by": "Angle of the rotation that the quaternion stands for.",
    "w = cos(half)": "Scalar part of the quaternion: the cosine of half the angle.",
    "angle from start": "Angle between the present orientation and the one at the start.",
    "angle to end": "Angle between the present orientation and the one at the end.",
    "first q · last q": (
        "Dot product of the first and the last quaternion. If it is negative, interpolation "
        "takes the long way round."
    ),
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
