"""A hundred runs of a cloned policy that has to pass a disc, left or right as demonstrated.

The policies are the stored ones (`course.learning.recorded`): chunks of eight steps, cloned from
a hundred demonstrations of which about half pass on either side. A change of a control computes new
runs.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numba import objmode
from numba.extending import register_jitable

from course.learning import Commit, Drawn, TwoWays, one_thread, recorded, roll
from course.learning.recorded import CHUNK, DEMONSTRATIONS, HEADS, SEED
from course.measure.success import wilson
from course.simulations import pen as draw
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
    shown=Field(0.0, shape=(RUNS, TASK.steps + 1, 2), unit="m"),
    side=Field(0, shape=(RUNS,)),
    paths=Field(0.0, shape=(RUNS, TASK.steps + 1, 2), unit="m"),
    time=Field(0.0, unit="s"),
    band=Field((0.0, 0.0)),
)


@lru_cache(maxsize=8)
def policy(head):
    """Return the policy on record, by its number in the menu."""
    return recorded(tuple(HEADS)[head])


@lru_cache(maxsize=64)
def driven(head, executed, noise, sampled):
    """Return paths (RUNS, steps + 1, 2), the side each passed, and the interval of successes."""
    # The same starts for all policies (common random numbers), so that differences belong to the
    # policy.
    task, rng = TwoWays(noise=noise), np.random.default_rng(SEED + 5)
    # One thread of the linear algebra: the same sums in the same order on every run.
    with one_thread():
        made = policy(head)
        made = replace(made, steps=sampled) if isinstance(made, Drawn) else made
        starts = task.starts(RUNS, rng)
        paths = roll(task, Commit(made, executed), starts, task.steps, rng).states
    # A run that passed on neither side has failed; the success rate comes with Wilson's interval
    # (1927).
    side = task.sides(paths)
    return paths, side, np.array(wilson(int(np.sum(side != 0)), RUNS))


@lru_cache(maxsize=1)
def demonstrated():
    """Return the demonstrations, (RUNS, steps + 1, 2)."""
    return TASK.demonstrate(DEMONSTRATIONS, SEED).states


@register_jitable
def initial(controls, state):
    """Run the policy from all starts."""
    c = controls
    values = np.array([1.0 * c["head"], 1.0 * c["executed"], c["noise"], 1.0 * c["sampled"]])
    # Networks run in Python, so this model is recorded for the page instead of compiled for it.
    with objmode(
        paths="float64[:,:,:]", side="int64[:]", band="float64[:]", shown="float64[:,:,:]"
    ):
        head, executed, noise, sampled = values.tolist()
        paths, side, band = driven(int(head), int(executed), round(noise, 9), int(sampled))
        shown = demonstrated()
    state["paths"][:], state["side"][:], state["band"][:] = paths, side, band
    state["shown"][:] = shown


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
        draw.curve(pen, state["shown"][i, :, 0], state["shown"][i, :, 1], draw.GREY, 0.8, 0.25)
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
        "Ten Euler steps carry random noise to a chunk of actions. Most runs pass, on both sides.",
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
        "Every step is disturbed, and eight actions are executed before the next observation, so "
        "the disturbances of eight steps add up uncorrected.",
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
