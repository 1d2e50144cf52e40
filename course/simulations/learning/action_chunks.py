"""Chunks of actions on a time line: which observation each executed action is based on."""

import math

from numba.extending import register_jitable

from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

PERIOD = 0.02  # s from one action to the next
AHEAD, WAITS = 0, 1
_SHOWN = 60  # periods on the time line
_PACE = 8.0  # periods per second while it plays

CONTROLS = Record(
    length=slider("Chunk length H", 16, 1, 40, 1, "actions", 0, live=True),
    executed=slider("Executed part k", 8, 1, 40, 1, "actions", 0, live=True),
    latency=slider("Latency of a prediction", 60.0, 0.0, 400.0, 5.0, "ms", 0, live=True),
    mode=menu(
        "While a chunk is being predicted",
        ("go on with the old chunk", "wait"),
        live=True,
    ),
)
STATE = Record(time=Field(0.0, unit="periods"))  # of the cursor


@register_jitable
def delay_of(controls):
    """Return the periods from an observation to the first action that can be based on it."""
    # The small number keeps a latency of whole periods from being rounded up.
    return math.ceil(1e-3 * controls["latency"] / PERIOD - 1e-9)


@register_jitable
def schedule(controls):
    """Return what happens from one chunk to the next, in periods.

    If the robot goes on, the observation is taken so early that the chunk is ready when it is
    needed; the actions for the time until then are dropped. If it waits, none is dropped.

    Returns:
        delay: from the observation to the first action based on it.
        actions: how many actions of a chunk are executed.
        cycle: from one chunk to the next; cycle - actions periods are without an action.
    """
    # More actions than the chunk holds cannot be executed.
    delay, k = delay_of(controls), min(controls["executed"], controls["length"])
    if controls["mode"] == WAITS:
        return delay, k, delay + k
    # One prediction at a time: the next one ends no sooner than a delay after this one.
    cycle = max(k, delay)
    # By the time a chunk is ready its first `delay` actions are outdated and dropped; if none is
    # left, the robot has nothing to execute.
    return delay, max(min(cycle, controls["length"] - delay), 0), cycle


@register_jitable
def ages(controls):
    """Return least, mean and largest age of the observation behind an action [s]; -1: no action."""
    delay, actions, _ = schedule(controls)
    if actions == 0:
        return -1.0, -1.0, -1.0
    # Ages grow linearly from the first executed action to the last, so their mean is the average of
    # both.
    last = delay + actions - 1
    return PERIOD * delay, 0.5 * PERIOD * (delay + last), PERIOD * last


@register_jitable
def age_at(controls, period):
    """Return the age of the observation behind the action in a period [s]; -1: no action.

    The first action of chunk 0 is executed in period 0.
    """
    delay, actions, cycle = schedule(controls)
    into = period % cycle
    return PERIOD * (delay + into) if into < actions else -1.0


def initial(controls, state):
    """Put the cursor at the beginning."""
    state["time"] = 0.0


def advance(state, controls, seconds):
    """Move the cursor along the time line, and back to its beginning."""
    state["time"] = (state["time"] + _PACE * seconds) % _SHOWN


TITLE = "Action chunks on a time line"
word, colour = draw.words_table(), draw.colours_table()
_PLANNED, _COMPUTED, _DROPPED = colour("#d6e4f0", "#f3d9b1", "#e6e6e6")
_TIME, _CHUNKS, _AGE, _HEADING = word(
    "time [ms]", "chunks", "age [ms]", "age of the observation behind each action"
)
_SEEN, _PREDICTED_KEY, _EXECUTED_KEY, _PLANNED_KEY, _STALE_KEY = word(
    "observation", "being predicted", "executed", "planned, not used", "outdated when ready"
)
_LEAST, _MEAN, _MOST, _RATE, _IDLE, _USED = word(
    "age, least",
    "age, mean",
    "age, largest",
    "predictions",
    "time without action",
    "actions used",
)
_MS, _PER_SECOND, _PERCENT, _OF, _NONE = word(" ms", " per s", " %", " of ", "no action")
_TOP, _LOW = (0.85, 8.8, 2.6, 4.35), (0.85, 8.8, 0.75, 1.9)
_ROWS = 6
_MS_SHOWN = 1000.0 * PERIOD * _SHOWN


