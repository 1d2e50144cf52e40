"""Complementarity: gap and contact force lie on two half axes, which a penalty law leaves.

A hand moves a ball without weight down to the floor, presses, and lifts it again. It moves so
slowly that the contact force equals the force of the hand.
"""

import numpy as np
from numba.extending import register_jitable

from course.contact.models import penalty_force
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider, switch

GAP, PRESS = 0.04, 20.0  # the largest gap [m] and the largest force of the hand [N]
RADIUS = 0.025  # of the ball [m]
_PACE, _TURN = 0.4, 0.95  # of the hand along its path [1/s]; where it turns back

CONTROLS = Record(
    stiffness=slider("Penalty stiffness", 1000.0, 500.0, 20_000.0, 100.0, "N/m", 0, live=True),
    penalty=switch("Penalty law for comparison", True, live=True),
    start=Field(0.8, low=-1.0, high=1.0),
)
STATE = Record(
    # Where the hand is on its path: above 0 a share of GAP, below 0 a share of PRESS.
    along=Field(0.0, low=-1.0, high=1.0),
    sense=Field(-1.0),
)


@register_jitable
def rigid_pair(along):
    """Return gap [m] and force [N] of a rigid contact: one of them is zero."""
    # Signorini's condition: gap >= 0, force >= 0 and their product 0, so one coordinate
    # parametrises the whole law.
    return GAP * max(along, 0.0), PRESS * max(-along, 0.0)


@register_jitable
def spring_force(gap, stiffness):
    """Return the force of the chapter's penalty law for a body at rest [N]."""
    force = np.zeros(1)
    penalty_force(-gap, np.zeros(1), stiffness, 0.0, np.zeros(0), 1.0, False, force)
    return force[0]


@register_jitable
def penalty_pair(along, stiffness):
    """Return gap [m] and force [N] where a penalty spring balances the same hand."""
    gap, force = rigid_pair(along)
    # Where the hand presses, the spring has to overlap by force / stiffness before it balances.
    gap -= force / stiffness
    return gap, spring_force(gap, stiffness)


def initial(controls, state):
    """Put the hand at its start, on its way down."""
    state["along"] = controls["start"]


def advance(state, controls, seconds):
    """Move the hand down, and up again once it presses hard."""
    # The hand turns back shortly before both ends of its path.
    along = state["along"] + _PACE * seconds * state["sense"]
    if state["sense"] < 0.0 and along < -_TURN:
        state["sense"] = 1.0
    elif state["sense"] > 0.0 and along > _TURN:
        state["sense"] = -1.0
    state["along"] = min(max(along, -1.0), 1.0)


TITLE = "Complementarity: gap and contact force on two half axes"
word, colour = draw.words_table(), draw.colours_table()
_FLOOR, _BALL, _AWAY = colour("#d9d4ca", "#f8dcc4", "#f2f2f2")
_GAPS, _FORCES, _HEADING = word("gap [mm]", "contact force [N]", "what the contact law allows")
_OVERLAP, _PULL, _DISTANCE = word("overlap", "the floor pulls", "force at a distance")
_RIGID, _SPRING, _HAND, _ABOVE = word(
    "rigid contact", "penalty spring", "force of the hand", "drag the ball"
)
_GAP, _FORCE, _PRODUCT, _SOFT_GAP, _SOFT_PRODUCT = word(
    "gap", "contact force", "gap × force", "gap, penalty", "gap × force, penalty"
)
_MM, _NEWTON, _WORK = word(" mm", " N", " N mm")
_SCENE, _VIEW = (0.3, 4.1, 0.4, 4.4), (-66.5, 66.5, -40.0, 100.0)
_PLANE, _VALUES = (5.2, 8.8, 0.75, 4.2), (-45.0, 45.0, -4.0, 24.0)
_PER_NEWTON = 2.0  # mm of an arrow


@register_jitable
def _scene(pen, state, controls):
    """Draw the floor, the ball by both laws, and the forces on it."""
    # The rigid ball in orange; beside it the penalty ball as an outline, which sinks into the
    # floor.
    gap, force = rigid_pair(state["along"])
    draw.area(pen, _SCENE, _VIEW)
    draw.box(pen, -70.0, 70.0, -50.0, 0.0, _FLOOR)
    draw.segment(pen, -70.0, 0.0, 70.0, 0.0, draw.INK, 1.5)
    radius, x = 1000.0 * RADIUS, 0.0
    if controls["penalty"]:
        x = -32.0
        soft, push = penalty_pair(state["along"], controls["stiffness"])
        y = 1000.0 * soft + radius
        draw.spot(pen, -x, y, radius, draw.NONE, draw.BLUE, 2.0)
        if push > 0.0:
            draw.arrow(pen, -x, y - radius, -x, y - radius + _PER_NEWTON * push, draw.BLUE, 3.0)
            draw.arrow(pen, -x, y + radius + _PER_NEWTON * push, -x, y + radius, draw.GREEN, 3.0)
    y = 1000.0 * gap + radius
    draw.spot(pen, x, y, radius, _BALL, draw.ORANGE, 2.0)
    # A dotted line for the gap, an arrow for the force: complementarity shows at most one of them.
    if gap > 0.0:
        draw.segment(pen, x, 0.0, x, y - radius, draw.GREY, 1.5, 1.0, 3.0, 3.0)
    if force > 0.0:
        draw.arrow(pen, x, 0.0, x, _PER_NEWTON * force, draw.ORANGE, 3.0)
        draw.arrow(pen, x, y + radius + _PER_NEWTON * force, x, y + radius, draw.GREEN, 3.0)
    draw.window(pen)


