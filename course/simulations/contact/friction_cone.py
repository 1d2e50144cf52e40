"""The friction cone in space: a block is pulled, and its contact force stays inside the cone."""

import math

import numpy as np
from numba.extending import register_jitable

from course.contact.models import _edges, pgs_sweep
from course.simulations import pen as draw
from course.simulations import space
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider
from course.simulations.rigid_body.turning import whole_steps

MASS, GRAVITY = 2.0, 9.81  # of the block [kg], [m/s^2]
STEP = 0.004  # s
_RUN = 3.0  # the block begins again after that distance [m]
# Corners of the four-sided pyramids that engines put in place of the cone, (2, 4) for mu f_n = 1.
PYRAMIDS = (_edges(3, 4, False).T.copy(), _edges(3, 4, True).T.copy())

CONTROLS = Record(
    friction=slider("Friction coefficient μ", 0.5, 0.0, 1.0, 0.05, live=True),
    size=slider("Pull, size", 6.0, 0.0, 25.0, 0.5, "N", 1, live=True),
    direction=slider("Pull, direction on the floor", 20.0, -180.0, 180.0, 5.0, "°", 0, live=True),
    rise=slider("Pull, angle above the floor", 0.0, 0.0, 45.0, 5.0, "°", 0, live=True),
    pyramid=menu(
        "Pyramid with four sides", ("none", "inside the cone", "around the cone"), live=True
    ),
    **space.camera(-0.9, 0.32, 6.0),
)
STATE = Record(
    v=Field((0.0, 0.0), unit="m/s"),
    moved=Field((0.0, 0.0), unit="m"),
    force=Field((0.0, 0.0, 0.0), unit="N"),  # of the contact: along x, along y, normal
    owed=Field(0.0, unit="s"),
    time=Field(0.0, unit="s"),
)


@register_jitable
def pull_of(controls):
    """Return the force of the pull (x, y, z) [N]."""
    along, rise = math.radians(controls["direction"]), math.radians(controls["rise"])
    flat = controls["size"] * math.cos(rise)
    return flat * math.cos(along), flat * math.sin(along), controls["size"] * math.sin(rise)


@register_jitable
def contact_force(controls, v, dt, force):
    """Write the force of the floor on the block (x, y, normal) [N] over a step of dt from v.

    One sweep of the chapter's projected Gauss-Seidel: the rows of one contact at the centre of mass
    are independent, so the first sweep is exact.
    """
    mu, pull = controls["friction"], pull_of(controls)
    # Rows scaled by the friction coefficient, so that the cone is |g_t| <= g_n.
    A = np.diag(np.array([1.0, mu * mu, mu * mu])) / MASS
    w = np.array(
        [
            dt * (pull[2] / MASS - GRAVITY),
            mu * (v[0] + dt * pull[0] / MASS),
            mu * (v[1] + dt * pull[1] / MASS),
        ]
    )
    # With impulses of zero to start from, w holds the velocity that the step would have without
    # contact.
    g = np.zeros(3)
    pgs_sweep(A, g, w, 3, False)
    force[0], force[1], force[2] = mu * g[1] / dt, mu * g[2] / dt, g[0] / dt


def initial(controls, state):
    """Put the block at rest."""
    contact_force(controls, state["v"], STEP, state["force"])


def advance(state, controls, seconds):
    """Advance by whole steps; after some metres the block starts again from rest."""
    pull = pull_of(controls)
    for _ in range(whole_steps(state, seconds, STEP)):
        # Semi-implicit Euler: the contact force is that over this step, so a sticking block stays
        # at rest exactly.
        contact_force(controls, state["v"], STEP, state["force"])
        state["time"] += STEP
        for k in range(2):
            state["v"][k] += STEP / MASS * (pull[k] + state["force"][k])
            state["moved"][k] += STEP * state["v"][k]
        if math.hypot(state["moved"][0], state["moved"][1]) > _RUN:
            state["v"][:] = 0.0
            state["moved"][:] = 0.0


@register_jitable
def pyramid_limit(corners, x, y):
    """Return how far a pyramid reaches in the direction (x, y), where the cone reaches 1."""
    # Where the pull has no direction, there is nothing to measure.
    size, result = math.hypot(x, y), math.inf
    if size == 0.0:
        return 1.0
    for k in range(4):
        ax, ay = corners[0, k], corners[1, k]
        # Intersection of a ray with a convex polygon: the nearest of the sides that face it.
        bx, by = corners[0, (k + 1) % 4], corners[1, (k + 1) % 4]
        # The side's line is n . p = c with c > 0; the ray meets it at c / (n . direction).
        nx, ny = by - ay, ax - bx
        towards = (nx * x + ny * y) / size
        if towards > 0.0:
            result = min(result, (nx * ax + ny * ay) / towards)
    return result


