"""PPO's clipped objective over the probability ratio, and where its gradient is zero."""

import numpy as np
from numba.extending import register_jitable

from course.learning.ppo import clipped_objective
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider

WIDEST = 2.5  # the largest ratio that is shown
_RATE = 0.25  # of the gradient ascent while it plays [1/s]

CONTROLS = Record(
    ratio=slider("Probability ratio ρ, new to old policy", 1.0, 0.0, WIDEST, 0.01),
    advantage=slider("Advantage A of the action", 1.0, -2.0, 2.0, 0.05),
    clip=slider("Clip width ε", 0.2, 0.05, 0.6, 0.05),
)
STATE = Record(ratio=Field(1.0))  # now; the gradient moves it


@register_jitable
def clipped(ratio, advantage, clip):
    """Return the chapter's objective and its slope for numbers instead of arrays."""
    value, slope = clipped_objective(np.array([ratio]), np.array([advantage]), clip)
    return value[0], slope[0]


def initial(controls, state):
    """Put the point on the ratio that is set."""
    state["ratio"] = controls["ratio"]


def advance(state, controls, seconds):
    """Follow the gradient of the objective with respect to the ratio."""
    # Short steps: the ascent stops within a hundredth of the clip.
    for _ in range(max(int(100.0 * seconds), 1)):
        step = seconds / max(int(100.0 * seconds), 1)
        slope = clipped(state["ratio"], controls["advantage"], controls["clip"])[1]
        state["ratio"] = min(max(state["ratio"] + _RATE * step * slope, 0.0), WIDEST)


TITLE = "PPO's clipped objective"
word, colour = draw.words_table(), draw.colours_table()
_BAND, _FLAT = colour("#e8eaf6", "#ececec")
_RATIO, _VALUE, _CURVE = word("probability ratio ρ", "objective", "objective of this action")
_ADVANTAGE, _MAP = word("advantage A", "where the gradient is zero")
_CLIPPED, _FREE, _SLOPE_KEY = word("clipped objective", "without the clip, ρA", "slope")
_RAISE, _LOWER = word("raise ρ", "lower ρ")
_NONE, _UP, _DOWN, _NEITHER = word("no gradient", "pushes ρ up", "pushes ρ down", "A is 0")
_NOW, _OBJECTIVE, _WITHOUT, _SLOPE, _EFFECT, _RANGE = word(
    "ratio ρ", "clipped objective", "without the clip", "slope", "effect", "clip range"
)
_TO, _RANGE_BELOW, _RANGE_ABOVE = word(" to ", "1 − ε", "1 + ε")
_LEFT, _RIGHT = (0.75, 5.05, 0.8, 4.15), (5.95, 8.85, 0.8, 4.15)


@register_jitable
def _view(controls):
    """Return the values at the edges of the left picture; they change in steps with A."""
    size = abs(controls["advantage"])
    # Three scales only, so that the axes stay still while A changes a little.
    high = 1.5 if size <= 0.5 else 3.0 if size <= 1.0 else 5.0
    return 0.0, WIDEST, -high, high


_MAP_VIEW = (0.0, WIDEST, -2.2, 2.2)


@register_jitable
def _objective(pen, state, controls):
    """Draw the objective over the ratio, and the slope at the point."""
    advantage, clip, view = controls["advantage"], controls["clip"], _view(controls)
    low, high = 1.0 - clip, 1.0 + clip
    draw.area(pen, _LEFT, view)
    # Within the band the clip has no effect; the objective is piecewise linear with its kinks at
    # the band's ends.
    draw.box(pen, low, high, view[2], view[3], _BAND)
    draw.axes(pen, _RATIO, _VALUE, _CURVE, 5, 6)
    draw.segment(pen, 0.0, 0.0, WIDEST, 0.0, draw.GREY, 1.2)
    draw.segment(pen, 0.0, 0.0, WIDEST, WIDEST * advantage, draw.GREY, 2.0, 1.0, 5.0, 4.0)
    draw.line(pen, draw.BLUE, 3.5)
    for at in (0.0, low, high, WIDEST):
        draw.point(pen, at, clipped(at, advantage, clip)[0])
    ratio = state["ratio"]
    value, slope = clipped(ratio, advantage, clip)
    # The tangent at the point: horizontal where the clip has removed the gradient.
    draw.segment(
        pen, ratio - 0.3, value - 0.3 * slope, ratio + 0.3, value + 0.3 * slope, draw.RED, 2.5
    )
    draw.spot(pen, ratio, value, 0.04, draw.ORANGE, draw.INK)
    draw.text(pen, low, view[2], _RANGE_BELOW, draw.GREY, 11.5, draw.RIGHT, draw.BOTTOM, -3.0, 4.0)
    draw.text(pen, high, view[2], _RANGE_ABOVE, draw.GREY, 11.5, draw.LEFT, draw.BOTTOM, 3.0, 4.0)
    draw.window(pen)


