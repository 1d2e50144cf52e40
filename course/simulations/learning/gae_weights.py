"""Generalised advantage estimation: its weights as bars, and what they cost in bias and noise.

A path of some steps leads to a prize of 1. The rewards carry noise, and the critic's values are off
by a constant. Bias and noise of the advantage of the first action then have closed forms.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider
from course.simulations.rigid_body.turning import whole_steps

LONGEST = 30  # steps of a path, at most
BEYOND = 10  # steps from a truncated end to the prize
TERMINATED, TRUNCATED = 0, 1
_PACE, _EACH = 0.25, 10  # s from one batch of paths to the next; paths in a batch

CONTROLS = Record(
    trace=slider("λ (trace)", 0.95, 0.0, 1.0, 0.01, live=True),
    discount=slider("γ (discount)", 0.99, 0.8, 1.0, 0.01),
    steps=slider("Steps to the end of the path", 20, 2, LONGEST, 1, "", 0),
    end=menu("How the path ends", ("terminated: prize reached", "truncated: time limit")),
    error=slider("Critic's error, in every state", 0.2, -0.5, 0.5, 0.05),
    noise=slider("Noise of each reward, standard deviation", 0.1, 0.0, 0.5, 0.01),
)
STATE = Record(
    seed=Field(np.uint64(7), shape=(1,)),
    errors=Field(0.0, shape=(LONGEST,)),  # temporal-difference errors of the last path
    # Of the first action's advantage over all paths so far: count, mean, and the sum of squared
    # deviations from the mean.
    count=Field(0),
    mean=Field(0.0),
    squares=Field(0.0),
    trace=Field(0.95),  # of the estimates that were counted
    owed=Field(0.0, unit="s"),
)


@register_jitable
def error_weights(discount, trace, steps):
    """Return the weights (steps,) that GAE gives to the temporal-difference errors."""
    # Schulman et al. (2016), eq. 16: the advantage is the sum of (γ λ)^l times the TD error at l.
    return (discount * trace) ** np.arange(steps)


@register_jitable
def n_step_weights(trace, steps):
    """Return the weights (steps,) that GAE gives to the n-step advantages, n = 1 to steps.

    They are (1 - lambda) lambda^(n - 1). All n that reach beyond the end give the same advantage,
    so the last weight is the sum of theirs, lambda^(steps - 1).
    """
    weights = (1.0 - trace) * trace ** np.arange(steps)
    weights[steps - 1] = trace ** (steps - 1)
    return weights


@register_jitable
def values_of(controls):
    """Return the critic's values (steps + 1,) on the path, the last one of where it ends."""
    # With a prize of 1 the exact value is γ to the number of steps that remain; the critic is off
    # by a constant in every state, but a terminal state has value 0 by definition.
    steps, beyond = controls["steps"], BEYOND if controls["end"] == TRUNCATED else 0
    left = steps - 1.0 + beyond - np.arange(steps + 1)
    # The last power is not used if the path is terminated; its value is zero then.
    values = controls["discount"] ** np.maximum(left, 0.0) + controls["error"]
    if controls["end"] == TERMINATED:
        values[steps] = 0.0
    return values


@register_jitable
def rewards_of(controls, noise):
    """Return the rewards (steps,) of a path for standard normal noise (steps,)."""
    rewards = controls["noise"] * noise
    # Only a terminated path has reached the prize; a truncated one bootstraps from the last value.
    if controls["end"] == TERMINATED:
        rewards[-1] += 1.0
    return rewards


@register_jitable
def temporal_differences(controls, noise):
    """Return the temporal-difference errors (steps,) of a path."""
    values = values_of(controls)
    # TD error: r + γ V(next) - V(now).
    return rewards_of(controls, noise) + controls["discount"] * values[1:] - values[:-1]


@register_jitable
def bias(controls, trace):
    """Return the error to expect of the estimated return, the advantage plus the critic's value.

    Each temporal-difference error is off by gamma times the critic's error after the step, less
    its error before it. The error of the first value itself is a baseline and is added back.
    """
    steps, gamma, error = controls["steps"], controls["discount"], controls["error"]
    # Differences of a constant error telescope but for the factor γ - 1; a terminal value has no
    # error to add.
    weights = error_weights(gamma, trace, steps)
    result = error + (gamma - 1.0) * error * np.sum(weights)
    if controls["end"] == TERMINATED:
        result -= gamma * error * weights[steps - 1]
    return result


@register_jitable
def deviation(controls, trace):
    """Return the standard deviation of the advantage: independent noise in each reward."""
    # Independent noise: variances add up with the squares of the weights.
    weights = error_weights(controls["discount"], trace, controls["steps"])
    return controls["noise"] * math.sqrt(np.sum(weights * weights))


