"""Gimbal lock: three rings, three angles, and the axis that none of them can turn about."""

import math

import numpy as np
from numba.extending import register_jitable

from course.rigid_body.quaternion import cross, from_euler_zyx, rotate
from course.simulations import pen as draw
from course.simulations import space
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider

CONTROLS = Record(
    yaw=slider("Yaw", 20.0, -180.0, 180.0, 1.0, "°", 0, live=True),
    pitch=slider("Pitch", 20.0, -90.0, 90.0, 1.0, "°", 0, live=True),
    roll=slider("Roll", 0.0, -180.0, 180.0, 1.0, "°", 0, live=True),
    **space.camera(-0.9, 0.3),
)
STATE = Record(time=Field(0.0, unit="s"))


def initial(controls, state):
    """Begin at time zero, with the rings where the sliders are."""
    state["time"] = 0.0


def advance(state, controls, seconds):
    """Advance the time."""
    state["time"] += seconds


@register_jitable
def angles(state, controls):
    """Return yaw, pitch and roll now [rad], (3,); the ring that is being wiggled, or -1."""
    now = np.radians(np.array([controls["yaw"], controls["pitch"], controls["roll"]]))
    # Each ring is wiggled for two seconds in turn, by one full period of a sine; at time 0 none.
    ring = int(state["time"] / 2.0) % 3 if state["time"] > 0.0 else -1
    if ring >= 0:
        now[ring] += 0.4 * math.sin(math.pi * state["time"])
    return now, ring


@register_jitable
def axes_of(yaw, pitch, roll):
    """Return the axes of the outer, middle and inner ring and the worst-turned axis, (4, 3)."""
    axes = np.zeros((4, 3))
    # Columns of the map from Euler rates (z-y-x) to the angular velocity, here as rows: world z,
    # the turned y, the body's x.
    axes[0, 2], axes[1, 0], axes[1, 1] = 1.0, -math.sin(yaw), math.cos(yaw)
    axes[2] = rotate(from_euler_zyx(yaw, pitch, roll), np.array([1.0, 0.0, 0.0]))
    # The direction of the smallest singular value: in gimbal lock no ring turns about it.
    # Across the middle axis and what lies halfway between the other two, which never vanishes.
    axes[3] = cross(axes[1], axes[0] + math.copysign(1.0, axes[2, 2]) * axes[2])
    axes[3] /= math.sqrt(np.sum(axes[3] ** 2))
    return axes


TITLE = "Gimbal lock"
word, colour = draw.words_table(), draw.colours_table()
_SHADES = space.shades(colour, "#4d9fd6", "#eb8f4a", "#ad7fbb", "#c4cad0")
_RINGS = ("yaw, outer ring", "pitch, middle ring", "roll, inner ring")
_NAMES = word(*(f"axis of {ring}" for ring in _RINGS), "lost axis: no ring turns about it")[0]
_MOVED = word(*(f"turning: {ring}" for ring in _RINGS))[0]
_ANGLES, _VALUE, _THEORY = word("yaw, pitch, roll", "weakest turn", "in theory")
_NEEDED, _NONE = word("ring rates for 1 rad/s", "none is enough")
_PITCH, _SIGMA, _DEG, _RATE, _COMMA = word("pitch [°]", "weakest turn [rad/s]", "°", " rad/s", ", ")
_SCENE, _CURVE = (0.1, 5.6, 0.1, 4.6), (6.35, 8.8, 2.6, 4.4)
_INKS = (draw.BLUE, draw.ORANGE, draw.PURPLE, draw.RED)
# Each ring lies in the plane of its own axis and the next one. All faces are sorted together.
_PARTS = [*(space.ring(r, 0.05) for r in (1.25, 1.05, 0.85)), space.box(1.1, 0.5, 0.08)]
_SWAP = ([2, 0, 1], [0, 1, 2], [0, 2, 1], [0, 1, 2])  # the normal goes along x, z, y of its frame
_CORNERS = np.hstack([part[0][rows] for part, rows in zip(_PARTS, _SWAP, strict=True)])
_N = _PARTS[0][0].shape[1]
_INDEX = np.vstack([part[1] + k * _N for k, part in enumerate(_PARTS)])
_FILLS = np.repeat(_SHADES, [len(part[1]) for part in _PARTS])


