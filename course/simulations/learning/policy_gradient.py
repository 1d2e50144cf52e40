"""The policy gradient of a normal distribution over a reward landscape, sample by sample.

The reward is quadratic, so that the true gradient and the noise of its estimate have closed forms.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider, switch
from course.simulations.rigid_body.turning import whole_steps

# The reward of an action is PRIZE - CURVE_X (x - GOAL_X)^2 - CURVE_Y (y - GOAL_Y)^2.
PRIZE, CURVES, GOAL = 4.0, np.array([0.5, 1.0]), np.array([1.2, 0.6])
LARGEST = 200  # samples
_PACE, _FAR = 0.6, 2.6  # s from one step of the policy to the next; how far its mean may go

CONTROLS = Record(
    samples=slider("Samples per step", 12, 1, LARGEST, 1, "", 0),
    spread=slider("Spread of the policy σ", 0.5, 0.1, 1.0, 0.05),
    baseline=switch("Subtract the baseline", True),
    rate=slider("Step size", 0.15, 0.0, 0.5, 0.01, live=True),
    seed=slider("Seed of the samples", 3, 1, 99, 1, "", 0),
    start=Field((-1.4, -0.9), low=-_FAR, high=_FAR),
)
STATE = Record(
    seed=Field(np.uint64(0), shape=(1,)),
    mean=Field((0.0, 0.0)),
    noise=Field(0.0, shape=(LARGEST, 2)),  # of the present samples, in standard deviations
    trail=Field(0.0, shape=(2, 61)),  # where the mean has been
    steps=Field(0),
    owed=Field(0.0, unit="s"),
)


@register_jitable
def reward(x, y):
    """Return the rewards of the actions (x, y), numbers or arrays."""
    return PRIZE - CURVES[0] * (x - GOAL[0]) ** 2 - CURVES[1] * (y - GOAL[1]) ** 2


@register_jitable
def expected_reward(mean, spread):
    """Return the mean reward of the policy: that at its mean, less what its spread costs."""
    # E of a quadratic under a normal distribution: its value at the mean plus the curvatures times
    # the variance.
    return reward(mean[0], mean[1]) - spread * spread * (CURVES[0] + CURVES[1])


@register_jitable
def true_gradient(mean):
    """Return the gradient (2,) of the expected reward with respect to the policy's mean."""
    return -2.0 * CURVES * (mean - GOAL)


@register_jitable
def votes(mean, spread, baseline, noise):
    """Return advantages (n,) and votes (n, 2), advantage times the gradient of log pi.

    Args:
        mean: of the policy, (2,).
        spread: its standard deviation in each direction.
        baseline: what is subtracted from each reward.
        noise: of the samples in standard deviations, (n, 2).
    """
    # REINFORCE (Williams, 1992): advantage times score. A baseline changes the variance, not the
    # mean.
    actions = mean + spread * noise
    advantages = reward(actions[:, 0], actions[:, 1]) - baseline
    # The score of a normal distribution: (a - mean) / spread^2.
    score = noise / spread
    return advantages, advantages.reshape(-1, 1) * score


@register_jitable
def baseline_of(controls, mean):
    """Return the baseline: the policy's mean reward, or zero if it is off."""
    return expected_reward(mean, controls["spread"]) if controls["baseline"] else 0.0


@register_jitable
def vote_variance(mean, spread, baseline):
    """Return the variance of a single vote, summed over both directions.

    With z standard normal a vote is (b - u.z - q.z^2) z / spread, where b is the reward at the mean
    less the baseline, u = 2 spread CURVES (mean - GOAL) and q = spread^2 CURVES. Its square has the
    moments E[z^4] = 3 and E[z^6] = 15.
    """
    b = reward(mean[0], mean[1]) - baseline
    u, q = 2.0 * spread * CURVES * (mean - GOAL), spread * spread * CURVES
    square = 2.0 * b * b + 4.0 * np.sum(u * u) - 8.0 * b * np.sum(q)
    square += 18.0 * np.sum(q * q) + 12.0 * q[0] * q[1]
    # Variance is the mean square less the square of the mean, which is the true gradient.
    gradient = true_gradient(mean)
    return square / (spread * spread) - np.sum(gradient * gradient)


@register_jitable
def estimate(controls, state):
    """Return the average vote (2,) of the present samples."""
    n, mean = controls["samples"], state["mean"].copy()
    noise = state["noise"][:n].copy()
    each = votes(mean, controls["spread"], baseline_of(controls, mean), noise)[1]
    return np.array([np.sum(each[:, 0]) / n, np.sum(each[:, 1]) / n])


@register_jitable
def sample(controls, state):
    """Sample the actions of the next step."""
    n = controls["samples"]
    noise = np.empty(2 * n)
    splitmix.normal(state["seed"], noise)
    state["noise"][:n] = noise.reshape(n, 2)