@register_jitable
def _plane(pen, state, controls):
    """Draw the half axes, what lies beside them, the penalty's line, and both pairs."""
    draw.area(pen, _PLANE, _VALUES)
    # Grey quadrants violate Signorini's condition: negative gaps, and forces that pull.
    draw.box(pen, _VALUES[0], 0.0, _VALUES[2], _VALUES[3], _AWAY)
    draw.box(pen, 0.0, _VALUES[1], _VALUES[2], 0.0, _AWAY)
    draw.axes(pen, _GAPS, _FORCES, _HEADING, 5, 5)
    draw.text(pen, -32.0, 2.5, _OVERLAP, draw.GREY, 11.5, draw.CENTRE)
    draw.text(pen, 23.0, -2.2, _PULL, draw.GREY, 11.5, draw.CENTRE)
    draw.text(pen, 23.0, 12.0, _DISTANCE, draw.GREY, 11.5, draw.CENTRE)
    # The law is the graph of both half axes: vertical while it touches, horizontal while it is
    # apart.
    draw.line(pen, draw.ORANGE, 4.0)
    draw.point(pen, 0.0, 100.0)
    draw.point(pen, 0.0, 0.0)
    draw.point(pen, 100.0, 0.0)
    if controls["penalty"]:
        draw.line(pen, draw.BLUE, 2.0)
        for k in range(9):
            gap = (1.5 - 0.375 * k) * GAP  # the law has one bend, at a gap of 0 (k = 4)
            draw.point(pen, 1000.0 * gap, spring_force(gap, controls["stiffness"]))
        gap, force = penalty_pair(state["along"], controls["stiffness"])
        draw.spot(pen, 1000.0 * gap, force, 1.7, draw.BLUE, draw.INK)
    gap, force = rigid_pair(state["along"])
    draw.spot(pen, 1000.0 * gap, force, 2.2, draw.ORANGE, draw.INK)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw the ball and its floor, the pair on its half axes, and the numbers."""
    _scene(pen, state, controls)
    _plane(pen, state, controls)
    draw.key(pen, 0.35, 4.7, _RIGID, draw.ORANGE, 4.0)
    draw.key(pen, 1.95, 4.7, _HAND, draw.GREEN, 4.0)
    if controls["penalty"]:
        draw.key(pen, 3.95, 4.7, _SPRING, draw.BLUE, 4.0)
    draw.text(pen, 0.4, 4.25, _ABOVE, draw.GREY, 11.5)
    gap, force = rigid_pair(state["along"])
    draw.reading(pen, _GAP, 1000.0 * gap, 1, _MM)
    draw.reading(pen, _FORCE, force, 1, _NEWTON)
    draw.reading(pen, _PRODUCT, 1000.0 * gap * force, 1, _WORK)
    if controls["penalty"]:
        gap, force = penalty_pair(state["along"], controls["stiffness"])
        draw.reading(pen, _SOFT_GAP, 1000.0 * gap, 1, _MM)
        draw.reading(pen, _SOFT_PRODUCT, 1000.0 * gap * force, 1, _WORK)


def drag(controls, state, x, y):
    """Move the ball, or the pair of gap and force, to the pointer; it stays on the half axes."""
    # In the scene the height of the ball sets the gap; below the floor the depth sets the force,
    # with full force at a depth of one radius.
    if x < 0.5 * (_SCENE[1] + _PLANE[0]):
        height = draw.values_at(_SCENE, _VIEW, x, y)[1] - 1000.0 * RADIUS
        along = height / (1000.0 * GAP) if height > 0.0 else height / (1000.0 * RADIUS)
    else:
        # In the plane the pointer is projected on the half axis that it is nearer to.
        gap, force = draw.values_at(_PLANE, _VALUES, x, y)
        along, pressed = gap / (1000.0 * GAP), force / PRESS
        if pressed > along:  # nearer to the axis of the forces
            along = -max(pressed, 0.0)
        else:
            along = max(along, 0.0)
    state["along"] = min(max(along, -1.0), 1.0)


def press(controls, state, key):
    """Handle a key: up and right lift the ball, down and left press it."""
    if key < 4:
        change = 0.05 if key in (1, 2) else -0.05
        state["along"] = min(max(state["along"] + change, -1.0), 1.0)


PRESETS = {
    "Down, press, lift": Preset(
        {},
        "Press play, or drag the ball or the orange point. While there is a gap, there is no "
        "force. While there is a force, there is no gap. So the product of the two is always zero: "
        "this is complementarity, and the corner in it is what makes contact hard to compute.",
    ),
    "A rigid contact alone": Preset(
        {"penalty": False, "start": 0.4},
        "The pair may lie anywhere on the orange lines and nowhere else. Try to drag the point "
        "into the corner regions: each of them is something that a floor cannot do.",
    ),
    "A stiff penalty": Preset(
        {"stiffness": 20_000.0, "start": -0.3},
        "A stiffer spring turns the blue line towards the vertical half axis, and the ball sinks "
        "in less. It never gets there, and a stiff spring needs short time steps. Change the "
        "stiffness while the ball is pressed.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "gap": "Distance between the ball and the floor with the rigid contact.",
    "contact force": "Force of the floor on the ball with the rigid contact.",
    "gap × force": "Product of gap and contact force. Complementarity says that it is zero.",
    "gap, penalty": "Distance with the penalty spring; negative while the ball overlaps the floor.",
    "gap × force, penalty": "The same product with the penalty spring: not zero while it pushes.",
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
    live_drag=True,
    readouts=READOUTS,
)
