"""A cloned policy follows a path: errors grow where its data end, and how fast the cost grows.

On the path a step goes wrong with a small probability. A wrong step leaves the band that the
demonstrations cover, where the next one goes wrong with another probability. A right step leads
back. Of 1 off the band this is the worst case of behaviour cloning; of the same probability on and
off it, DAgger's bound (Ross and Bagnell, 2010; Ross, Gordon and Bagnell, 2011).
"""

import numpy as np
from numba.extending import register_jitable

from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider

LONGEST, RUNS, SHOWN = 200, 1000, 24  # steps; runs, and how many of them are drawn
STEP = 0.02  # m to the side with each wrong step
BAND = 0.01  # half the width of the demonstrated band [m]
_SPEED = 25.0  # steps per second

CONTROLS = Record(
    inside=slider("Error rate on the demonstrated path ε", 1.0, 0.0, 5.0, 0.1, "%", 1),
    outside=slider("Error rate off the path", 100.0, 0.0, 100.0, 1.0, "%", 0),
    steps=slider("Length of the task T", 100, 10, LONGEST, 5, "steps", 0),
    seed=slider("Seed of the runs", 1, 1, 99, 1, "", 0),
)
STATE = Record(
    seed=Field(np.uint64(0), shape=(1,)),
    place=Field(0.0, shape=(LONGEST + 1, SHOWN), unit="m"),  # to the side of the path
    rate=Field(0.0, shape=(LONGEST + 1,)),  # share of the runs whose step was wrong
    cost=Field(0.0, shape=(LONGEST + 1,)),  # mean of the wrong steps so far
    now=Field(0.0),  # step
)


@register_jitable
def wrong_rates(inside, outside, steps):
    """Return the probability that each step from 0 to `steps` is wrong (steps + 1,), 0 at first.

    A step after a right one is wrong with the probability `inside`, after a wrong one `outside`, so
    p' = inside + (outside - inside) p.
    """
    # A two-state Markov chain, on and off the band, started on it: its recursion for the
    # probability of being off.
    rates = np.zeros(steps + 1)
    for t in range(steps):
        rates[t + 1] = inside + (outside - inside) * rates[t]
    return rates


@register_jitable
def rates_of(controls):
    """Return the error rates on and off the path as numbers from 0 to 1."""
    return 0.01 * controls["inside"], 0.01 * controls["outside"]


@register_jitable
def mean_cost(controls, steps):
    """Return the expected number of wrong steps up to each step (steps + 1,)."""
    inside, outside = rates_of(controls)
    return np.cumsum(wrong_rates(inside, outside, steps))


def initial(controls, state):
    """Let all runs go through the whole task."""
    state["seed"][0] = controls["seed"]
    inside, outside = rates_of(controls)
    chance, sides = np.empty(RUNS), np.empty(RUNS)
    off, wrong, total = np.zeros(RUNS), np.zeros(RUNS), 0.0
    # Each run drifts to one side, chosen once.
    splitmix.uniform(state["seed"], sides)
    side = np.where(sides < 0.5, -1.0, 1.0)
    for t in range(controls["steps"]):
        splitmix.uniform(state["seed"], chance)
        # The state of each run is whether its last step was wrong; it selects the rate of the next
        # one.
        wrong = np.where(chance < np.where(wrong > 0.0, outside, inside), 1.0, 0.0)
        # A right action leads back to the path; a wrong one leads further to the side.
        off = (off + STEP) * wrong
        state["place"][t + 1] = (side * off)[:SHOWN]
        state["rate"][t + 1] = np.sum(wrong) / RUNS
        total += state["rate"][t + 1]
        state["cost"][t + 1] = total


def advance(state, controls, seconds):
    """Let all runs move along the path."""
    state["now"] = min(state["now"] + _SPEED * seconds, float(controls["steps"]))


TITLE = "How a cloned policy drifts off its data"
word, colour = draw.words_table(), draw.colours_table()
_GREEN = colour("#c3e3d3")[0]
_STEP, _SIDE, _ROAD = word("step", "off the path [m]", "runs of the cloned policy")
_COST, _GROWTH = word("wrong steps", "mean number of wrong steps")
_BAND_KEY, _RUN_KEY, _OFF_KEY, _MEASURED_KEY, _EXPECTED_KEY, _SQUARE_KEY, _LINE_KEY = word(
    "demonstrated band", "on the path", "off it", "measured", "expected", "½ ε T²", "ε T (recovers)"
)
_NOW, _LOST, _EXPECTED, _MEASURED, _SQUARE, _LINEAR = word(
    "step now",
    "runs off the band",
    "expected at T",
    "measured to T",
    "½ ε T², no recovery",
    "ε T, recovers",
)
_PERCENT = word(" %")[0]
_LEFT, _RIGHT = (0.8, 4.9, 0.8, 4.05), (5.85, 8.85, 0.8, 4.05)


