"""A mass dropped on a spring and damper: the loop of force and penetration, and the step limit."""

import math

import numpy as np
from numba.extending import register_jitable

from course.contact.models import penalty_force, penalty_step_limit
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, slider, switch

MASS, GRAVITY = 1.0, 9.81  # [kg], [m/s^2]
DURATION = 0.6  # of the motion that is shown [s]
_SHORTEST, _LONGEST = 0.2, 40.0  # steps [ms]
_MOST = round(1000.0 * DURATION / _SHORTEST)  # steps
_POINTS = 500  # of a line in the picture, at most
_SLOW = 0.1  # s of the motion in a second of playing
_FAR = 10.0  # m; what is farther away has exploded

CONTROLS = Record(
    stiffness=slider("Stiffness", 10_000.0, 1000.0, 50_000.0, 500.0, "N/m", 0),
    zeta=slider("Damping ratio", 0.2, 0.0, 1.5, 0.05),
    timestep=slider("Step", 2.0, _SHORTEST, _LONGEST, 0.2, "ms", 1),
    height=slider("Drop height", 20.0, 0.0, 100.0, 1.0, "mm", 0),
    pull=switch("Damper may pull", False),
)
STATE = Record(
    path=Field(0.0, shape=(3, _MOST + 1)),  # height of the lower side [m], its velocity, force [N]
    fine=Field(0.0, shape=(3, _MOST + 1)),  # the same with the shortest step
    time=Field(0.0, unit="s"),
)


@register_jitable
def steps_of(timestep):
    """Return how many steps of `timestep` milliseconds are shown."""
    # Rounding may put the quotient just above an integer, hence the subtracted term; the bound is
    # the room in the path.
    return min(math.ceil(1000.0 * DURATION / timestep - 1e-9), _MOST)


@register_jitable
def damper(controls):
    """Return the damping coefficient of the contact [N s/m]."""
    return 2.0 * controls["zeta"] * math.sqrt(controls["stiffness"] * MASS)


@register_jitable
def simulate_from(controls, timestep, y, v, path):
    """Write height, velocity and contact force before each step into the columns of path.

    The motion starts at the height y [m] with the velocity v [m/s].
    """
    dt, force = 1e-3 * timestep, np.zeros(1)
    none, u, pull = np.zeros(0), np.zeros(1), controls["pull"] != 0
    for k in range(steps_of(timestep) + 1):
        u[0] = v
        # Kelvin-Voigt contact: the force is evaluated at the old state, so that the damper limits
        # the step too.
        penalty_force(-y, u, controls["stiffness"], damper(controls), none, 1.0, pull, force)
        path[0, k], path[1, k], path[2, k] = y, v, force[0]
        if abs(y) < _FAR:  # what has exploded stays where it is
            # Semi-implicit Euler: the new velocity moves the mass.
            v += dt * (force[0] / MASS - GRAVITY)
            y += dt * v


def initial(controls, state):
    """Compute the motion at this step, and at the shortest one."""
    height = 1e-3 * controls["height"]
    simulate_from(controls, controls["timestep"], height, 0.0, state["path"])
    simulate_from(controls, _SHORTEST, height, 0.0, state["fine"])


def advance(state, controls, seconds):
    """Let the marker follow the motion slowly, and start again at its end."""
    state["time"] = (state["time"] + _SLOW * seconds) % DURATION


@register_jitable
def scaled_step(controls):
    """Return omega dt: the natural frequency of the spring times the step."""
    return 1e-3 * controls["timestep"] * math.sqrt(controls["stiffness"] / MASS)


TITLE = "A penalty contact: spring, damper and time step"
word, colour = draw.words_table(), draw.colours_table()
_SAFE, _UNSAFE = colour("#dff0e6", "#f7dedd")
_DEPTH, _FORCE, _LOOP = word("penetration [mm]", "contact force [N]", "force against penetration")
_TIME, _HEIGHT, _MOTION = word("time [s]", "height [mm]", "height of the mass")
_ZETA, _STEP, _LIMITS = word("damping ratio", "ω h", "step limit: drag the point")
_STABLE, _UNSTABLE = word("stable", "unstable")
_THIS, _FINE, _NOW = word("this step", "shortest step", "now, in slow motion")
_LIMIT, _SIDE, _DEEPEST, _BOUNCE = word(
    "limit of ω h", "resting contact", "deepest", "highest bounce"
)
_MM, _NONE = word(" mm", "none")
_LEFT, _TOP, _BOTTOM = (0.85, 3.95, 0.75, 4.1), (5.0, 8.8, 3.0, 4.25), (5.0, 8.8, 0.72, 1.95)
_ZETAS, _SCALED = (0.0, 1.5), (0.0, 3.0)  # shown beside the step limit


