"""Chapter 8's simulation: one policy on the arm it was tuned for and on the real one.

Both rates of success are counted on common tasks after every change, in portions. The policies are
those on record (`course.sim_to_real.recorded`).
"""

import math

import numpy as np
from numba.extending import register_jitable

from course import sim_to_real as chapter
from course.control import sampled, touch
from course.sim_to_real import plants, transfer
from course.sim_to_real.motion import episodes
from course.sim_to_real.plants import HOME, SIZES
from course.sim_to_real.tune import DELAYS, GRID, KNOWN_DELAY
from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.interval import score_interval
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

COUNTED, PORTION, SEED, PAUSE = 256, 128, 17, 0.6  # episodes; of a portion; pause [s]
SAMPLES = round(plants.SECONDS / plants.DT)
NEAREST, FARTHEST = 0.15, 0.85  # of a target [m]
START = (0.3, 1.6)  # where the shown episode starts [rad]
PARTS, _LENGTHS = tuple(transfer.PARTS), tuple(map(float, plants.ARM.lengths))
NOMINAL, RANGE, IDENTIFIED, BOTH, DELAY, LOAD = range(6)
SIMULATED, REAL = range(2)
# What `report` holds: of both arms share, ends of its band, and how the shown episode ended; then
# the latest command that is stable [s], the gain margin, the part that costs most and what, and the
# success on the unchanged simulator. A share that is not counted yet is not a number.
SHARE, LOW, HIGH, ENDED = range(4)
LIMIT, GAIN, PART, COSTS, AT_HOME = range(8, 13)

CONTROLS = Record(
    gap=slider("Reality Gap", 0.3, 0.0, 1.0, 0.1, "", 1),
    width=slider("DR Range", 0.2, 0.0, 1.0, 0.1, "", 1),
    delay=slider("Actuator Delay", 10.0, 0.0, 40.0, 1.0, "ms", 0),
    policy=menu(
        "Tuned on",
        (
            "the unchanged simulator",
            "a range around it",
            "the arm, identified at 10 ms",
            "a range around that",
            "the simulator, delay corrected",
            "the simulator, load corrected",
        ),
        1,  # a range, so that each slider acts from the start
    ),
    aim=Field((-0.28, 0.56), low=-1.0, high=1.0, unit="m"),
)
STATE = Record(
    q=Field(0.0, shape=(2, 2, SAMPLES + 1), unit="rad"),
    report=Field(0.0, shape=(13,)),
    time=Field(0.0, unit="s"),
    remaining=Field(0),
)

# The gains on record, rows as in `tune.ROWS`.
_RECORD = {kind: rows[:, 0].copy() for kind, rows in chapter.recorded().items()}
_RANGE, _KNOWN, _BOTH = _RECORD["range"], _RECORD["known"], _RECORD["both"]
_DELAY, _LOAD = _RECORD["delay"], _RECORD["load"]
# The common tasks: starts and reference angles [rad], goals [m].
_TASKS = chapter.tasks(COUNTED, SEED)
_STARTS, _REFERENCES, _GOALS = _TASKS.start, _TASKS.reference, _TASKS.goal
# The controllers of both joints without their gains.
_CONTROLLERS = plants.controller_numbers(np.zeros((6, 1)))
# Which fields of an arm each part has.
_HAS = np.array([[name in transfer.PARTS[part] for name in plants.FIELDS] for part in PARTS])
_DELAYED, _LOADED = PARTS.index("delay"), PARTS.index("load")
_STEPS, _WIDTHS = len(DELAYS) - 1, len(GRID) - 1
# Portions: of both arms, then of the unchanged simulator, then of each part.
_BLOCKS = COUNTED // PORTION
_UNCHANGED, _PORTIONS = 2 * _BLOCKS, 2 * _BLOCKS + 1 + len(PARTS)


@register_jitable
def unit_noise():
    """Return standard normal numbers for the encoders in all episodes, (samples, 2, COUNTED)."""
    seed, noise = np.zeros(1, np.uint64), np.empty((SAMPLES + 1) * 2 * COUNTED)
    seed[0] = SEED
    splitmix.normal(seed, noise)
    return noise.reshape(SAMPLES + 1, 2, COUNTED)