@register_jitable
def _runs(pen, state, controls):
    """Draw the band of the demonstrations and the runs up to now."""
    steps, now = controls["steps"], int(state["now"])
    # A scale in powers of two that holds all runs, so that it seldom changes.
    high = 0.1
    while high < np.max(np.abs(state["place"][: steps + 1])):
        high *= 2.0
    draw.area(pen, _LEFT, (0.0, 1.0 * steps, -1.1 * high, 1.1 * high))
    half = max(BAND, 0.03 * high)  # a band far thinner than the picture would not be seen
    draw.box(pen, 0.0, 1.0 * steps, -half, half, _GREEN)
    draw.axes(pen, _STEP, _SIDE, _ROAD, 5, 5)
    times = np.arange(now + 1) * 1.0
    for k in range(SHOWN):
        place = state["place"][: now + 1, k].copy()
        # Orange marks the runs that are off the band now.
        ink = draw.ORANGE if place[now] != 0.0 else draw.BLUE
        draw.curve(pen, times, place, ink, 1.3, 0.8)
        draw.spot(pen, 1.0 * now, place[now], 0.008 * steps, ink)
    draw.window(pen)


@register_jitable
def _growth(pen, state, controls):
    """Draw the mean number of wrong steps, its expectation, the square law and the line."""
    steps, now, inside = controls["steps"], int(state["now"]), rates_of(controls)[0]
    expected = mean_cost(controls, steps)
    # Room for the measured cost, its expectation and twice the line of DAgger.
    high = max(1.15 * expected[steps], 1.15 * state["cost"][steps], 2.0 * inside * steps, 0.5)
    times = np.arange(steps + 1) * 1.0
    draw.area(pen, _RIGHT, (0.0, 1.0 * steps, 0.0, high))
    draw.axes(pen, _STEP, _COST, _GROWTH, 5, 5)
    # Behaviour cloning's quadratic bound, DAgger's line, the exact expectation, and the measured
    # mean.
    draw.curve(pen, times, 0.5 * inside * times * times, draw.RED, 2.0, 0.9, 6.0, 4.0)
    draw.curve(pen, times, inside * times, draw.GREEN, 2.5)
    draw.curve(pen, times, expected, draw.INK, 1.6, 0.8, 5.0, 4.0)
    draw.curve(pen, times[: now + 1], state["cost"][: now + 1].copy(), draw.PURPLE, 2.5)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw the runs, the growth of their cost, and the numbers."""
    _runs(pen, state, controls)
    _growth(pen, state, controls)
    draw.key(pen, 0.1, 4.72, _BAND_KEY, _GREEN, 6.0)
    draw.key(pen, 1.95, 4.72, _RUN_KEY, draw.BLUE, 2.0)
    draw.key(pen, 3.2, 4.72, _OFF_KEY, draw.ORANGE, 2.0)
    draw.key(pen, 4.05, 4.72, _MEASURED_KEY, draw.PURPLE, 2.5)
    draw.key(pen, 5.3, 4.72, _EXPECTED_KEY, draw.INK, 1.6, 0.8, 5.0, 4.0)
    draw.key(pen, 6.5, 4.72, _SQUARE_KEY, draw.RED, 2.0, 0.9, 6.0, 4.0)
    draw.key(pen, 7.5, 4.72, _LINE_KEY, draw.GREEN, 2.5)
    steps, now, inside = controls["steps"], int(state["now"]), rates_of(controls)[0]
    draw.reading(pen, _NOW, now, 0)
    draw.reading(pen, _LOST, 100.0 * state["rate"][now], 0, _PERCENT)
    draw.reading(pen, _EXPECTED, mean_cost(controls, steps)[steps], 2)
    draw.reading(pen, _MEASURED, state["cost"][steps], 2)
    draw.reading(pen, _SQUARE, 0.5 * inside * steps * steps, 2)
    draw.reading(pen, _LINEAR, inside * steps, 2)


PRESETS = {
    "Lost after one error": Preset(
        {},
        "Press play. After its first error a run is in states that no demonstration showed, "
        "and every later step is wrong too. At first the cost grows with the square of time, ½ ε "
        "T². Once most runs are lost it grows by one wrong step per step.",
    ),
    "A small error rate": Preset(
        {"inside": 0.1},
        "While ε T is small, the cost follows the square law closely. Double the "
        "length of the task: the cost becomes about four times as large.",
    ),
    "DAgger: labels off the path too": Preset(
        {"inside": 1.0, "outside": 1.0},
        "The expert has also labelled the states beside the path, so a step there is wrong no more "
        "often than on it. Each error costs only itself, and the cost grows in proportion to time, "
        "ε T. Raise the error rate off the path step by step.",
    ),
    "Errors are often corrected": Preset(
        {"outside": 80.0, "inside": 1.0},
        "Off the path the policy is wrong in four of five steps. An error then costs five steps on "
        "average, but it does not last, so the cost grows in proportion to time. Compare 80 % with "
        "99 %.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "step now": "How many steps the runs have made.",
    "runs off the band": "Share of all 1000 runs whose present step was wrong.",
    "expected at T": "Expected number of wrong steps of a run, from the two error rates.",
    "measured to T": "Mean number of wrong steps of the 1000 runs at their end, simulated ahead.",
    "½ ε T², no recovery": "Square law for a policy that never returns; good while ε T is small.",
    "ε T, recovers": "Expected wrong steps if the error rate is the same on and off the path.",
}

PAPER = draw.Paper(TITLE, word, colour, room=30_000)
MODEL = Model(TITLE, PAPER, CONTROLS, STATE, PRESETS, initial, advance, frame, readouts=READOUTS)