@register_jitable
def _thinned(timestep):
    """Return every how many-th step is drawn."""
    return max(1, math.ceil(steps_of(timestep) / _POINTS))


@register_jitable
def _overlaps(pen, path, ink):
    """Draw force against penetration while the bodies overlap."""
    draw.line(pen, ink, 2.0, 0.9)
    # The loop encloses the energy that the damper takes; samples without overlap become gaps.
    draw.points(pen, np.where(path[0] < 0.0, -1000.0 * path[0], np.nan), path[2])


@register_jitable
def _loop(pen, state, controls, k):
    """Draw force against penetration, at this step and at the shortest."""
    # The scale comes from the fine motion, so that an explosion leaves the picture instead of
    # flattening it.
    deep = max(-1000.0 * np.min(state["fine"][0]), 1.0)
    push = max(np.max(state["fine"][2]), 20.0)
    n, fine = steps_of(controls["timestep"]) + 1, _thinned(_SHORTEST)
    rough = _thinned(controls["timestep"])
    floor = -0.5 * push if controls["pull"] else 0.0
    draw.area(pen, _LEFT, (-0.1 * deep, 1.6 * deep, floor, 1.45 * push))
    draw.axes(pen, _DEPTH, _FORCE, _LOOP, 4, 6)
    m, path = steps_of(_SHORTEST) + 1, state["path"]
    _overlaps(pen, state["fine"][:, :m:fine], draw.GREY)
    _overlaps(pen, path[:, :n:rough], draw.BLUE)
    draw.spot(pen, -1000.0 * path[0, k], path[2, k], 0.035 * deep, draw.RED)
    draw.window(pen)


@register_jitable
def _motion(pen, state, controls, k):
    """Draw the height over time."""
    n, rough, fine = steps_of(controls["timestep"]) + 1, _thinned(controls["timestep"]), 6
    high = max(1000.0 * np.max(state["fine"][0]), 4.0)
    low = min(1300.0 * np.min(state["fine"][0]), -1.0)
    draw.area(pen, _TOP, (0.0, DURATION, low, 1.25 * high))
    draw.axes(pen, _TIME, _HEIGHT, _MOTION, 6, 4)
    draw.segment(pen, 0.0, 0.0, DURATION, 0.0, draw.INK, 1.0)
    # Heights in mm over time: the fine motion in grey, the one with the chosen step in blue.
    times = 1e-3 * _SHORTEST * np.arange(steps_of(_SHORTEST) + 1)
    draw.curve(pen, times[::fine], 1000.0 * state["fine"][0, : times.size : fine], draw.GREY, 2.0)
    times = 1e-3 * controls["timestep"] * np.arange(n)
    draw.curve(pen, times[::rough], 1000.0 * state["path"][0, :n:rough], draw.BLUE, 2.0)
    draw.spot(pen, times[k], 1000.0 * state["path"][0, k], 0.01, draw.RED)
    draw.window(pen)


@register_jitable
def _limits(pen, controls):
    """Draw the step limit over the damping ratio, and where this contact is."""
    draw.area(pen, _BOTTOM, (_ZETAS[0], _ZETAS[1], _SCALED[0], _SCALED[1]))
    zeta = np.linspace(_ZETAS[0], _ZETAS[1], 61)
    # Stability region of the step over the damping ratio: the limit is a root of the step's
    # characteristic polynomial at the eigenvalue -1.
    limit = np.empty(61)
    for i in range(61):
        limit[i] = penalty_step_limit(zeta[i])
    draw.box(pen, _ZETAS[0], _ZETAS[1], _SCALED[0], _SCALED[1], _UNSAFE)
    draw.polygon(pen, _SAFE)
    draw.point(pen, _ZETAS[1], 0.0)
    draw.point(pen, _ZETAS[0], 0.0)
    draw.points(pen, zeta, limit)
    draw.axes(pen, _ZETA, _STEP, _LIMITS, 4, 3)
    draw.theory(pen, zeta, limit)
    draw.text(pen, 1.3, 0.35, _STABLE, draw.GREEN, 12.0, draw.RIGHT)
    draw.text(pen, 1.42, 2.5, _UNSTABLE, draw.RED, 12.0, draw.RIGHT)
    # Points beyond the chart stay visible at its upper edge.
    at = min(scaled_step(controls), _SCALED[1])
    draw.spot(pen, controls["zeta"], at, 0.025, draw.BLUE, draw.INK)
    draw.window(pen)


