"""Projected Gauss-Seidel on a stack of two blocks: each sweep takes the same share of the error."""

import math

import numpy as np
from numba.extending import register_jitable

from course.contact.models import pgs_sweep
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider
from course.simulations.rigid_body.turning import whole_steps

LOWER, GRAVITY = 1.0, 9.81  # mass of the lower block [kg], [m/s^2]
STEP = 0.01  # of the simulation whose contact impulses are computed [s]
LAST = 40  # sweeps
_PACE = 0.7  # s from one sweep to the next

CONTROLS = Record(
    ratio=slider("Mass ratio, upper to lower", 4.0, 0.25, 20.0, 0.25),
    order=menu("Order of the contacts", ("floor first", "upper contact first")),
)
STATE = Record(
    impulse=Field(0.0, shape=(2,), unit="N s"),  # of the floor, and between the blocks
    velocity=Field(0.0, shape=(2,), unit="m/s"),  # of these contacts, apart, after the step
    error=Field(0.0, shape=(LAST + 1,)),  # after each sweep, over the size of the solution
    sweeps=Field(0),
    owed=Field(0.0, unit="s"),
)


@register_jitable
def delassus(controls):
    """Return A (2, 2) [1/kg] and the contact velocity without contact b (2,) [m/s], floor first."""
    # Delassus matrix J M^-1 J^T: the lower block couples both contacts, with opposite signs.
    lower, upper = 1.0 / LOWER, 1.0 / (LOWER * controls["ratio"])
    A = np.array([[lower, -lower], [-lower, lower + upper]])
    return A, np.array([-GRAVITY * STEP, 0.0])


@register_jitable
def solution(controls):
    """Return the impulses that carry the stack, floor first (2,): each contact what is above it."""
    # In balance each contact carries the weight above it for one step: its impulse is weight times
    # step.
    weight = LOWER * GRAVITY * STEP
    return np.array([weight * (1.0 + controls["ratio"]), weight * controls["ratio"]])


@register_jitable
def contraction(A):
    """Return the largest eigenvalue of a sweep's error for a 2 x 2 Delassus matrix.

    The error after a sweep is -(D + L)^-1 U times the error before, with the diagonal D of A and
    its halves L below and U above it. This matrix has the eigenvalues 0 and A12 A21 / (A11 A22).
    """
    return A[0, 1] * A[1, 0] / (A[0, 0] * A[1, 1])


@register_jitable
def error_of(controls, impulse):
    """Return the distance to the solution over the size of the solution."""
    exact = solution(controls)
    away = math.hypot(impulse[0] - exact[0], impulse[1] - exact[1])
    return away / math.hypot(exact[0], exact[1])


@register_jitable
def sweep(controls, state):
    """Make one sweep, contact after contact, in the order that is chosen."""
    # The order of the rows decides which contact the Gauss-Seidel sweep visits first; results are
    # returned in the order floor, upper.
    A, _ = delassus(controls)
    g, w = state["impulse"].copy(), state["velocity"].copy()
    if controls["order"] == 1:
        A, g, w = A[::-1, ::-1].copy(), g[::-1].copy(), w[::-1].copy()
    pgs_sweep(A, g, w, 1, False)
    if controls["order"] == 1:
        g, w = g[::-1].copy(), w[::-1].copy()
    state["impulse"][:] = g
    state["velocity"][:] = w
    state["sweeps"] += 1
    state["error"][state["sweeps"]] = error_of(controls, g)


def initial(controls, state):
    """Start from impulses of zero: the blocks would fall freely."""
    state["velocity"][:] = delassus(controls)[1]
    state["error"][0] = error_of(controls, state["impulse"])


def advance(state, controls, seconds):
    """Make the sweeps that are due, up to the last one."""
    for _ in range(min(whole_steps(state, seconds, _PACE), LAST - state["sweeps"])):
        sweep(controls, state)


TITLE = "Solver sweeps on a stack of two blocks"
word, colour = draw.words_table(), draw.colours_table()
_FLOOR, _LOW, _HIGH = colour("#d9d4ca", "#cfe3f2", "#f8dcc4")
_SWEEP, _IMPULSE, _BARS = word("sweep", "impulse [N s]", "impulses in this step")
_LOG, _ERRORS, _THEORY = word("log₁₀ of the error", "error after each sweep", "predicted")
_AT_FLOOR, _BETWEEN, _EXACT = word("floor", "between", "exact")
_MISSING, _MEASURED, _PREDICTED, _APPROACH = word(
    "relative error", "factor, measured", "factor, predicted", "still approaching at"
)
_PERCENT, _MMPS, _KG, _NONE = word(" %", " mm/s", " kg", "after two sweeps")
_SCENE, _VIEW = (0.2, 2.9, 0.5, 4.4), (-1.35, 1.35, -0.35, 3.55)
_BAR_PLACE, _ERROR_PLACE = (3.75, 5.65, 0.85, 4.2), (6.6, 8.85, 0.85, 4.2)
_SIDE = 0.8  # of a block of 1 kg in the picture