@register_jitable
def run_episodes(fields, gains, start, reference, goal, noise, trace):
    """Return what became of the episodes of one arm, rows of `plants.Outcome`, (4, E).

    Args:
        fields: of the arm, (8, 1), as `plants.FIELDS`.
        gains: (6,), as `plants.GAINS`.
        start: angles at rest (2, E) [rad].
        reference: angles of the target (2, E) [rad].
        goal: the target (2, E) [m].
        noise: unit normals of the encoders, (samples, 2, E or more).
        trace: (10, E, samples) for the motion, or with no first axis for none.
    """
    count = start.shape[1]
    rest, out = np.zeros((4, count)), np.empty((4, count))
    rest[:2] = start
    numbers = _CONTROLLERS.copy()
    numbers[0, :, :3] = gains.copy().reshape(2, 3)
    arm, plan = plants.columns_of(fields), np.empty((0, 2, 1))
    goals, references, sizes = goal.copy(), reference.copy(), SIZES.copy()
    episodes(arm, numbers, rest, references, goals, noise, plan, sizes, out, trace)
    return out


@register_jitable
def success(fields, gains, block, noise):
    """Return the share of the common tasks of one block, of `PORTION` tasks, that succeed."""
    some = slice(PORTION * block, PORTION * (block + 1))
    return np.mean(
        run_episodes(
            fields,
            gains,
            _STARTS[:, some],
            _REFERENCES[:, some],
            _GOALS[:, some],
            noise[:, :, some].copy(),
            np.empty((0, 1, 1)),
        )[0]
    )


@register_jitable
def mended(actual, part):
    """Return the fields (8, 1) of the simulator with one part taken from an arm (8, 1)."""
    fields = HOME.copy()
    for k in range(len(fields)):
        if _HAS[part, k]:
            fields[k] = actual[k]
    return fields


@register_jitable
def policy(kind, gap, width, delay):
    """Return gains (6,), and fields (8, 1) of the arm they were tuned on, the middle of a range.

    Args:
        kind: number of the policy in the menu.
        gap: of the real arm.
        width: of the range.
        delay: of the command [s].
    """
    # Rows of the record, each a tenth of a gap or of a width, or a millisecond.
    at = min(max(int(_WIDTHS * gap + 0.5), 0), _WIDTHS)
    wide = min(max(int(_WIDTHS * width + 0.5), 0), _WIDTHS)
    late = min(max(int(1e3 * delay + 0.5), 0), _STEPS)
    # Nominal or domain randomisation about it, system identification, or both.
    gains, fields = _RANGE[0], HOME.copy()
    if kind == RANGE:
        gains = _RANGE[wide]
    elif kind == IDENTIFIED or kind == BOTH:
        gains = _KNOWN[at] if kind == IDENTIFIED else _BOTH[at]
        fields = plants.fields_of(at / _WIDTHS, KNOWN_DELAY)
    elif kind == DELAY:
        gains, fields = _DELAY[late], mended(plants.fields_of(0.0, 1e-3 * late), _DELAYED)
    elif kind == LOAD:
        gains, fields = _LOAD[at], mended(plants.fields_of(at / _WIDTHS, 0.0), _LOADED)
    return gains, fields


@register_jitable
def stability(arm, gains):
    """Return the latest command at which each joint alone is stable [s], and the gain margin.

    Args:
        arm: columns of one arm, (12, 1), as `plants.Plants.columns`.
        gains: (6,).
    """
    # Each joint alone is a linear loop, the inertia that of the start posture: delay and gain
    # margins from its crossover frequencies.
    limit, gain, delay = 99.0, 99.0, arm[8, 0]
    whole = math.floor(delay / plants.DT + 1e-9)
    rest = max(0.0, delay - whole * plants.DT)
    for k in range(2):
        inertia = arm[0, 0] + 2.0 * arm[1, 0] * math.cos(START[1]) if k == 0 else arm[2, 0]
        kp, ki, kd = arm[7, 0] * gains[3 * k], arm[7, 0] * gains[3 * k + 1], 0.0
        kd = arm[7, 0] * gains[3 * k + 2]
        law = sampled._pid(kp, ki, kd, plants.DT, 0, plants.FILTER)
        for late in range(2):
            # Without any delay the margin is the limit; with the arm's the gain margin is asked.
            step, waits = (rest, whole) if late == 1 else (0.0, 0)
            joint = touch.held_mass(inertia, arm[3 + k, 0], 0.0, plants.DT, step)
            at, lags, _, reals = sampled._crossed(*joint, waits, *law)
            margins = sampled._margins(at, lags, reals, plants.DT)
            if late == 1:
                gain = min(gain, margins[0])
            else:
                limit = min(limit, margins[3])
    return limit, gain if delay < limit else 0.0