def frame(pen, state, controls):
    """Draw the loop, the motion, the step limit, and the numbers."""
    timestep, path = controls["timestep"], state["path"]
    n = steps_of(timestep)
    # The sample at which the marker is; the addend keeps it from falling one behind by rounding.
    k = min(int(1000.0 * state["time"] / timestep + 1e-9), n)
    _loop(pen, state, controls, k)
    _motion(pen, state, controls, k)
    _limits(pen, controls)
    draw.key(pen, 0.4, 4.75, _THIS, draw.BLUE, 3.0)
    draw.key(pen, 1.7, 4.75, _FINE, draw.GREY, 3.0)
    draw.spot(pen, 3.45, 4.75, 0.06, draw.RED)
    draw.text(pen, 3.6, 4.75, _NOW, draw.INK, 11.5)
    scaled, limit = scaled_step(controls), penalty_step_limit(controls["zeta"])
    draw.reading(pen, _STEP, scaled, 2)
    draw.reading(pen, _LIMIT, limit, 2)
    draw.readout(pen, _SIDE)
    # The limit is that of a lasting contact: a bounce leaves the spring's linear range in between.
    draw.words(pen, _STABLE if scaled < limit else _UNSTABLE)
    draw.reading(pen, _DEEPEST, -1000.0 * min(np.min(path[0, : n + 1]), 0.0), 1, _MM)
    bounce = highest_bounce(path, n)
    if bounce < 0.0:
        draw.reading(pen, _BOUNCE, 0.0, 0, 0, _NONE)
    else:
        draw.reading(pen, _BOUNCE, 1000.0 * bounce, 1, _MM)


@register_jitable
def highest_bounce(path, n):
    """Return the largest height after the first contact [m]; -1.0 where there is none above 0."""
    result, touched = -1.0, False
    for k in range(n + 1):
        touched = touched or path[0, k] < 0.0
        if touched and path[0, k] > 0.0:
            result = max(result, path[0, k])
    return result


def drag(controls, state, x, y):
    """Move the point beside the step limit: damping ratio and step follow the pointer."""
    values = (_ZETAS[0], _ZETAS[1], _SCALED[0], _SCALED[1])
    zeta, scaled = draw.values_at(_BOTTOM, values, x, y)
    controls["zeta"] = min(max(zeta, _ZETAS[0]), _ZETAS[1])
    # From ω dt back to milliseconds with the present stiffness, inverse to `scaled_step`.
    step = 1000.0 * scaled / math.sqrt(controls["stiffness"] / MASS)
    controls["timestep"] = min(max(step, _SHORTEST), _LONGEST)


PRESETS = {
    "A short step": Preset(
        {},
        "The spring pushes back in proportion to the penetration, the damper in proportion to "
        "the speed, so the force on the way in is larger than on the way out. The area of the loop "
        "is the energy that the damper takes. Lengthen the step and watch the loop open.",
    ),
    "Just below the limit": Preset(
        {"timestep": 15.0, "height": 0.0},
        "The mass is laid on the floor and comes to rest, though each oscillation has only a few "
        "steps. Drag the point in the lower chart across the dashed line.",
    ),
    "Just above the limit": Preset(
        {"timestep": 17.0, "height": 0.0},
        "The same contact with a slightly longer step never comes to rest: each step overshoots by "
        "more than the one before, until the mass loses contact and falls back. Lower the "
        "stiffness or shorten the step.",
    ),
    "The damper pulls": Preset(
        {"zeta": 0.4, "pull": True, "height": 50.0, "timestep": 1.0},
        "If the damper may pull, the force becomes negative while the mass leaves, as if the floor "
        "were sticky. Engines clip the force at zero: switch the pull off and compare the loops.",
    ),
}

# What each number below the picture means.
READOUTS = {
    "ω h": "Natural frequency of the spring times the step.",
    "limit of ω h": (
        "Largest stable value at this damping ratio, for a contact that stays closed and a "
        "semi-implicit step."
    ),
    "resting contact": "Whether a mass that lies on this contact comes to rest.",
    "deepest": "Largest penetration during the motion that is shown.",
    "highest bounce": "Largest height of the mass after the first contact.",
}

PAPER = draw.Paper(TITLE, word, colour)
MODEL = Model(
    TITLE, PAPER, CONTROLS, STATE, PRESETS, initial, advance, frame, drag, readouts=READOUTS
)
