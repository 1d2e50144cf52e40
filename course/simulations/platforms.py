"""One scene on several simulators: paths over each other, errors and costs, and five numbers.

Another library has to come along for every path, so all of them are on record
(`course.platforms.recorded`), as `course.charts.platforms.record` ran them. Five scenes, four
steps, both settings; a click on a card puts its simulator in front.
"""

import itertools
import math

import numpy as np
from numba.extending import register_jitable

from course.platforms.recorded import recorded
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, switch

_FOUND = recorded()
PATHS, TRUTH, ERRORS, COSTS = _FOUND.paths, _FOUND.truth, _FOUND.errors, _FOUND.costs
TOLERANCE, DURATION, STEPS, RADAR = _FOUND.tolerance, _FOUND.duration, _FOUND.steps, _FOUND.radar
ENGINES = len(_FOUND.engines)
TUMBLE, CHAIN, BRAKE, TOWER, GRASP = range(5)
SCENES = ("free tumble", "chain of six", "braking block", "tower of five", "grasp")
CARDS = (*_FOUND.engines, "Isaac Sim")
# Orders of the five axes: as in the text, and the one in which the areas add up to most.
_TURNED = np.array([(0, *rest) for rest in itertools.permutations(range(1, 5))])
# The area of a radar chart depends on the order of its axes: all 24 orders are compared.
_HEIGHTS = RADAR[:, _TURNED, 1]
_SUMS = np.sum(_HEIGHTS * np.roll(_HEIGHTS, -1, axis=2), axis=(0, 2))
ORDERS = np.array([_TURNED[0], _TURNED[np.argmax(_SUMS)]])

CONTROLS = Record(
    scene=menu("Scene", SCENES, CHAIN),
    step=menu("Step", tuple(f"{1e3 * dt:g} ms" for dt in STEPS), 1, live=True),
    fair=switch("fair settings", True, live=True),
    card=menu("Card", CARDS, 1, live=True),
    reorder=switch("axes in another order", False, live=True),
)
STATE = Record(time=Field(0.0, unit="s"), clicked=Field((-1.0, -1.0)))

TITLE = "The same scene, side by side"
word, colour = draw.words_table(), draw.colours_table()
_CARDS = word(*CARDS)[0]
_X = word("x of its axis", "x of the tip [m]", "x [m]", "time [s]", "time [s]")[0]
_Y = word("y of its axis", "y of the tip [m]", "y [m]", "top cube [mm]", "part [mm]")[0]
_UNITS = word(" mrad", " mrad", " mm", " mm", " mm")[0]
_PLACES = word(" mrad", " mm", " mm", " mm", " mm")[0]
_AXES = word("smooth accuracy", "contact accuracy", "speed in contact", "largest step", "honesty")[
    0
]
_RADAR, _PATH, _TRUE, _TIMES, _OFF, _WITHIN, _BEYOND, _NOT_HERE = word(
    "five measured axes",
    "where it goes",
    "truth",
    " x MuJoCo",
    "off by ",
    "within",
    "beyond",
    "not measured here",
)
_ERROR, _ALLOWED, _VERDICT, _COST, _APART, _AREA, _S = word(
    "error at the end",
    "tolerance",
    "verdict",
    "cost of a step",
    "ends apart",
    "area of the five",
    " of 1",
)
_DOCUMENTED = word(
    "documented: PhysX or Newton, NVIDIA's card (its manual, 2026)",
    "not measured here",
)[0]
_PAPER, _FRONT = colour("#eef3f7", "#fbe3c8")
# As in the charts: MuJoCo is purple.
_INKS = np.array([draw.BLUE, draw.PURPLE, draw.GREEN, draw.ORANGE])
_LEFT, _BOTTOM, _WIDE, _HIGH, _GAP = 0.15, 4.3, 1.62, 0.62, 0.13  # of the cards
_AREA_OF = (0.85, 5.3, 0.75, 3.75)  # of the paths
_CENTRE, _RADIUS = (7.2, 2.15), 1.1  # of the five axes