@register_jitable
def take_step(controls, state):
    """Move the mean along the estimated gradient, and sample again."""
    # Stochastic gradient ascent; the mean is kept in the picture, as large steps diverge.
    ahead = state["mean"] + controls["rate"] * estimate(controls, state)
    for k in range(2):
        state["mean"][k] = min(max(ahead[k], -_FAR), _FAR)
    size = state["trail"].shape[1]
    if state["steps"] + 1 >= size:  # the older half of the trail is forgotten
        half = size // 2
        state["trail"][:, : size - half] = state["trail"][:, half:].copy()
        state["steps"] -= half
    state["steps"] += 1
    state["trail"][:, state["steps"]] = state["mean"]
    sample(controls, state)


def initial(controls, state):
    """Put the policy at its start and sample for the first time."""
    state["seed"][0] = controls["seed"]
    state["mean"][:] = controls["start"]
    state["trail"][:, 0] = controls["start"]
    sample(controls, state)


def advance(state, controls, seconds):
    """Take the steps that are due."""
    # At most 50 steps at once, after a pause of the page.
    for _ in range(min(whole_steps(state, seconds, _PACE), 50)):
        take_step(controls, state)


TITLE = "The policy gradient: samples vote on where the mean should go"
word, colour = draw.words_table(), draw.colours_table()
_RINGS = colour("#f3faf6", "#dcefe5", "#c3e3d3", "#a6d5bf")
_SHADE = colour("#8fb3d9")[0]
_X, _Y, _PLANE = word("action, x", "action, y", "samples over the reward landscape")
_VX, _VY, _VOTES = word("vote, x", "vote, y", "votes, and their average")
_BETTER, _WORSE, _AVERAGE, _TRUE, _POLICY = word(
    "positive advantage", "negative advantage", "average vote", "true gradient", "policy: drag it"
)
_ANGLE, _SIZE, _TRUTH, _ERROR, _EXPECTED, _REWARD = word(
    "angle to the gradient",
    "size, estimate",
    "size, true",
    "error, this step",
    "error, expected",
    "expected reward",
)
_DEGREES, _PERCENT, _NONE = word("°", " %", "none: at the top")
_SCENE, _VIEW = (0.7, 4.75, 0.6, 4.1), (-2.7, 2.7, -2.35, 2.3167)
_ROSE = (5.75, 8.85, 0.85, 3.95)
_ROUND = np.linspace(0.0, 2.0 * math.pi, 49)
_COS, _SIN = np.cos(_ROUND), np.sin(_ROUND)


@register_jitable
def _scene(pen, state, controls):
    """Draw the landscape, the policy, its samples and the trail of its mean."""
    draw.area(pen, _SCENE, _VIEW)
    # Level sets of the reward: ellipses around the goal, from low to high.
    for k in range(4):
        below = (12.0, 6.0, 2.5, 0.6)[k]  # reward lost at the ring
        draw.polygon(pen, _RINGS[k])
        x, y = math.sqrt(below / CURVES[0]), math.sqrt(below / CURVES[1])
        draw.points(pen, GOAL[0] + x * _COS, GOAL[1] + y * _SIN)
    draw.axes(pen, _X, _Y, _PLANE, 5, 5, 12.0, False)
    mean, spread, n = state["mean"].copy(), controls["spread"], controls["samples"]
    # The policy as circles of one and two standard deviations.
    for reach in (2.0, 1.0):
        draw.polygon(pen, _SHADE, draw.BLUE, 1.2, 0.25)
        draw.points(pen, mean[0] + reach * spread * _COS, mean[1] + reach * spread * _SIN)
    x, y = state["trail"][0].copy(), state["trail"][1].copy()
    draw.curve(pen, x[: state["steps"] + 1], y[: state["steps"] + 1], draw.INK, 1.5)
    noise = state["noise"][:n].copy()
    advantages = votes(mean, spread, baseline_of(controls, mean), noise)[0]
    for k in range(n):
        # Blue samples pull the mean towards them, orange ones push it away.
        ink = draw.BLUE if advantages[k] > 0.0 else draw.ORANGE
        px, py = mean[0] + spread * noise[k, 0], mean[1] + spread * noise[k, 1]
        draw.spot(pen, px, py, 0.045, ink, draw.NONE, 1.0, 0.9)
    draw.spot(pen, GOAL[0], GOAL[1], 0.06, draw.GREEN, draw.INK)
    # Both gradients at the mean to one scale: the sample average and its expectation.
    average, true = estimate(controls, state), true_gradient(mean)
    scale = 0.35
    draw.arrow(
        pen,
        mean[0],
        mean[1],
        mean[0] + scale * true[0],
        mean[1] + scale * true[1],
        draw.GREEN,
        5.0,
        13.0,
        0.8,
    )
    draw.arrow(
        pen,
        mean[0],
        mean[1],
        mean[0] + scale * average[0],
        mean[1] + scale * average[1],
        draw.INK,
        3.0,
        11.0,
    )
    draw.spot(pen, mean[0], mean[1], 0.06, draw.INK)
    draw.window(pen)


