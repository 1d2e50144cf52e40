"""A probe that touches a wall: impedance, force control and admittance, the set-point dragged."""

import math

import numba
import numpy as np
from numba.extending import register_jitable

from course.compiled import VECTOR, loop
from course.control import sampled
from course.control import touch as chapter
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

MASS, FRICTION, DT = 4.0, 20.0, 1e-3  # of the arm along the normal [kg], [N s/m]; sample time [s]
SPEED, FAR, FORCE = 0.1, 0.03, 10.0  # of the set-point [m/s], where it starts [m]; wanted [N]
INNER = (4e4, 800.0)  # stiffness and damping under the virtual body of admittance
_N, _GONE = 1500, 0.5  # samples of a run; how far off is not followed any more [m]
IMPEDANCE, PRESSES, ADMITTANCE = range(3)

CONTROLS = Record(
    controller=menu("Controller", ("impedance", "force", "admittance")),
    stiffness=slider("Stiffness K", 500.0, 0.0, 20000.0, 100.0, "N/m", 0),
    damping=slider("Damping B", 90.0, 0.0, 1000.0, 10.0, "N s/m", 0),
    gain=slider("Gain on the force", 0.3, 0.0, 2.0, 0.01),
    mass=slider("Virtual mass", 8.0, 0.1, 10.0, 0.1, "kg", 1),
    wall=slider("Wall, power of ten", 4.0, 2.0, 6.0, 0.1, "N/m", 1),
    delay=slider("Delay", 2.0, 0.0, 20.0, 0.5, "ms", 1),
    aim=Field(0.02, low=-FAR, high=0.04, unit="m"),
)
STATE = Record(
    time=Field(0.0, unit="s"),
    samples=Field(0),
    run=Field(0.0, shape=(3, _N + 1)),  # place, force on the wall, place wanted [m, N, m]
    growth=Field(0.0),  # a sample, in contact
)


def growth(law, wall, delay):
    """Return growth per sample of a law (7,) while the probe touches."""
    # The wall is a spring in the plant's transition matrix, so this describes lasting contact only.
    whole = math.floor(delay / DT + 1e-9)
    plant = chapter.held_mass(MASS, FRICTION, wall, DT, max(0.0, delay - whole * DT))
    linear = chapter._linear(law, wall, 0.0, DT)
    return sampled.growth_by_squares(sampled._closed(*plant, whole, *linear))


_growth = loop(growth, numba.float64(VECTOR, numba.float64, numba.float64))


def warm() -> None:
    """Compile, or load from the cache, what the model calls from Python."""
    _growth(np.zeros(7), 0.0, 0.0)


@register_jitable
def law_of(controls):
    """Return the law as the chapter's loop takes it: `course.control.TouchLaw.numbers`."""
    K, B = controls["stiffness"], controls["damping"]
    if controls["controller"] == IMPEDANCE:
        return np.array([K, B, 0.0, 0.0, 0.0, 0.0, 0.0])
    if controls["controller"] == PRESSES:
        return np.array([0.0, B, FORCE, controls["gain"], 0.0, 0.0, 0.0])
    return np.array([INNER[0], INNER[1], 0.0, 0.0, controls["mass"], B, K])


@register_jitable
def expected(controls):
    """Return the steady force: two springs in series, or what is asked for."""
    if controls["controller"] == PRESSES:
        return FORCE
    # At rest the controller's spring and the wall's carry one force: stiffnesses in series.
    K, wall = controls["stiffness"], 10.0 ** controls["wall"]
    return max(controls["aim"], 0.0) * K * wall / (K + wall)


def initial(controls, state):
    """Compute the whole run: the set-point goes to its place.

    A force law begins where it touches.
    """
    law, wall, late = law_of(controls), 10.0 ** controls["wall"], 1e-3 * controls["delay"]
    # Motion laws approach from free space; a force law starts at the surface, since it would
    # accelerate without bound before it.
    start = np.zeros(2)
    if controls["controller"] != PRESSES:
        start[0] = -FAR
    desired = np.minimum(SPEED * DT * np.arange(_N) - FAR, controls["aim"])
    # Whole samples of the delay queue commands; the rest shifts a command within its sample.
    whole = math.floor(late / DT + 1e-9)
    body, out = np.array([MASS, FRICTION, wall, 0.0, 0.0]), np.zeros((5, _N + 1))
    chapter._touch_loop(
        body, law, DT, whole, max(0.0, late - whole * DT), start, desired, np.zeros(_N), out
    )
    # The run ends before the first sample that is far away or NaN: an unstable contact has thrown
    # the probe off.
    lost = np.flatnonzero(~(np.abs(out[0]) < _GONE))
    n = lost[0] - 1 if lost.size else _N
    state["samples"] = n
    for row, retained in ((0, 0), (1, 2), (2, 4)):
        state["run"][row, : n + 1] = out[retained, : n + 1]
    state["run"][2, n] = state["run"][2, n - 1]
    state["growth"] = _growth(law, wall, late)