@register_jitable
def _regions(pen, state, controls):
    """Draw the plane of ratio and advantage; the gradient is zero in two corners of it."""
    low, high = 1.0 - controls["clip"], 1.0 + controls["clip"]
    draw.area(pen, _RIGHT, _MAP_VIEW)
    # No gradient where ρ has already moved far enough in the direction that A wants (PPO, Schulman
    # et al., 2017): upper right and lower left.
    draw.box(pen, high, WIDEST, 0.0, _MAP_VIEW[3], _FLAT)
    draw.box(pen, 0.0, low, _MAP_VIEW[2], 0.0, _FLAT)
    draw.axes(pen, _RATIO, _ADVANTAGE, _MAP, 5, 5)
    draw.segment(pen, 0.0, 0.0, WIDEST, 0.0, draw.GREY, 1.2)
    for at in (low, high):
        draw.segment(pen, at, _MAP_VIEW[2], at, _MAP_VIEW[3], draw.GREY, 1.2, 1.0, 3.0, 3.0)
    # One arrow or word in each of the six regions, from the slope at a point in it.
    for y, ink in ((1.1, draw.GREEN), (-1.1, draw.PURPLE)):
        for at in (0.5 * low, 1.0, 0.5 * (high + WIDEST)):
            if clipped(at, y, controls["clip"])[1] == 0.0:
                draw.text(pen, at, y, _NONE, draw.GREY, 11.5, draw.CENTRE, turn=90.0)
            else:
                # Arrows point up in ρ for a positive advantage, down for a negative one.
                half = 0.16 if y > 0.0 else -0.16
                draw.arrow(pen, at - half, y, at + half, y, ink, 3.0)
    ratio, advantage = state["ratio"], controls["advantage"]
    draw.spot(pen, ratio, advantage, 0.06, draw.ORANGE, draw.INK)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw the objective, the regions of its gradient, and the numbers."""
    _objective(pen, state, controls)
    _regions(pen, state, controls)
    draw.key(pen, 0.6, 4.75, _CLIPPED, draw.BLUE, 3.5)
    draw.key(pen, 2.4, 4.75, _FREE, draw.GREY, 2.0, 1.0, 5.0, 4.0)
    draw.key(pen, 4.35, 4.75, _SLOPE_KEY, draw.RED, 2.5)
    draw.key(pen, 5.95, 4.75, _RAISE, draw.GREEN, 3.0)
    draw.key(pen, 7.2, 4.75, _LOWER, draw.PURPLE, 3.0)
    ratio, advantage, clip = state["ratio"], controls["advantage"], controls["clip"]
    value, slope = clipped(ratio, advantage, clip)
    # Three digits: just above 1 + ε the slope is 0, at 1 + ε itself it is still A.
    draw.reading(pen, _NOW, ratio, 3)
    draw.reading(pen, _OBJECTIVE, value, draw.SIGNED + 2)
    draw.reading(pen, _WITHOUT, ratio * advantage, draw.SIGNED + 2)
    draw.reading(pen, _SLOPE, slope, draw.SIGNED + 2)
    draw.readout(pen, _EFFECT)
    if advantage == 0.0:
        draw.words(pen, _NEITHER)
    elif slope == 0.0:
        draw.words(pen, _NONE)
    else:
        draw.words(pen, _UP if slope > 0.0 else _DOWN)
    draw.readout(pen, _RANGE)
    draw.number(pen, 1.0 - clip, 2, _TO)
    draw.number(pen, 1.0 + clip, 2)


def drag(controls, state, x, y):
    """Move the point: on the left its ratio, on the right ratio and advantage."""
    if x < 0.5 * (_LEFT[1] + _RIGHT[0]):
        ratio = draw.values_at(_LEFT, _view(controls), x, y)[0]
    else:
        ratio, advantage = draw.values_at(_RIGHT, _MAP_VIEW, x, y)
        controls["advantage"] = min(max(advantage, -2.0), 2.0)
    controls["ratio"] = min(max(ratio, 0.0), WIDEST)


def press(controls, state, key):
    """Handle a key: left and right change the ratio, up and down the advantage."""
    if key < 2:
        change = -0.02 if key == 0 else 0.02
        controls["ratio"] = min(max(controls["ratio"] + change, 0.0), WIDEST)
    elif key < 4:
        change = 0.05 if key == 2 else -0.05
        controls["advantage"] = min(max(controls["advantage"] + change, -2.0), 2.0)


PRESETS = {
    "A good action": Preset(
        {},
        "The action was better than average, so the gradient makes it more likely. Press play: "
        "the ratio rises until it reaches 1 + ε, where the objective becomes flat and nothing "
        "pulls any further. Drag the point to try other ratios.",
    ),
    "A bad action": Preset(
        {"advantage": -1.0},
        "The action was worse than average, so the gradient makes it less likely. Press play: the "
        "ratio falls to 1 − ε and stops there. Change the clip width and play again.",
    ),
    "A bad action that became likelier": Preset(
        {"advantage": -1.0, "ratio": 1.8},
        "Other actions moved the shared weights, and this bad action is now far above the clip "
        "range. Here the objective is not flat: the full gradient brings the ratio back. Press "
        "play, and compare with a good action at the same ratio.",
    ),
    "Good action, now unlikely": Preset(
        {"ratio": 0.4},
        "A good action below the clip range keeps its full gradient, so the update "
        "can correct the mistake. Drag the point in the right picture: only two of the six fields "
        "have no gradient.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "ratio ρ": "Probability of the action with the new policy over that with the old one.",
    "clipped objective": "The smaller of ρA and clip(ρ, 1 − ε, 1 + ε)·A; PPO makes it large.",
    "without the clip": "The product ρA. Where all ratios are 1, its gradient is the plain policy "
    "gradient.",
    "slope": "Derivative of the clipped objective with respect to the ratio.",
    "effect": "What the gradient does to the ratio of this action.",
    "clip range": "From 1 − ε to 1 + ε.",
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
