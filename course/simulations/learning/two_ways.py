"""A hundred runs of a cloned policy that has to pass a disc, left or right as demonstrated.

The policies are the stored ones (`course.learning.recorded`): chunks of eight steps, cloned from
a hundred demonstrations of which about half pass on either side. A change of a control computes new
runs with the forward passes of `course.learning.forward`.
"""

import numpy as np
from numba.extending import register_jitable

from course.learning import TwoWays, windows
from course.learning.clone import prepared
from course.learning.forward import diffusion_sample, flow_sample, mixture_sample, perceptron
from course.learning.recorded import CHUNK, DEMONSTRATIONS, HEADS, SEED, stored_weights
from course.learning.tasks import sides
from course.simulations import pen as draw
from course.simulations import splitmix
from course.simulations.interval import score_interval
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

RUNS, PICTURE, PAUSE = 100, 0.15, 1.5  # of a policy; s for a step; s
TASK = TwoWays()
_LENGTH, _REACH, _CENTRE, _RADIUS = TASK.steps, TASK.reach, TASK.centre, TASK.radius
CONTROLS = Record(
    head=menu("Policy", tuple(HEADS)),
    executed=slider("Executed steps of each chunk of 8", 8, 1, CHUNK, 1),
    noise=slider("Disturbance per step", 0.0, 0.0, 0.1, 0.01, "m"),
    sampled=slider("Sampler steps", 10, 1, 20, 1),
)
STATE = Record(
    seed=Field(np.uint64(0), shape=(1,)),
    side=Field(0, shape=(RUNS,)),
    paths=Field(0.0, shape=(RUNS, TASK.steps + 1, 2), unit="m"),
    time=Field(0.0, unit="s"),
    band=Field((0.0, 0.0)),
)

# The policies on record: normalisers of states and chunks, then the weights of all networks one
# after the other. Of the autoencoder the decoder is used, whose weights come first.
MEAN, MIXTURE, FLOW, DIFFUSION, AUTOENCODER = range(5)
_TRAINING = TASK.demonstrate(DEMONSTRATIONS, SEED)
_BLANK = prepared(*windows(_TRAINING, CHUNK))[0]
_INPUT_MEAN, _INPUT_SCALE = _BLANK.inputs.mean, np.sqrt(_BLANK.inputs.variance + 1e-8)
_CHUNK_MEAN, _CHUNK_SCALE = _BLANK.done.mean, np.sqrt(_BLANK.done.variance + 1e-8)
_SIZE, _HIDDEN, _MODES = 2 * CHUNK, 64, 5
_PARTS = [stored_weights(name) for name in HEADS]
_PARTS[AUTOENCODER] = _PARTS[AUTOENCODER][: (3 + 1) * _HIDDEN + (_HIDDEN + 1) * (_HIDDEN + _SIZE)]
_WEIGHTS = np.concatenate(_PARTS)
_FIRST = np.cumsum(np.array([0, *map(len, _PARTS)]))
# Positions of the demonstrations in steps of 0.1 mm, enough for a picture.
_DEMONSTRATED = np.round(1e4 * _TRAINING.states).astype(np.int16)


@register_jitable
def normal(seed, rows, columns):
    """Return standard normal numbers (rows, columns); the seed moves on."""
    out = np.empty(rows * columns)
    splitmix.normal(seed, out)
    return out.reshape(rows, columns)


@register_jitable
def chunk(head, states, sampled, seed):
    """Return a policy's next eight actions for states (N, 2), flattened (N, 16) [m].

    Args:
        head: number of the policy in the menu.
        states: positions [m].
        sampled: steps of the sampler of a flow or a diffusion.
        seed: of the random numbers, (1,) uint64; it moves on.
    """
    rows = (states - _INPUT_MEAN) / _INPUT_SCALE
    weights, n = _WEIGHTS[_FIRST[head] : _FIRST[head + 1]], len(states)
    # Every policy uses the same random numbers, so that differences belong to the policy.
    noise, uniform = normal(seed, n, _SIZE), np.empty(n * _MODES)
    splitmix.uniform(seed, uniform)
    if head == FLOW:
        drawn = flow_sample(noise, rows, sampled, weights, _HIDDEN)
    elif head == DIFFUSION:
        drawn = diffusion_sample(noise, rows, sampled, weights, _HIDDEN)
    elif head == MIXTURE:
        out = perceptron(rows, weights, _HIDDEN, _MODES * (1 + 2 * _SIZE))
        # u is below 1 but may be 0, hence the logarithm of 1 - u.
        gumbel = -np.log(1e-300 - np.log(1.0 - uniform)).reshape(n, _MODES)
        drawn = mixture_sample(out, _MODES, gumbel, noise)
    elif head == AUTOENCODER:
        # The decoder's third input is the code, sampled from its prior.
        coded = np.empty((n, 3))
        coded[:, :2], coded[:, 2] = rows, noise[:, 0]
        drawn = perceptron(coded, weights, _HIDDEN, _SIZE)
    else:
        drawn = perceptron(rows, weights, _HIDDEN, _SIZE)
    return drawn * _CHUNK_SCALE + _CHUNK_MEAN