def advance(state, controls, seconds):
    """Advance the simulation: the probe goes on along its run, to the end of it."""
    state["time"] = min(state["time"] + seconds, DT * state["samples"])


TITLE = "A probe that touches a wall"
word, colour = draw.words_table(), draw.colours_table()
_WALL, _TIP = colour("#d9d4ca", "#cfe3f2")
_TIME, _PLACE, _PUSH, _WANTED, _SERIES = word(
    "time [s]", "place [mm]", "force on the wall [N]", "set-point: drag it", "expected at rest"
)
_PEAK, _REST, _GROWTH, _HOLDS, _N_, _PER_M = word(
    "largest force", "force at the end", "growth a sample", "in contact", " N", " N/m"
)
_KEEPS, _GROWS, _GAIN, _STIFF = word("stable", "unstable", "limit of the gain", "limit of K, B = 0")
_SCENE, _LEFT, _RIGHT = (0.3, 8.8, 3.75, 4.6), (0.9, 4.3, 0.6, 3.1), (5.4, 8.8, 0.6, 3.1)
_VIEW = (-40.0, 50.0, -4.5, 4.5)  # mm


def frame(pen, state, controls):
    """Probe and wall now; place and force over the whole run; what theory says."""
    n, run, seconds = state["samples"], state["run"], DT * _N
    at, aim = min(int(state["time"] / DT + 1e-9), n), 1000.0 * controls["aim"]
    # Position of the probe in mm; the wall starts at 0.
    x = 1000.0 * run[0, at]
    draw.area(pen, _SCENE, _VIEW)
    draw.box(pen, 0.0, 50.0, -4.5, 4.5, _WALL, draw.INK)
    if controls["controller"] != PRESSES:
        draw.segment(pen, aim, -4.5, aim, 4.5, draw.GREEN, 3.0, 1.0, 5.0, 4.0)
    draw.box(pen, x - 9.0, x - 3.0, -2.2, 2.2, _TIP, draw.BLUE)
    draw.segment(pen, x - 3.0, 0.0, x, 0.0, draw.BLUE, 5.0)
    # The wall's force as an arrow, limited so that it stays in the picture.
    push = run[1, at]
    if push > 0.0:
        draw.arrow(pen, x, 0.0, x - min(0.8 * push, 30.0), 0.0, draw.ORANGE, 3.0)
    draw.window(pen)
    draw.key(pen, 0.35, 4.8, _WANTED, draw.GREEN, 3.0, 1.0, 5.0, 4.0)
    draw.theory_key(pen, 5.4, 3.4, _SERIES)
    times, force = DT * np.arange(n + 1), run[1, : n + 1]
    draw.chart(pen, _LEFT, (0.0, seconds, -1000.0 * FAR - 2.0, 45.0), _TIME, _PLACE, 0, 4, 5)
    draw.segment(pen, 0.0, 0.0, seconds, 0.0, draw.INK, 1.0)
    if controls["controller"] != PRESSES:
        draw.curve(pen, times, 1000.0 * run[2, : n + 1], draw.GREEN, 1.8, 1.0, 5.0, 4.0)
    draw.curve(pen, times, 1000.0 * run[0, : n + 1], draw.BLUE, 2.0)
    draw.spot(pen, DT * at, x, 0.02, draw.ORANGE, draw.INK)
    # The force in theory as a dashed line, for comparison with the end of the run; peaks of an
    # unstable contact above 400 N don't set the scale.
    rest = expected(controls)
    top = max(5.0, 1.15 * min(np.max(force), 400.0), 1.3 * rest)
    draw.chart(pen, _RIGHT, (0.0, seconds, 0.0, top), _TIME, _PUSH, 0, 4, 5)
    draw.theory(pen, np.array([0.0, seconds]), np.array([rest, rest]))
    draw.curve(pen, times, force, draw.ORANGE, 1.6)
    draw.segment(pen, DT * at, 0.0, DT * at, top, draw.GREY, 1.0)
    draw.window(pen)
    draw.reading(pen, _PEAK, np.max(force), 1, _N_)
    draw.reading(pen, _REST, force[n], 1, _N_)
    draw.reading(pen, _GROWTH, state["growth"], 5)
    draw.reading(pen, _HOLDS, 0.0, 0, 0, _GROWS if state["growth"] > sampled.STABLE else _KEEPS)
    # A hold acts like half a sample of further delay. Virtual stiffness times this delay uses up
    # the damping of the arm (Colgate and Schenkel, 1997): K < b / (T / 2 + delay).
    late = 1e-3 * controls["delay"] + 0.5 * DT
    if controls["controller"] == IMPEDANCE:
        draw.reading(pen, _STIFF, FRICTION / late, 0, _PER_M)
    # The same limit for a proportional force law, whose loop sees gain times wall stiffness.
    elif controls["controller"] == PRESSES:
        draw.reading(pen, _GAIN, FRICTION / 10.0 ** controls["wall"] / late, 3)


