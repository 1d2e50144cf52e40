"""Chapter 2's simulation: a shape is pulled against another, by two contact models at one step.

The shapes don't turn, so that the one against the other is a point against a box with a radius. The
models are those of `course.contact`: its penalty, and its sweep over cones, which is exact here.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.contact.models import penalty_force, pgs_sweep
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider, switch
from course.simulations.rigid_body.turning import whole_steps

MASS, GRAVITY = 1.0, 9.81  # of what moves [kg], [m/s^2]
HAND, HOLD = 200.0, 20.0  # spring and damper between the hand and each body [N/m, N s/m]
SLIP, RECOVERY = 0.04, 0.2  # speed of full friction [m/s]; share of the depth undone in a step
MOVING = ((0.0, 0.0, 0.15), (0.25, 0.2, 0.0))  # half sides and radius of what moves [m]
FIXED = ((1.5, 0.4, 0.0), (0.0, 0.0, 0.5), (0.02, 1.2, 0.0))  # and of what stands
PLACE = ((0.0, -0.4), (0.0, -0.1), (0.0, 0.1))  # of what stands
_GONE, _PAST, _WINDOW = 20.0, 500, 2.0  # m, samples, s shown
_SAMPLE = 0.004  # s
_REACH = 1.6  # of the hand, along each axis [m]

CONTROLS = Record(
    fixed=menu("Fixed body", ("floor", "circle", "thin wall")),
    moving=menu("Moving body", ("circle", "box"), 1),
    stiffness=slider("Stiffness", 3000.0, 500.0, 50000.0, 500.0, "N/m", 0),
    zeta=slider("Damping ratio", 0.3, 0.0, 2.0, 0.05),
    friction=slider("Friction coefficient μ", 0.70, 0.0, 1.5, 0.05),
    timestep=slider("Step", 5.0, 0.5, 40.0, 0.5, "ms", 1),
    pull=switch("Damper may pull", False),
    hand=Field((0.0, 0.2), low=-_REACH, high=_REACH, unit="m"),
    start=Field((0.0, 0.2, 0.0, 0.0)),  # x, y, vx, vy [m, m/s]
)
STATE = Record(
    bodies=Field(0.0, shape=(2, 4)),  # by penalty, by constraint: x, y, vx, vy
    force=Field(0.0, shape=(2, 2), unit="N"),  # of the last step: normal, along the surface
    gone=Field(0.0, shape=(2,)),  # whether one has left and is not followed any more
    steps=Field(0),
    owed=Field(0.0, unit="s"),
    past=Field(0.0, shape=(7, 2 * _PAST)),  # time, gaps [m], normal forces, tangential forces [N]
    samples=Field(0),
)


@register_jitable
def touch(controls, x, y):
    """Return signed distance of the shapes, and the unit normal from what stands to what moves."""
    # The Minkowski sum of both shapes is a box with rounded corners: its signed distance from the
    # relative position is that of the shapes.
    a, b = FIXED[controls["fixed"]], MOVING[controls["moving"]]
    here = PLACE[controls["fixed"]]
    px, py = x - here[0], y - here[1]
    dx, dy = abs(px) - (a[0] + b[0]), abs(py) - (a[1] + b[1])
    sx, sy, radius = math.copysign(1.0, px), math.copysign(1.0, py), a[2] + b[2]
    if dx <= 0.0 and dy <= 0.0:  # inside the box: out by the nearest side
        if dx > dy:
            return dx - radius, sx, 0.0
        return dy - radius, 0.0, sy
    # Outside, the distance to the nearest point of the box, clamped per axis, less the radius.
    ox, oy = max(dx, 0.0), max(dy, 0.0)
    far = math.hypot(ox, oy)
    return far - radius, sx * ox / far, sy * oy / far


@register_jitable
def step(controls, dt, model, body, force):
    """Advance a body (4,) by penalty (0) or constraint (1); return its contact force (2,) [N]."""
    gap, nx, ny = touch(controls, body[0], body[1])
    mu, hand = controls["friction"], controls["hand"]
    # The velocity without contact: the hand as a spring and damper, explicit, and gravity.
    vx = body[2] + dt / MASS * (HAND * (hand[0] - body[0]) - HOLD * body[2])
    vy = body[3] + dt / MASS * (HAND * (hand[1] - body[1]) - HOLD * body[3]) - dt * GRAVITY
    # The contact frame is the normal (nx, ny) and the tangent (ny, -nx), which points to the right
    # on the floor. Penalty: relative velocity in this frame, then a spring, damper and regularised
    # friction.
    if model == 0:
        u = np.array([nx * body[2] + ny * body[3], ny * body[2] - nx * body[3]])
        damper = 2.0 * controls["zeta"] * math.sqrt(controls["stiffness"] * MASS)
        penalty_force(
            -gap,
            u,
            controls["stiffness"],
            damper,
            np.array([mu]),
            SLIP,
            controls["pull"] != 0,
            force,
        )
    else:
        # Rows scaled by the friction coefficient, so that the cone is |g_t| <= g_n.
        A = np.diag(np.array([1.0, mu * mu])) / MASS
        # While apart, the gap may be closed within the step (speculative contact); an overlap is
        # undone by a share of its depth per step (Baumgarte stabilisation).
        allowed = gap / dt if gap > 0.0 else RECOVERY * gap / dt
        w = np.array([nx * vx + ny * vy + allowed, mu * (ny * vx - nx * vy)])
        g = np.zeros(2)
        # One projected Gauss-Seidel sweep is exact here, as the rows of a single contact at the
        # centre of mass are independent.
        pgs_sweep(A, g, w, 2, False)
        force[0], force[1] = g[0] / dt, mu * g[1] / dt
    # Semi-implicit Euler: force in the contact frame (n, t) back to x and y, then the new velocity
    # moves the body.
    body[2] = vx + dt / MASS * (nx * force[0] + ny * force[1])
    body[3] = vy + dt / MASS * (ny * force[0] - nx * force[1])
    body[0] += dt * body[2]
    body[1] += dt * body[3]


@register_jitable
def remember(controls, state):
    """Remember gaps and forces now."""
    past = state["past"]
    # Gaps now, and the forces of the step that led here.
    time = 1e-3 * controls["timestep"] * state["steps"]
    state["samples"] = n = draw.remember(past, state["samples"], time)
    for k in range(2):
        past[1 + k, n - 1] = touch(controls, state["bodies"][k, 0], state["bodies"][k, 1])[0]
        past[3 + k, n - 1] = state["force"][k, 0]
        past[5 + k, n - 1] = state["force"][k, 1]


def initial(controls, state):
    """Set up both bodies at the start."""
    for k in range(2):
        state["bodies"][k] = controls["start"]
    remember(controls, state)


def advance(state, controls, seconds):
    """Advance the simulation: as many whole steps as fit into the time, of both bodies.

    The rest is owed.
    """
    dt = 1e-3 * controls["timestep"]
    for _ in range(whole_steps(state, seconds, dt)):
        for k in range(2):
            if state["gone"][k] == 0.0:
                step(controls, dt, k, state["bodies"][k], state["force"][k])
                # A body that an unstable step has thrown far away is not followed any more, before
                # numbers overflow.
                state["gone"][k] = 1.0 if np.max(np.abs(state["bodies"][k])) > _GONE else 0.0
        state["steps"] += 1
        if state["steps"] % max(1, round(_SAMPLE / dt)) == 0:
            remember(controls, state)


TITLE = "Two shapes touch: penalty and constraint at one step"
word, colour = draw.words_table(), draw.colours_table()
_STONE, _PALE, _SAND = colour("#d9d4ca", "#cfe3f2", "#f8dcc4")
_PENALTY, _SOLVED, _CONE, _HAND = word(
    "penalty", "constraint", "friction cone", "the hand: drag it"
)
_T, _GAP, _GAPS, _TANGENT, _NORMAL, _FORCES = word(
    "time [s]",
    "gap [mm]",
    "gap: below zero is overlap",
    "tangential [N]",
    "normal [N]",
    "force on the body",
)
_DEPTH, _NORMALS, _TANGENTS, _MODE, _STEP, _MM, _NEWTON, _COMMA = word(
    "depth", "normal force", "tangential force", "contact", "ω h (penalty)", " mm", " N", ", "
)
_MODES = word("apart", "sticks", "slips", "pulls", "gone", "creeps")[0]
_DIRECTION = word("normal")[0]
_SCENE, _STRIP, _PLANE = (0.3, 5.3, 0.35, 4.45), (6.35, 8.8, 3.1, 4.45), (6.35, 8.8, 0.65, 2.2)
_VIEW = (-1.6, 1.6, -0.95, 1.674)
_INKS, _SKINS = (draw.BLUE, draw.ORANGE), (_PALE, _SAND)


@register_jitable
def mode(controls, missing, force, regularised):
    """Return which word says what the contact does.

    Apart, sticks, slips, pulls, or the body is gone. Below its limit, regularised friction sticks
    only if it is zero; otherwise the body creeps.
    """
    if missing != 0.0:
        return 4
    if force[0] < 0.0:
        return 3
    # A normal force of exactly zero means no contact; friction at its bound, up to rounding, means
    # slip.
    if force[0] == 0.0:
        return 0
    if abs(force[1]) > (1.0 - 1e-9) * controls["friction"] * force[0]:
        return 2
    return 5 if regularised and abs(force[1]) > 1e-6 * force[0] else 1


@register_jitable
def _shape(pen, half, x, y, fill, edge, alpha):
    """Draw a box or a circle."""
    if half[2] > 0.0:
        draw.spot(pen, x, y, half[2], fill, edge, 2.0, alpha)
    else:
        draw.box(pen, x - half[0], x + half[0], y - half[1], y + half[1], fill, edge, 2.0)


@register_jitable
def _scene(pen, state, controls):
    """Both bodies, what stands, the hand, and the forces at the nearest point."""
    draw.area(pen, _SCENE, _VIEW)
    # What stands, then both bodies with the spring that pulls each towards the hand.
    here, half = PLACE[controls["fixed"]], MOVING[controls["moving"]]
    _shape(pen, FIXED[controls["fixed"]], here[0], here[1], _STONE, draw.INK, 1.0)
    hand = controls["hand"]
    for k in range(2):
        x, y = state["bodies"][k, 0], state["bodies"][k, 1]
        if state["gone"][k] == 0.0:
            _shape(pen, half, x, y, _SKINS[k], _INKS[k], 0.8)
            draw.segment(pen, x, y, hand[0], hand[1], draw.GREY, 1.2, 0.8, 3.0, 3.0)
    for k in range(2):
        x, y = state["bodies"][k, 0], state["bodies"][k, 1]
        _, nx, ny = touch(controls, x, y)
        fn, ft = state["force"][k, 0], state["force"][k, 1]
        size = math.hypot(fn, ft)
        if state["gone"][k] == 0.0 and size > 0.0:
            scale = min(0.02, 0.8 / size)  # m per N; long arrows are drawn at most 0.8 m long
            draw.arrow(
                pen,
                x,
                y,
                x + scale * (nx * fn + ny * ft),
                y + scale * (ny * fn - nx * ft),
                _INKS[k],
                3.0,
            )
    draw.spot(pen, hand[0], hand[1], 0.05, draw.GREEN, draw.INK)
    draw.window(pen)
    draw.key(pen, 0.35, 4.72, _PENALTY, draw.BLUE, 4.0)
    draw.key(pen, 1.75, 4.72, _SOLVED, draw.ORANGE, 4.0)
    draw.key(pen, 3.4, 4.72, _HAND, draw.GREEN, 4.0)


@register_jitable
def _charts(pen, state, controls):
    """Draw gaps over time; the forces beside their cone."""
    end, past = state["samples"], state["past"]
    # Gaps over a sliding window of two seconds; the binary search finds its first sample.
    first = int(np.searchsorted(past[0, :end], past[0, end - 1] - _WINDOW))
    shown = past[:, first:end]
    start = max(0.0, past[0, end - 1] - _WINDOW)
    # The scale follows the deepest overlap in sight, but at most 60 mm.
    low = max(min(-1.0, 1300.0 * np.min(shown[1:3])), -60.0)
    draw.area(pen, _STRIP, (start, start + _WINDOW, low, max(1.0, -0.5 * low)))
    draw.axes(pen, _T, _GAP, _GAPS, 4, 4)
    draw.segment(pen, 0.0, 0.0, 1e4, 0.0, draw.INK, 1.0)
    for k in range(2):
        draw.curve(pen, shown[0], 1000.0 * shown[1 + k], _INKS[k], 2.0)
    # The plane of contact forces: Coulomb's cone as two lines, the forces of both models as dots,
    # so that a slipping contact lies on a line.
    top = 15.0
    for k in range(2):
        top = max(top, min(1.3 * state["force"][k, 0], 400.0))
    low = -0.2 * top  # a pulling damper's force is shown as well
    for k in range(2):
        low = min(low, max(1.3 * state["force"][k, 0], -400.0))
    draw.area(pen, _PLANE, (-top, top, low, top))
    draw.axes(pen, _TANGENT, _NORMAL, _FORCES, 4, 4)
    for side in (-1.0, 1.0):
        draw.segment(pen, 0.0, 0.0, side * controls["friction"] * top, top, draw.INK, 1.4, 0.8)
    for k in range(2):
        draw.spot(pen, state["force"][k, 1], state["force"][k, 0], 0.035 * top, _INKS[k])
    draw.window(pen)


@register_jitable
def _both(pen, name, a, b, form, unit):
    """Draw a reading of both models."""
    draw.readout(pen, name)
    draw.number(pen, a, form, _COMMA)
    draw.number(pen, b, form, unit)


def frame(pen, state, controls):
    """Draw the scene, gaps and forces; numbers of the penalty, then of the constraint."""
    _scene(pen, state, controls)
    _charts(pen, state, controls)
    bodies, force = state["bodies"], state["force"]
    # Numbers in pairs, penalty first: depth, normal and tangential force, and the contact's mode.
    gaps = [touch(controls, bodies[k, 0], bodies[k, 1])[0] for k in range(2)]
    depth = [1000.0 * max(-gap, 0.0) for gap in gaps]
    _both(pen, _DEPTH, depth[0], depth[1], 2, _MM)
    _both(pen, _NORMALS, force[0, 0], force[1, 0], 1, _NEWTON)
    _both(pen, _TANGENTS, force[0, 1], force[1, 1], 1, _NEWTON)
    _, nx, ny = touch(controls, bodies[1, 0], bodies[1, 1])
    _both(pen, _DIRECTION, nx, ny, 2, 0)
    draw.readout(pen, _MODE)
    draw.words(pen, _MODES + mode(controls, state["gone"][0], force[0], True))
    draw.words(pen, _COMMA)
    draw.words(pen, _MODES + mode(controls, state["gone"][1], force[1], False))
    # Natural frequency times step: semi-implicit Euler is unstable above 2 without damping.
    omega = math.sqrt(controls["stiffness"] / MASS)
    draw.reading(pen, _STEP, 1e-3 * controls["timestep"] * omega, 2)


def drag(controls, state, x, y):
    """Handle a drag: the hand is where the pointer is."""
    to = draw.values_at(_SCENE, _VIEW, x, y)
    for axis in range(2):
        controls["hand"][axis] = min(max(to[axis], -_REACH), _REACH)


def press(controls, state, key):
    """Handle a key: an arrow key moves the hand by 2 cm."""
    if key < 4:
        direction = 0.02 if key in (1, 2) else -0.02
        axis = 0 if key < 2 else 1
        controls["hand"][axis] = min(max(controls["hand"][axis] + direction, -_REACH), _REACH)


PRESETS = {
    "Drag it": Preset(
        {"hand": (0.9, 0.17), "start": (-1.2, 0.9, 0.0, 2.0)},
        "Two boxes start at the same place. Press play and drag the hand: the same spring pulls "
        "both. The penalty box has to overlap before it is pushed. The constraint box never does.",
    ),
    "Stick": Preset(
        {"hand": (0.03, 0.2)},
        "The hand pulls sideways with less than μ times the normal force. The constraint box "
        "stays. The penalty box creeps, because its friction is zero at rest. Move the hand a "
        "little and compare the speeds.",
    ),
    "Slip": Preset(
        {"hand": (1.2, 0.2)},
        "The pull exceeds the friction limit. Both contact forces lie on the "
        "edge of the friction cone. The boxes slide until the pull fits into the cone.",
    ),
    "Pull-back": Preset(
        {
            "pull": True,
            "zeta": 2.0,
            "stiffness": 500.0,
            "hand": (0.0, 0.45),
            "start": (0.0, 0.15, 0.0, 0.0),
            "timestep": 2.0,
        },
        "The hand lifts the boxes out of an overlap. Once the penalty box moves up fast enough, "
        "its damper pulls more than its spring pushes: the normal force is negative, as if the "
        "floor were sticky.",
    ),
    "Explosion": Preset(
        {"stiffness": 50000.0, "timestep": 15.0, "zeta": 0.0},
        "ω h is above 2, so the contact spring throws the penalty box off again and again. At the "
        "same step, the constraint box lies still. Shorten the step until both do.",
    ),
    "Tunnelling": Preset(
        {
            "fixed": 2,
            "moving": 0,
            "stiffness": 500.0,
            "zeta": 0.0,
            "hand": (0.6, 0.3),
            "start": (-0.4, 0.3, 9.0, 0.0),
        },
        "A fast ball, a soft contact and a wall of 4 cm. Once the penalty ball is past the middle "
        "of the wall, the shortest way out is the far side, and the spring pushes it there. The "
        "constraint ball looks ahead by one step and stops, although the hand is behind the wall.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "depth": "Penetration: first with the penalty model, then with the constraint.",
    "normal force": (
        "Contact force perpendicular to the surface: first the penalty model, then the constraint."
    ),
    "tangential force": (
        "Friction force along the surface, on the floor positive to the right: first the penalty "
        "model, then the constraint."
    ),
    "normal": "Components of the unit normal at the contact of the constraint model.",
    "contact": "Apart, sticking or sliding: first the penalty model, then the constraint.",
    "ω h (penalty)": (
        "Natural frequency of the penalty spring times the step size. Semi-implicit Euler is "
        "unstable above 2."
    ),
}

MODEL = Model(
    TITLE,
    draw.Paper(TITLE, word, colour),
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
