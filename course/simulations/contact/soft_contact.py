"""MuJoCo's soft contact: solref and solimp as curves, and how a body of 1 kg lands on them."""

import numpy as np
from numba.extending import register_jitable

from course.contact.soft import impedance_at, reference_gains
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider

MASS, GRAVITY = 1.0, 9.81  # [kg], [m/s^2]
STEP, STEPS = 0.002, 250  # MuJoCo's default step [s], and how many are shown
_SLOW = 0.1  # s of the motion in a second of playing
_LOW, _HIGH = 0.01, 0.99  # impedances that the sliders reach
_WIDTHS = (0.5, 20.0)  # mm

CONTROLS = Record(
    time=slider("Time constant (solref)", 20.0, 4.0, 100.0, 1.0, "ms", 0),
    ratio=slider("Damping ratio (solref)", 1.0, 0.1, 2.0, 0.05),
    low=slider("Impedance at depth 0 (solimp d₀)", 0.90, _LOW, _HIGH, 0.01),
    high=slider("Impedance beyond the width (solimp dwidth)", 0.95, _LOW, _HIGH, 0.01),
    width=slider("Width (solimp)", 1.0, *_WIDTHS, 0.5, "mm", 1),
    middle=slider("Midpoint (solimp)", 0.5, 0.05, 0.95, 0.05),
    power=slider("Power (solimp)", 2.0, 1.0, 6.0, 0.5, "", 1),
    height=slider("Drop height", 20.0, 0.0, 50.0, 1.0, "mm", 0),
    handle=Field(1, low=0, high=2),  # which point of the curve is dragged
)
STATE = Record(
    path=Field(0.0, shape=(3, STEPS + 1)),  # gap [m], velocity [m/s] and contact force [N]
    time=Field(0.0, unit="s"),
)


@register_jitable
def impedance(controls, gap):
    """Return the impedance at gaps (n,) [m]."""
    width = 1e-3 * controls["width"]
    return impedance_at(
        gap, controls["low"], controls["high"], width, controls["middle"], controls["power"]
    )


@register_jitable
def contact_acceleration(controls, gap, speed):
    """Return what MuJoCo's contact adds to the acceleration of one body without friction [m/s^2].

    The convex problem of one row has a closed form: a share d of what is missing to the reference
    acceleration -b v - k d r, if it is missing.
    """
    # The constraint is active only while the bodies overlap (margin 0).
    if gap >= 0.0:
        return 0.0
    # Reference acceleration from solref, with MuJoCo's `refsafe` bound of two steps on the time
    # constant; the impedance d scales the stiffness again.
    d = impedance(controls, np.array([gap]))[0]
    k, b = reference_gains(1e-3 * controls["time"], controls["ratio"], controls["high"], 2.0 * STEP)
    # A contact may only push: the multiplier of the inequality constraint is not negative.
    return d * max(-b * speed - k * d * gap + GRAVITY, 0.0)


def initial(controls, state):
    """Let the body fall: the whole motion, in MuJoCo's semi-implicit steps."""
    gap, speed = 1e-3 * controls["height"], 0.0
    for k in range(STEPS + 1):
        push = contact_acceleration(controls, gap, speed)
        state["path"][0, k], state["path"][1, k] = gap, speed
        state["path"][2, k] = MASS * push
        # Semi-implicit Euler, as in MuJoCo's default integrator: velocity first, then position.
        speed += STEP * (push - GRAVITY)
        gap += STEP * speed


def advance(state, controls, seconds):
    """Let the marker follow the motion slowly, and start again at its end."""
    state["time"] = (state["time"] + _SLOW * seconds) % (STEP * STEPS)


TITLE = "MuJoCo’s soft contact: solref and solimp"
word, colour = draw.words_table(), draw.colours_table()
_DEPTH, _IMPEDANCE, _CURVE = word("depth [mm]", "impedance d", "solimp: impedance over depth")
_TIME, _GAP, _MOTION = word("time [ms]", "gap [mm]", "a body of 1 kg lands")
_HANDLES, _NOW = word("drag these points", "now, in slow motion")
_DEEPEST, _END, _HERE, _FORCE, _K, _B = word(
    "deepest",
    "depth at the end",
    "impedance now",
    "contact force now",
    "reference k",
    "reference b",
)
_MM, _N, _PER_S2, _PER_S = word(" mm", " N", " 1/s²", " 1/s")
_LEFT, _RIGHT = (0.8, 4.2, 0.75, 4.15), (5.15, 8.8, 0.75, 4.15)


@register_jitable
def _left_view(controls):
    """Return the values at the edges of the curve's chart."""
    # The smallest of four ranges that holds the width with some margin, so that the scale seldom
    # changes.
    far = 25.0
    for smaller in (10.0, 5.0, 2.0):
        if 1.2 * controls["width"] <= smaller:
            far = smaller
    return 0.0, far, 0.0, 1.05


@register_jitable
def handle_position(controls, which):
    """Return depth [mm] and impedance of a point that can be dragged: start, width, midpoint."""
    depth = (0.0, controls["width"], controls["middle"] * controls["width"])[which]
    return depth, impedance(controls, np.array([-1e-3 * depth]))[0]


