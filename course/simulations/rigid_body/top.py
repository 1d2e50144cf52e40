"""A heavy top, and what holds it up: gravity's torque turns its angular momentum sideways."""

import math

import numpy as np
from numba.extending import register_jitable

from course.rigid_body.problems import nutation_limits, top_acceleration, top_energy
from course.rigid_body.quaternion import cross, exp, rotate
from course.simulations import pen as draw
from course.simulations import space
from course.simulations.model import Model, Preset
from course.simulations.record import Record, menu, slider
from course.simulations.rigid_body import turning

I1, WEIGHT = 0.02, 1.0  # about the tip [kg m^2]; m g l [N m]
RATIOS = np.array([0.2, 1.0, 1.6])  # I3 / I1
STEP, _SAMPLE = 0.002, 6  # s, steps

CONTROLS = Record(
    moments=menu("Moments", ("slim: I3 = I1 / 5", "equal: I3 = I1", "flat: I3 = 1.6 I1")),
    spin=slider("Spin", 80.0, 0.0, 120.0, 1.0, "rad/s", 0),
    tilt=slider("Tilt at release", 30.0, 1.0, 90.0, 1.0, "°", 0),
    **space.camera(0.5, 0.3),
)
STATE = Record(**turning.TURNING)


@register_jitable
def critical(i3):
    """Return the spin above which the upright top stands (Goldstein, sec. 5.7) [rad/s]."""
    return 2.0 * math.sqrt(I1 * WEIGHT) / i3


def initial(controls, state):
    """Set up released with the axis at rest."""
    # The axis leans by the tilt, and the only rate is the spin about it: released without
    # precession, the top therefore nutates.
    state["q"][:] = exp(np.array([math.radians(controls["tilt"]), 0.0, 0.0]))
    state["omega"][2] = controls["spin"]
    turning.remember(state, 0.0)


def advance(state, controls, seconds):
    """Turn on."""
    params = np.array([I1, I1, RATIOS[controls["moments"]] * I1, WEIGHT])
    turning.march(state, top_acceleration, params, STEP, _SAMPLE, seconds)


TITLE = "A top, and what holds it up"
word, colour = draw.words_table(), draw.colours_table()
_PALE, _DARK, _POST = space.shades(colour, "#e3c9a0", "#b9803f", "#b8bec4")
_RADII, _HEIGHTS = (0.02, 0.05, 0.05, 0.5, 0.5, 0.05, 0.05), (0.0, 0.1, 0.5, 0.6, 0.75, 0.85, 1.0)
_CORNERS, _INDEX = space.lathe(list(zip(_RADII, _HEIGHTS, strict=True)), 16)
_FILLS = np.where(np.arange(len(_INDEX)) % 4 < 2, _PALE, _DARK)
_FOOT, _FEET = space.lathe([(0.3, -1.1), (0.04, -1.0), (0.03, 0.0)], 12)
_GREY = np.full(len(_FEET), _POST)
_L, _TORQUE, _FALLS, _LIMIT = word("L", "torque: where L goes", "weight", "limits in theory")
_TILTS, _T, _DEGREES, _SPIN = word("tilt", "time [s]", "[°]", "spin [rad/s]")
_CRITICAL, _TURNS, _STEADY = word("an upright top is stable above ", "turns at", "fast-top theory")
_TIME, _TERM, _ENERGY = word("time", "ω × I ω", "energy")
_S, _NM, _J, _RATE = word(" s", " N m", " J", " rad/s")
_SCENE, _STRIP, _BAR = (0.1, 5.6, 0.1, 4.6), (6.35, 8.8, 2.55, 4.5), (6.35, 8.8, 0.8, 1.1)


