"""One step on a spring: where an integrator evaluates the force, and how far the step ends off."""

import math

import numpy as np
from numba.extending import register_jitable

from course.rigid_body.integrators import INTEGRATORS
from course.rigid_body.oscillator import METHODS, step_under
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

# More than one step can need: the implicit rule evaluates three times before its at most 25
# corrections.
ROOM = 30
_PACE = 0.8  # s from one evaluation to the next while playing

CONTROLS = Record(
    method=menu("Integrator", tuple(INTEGRATORS[name].label for name in METHODS)),
    # Beyond 1.4 some steps of semi-implicit Euler would end outside both pictures.
    omega_h=slider("ω h", 1.2, 0.1, 1.4, 0.05),
    phase=slider("Phase of the start", 45.0, -180.0, 180.0, 5.0, "°", 0),
)
# The unit of time is 1 / omega, so that x and v / omega have the same scale.
STATE = Record(
    evaluated=Field(0.0, shape=(2, ROOM)),  # x and v / omega at each evaluation of the step
    count=Field(0),  # of the evaluations
    end=Field(0.0, shape=(2,)),  # of the step
    halves=Field(0.0, shape=(2,)),  # end of two steps of half the size
    time=Field(0.0, unit="s"),
)

# When each evaluation takes place, as a fraction of the step; the last entry serves all later ones.
FRACTIONS = np.array(
    [
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 1.0, 1.0],
        [0.0, 0.5, 0.5, 0.5],
        [0.0, 0.5, 0.5, 0.5],
        [0.0, 0.5, 0.5, 1.0],
    ]
)
_FACTORS = np.array([2.0 ** INTEGRATORS[name].order for name in METHODS])


@register_jitable
def recorded_force(q, v, state):
    """Return the acceleration of the spring, and record where it was evaluated."""
    k = state["count"]
    state["evaluated"][0, k] = q[0]
    state["evaluated"][1, k] = v[0]
    state["count"] = k + 1
    return -q


@register_jitable
def exact(controls, t):
    """Return x and v / omega at the scaled time t (a number or an array): a turn of the plane."""
    angle = math.radians(controls["phase"]) - t
    return np.cos(angle), np.sin(angle)


def initial(controls, state):
    """Take two half steps, then the whole step, whose evaluations are recorded."""
    h = controls["omega_h"]
    start_x, start_v = exact(controls, 0.0)
    q, v = np.array([start_x]), np.array([start_v])
    half_q, half_v = step_under(controls["method"], q, v, recorded_force, 0.5 * h, state)
    state["count"] = 0
    half_q, half_v = step_under(controls["method"], half_q, half_v, recorded_force, 0.5 * h, state)
    state["halves"][0], state["halves"][1] = half_q[0], half_v[0]
    # The records of the half steps are overwritten by those of the whole step.
    state["count"] = 0
    q, v = step_under(controls["method"], q, v, recorded_force, h, state)
    state["end"][0], state["end"][1] = q[0], v[0]


def advance(state, controls, seconds):
    """Let time pass: the evaluations appear one after the other."""
    state["time"] += seconds


TITLE = "Where an integrator evaluates the force"
word, colour = draw.words_table(), draw.colours_table()
_T, _X, _V = word("ω t", "x", "v / ω")
_OVER_TIME, _STATES = word("position over one step", "states: drag the start")
_EXACT_KEY, _DOT_KEY, _FORCE_KEY, _RATE_KEY, _END_KEY = word(
    "exact motion", "force evaluated", "force", "rate of the state", "end of the step"
)
_COUNT, _POSITION, _ERROR, _HALVES, _RATIO, _THEORY = word(
    "force evaluations",
    "error in position",
    "error of the step",
    "error, half steps",
    "ratio of the errors",
    "ratio for small ω h",
)
(_REUSED,) = word(" (1 reused)")
_LEFT, _RIGHT = (0.75, 4.5, 0.75, 4.05), (5.4, 8.7, 0.75, 4.05)
_HIGH, _ARROW, _DOT = 1.95, 0.4, 0.065  # edge of both pictures, length per rate, radius on paper
_PLANE = (-_HIGH, _HIGH, -_HIGH, _HIGH)
_LINE = np.linspace(0.0, 1.0, 60)


