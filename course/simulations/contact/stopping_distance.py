"""Where a block stops that is sent off on a floor: Coulomb's cone, and a pyramid with four sides.

With a constant normal force both have closed forms. Friction on the cone is opposite to the motion.
On a pyramid it is the corner, or the point between two corners, that brakes most: the block turns
while it brakes.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

GRAVITY = 9.81  # m/s^2
INSIDE, AROUND = 0, 1

CONTROLS = Record(
    direction=slider("Launch direction", 25.0, -180.0, 180.0, 1.0, "°", 0),
    speed=slider("Launch speed", 2.0, 0.5, 4.0, 0.1, "m/s", 1),
    friction=slider("Friction coefficient μ", 0.4, 0.1, 1.0, 0.05),
    pyramid=menu("Pyramid with four sides", ("inside the cone", "around the cone")),
)
STATE = Record(time=Field(0.0, unit="s"))


@register_jitable
def braked(speed, rate, time):
    """Return the distance covered in a time at a rate of braking, until the speed is zero."""
    # Friction stops the block, but never reverses it: uniform deceleration ends where the speed is
    # zero.
    time = min(time, speed / rate)
    return speed * time - 0.5 * rate * time * time


@register_jitable
def cone_distance(controls, time):
    """Return how far the block has slid along its launch direction by Coulomb's cone [m]."""
    return braked(controls["speed"], controls["friction"] * GRAVITY, time)


@register_jitable
def pyramid_position(controls, direction, time):
    """Return the position (x, y) [m] after a time for a launch direction [rad], by the pyramid.

    Its corners lie on the axes if it is inside the cone, its sides are normal to them if it is
    around it.
    """
    # The law of maximum dissipation picks the corners of the pyramid that oppose the velocity most.
    rate = controls["friction"] * GRAVITY
    vx = controls["speed"] * math.cos(direction)
    vy = controls["speed"] * math.sin(direction)
    if controls["pyramid"] == AROUND:
        # A box of limits: each axis brakes by itself, with all of mu f_n.
        x, y = braked(abs(vx), rate, time), braked(abs(vy), rate, time)
    else:
        # One corner brakes the faster axis until both are equally fast; then two corners share
        # mu f_n between the axes.
        fast, slow = max(abs(vx), abs(vy)), min(abs(vx), abs(vy))
        equal = (fast - slow) / rate
        first = min(time, equal)
        both = braked(slow, 0.5 * rate, max(time - equal, 0.0))
        far = fast * first - 0.5 * rate * first * first + both
        near = slow * first + both
        x, y = (far, near) if abs(vx) >= abs(vy) else (near, far)
    return math.copysign(x, vx), math.copysign(y, vy)


@register_jitable
def stop(controls, direction):
    """Return where the block stops by the pyramid, for a launch direction [rad]."""
    # Friction of the pyramid brakes at mu g / sqrt(2) or harder.
    return pyramid_position(
        controls, direction, 2.0 * controls["speed"] / (controls["friction"] * GRAVITY)
    )


def initial(controls, state):
    """Launch the block."""
    state["time"] = 0.0


def advance(state, controls, seconds):
    """Let the blocks slide."""
    state["time"] += seconds


TITLE = "Stopping distance: friction cone and pyramid"
word, colour = draw.words_table(), draw.colours_table()
_PALE, _SAND = colour("#cfe3f2", "#f8dcc4")
_X, _Y, _PLAN = word("x [m]", "y [m]", "seen from above")
_ANGLE, _RATIO_AXIS, _ALL = word(
    "launch direction [°]", "pyramid / cone", "ratio of stopping distances"
)
_CONE, _PYRAMID, _LAUNCH = word("Coulomb’s cone", "pyramid", "launch: drag it")
_D_CONE, _D_PYRAMID, _RATIO, _TURNED = word(
    "distance, cone", "distance, pyramid", "pyramid / cone", "direction changes by"
)
_M, _DEGREES = word(" m", "°")
_SCENE, _CHART = (0.75, 4.75, 0.65, 4.25), (5.85, 8.8, 0.85, 4.1)
_ALL_ROUND = np.linspace(-math.pi, math.pi, 145)


@register_jitable
def _view(controls):
    """Return the values at the edges of the scene; they change in steps of the square root of 2."""
    # The scale follows the stopping distance in steps, so that it seldom changes while a slider
    # moves; the subtracted term absorbs rounding at a power.
    steps = math.ceil(2.0 * math.log2(cone_distance(controls, math.inf)) - 1e-9)
    far = 1.15 * 2.0 ** (0.5 * steps)
    wide = far * (_SCENE[1] - _SCENE[0]) / (_SCENE[3] - _SCENE[2])
    return -wide, wide, -far, far