def initial(controls, state):
    """Set up at the start of the paths."""
    state["time"] = 0.0


def advance(state, controls, seconds):
    """Advance the simulation.

    The paths are followed in their own time, and again after a moment.
    """
    state["time"] = (state["time"] + seconds) % (DURATION[controls["scene"]] + 1.0)


def drag(controls, state, x, y):
    """Handle a drag: the card that is nearest to the pointer comes in front."""
    place = int((x - _LEFT) / (_WIDE + _GAP)) if x > _LEFT else 0
    controls["card"] = min(place, len(CARDS) - 1)
    state["clicked"][0], state["clicked"][1] = min(max(x, 0.0), 9.0), min(max(y, 0.0), 5.0)


def press(controls, state, key):
    """Handle a key: arrow keys go from card to card."""
    controls["card"] = (controls["card"] + (1 if key in (1, 3, 4) else -1)) % len(CARDS)


@register_jitable
def area(heights):
    """Return share of a regular pentagon's area that five axes in turn enclose, (5,) -> [0, 1]."""
    # Triangles between neighbouring axes, relative to a pentagon with all heights 1.
    total = 0.0
    for k in range(5):
        total += heights[k] * heights[(k + 1) % 5] / 5.0
    return total


@register_jitable
def _limits(scene):
    """Return the limits of x and y.

    The truth and the paths with one step and both settings must fit, with a margin.
    """
    x, y = TRUTH[scene, :, 0], TRUTH[scene, :, 1]
    low_x, high_x = float(np.min(x)), float(np.max(x))
    low_y, high_y = float(np.min(y)), float(np.max(y))
    # The paths at one step with both settings decide the scale; others may leave the picture.
    for e in range(ENGINES):
        for k in range(2):
            path = PATHS[scene, 1, k, e]
            low_x, high_x = min(low_x, np.min(path[:, 0])), max(high_x, np.max(path[:, 0]))
            low_y, high_y = min(low_y, np.min(path[:, 1])), max(high_y, np.max(path[:, 1]))
    # A tower that falls or a part that is dropped would flatten the rest.
    if scene >= TOWER:
        low_y, high_y = max(low_y, -12.0), min(high_y, 3.0)
    dx, dy = 0.06 * (high_x - low_x), 0.1 * (high_y - low_y) + 1e-9
    low_x, high_x, low_y, high_y = low_x - dx, high_x + dx, low_y - dy, high_y + dy
    if scene < TOWER:
        # Both axes are lengths or shares: one scale for both, so that directions are true.
        left, right, bottom, top = _AREA_OF
        unit = max((high_x - low_x) / (right - left), (high_y - low_y) / (top - bottom))
        more_x = 0.5 * (unit * (right - left) - (high_x - low_x))
        more_y = 0.5 * (unit * (top - bottom) - (high_y - low_y))
        return low_x - more_x, high_x + more_x, low_y - more_y, high_y + more_y
    return low_x, high_x, low_y, high_y


@register_jitable
def _cards(pen, controls):
    """Draw a simulator each: its error in this scene, and what a step costs."""
    scene, step, fair = controls["scene"], controls["step"], controls["fair"]
    for k in range(len(CARDS)):
        x = _LEFT + k * (_WIDE + _GAP)
        front = k == controls["card"]
        draw.box(
            pen,
            x,
            x + _WIDE,
            _BOTTOM,
            _BOTTOM + _HIGH,
            _FRONT if front else _PAPER,
            draw.INK if front else draw.GREY,
            2.0 if front else 1.0,
        )
        ink = _INKS[k] if k < ENGINES else draw.GREY
        draw.text(
            pen,
            x + 0.08,
            _BOTTOM + 0.43,
            _CARDS + k,
            ink,
            13.0,
            draw.LEFT,
            draw.MIDDLE,
            0.0,
            0.0,
            0.0,
            1.0,
        )
        draw.text(pen, x + 0.08, _BOTTOM + 0.17, 0, draw.INK, 11.5)
        if k == ENGINES:
            draw.words(pen, _NOT_HERE)
            continue
        error = 1e3 * ERRORS[scene, step, fair, k]
        draw.words(pen, _OFF)
        if math.isfinite(error):
            form = draw.EXPONENT if error < 0.01 else (2 if error < 1e3 else 0)
            draw.number(pen, error, form, _UNITS + scene)


