"""Chapter 4's simulation: two links follow a target by steps of inverse kinematics."""

import math

import numpy as np
from numba.extending import register_jitable

from course.kinematics.chain import planar
from course.kinematics.inverse import METHODS, decompose, gain, step
from course.kinematics.motion import columns, place
from course.kinematics.two_link import branches
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider

L1, L2 = 1.0, 0.8  # as in the chapter's worked examples [m]
_TABLE = planar((L1, L2)).table
_FAR, _NEAR = L1 + L2, L1 - L2
DAMPED, MARQUARDT = METHODS.index("damped"), METHODS.index("levenberg_marquardt")
_METHODS = tuple(name.replace("_", " ") for name in METHODS)
_ROWS = ("x, y", "x, y, angle (m)", "x, y, angle (mm)")
_PACE, _AIM = 0.05, 0.04  # time from one step to the next [s]; the farthest that one aims [m]
_PAST = 160  # steps remembered

CONTROLS = Record(
    method=menu("Step", _METHODS, DAMPED, live=True),
    damping=slider("Damping", 0.10, 0.01, 1.0, 0.01, "m/rad", live=True),
    rows=menu("Condition number of", _ROWS, live=True),
    target=Field((0.5, 1.1), low=-2.2, high=2.2, unit="m"),
    start=Field((2.2, 1.2), unit="rad"),
)
STATE = Record(
    q=Field(0.0, shape=(2,), unit="rad"),
    lam=Field(0.0, unit="m/rad"),  # damping of Levenberg-Marquardt, which follows its success
    amplification=Field(
        0.0, unit="rad/m"
    ),  # length of the last step by the error that it was made for
    largest=Field(0.0, unit="rad/m"),  # of these since the start
    steps=Field(0),
    owed=Field(0.0, unit="s"),
    past=Field(0.0, shape=(3, 2 * _PAST)),  # time, error [m], smallest singular value
    samples=Field(0),
)


@register_jitable
def jacobian(q):
    """Return the positions of elbow and tip, (2,) each [m], and the Jacobian.

    The rows of the Jacobian, (3, 2), are x, y and angle.
    """
    # Forward kinematics and the geometric Jacobian; of its six rows the plane needs x, y and the
    # rotation about z.
    pose, whole = np.empty((3, 7)), np.zeros((6, 2, 1))
    place(_TABLE, q.reshape(2, 1), 0, pose)
    columns(_TABLE, pose, 2, (pose[2, 0], pose[2, 1], pose[2, 2]), whole, 0)
    rows = np.empty((3, 2))
    rows[:2], rows[2] = whole[:2, :, 0], whole[5, :, 0]
    return pose[1, :2].copy(), pose[2, :2].copy(), rows


@register_jitable
def singular(rows):
    """Return directions of the tip, (m, m), and singular values, (m,), largest first."""
    m = rows.shape[0]
    moved, U = np.empty(rows.shape), np.empty((m, m))
    # Singular values from orthogonal rows (one-sided Jacobi), sorted, since the rows come in any
    # order.
    decompose(rows, moved, U)
    s = np.sqrt(np.sum(moved * moved, axis=1))
    order = np.argsort(-s)
    return U[:, order], s[order]


@register_jitable
def gains(J, e, method, damping, s):
    """Return what a step makes of an error along singular directions s, (k,) [rad/m].

    The transpose takes each s times a length that belongs to this posture and this error.
    """
    # Jacobian transpose with the step length that minimises the remaining error to first order:
    # the product of e and J J^T e over |J J^T e|².
    if method == 0:
        pull = np.array([J[0, k] * e[0] + J[1, k] * e[1] for k in range(2)])
        moved = np.array([J[k, 0] * pull[0] + J[k, 1] * pull[1] for k in range(2)])
        return s * (np.sum(moved * e) / max(np.sum(moved * moved), 1e-300))
    desired = np.empty(len(s))
    for k in range(len(s)):
        # A method's filter of a singular value: 1 / s for the pseudo-inverse, s / (s² + λ²) damped.
        desired[k] = gain(s[k], method, damping) if s[k] > 0.0 else 0.0
    return desired


@register_jitable
def aim(controls, tip):
    """Return the error that one step works on, (2,), and the whole one's length [m].

    A far target is aimed at in pieces, as the Jacobian holds near the posture only.
    """
    e = controls["target"] - tip
    size = math.hypot(e[0], e[1])
    return (e * (_AIM / size) if size > _AIM else e), size