@register_jitable
def _scene(pen, state, controls):
    """Draw both blocks and their paths, and where they stop for every launch direction."""
    values, angle = _view(controls), math.radians(controls["direction"])
    far, unit = cone_distance(controls, math.inf), values[3]
    draw.area(pen, _SCENE, values)
    draw.axes(pen, _X, _Y, _PLAN, 5, 5)
    # Where the block stops for every launch direction: a circle for the cone, a square for the
    # pyramid.
    draw.curve(pen, far * np.cos(_ALL_ROUND), far * np.sin(_ALL_ROUND), draw.BLUE, 2.0, 0.7)
    draw.line(pen, draw.ORANGE, 2.0, 0.8)
    for direction in _ALL_ROUND:
        x, y = stop(controls, direction)
        draw.point(pen, x, y)
    c, s, half = math.cos(angle), math.sin(angle), 0.045 * unit
    draw.box(pen, -half, half, -half, half, draw.NONE, draw.GREY, 1.2)
    draw.arrow(pen, 0.0, 0.0, 0.4 * unit * c, 0.4 * unit * s, draw.GREEN, 7.0, 16.0, 0.55)
    # The path under the pyramid bends, as the axes brake at different rates.
    draw.line(pen, draw.ORANGE, 3.0)
    for k in range(41):
        x, y = pyramid_position(controls, angle, state["time"] * k / 40.0)
        draw.point(pen, x, y)
    far = cone_distance(controls, state["time"])
    # Under the cone the path is straight: friction is opposite to the velocity.
    draw.segment(pen, 0.0, 0.0, far * c, far * s, draw.BLUE, 3.0)
    draw.box(pen, x - half, x + half, y - half, y + half, _SAND, draw.ORANGE, 2.0)
    x, y = far * c, far * s
    draw.box(pen, x - half, x + half, y - half, y + half, _PALE, draw.BLUE, 2.0)
    draw.window(pen)


@register_jitable
def _chart(pen, controls):
    """Draw the ratio of the stopping distances over the launch direction."""
    draw.area(pen, _CHART, (-180.0, 180.0, 0.6, 1.6))
    draw.axes(pen, _ANGLE, _RATIO_AXIS, _ALL, 4, 5)
    # Ratio 1 is Coulomb's cone itself; the pyramid's ratio depends on the direction alone, as both
    # distances are proportional to v² / (μ g).
    draw.segment(pen, -180.0, 1.0, 180.0, 1.0, draw.BLUE, 2.0)
    far = cone_distance(controls, math.inf)
    draw.line(pen, draw.ORANGE, 2.5)
    for direction in _ALL_ROUND:
        x, y = stop(controls, direction)
        draw.point(pen, math.degrees(direction), math.hypot(x, y) / far)
    x, y = stop(controls, math.radians(controls["direction"]))
    draw.spot(pen, controls["direction"], math.hypot(x, y) / far, 7.0, draw.ORANGE, draw.INK)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw the floor from above, the ratio of all directions, and the numbers."""
    _scene(pen, state, controls)
    _chart(pen, controls)
    draw.key(pen, 0.6, 4.72, _LAUNCH, draw.GREEN, 3.0)
    draw.key(pen, 2.4, 4.72, _CONE, draw.BLUE, 3.0)
    draw.key(pen, 4.3, 4.72, _PYRAMID, draw.ORANGE, 3.0)
    angle, far = math.radians(controls["direction"]), cone_distance(controls, math.inf)
    x, y = stop(controls, angle)
    draw.reading(pen, _D_CONE, far, 3, _M)
    draw.reading(pen, _D_PYRAMID, math.hypot(x, y), 3, _M)
    draw.reading(pen, _RATIO, math.hypot(x, y) / far, 3)
    # The difference of two angles, wrapped to half a turn.
    turned = math.degrees(math.atan2(y, x) - angle)
    turned -= 360.0 * round(turned / 360.0)
    draw.reading(pen, _TURNED, turned, draw.SIGNED + 1, _DEGREES)


def drag(controls, state, x, y):
    """Launch towards the pointer."""
    to = draw.values_at(_SCENE, _view(controls), x, y)
    controls["direction"] = math.degrees(math.atan2(to[1], to[0]))


def press(controls, state, key):
    """Handle a key: left and right turn the launch by a degree, up and down by five."""
    if key < 4:
        turn = (1.0, -1.0, 5.0, -5.0)[key]
        # The direction wraps around at half a turn, as its slider does.
        controls["direction"] = (controls["direction"] + turn + 180.0) % 360.0 - 180.0


PRESETS = {
    "Inside the cone": Preset(
        {},
        "Press play, then drag the launch around. The pyramid allows less friction than the "
        "cone in most directions, so its block slides farther and turns. The points where it "
        "stops form a square around the cone’s circle.",
    ),
    "Around the cone": Preset(
        {"pyramid": 1},
        "This pyramid allows more friction than Coulomb’s law. Its block stops too early, on a "
        "diamond inside the circle. Along the axes both laws agree: turn the launch until they do.",
    ),
    "Along the diagonal": Preset(
        {"direction": 45.0},
        "Here the pyramid is farthest from the cone. The block does not turn, "
        "as both axes brake alike, but it slides too far. Change μ and the speed: the distances "
        "change, their ratio does not.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "distance, cone": "How far the block slides with Coulomb's cone.",
    "distance, pyramid": "Straight distance from the launch to the stop with the pyramid.",
    "pyramid / cone": "Ratio of the two distances.",
    "direction changes by": "Angle between the launch and the line to the stop with the pyramid.",
}

PAPER = draw.Paper(TITLE, word, colour)
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
    press=press,
    readouts=READOUTS,
)
