"""A spring, its step dragged across the limit: eigenvalues of one step, and a patch of states."""

import math

import numpy as np

from course.rigid_body.integrators import INTEGRATORS
from course.rigid_body.oscillator import METHODS, limit, step_of
from course.simulations import pen as draw
from course.simulations.model import Model, Preset
from course.simulations.record import Field, Record, menu, slider
from course.simulations.rigid_body.turning import whole_steps

OMEGA = 6.0  # rad/s
_LARGEST, _EDGE, _PAST = 3.2, 48, 400  # omega h, corners of the patch, steps remembered
_COSINE, _SINE = (f(np.linspace(0.0, 2.0 * math.pi, _EDGE + 1)) for f in (np.cos, np.sin))
_PATCH = 0.5 * _EDGE * 0.3**2 * math.sin(2.0 * math.pi / _EDGE)  # its area at the start
_LIMITS = np.array([[limit(name, k / 20) for k in range(21)] for name in METHODS])  # by zeta

CONTROLS = Record(
    omega_h=slider("ω h", 0.7, 0.05, _LARGEST, 0.01),
    zeta=slider("Damping ratio ζ", 0.0, 0.0, 1.0, 0.05),
    method=menu("Integrator", tuple(INTEGRATORS[name].label for name in METHODS), 1),
)
STATE = Record(
    z=Field(0.0, shape=(2, 1 + _EDGE)),  # x and v / omega: of the mass, of a patch of other starts
    matrix=Field(0.0, shape=(2, 2)),  # of one step
    steps=Field(0),
    owed=Field(0.0, unit="s"),
    past=Field(0.0, shape=(3, 2 * _PAST)),  # time, x, v / omega
    samples=Field(0),
)


def initial(controls, state):
    """Set up released at 1.

    The step's matrix is where it takes (1, 0) and (0, 1), in time 1 / omega.
    """
    # The patch is a polygon of other initial states around (1, 0): its area shows whether the step
    # is symplectic.
    state["z"][0, 0] = state["past"][1, 0] = 1.0
    state["z"][0, 1:], state["z"][1, 1:] = 1.0 + 0.3 * _COSINE[1:], 0.3 * _SINE[1:]
    state["samples"] = 1
    unit, params = np.eye(2), np.array([1.0, controls["zeta"]])
    # The step is linear in the state, so its images of the two unit vectors are the columns of its
    # matrix.
    q, v = step_of(controls["method"], unit[0:1], unit[1:2], controls["omega_h"], params)
    state["matrix"][:] = np.vstack((q, v))


def advance(state, controls, seconds):
    """Advance the simulation by as many whole steps as fit.

    A method whose state has left the picture by far is no longer advanced.
    """
    h, past, m = controls["omega_h"] / OMEGA, state["past"], state["matrix"]
    for _ in range(whole_steps(state, seconds, h)):
        # An unstable method grows without bound; beyond 1e4 further steps would only overflow.
        if np.max(np.abs(state["z"])) < 1e4:
            state["z"][:] = m[:, :1] * state["z"][0] + m[:, 1:] * state["z"][1]
            state["steps"] += 1
            state["samples"] = n = draw.remember(past, state["samples"], h * state["steps"])
            past[1:, n - 1] = state["z"][:, 0]


TITLE = "A spring and its step"
word, colour = draw.words_table(), draw.colours_table()
(_PALE,) = colour("#cfe3f2")
_PHASE, _CIRCLE = word(
    "states: the mass, and a patch of other starts", "eigenvalues of one step, unit circle"
)
_X, _V, _T, _H, _LIMIT = word("x", "v / ω", "time [s]", "ω h: drag me", "limit")
_STEPS, _MODULUS, _DET = word("steps", "largest |eigenvalue|", "determinant")
_AREA, _THEORY = word("area of the patch", "determinant ^ steps")
_ROPE, _STATES, _UNIT = (0.6, 4.6, 4.05, 4.6), (0.6, 4.6, 0.55, 3.7), (5.5, 7.1, 3.0, 4.6)
_SCALE, _TIME = (5.5, 8.8, 2.2, 2.45), (5.5, 8.8, 0.55, 1.4)


def drag(controls, state, x, y):
    """Handle a drag: the step is where the pointer is on its scale."""
    desired, _ = draw.values_at(_SCALE, (0.0, _LARGEST, 0.0, 1.0), x, y)
    controls["omega_h"] = min(max(desired, 0.05), _LARGEST)