@register_jitable
def damping_of(controls, state):
    """Return the lambda of the next step: Levenberg and Marquardt have their own."""
    return state["lam"] if controls["method"] == MARQUARDT else controls["damping"]


@register_jitable
def follow(controls, state):
    """Take one step; return whether it was taken, as Levenberg-Marquardt refuses a worse one."""
    q, method = state["q"], controls["method"]
    _, tip, rows = jacobian(q)
    e, size = aim(controls, tip)
    change = np.zeros(2)
    # Levenberg-Marquardt is damped least squares with a λ that adapts; the step itself is the same.
    kind = DAMPED if method == MARQUARDT else method
    step(
        rows[:2].copy(),
        e,
        kind,
        damping_of(controls, state),
        np.empty((2, 2)),
        np.empty((2, 2)),
        change,
    )
    # Gain of the step: joint motion over the error that it worked on, bounded by 1 / (2 λ) if
    # damped.
    state["amplification"] = math.hypot(change[0], change[1]) / max(min(size, _AIM), 1e-300)
    if size > 1e-9:
        state["largest"] = max(state["largest"], state["amplification"])
    # Turned back into one turn: the picture cannot tell, and no number grows.
    ahead = (q + change + math.pi) % (2.0 * math.pi) - math.pi
    # Accept a step that reduces the error, and trust the linear model more; otherwise raise the
    # damping and stay. The bounds keep λ finite when no step succeeds.
    if method == MARQUARDT:
        _, after, _ = jacobian(ahead)
        _, remaining = aim(controls, after)
        if not remaining < size:
            state["lam"] = min(state["lam"] * math.sqrt(8.0), 1e3)
            return
        state["lam"] = max(state["lam"] * math.sqrt(0.1), 1e-6)
    q[:] = ahead


@register_jitable
def _remember(controls, state):
    _, tip, rows = jacobian(state["q"])
    # The smallest singular value measures the distance to a singular posture.
    _, s = singular(rows[:2])
    away = math.hypot(controls["target"][0] - tip[0], controls["target"][1] - tip[1])
    n = draw.remember(state["past"], state["samples"], _PACE * state["steps"])
    state["past"][1, n - 1], state["past"][2, n - 1] = away, s[1]
    state["samples"] = n


def initial(controls, state):
    """Set up the arm at its start."""
    state["q"][:] = controls["start"]
    state["lam"] = controls["damping"]
    _remember(controls, state)


def advance(state, controls, seconds):
    """Advance the simulation: as many whole steps as fit; the rest is owed."""
    count = math.floor((state["owed"] + seconds) / _PACE + 1e-9)
    state["owed"] = max(state["owed"] + seconds - count * _PACE, 0.0)
    for _ in range(count):
        follow(controls, state)
        state["steps"] += 1
        _remember(controls, state)


TITLE = "Two links follow a target"
word, colour = draw.words_table(), draw.colours_table()
_SHELL, _HOLE, _LINK = colour("#eef3f7", "#ffffff", "#3b6ea5")
_ERROR, _STEPS, _COND, _YOSHIKAWA, _SMALLEST, _ASKED, _MOST, _BOUND = word(
    "error",
    "steps",
    "condition number",
    "manipulability",
    "smallest value",
    "gain of the step",
    "largest gain so far",
    "its bound 1/(2λ)",
)
_METRES, _RADIANS, _PER, _SQUARE, _ENDLESS, _NO_BOUND = word(
    " m",
    " m/rad",
    " rad/m",
    " m²/rad²",
    "∞",
    "none",
)
_S, _GAIN, _GAINS, _TIME, _LOG, _HISTORY = word(
    "singular value s [m/rad]",
    "rad/m",
    "gain of a step at s; dots: this posture",
    "time [s]",
    "log₁₀ error [m]",
    "how far the tip is from its target",
)
_SCENE, _CURVE, _PASSED = (0.1, 4.8, 0.15, 4.85), (5.75, 8.8, 2.95, 4.4), (5.75, 8.8, 0.6, 1.95)
_HALF = 2.2  # of the scene [m]
_VIEW = (-_HALF, _HALF, -_HALF, _HALF)
_TOP, _SPAN = 12.0, 2.0  # of the gains [rad/m] and of the singular values shown


def drag(controls, state, x, y):
    """Handle a drag: the target is where the pointer is, or at the edge of the scene."""
    result = draw.values_at(_SCENE, _VIEW, x, y)
    for k in range(2):
        controls["target"][k] = min(max(result[k], -_HALF), _HALF)


