"""A 7-R arm in its null space: the elbow swings, the tip stays, and what each step costs it."""

import math

import numpy as np
from numba.extending import register_jitable

from course.kinematics.chain import panda
from course.kinematics.inverse import METHODS, decompose, step
from course.kinematics.motion import columns, place
from course.rigid_body.quaternion import conjugate, log, product, rotate
from course.simulations import pen as draw
from course.simulations import space
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider, switch

_ARM = panda()
_TABLE, _LOWER, _UPPER = _ARM.table, _ARM.lower, _ARM.upper
_START = np.array([0.3, -0.4, 0.1, -1.9, 0.0, 1.7, 0.6])  # rad
_PACE, _SWING = 1.0, 2.2  # rad/s along the null space; rad to either side
_PSEUDO = METHODS.index("pseudo_inverse")
_ELBOW, _PAST = 3, 240  # the joint that swings; samples remembered

CONTROLS = Record(
    h=slider("Step h", 0.02, 0.002, 0.1, 0.002, "rad", 3, live=True),
    correct=switch("one IK step after each", False, live=True),
    **space.camera(0.35, 0.3, 5.0),
)
STATE = Record(
    q=Field(0.0, shape=(7,), unit="rad"),
    goal=Field(0.0, shape=(7,)),  # pose of the tip at the start
    along=Field(0.0, shape=(7,)),  # where the last step went, a unit vector
    swing=Field(0.0, unit="rad"),  # made along the null space, from the start
    sense=Field(1.0),
    travelled=Field(0.0, unit="m"),  # by the elbow
    steps=Field(0),
    time=Field(0.0, unit="s"),
    owed=Field(0.0, unit="s"),
    past=Field(0.0, shape=(5, 2 * _PAST)),  # time, error of the tip [m], elbow
    samples=Field(0),
)


@register_jitable
def posed(q):
    """Return poses of all joints and of the tip, (8, 7), and the tip's Jacobian, (6, 7)."""
    # Forward kinematics, then the geometric Jacobian about the tip: a 6 x 7 matrix with a null
    # space.
    pose, J = np.empty((8, 7)), np.zeros((6, 7, 1))
    place(_TABLE, q.reshape(7, 1), 0, pose)
    columns(_TABLE, pose, 7, (pose[7, 0], pose[7, 1], pose[7, 2]), J, 0)
    return pose, J[:, :, 0].copy()


@register_jitable
def error_of(pose, goal):
    """Return the twist from the tip to its goal, (6,) [m, rad]."""
    away = np.empty(6)
    # Position error, then the rotation vector (logarithm) of the attitude error.
    away[:3] = goal[:3] - pose[7, :3]
    away[3:] = log(product(goal[3:], conjugate(pose[7, 3:])))
    return away


@register_jitable
def still(J, last):
    """Return the unit joint rates that leave the tip still, (7,), on the side of the last ones."""
    moving, U, direction = np.empty((6, 7)), np.empty((6, 6)), last.copy()
    decompose(J, moving, U)
    # Gram-Schmidt against the rows of J, which `decompose` makes orthogonal: what remains of the
    # last direction spans the null space. "Twice is enough" (Kahan and Parlett).
    for _ in range(2):  # once more for the digits that the first time cancels
        for k in range(6):
            row = moving[k]
            direction -= row * (np.sum(row * direction) / np.sum(row * row))
        direction /= math.sqrt(np.sum(direction * direction))
    return direction


@register_jitable
def _remember(state, pose):
    n = draw.remember(state["past"], state["samples"], state["time"])
    state["past"][1, n - 1] = math.sqrt(np.sum((pose[7, :3] - state["goal"][:3]) ** 2))
    state["past"][2:, n - 1] = pose[_ELBOW, :3]
    state["samples"] = n


def initial(controls, state):
    """Set up the arm at its start, which is where its tip must stay."""
    state["q"][:] = _START
    pose, J = posed(_START)
    state["goal"][:] = pose[7]
    state["along"][:] = still(J, np.ones(7))
    _remember(state, pose)


def advance(state, controls, seconds):
    """Advance the simulation: as many whole steps as fit.

    At the end of the swing, and at a limit, it turns round.
    """
    h, q = controls["h"], state["q"]
    count = math.floor((state["owed"] + seconds) * _PACE / h + 1e-9)
    state["owed"] = max(state["owed"] + seconds - count * h / _PACE, 0.0)
    for _ in range(count):
        # A motion along the null space leaves the tip still to first order only: each step errs by
        # O(h²).
        pose, J = posed(q)
        state["along"][:] = still(J, state["along"])
        ahead = q + h * state["sense"] * state["along"]
        # Turn round before the end of the swing or a joint limit, instead of leaving the interval.
        if abs(state["swing"] + h * state["sense"]) > _SWING or np.any(
            (ahead < _LOWER) | (ahead > _UPPER)
        ):
            state["sense"] = -state["sense"]
            ahead = q + h * state["sense"] * state["along"]
        state["swing"] += h * state["sense"]
        after, J = posed(ahead)
        # One pseudo-inverse (Newton) step on the pose error undoes the drift of second order.
        if controls["correct"]:
            change, e = np.zeros(7), error_of(after, state["goal"])
            step(J, e, _PSEUDO, 0.0, np.empty((6, 7)), np.empty((6, 6)), change)
            ahead = ahead + change
            after, _ = posed(ahead)
        q[:] = ahead
        state["travelled"] += math.sqrt(np.sum((after[_ELBOW, :3] - pose[_ELBOW, :3]) ** 2))
        state["steps"] += 1
        state["time"] += h / _PACE
        _remember(state, after)