TITLE = "The friction cone and the contact force inside it"
word, colour = draw.words_table(), draw.colours_table()
_GROUND, _PAINT = colour("#f4f1ea", "#d8d2c4")
_CONE_FILL, _BLOCK_FILL = space.shades(colour, "#e8b07a", "#8fb3d9")
_CONTACT, _PULL_KEY, _CONE_KEY, _PYRAMID_KEY = word(
    "contact force", "pull", "friction cone", "pyramid"
)
_FX, _FY, _ABOVE = word("along x [N]", "along y [N]", "friction, from above")
_NORMAL, _FRICTION, _LIMIT, _BOX, _RATE, _MODE, _TIME = word(
    "normal force",
    "friction force",
    "limit μ × normal",
    "limit of pyramid",
    "acceleration",
    "contact",
    "time",
)
_N, _MPSS, _SECONDS = word(" N", " m/s²", " s")
_STICKS, _SLIDES = word("sticks", "slides")
_NO_PYRAMID = word("none")[0]
_SCENE, _PLANE = (0.1, 5.5, 0.1, 4.6), (6.45, 8.85, 1.35, 3.75)
_REACH, _PER_NEWTON, _LIFT = 1.15, 0.05, 0.5  # m shown; m of an arrow for a newton; view's centre
_WIDE = 26.0  # N shown from above
_CORNERS, _INDEX = space.box(0.8, 0.6, 0.22)
_SIDES, _SIDE_INDEX = space.lathe([(0.0, 0.0), (1.0, 1.0)], 36)
_CONE_FILLS = np.full(len(_SIDE_INDEX), _CONE_FILL)
_BLOCK_FILLS = np.full(len(_INDEX), _BLOCK_FILL)
_TILE = 0.4  # m between the lines of the floor


@register_jitable
def _at(x, y, z):
    """Return a point (3,) relative to the centre of the view."""
    return np.array([x, y, z - _LIFT])


@register_jitable
def _floor(pen, eye, moved):
    """Draw the floor with lines that pass under the block as it moves."""
    half = 1.1
    corner = np.array([[-half, half, half, -half], [-half, -half, half, half], [-_LIFT] * 4])
    space.sheet(pen, eye, corner, _GROUND, draw.FAINT, 1.0, 1.0)
    for axis in range(2):
        # Rounding may put the first line just below -half or one tile above it.
        first = -half + (-moved[axis] + half) % _TILE
        for k in range(6):
            at = first + k * _TILE
            if -half <= at <= half:
                ends = np.zeros((3, 2))
                ends[axis] = at
                ends[1 - axis, 0], ends[1 - axis, 1] = -half, half
                ends[2] = -_LIFT
                space.trail(pen, eye, ends, _PAINT, 1.2)


@register_jitable
def _pyramid(pen, eye, corners, radius, height):
    """Draw the edges of a pyramid from the contact up."""
    rim = np.zeros((3, 5))
    for k in range(5):
        rim[0, k], rim[1, k] = radius * corners[0, k % 4], radius * corners[1, k % 4]
    rim[2] = height - _LIFT
    space.trail(pen, eye, rim, draw.PURPLE, 2.0)
    for k in range(4):
        edge = np.zeros((3, 2))
        edge[2, 0] = -_LIFT
        edge[:, 1] = rim[:, k]
        space.trail(pen, eye, edge, draw.PURPLE, 1.6)


@register_jitable
def slides(controls, force):
    """Return whether the contact force lies on the surface of the cone."""
    size = math.hypot(force[0], force[1])
    # On the surface of the cone up to rounding; without friction force a contact sticks.
    return size > 0.0 and size >= (1.0 - 1e-9) * controls["friction"] * force[2]