def frame(pen, state, controls):
    """Draw rings, plate and axes; the singular value over the pitch, and numbers."""
    (yaw, pitch, roll), ring = angles(state, controls)
    axes, corners = axes_of(yaw, pitch, roll), np.empty(_CORNERS.shape)
    # Ring k carries the turns of all rings outside it; the plate, k = 3, carries all three.
    for k in range(4):
        q = from_euler_zyx(yaw, pitch if k > 0 else 0.0, roll if k > 1 else 0.0)
        corners[:, k * _N : (k + 1) * _N] = rotate(q, _CORNERS[:, k * _N : (k + 1) * _N])
    # The smallest singular value: how fast rings at unit rate turn the body about its worst axis.
    sigma = math.sqrt(np.sum(np.sum(axes[:3] * axes[3], axis=1) ** 2))  # of unit rates together
    eye, shown = space.camera_view(pen, _SCENE, controls, 1.55), 4 if sigma < 0.5 else 3
    # The negative ends of the axes are drawn before the solids, the positive ones after them; the
    # lost axis appears only near the lock.
    for k in range(shown):
        space.trail(pen, eye, np.outer(axes[k], np.array([-1.45, -0.8])), _INKS[k], 2.5)
    space.faces(pen, eye, corners, _INDEX, _FILLS)
    for k in range(shown):
        width = 4.5 if k == ring or k == 3 else 2.5
        space.arrow(pen, eye, (0.9 if k < 3 else 0.0) * axes[k], 1.5 * axes[k], _INKS[k], width)
    draw.chart(pen, _CURVE, (-110.0, 110.0, 0.0, 1.1), _PITCH, 0, _SIGMA, 4, 4)
    bend = np.linspace(-110.0, 110.0, 111)
    # In theory the singular value depends on the pitch alone, since the cosine between the outer
    # and the inner axis is -sin(pitch).
    draw.theory(pen, bend, np.sqrt(1.0 - np.abs(np.sin(np.radians(bend)))))
    draw.spot(pen, math.degrees(pitch), sigma, 7.0, draw.RED)
    draw.window(pen)
    for k in range(4):
        draw.key(pen, 5.9, 1.6 - 0.27 * k, _NAMES + k, _INKS[k], 3.5)
    if ring >= 0:
        draw.text(pen, 0.2, 4.75, _MOVED + ring, _INKS[ring], 13.0)
    draw.readout(pen, _ANGLES)
    for k in range(3):
        draw.number(pen, math.degrees((yaw, pitch, roll)[k]), 0, _COMMA if k < 2 else _DEG)
    draw.reading(pen, _VALUE, sigma, 4, _RATE)
    draw.reading(pen, _THEORY, math.sqrt(max(1.0 - abs(math.sin(pitch)), 0.0)), 4, _RATE)
    # At the lock no ring rates suffice: a word replaces the reciprocal of zero.
    draw.reading(pen, _NEEDED, 1.0 / max(sigma, 1e-3), 1, _RATE, 0 if sigma > 1e-3 else _NONE)


PRESETS = {
    "Three free axes": Preset(
        {},
        "Press play: each ring in turn wiggles about its own axis. The farther the middle ring "
        "tilts, the nearer the outer axis comes to the inner. The curve: how fast the plate turns "
        "about its weakest axis when the vector of the three ring rates has the length 1 rad/s.",
    ),
    "Locked: pitch 90°": Preset(
        {"pitch": 90.0},
        "The outer and the inner ring turn about one axis: wiggling either does "
        "the same. None turns the plate about the red one. It can; three angles cannot follow.",
    ),
    "Nearly locked: pitch 80°": Preset(
        {"pitch": 80.0}, "To turn about the red axis at 1 rad/s the rings need eight times that."
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "yaw, pitch, roll": "The three angles of the rings, from the outer to the inner one.",
    "weakest turn": (
        "Smallest singular value of the map from ring rates to angular velocity: how fast the "
        "body turns about its worst axis when the rings turn at 1 rad/s."
    ),
    "in theory": "The same value from the formula sqrt(1 - |sin(pitch)|).",
    "ring rates for 1 rad/s": (
        "How fast the rings have to turn to rotate the body at 1 rad/s about its worst axis."
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