@register_jitable
def _setting(controls):
    """Return the gains, and the fields of the arm they were tuned on and of the real arm."""
    gap, delay = controls["gap"], 1e-3 * controls["delay"]
    gains, believed = policy(controls["policy"], gap, controls["width"], delay)
    return gains, believed, plants.fields_of(gap, delay)


def complete(controls, state):
    """Count one more portion of the common tasks; both arms get the same tasks."""
    gains, believed, arm = _setting(controls)
    report, noise, at = state["report"], unit_noise(), _PORTIONS - state["remaining"]
    if at < _UNCHANGED:
        # The same tasks on the arm in simulation and on the real one: the difference is the reality
        # gap. Both shares grow side by side.
        k, block = at % 2, at // 2
        share = success(believed if k == SIMULATED else arm, gains, block, noise)
        if block > 0:
            share = (block * report[4 * k + SHARE] + share) / (block + 1)
        low, high = score_interval(share, PORTION * (block + 1))
        report[4 * k + SHARE], report[4 * k + LOW], report[4 * k + HIGH] = share, low, high
    elif at == _UNCHANGED:
        # Attribute the gap: the nominal arm with a single part taken from the real one, and the
        # success that this costs alone. These costs need not add up.
        report[AT_HOME], report[COSTS] = success(HOME.copy(), gains, 0, noise), -1.0
    else:
        part = at - _UNCHANGED - 1
        cost = report[AT_HOME] - success(mended(arm, part), gains, 0, noise)
        if cost > report[COSTS]:
            report[PART], report[COSTS] = part, cost
    state["remaining"] -= 1


@register_jitable
def _target(controls):
    """Return where the tip has to go: as near to where the pointer was as the arm reaches well."""
    x, y = controls["aim"]
    r = math.hypot(x, y)
    # The target is pulled into the annulus that the arm reaches well.
    factor = min(max(r, NEAREST), FARTHEST) / r if r > 1e-9 else 0.0
    return (x * factor, y * factor) if r > 1e-9 else (NEAREST, 0.0)


@register_jitable
def show(controls, state):
    """Run the shown episode on both arms, from a fixed start to the target."""
    gains, believed, arm = _setting(controls)
    start, goal = np.empty((2, 1)), np.empty((2, 1))
    start[0, 0], start[1, 0] = START
    goal[0, 0], goal[1, 0] = _target(controls)
    reference, noise = plants.reference_angles(start, goal), unit_noise()
    for k in range(2):
        trace = np.zeros((10, 1, SAMPLES + 1))
        fields = believed if k == SIMULATED else arm
        ended = run_episodes(fields, gains, start, reference, goal, noise, trace)[3, 0]
        state["q"][k], state["report"][4 * k + ENDED] = trace[:2, 0], ended


def initial(controls, state):
    """Run the shown episode on both arms; the common tasks are counted in portions."""
    gains, _, arm = _setting(controls)
    report = state["report"]
    report[LIMIT], report[GAIN] = stability(plants.columns_of(arm), gains)
    report[SHARE], report[4 + SHARE] = math.nan, math.nan
    state["remaining"] = _PORTIONS
    show(controls, state)


def advance(state, controls, seconds):
    """Advance the simulation: the episode is shown again and again."""
    state["time"] += seconds


TITLE = "One policy, two arms"
word, colour = draw.words_table(), draw.colours_table()
_SAND = colour("#f7f5ef")[0]
_ARM, _HEADING = word("the arm it was tuned on", "the real arm")[0], word("simulated", "real")[0]
_REASON, _PART = word(*plants.REASONS)[0], word(*PARTS)[0]
_RATE, _FAR, _TIME, _TARGET, _LATE, _LIMIT = word(
    "successes [%]", "tip to target [cm]", "time [s]", "target", "actuator delay [ms]", "limit"
)
_SUCCESS, _SHOWN = word("success, simulated", "success, real")[0], word("this reach, simulated")[0]
_BAND, _TO, _CLOSE, _PERCENT, _MS, _NONE, _COMMA = word(" % (", "-", ")", " %", " ms", "none", ", ")
_REALLY, _STABLE, _GAIN, _WORST, _SPARE, _COUNTING = word(
    "this reach, real",
    "longest stable delay",
    "gain margin",
    "costliest difference",
    "delay to spare",
    "being counted",
)
_COLOUR = (draw.BLUE, draw.ORANGE)
_SCENES, _VIEW = ((0.1, 3.0, 1.7, 4.6), (3.15, 6.05, 1.7, 4.6)), (-0.95, 0.95, -0.95, 0.95)
_RATES = ((0.25, 2.85, 0.75, 1.05), (3.3, 5.9, 0.75, 1.05))
_CHART, _GAUGE = (6.75, 8.85, 2.3, 4.4), (6.75, 8.85, 0.75, 1.05)