def press(controls, state, key):
    """Handle a key: an arrow key moves the target by 5 cm."""
    if key < 4:
        target = controls["target"]
        target[0] += 0.05 * ((key == 1) - (key == 0))
        target[1] += 0.05 * ((key == 2) - (key == 3))
        for k in range(2):
            target[k] = min(max(target[k], -_HALF), _HALF)


@register_jitable
def _links(pen, q1, q2, ink, width, alpha, on, gap):
    ex, ey = L1 * math.cos(q1), L1 * math.sin(q1)
    draw.line(pen, ink, width, alpha, on, gap)
    draw.point(pen, 0.0, 0.0)
    draw.point(pen, ex, ey)
    draw.point(pen, ex + L2 * math.cos(q1 + q2), ey + L2 * math.sin(q1 + q2))


@register_jitable
def _scene(pen, state, controls, tip, elbow, U, s):
    """Annulus, ghosts, glow, arm, ellipse, target."""
    q, target = state["q"], controls["target"]
    draw.area(pen, _SCENE, _VIEW)
    # The workspace is an annulus between |L1 - L2| and L1 + L2.
    draw.spot(pen, 0.0, 0.0, _FAR, _SHELL, draw.GREY, 1.2)
    draw.spot(pen, 0.0, 0.0, _NEAR, _HOLE, draw.GREY, 1.2)
    # Both exact solutions of the inverse kinematics as ghosts, elbow to either side.
    left, right, bend, _ = branches(L1, L2, target[0], target[1])
    _links(pen, left, bend, draw.GREY, 3.0, 0.7, 6.0, 5.0)
    _links(pen, right, -bend, draw.GREY, 3.0, 0.7, 6.0, 5.0)
    # Red grows with 1 / s: at s = 0.05 m/rad it is full.
    glow = min(0.05 / max(s[1], 1e-12), 1.0)
    for k in range(5):
        draw.spot(
            pen,
            tip[0],
            tip[1],
            (0.12 + 0.5 * glow) * (k + 1) / 5.0,
            draw.RED,
            draw.NONE,
            1.0,
            0.22 * glow,
        )
    # Manipulability ellipsoid (Yoshikawa, 1985): tip velocities of unit joint rates, with the
    # singular vectors as its axes.
    angle = np.linspace(0.0, 2.0 * math.pi, 49)
    along, across = 0.35 * s[0] * np.cos(angle), 0.35 * s[1] * np.sin(angle)
    draw.curve(
        pen,
        tip[0] + U[0, 0] * along + U[0, 1] * across,
        tip[1] + U[1, 0] * along + U[1, 1] * across,
        draw.GREEN,
        2.0,
    )
    _links(pen, q[0], q[1], _LINK, 9.0, 1.0, 0.0, 0.0)
    draw.disc(pen, 0.07, draw.INK)
    draw.point(pen, 0.0, 0.0)
    draw.point(pen, elbow[0], elbow[1])
    draw.spot(pen, tip[0], tip[1], 0.06, draw.RED if glow > 0.5 else draw.INK)
    draw.spot(pen, target[0], target[1], 0.08, draw.ORANGE, draw.INK, 1.5)


@register_jitable
def _charts(pen, state, controls, J, e, s):
    """Draw the gain over singular values, and the error over time."""
    damping, method = damping_of(controls, state), controls["method"]
    method = DAMPED if method == MARQUARDT else method
    draw.area(pen, _CURVE, (0.0, _SPAN, 0.0, _TOP))
    draw.axes(pen, _S, _GAIN, _GAINS, 4, 4)
    # Gain over the singular value: near s = 0 the pseudo-inverse diverges, the damped step returns
    # to 0.
    values = np.linspace(0.0, _SPAN, 161)
    draw.curve(
        pen, values, np.minimum(gains(J, e, method, damping, values), 9.0 * _TOP), draw.BLUE, 2.0
    )
    # The damped gain s / (s² + λ²) has its maximum 1 / (2 λ) at s = λ.
    if method == DAMPED:
        draw.segment(pen, 0.0, 0.5 / damping, _SPAN, 0.5 / damping, draw.INK, 1.2, 0.8, 5.0, 4.0)
    own = gains(J, e, method, damping, s)
    draw.disc(pen, 0.05, draw.RED)
    draw.point(pen, s[0], min(own[0], _TOP))
    draw.point(pen, s[1], min(own[1], _TOP))
    # The error over the last six seconds, on a logarithmic scale with a floor against log10(0).
    past = state["past"][:, : state["samples"]]
    start = max(past[0, -1] - 6.0, 0.0)
    draw.area(pen, _PASSED, (start, start + 6.0, -10.0, 1.0))
    draw.axes(pen, _TIME, _LOG, _HISTORY, 4, 3)
    draw.curve(pen, past[0], np.log10(np.maximum(past[1], 1e-12)), draw.BLUE, 1.8)