def frame(pen, state, controls):
    """Draw the spring, its states, the eigenvalues of a step, the step's scale, and numbers."""
    z, past, m = state["z"], state["past"][:, : state["samples"]], state["matrix"]
    # Eigenvalues of the step's matrix from trace and discriminant; adding 0j makes the root complex
    # where they are a conjugate pair.
    a, b, c, d = m[0, 0], m[0, 1], m[1, 0], m[1, 1]
    values = 0.5 * (a + d) + np.array([0.5, -0.5]) * np.sqrt((a - d) ** 2 + 4.0 * b * c + 0j)
    modulus, det = np.max(np.abs(values)), a * d - b * c
    # Unstable if an eigenvalue lies outside the unit circle; the margin is for rounding.
    ink = draw.RED if modulus > 1.0 + 1e-7 else draw.GREEN
    # The spring between the wall and the mass, as a zigzag of 25 points.
    draw.area(pen, _ROPE, (-3.0, 3.0, -1.0, 1.0))
    coil, side = np.arange(25) / 24.0, 1.0 * (np.arange(25) % 2) - 0.5
    draw.curve(pen, -3.0 + (z[0, 0] + 2.8) * coil, side, draw.GREY, 2.0)
    draw.box(pen, z[0, 0] - 0.2, z[0, 0] + 0.2, -0.7, 0.7, draw.BLUE)
    draw.chart(pen, _STATES, (-3.0, 3.0, -2.4, 2.4), _X, _V, _PHASE, 6, 4)
    draw.curve(pen, past[1, -60:], past[2, -60:], draw.BLUE, 1.0, 0.5)
    # Area of the transported patch, with the shoelace formula: without damping the exact flow
    # preserves it (Liouville's theorem).
    patch = 0.5 * abs(np.sum(z[0, 1:] * np.roll(z[1, 1:], -1) - z[1, 1:] * np.roll(z[0, 1:], -1)))
    draw.polygon(pen, _PALE, ink, 1.8, 0.9)
    draw.points(pen, z[0, 1:], z[1, 1:])
    draw.spots(pen, past[1, -60:], past[2, -60:], 0.07, draw.BLUE)
    # The eigenvalues in the complex plane, with the unit circle as the border of stability.
    draw.chart(pen, _UNIT, (-1.6, 1.6, -1.6, 1.6), 0, 0, _CIRCLE, 3, 3)
    draw.curve(pen, _COSINE, _SINE, draw.INK, 1.5)
    draw.spots(pen, values.real, values.imag, 0.1, ink)
    # The limit of ω h for this method, tabulated over the damping ratio in steps of 1 / 20.
    edge = _LIMITS[controls["method"], round(20.0 * controls["zeta"])]
    draw.gauge(pen, _SCALE, _LARGEST, controls["omega_h"], ink, _H, edge, _LIMIT)
    start = max(past[0, -1] - 8.0, 0.0)
    draw.chart(pen, _TIME, (start, start + 8.0, -3.0, 3.0), _T, _X, 0, 4, 3)
    draw.curve(pen, past[0], past[1], draw.BLUE, 1.8)
    draw.reading(pen, _STEPS, state["steps"], 0)
    draw.reading(pen, _MODULUS, modulus, 4)
    draw.reading(pen, _DET, det, 4)
    draw.reading(pen, _AREA, patch / _PATCH, 4)
    # Each step multiplies areas by the determinant.
    draw.reading(pen, _THEORY, det ** state["steps"], 4)


PRESETS = {
    "A step well below the limit": Preset(
        {},
        "Drag the bar ω h. Semi-implicit Euler: both eigenvalues stay on the unit circle, the "
        "patch is sheared and turned, and its area stays what it was.",
    ),
    "At the limit, ω h = 2": Preset(
        {"omega_h": 2.0},
        "Both eigenvalues meet at −1. The patch keeps its area and is drawn out: "
        "the motion grows by as much every step.",
    ),
    "Just beyond": Preset(
        {"omega_h": 2.01},
        "One eigenvalue leaves the circle, the other enters it, the area still "
        "stays: that does not make a step stable.",
    ),
    "Explicit Euler": Preset(
        {"method": 0, "omega_h": 0.2}, "Without damping, outside at every h: the patch grows."
    ),
    "RK4": Preset({"method": 5, "omega_h": 1.5}, "Inside the circle: the patch shrinks."),
}

PAPER = draw.Paper(TITLE, word, colour)

# What each number below the picture means.
READOUTS = {
    "steps": "Steps of the integrator so far.",
    "largest |eigenvalue|": (
        "Largest modulus of the eigenvalues of one step. Above 1 the motion grows."
    ),
    "determinant": "Determinant of one step: the factor by which it changes areas in phase space.",
    "area of the patch": "Area of the coloured patch of states, relative to its area at the start.",
    "determinant ^ steps": (
        "The area that theory predicts: the determinant to the power of the number of steps."
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
    drag,
    readouts=READOUTS,
    upright=False,
)