@register_jitable
def _left(pen, controls, depth):
    """Draw the impedance over the depth, its handles, and where the body is."""
    values = _left_view(controls)
    draw.area(pen, _LEFT, values)
    draw.axes(pen, _DEPTH, _IMPEDANCE, _CURVE, 5, 5)
    # The sigmoid of solimp, from d₀ at the surface to dwidth at the width, and the width as a
    # dashed line.
    x = np.linspace(0.0, values[1], 121)
    draw.curve(pen, x, impedance(controls, -1e-3 * x), draw.BLUE, 3.0)
    draw.segment(pen, controls["width"], 0.0, controls["width"], 2.0, draw.GREY, 1.2, 1.0, 4.0, 4.0)
    if depth > 0.0:
        here = impedance(controls, np.array([-1e-3 * depth]))[0]
        draw.spot(pen, depth, here, 0.017 * values[1], draw.RED)
    draw.window(pen)
    for k in range(3):  # not cut off at the edge of the chart
        at, d = handle_position(controls, k)
        u, v = draw.values_at(values, _LEFT, at, d)
        draw.spot(pen, u, v, 0.075, draw.GREEN, draw.INK)


def frame(pen, state, controls):
    """Draw the impedance, the motion, and the numbers."""
    path = state["path"]
    k = min(int(state["time"] / STEP + 0.5), STEPS)
    depth = 1000.0 * max(-path[0, k], 0.0)
    _left(pen, controls, depth)
    # The chart includes the surface and the deepest point, whatever the settings.
    low, high = 1000.0 * np.min(path[0]), 1000.0 * np.max(path[0])
    draw.area(pen, _RIGHT, (0.0, 1000.0 * STEP * STEPS, min(1.2 * low, -0.5), max(1.1 * high, 1.0)))
    draw.axes(pen, _TIME, _GAP, _MOTION, 5, 6)
    draw.segment(pen, 0.0, 0.0, 1e4, 0.0, draw.INK, 1.2)
    draw.curve(pen, 1000.0 * STEP * np.arange(STEPS + 1), 1000.0 * path[0], draw.ORANGE, 2.0)
    draw.spot(pen, 1000.0 * STEP * k, 1000.0 * path[0, k], 9.0, draw.RED)
    draw.window(pen)
    draw.spot(pen, 0.6, 4.75, 0.06, draw.GREEN, draw.INK)
    draw.text(pen, 0.75, 4.75, _HANDLES, draw.INK, 11.5)
    draw.spot(pen, 2.7, 4.75, 0.06, draw.RED)
    draw.text(pen, 2.85, 4.75, _NOW, draw.INK, 11.5)
    draw.reading(pen, _DEEPEST, max(-low, 0.0), 2, _MM)
    draw.reading(pen, _END, max(-1000.0 * path[0, STEPS], 0.0), 3, _MM)
    # Above the surface the impedance is that of depth 0.
    draw.reading(pen, _HERE, impedance(controls, np.array([min(path[0, k], 0.0)]))[0], 3)
    draw.reading(pen, _FORCE, path[2, k], 1, _N)
    stiff, damp = reference_gains(
        1e-3 * controls["time"], controls["ratio"], controls["high"], 2.0 * STEP
    )
    draw.reading(pen, _K, stiff, 0, _PER_S2)
    draw.reading(pen, _B, damp, 0, _PER_S)


def grab(controls, state, x, y):
    """Take the point of the curve that is nearest to the pointer."""
    # The nearest handle in units of the window, where both axes have the same scale.
    values, best = _left_view(controls), np.inf
    for k in range(3):
        depth, d = handle_position(controls, k)
        u, v = draw.values_at(values, _LEFT, depth, d)
        far = (u - x) ** 2 + (v - y) ** 2
        if far < best:
            best = far
            controls["handle"] = k


def drag(controls, state, x, y):
    """Move the point that was taken: d at depth 0, width and d there, or the midpoint."""
    depth, d = draw.values_at(_LEFT, _left_view(controls), x, y)
    if controls["handle"] == 0:
        controls["low"] = min(max(d, _LOW), _HIGH)
    elif controls["handle"] == 1:
        controls["high"] = min(max(d, _LOW), _HIGH)
        # Within the chart, so that its scale changes with the next drag only.
        controls["width"] = min(max(depth, _WIDTHS[0]), _WIDTHS[1])
    else:
        # The midpoint is a share of the width; its bounds keep the sigmoid's two branches apart.
        controls["middle"] = min(max(depth / controls["width"], 0.05), 0.95)


PRESETS = {
    "MuJoCo’s defaults": Preset(
        {},
        "Press play. The body sinks in, the reference spring and damper bring it back, and it "
        "rests a little below the surface. The impedance d is the share of the load that the "
        "reference takes: drag its curve down and the body rests deeper.",
    ),
    "A longer time constant": Preset(
        {"time": 60.0},
        "solref sets the time constant and the damping ratio of the reference. A "
        "longer time constant makes the contact softer: it is deeper and takes longer to come to "
        "rest. Try a small damping ratio as well.",
    ),
    "A soft surface layer": Preset(
        {"low": 0.05, "high": 0.95, "width": 15.0, "height": 5.0},
        "The impedance starts low and grows over the width: the first millimetres hardly push. "
        "Drag the midpoint and change the power, and see where the body comes to rest.",
    ),
    "Bouncy": Preset(
        {"time": 40.0, "ratio": 0.15, "height": 50.0},
        "A small damping ratio leaves energy in the spring, and the body bounces. MuJoCo has no "
        "coefficient of restitution: the damping ratio takes its place. A ratio of 1 still leaves "
        "about 14 % of the speed, because the contact can only push.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "deepest": "Largest penetration during the motion that is shown.",
    "depth at the end": "Penetration after half a second: where the body rests, if it has settled.",
    "impedance now": "Impedance d at the present depth: the share that the reference takes.",
    "contact force now": "Normal force on the body at the red point.",
    "reference k": "Stiffness of the reference acceleration, per unit of mass, from solref.",
    "reference b": "Damping of the reference acceleration, per unit of mass, from solref.",
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
    grab=grab,
    readouts=READOUTS,
)