@register_jitable
def _rose(pen, state, controls):
    """Draw each vote as an arrow from the mean, their average, and the true gradient."""
    mean, n = state["mean"].copy(), controls["samples"]
    noise = state["noise"][:n].copy()
    advantages, each = votes(mean, controls["spread"], baseline_of(controls, mean), noise)
    # The scale follows the typical vote in steps of sqrt(2), and holds the true gradient.
    true = true_gradient(mean)
    typical = vote_variance(mean, controls["spread"], baseline_of(controls, mean))
    typical = max(1.6 * math.sqrt(typical), 1.3 * math.hypot(true[0], true[1]), 0.1)
    far = 2.0 ** (0.5 * math.ceil(2.0 * math.log2(typical)))
    draw.area(pen, _ROSE, (-far, far, -far, far))
    draw.axes(pen, _VX, _VY, _VOTES, 5, 5)
    for k in range(n):
        ink = draw.BLUE if advantages[k] > 0.0 else draw.ORANGE
        draw.arrow(pen, 0.0, 0.0, each[k, 0], each[k, 1], ink, 1.2, 6.0, 0.7)
    average = estimate(controls, state)
    draw.arrow(pen, 0.0, 0.0, true[0], true[1], draw.GREEN, 5.0, 13.0, 0.8)
    draw.arrow(pen, 0.0, 0.0, average[0], average[1], draw.INK, 3.0, 11.0)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw the landscape with the policy, the votes of its samples, and the numbers."""
    _scene(pen, state, controls)
    _rose(pen, state, controls)
    draw.key(pen, 0.15, 4.75, _BETTER, draw.BLUE, 4.0)
    draw.key(pen, 2.2, 4.75, _WORSE, draw.ORANGE, 4.0)
    draw.key(pen, 4.35, 4.75, _AVERAGE, draw.INK, 3.0)
    draw.key(pen, 5.95, 4.75, _TRUE, draw.GREEN, 5.0)
    draw.key(pen, 7.55, 4.75, _POLICY, _SHADE, 5.0)
    mean, average = state["mean"].copy(), estimate(controls, state)
    true = true_gradient(mean)
    size, truth = math.hypot(average[0], average[1]), math.hypot(true[0], true[1])
    # At the top, or without votes, the angle is not defined.
    near = truth < 1e-9 or size == 0.0
    draw.readout(pen, _ANGLE)
    if near:
        draw.words(pen, _NONE)
    else:
        # atan2 of cross and dot product: accurate for small angles, where the arc cosine isn't.
        cross, dot = average[0] * true[1] - average[1] * true[0], np.sum(average * true)
        draw.number(pen, abs(math.degrees(math.atan2(cross, dot))), 0, _DEGREES)
    draw.reading(pen, _SIZE, size, 2)
    draw.reading(pen, _TRUTH, truth, 2)
    away = math.hypot(average[0] - true[0], average[1] - true[1])
    draw.reading(pen, _ERROR, away, 2)
    # Standard error of the average: the deviation of a single vote over the square root of their
    # number.
    variance = vote_variance(mean, controls["spread"], baseline_of(controls, mean))
    draw.reading(pen, _EXPECTED, math.sqrt(variance / controls["samples"]), 2)
    draw.reading(pen, _REWARD, expected_reward(mean, controls["spread"]), 2)


def drag(controls, state, x, y):
    """Put the mean of the policy where the pointer is in the left picture."""
    to = draw.values_at(_SCENE, _VIEW, min(x, _SCENE[1]), y)
    for k in range(2):
        controls["start"][k] = min(max(to[k], -_FAR), _FAR)


def press(controls, state, key):
    """Handle a key: the arrows move the start of the mean."""
    if key < 4:
        axis, change = (0 if key < 2 else 1), (0.1 if key in (1, 2) else -0.1)
        controls["start"][axis] = min(max(controls["start"][axis] + change, -_FAR), _FAR)


PRESETS = {
    "Twelve samples": Preset(
        {},
        "Each sample votes with its advantage times (a − μ)/σ². Samples that were better than "
        "average pull the mean towards themselves, worse ones push it away. Press play: the mean "
        "follows the average vote uphill. Drag the policy to start elsewhere.",
    ),
    "The same without a baseline": Preset(
        {"baseline": False, "start": (0.2, 0.1)},
        "Here almost all rewards are positive, so every sample pulls the mean towards itself. The "
        "average is still right in the long run, but it is far noisier. Switch the baseline on and "
        "compare the expected error.",
    ),
    "Two hundred samples": Preset(
        {"samples": LARGEST},
        "With more samples the average vote comes closer to the true gradient: its error falls "
        "with the square root of their number. Change the number by a factor of four and compare "
        "the expected error.",
    ),
    "A narrow policy": Preset(
        {"spread": 0.1},
        "The samples lie close together and their rewards hardly differ. But the "
        "score divides by σ², so the votes are as long as before. Switch the baseline off: now "
        "every vote is long, whatever its reward, and the expected error explodes.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "angle to the gradient": "Angle between the average vote and the true gradient.",
    "size, estimate": "Length of the average vote.",
    "size, true": "Length of the true gradient, −2 times curvature times distance to the top.",
    "error, this step": "Distance between the average vote and the true gradient.",
    "error, expected": "Root mean square of this distance, from a closed form.",
    "expected reward": "Mean reward of the policy, over all actions that it may sample.",
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
)