def initial(controls, state):
    """Run the policy from all starts."""
    state["seed"][0] = SEED + 5
    paths = np.empty((RUNS, _LENGTH + 1, 2))
    paths[:, 0] = 0.02 * normal(state["seed"], RUNS, 2)
    planned = np.empty((RUNS, _SIZE))
    for k in range(_LENGTH):
        # The policy observes, then the first steps of its chunk are executed without a look.
        done = k % controls["executed"]
        if done == 0:
            planned[:] = chunk(
                controls["head"], paths[:, k].copy(), controls["sampled"], state["seed"]
            )
        disturbed = controls["noise"] * normal(state["seed"], RUNS, 2)
        paths[:, k + 1] = paths[:, k] + planned[:, 2 * done : 2 * done + 2] + disturbed
    # A run that passed on neither side has failed; the success rate comes with Wilson's interval
    # (1927).
    side = sides(paths, _CENTRE, _RADIUS, _REACH)
    state["paths"][:], state["side"][:] = paths, side
    low, high = score_interval(np.sum(side != 0) / RUNS, RUNS)
    state["band"][0], state["band"][1] = low, high


def advance(state, controls, seconds):
    """Advance the simulation: the runs are shown again and again."""
    state["time"] = (state["time"] + seconds) % (_LENGTH * PICTURE + PAUSE)


TITLE = "Two routes around a disc"
word, colour = draw.words_table(), draw.colours_table()
_SAND = colour("#f7f5ef")[0]
_DONE, _SHOWN, _GOOD, _LEFT, _RIGHT, _HIT, _EXECUTED, _BAND, _TO, _CLOSE = word(
    "a hundred runs of the policy",
    "demonstrations",
    "success",
    "pass left",
    "pass right",
    "collide or miss the goal",
    "chunks in a run",
    " % (",
    "-",
    ")",
)
_SCENE, _VIEW = (0.1, 8.9, 0.5, 4.6), (-0.3, 1.5, -0.42, 0.42)


def frame(pen, state, controls):
    """Draw all runs up to this step over the demonstrations; how many passed, and on which side."""
    # After the last step the picture pauses, with all paths complete.
    now = int(min(state["time"] / PICTURE + 1e-9, 1.0 * _LENGTH))
    draw.area(pen, _SCENE, _VIEW)
    draw.box(pen, *_VIEW, _SAND, draw.GREY)
    draw.title(pen, _VIEW[0], _VIEW[3], _DONE)
    # The goal's circle, the demonstrations in grey, the disc, then the policy's runs: blue ones
    # succeed, orange ones collide or miss the goal.
    draw.spot(pen, 1.0, 0.0, _REACH, draw.NONE, draw.GREEN, 1.5)
    for i in range(RUNS):
        draw.curve(
            pen, 1e-4 * _DEMONSTRATED[i, :, 0], 1e-4 * _DEMONSTRATED[i, :, 1], draw.GREY, 0.8, 0.25
        )
    draw.spot(pen, _CENTRE, 0.0, _RADIUS, draw.GREY, draw.INK, 1.0, 0.5)
    for i in range(RUNS):
        x, y = state["paths"][i, : now + 1, 0], state["paths"][i, : now + 1, 1]
        ink = draw.BLUE if state["side"][i] != 0 else draw.ORANGE
        draw.curve(pen, x, y, ink, 1.2, 0.6)
        draw.spot(pen, x[now], y[now], 0.006, ink)
    draw.window(pen)
    draw.key(pen, 0.2, 0.25, _SHOWN, draw.GREY, 1.5)
    good = np.sum(state["side"] != 0)
    draw.reading(pen, _GOOD, 100.0 * good / RUNS, 0)
    draw.words(pen, _BAND)
    draw.number(pen, 100.0 * state["band"][0], 0, _TO)
    draw.number(pen, 100.0 * state["band"][1], 0, _CLOSE)
    draw.reading(pen, _LEFT, 1.0 * np.sum(state["side"] > 0), 0)
    draw.reading(pen, _RIGHT, 1.0 * np.sum(state["side"] < 0), 0)
    draw.reading(pen, _HIT, 1.0 * (RUNS - good), 0)
    draw.reading(pen, _EXECUTED, np.ceil(_LENGTH / controls["executed"]), 0)


PRESETS = {
    "The mean": Preset(
        {},
        "Trained with the squared error. Half of the demonstrations pass left, half right, and "
        "the prediction closest to both goes straight ahead: nearly all runs hit the disc, though "
        "no demonstration did.",
    ),
    "A mixture": Preset(
        {"head": "mixture"},
        "Several normal distributions, of which one is selected at random for each chunk: runs on "
        "both sides, and almost none between them.",
    ),
    "A flow": Preset(
        {"head": "flow"},
        "Ten Euler steps carry random noise to a chunk of actions. Reduce the sampler steps and "
        "watch the two routes merge.",
    ),
    "A flow in one step": Preset(
        {"head": "flow", "sampled": 1},
        "A single Euler step ends near the mean of the demonstrations, so most runs hit the disc. "
        "With two steps more than half pass.",
    ),
    "Diffusion": Preset(
        {"head": "diffusion"},
        "Noise is removed in ten steps. Most runs pass, and a few end up between the two routes.",
    ),
    "Disturbed, eight executed": Preset(
        {"head": "flow", "noise": 0.05},
        "Every step is disturbed, and eight actions are executed before the next observation. "
        "Execute two instead.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "success": "Runs that pass the disc on either side, with a 95 % confidence interval.",
    "pass left": "Runs that pass the disc on the left.",
    "pass right": "Runs that pass the disc on the right.",
    "collide or miss the goal": "Runs that hit the disc or end somewhere else.",
    "chunks in a run": (
        "How often the policy observes and predicts a new chunk of actions during a run."
    ),
}

MODEL = Model(
    TITLE,
    draw.Paper(TITLE, word, colour, room=30_000),
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    readouts=READOUTS,
)