def drag(controls, state, x, y):
    """Handle a drag: the set-point is where the pointer is."""
    to, _ = draw.values_at(_SCENE, _VIEW, x, y)
    controls["aim"] = min(max(1e-3 * to, -FAR), 0.04)


_PASSIVE = sampled.passive_stiffness(FRICTION, DT, 2e-3)
_FORCE = sampled.force_limit(FRICTION, 1e4, 2.5e-3)
PRESETS = {
    "Drag it into the wall": Preset(
        {},
        "A soft impedance controller. Drag the dashed set-point deeper: the force is that of "
        "two springs in series, the controller's and the wall's.",
    ),
    "Stiff": Preset(
        {"stiffness": 4000.0, "damping": 250.0},
        "The set-point is two centimetres in the wall. Eight times the stiffness gives six "
        "times the force.",
    ),
    "B = 2 sqrt(K M)": Preset(
        {"stiffness": 100.0, "damping": 40.0, "wall": 5.0},
        "Critical damping in free space. In contact the wall's stiffness adds to K, and the "
        "hand vibrates.",
    ),
    "Stiff by friction alone": Preset(
        {"stiffness": 0.95 * _PASSIVE, "damping": 0.0},
        "Up to K = 2 b/(dt + 2 D) the arm's own friction keeps it stable at any passive wall.",
    ),
    "A little stiffer": Preset(
        {"stiffness": 1.1 * _PASSIVE, "damping": 0.0},
        "Above that limit it is unstable at this wall. Now raise B, slowly.",
    ),
    "Too much damping": Preset(
        {"damping": 1000.0, "delay": 7.0},
        "Damping that comes late makes the oscillation grow. Lower B.",
    ),
    "Force": Preset(
        {"controller": PRESSES, "damping": 0.0, "gain": 0.8 * _FORCE},
        "The wall's stiffness multiplies the gain, and only friction damps the loop. Make the "
        "wall stiffer.",
    ),
    "Force, too much gain": Preset(
        {"controller": PRESSES, "damping": 0.0, "gain": 1.15 * _FORCE},
        "The gain is above b/(ke (D + dt/2)): unstable. Lower it.",
    ),
    "Admittance": Preset(
        {"controller": ADMITTANCE, "damping": 300.0},
        "The measured force moves a virtual mass on a spring, and a stiff inner loop follows "
        "that motion.",
    ),
    "Admittance, too light": Preset(
        {"controller": ADMITTANCE, "damping": 20.0, "mass": 0.5, "wall": 5.0},
        "A stiffer wall needs a heavier virtual mass or more damping. Raise one of them.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "largest force": "Largest contact force of the run.",
    "force at the end": "Contact force at the end of the run.",
    "growth a sample": "Spectral radius of the loop in contact: above 1 it is unstable.",
    "in contact": "Whether the loop is stable while the probe touches the wall.",
    "limit of K, B = 0": "Largest stiffness of the controller that is stable without damping.",
    "limit of the gain": "Largest gain of the force controller that is stable on this wall.",
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
    readouts=READOUTS,
    upright=False,
)