def drag(controls, state, x, y):
    """Handle a drag: the start has the phase of the pointer."""
    to_x, to_v = draw.values_at(_RIGHT, _PLANE, x, y)
    controls["phase"] = float(round(math.degrees(math.atan2(to_v, to_x))))


@register_jitable
def error_of(controls, end):
    """Return how far a state (2,) is from the exact state at the end of the step."""
    x, v = exact(controls, controls["omega_h"])
    return math.sqrt((end[0] - x) ** 2 + (end[1] - v) ** 2)


@register_jitable
def _visible(state):
    """Return how many evaluations are drawn now, and whether the end of the step is."""
    n = state["count"]
    # Before it is played the picture is complete; then it is built up again and again.
    if state["time"] == 0.0:
        return n, True
    stage = int(state["time"] / _PACE) % (n + 3)
    return min(stage + 1, n), stage >= n


@register_jitable
def _numbered(pen, x, y, right, up, wide, radius):
    """Draw evaluations with their numbers, which stand side by side where dots coincide.

    Two dots coincide if they are less than wide and one tenth of a unit apart. The numbers are
    moved by right and up, pixels for each dot.
    """
    for k in range(len(x)):
        draw.spot(pen, x[k], y[k], radius, draw.BLUE)
        before = 0
        for j in range(k):
            if abs(x[j] - x[k]) < wide and abs(y[j] - y[k]) < 0.1:
                before += 1
        along = right[k] + 12.0 * before
        draw.text(pen, x[k], y[k], 0, draw.INK, 13.0, draw.CENTRE, draw.MIDDLE, along, up[k])
        draw.number(pen, k + 1, 0)


@register_jitable
def _error(pen, reading, value):
    """Draw a number below the picture, with a power of ten where it is small."""
    draw.reading(pen, reading, value, 4 if abs(value) >= 0.01 else draw.EXPONENT + 2)


def frame(pen, state, controls):
    """Draw the step over time and in the phase plane, and the numbers."""
    h, method = controls["omega_h"], controls["method"]
    n, ended = _visible(state)
    x, v, t = state["evaluated"][0, :n], state["evaluated"][1, :n], np.zeros(n)
    for k in range(n):
        t[k] = h * FRACTIONS[method, min(k, 3)]
    start_x, start_v = exact(controls, 0.0)
    goal_x, goal_v = exact(controls, h)
    end_x, end_v = state["end"]
    # Position over time; the axis ends just after the step, however long it is.
    wide = 1.2 * h
    radius = _DOT * wide / (_LEFT[1] - _LEFT[0])
    draw.chart(pen, _LEFT, (-0.1 * h, 1.1 * h, -_HIGH, _HIGH), _T, _X, _OVER_TIME, 4, 5)
    curve_x, curve_v = exact(controls, h * (1.1 * _LINE))
    draw.curve(pen, h * (1.1 * _LINE), curve_x, draw.GREY, 2.0)
    draw.segment(pen, h, -_HIGH, h, _HIGH, draw.GREY, 1.0, 0.8, 4.0, 4.0)
    for k in range(n):
        draw.arrow(pen, t[k], x[k], t[k], x[k] - 2.0 * _ARROW * x[k], draw.ORANGE, 2.5)
    if ended:
        draw.segment(pen, 0.0, start_x, h, end_x, draw.RED, 1.2, 0.8, 5.0, 4.0)
        draw.segment(pen, h, goal_x, h, end_x, draw.RED, 3.0)
        draw.spot(pen, h, end_x, 1.3 * radius, draw.NONE, draw.RED, 2.2)
    # Beside the dots, as the forces point up or down.
    _numbered(pen, t, x, np.full(n, 13.0), np.zeros(n), 0.04 * wide, radius)
    # The phase plane, where the exact motion runs clockwise on a circle.
    radius = _DOT * 2.0 * _HIGH / (_RIGHT[1] - _RIGHT[0])
    draw.chart(pen, _RIGHT, _PLANE, _X, _V, _STATES, 5, 5)
    curve_x, curve_v = exact(controls, 2.0 * math.pi * _LINE)
    draw.curve(pen, curve_x, curve_v, draw.GREY, 1.0, 0.6)
    curve_x, curve_v = exact(controls, h * _LINE)
    draw.curve(pen, curve_x, curve_v, draw.GREY, 3.0)
    # The rate of the state (x, v / omega) in scaled time is (v / omega, -x).
    for k in range(n):
        draw.arrow(pen, x[k], v[k], x[k] + _ARROW * v[k], v[k] - _ARROW * x[k], draw.GREEN, 2.5)
    if ended:
        draw.segment(pen, start_x, start_v, end_x, end_v, draw.RED, 1.2, 0.8, 5.0, 4.0)
        draw.segment(pen, goal_x, goal_v, end_x, end_v, draw.RED, 3.0)
        draw.spot(pen, end_x, end_v, 1.3 * radius, draw.NONE, draw.RED, 2.2)
    # Away from the centre, as the rates point across.
    far = 15.0 / np.sqrt(x * x + v * v)
    _numbered(pen, x, v, far * x, far * v, 0.1, radius)
    draw.window(pen)
    draw.key(pen, 0.75, 4.75, _EXACT_KEY, draw.GREY, 2.5)
    draw.spot(pen, 2.4, 4.75, _DOT, draw.BLUE)
    draw.text(pen, 2.55, 4.75, _DOT_KEY, draw.INK, 11.5)
    draw.key(pen, 4.2, 4.75, _FORCE_KEY, draw.ORANGE, 2.5)
    draw.key(pen, 5.35, 4.75, _RATE_KEY, draw.GREEN, 2.5)
    draw.spot(pen, 7.25, 4.75, 1.3 * _DOT, draw.NONE, draw.RED, 2.2)
    draw.text(pen, 7.45, 4.75, _END_KEY, draw.INK, 11.5)
    # A step of velocity Verlet begins where the last one evaluated its second force.
    draw.reading(pen, _COUNT, state["count"], 0, _REUSED if method == 2 else 0)
    error, halves = error_of(controls, state["end"]), error_of(controls, state["halves"])
    draw.reading(pen, _POSITION, end_x - goal_x, draw.SIGNED + 4)
    _error(pen, _ERROR, error)
    _error(pen, _HALVES, halves)
    draw.reading(pen, _RATIO, error / halves, 2)
    draw.reading(pen, _THEORY, _FACTORS[method], 0)