@register_jitable
def _from_above(pen, controls, force):
    """Draw friction seen from above, in the section of the cone at the present normal force."""
    # The section of the cone at the present normal force is Coulomb's disc of radius μ f_n.
    limit = controls["friction"] * force[2]
    draw.area(pen, _PLANE, (-_WIDE, _WIDE, -_WIDE, _WIDE))
    draw.axes(pen, _FX, _FY, _ABOVE, 5, 5)
    round = space.circle(limit)
    draw.polygon(pen, _CONE_FILL + 6, draw.ORANGE, 2.0, 0.6)
    draw.points(pen, round[0], round[1])
    if controls["pyramid"] > 0:
        corners = PYRAMIDS[0] if controls["pyramid"] == 1 else PYRAMIDS[1]
        draw.polygon(pen, draw.NONE, draw.PURPLE, 2.0)
        draw.points(pen, limit * corners[0], limit * corners[1])
    # The pull and friction in one plane: while the block sticks, the arrows are opposite and equal.
    pull = pull_of(controls)
    draw.arrow(pen, 0.0, 0.0, pull[0], pull[1], draw.GREEN, 2.0)
    ink = draw.RED if slides(controls, force) else draw.BLUE
    draw.arrow(pen, 0.0, 0.0, force[0], force[1], ink, 3.0)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw block, cone and forces in space, their section from above, and the numbers."""
    # The contact force is computed again, since the controls may have changed after the last step.
    force, pull = np.zeros(3), pull_of(controls)
    contact_force(controls, state["v"], STEP, force)
    mu, ink = controls["friction"], draw.RED if slides(controls, force) else draw.BLUE
    height = _PER_NEWTON * force[2]
    radius, foot = mu * height, _at(0.0, 0.0, 0.0)
    eye = space.camera_view(pen, _SCENE, controls, _REACH)
    _floor(pen, eye, state["moved"])
    block = _CORNERS + np.array([[0.0], [0.0], [0.11 - _LIFT]])
    space.faces(pen, eye, block, _INDEX, _BLOCK_FILLS, draw.GREY, 0.8, 0.55)
    # A unit cone from the contact up, stretched to the present normal force: its rim is the disc.
    cone = _SIDES * np.array([[radius], [radius], [height]]) + foot.reshape(3, 1)
    space.faces(pen, eye, cone, _SIDE_INDEX, _CONE_FILLS, draw.NONE, 0.6, 0.28)
    rim = space.circle(radius)
    rim[2] = height - _LIFT
    space.trail(pen, eye, rim, draw.ORANGE, 2.0)
    if controls["pyramid"] > 0:
        corners = PYRAMIDS[0] if controls["pyramid"] == 1 else PYRAMIDS[1]
        _pyramid(pen, eye, corners, radius, height)
    # Dashed: the normal force and then friction, the components of the contact force.
    tip = _at(_PER_NEWTON * force[0], _PER_NEWTON * force[1], height)
    axis = np.zeros((3, 3))
    axis[:, 0], axis[:, 1], axis[:, 2] = foot, _at(0.0, 0.0, height), tip
    space.trail(pen, eye, axis, draw.INK, 1.2, 0.8, 4.0, 4.0)
    space.arrow(pen, eye, foot, tip, ink, 4.0, 13.0)
    # The pull acts at the block's upper side in the picture; the model has no moments.
    hook = _at(0.0, 0.0, 0.11)
    end = _at(_PER_NEWTON * pull[0], _PER_NEWTON * pull[1], 0.11 + _PER_NEWTON * pull[2])
    space.arrow(pen, eye, hook, end, draw.GREEN, 4.0, 13.0)
    _from_above(pen, controls, force)
    draw.key(pen, 0.2, 4.78, _CONTACT, ink, 4.0)
    draw.key(pen, 1.85, 4.78, _PULL_KEY, draw.GREEN, 4.0)
    draw.key(pen, 2.8, 4.78, _CONE_KEY, draw.ORANGE, 2.5)
    if controls["pyramid"] > 0:
        draw.key(pen, 4.4, 4.78, _PYRAMID_KEY, draw.PURPLE, 2.5)
    limit = mu * force[2]
    draw.reading(pen, _NORMAL, force[2], 1, _N)
    draw.reading(pen, _FRICTION, math.hypot(force[0], force[1]), 1, _N)
    draw.reading(pen, _LIMIT, limit, 1, _N)
    rate = math.hypot(pull[0] + force[0], pull[1] + force[1]) / MASS
    draw.reading(pen, _RATE, rate, 2, _MPSS)
    draw.readout(pen, _MODE)
    draw.words(pen, _SLIDES if slides(controls, force) else _STICKS)
    # The limit of the pyramid in the direction of the pull, since friction is opposite to it.
    if controls["pyramid"] > 0:
        corners = PYRAMIDS[0] if controls["pyramid"] == 1 else PYRAMIDS[1]
        draw.reading(pen, _BOX, limit * pyramid_limit(corners, pull[0], pull[1]), 1, _N)
    else:
        draw.reading(pen, _BOX, 0.0, 1, _N, _NO_PYRAMID)
    draw.reading(pen, _TIME, state["time"], 2, _SECONDS)


PRESETS = {
    "It sticks": Preset(
        {},
        "Friction is exactly as large as the pull, so nothing moves. Raise the pull: the blue "
        "arrow leans over until it reaches the surface of the cone. Drag the picture to look at it "
        "from elsewhere.",
    ),
    "It slides": Preset(
        {"size": 15.0},
        "Press play. The pull asks for more friction than μ times the normal "
        "force. The contact force stops on the surface of the cone, and what is left of the pull "
        "accelerates the block. Raise μ until it stops.",
    ),
    "Pulled upwards": Preset(
        {"size": 15.0, "rise": 40.0, "friction": 0.7},
        "A pull that also lifts takes weight off the floor. The normal force is smaller, so the "
        "cone is cut lower and friction can resist less. Lower the angle and watch both.",
    ),
    "A pyramid around the cone": Preset(
        {"pyramid": 2, "size": 12.0, "direction": 45.0},
        "Many engines replace the cone by a pyramid, since flat sides are easier to solve for. "
        "Along its diagonal this one would still hold the block. Turn the pull, and compare with "
        "the pyramid inside the cone.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "normal force": "Component of the contact force perpendicular to the floor.",
    "friction force": "Size of the component of the contact force along the floor.",
    "limit μ × normal": "Largest friction force that Coulomb's law allows at this normal force.",
    "limit of pyramid": "Largest friction force that the pyramid allows opposite to the pull.",
    "acceleration": "Acceleration of the block: what friction leaves of the pull, over the mass.",
    "contact": "Whether the contact sticks or slides, with its force on the cone's surface.",
    "time": "Simulated time since the start. A contact that sticks stays as it is meanwhile.",
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
    **space.ORBIT,
    readouts=READOUTS,
)
