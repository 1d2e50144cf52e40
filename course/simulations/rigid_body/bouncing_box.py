"""Chapter 1's simulation: a box falls, tumbles and bounces, and its energy is watched.

The physics is that of `course.rigid_body.planar`; here is what can be set, how a state becomes a
picture and numbers, and the presets that show one failure each.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.rigid_body.integrators import INTEGRATORS, STANDARD_GRAVITY
from course.rigid_body.planar import FLIGHT_COEFFICIENT, box_parameters, step_boxes_loop
from course.rigid_body.planar_contact import flight
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider, switch

MASS, WIDTH, HEIGHT = 1.0, 0.6, 0.4  # of the box [kg, m, m]
_BOX = box_parameters(MASS, WIDTH, HEIGHT)
_INERTIA = float(_BOX[3, 0])
_RADIUS = 0.5 * math.hypot(WIDTH, HEIGHT)

MENU = {INTEGRATORS[name].label: name for name in FLIGHT_COEFFICIENT}
_COEFFICIENTS = tuple(FLIGHT_COEFFICIENT[name] for name in MENU.values())

TUMBLING = (0.0, 2.5, -0.35, -0.5, 0.0, 1.0)
FLAT = (0.0, 2.5, 0.0, 0.5, 0.0, 0.0)

CONTROLS = Record(
    gravity=slider("Gravity", round(STANDARD_GRAVITY, 1), 0.0, 20.0, 0.1, "m/s²", 1),
    restitution=slider("Restitution", 0.70, 0.0, 1.0, 0.01),
    timestep=slider("Timestep", 2.0, 0.5, 50.0, 0.5, "ms", 1),
    friction=slider("Friction", 0.5, 0.0, 2.0, 0.05),
    rest_speed=slider("Rest speed", 0.01, 0.0, 0.2, 0.01, "m/s"),
    integrator=menu("Integrator", tuple(MENU), 1),
    resolve_impacts=switch("find impact times within the step", True),
    start=Field(TUMBLING),  # x, y, angle, vx, vy, omega [m, rad, m/s, rad/s]
)

_MOST = 64  # impacts that are followed within one step
_PREVIEW = 3.0  # how much of the motion ahead is drawn [s]
_SAMPLE = 0.01  # time between two points of a path, rounded to whole steps [s]
_MEMORY = 10.0  # how much of the energy's past is shown [s]
_POINTS, _PAST = 480, 1600  # room for both: a rounded sample is at least 2/3 of _SAMPLE

STATE = Record(
    box=Field(0.0, shape=(6, 1)),  # x, y, angle, vx, vy, omega
    steps=Field(0),
    owed=Field(0.0, unit="s"),  # time that is less than a step and was not yet made
    impacts=Field(0),
    unresolved=Field(0),  # steps with more than _MOST impacts
    deepest=Field(0.0, unit="m"),  # of a corner in the ground at the end of a step
    peak=Field(0.0, unit="m"),  # greatest height of the centre so far
    energy=Field(0.0, unit="J"),  # at the start
    # Time, kinetic, potential and total energy of the samples.
    history=Field(0.0, shape=(4, 2 * _PAST)),
    samples=Field(0),
    # The motion from the start, and the same drop computed well: time, box, total energy.
    path=Field(0.0, shape=(8, _POINTS)),
    path_points=Field(0),
    good=Field(0.0, shape=(8, _POINTS)),
    good_points=Field(0),
)


@register_jitable
def energies(box, gravity):
    """Return kinetic, potential and total energy [J] of states (6,) or (6, M)."""
    kinetic = 0.5 * MASS * (box[3] ** 2 + box[4] ** 2) + 0.5 * _INERTIA * box[5] ** 2
    potential = MASS * gravity * box[1]
    return kinetic, potential, kinetic + potential


@register_jitable
def _reach(angle):
    """Return how far the box reaches below its centre [m]."""
    return 0.5 * (WIDTH * abs(math.sin(angle)) + HEIGHT * abs(math.cos(angle)))


@register_jitable
def _method(controls):
    """Return step [s], flight coefficient, whether impacts are resolved, rest speed [m/s]."""
    coefficient = _COEFFICIENTS[controls["integrator"]]
    resolve = controls["resolve_impacts"] != 0
    return 1e-3 * controls["timestep"], coefficient, resolve, controls["rest_speed"]


@register_jitable
def _run(box, controls, how, steps):
    """Advance the box (6, 1) in place; impacts, and steps that were not resolved."""
    dt, coefficient, resolve, rest_speed = how
    parameters = _BOX.copy()
    parameters[4, 0] = controls["restitution"]
    parameters[5, 0] = controls["friction"]
    parameters[6, 0] = rest_speed
    counts = np.zeros((2, 1), np.int64)
    step_boxes_loop(
        box,
        counts,
        box,
        parameters,
        np.zeros((3, 1)),
        0.0,
        -controls["gravity"],
        dt,
        steps,
        coefficient,
        resolve,
        True,
        _MOST,
    )
    return counts[0, 0], counts[1, 0]


@register_jitable
def _trace(path, start, controls, how):
    """Write the motion from the start (6, 1) into `path`; how many points there are."""
    dt, box = how[0], start.copy()
    path[0, 0] = 0.0
    path[1:7, 0] = box[:, 0]
    # Points in whole steps close to _SAMPLE, so that every point is a state that the method
    # computed.
    number = max(1, math.floor(_SAMPLE / dt + 0.5))
    end = max(1, math.floor(_PREVIEW / dt + 1e-9))
    steps, n = 0, 1
    while steps < end:
        # In flight, clear of the ground, a smooth curve needs fewer points: no corner can touch
        # while the centre, after an upper bound of its fall, is above the half diagonal.
        leap = 4 * number * dt
        fall = leap * (max(-box[4, 0], 0.0) + leap * controls["gravity"])
        count = 4 * number if box[1, 0] - fall > _RADIUS else number
        _run(box, controls, how, count)
        steps += count
        path[0, n] = steps * dt
        path[1:7, n] = box[:, 0]
        n += 1
    path[7, :n] = energies(path[1:7, :n], controls["gravity"])[2]
    return n


def initial(controls, state):
    """Set up the box at its start, but not in the ground, and the motion ahead of it."""
    box = state["box"]
    box[:, 0] = controls["start"]
    # A box that was dragged into the ground is lifted until its lowest corner touches it.
    box[1, 0] = max(box[1, 0], _reach(box[2, 0]))
    now = energies(box[:, 0], controls["gravity"])
    state["energy"], state["peak"] = now[2], box[1, 0]
    state["history"][1:, 0] = now
    state["samples"] = 1
    state["path_points"] = _trace(state["path"], box, controls, _method(controls))
    # Exact flight, impacts located within the step, short steps.
    rest = min(controls["rest_speed"], 0.01) or 0.01
    state["good_points"] = _trace(state["good"], box, controls, (5e-4, 0.5, True, rest))


def advance(state, controls, seconds):
    """Advance the simulation: as many whole steps as fit into the time; the rest is owed."""
    gravity, how = controls["gravity"], _method(controls)
    dt, coefficient, resolve, _ = how
    box, history = state["box"], state["history"]
    count = math.floor((state["owed"] + seconds) / dt + 1e-9)
    state["owed"] = max(state["owed"] + seconds - count * dt, 0.0)
    # Energies are sampled at whole steps, so the loop advances from one sample to the next.
    sample = max(1, math.floor(_SAMPLE / dt + 0.5))
    steps = state["steps"]
    end = steps + count
    while steps < end:
        number = min(sample - steps % sample, end - steps)
        # Without event location the box may sink in during a step; only where it may touch at all,
        # its depth is computed before the solver pushes it out.
        if not resolve:
            reach = number * dt * (abs(box[4, 0]) + number * dt * gravity)
            if box[1, 0] - reach < _RADIUS:
                number = 1  # step by step, to see how deep it gets before it is pushed out
                y = flight(box[1, 0], box[4, 0], -gravity, dt, coefficient)
                deep = _reach(box[2, 0] + dt * box[5, 0]) - y
                state["deepest"] = max(state["deepest"], deep)
        impacts, unresolved = _run(box, controls, how, number)
        state["impacts"] += impacts
        state["unresolved"] += unresolved
        state["peak"] = max(state["peak"], box[1, 0])
        steps += number
        if steps % sample == 0:
            state["samples"] = n = draw.remember(history, state["samples"], steps * dt)
            history[1:, n - 1] = energies(box[:, 0], gravity)
    state["steps"] = steps


TITLE = "Rigid body simulator: bouncing box"
word, colour = draw.words_table(), draw.colours_table()
_GROUND, _EARTH, _SKIN = colour("#ece7df", "#8c7a5c", "#f4b183")
_INTEGRATOR, _ENERGY = word(*MENU)[0], word("kinetic", "potential", "total")[0]
_M, _J, _S, _MM, _MS, _PERCENT, _DASH = word(" m", " J", " s", " mm", " ms", " %", "\N{EN DASH}")
_COMMA, _FOUND, _LATE = word(", ", ", impacts located in the step", ", impacts at its end")
_THIS, _FINE = word("path with these settings, 3 s", "the same box computed finely")
(_VELOCITY,) = word("velocity")
_X, _Y, _T, _E = word("x [m]", "height [m]", "time [s]", "energy [J]")
_NOW, _OVER_TIME = word("energy now (dotted: start)", "energy over time")
_TIME, _CHANGE, _HEIGHT, _HIGHEST = word("time", "energy change", "height", "highest so far")
_IMPACTS, _UNRESOLVED, _DEEPEST = word("impacts", "steps not resolved", "deepest in ground")

# In units of the window, not metres.
_SCENE, _BARS, _STRIP = (0.62, 5.42, 0.62, 4.62), (6.4, 8.82, 2.98, 4.62), (6.4, 8.82, 0.62, 2.22)
_METRES = 0.8  # per unit of the window, before zooming out


@register_jitable
def scene(state):
    """Return what the scene shows [m]: zooms out in powers of two, follows the box sideways."""
    wide, high = _METRES * (_SCENE[1] - _SCENE[0]), _METRES * (_SCENE[3] - _SCENE[2])
    # The peaks so far and of the preview decide the zoom, so that it does not change while the box
    # falls.
    top = max(state["peak"], state["path"][2, : state["path_points"]].max()) + _RADIUS
    zoom = 2.0 ** max(0.0, math.ceil(math.log2(top / (high - 0.25))))
    wide, high = zoom * wide, zoom * high
    x = state["box"][0, 0]
    # The view moves only when the box comes near its sides, and starts a quarter left of the
    # origin.
    remaining = min(max(-0.25 * wide, x - 0.85 * wide), x - 0.15 * wide)
    return remaining, remaining + wide, -0.2 * zoom, high - 0.2 * zoom


@register_jitable
def _corners(pen, x, y, angle):
    """Return the corners of the box; the middle of its right side."""
    c, s = 0.5 * math.cos(angle), 0.5 * math.sin(angle)
    for a, b in ((-WIDTH, -HEIGHT), (WIDTH, -HEIGHT), (WIDTH, HEIGHT), (-WIDTH, HEIGHT)):
        draw.point(pen, x + c * a - s * b, y + s * a + c * b)
    return x + c * WIDTH, y + s * WIDTH


@register_jitable
def _world(pen, state, controls):
    """Draw the box, its path and the ground."""
    left, right, bottom, top = scene(state)
    path, n = state["path"], state["path_points"]
    good, m = state["good"], state["good_points"]
    draw.area(pen, _SCENE, (left, right, bottom, top))
    draw.box(pen, left, right, bottom, 0.0, _GROUND)
    draw.axes(pen, _X, _Y)
    draw.segment(pen, left, 0.0, right, 0.0, _EARTH, 2.0)
    # Dashed: the reference with fine steps. Blue: the preview with the chosen settings and method.
    draw.line(pen, draw.INK, 1.4, 0.75, 5.0, 4.0)
    draw.points(pen, good[1, :m], good[2, :m])
    draw.line(pen, draw.BLUE, 2.0, 0.55)
    draw.points(pen, path[1, :n], path[2, :n])
    # Ghosts of the box at quarters of a second; a coarse path may have one point for two of them.
    before = -1
    for quarter in range(1, 12):
        k = int(np.searchsorted(path[0, :n], 0.25 * quarter))
        if k != before and k < n:
            draw.polygon(pen, draw.NONE, draw.BLUE, 1.0, 0.22)
            _corners(pen, path[1, k], path[2, k], path[3, k])
        before = k
    box = state["box"][:, 0]
    x, y = box[0], box[1]
    draw.polygon(pen, _SKIN, draw.ORANGE, 2.0, 0.95)
    # A line from the centre to the middle of one side shows how the box turns.
    side_x, side_y = _corners(pen, x, y, box[2])
    draw.segment(pen, x, y, side_x, side_y, draw.ORANGE)
    unit = (right - left) / (_SCENE[1] - _SCENE[0])
    draw.disc(pen, 0.035 * unit, draw.ORANGE)
    draw.point(pen, x, y)
    # The velocity's tip stays within the scene; an arrow hardly longer than its head is omitted.
    tip_x = min(max(x + 0.12 * box[3], left), right)
    tip_y = min(max(y + 0.12 * box[4], bottom), top)
    if math.hypot(tip_x - x, tip_y - y) > 0.15 * unit:
        draw.arrow(pen, x, y, tip_x, tip_y, draw.INK, 1.8)
    draw.window(pen)
    x, y = _SCENE[1] - 2.55, _SCENE[3] - 0.12
    draw.key(pen, x, y, _THIS, draw.BLUE, 2.0, 0.7)
    draw.key(pen, x, y - 0.2, _FINE, draw.INK, 2.0, 0.7, 5.0, 4.0)
    draw.key(pen, x, y - 0.4, _VELOCITY, draw.INK, 1.8)
    draw.arrow(pen, x, y - 0.4, x + 0.3, y - 0.4, draw.INK, 1.8)
    draw.title(pen, _SCENE[0], _SCENE[3], _INTEGRATOR + controls["integrator"])
    draw.words(pen, _COMMA)
    step = controls["timestep"]
    draw.number(pen, step, 0 if step == math.floor(step) else 1, _MS)
    draw.words(pen, _FOUND if controls["resolve_impacts"] != 0 else _LATE)


@register_jitable
def _energies(pen, state, controls, first):
    """Draw the energies now as bars, and over time from the sample `first` on."""
    past, end = state["history"], state["samples"]
    path, n = state["path"], state["path_points"]
    start = state["energy"]
    # One scale for both charts, over what is shown and what is to come, so that gains of energy fit
    # in.
    highest = max(start, past[3, first:end].max(), path[7, :n].max())
    top = 1.18 * highest if highest > 1e-9 else 1.0
    draw.area(pen, _BARS, (0.0, 3.0, 0.0, top))
    draw.axes(pen, 0, _E, _NOW, 0, 4)
    now = energies(state["box"][:, 0], controls["gravity"])
    for k in range(3):
        draw.box(pen, k + 0.2, k + 0.8, 0.0, now[k], _COLOURS[k])
        draw.text(pen, k + 0.5, 0.0, _ENERGY + k, draw.INK, 12.0, draw.CENTRE, draw.TOP, 0.0, -5.0)
        draw.text(pen, k + 0.5, now[k], 0, draw.INK, 12.0, draw.CENTRE, draw.BOTTOM, 0.0, 2.0)
        draw.number(pen, now[k], 1)
    # The energy at the start: what a conservative method would keep when impacts are elastic.
    draw.segment(pen, 0.0, start, 3.0, start, draw.GREY, 1.2, 1.0, 2.0, 3.0)
    begin = max(0.0, past[0, end - 1] - _MEMORY)
    draw.area(pen, _STRIP, (begin, begin + _MEMORY, 0.0, top))
    draw.axes(pen, _T, _E, _OVER_TIME, 5, 4)
    draw.segment(pen, begin, start, begin + _MEMORY, start, draw.GREY, 1.2, 1.0, 2.0, 3.0)
    # The predicted total energy in pale green, the measured ones in full colours over it.
    draw.line(pen, draw.GREEN, 2.0, 0.3)
    draw.points(pen, path[0, :n], path[7, :n])
    for k in range(3):
        draw.line(pen, _COLOURS[k], 2.2 if k == 2 else 1.2)
        draw.points(pen, past[0, first:end], past[k + 1, first:end])
    draw.window(pen)


_COLOURS = (draw.RED, draw.BLUE, draw.GREEN)


def frame(pen, state, controls):
    """Draw the box in its world, its energy as bars and over time; the numbers."""
    past, end = state["history"], state["samples"]
    _world(pen, state, controls)
    # Binary search for the oldest sample in the window; the subtracted term absorbs rounding.
    first = np.searchsorted(past[0, :end], past[0, end - 1] - _MEMORY - 1e-9)
    _energies(pen, state, controls, first)
    draw.segment(pen, 5.72, 0.2, 5.72, 4.85, draw.FAINT, 1.0)
    draw.reading(pen, _TIME, 1e-3 * controls["timestep"] * state["steps"], 3, _S)
    now = energies(state["box"][:, 0], controls["gravity"])
    for k in range(3):
        draw.reading(pen, _ENERGY + k, now[k], 3, _J)
    draw.readout(pen, _CHANGE)
    # A relative change needs an energy to compare with: without gravity a box at rest has none.
    if state["energy"] > 1e-9:
        draw.number(pen, 100.0 * (now[2] / state["energy"] - 1.0), draw.SIGNED + 2, _PERCENT)
    else:
        draw.words(pen, _DASH)
    draw.reading(pen, _HEIGHT, state["box"][1, 0], 3, _M)
    draw.reading(pen, _HIGHEST, state["peak"], 3, _M)
    draw.reading(pen, _IMPACTS, state["impacts"], 0)
    draw.reading(pen, _UNRESOLVED, state["unresolved"], 0)
    draw.reading(pen, _DEEPEST, 1e3 * state["deepest"], 1, _MM)


def drag(controls, state, x, y):
    """Drop the box from where the pointer is; it stays above the ground."""
    x, y = draw.values_at(_SCENE, scene(state), x, y)
    controls["start"][0] = x
    # Above the half diagonal no corner is in the ground, whatever the angle.
    controls["start"][1] = min(max(y, _RADIUS), 50.0)


_ELASTIC = {"restitution": 1.0, "friction": 0.0, "timestep": 20.0}

PRESETS = {
    "Default drop": Preset(
        {},
        "Semi-implicit Euler: each step changes the speed first, then moves the box with the new "
        "one. Every bounce takes energy. Drag the box to drop it from "
        "elsewhere. The dashed path is the same box computed with exact flight and short steps: "
        "after a few tumbling bounces the smallest error sends it elsewhere.",
    ),
    "Explicit Euler gains energy": Preset(
        _ELASTIC | {"integrator": "explicit Euler"},
        "Nothing takes or gives energy here, and impacts are located within the step. Each step of "
        "flight adds m g² h²/2: the box bounces higher and higher.",
    ),
    "Semi-implicit Euler, bouncing": Preset(
        _ELASTIC | {"integrator": "semi-implicit Euler"},
        "The same drop with the order of two lines swapped. In flight the same m g² h²/2 is now "
        "taken at every step. Being symplectic, the method conserves a nearby energy exactly in "
        "flight: m g y + m v²/2 - m g h v/2. An impact turns v around, and with it the last term: "
        "each bounce lowers that energy.",
    ),
    "Exact flight, late impacts": Preset(
        _ELASTIC | {"integrator": "RK4", "resolve_impacts": False},
        "Fourth order and exact in flight. But an impact is noticed only at the end of a step, "
        "and pushing the box out of the ground lifts it: energy jumps up at bounces. A better "
        "integrator does not help, finding the impact time does.",
    ),
    "50 ms steps: deep in the ground": Preset(
        {"timestep": 50.0, "resolve_impacts": False, "start": FLAT},
        "At the end of a step the box is found far inside the ground, then it is pushed out. "
        "It is 0.4 m high and falls at most 0.34 m in a step, so it would not miss a thin floor "
        "either. A thinner box could be above such a floor at one step and below it at the next: "
        "tunnelling.",
    ),
    "Late impacts: never at rest": Preset(
        {"timestep": 20.0, "resolve_impacts": False},
        "Lying on the ground the box falls g h in every step, is found below the ground and "
        "bounces. Impacts go on for ever and it trembles instead of resting.",
    ),
    "No rest speed: endless impacts": Preset(
        {"rest_speed": 0.0},
        "With semi-implicit Euler a hop within one step comes back to the ground without speed, "
        f"so impact follows impact, until the {_MOST} impacts that are followed in one step are "
        "used up. Try velocity Verlet, whose flight is exact: here most drops come to rest, with "
        "a restitution of 0.4 most do not.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "time": "Simulated time since the box was released.",
    "kinetic": "Kinetic energy of the box, translation and rotation together.",
    "potential": "Potential energy of the box in gravity, zero at the ground.",
    "total": "Kinetic plus potential energy.",
    "energy change": (
        "Change of the total energy since the start, as a fraction of the energy at the start."
    ),
    "height": "Height of the box's centre above the ground.",
    "highest so far": "Largest height of the centre since the start.",
    "impacts": "Number of impacts with the ground so far.",
    "steps not resolved": (
        "Steps that contained more impacts than the integrator resolves in one step."
    ),
    "deepest in ground": "Largest penetration of a corner into the ground so far.",
}

MODEL = Model(
    TITLE,
    draw.Paper(TITLE, word, colour),
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    drag,
    readouts=READOUTS,
)