@register_jitable
def _time_line(pen, state, controls):
    """Draw the chunks one below the other: observation, prediction, and what becomes of them."""
    delay, actions, cycle = schedule(controls)
    waits, length = controls["mode"] == WAITS, controls["length"]
    ms = 1000.0 * PERIOD
    draw.area(pen, _TOP, (0.0, _MS_SHOWN, 0.0, 1.0 * _ROWS))
    draw.axes(pen, 0, 0, 0, 10, 0)
    # Chunks whose bars reach into the picture.
    first, last = -((delay + length) // cycle) - 1, _SHOWN // cycle + delay // cycle + 1
    for n in range(first, last + 1):
        ready = n * cycle
        seen = ready - delay
        # Chunks cycle through six rows, so that overlapping ones stay apart.
        low = _ROWS - 1.0 - n % _ROWS
        foot, top = low + 0.14, low + 0.86
        draw.box(pen, ms * seen, ms * ready, low + 0.36, low + 0.64, _COMPUTED)
        if waits:  # the robot has not moved, so the chunk begins with its first action
            begin, outdated = ready, 0
        else:
            begin, outdated = seen, min(delay, length)
        # Layers: the whole chunk pale, its outdated part grey, the prediction in progress, the
        # executed part blue.
        draw.box(pen, ms * begin, ms * (begin + length), foot, top, _PLANNED, draw.NONE, 1.0, 0.75)
        if outdated > 0:
            draw.box(pen, ms * begin, ms * (begin + outdated), foot, top, _DROPPED)
            draw.box(pen, ms * seen, ms * ready, low + 0.36, low + 0.64, _COMPUTED)
        if actions > 0:
            draw.box(pen, ms * ready, ms * (ready + actions), foot, top, draw.BLUE)
        draw.spot(pen, ms * seen, low + 0.5, 7.0, draw.ORANGE, draw.INK, 1.0)
    now = ms * state["time"]
    draw.segment(pen, now, 0.0, now, 1.0 * _ROWS, draw.INK, 1.5)
    draw.window(pen)
    draw.text(
        pen, _TOP[0], 3.42, _CHUNKS, draw.INK, 12.0, draw.CENTRE, draw.BOTTOM, -8.0, 0.0, 90.0
    )


@register_jitable
def _ages(pen, state, controls):
    """Draw the age of the observation in each period, as bars, and the mean."""
    _, mean, most = ages(controls)
    # A scale in powers of two over 100 ms that holds the largest age.
    ms, high = 1000.0 * PERIOD, 100.0
    while high < 1050.0 * most:
        high *= 2.0
    draw.area(pen, _LOW, (0.0, _MS_SHOWN, 0.0, high))
    draw.axes(pen, _TIME, _AGE, _HEADING, 10, 2)
    # One bar for each period; a period without an action stays empty.
    for period in range(_SHOWN):
        age = age_at(controls, period)
        if age >= 0.0:
            ink = draw.BLUE if period == int(state["time"]) else _PLANNED
            draw.box(pen, ms * period, ms * (period + 1), 0.0, 1000.0 * age, ink, draw.BLUE, 0.8)
    if mean >= 0.0:
        draw.segment(pen, 0.0, 1000.0 * mean, _MS_SHOWN, 1000.0 * mean, draw.RED, 2.0)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw the time line of the chunks, the age of each action's observation, and the numbers."""
    _time_line(pen, state, controls)
    _ages(pen, state, controls)
    draw.spot(pen, 0.95, 4.7, 0.07, draw.ORANGE, draw.INK, 1.0)
    draw.text(pen, 1.12, 4.7, _SEEN, draw.INK, 11.5)
    draw.key(pen, 2.1, 4.7, _PREDICTED_KEY, _COMPUTED, 7.0)
    draw.key(pen, 3.65, 4.7, _STALE_KEY, _DROPPED, 9.0)
    draw.key(pen, 5.75, 4.7, _EXECUTED_KEY, draw.BLUE, 9.0)
    draw.key(pen, 7.1, 4.7, _PLANNED_KEY, _PLANNED, 9.0)
    _, actions, cycle = schedule(controls)
    least, mean, most = ages(controls)
    nothing = _NONE if actions == 0 else 0
    draw.reading(pen, _LEAST, 1000.0 * least, 0, _MS, nothing)
    draw.reading(pen, _MEAN, 1000.0 * mean, 0, _MS, nothing)
    draw.reading(pen, _MOST, 1000.0 * most, 0, _MS, nothing)
    draw.reading(pen, _RATE, 1.0 / (PERIOD * cycle), 1, _PER_SECOND)
    # Share of the time in which the robot has no action, and how much of each chunk is used.
    draw.reading(pen, _IDLE, 100.0 * (cycle - actions) / cycle, 0, _PERCENT)
    draw.readout(pen, _USED)
    draw.number(pen, actions, 0, _OF)
    draw.number(pen, controls["length"], 0)


def drag(controls, state, x, y):
    """Move the cursor."""
    time = draw.values_at(_TOP, (0.0, 1.0 * _SHOWN, 0.0, 1.0), x, y)[0]
    state["time"] = min(max(time, 0.0), _SHOWN - 1e-6)


def press(controls, state, key):
    """Handle a key: left and right move the cursor by a period, up and down change k."""
    if key < 2:
        state["time"] = (state["time"] + (-1.0 if key == 0 else 1.0)) % _SHOWN
    elif key < 4:
        controls["executed"] = min(max(controls["executed"] + (1 if key == 2 else -1), 1), 40)


PRESETS = {
    "Eight of sixteen": Preset(
        {},
        "The robot takes an observation (orange), waits for the prediction, executes 8 of its "
        "16 actions, and uses the next chunk. Each action is older than the one before, until the "
        "next chunk begins. Lower the executed part and watch the mean age fall.",
    ),
    "One action per chunk": Preset(
        {"executed": 1, "latency": 20.0, "length": 4},
        "A new chunk for each action reacts as fast as the latency allows: every action is one "
        "period old. It also needs 50 predictions per second. Raise the latency: the predictions "
        "can't keep up, and each chunk has to last longer.",
    ),
    "The robot waits": Preset(
        {"mode": 1, "latency": 100.0},
        "The robot stands still while each chunk is being predicted. No action is dropped, but "
        "part of the time has none. Execute a larger part of each chunk: less time is lost, and "
        "the actions become older.",
    ),
    "The chunk runs out": Preset(
        {"length": 12, "latency": 160.0, "executed": 8},
        "The prediction takes as long as eight actions, so only four of the twelve are left when "
        "the chunk is ready, and then the robot has no action. Make the chunk longer or the "
        "prediction faster.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "age, least": "Time from the observation to the first action that is based on it.",
    "age, mean": "Mean over all executed actions; the red line.",
    "age, largest": "Time from the observation to the last action of its chunk.",
    "predictions": "How many chunks the policy predicts in a second.",
    "time without action": "Share of the time in which the robot has no action to execute.",
    "actions used": "Executed actions of each chunk, of all that it holds.",
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
    live_drag=True,
    readouts=READOUTS,
    upright=False,
)
