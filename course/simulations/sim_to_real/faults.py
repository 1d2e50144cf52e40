"""Five faults of a robot, each with a switch: do their effects add?

One arm of the chapter reaches for targets. Every combination of the faults is counted on the same
tasks after the simulation has started, one after another, so a switch only looks up another result.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course import sim_to_real as chapter
from course.control import Gains
from course.sim_to_real import plants
from course.sim_to_real.motion import episodes
from course.sim_to_real.plants import DIRECTION, HOME, SIZES
from course.simulations import pen as draw
from course.simulations.interval import score_interval
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider, switch

COUNTED, SEED, PAUSE = 128, 17, 0.6  # tasks; pause before the reach is shown again [s]
SLOW_STEP, CAMERA, HEAVIER = 0.02, 0.02, 1.1  # [s]; along x [m]; factor on the masses
RANDOMISED = 4  # row of the record: tuned on the range of width 0.4
FAULTS = ("step", "friction", "mass", "camera", "no_randomisation")
STEP, FRICTION, MASS, OFFSET, PLAIN = range(5)
COMBINATIONS = 2 ** len(FAULTS)
SAMPLES = round(plants.SECONDS / plants.DT)
START, GOAL = (0.3, 1.6), (-0.28, 0.56)  # of the shown reach [rad], [m]

CONTROLS = Record(
    step=switch("Control step 20 ms instead of 10", False, live=True),
    friction=switch("Sliding friction in the joints", False, live=True),
    mass=switch("Mass + 10 %", False, live=True),
    camera=switch("Camera off by 2 cm", False, live=True),
    no_randomisation=switch("No randomisation in training", False, live=True),
    radius=slider("Target radius", 2.5, 2.2, 4.0, 0.1, "cm", 1),
    delay=slider("Actuator delay", 6.0, 0.0, 12.0, 1.0, "ms", 0),
)
STATE = Record(
    rates=Field(math.nan, shape=(COMBINATIONS,)),  # not a number where it is not counted yet
    remaining=Field(COMBINATIONS),
    q=Field(0.0, shape=(COMBINATIONS, 2, SAMPLES + 1), unit="rad"),
    time=Field(0.0, unit="s"),
)

_GAINS = chapter.recorded()["range"][[0, RANDOMISED], 0].copy()
_TASKS = chapter.tasks(COUNTED, SEED)
# The last column is the reach that is shown: it is not counted.
_STARTS = np.column_stack((_TASKS.start, START))
_GOALS = np.column_stack((_TASKS.goal, GOAL))
# Controllers of both joints without gains, for either control step.
_CONTROLLERS = np.array(
    [
        [Gains(0.0, tau=plants.FILTER, u_min=-u, u_max=u).numbers(dt) for u in plants.ARM.torques]
        for dt in (plants.DT, SLOW_STEP)
    ]
)
_LENGTHS = tuple(map(float, plants.ARM.lengths))
_DRY = float(DIRECTION["coulomb"])


@register_jitable
def has(combination, fault):
    """Return whether a combination, a number from 0 to 31, has a fault, a bit of it."""
    return (combination >> fault) & 1 == 1


@register_jitable
def count(some, radius, delay, q):
    """Return the success rate of a combination, and write the angles of its shown reach.

    Args:
        some: number of the combination.
        radius: of the target [m].
        delay: of the command [s].
        q: to be filled, (2, samples) [rad]; after a reach with long steps the rest repeats its end.
    """
    rest = np.zeros((4, COUNTED + 1))
    rest[:2] = _STARTS
    dt = SLOW_STEP if has(some, STEP) else plants.DT
    fields = HOME.copy()
    fields[0] = HEAVIER if has(some, MASS) else 1.0
    fields[3] = _DRY if has(some, FRICTION) else 0.0
    fields[5] = delay
    # The camera reports the goal elsewhere; the tip is judged at the true goal.
    observed = _GOALS.copy()
    observed[0] += CAMERA if has(some, OFFSET) else 0.0
    references = plants.reference_angles(_STARTS, observed)
    numbers = np.empty((1, 2, _CONTROLLERS.shape[2]))
    numbers[0] = _CONTROLLERS[1 if has(some, STEP) else 0]
    numbers[0, :, :3] = _GAINS[0 if has(some, PLAIN) else 1].copy().reshape(2, 3)
    samples = int(plants.SECONDS / dt + 0.5)
    sizes = SIZES.copy()
    sizes[0], sizes[1], sizes[3] = samples, dt, radius
    sizes[4] = int(plants.HOLD / dt + 0.5)
    out = np.empty((4, COUNTED + 1))
    trace = np.zeros((10, COUNTED + 1, samples + 1))
    noise, plan = np.zeros((samples + 1, 2, 1)), np.empty((0, 2, 1))
    arm, goals = plants.columns_of(fields), _GOALS.copy()
    episodes(arm, numbers, rest, references, goals, noise, plan, sizes, out, trace)
    for k in range(2):
        q[k, :] = trace[k, COUNTED, samples]
        q[k, : samples + 1] = trace[k, COUNTED]
    return np.mean(out[0, :COUNTED])


@register_jitable
def chosen(controls):
    """Return the number of the combination that the switches choose."""
    return (
        (controls["step"] << STEP)
        + (controls["friction"] << FRICTION)
        + (controls["mass"] << MASS)
        + (controls["camera"] << OFFSET)
        + (controls["no_randomisation"] << PLAIN)
    )


@register_jitable
def lost(rates, some):
    """Return the share of reaches that a combination loses against none of the faults."""
    return rates[0] - rates[some]


@register_jitable
def added(rates, some):
    """Return the sum of what the faults of a combination lose one at a time."""
    total = 0.0
    for fault in range(len(FAULTS)):
        if has(some, fault):
            total += lost(rates, 1 << fault)
    return total


@register_jitable
def strongest_pair(rates, some):
    """Return the two faults of a combination that interact most, and by how much.

    The interaction is what the pair loses beyond the sum of both separate losses; negative where
    one makes up for the other. Without two faults the numbers are 0, 0 and 0. The last number is
    not a number as long as a pair is not counted.
    """
    first, second, most = 0, 0, 0.0
    for i in range(len(FAULTS)):
        for j in range(i + 1, len(FAULTS)):
            if has(some, i) and has(some, j):
                pair = (1 << i) + (1 << j)
                more = lost(rates, pair) - added(rates, pair)
                if first == second or math.isnan(more) or abs(more) > abs(most):
                    first, second, most = i, j, more
    return first, second, most


@register_jitable
def complete(controls, state):
    """Count one more combination on the common tasks: the chosen one first."""
    rates, some = state["rates"], chosen(controls)
    if not math.isnan(rates[some]):
        some = 0
        while not math.isnan(rates[some]):
            some += 1
    radius, delay = 0.01 * controls["radius"], 1e-3 * controls["delay"]
    rates[some] = count(some, radius, delay, state["q"][some])
    state["remaining"] -= 1


def initial(controls, state):
    """Count the chosen combination; the others follow in portions."""
    complete(controls, state)


def advance(state, controls, seconds):
    """Advance the simulation: the reach is shown again and again."""
    state["time"] += seconds


TITLE = "Faults that can be combined"
word, colour = draw.words_table(), draw.colours_table()
_PAPER, _LIT, _SAND = colour("#f7f7f7", "#fbe3c8", "#f7f5ef")
_NAMES = word(
    "control step 20 ms",
    "sliding friction",
    "mass + 10 %",
    "camera off by 2 cm",
    "tuned without randomisation",
)[0]
_ACTIVE, _OFF, _FAULTS, _REACH, _TARGET, _SEEN = word(
    "ACTIVE", "off", "faults", "one reach", "target", "where the camera sees it"
)
_ADDED, _TOGETHER, _HEADING, _DIAGONAL, _NOW, _WORSE, _BETTER = word(
    "lost one at a time, added [%]",
    "lost together [%]",
    "all 32 combinations",
    "effects add",
    "this one",
    "worse than the sum",
    "better than the sum",
)
_RATE, _BAND, _TO, _CLOSE = word("success", " % (", "-", ")")
_LOST, _SUM, _PAIR, _PERCENT, _NONE, _AND, _COLON, _COUNTING = word(
    "lost together",
    "sum of single losses",
    "strongest pair",
    " %",
    "none",
    " and ",
    ": ",
    "being counted",
)
_COUNTED, _OF_ALL = word("counted: ", " of 32 combinations")
_SCENE, _VIEW = (0.15, 3.35, 1.75, 4.55), (-0.85, 0.75, -0.35, 1.05)
_ROWS, _WIDE, _HIGH = 1.35, 3.2, 0.24  # top of the list, width and height of a row
_CHART, _VALUES = (4.6, 8.7, 0.75, 4.5), (-10.0, 100.0, -10.0, 100.0)
_COUNTER = (8.6, 1.55)  # where the progress of the counting is written


@register_jitable
def _links(pen, q, ink):
    """Draw an arm with angles (2,) as two lines, its joints and its tip."""
    l1, l2 = _LENGTHS
    x, y = l1 * math.cos(q[0]), l1 * math.sin(q[0])
    u, v = x + l2 * math.cos(q[0] + q[1]), y + l2 * math.sin(q[0] + q[1])
    draw.curve(pen, np.array([0.0, x, u]), np.array([0.0, y, v]), ink, 5.0, 1.0)
    draw.spots(pen, np.array([0.0, x, u]), np.array([0.0, y, v]), 0.022, ink)


def frame(pen, state, controls):
    """Draw the reach, the list of faults, and all combinations against the sum of their effects."""
    some, rates = chosen(controls), state["rates"]
    q, (l1, l2) = state["q"][some], _LENGTHS
    dt = SLOW_STEP if has(some, STEP) else plants.DT
    now = int(min(state["time"] % (plants.SECONDS + PAUSE), plants.SECONDS) / dt + 1e-9)
    draw.area(pen, _SCENE, _VIEW)
    draw.box(pen, *_VIEW, _SAND, draw.GREY)
    draw.title(pen, _VIEW[0], _VIEW[3], _REACH)
    x, y = GOAL
    draw.spot(pen, x, y, 0.01 * controls["radius"], draw.GREEN, draw.INK, 1.0, 0.7)
    draw.text(pen, x, y, _TARGET, draw.GREEN, 11.5, draw.RIGHT, draw.MIDDLE, -14.0)
    if has(some, OFFSET):
        draw.spot(pen, x + CAMERA, y, 0.008, draw.RED)
        draw.text(pen, x + CAMERA, y, _SEEN, draw.RED, 11.5, draw.LEFT, draw.BOTTOM, 4.0, 14.0)
    counted = not math.isnan(rates[some])
    if counted:
        u = l1 * np.cos(q[0, : now + 1]) + l2 * np.cos(q[0, : now + 1] + q[1, : now + 1])
        v = l1 * np.sin(q[0, : now + 1]) + l2 * np.sin(q[0, : now + 1] + q[1, : now + 1])
        draw.curve(pen, u, v, draw.BLUE, 1.4, 0.8)
        _links(pen, q[:, now], draw.BLUE)
    # The list of faults, with a mark at each that is switched on.
    draw.window(pen)
    for k in range(len(FAULTS)):
        on, top = has(some, k), _ROWS - _HIGH * k
        left, middle = _SCENE[0], top - 0.5 * _HIGH
        draw.box(pen, left, left + _WIDE, top - _HIGH, top, _LIT if on else _PAPER, draw.GREY, 1.0)
        draw.text(pen, left + 0.1, middle, _NAMES + k, draw.INK, 11.5)
        mark, ink = (_ACTIVE, draw.RED) if on else (_OFF, draw.GREY)
        right = left + _WIDE - 0.1
        bold = 1.0 if on else 0.0
        draw.text(pen, right, middle, mark, ink, 11.5, draw.RIGHT, draw.MIDDLE, 0.0, 0.0, 0.0, bold)
    # All combinations: on the dashed line the effects add.
    draw.chart(pen, _CHART, _VALUES, _ADDED, _TOGETHER, _HEADING)
    draw.theory(pen, np.array([-10.0, 100.0]), np.array([-10.0, 100.0]))
    draw.text(pen, -4.0, 92.0, _WORSE, draw.GREY, 11.5)
    draw.text(pen, 97.0, 2.0, _BETTER, draw.GREY, 11.5, draw.RIGHT)
    for other in range(COMBINATIONS):
        a, b = 100.0 * added(rates, other), 100.0 * lost(rates, other)
        if not math.isnan(a + b):
            draw.spot(
                pen, min(max(a, -10.0), 100.0), max(b, -10.0), 0.9, draw.GREY, draw.NONE, 1.0, 0.8
            )
    a, b = 100.0 * added(rates, some), 100.0 * lost(rates, some)
    if not math.isnan(a + b):
        a, b = min(max(a, -10.0), 100.0), max(b, -10.0)
        draw.spot(pen, a, b, 2.2, draw.ORANGE, draw.INK, 1.0)
        side, beside = (draw.LEFT, 10.0) if a < 70.0 else (draw.RIGHT, -10.0)
        draw.text(pen, a, b, _NOW, draw.ORANGE, 12.0, side, draw.MIDDLE, beside)
    draw.window(pen)
    draw.theory_key(pen, 7.35, 4.68, _DIAGONAL)
    if state["remaining"] > 0:
        draw.text(pen, *_COUNTER, _COUNTED, draw.INK, 12.0, draw.RIGHT, draw.MIDDLE)
        draw.number(pen, COMBINATIONS - state["remaining"], 0, _OF_ALL)
    draw.reading(pen, _RATE, 100.0 * rates[some], 0, 0, 0 if counted else _COUNTING)
    if counted:
        low, high = score_interval(rates[some], COUNTED)
        draw.words(pen, _BAND)
        draw.number(pen, 100.0 * low, 0, _TO)
        draw.number(pen, 100.0 * high, 0, _CLOSE)
    together, single = lost(rates, some), added(rates, some)
    waits = _COUNTING if math.isnan(together) else 0
    draw.reading(pen, _LOST, 100.0 * together, 0, _PERCENT, waits)
    waits = _COUNTING if math.isnan(single) else 0
    draw.reading(pen, _SUM, 100.0 * single, 0, _PERCENT, waits)
    first, second, most = strongest_pair(rates, some)
    pair = _COUNTING if math.isnan(most) else (_NAMES + first if first != second else _NONE)
    draw.reading(pen, _PAIR, 0.0, 0, 0, pair)
    if first != second and not math.isnan(most):
        draw.words(pen, _AND)
        draw.words(pen, _NAMES + second)
        draw.words(pen, _COLON)
        draw.number(pen, 100.0 * most, draw.SIGNED, _PERCENT)


PRESETS = {
    "Step and camera": Preset(
        {"step": True, "camera": True},
        "Each of the two alone costs few "
        "reaches. Together they cost about half. Now switch the sliding friction on.",
    ),
    "All off": Preset(
        {},
        "The robot agrees with the simulator except for the delay, and nearly "
        "all reaches succeed. Switch one fault on, then a second one.",
    ),
    "Friction makes up": Preset(
        {"step": True, "camera": True, "friction": True},
        "Sliding "
        "friction brakes the arm, and most of the loss comes back: three faults cost less than "
        "two of them.",
    ),
    "No randomisation": Preset(
        {"step": True, "camera": True, "no_randomisation": True},
        "The gains that were tuned on "
        "one arm are higher: with the long step and the camera's error most reaches fail.",
    ),
    "All on": Preset(
        {name: True for name in FAULTS},
        "All five faults. More reaches succeed than "
        "with the long step and the camera's error alone.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "success": "Successful reaches with these faults, with a 95 % confidence interval.",
    "lost together": "Success rate without any fault minus the success rate with these faults.",
    "sum of single losses": "Sum of what each of these faults costs if it is the only one.",
    "strongest pair": (
        "Of the active faults, the two whose joint loss differs most from the sum of their "
        "separate losses, and by how much."
    ),
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
    readouts=READOUTS,
    complete=complete,
)