@register_jitable
def _paths(pen, state, controls):
    """Draw the truth, dashed, and all paths; that of the card in front is wide."""
    scene, step, fair = controls["scene"], controls["step"], controls["fair"]
    x0, x1, y0, y1 = _limits(scene)
    draw.area(pen, _AREA_OF, (x0, x1, y0, y1))
    draw.axes(pen, _X + scene, _Y + scene, _PATH, 4, 4)
    # The moving marker is interpolated between samples, in the time of the scene.
    share = min(state["time"] / DURATION[scene], 1.0)
    last = share * (TRUTH.shape[1] - 1)
    whole = int(last)
    for e in range(ENGINES):
        path, front = PATHS[scene, step, fair, e], e == controls["card"]
        ink = _INKS[e]
        draw.curve(pen, path[:, 0], path[:, 1], ink, 2.6 if front else 1.3, 1.0 if front else 0.55)
        after = min(whole + 1, len(path) - 1)
        x = path[whole, 0] + (last - whole) * (path[after, 0] - path[whole, 0])
        y = path[whole, 1] + (last - whole) * (path[after, 1] - path[whole, 1])
        draw.spot(pen, x, y, (0.012 if front else 0.008) * (x1 - x0), ink, draw.INK, 1.0)
    # The truth is drawn last, over all paths.
    draw.theory(pen, TRUTH[scene, :, 0], TRUTH[scene, :, 1])
    draw.window(pen)
    draw.theory_key(pen, 4.2, 3.98, _TRUE)


@register_jitable
def _radar(pen, controls, order):
    """Five axes; the ends of the bands are the spread over scenes."""
    draw.text(pen, 5.95, 3.98, _RADAR, draw.INK, 13.0, draw.LEFT, draw.MIDDLE, 0.0, 0.0, 0.0, 1.0)
    x, y = _CENTRE
    for k in range(5):
        # Five axes, the first one upwards, clockwise.
        turn = 0.5 * math.pi - 0.4 * math.pi * k
        c, s = _RADIUS * math.cos(turn), _RADIUS * math.sin(turn)
        draw.segment(pen, x, y, x + c, y + s, draw.GREY, 1.0)
        align = draw.CENTRE if abs(c) < 0.1 else (draw.LEFT if c > 0.0 else draw.RIGHT)
        up = 16.0 if s > 0.0 else -9.0  # above the axis, which a lower label would cross
        draw.text(
            pen,
            x + c,
            y + s,
            _AXES + order[k],
            draw.INK,
            11.0,
            draw.CENTRE,
            draw.MIDDLE,
            12.0 * (align == draw.LEFT) - 12.0 * (align == draw.RIGHT),
            up,
        )
    for e in range(ENGINES):
        front = e == controls["card"]
        # The polygon of the means, closed with the first corner; bands only of the card in front.
        draw.line(pen, _INKS[e], 2.4 if front else 1.0, 1.0 if front else 0.4)
        for k in range(6):
            turn = 0.5 * math.pi - 0.4 * math.pi * (k % 5)
            size = _RADIUS * RADAR[e, order[k % 5], 1]
            draw.point(pen, x + size * math.cos(turn), y + size * math.sin(turn))
        for k in range(5):
            turn = 0.5 * math.pi - 0.4 * math.pi * k
            low, high = _RADIUS * RADAR[e, order[k], 0], _RADIUS * RADAR[e, order[k], 2]
            if front:
                draw.segment(
                    pen,
                    x + low * math.cos(turn),
                    y + low * math.sin(turn),
                    x + high * math.cos(turn),
                    y + high * math.sin(turn),
                    _INKS[e],
                    5.0,
                    0.5,
                )