@register_jitable
def _blocks(pen, state, controls):
    """Draw both blocks, and the share of the exact contact force that each contact carries."""
    draw.area(pen, _SCENE, _VIEW)
    draw.box(pen, -2.0, 2.0, -1.0, 0.0, _FLOOR)
    draw.segment(pen, -2.0, 0.0, 2.0, 0.0, draw.INK, 1.5)
    # Blocks of one density: the side is proportional to the cube root of the mass.
    low, high = 0.5 * _SIDE, 0.5 * _SIDE * controls["ratio"] ** (1.0 / 3.0)
    draw.box(pen, -low, low, 0.0, 2.0 * low, _LOW, draw.BLUE, 2.0)
    draw.box(pen, -high, high, 2.0 * low, 2.0 * (low + high), _HIGH, draw.ORANGE, 2.0)
    draw.text(pen, low, low, 0, draw.INK, 12.0, draw.LEFT, draw.MIDDLE, 8.0)
    draw.number(pen, LOWER, 0, _KG)
    top = 2.0 * (low + high)
    draw.text(pen, 0.0, top, 0, draw.INK, 12.0, draw.CENTRE, draw.BOTTOM, 0.0, 5.0)
    draw.number(pen, LOWER * controls["ratio"], 2, _KG)
    exact = solution(controls)
    # Arrows in units of the floor's exact impulse, so that they grow to a common scale.
    for k in range(2):
        x, foot = (0.15, 0.0) if k == 0 else (-0.15, 2.0 * low)
        share = state["impulse"][k] / exact[0]
        if share > 0.0:
            ink = draw.BLUE if k == 0 else draw.ORANGE
            draw.arrow(pen, x, foot, x, foot + 1.2 * share, ink, 4.0)
    draw.window(pen)


@register_jitable
def _charts(pen, state, controls):
    """Draw the impulses as bars in front of the exact ones, and the error over the sweeps."""
    exact = solution(controls)
    draw.area(pen, _BAR_PLACE, (0.0, 2.0, 0.0, 1.15 * exact[0]))
    draw.axes(pen, 0, _IMPULSE, _BARS, 0, 5)
    for k in range(2):
        ink = draw.BLUE if k == 0 else draw.ORANGE
        draw.box(pen, k + 0.2, k + 0.8, 0.0, state["impulse"][k], ink)
        draw.segment(pen, k + 0.1, exact[k], k + 0.9, exact[k], draw.INK, 2.5)
        name = _AT_FLOOR if k == 0 else _BETWEEN
        draw.text(pen, k + 0.5, 0.0, name, draw.INK, 12.0, draw.CENTRE, draw.TOP, 0.0, -6.0)
    draw.text(pen, 0.5, exact[0], _EXACT, draw.INK, 11.5, draw.CENTRE, draw.BOTTOM, 0.0, 4.0)
    n, A = state["sweeps"], delassus(controls)[0]
    # The axis of sweeps doubles as they go on.
    last = 10.0 if n <= 10 else 20.0 if n <= 20 else 40.0
    draw.area(pen, _ERROR_PLACE, (0.0, last, -6.0, 0.4))
    draw.axes(pen, _SWEEP, _LOG, _ERRORS, 5, 6)
    # Exact convergence would be log10(0).
    error = np.log10(np.maximum(state["error"][: n + 1], 1e-300))
    if n > 0:
        # From the first sweep on the error lies along the eigenvector, so it shrinks by its factor.
        x = np.linspace(1.0, last, 2)
        draw.theory(pen, x, error[1] + (x - 1.0) * math.log10(contraction(A)))
    draw.spots(pen, np.arange(n + 1), error, 0.014 * last, draw.PURPLE)
    draw.window(pen)
    draw.theory_key(pen, 7.3, 4.7, _THEORY)


def frame(pen, state, controls):
    """Draw the stack, the impulses and their error, and the numbers."""
    _blocks(pen, state, controls)
    _charts(pen, state, controls)
    n, error = state["sweeps"], state["error"]
    draw.reading(pen, _SWEEP, n, 0)
    draw.reading(pen, _MISSING, 100.0 * error[n], 2, _PERCENT)
    # Measured contraction: the ratio of two successive errors, as long as rounding doesn't
    # dominate.
    draw.readout(pen, _MEASURED)
    if n >= 2 and error[n] > 1e-13:
        draw.number(pen, error[n] / error[n - 1], 3)
    else:
        draw.words(pen, _NONE)
    draw.reading(pen, _PREDICTED, contraction(delassus(controls)[0]), 3)
    # The residual of the contact law: the largest speed of approach that is left.
    left = max(-min(state["velocity"][0], state["velocity"][1]), 0.0)
    draw.reading(pen, _APPROACH, 1000.0 * left, 2, _MMPS)


def press(controls, state, key):
    """Handle a key: right or + makes one sweep."""
    if key in (1, 4) and state["sweeps"] < LAST:
        sweep(controls, state)


PRESETS = {
    "Heavy on light": Preset(
        {},
        "Press play, or press the right arrow key for one sweep. A sweep visits each contact "
        "once and treats the other impulse as right. The upper block presses down the lower one "
        "again and again, so only a part of the error goes away each time.",
    ),
    "Light on heavy": Preset(
        {"ratio": 0.25},
        "The same stack the other way round. A light block hardly disturbs what "
        "is below it, and a few sweeps are enough.",
    ),
    "Very heavy on light": Preset(
        {"ratio": 20.0},
        "Almost all of the error survives a sweep. A real-time engine stops after "
        "a few sweeps, and such a stack looks soft. Try smaller mass ratios.",
    ),
    "Upper contact first": Preset(
        {"order": 1},
        "The first sweep reaches the upper contact before anything presses on it. "
        "That costs a sweep. After it, the error falls by the same factor as in the other order.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "sweep": "How many times the solver has visited both contacts.",
    "relative error": "Distance of the impulses from the exact ones, over the size of those.",
    "factor, measured": "Error after this sweep over the error before it.",
    "factor, predicted": "Largest eigenvalue of a sweep, from the Delassus matrix of the stack.",
    "still approaching at": "Largest speed at which a contact would still close after this sweep.",
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
    press=press,
    live_drag=True,
    readouts=READOUTS,
)