def frame(pen, state, controls):
    """Draw the top on its post, its vectors and the path of its axis; tilt, spin and numbers."""
    q, omega, spin, past = state["q"], state["omega"], controls["spin"], turning.recent(state)
    i3, up = RATIOS[controls["moments"]] * I1, np.array([0.0, 0.0, 1.0])
    inertia, axis, time, path = np.array([I1, I1, i3]), rotate(q, up), past[0], past[7:10]
    # Angular momentum in the world, and the torque r × m g of the weight about the tip (Euler's
    # equations, fixed point).
    momentum, torque = rotate(q, inertia * omega), WEIGHT * cross(axis, -up)
    eye = space.camera_view(pen, _SCENE, controls, 1.5)
    # The post first, then the part of the trail behind the top, the top, and the part in front of
    # it: the painter's algorithm with three layers.
    space.faces(pen, eye, _FOOT, _FEET, _GREY)
    space.trail(pen, eye, 1.02 * path, draw.BLUE, 1.6, 0.35, 0.0, 0.0, -1.0)
    space.faces(pen, eye, rotate(q, _CORNERS), _INDEX, _FILLS)
    space.trail(pen, eye, 1.02 * path, draw.BLUE, 1.8, 0.9, 0.0, 0.0, 1.0)
    # L is drawn with one length, since only its direction is compared; without spin it may vanish.
    tip = 1.35 * momentum / max(math.sqrt(np.sum(momentum * momentum)), 0.02)
    space.arrow(pen, eye, 0.0 * tip, tip, draw.INK, 3.0, 12.0, _L)
    # The torque starts at the tip of L, as it is the velocity of this tip: dL/dt = torque.
    space.arrow(pen, eye, tip, tip + 0.7 * torque, draw.RED, 3.0, 12.0)
    space.arrow(pen, eye, 0.68 * axis, 0.68 * axis - 0.6 * up, draw.GREEN, 2.5)
    # Turning points of the nutation, from the conservation of energy and of both components of L
    # (Goldstein, sec. 5.7: roots of the cubic f(u)).
    cosines = nutation_limits((I1, i3), WEIGHT, math.radians(controls["tilt"]), spin)
    limits = np.degrees(np.arccos(cosines[:2]))
    values = time[0], time[0] + 4.0, 0.0, min(1.2 * limits[0], 180.0)
    draw.chart(pen, _STRIP, values, _T, _DEGREES, _TILTS, 4, 4)
    for k in range(2):
        draw.theory(pen, np.array([0.0, 1e4]), np.full(2, limits[k]))
    # Rounding may take the axis' height just beyond 1, where the arc cosine is not defined.
    draw.curve(pen, time, np.degrees(np.arccos(np.clip(path[2], -1.0, 1.0))), draw.BLUE, 2.0)
    # Green above the critical spin: a sleeping top that stands upright is stable there.
    ink = draw.GREEN if spin > critical(i3) else draw.ORANGE
    draw.gauge(pen, _BAR, 120.0, spin, ink, _SPIN, critical(i3), _CRITICAL)
    draw.number(pen, critical(i3), 1)
    draw.window(pen)
    draw.key(pen, 0.2, 4.75, _TORQUE, draw.RED, 3.0)
    draw.key(pen, 3.9, 4.75, _FALLS, draw.GREEN, 3.0)
    draw.theory_key(pen, 7.3, 4.75, _LIMIT)
    # The gyroscopic term of Euler's equations: zero with equal moments, although the top still
    # stands.
    term = cross(omega, inertia * omega)
    # Precession: signed angles between successive horizontal projections of the axis, summed; small
    # steps need no unwrapping.
    (a, b), (x, y) = path[:2, :-1], path[:2, 1:]
    turned = np.sum(np.arctan2(a * y - b * x, a * x + b * y))
    draw.reading(pen, _TIME, STEP * state["steps"], 2, _S)
    draw.reading(pen, _TURNS, turned / max(time[-1] - time[0], 1e-9), 2, _RATE)
    # Fast-top theory, m g l / (I3 ω3); a spin near zero is bounded, as the formula diverges there.
    draw.reading(pen, _STEADY, WEIGHT / (i3 * max(spin, 1.0)), 2, _RATE)
    draw.reading(pen, _TERM, math.sqrt(np.sum(term * term)), 3, _NM)
    draw.reading(pen, _ENERGY, top_energy(q, omega, np.array([I1, I1, i3, WEIGHT])), 4, _J)


PRESETS = {
    "A fast top": Preset(
        {},
        "The torque of the weight points sideways, and L follows it. The axis nods. "
        "Fast-top theory, m g l over I3 ω, leaves out what the circling itself adds to L, and "
        "comes out too slow; with more spin the two meet.",
    ),
    "Equal moments: still it stands": Preset(
        {"moments": 1, "spin": 60.0},
        "With I1 = I3 the gyroscopic term ω × I ω is zero, and the top stands. Not the term holds "
        "it, L does.",
    ),
    "Upright, 5 % too slow": Preset(
        {"spin": 67.0, "tilt": 1.0}, "Below it the top falls far aside, rises, and repeats."
    ),
    "Upright, 6 % above": Preset({"spin": 75.0, "tilt": 1.0}, "Above it the axis stays near."),
    "No spin": Preset({"spin": 0.0}, "Without spin there is no L to turn, and L grows sideways."),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "time": "Simulated time since the start.",
    "turns at": "Measured rate of precession: how fast the axis goes round the vertical.",
    "fast-top theory": "Rate of precession of a fast top: torque divided by spin angular momentum.",
    "ω × I ω": "Magnitude of the gyroscopic term of Euler's equations.",
    "energy": (
        "Kinetic plus potential energy. It is constant apart from the error of the integrator."
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