@register_jitable
def _tips(q):
    """Return elbow and tip of angles (2, ...) [m]."""
    l1, l2 = _LENGTHS
    x, y = l1 * np.cos(q[0]), l1 * np.sin(q[0])
    return x, y, x + l2 * np.cos(q[0] + q[1]), y + l2 * np.sin(q[0] + q[1])


@register_jitable
def _links(pen, q, ink, width, alpha):
    """Draw an arm as two lines, its joints and its tip."""
    x, y, u, v = _tips(q)
    draw.curve(pen, np.array([0.0, x, u]), np.array([0.0, y, v]), ink, width, alpha)
    draw.spots(pen, np.array([0.0, x, u]), np.array([0.0, y, v]), 0.022, ink, draw.NONE, 1.5, alpha)


def frame(pen, state, controls):
    """Draw both arms, the simulated one as a ghost over the real, and their numbers."""
    report = state["report"]
    x, y = _target(controls)
    # Time runs through the episode and a pause, then again.
    now = int(min(state["time"] % (plants.SECONDS + PAUSE), plants.SECONDS) / plants.DT + 1e-9)
    t = np.linspace(0.0, plants.SECONDS, SAMPLES + 1)
    for k in range(2):
        draw.area(pen, _SCENES[k], _VIEW)
        draw.box(pen, *_VIEW, _SAND, draw.GREY)
        draw.title(pen, _VIEW[0], _VIEW[3], _ARM + k)
        draw.spot(pen, x, y, plants.RADIUS, draw.GREEN, draw.INK, 1.0, 0.7)
        if k == REAL:
            # The simulated arm as a ghost over the real one, at the same moment.
            _links(pen, state["q"][SIMULATED, :, now], _COLOUR[SIMULATED], 4.0, 0.3)
        _, _, u, v = _tips(state["q"][k, :, : now + 1])
        draw.curve(pen, u, v, _COLOUR[k], 1.4, 0.8)
        _links(pen, state["q"][k, :, now], _COLOUR[k], 5.0, 1.0)
        share, low, high = (
            100.0 * report[4 * k],
            100.0 * report[4 * k + 1],
            100.0 * report[4 * k + 2],
        )
        # Success rates as bars with Wilson's interval.
        draw.chart(pen, _RATES[k], (0.0, 100.0, 0.0, 1.0), _RATE, 0, 0, 5, 0)
        if not math.isnan(share):
            draw.box(pen, 0.0, share, 0.0, 1.0, _COLOUR[k])
            draw.segment(pen, low, 0.5, high, 0.5, draw.INK, 3.0)
            for end in (low, high):
                draw.segment(pen, end, 0.15, end, 0.85, draw.INK, 2.0)
    draw.chart(pen, _CHART, (0.0, plants.SECONDS, 0.0, 50.0), _TIME, 0, _FAR, 3, 5)
    draw.segment(
        pen,
        0.0,
        100.0 * plants.RADIUS,
        plants.SECONDS,
        100.0 * plants.RADIUS,
        draw.GREEN,
        1.5,
        1.0,
        4.0,
        3.0,
    )
    for k in range(2):
        _, _, u, v = _tips(state["q"][k, :, : now + 1])
        draw.curve(pen, t[: now + 1], 100.0 * np.hypot(u - x, v - y), _COLOUR[k], 2.0)
    # The delay against the latest one at which a joint alone is stable.
    draw.gauge(pen, _GAUGE, 40.0, controls["delay"], draw.GREY, _LATE, 1e3 * report[LIMIT], _LIMIT)
    draw.window(pen)
    for k in range(2):
        draw.key(pen, 6.75 + 1.15 * k, 1.62, _HEADING + k, _COLOUR[k], 4.0)
        counted = not math.isnan(report[4 * k])
        draw.reading(pen, _SUCCESS + k, 100.0 * report[4 * k], 0, 0, 0 if counted else _COUNTING)
        if counted:
            draw.words(pen, _BAND)
            draw.number(pen, 100.0 * report[4 * k + LOW], 0, _TO)
            draw.number(pen, 100.0 * report[4 * k + HIGH], 0, _CLOSE)
    for k in range(2):
        ended = _REASON + int(report[4 * k + ENDED])
        draw.reading(pen, _SHOWN if k == SIMULATED else _REALLY, 0.0, 0, 0, ended)
    draw.reading(pen, _STABLE, 1e3 * report[LIMIT], 1, _MS)
    draw.reading(pen, _SPARE, 1e3 * report[LIMIT] - controls["delay"], draw.SIGNED + 1, _MS)
    draw.reading(pen, _GAIN, report[GAIN], 2, 0, 0 if report[GAIN] > 0.0 else _NONE)
    worst = _PART + int(report[PART]) if report[COSTS] > 0.0 else _NONE
    if state["remaining"] > 0:
        worst = _COUNTING
    draw.reading(pen, _WORST, 0.0, 0, 0, worst)
    if report[COSTS] > 0.0 and state["remaining"] == 0:
        draw.words(pen, _COMMA)
        draw.number(pen, 100.0 * report[COSTS], 0, _PERCENT)