TITLE = "An arm in its null space"
word, colour = draw.words_table(), draw.colours_table()
_LINK, _FLOOR = colour("#3b6ea5", "#f2f4f6")
_TIP, _TURNED, _STEPS, _ROAD, _CURVE, _WAY = word(
    "the tip is off by",
    "and turned by",
    "steps",
    "the elbow has moved",
    "off by one step / h²",
    "along the null space",
)
_MM, _DEGREES, _M, _PER, _RAD, _TIME, _LOG, _HISTORY = word(
    " mm",
    "°",
    " m",
    " m/rad²",
    " rad",
    "time [s]",
    "log₁₀ [mm]",
    "how far the tip is from its place",
)
_SCENE, _PAST_PLACE = (0.1, 5.2, 0.1, 4.9), (6.1, 8.8, 2.2, 4.3)
_CENTRE = np.array([0.2, 0.0, 0.45])  # of the view [m]
_SQUARE = np.array([[-0.5, 0.8, 0.8, -0.5], [-0.6, -0.6, 0.6, 0.6], [0.0] * 4])


def frame(pen, state, controls):
    """Draw the arm, the way of its elbow and the place of its tip; the error over time; numbers."""
    pose, J = posed(state["q"])
    past = state["past"][:, : state["samples"]]
    middle = _CENTRE.reshape(3, 1)
    eye = space.camera_view(pen, _SCENE, controls, 0.62)
    space.sheet(pen, eye, _SQUARE - middle, _FLOOR, draw.FAINT, 1.0, 0.9)
    joints = np.zeros((3, 9))
    # The arm as a polyline from the base over all joints to the tip, in the frame of the view.
    joints[:, 1:] = pose[:, :3].T
    joints -= middle
    space.trail(pen, eye, joints, _LINK, 9.0)
    for k in range(9):
        space.dot(pen, eye, joints[:, k].copy(), draw.INK, 0.022)
    space.dot(pen, eye, joints[:, 1 + _ELBOW].copy(), draw.GREEN, 0.035)
    space.trail(pen, eye, past[2:] - middle, draw.GREEN, 2.5)
    goal = state["goal"]
    for k in range(3):  # the hand's axes where they should be, and where they are
        unit = np.zeros(3)
        unit[k] = 0.16
        foot = goal[:3] - _CENTRE
        space.arrow(pen, eye, foot, foot + rotate(goal[3:], unit), draw.ORANGE, 4.0, 7.0)
        foot = pose[7, :3] - _CENTRE
        space.arrow(pen, eye, foot, foot + rotate(pose[7, 3:], unit), draw.INK, 1.6, 7.0)
    # The error of the tip on a logarithmic scale over the last eight seconds; the floor avoids
    # log10(0).
    start = max(past[0, -1] - 8.0, 0.0)
    draw.area(pen, _PAST_PLACE, (start, start + 8.0, -10.0, 3.0))
    draw.axes(pen, _TIME, _LOG, _HISTORY, 4, 4)
    draw.curve(pen, past[0], np.log10(np.maximum(1000.0 * past[1], 1e-12)), draw.BLUE, 1.8)
    draw.window(pen)
    away = error_of(pose, goal)
    # The error of a single step over h² is nearly constant: it measures the curvature of the
    # motion.
    h = controls["h"]
    ahead, _ = posed(state["q"] + h * still(J, state["along"]))
    one = math.sqrt(np.sum((ahead[7, :3] - pose[7, :3]) ** 2))
    draw.reading(pen, _TIP, 1000.0 * math.sqrt(np.sum(away[:3] ** 2)), 6, _MM)
    draw.reading(pen, _TURNED, math.degrees(math.sqrt(np.sum(away[3:] ** 2))), 6, _DEGREES)
    draw.reading(pen, _STEPS, state["steps"], 0)
    draw.reading(pen, _WAY, state["swing"], 2, _RAD)
    draw.reading(pen, _ROAD, state["travelled"], 3, _M)
    draw.reading(pen, _CURVE, one / (h * h), 4, _PER)


PRESETS = {
    "The elbow swings": Preset(
        {},
        "Press play. Seven joints, six numbers to keep: one way to move is left. Each step "
        "goes along it exactly, and the tip is off all the same: the way is curved.",
    ),
    "Half the step": Preset(
        {"h": 0.01},
        "A step of half the length is off by a quarter, and twice as many are needed: "
        "half the error at the same place.",
    ),
    "One IK step after each": Preset(
        {"correct": True},
        "A step of inverse kinematics puts the tip back: from the square of h to its fourth power.",
    ),
    "Long steps, put back": Preset(
        {"h": 0.1, "correct": True},
        "The step is five times as long. With the correction you still cannot see the tip move.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "the tip is off by": "Distance of the tip from where it should stay.",
    "and turned by": "Angle between the tip's orientation and the one it should keep.",
    "steps": "Steps along the null space so far.",
    "along the null space": "Distance covered in joint space along the null space.",
    "the elbow has moved": "Length of the elbow's path.",
    "off by one step / h²": (
        "Tip error of a single uncorrected step, divided by the square of the step. It is "
        "constant if the error is of second order."
    ),
}

MODEL = Model(
    TITLE,
    PAPER,
    CONTROLS,
    STATE,
    PRESETS,
    initial,
    advance,
    frame,
    **space.ORBIT,
    readouts=READOUTS,
)