@register_jitable
def sample(controls, state):
    """Sample a path, and count the estimate that it makes of the first action's advantage."""
    steps = controls["steps"]
    noise = np.empty(steps)
    splitmix.normal(state["seed"], noise)
    errors = temporal_differences(controls, noise)
    state["errors"][:steps] = errors
    advantage = np.sum(error_weights(controls["discount"], controls["trace"], steps) * errors)
    # Paths with another λ are discarded, so that the measured bias and deviation belong to one
    # estimator.
    if state["trace"] != controls["trace"]:
        state["trace"] = controls["trace"]
        state["count"], state["mean"], state["squares"] = 0, 0.0, 0.0
    # Welford (1962): without noise all advantages are equal, and the deviation is exactly 0. The
    # mean of the squares less the square of the mean would leave the root of rounding.
    state["count"] += 1
    change = advantage - state["mean"]
    state["mean"] += change / state["count"]
    state["squares"] += change * (advantage - state["mean"])


def initial(controls, state):
    """Sample the first path."""
    sample(controls, state)


def advance(state, controls, seconds):
    """Sample the paths that are due."""
    # Not more than 20 batches at once, after a pause of the page.
    for _ in range(_EACH * min(whole_steps(state, seconds, _PACE), 20)):
        sample(controls, state)


TITLE = "Weights of generalised advantage estimation"
word, colour = draw.words_table(), draw.colours_table()
_AHEAD, _WEIGHT, _OF_ERRORS = word("steps ahead, l", "weight", "weights of the TD errors")
_N, _OF_STEPS = word("n", "weights of the n-step advantages")
_DELTA, _THIS_PATH = word("TD error δ", "one path: TD errors, weighted")
_LAMBDA, _SIZE, _TRADE = word("λ", "error of the estimate", "bias and noise over λ")
_ADVANTAGE, _BIAS, _DEVIATION, _HORIZON, _MEASURED, _MEASURED_DEVIATION, _PATHS = word(
    "advantage, this path",
    "bias",
    "standard deviation",
    "horizon 1/(1 − γλ)",
    "bias, measured",
    "deviation, measured",
    "paths sampled",
)
_BIAS_KEY, _NOISE_KEY, _BOTH_KEY, _RAW_KEY, _WEIGHTED_KEY = word(
    "|bias|", "deviation", "both, RMS", "δ", "weight × δ"
)
_STEPS, _ENDLESS, _ONE_PATH = word(" steps", "no limit", "press play")
_TOP_LEFT, _TOP_RIGHT = (0.75, 4.3, 3.75, 5.45), (5.4, 8.85, 3.75, 5.45)
_LOW_LEFT, _LOW_RIGHT = (0.75, 4.3, 0.7, 2.45), (5.4, 8.85, 0.7, 2.45)
_TRACES = np.linspace(0.0, 1.0, 51)


@register_jitable
def _bars(pen, first, heights, fill, edge=draw.NONE):
    """Draw a bar for each height, the first one around the value `first`.

    Heights that are rounding get none: an exact critic without noise has errors of 1e-17.
    """
    for k in range(len(heights)):
        if abs(heights[k]) > 1e-12:
            draw.box(pen, first + k - 0.4, first + k + 0.4, 0.0, heights[k], fill, edge, 1.2)


@register_jitable
def _trade(pen, controls):
    """Draw bias, deviation and both over lambda."""
    # Bias falls and noise grows with λ, the trade-off that λ is for.
    curves = np.zeros((2, len(_TRACES)))
    for k in range(len(_TRACES)):
        curves[0, k] = abs(bias(controls, _TRACES[k]))
        curves[1, k] = deviation(controls, _TRACES[k])
    both = np.sqrt(curves[0] ** 2 + curves[1] ** 2)
    high = 1.1 * max(np.max(both), 0.05)
    draw.area(pen, _LOW_RIGHT, (0.0, 1.0, 0.0, high))
    draw.axes(pen, _LAMBDA, _SIZE, _TRADE, 5, 4)
    draw.curve(pen, _TRACES, curves[0], draw.ORANGE, 2.5)
    draw.curve(pen, _TRACES, curves[1], draw.GREEN, 2.5)
    draw.curve(pen, _TRACES, both, draw.INK, 1.6, 0.8, 5.0, 4.0)
    trace = controls["trace"]
    draw.segment(pen, trace, 0.0, trace, high, draw.BLUE, 1.5)
    draw.spot(pen, trace, abs(bias(controls, trace)), 0.018, draw.ORANGE, draw.INK)
    draw.spot(pen, trace, deviation(controls, trace), 0.018, draw.GREEN, draw.INK)
    draw.window(pen)
    draw.key(pen, 5.35, 2.98, _BIAS_KEY, draw.ORANGE, 2.5)
    draw.key(pen, 6.4, 2.98, _NOISE_KEY, draw.GREEN, 2.5)
    draw.key(pen, 7.65, 2.98, _BOTH_KEY, draw.INK, 1.6, 0.8, 5.0, 4.0)