def drag(controls, state, x, y):
    """Handle a drag: the target of both arms follows the pointer in either picture."""
    u, v = draw.values_at(_SCENES[SIMULATED if x < _SCENES[REAL][0] else REAL], _VIEW, x, y)
    controls["aim"][0] = min(max(u, -1.0), 1.0)
    controls["aim"][1] = min(max(v, -1.0), 1.0)
    # Only the shown episode depends on it.
    state["time"] = 0.0
    show(controls, state)


PRESETS = {
    "Gap": Preset(
        {},
        "A policy that never fails in its simulator, on an arm that differs a "
        "little. Raise the gap, and successes are lost. Then raise DR Range, and part of them "
        "comes back. Drag the target: the ghost is the simulated motion.",
    ),
    "No range": Preset(
        {"policy": NOMINAL},
        "The same arm with a policy that was tuned on the "
        "unchanged simulator. DR Range does nothing here, because no range was used.",
    ),
    "No gap": Preset(
        {"gap": 0.0, "delay": 0.0, "policy": NOMINAL},
        "The real arm equals the "
        "simulated one, and all reaches succeed. Then give it 10 ms of delay.",
    ),
    "Gap and range": Preset(
        {"width": 0.4},
        "Tuned on arms that differ in every "
        "episode: part of the loss comes back, and in the simulator no success is lost.",
    ),
    "Wide range, far gap": Preset(
        {"gap": 1.0, "width": 1.0},
        "The widest range "
        "at the full gap: little more than half succeed. In the simulator the range costs no "
        "success, only time in the target. Gains for the identified arm do far better.",
    ),
    "Delay beyond the margin": Preset(
        {"gap": 0.0, "delay": 20.0, "policy": NOMINAL},
        "No gap but "
        "a delay that is longer than the longest stable one: hardly one reach succeeds. At 12 ms, "
        "well below it, most succeed: those that end with a folded arm.",
    ),
    "Cancelling errors": Preset(
        {"gap": 0.3, "delay": 20.0, "policy": NOMINAL},
        "The same delay on "
        "an arm that differs in all else, too: most reaches succeed. Its load makes it slower, and "
        "a slower arm stays stable with a longer delay. Set the gap to zero, and they fail.",
    ),
    "Mended delay alone": Preset(
        {"gap": 1.0, "policy": DELAY},
        "The simulator has the true "
        "delay, and the real arm does worse than with gains from the unchanged simulator: the "
        "gains are lower, and the load needs higher ones. Now correct the load, too.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "success, simulated": "Successful episodes in the simulator, with a 95 % confidence interval.",
    "success, real": (
        "Successful episodes on the arm that stands for the real one, with a 95 % confidence "
        "interval."
    ),
    "this reach, simulated": "How the episode shown ended in the simulator.",
    "this reach, real": "How the same episode ended on the real arm.",
    "longest stable delay": (
        "Longest delay of the real arm's commands at which both joints are stable, each with the "
        "other one locked (computed)."
    ),
    "delay to spare": "The longest stable delay minus the actuator delay.",
    "gain margin": "Factor by which the loop gain can rise before the joint becomes unstable.",
    "costliest difference": (
        "The difference that costs the most successes if it is the only one, and how many."
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
    drag,
    live_drag=True,
    readouts=READOUTS,
    complete=complete,
)