PRESETS = {
    "Explicit Euler": Preset(
        {},
        "The only force is evaluated at the start, so the step follows the tangent there. "
        "Drag the start around the circle: the step always ends outside, with too much energy.",
    ),
    "Semi-implicit Euler": Preset(
        {"method": 1},
        "The force is the same, but now the new velocity moves the mass. Drag the "
        "start: from some phases the step ends outside the circle, from others inside.",
    ),
    "Velocity Verlet": Preset(
        {"method": 2},
        "The second force is evaluated at the new position. The next step begins "
        "there and uses it again, so each step needs one new evaluation.",
    ),
    "Explicit midpoint": Preset(
        {"method": 3},
        "Force 1 is used only to reach the middle of the step. Force 2, evaluated "
        "there, then changes the velocity over the whole step.",
    ),
    "Implicit midpoint": Preset(
        {"method": 4},
        "The last force is evaluated halfway between start and end. The end is not "
        "known before, so the equation is solved by iteration: several evaluations for one step. "
        "The end stays on the circle.",
    ),
    "RK4": Preset(
        {"method": 5},
        "Four evaluations: at the start, twice in the middle, at the end. Press "
        "play to see their sequence. The error is by far the smallest of the six.",
    ),
    "The order in numbers": Preset(
        {"method": 5, "omega_h": 0.2},
        "Two half steps cover the same time as one step. For RK4 their error is about 16 times "
        "smaller. Choose other integrators: the ratio is about 2 for order 1 and about 4 for order "
        "2.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "force evaluations": "How often this step evaluated the force, as counted while it was taken.",
    "error in position": "Position at the end of the step minus the exact position.",
    "error of the step": "Distance in the plane of x and v / ω between the step's end and the "
    "exact state, for a motion of amplitude 1.",
    "error, half steps": "The same distance after two steps of half the size.",
    "ratio of the errors": "Error of one step over the error of two half steps.",
    "ratio for small ω h": "2 to the power of the order: what the ratio tends to as ω h tends to "
    "zero.",
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
    readouts=READOUTS,
)