def frame(pen, state, controls):
    """Draw the arm, its ellipse and glow, the exact answers; gains and error; numbers."""
    elbow, tip, rows = jacobian(state["q"])
    U, s = singular(rows[:2])
    e, error = aim(controls, tip)
    _scene(pen, state, controls, tip, elbow, U, s)
    _charts(pen, state, controls, rows[:2].copy(), e, s)
    draw.window(pen)
    whole = rows.copy() if controls["rows"] else rows[:2].copy()
    # Rows of different units: with lengths in mm the condition number changes, although the arm
    # doesn't.
    if controls["rows"] == 2:
        whole[:2] *= 1000.0
    _, shown = singular(whole.T)
    draw.reading(pen, _ERROR, error, 6, _METRES)
    draw.reading(pen, _STEPS, state["steps"], 0)
    draw.readout(pen, _COND)
    # At a singular posture the quotient would be infinite or arbitrary.
    if shown[1] > 1e-12 * shown[0]:
        draw.number(pen, shown[0] / shown[1], 1)
    else:
        draw.words(pen, _ENDLESS)
    draw.reading(pen, _YOSHIKAWA, s[0] * s[1], 4, _SQUARE)
    draw.reading(pen, _SMALLEST, s[1], 4, _RADIANS)
    draw.reading(pen, _ASKED, state["amplification"], 2, _PER)
    draw.reading(pen, _MOST, state["largest"], 1, _PER)
    draw.readout(pen, _BOUND)
    if controls["method"] == DAMPED or controls["method"] == MARQUARDT:
        draw.number(pen, 0.5 / damping_of(controls, state), 2, _PER)
    else:
        draw.words(pen, _NO_BOUND)


PRESETS = {
    "Follow the target": Preset(
        {},
        "Click anywhere, drag the target, or use the arrow keys. While the simulation plays, "
        "the arm follows. Inside the ring two arms reach the target (dashed). The start decides "
        "which one the steps find, and it is not always the nearer one. "
        "Green: how far the tip can move for joint rates of one.",
    ),
    "Stretched, target inward": Preset(
        {"start": (0.6, 0.0), "target": (0.6 * math.cos(0.6), 0.6 * math.sin(0.6))},
        "Press play: nothing happens, whatever the step. The tip can only move across the arm, "
        "and the target lies along it. Nudge the target by one arrow key.",
    ),
    "Target out of reach": Preset(
        {"target": (1.7, 1.3), "start": (0.2, 0.9)},
        "The arm stretches towards it and the error stays. The smallest value goes to zero, the "
        "glow grows. Then take the pseudo-inverse.",
    ),
    "Jump beside the singularity": Preset(
        {
            "method": METHODS.index("pseudo_inverse"),
            "start": (0.6, 1e-3),
            "target": (1.2 * math.cos(0.6), 1.2 * math.sin(0.6)),
        },
        "A thousandth of a radian from stretched, the pseudo-inverse answers a pull inward with "
        "turns of many radians. Then try the damped step, and slide λ.",
    ),
    "The same arm in millimetres": Preset(
        {"rows": 2, "start": (0.9, 0.02), "target": (1.8 * math.cos(0.9), 1.8 * math.sin(0.9))},
        "With the angle of the hand among its rows, the condition number depends on the unit of "
        "the others: choose metres. The posture is the same; so say which rows were scaled.",
    ),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "error": "Distance from the tip to the target, with the orientation error where it counts.",
    "steps": "Steps of the inverse kinematics so far.",
    "condition number": (
        "Largest divided by smallest singular value of the Jacobian. At a singularity it is "
        "infinite."
    ),
    "manipulability": (
        "Product of the Jacobian's singular values (Yoshikawa). At a singularity it is zero."
    ),
    "smallest value": (
        "Smallest singular value of the Jacobian: how fast the tip moves in its worst direction "
        "at unit joint speed."
    ),
    "gain of the step": "Length of the last joint step divided by the error that it answered.",
    "largest gain so far": "Largest gain of a step since the start.",
    "its bound 1/(2λ)": "Upper bound of the gain with damping λ, for any Jacobian.",
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
    drag,
    press=press,
    live_drag=True,
    readouts=READOUTS,
)