def frame(pen, state, controls):
    """Draw cards, paths, the five axes and the numbers of the card in front."""
    scene, step, fair, card = (
        controls["scene"],
        controls["step"],
        controls["fair"],
        controls["card"],
    )
    order = ORDERS[1 if controls["reorder"] else 0]
    _cards(pen, controls)
    _paths(pen, state, controls)
    _radar(pen, controls, order)
    draw.spot(pen, state["clicked"][0], state["clicked"][1], 0.05, draw.NONE, draw.GREY, 1.0)
    here = card < ENGINES
    at = min(card, ENGINES - 1)
    error, away = ERRORS[scene, step, fair, at], 0 if here else _NOT_HERE
    if not here:
        # A simulator that was not run here has documented properties only, no numbers.
        draw.text(pen, 0.15, 0.1, _DOCUMENTED, draw.INK, 12.0)
    draw.reading(pen, _ERROR, 1e3 * error if math.isfinite(error) else 0.0, 3, _UNITS + scene, away)
    draw.reading(pen, _ALLOWED, 1e3 * TOLERANCE[scene], 1, _UNITS + scene)
    verdict = _WITHIN if error <= TOLERANCE[scene] else _BEYOND
    draw.reading(pen, _VERDICT, 0.0, 0, 0, verdict if here else away)
    draw.reading(pen, _COST, COSTS[scene, fair, at], 1, _TIMES, away)
    # The largest distance between the ends of any two simulators: how far they disagree.
    ends = PATHS[scene, step, fair, :, -1]
    distance = 0.0
    for a in range(ENGINES):
        for b in range(a):
            distance = max(distance, math.hypot(ends[a, 0] - ends[b, 0], ends[a, 1] - ends[b, 1]))
    unit = 1.0 if scene >= TOWER else 1e3
    draw.reading(pen, _APART, unit * distance, 2, _PLACES + scene)
    draw.reading(pen, _AREA, area(RADAR[at, order, 1]), 2, _S, away)


PRESETS = {
    "Same scheme, same error": Preset(
        {},
        "One scheme at one step: the four paths lie on each other, and so does their error. "
        "Halve the step. Then switch the fair settings off.",
    ),
    "Default damping": Preset(
        {"fair": False, "card": "PyBullet"},
        "As shipped, PyBullet damps the links, holds the joints with motors and computes other "
        "inertias. A smaller step doesn't help.",
    ),
    "Pyramid steers": Preset(
        {"scene": "braking block", "fair": False, "card": "MuJoCo"},
        "A block is launched between two axes. With a friction pyramid it stops too far away, in "
        "another direction.",
    ),
    "Sinking grasp": Preset(
        {"scene": "grasp", "fair": False, "card": "MuJoCo"},
        "By Coulomb's law the fingers press hard enough. But soft friction creeps, and the part "
        "sinks.",
    ),
    "Collapsing tower": Preset(
        {"scene": "tower of five", "fair": False, "card": "Drake"},
        "Five cubes of 1 kg. How far does the highest sink, and where does it come to rest?",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "error at the end": (
        "Difference between the selected simulator's final state and the reference solution."
    ),
    "tolerance": "Largest error that counts as correct in this scene.",
    "verdict": "Whether the error is within the tolerance.",
    "cost of a step": (
        "Computing time of the motion at 1 ms, as a multiple of MuJoCo's with fair settings."
    ),
    "ends apart": "Largest distance between the final states of any two simulators.",
    "area of the five": (
        "Area of the selected simulator's radar polygon, as a fraction of the full pentagon. It "
        "changes when the axes change their order, so it is a poor score."
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
    drag,
    press=press,
    live_drag=True,
    readouts=READOUTS,
    upright=False,
)