def frame(pen, state, controls):
    """Draw both sets of weights, one path's errors, the trade-off over lambda, and the numbers."""
    steps, gamma, trace = controls["steps"], controls["discount"], controls["trace"]
    weights, errors = error_weights(gamma, trace, steps), state["errors"][:steps]
    # Weights of the TD errors, and of the n-step advantages that they sum up to: two forms of one
    # estimator.
    draw.area(pen, _TOP_LEFT, (-0.6, steps - 0.4, 0.0, 1.05))
    draw.axes(pen, _AHEAD, _WEIGHT, _OF_ERRORS, 5, 4)
    _bars(pen, 0.0, weights, draw.BLUE)
    draw.area(pen, _TOP_RIGHT, (0.4, steps + 0.6, 0.0, 1.05))
    draw.axes(pen, _N, _WEIGHT, _OF_STEPS, 5, 4)
    _bars(pen, 1.0, n_step_weights(trace, steps), draw.PURPLE)
    # TD errors of the last path as frames, their contributions to the advantage filled.
    tall = 1.15 * max(np.max(np.abs(errors)), 0.1)
    draw.area(pen, _LOW_LEFT, (-0.6, steps - 0.4, -tall, tall))
    draw.axes(pen, _AHEAD, _DELTA, _THIS_PATH, 5, 4)
    _bars(pen, 0.0, errors, draw.NONE, draw.GREY)
    _bars(pen, 0.0, weights * errors, draw.BLUE)
    draw.segment(pen, -0.6, 0.0, steps - 0.4, 0.0, draw.GREY, 1.2)
    draw.window(pen)
    draw.key(pen, 0.75, 2.98, _RAW_KEY, draw.GREY, 1.5)
    draw.key(pen, 1.55, 2.98, _WEIGHTED_KEY, draw.BLUE, 5.0)
    _trade(pen, controls)
    draw.reading(pen, _ADVANTAGE, np.sum(weights * errors), draw.SIGNED + 3)
    draw.reading(pen, _BIAS, bias(controls, trace), draw.SIGNED + 3)
    draw.reading(pen, _DEVIATION, deviation(controls, trace), 3)
    # The sum of the weights without an end; with γ λ = 1 it diverges.
    if gamma * trace < 1.0 - 1e-12:
        draw.reading(pen, _HORIZON, 1.0 / (1.0 - gamma * trace), 1, _STEPS)
    else:
        draw.reading(pen, _HORIZON, 0.0, 1, _STEPS, _ENDLESS)
    n = state["count"]
    if n > 1 and state["trace"] == trace:
        # The true advantage is zero, so the mean estimate plus the critic's error is the bias.
        draw.reading(pen, _MEASURED, state["mean"] + controls["error"], draw.SIGNED + 3)
        draw.reading(pen, _MEASURED_DEVIATION, math.sqrt(state["squares"] / n), 3)
        draw.reading(pen, _PATHS, n, 0)
    else:
        draw.reading(pen, _MEASURED, 0.0, 0, 0, _ONE_PATH)
        draw.reading(pen, _MEASURED_DEVIATION, 0.0, 0, 0, _ONE_PATH)
        draw.reading(pen, _PATHS, n if state["trace"] == trace else 0, 0)


PRESETS = {
    "The usual λ of 0.95": Preset(
        {},
        "Move λ. Every step further ahead counts γλ times as much as the one before. Most of "
        "the weight lies within the horizon of 1/(1 − γλ) steps. Press play to sample paths and "
        "compare the measured bias and deviation with the predicted ones.",
    ),
    "λ = 0: believe the critic": Preset(
        {"trace": 0.0},
        "Only the first TD error counts. The estimate has the noise of a single "
        "reward, but nearly all of the critic's error is in it. Set the critic's error to 0: then "
        "λ = 0 is the best choice.",
    ),
    "λ = 1: wait for the return": Preset(
        {"trace": 1.0},
        "All errors count, and the critic's values cancel. No bias is left, but "
        "the noise of all rewards adds up. Raise λ from 0.8 to 1 and see which of the two grows.",
    ),
    "Cut off by a time limit": Preset(
        {"trace": 1.0, "end": 1},
        "The time limit comes before the prize. What follows is known only from the critic, so its "
        "error stays in the estimate even with λ = 1. Switch to a terminated path and compare the "
        "bias.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "advantage, this path": "GAE of the first action on the path that is drawn: sum of weight × δ.",
    "bias": "Expected error of advantage + V(s), predicted. An error of V(s) alone is a baseline: "
    "it adds noise to the gradient, but no bias.",
    "standard deviation": "Of the advantage between paths, predicted from the rewards' noise.",
    "horizon 1/(1 − γλ)": "Sum of all weights on an endless path: how far the estimate looks.",
    "bias, measured": "The bias over the paths that were sampled with this λ.",
    "deviation, measured": "Standard deviation of the advantage over the paths that were sampled.",
    "paths sampled": "How many paths the measured numbers rest on.",
}

PAPER = draw.Paper(TITLE, word, colour, window=(0.0, 9.0, 0.0, 6.0))
MODEL = Model(TITLE, PAPER, CONTROLS, STATE, PRESETS, initial, advance, frame, readouts=READOUTS)
