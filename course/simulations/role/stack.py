"""The stack as a graph: samples run through it, each with its age; ten times slower than they are.

The chain is chapter 0's: a camera whose pictures are seen, a planner, a loop. It runs once at the
start, for `SPAN` seconds, with the loops of `course.role`; the picture shows a moment of that run
and the histogram all of it.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course import role
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider, switch

read, free, serve = (register_jitable(f) for f in (role.read, role.free, role.serve))

SPAN, SETTLED, PACE = 40.0, 8.0, 0.1  # of the run [s]; when queues are full [s]; of the picture
CAMERA, PLAN, LOOP = 1.0 / 30.0, 0.060, 0.0002  # period of the camera; executions [s]
_BINS, _MOST = 50, 1300  # of the histogram; results of one stage in the run
ROBOT, _, MIDDLEWARE, PERCEPTION, PLANNING, CONTROL, LEARNING = range(7)  # as in role.BOXES

CONTROLS = Record(
    seeing=slider("Perception takes", 45.0, 5.0, 120.0, 5.0, "ms", 0),
    parallel=switch("seen by several workers", True),
    rate=slider("Planner", 10.0, 1.0, 16.0, 0.5, "Hz", 1),
    depth=slider("Queue before it", 1, 1, 10, 1),
    trigger=menu("Planner starts", ("by its clock", "on arrival")),
    loop=slider("Loop", 1000.0, 50.0, 1000.0, 50.0, "Hz", 0),
    locked=switch("all clocks from one", False),
    phase=slider("planner's phase", 0.3, 0.0, 0.95, 0.05),
    box=menu("Box", role.BOXES, PERCEPTION, live=True),
)
STATE = Record(
    time=Field(SETTLED, unit="s"),
    begun=Field(0.0, shape=(2, _MOST), unit="s"),  # of seeing and planning: when each job began,
    done=Field(0.0, shape=(2, _MOST), unit="s"),  # when it ended,
    born=Field(0.0, shape=(2, _MOST), unit="s"),  # and when its picture was taken
    jobs=Field(0, shape=(2,)),
    ages=Field(0.0, shape=(_BINS,)),  # share of the run's moments in each bin
    mean=Field(0.0, unit="s"),
    clicked=Field((-1.0, -1.0)),
)


@register_jitable
def predicted(controls):
    """Return the least, mean and greatest age and the intervals of perception and planning [s].

    The formula is that of `role.age`.
    """
    # Perception runs at the camera's rate with several workers; one worker drops the images that
    # come while it is busy.
    see, given = 1e-3 * controls["seeing"], CAMERA
    if not controls["parallel"]:
        given = CAMERA * max(math.ceil(see / CAMERA - 1e-9), 1.0)
    period = 1.0 / controls["rate"]
    # A planner on a clock that is too fast for its own execution skips to the next multiple of its
    # period.
    interval = period * max(math.ceil(PLAN / period - 1e-9), 1.0)
    if controls["trigger"] == 1:
        interval = max(PLAN, given)
    # If perception delivers faster than the planner reads, the queue is full and each message waits
    # behind depth - 1 others.
    full = given < interval * (1.0 - 1e-9)
    # Waiting is uniform between none and one interval per sampling stage, hence a mean at half the
    # spread.
    waits = given if full or controls["trigger"] == 0 else 0.0
    least = see + PLAN + LOOP + (controls["depth"] - 1) * given * full
    spread = waits + interval + 1.0 / controls["loop"]
    return least, least + 0.5 * spread, least + spread, given, interval


@register_jitable
def _ticks(period, phase):
    return phase * period + period * np.arange(int(SPAN / period))


@register_jitable
def commands(controls, state, times):
    """Return, for these times (N,), when the image behind the current command was taken [s]."""
    period = 1.0 / controls["loop"]
    # A command comes from the last tick of the loop that has finished; it uses the newest plan by
    # then.
    ticks = period * np.floor((times - LOOP) / period)
    done, count = state["done"][1, : state["jobs"][1]], state["jobs"][1]
    index = np.searchsorted(done, ticks, side="right") - 1
    return state["born"][1, :count][np.maximum(index, 0)]


def initial(controls, state):
    """Compute the whole run.

    Clocks of their own are off by a part in a thousand, so that phases drift.
    """
    # Locked clocks keep their phases; otherwise they drift by a part in a thousand and all phases
    # occur.
    deviation = 0.0 if controls["locked"] else 1.3e-3
    ticks = _ticks(CAMERA * (1.0 + deviation), 0.4)
    durations = np.full(_MOST, 1e-3 * controls["seeing"])
    # A single worker skips the ticks at which it is still busy.
    if not controls["parallel"]:
        ticks = ticks[free(ticks, durations[: ticks.size])]
    n = ticks.size
    state["begun"][0, :n] = state["born"][0, :n] = ticks
    state["done"][0, :n] = ticks + durations[:n]
    arrived = state["done"][0, :n].copy()
    durations[:] = PLAN
    # The planner serves messages as they arrive, or reads the queue at its own free ticks.
    if controls["trigger"] == 1:
        taken, starts = serve(arrived, durations, controls["depth"])
    else:
        starts = _ticks((1.0 - 0.5 * deviation) / controls["rate"], controls["phase"])
        starts = starts[free(starts, durations[: starts.size])]
        taken = read(arrived, starts, controls["depth"])
        starts, taken = starts[taken >= 0], taken[taken >= 0]
    m = taken.size
    state["begun"][1, :m], state["done"][1, :m] = starts, starts + PLAN
    # Each plan inherits the time stamp of its image: ages are measured from the camera.
    state["born"][1, :m] = state["born"][0, :n][taken]
    state["jobs"][0], state["jobs"][1] = n, m
    # Sample the age of the command once the queues have settled, at a spacing that does not keep in
    # step with the loop at its usual rates.
    times = np.linspace(SETTLED, SPAN - 1.0, 6007)
    old = times - commands(controls, state, times)
    state["mean"] = np.mean(old)
    # Bins up to a little over the bound; older commands would be counted in the last one.
    wide = 1.15 * predicted(controls)[2] / _BINS
    bins = np.minimum((old / wide).astype(np.int64), _BINS - 1)
    state["ages"][:] = np.bincount(bins, minlength=_BINS) / old.size


def advance(state, controls, seconds):
    """Advance the simulation: ten times slower than the stack.

    At the end of the run it starts again.
    """
    passed = state["time"] + PACE * seconds - SETTLED
    state["time"] = SETTLED + passed % (SPAN - SETTLED - 1.0)


TITLE = "The stack as a graph"
word, colour = draw.words_table(), draw.colours_table()
_NAMES = word(*role.BOXES)[0]
_FLOWS = word(*(edge.flow for edge in role.STACK))[0]
_QUIET, _CHOSEN, _PULSE = colour("#eef3f7", "#fbe3c8", "#d55e00")
_IN, _OUT, _COMMA, _HZ, _KB, _MB, _MS, _NOT = word(
    "in", "out", ", ", " Hz, ", " kB/s", " MB/s", " ms", "not on the way"
)
_NOW, _LEAST, _MEAN, _GREATEST, _RUN, _HERE, _RATE = word(
    "age of the command",
    "least predicted",
    "mean predicted",
    "bound predicted",
    "mean of the run",
    "result of the box",
    "planner's results",
)
_PER, _HIST, _AGE, _SHARE = word(" Hz", "age of the command in force", "age [ms]", "share")
_L = word("least", "mean", "bound")[0]
_AT = np.array(
    [(2.9, 0.55), (0.85, 1.55), (0.85, 4.1), (2.9, 4.1), (4.95, 4.1), (4.95, 1.55), (2.9, 2.3)]
)
_W, _H = 0.66, 0.27  # half a box
_FROM = np.array([role.BOXES.index(edge.source) for edge in role.STACK])
_TO = np.array([role.BOXES.index(edge.target) for edge in role.STACK])
_RATES, _SIZES = (
    np.array([float(getattr(edge, name)) for edge in role.STACK]) for name in ("rate", "size")
)
_HISTOGRAM = (6.35, 8.8, 3.1, 4.55)


def drag(controls, state, x, y):
    """Handle a drag: the box that is nearest to the pointer is shown."""
    near = np.argmin((_AT[:, 0] - x) ** 2 + (2.0 * (_AT[:, 1] - y)) ** 2)
    controls["box"] = near
    state["clicked"][0], state["clicked"][1] = min(max(x, 0.0), 9.0), min(max(y, 0.0), 5.0)


def press(controls, state, key):
    """Handle a key: arrow keys go from box to box."""
    controls["box"] = (controls["box"] + (1 if key in (1, 3, 4) else -1)) % len(role.BOXES)


@register_jitable
def _rate(edge, controls, given, interval):
    """Return how often something flows along an edge, with these controls [Hz]."""
    if _FROM[edge] == PERCEPTION:
        return 1.0 / given
    if _FROM[edge] == PLANNING:
        return 1.0 / interval
    return controls["loop"] if _RATES[edge] == 1000.0 else _RATES[edge]


@register_jitable
def _ends(edge):
    """Return where an edge is drawn: beside the one that goes the other way, from rim to rim."""
    a, b = _AT[_FROM[edge]], _AT[_TO[edge]]
    # Edges in both directions run side by side, each shifted to its left, and end at the boxes'
    # rims.
    dx, dy = b[0] - a[0], b[1] - a[1]
    size = math.hypot(dx, dy)
    rim = min(_W / max(abs(dx), 1e-9), _H / max(abs(dy), 1e-9)) + 0.03
    sx, sy = -0.09 * dy / size, 0.09 * dx / size
    return a[0] + rim * dx + sx, a[1] + rim * dy + sy, b[0] - rim * dx + sx, b[1] - rim * dy + sy


@register_jitable
def _pulse(pen, x, y, age, below):
    """Draw a sample and its age [s]."""
    draw.spot(pen, x, y, 0.09, _PULSE, draw.INK, 1.0)
    draw.text(pen, x, y, 0, draw.INK, 12.0, draw.CENTRE, draw.MIDDLE, 0.0, -18.0 if below else 17.0)
    draw.number(pen, 1000.0 * age, 0, _MS)


@register_jitable
def _graph(pen, controls, given, interval):
    """Boxes, and edges as wide as the rate is high; those of the chosen box are dark."""
    chosen = controls["box"]
    for k in range(_FROM.size):
        x0, y0, x1, y1 = _ends(k)
        ink = draw.BLUE if _FROM[k] == chosen or _TO[k] == chosen else draw.GREY
        # Rates range over decades, so widths are logarithmic.
        width = 1.0 + 1.3 * math.log10(1.0 + _rate(k, controls, given, interval))
        draw.arrow(pen, x0, y0, x1, y1, ink, width, 8.0 + width, 1.0 if ink == draw.BLUE else 0.45)
    for k in range(len(_AT)):
        x, y = _AT[k]
        draw.box(
            pen,
            x - _W,
            x + _W,
            y - _H,
            y + _H,
            _CHOSEN if k == chosen else _QUIET,
            draw.INK if k == chosen else draw.GREY,
            2.2 if k == chosen else 1.2,
        )
        draw.text(pen, x, y, _NAMES + k, draw.INK, 13.0, draw.CENTRE)


@register_jitable
def _pulses(pen, state, now):
    """Return the messages in work, those that wait for a reader, and the age of the newest [s]."""
    newest = np.zeros(2)
    for k in range(2):
        x, y = _AT[PERCEPTION + k]
        count = state["jobs"][k]
        begun, done = state["begun"][k, :count], state["done"][k, :count]
        born = state["born"][k, :count]
        last = max(np.searchsorted(done, now, side="right") - 1, 0)
        # The newest finished message waits at the exit; those in work move along the box with their
        # progress.
        newest[k] = now - born[last]
        if k == 0:
            _pulse(pen, x + 1.02, y, newest[k], False)
        else:
            _pulse(pen, x, y - 1.2, newest[k], False)
        for job in range(last + 1, count):
            if begun[job] > now:
                break
            share = (now - begun[job]) / (done[job] - begun[job])
            _pulse(pen, x + _W * (2.0 * share - 1.0), y + _H, now - born[job], False)
    return newest


@register_jitable
def _flows(pen, controls, given, interval):
    """Draw what flows into the chosen box, and what flows out of it."""
    y = 2.3
    for direction in range(2):
        draw.text(
            pen,
            6.0,
            y,
            _OUT if direction else _IN,
            draw.INK,
            13.0,
            draw.LEFT,
            draw.MIDDLE,
            0.0,
            0.0,
            0.0,
            1.0,
        )
        for k in range(_FROM.size):
            if (_FROM[k] if direction else _TO[k]) != controls["box"]:
                continue
            y -= 0.26
            rate = _rate(k, controls, given, interval)
            flow = rate * _SIZES[k]
            draw.text(pen, 6.0, y, _FLOWS + k, draw.INK, 12.0)
            draw.words(pen, _COMMA)
            draw.number(pen, rate, 0 if rate >= 1.0 else 3, _HZ)
            big = flow >= 1e6
            draw.number(pen, flow * (1e-6 if big else 1e-3), 1, _MB if big else _KB)
        y -= 0.3


@register_jitable
def _histogram(pen, state, least, mean, greatest):
    """Draw the ages of the run, and the three lines that the closed form draws."""
    # The histogram is normalised to shares; least, mean and bound of the closed form are dashed.
    wide, high = 1150.0 * greatest, 1.25 * max(np.max(state["ages"]), 0.02)
    draw.area(pen, _HISTOGRAM, (0.0, wide, 0.0, high))
    draw.axes(pen, _AGE, _SHARE, _HIST, 4, 2)
    for k in range(_BINS):
        draw.box(pen, k * wide / _BINS, (k + 1) * wide / _BINS, 0.0, state["ages"][k], draw.BLUE)
    lines = (1000.0 * least, 1000.0 * mean, 1000.0 * greatest)
    for k in range(3):
        top, align = 0.88 * high, (draw.RIGHT, draw.CENTRE, draw.LEFT)[k]
        draw.segment(pen, lines[k], 0.0, lines[k], top, draw.ORANGE, 1.8, 1.0, 5.0, 3.0)
        draw.text(pen, lines[k], top, _L + k, draw.ORANGE, 11.0, align, draw.BOTTOM)


def frame(pen, state, controls):
    """Draw the graph at this moment, what flows through the chosen box, and all ages of the run."""
    least, mean, greatest, given, interval = predicted(controls)
    now, chosen = state["time"], controls["box"]
    _graph(pen, controls, given, interval)
    newest = _pulses(pen, state, now)
    command = now - commands(controls, state, np.array([now]))[0]
    _pulse(pen, 3.9, 0.95, command, True)
    draw.spot(pen, state["clicked"][0], state["clicked"][1], 0.05, draw.NONE, draw.GREY, 1.0)
    _flows(pen, controls, given, interval)
    _histogram(pen, state, least, mean, greatest)
    draw.window(pen)
    draw.reading(pen, _NOW, 1000.0 * command, 1, _MS)
    draw.reading(pen, _LEAST, 1000.0 * least, 1, _MS)
    draw.reading(pen, _MEAN, 1000.0 * mean, 1, _MS)
    draw.reading(pen, _RUN, 1000.0 * state["mean"], 1, _MS)
    draw.reading(pen, _GREATEST, 1000.0 * greatest, 1, _MS)
    draw.reading(pen, _RATE, 1.0 / interval, 1, _PER)
    # The age in the chosen box: its newest result, or the age of the image that the middleware
    # carries.
    here = command
    if chosen == PERCEPTION or chosen == PLANNING:
        here = newest[chosen - PERCEPTION]
    elif chosen == MIDDLEWARE:
        count = state["jobs"][0]
        born = state["born"][0, :count]
        here = now - born[max(np.searchsorted(born, now, side="right") - 1, 0)]
    aside = chosen == LEARNING or chosen == 1
    draw.reading(pen, _HERE, 1000.0 * here, 1, _MS, _NOT if aside else 0)


PRESETS = {
    "Comfortable": Preset(
        {},
        "Press play. Each dot is the content of an image, with its age in milliseconds. Time "
        "runs ten times slower than in reality. Click a box, or use the arrow keys. Dashed lines: "
        "the predicted least age, mean and bound.",
    ),
    "Slow perception": Preset(
        {"seeing": 120.0, "parallel": False},
        "One worker needs four periods of the camera for an image, so three images of four are "
        "lost. Then let several workers see.",
    ),
    "Deep queue": Preset(
        {"depth": 10, "rate": 5.0},
        "The queue before the planner keeps ten poses and hands out the oldest. Move its depth "
        "down to one.",
    ),
    "Locked clocks": Preset(
        {"locked": True, "phase": 0.95},
        "Camera and planner run from the same clock, so the phase between them never changes. The "
        "mean of the run differs from the prediction. Move the planner's phase.",
    ),
    "Overload": Preset(
        {"trigger": "on arrival", "depth": 10},
        "Each pose starts the planner. It needs 60 ms, but poses come every 33 ms: it is always "
        "busy, and its queue is always full.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "age of the command": (
        "Age of the measurement behind the command that is in force now: the time since the "
        "capture of its image."
    ),
    "least predicted": (
        "Smallest age of a command according to the formula: every stage finds its input fresh."
    ),
    "mean predicted": "Mean age of a command according to the formula.",
    "mean of the run": "Mean age of a command over the whole run, measured.",
    "bound predicted": (
        "Largest age of a command according to the formula: every stage just misses its input."
    ),
    "planner's results": "Plans that are finished per second.",
    "result of the box": (
        "Age of the newest result of the selected box: the dot on the arrow behind it. Images "
        "in the box itself are younger."
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
