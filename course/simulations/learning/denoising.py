"""Samples that flow from noise to data with two modes, with the exact velocity field."""

import math

import numpy as np
from numba.extending import register_jitable

from course.learning.generate import posterior_means
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

SAMPLES, MOST = 40, 50  # of the noise; of the solver's steps
_FINE = 100  # steps of Heun's method that stand for the exact flow
EULER, HEUN = 0, 1
_SPEED = 0.25  # of the clock, in units of the flow's time per second

CONTROLS = Record(
    steps=slider("Solver steps", 5, 1, MOST, 1, "", 0),
    solver=menu("Solver", ("Euler", "Heun")),
    time=slider("Time t (0 noise, 1 data)", 0.0, 0.0, 1.0, 0.01),
    share=slider("Share of the upper mode", 0.5, 0.1, 0.9, 0.05),
    width=slider("Standard deviation of each mode", 0.15, 0.05, 0.5, 0.01),
)
STATE = Record(
    time=Field(0.0),
    path=Field(0.0, shape=(MOST + 1, SAMPLES)),  # of the solver, at the ends of its steps
    exact=Field(0.0, shape=(_FINE + 1, SAMPLES)),
)

# Evenly spread quantiles of the noise: the samples of a standard normal distribution that 40 draws
# have on average. Hastings' rational approximation of the quantile (Abramowitz and Stegun, 26.2.23,
# absolute error below 4.5e-4).
_TAIL = np.sqrt(-2.0 * np.log((np.arange(SAMPLES // 2) + 0.5) / SAMPLES))
_UPPER = _TAIL - (2.515517 + 0.802853 * _TAIL + 0.010328 * _TAIL**2) / (
    1.0 + 1.432788 * _TAIL + 0.189269 * _TAIL**2 + 0.001308 * _TAIL**3
)
NOISE = np.concatenate((-_UPPER, _UPPER[::-1]))


@register_jitable
def mixture(controls):
    """Return weights (2,), means (2, 1) and deviations (2,) of the data, the lower mode first."""
    share = controls["share"]
    width = controls["width"]
    return np.array([1.0 - share, share]), np.array([[-1.0], [1.0]]), np.array([width, width])


@register_jitable
def velocity(controls, x, time):
    """Return the exact velocity (n,) of samples (n,): the mean of clean - noise, given each."""
    # Conditional flow matching (Lipman et al., 2023): along x = t clean + (1 - t) noise the
    # velocity is clean - noise; its mean given x is what a perfect network would learn.
    weights, means, deviations = mixture(controls)
    samples = x.copy().reshape(len(x), 1)
    clean, noise = posterior_means(weights, means, deviations, samples, time, 1.0 - time)
    return (clean - noise)[:, 0].copy()


@register_jitable
def flow(controls, steps, heun, path):
    """Write the samples at the ends of all steps of a solver into path (steps + 1 or more, n)."""
    x, h = NOISE.copy(), 1.0 / steps
    path[0] = x
    for k in range(steps):
        # Explicit Euler, or Heun's method: average the slopes at both ends of an Euler step.
        v = velocity(controls, x, k * h)
        if heun:
            v = 0.5 * (v + velocity(controls, x + h * v, (k + 1) * h))
        x = x + h * v
        path[k + 1] = x


@register_jitable
def position(path, steps, time):
    """Return the samples (n,) at a time, on the straight lines between the ends of the steps."""
    # The last interval also holds time 1.
    k = min(int(time * steps), steps - 1)
    along = time * steps - k
    return (1.0 - along) * path[k] + along * path[k + 1]


@register_jitable
def density(controls, y, time):
    """Return the exact density of the samples at a time, at positions (n,)."""
    weights, means, deviations = mixture(controls)
    result = np.zeros(len(y))
    # A mode at time t is normal with mean t m and variance (t d)² + (1 - t)², the mixture of both
    # exact.
    for k in range(2):
        variance = (time * deviations[k]) ** 2 + (1.0 - time) ** 2
        away = y - time * means[k, 0]
        result += (
            weights[k] * np.exp(-0.5 * away * away / variance) / math.sqrt(2.0 * math.pi * variance)
        )
    return result


@register_jitable
def distance(path, steps, exact, time):
    """Return the mean distance of the solver's samples from those of the exact flow at a time.

    Both keep the order of the samples if the steps are fine, so this is the Wasserstein distance of
    the two sets.
    """
    away = np.sort(position(path, steps, time)) - position(exact, _FINE, time)
    return np.sum(np.abs(away)) / SAMPLES


def initial(controls, state):
    """Compute both flows."""
    flow(controls, controls["steps"], controls["solver"] == HEUN, state["path"])
    flow(controls, _FINE, True, state["exact"])
    state["time"] = controls["time"]


def advance(state, controls, seconds):
    """Let the clock of the flow run to its end."""
    state["time"] = min(state["time"] + _SPEED * seconds, 1.0)


TITLE = "Denoising step by step: noise flows to data"
word, colour = draw.words_table(), draw.colours_table()
_PALE = colour("#dcefe5")[0]
_TIME, _SAMPLE, _PATHS = word("time t", "sample", "from noise (t = 0) to data (t = 1)")
_DENSITY, _NOW = word("density", "samples at this time")
_SOLVER_KEY, _EXACT_KEY, _MODES_KEY = word("path of the solver", "exact flow", "exact density")
_T, _STEPS, _CALLS, _OFF, _END, _BETWEEN = word(
    "time t",
    "solver steps",
    "field evaluations",
    "distance, now",
    "distance, at t = 1",
    "between the modes",
)
_PERCENT = word(" %")[0]
_LEFT, _RIGHT = (0.75, 5.4, 0.8, 4.2), (6.15, 8.85, 0.8, 4.2)
_LOW, _HIGH = -2.6, 2.6
_VALUES = (0.0, 1.0, _LOW, _HIGH)
_GRID = np.linspace(_LOW, _HIGH, 105)
_BINS = 26


@register_jitable
def _flows(pen, state, controls):
    """Draw the exact flow, the solver's steps up to now, and the samples now."""
    time, steps = state["time"], controls["steps"]
    draw.area(pen, _LEFT, _VALUES)
    # Bands of two standard deviations around both modes of the data.
    reach = 2.0 * controls["width"]
    for mode in (-1.0, 1.0):
        draw.box(pen, 0.0, 1.0, mode - reach, mode + reach, _PALE)
    draw.axes(pen, _TIME, _SAMPLE, _PATHS, 5, 5)
    times = np.linspace(0.0, 1.0, 26)
    # Every third path of the exact flow; paths of an ODE in one dimension never cross.
    for i in range(0, SAMPLES, 3):
        draw.curve(pen, times, state["exact"][:: _FINE // 25, i].copy(), draw.GREEN, 1.2, 0.8)
    now = position(state["path"], steps, time)
    # The ends of the steps so far, and the sample itself on its way through the present one.
    done = min(int(time * steps), steps - 1)
    for i in range(SAMPLES):
        draw.line(pen, draw.BLUE, 1.0, 0.8)
        for k in range(done + 1):
            draw.point(pen, k / steps, state["path"][k, i])
        draw.point(pen, time, now[i])
    # With more than 20 steps the ends of the steps would cover each other.
    if steps <= 20:
        for k in range(done + 1):
            draw.spots(pen, np.full(SAMPLES, k / steps), state["path"][k].copy(), 0.006, draw.BLUE)
    draw.segment(pen, time, _LOW, time, _HIGH, draw.GREY, 1.2)
    draw.spots(pen, np.full(SAMPLES, time), now, 0.011, draw.ORANGE)
    draw.window(pen)


@register_jitable
def _histogram(pen, state, controls):
    """Draw the samples now as bars, and the exact density."""
    now, exact = position(state["path"], controls["steps"], state["time"]), _GRID
    # Share of the samples in a bin over its width, comparable with a density.
    high = density(controls, exact, state["time"])
    size = (_HIGH - _LOW) / _BINS
    bars = np.zeros(_BINS)
    for x in now:
        k = math.floor((x - _LOW) / size)
        if 0 <= k < _BINS:
            bars[k] += 1.0 / (SAMPLES * size)
    # A scale in powers of two, so that it seldom changes.
    wide = 1.0
    while wide < 1.05 * max(np.max(high), np.max(bars)):
        wide *= 2.0
    draw.area(pen, _RIGHT, (0.0, wide, _LOW, _HIGH))
    draw.axes(pen, _DENSITY, 0, _NOW, 4, 5)
    for k in range(_BINS):
        if bars[k] > 0.0:
            low = _LOW + k * size
            draw.box(pen, 0.0, bars[k], low, low + size, draw.ORANGE, draw.NONE, 1.0, 0.55)
    draw.curve(pen, high, exact, draw.GREEN, 2.5)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw the paths of the samples, their distribution now, and the numbers."""
    _flows(pen, state, controls)
    _histogram(pen, state, controls)
    draw.key(pen, 0.75, 4.75, _SOLVER_KEY, draw.BLUE, 2.0)
    draw.key(pen, 2.6, 4.75, _EXACT_KEY, draw.GREEN, 2.0)
    draw.key(pen, 6.15, 4.75, _MODES_KEY, draw.GREEN, 2.5)
    steps = controls["steps"]
    draw.reading(pen, _T, state["time"], 2)
    draw.reading(pen, _STEPS, steps, 0)
    # Heun's method evaluates the field twice per step: compare solvers at equal evaluations.
    draw.reading(pen, _CALLS, 2 * steps if controls["solver"] == HEUN else steps, 0)
    draw.reading(pen, _OFF, distance(state["path"], steps, state["exact"], state["time"]), 3)
    draw.reading(pen, _END, distance(state["path"], steps, state["exact"], 1.0), 3)
    # Samples that end between the modes, more than three deviations inside both, belong to no data.
    end, reach = position(state["path"], steps, 1.0), 1.0 - 3.0 * controls["width"]
    draw.reading(pen, _BETWEEN, 100.0 * np.sum(np.abs(end) < reach) / SAMPLES, 0, _PERCENT)


def drag(controls, state, x, y):
    """Set the time to where the pointer is in the left picture."""
    controls["time"] = min(max(draw.values_at(_LEFT, _VALUES, x, y)[0], 0.0), 1.0)


def press(controls, state, key):
    """Handle a key: left and right move the time, up and down the number of steps."""
    if key < 2:
        change = -0.02 if key == 0 else 0.02
        controls["time"] = min(max(controls["time"] + change, 0.0), 1.0)
    elif key < 4:
        controls["steps"] = min(max(controls["steps"] + (1 if key == 2 else -1), 1), MOST)


PRESETS = {
    "Five Euler steps": Preset(
        {},
        "Press play, or drag the time. Noise flows along the exact velocity field. In each "
        "step Euler's method keeps the velocity of the step's beginning, so the samples arrive "
        "near the modes but not with the right spread. Raise the number of steps.",
    ),
    "One Euler step": Preset(
        {"steps": 1, "time": 1.0},
        "At t = 0 a sample is only noise and says nothing about the data. The best velocity points "
        "to the mean of all data, so one step takes every sample to the middle, where there are no "
        "data. Take two steps, then three.",
    ),
    "Five Heun steps": Preset(
        {"solver": 1},
        "Heun's method also evaluates the field at the end of each step and uses "
        "the mean of both velocities. Compare its distance at t = 1 with that of ten Euler steps, "
        "which evaluate the field as often.",
    ),
    "A rare mode": Preset(
        {"share": 0.1, "steps": 20},
        "One tenth of the data lie in the upper mode, and one tenth of the noise flows there. "
        "Where the paths part depends on the share. Make the modes narrower and lower the number "
        "of steps: the distance grows.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "time t": "Time of the flow: 0 is pure noise, 1 is data.",
    "solver steps": "Number of equal steps from noise to data.",
    "field evaluations": "How often the velocity field is evaluated: an Euler step does so once, "
    "a Heun step twice.",
    "distance, now": "Mean distance between the sorted samples and those of the exact flow.",
    "distance, at t = 1": "The same at the end, where the samples are used as actions.",
    "between the modes": "Share of the final samples more than three standard deviations inside of "
    "both modes.",
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
    readouts=READOUTS,
    upright=False,
)
