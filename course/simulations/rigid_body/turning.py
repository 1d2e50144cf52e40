"""What the simulations of a body that turns freely share: its shape, its motion, its rates.

The motion is that of `course.rigid_body`: Euler's equations by RK4 on the rotation group.
"""

import math

import numpy as np
from numba.extending import register_jitable

from course.rigid_body.integrators import rk4
from course.rigid_body.problems import tumble_acceleration
from course.rigid_body.quaternion import cross, exp, rotate
from course.simulations import pen as draw
from course.simulations import space
from course.simulations.record import Field

STEP, SAMPLE, PAST = 0.005, 4, 300  # s, steps, samples

TURNING = {
    "q": Field(0.0, shape=(4,)),
    "omega": Field(0.0, shape=(3,), unit="rad/s"),  # in the body frame
    "steps": Field(0),
    "owed": Field(0.0, unit="s"),
    # Time, angular velocity in the body frame and in the world, and axis 3 there, of the samples.
    "past": Field(0.0, shape=(10, 2 * PAST)),
    "samples": Field(0),
}


@register_jitable
def remember(state, time):
    """Remember how the body turns now."""
    past = state["past"]
    state["samples"] = n = draw.remember(past, state["samples"], time)
    past[1:4, n - 1] = state["omega"]
    past[4:7, n - 1] = rotate(state["q"], state["omega"])
    past[7:10, n - 1] = rotate(state["q"], np.array([0.0, 0.0, 1.0]))


@register_jitable
def start(state, moments, omega):
    """Begin with a body rate, turned so that the angular momentum points up."""
    # Rotate L to the vertical about their common normal. atan2 is exact for small angles, where an
    # arc cosine would lose half the digits; the bound avoids 0 / 0 when L already points up.
    momentum = moments * omega
    axis = cross(momentum, np.array([0.0, 0.0, 1.0]))
    sine = math.sqrt(axis[0] ** 2 + axis[1] ** 2)
    state["q"][:] = exp(axis * (math.atan2(sine, momentum[2]) / max(sine, 1e-300)))
    state["omega"][:] = omega
    remember(state, 0.0)


@register_jitable
def whole_steps(state, seconds, step):
    """Return how many steps fit into the elapsed time; the remainder is carried over."""
    # The small addend counts a step whose end rounding puts just after the elapsed time.
    count = math.floor((state["owed"] + seconds) / step + 1e-9)
    state["owed"] = max(state["owed"] + seconds - count * step, 0.0)
    return count


@register_jitable
def march(state, law, params, step, sample, seconds):
    """Let the body turn by whole steps; each so-manieth is remembered."""
    for _ in range(whole_steps(state, seconds, step)):
        # Runge-Kutta of fourth order for the attitude and the body rates; both change in place.
        q, omega = rk4(state["q"], state["omega"], law, step, params)
        state["q"][:] = q
        state["omega"][:] = omega
        state["steps"] += 1
        if state["steps"] % sample == 0:
            remember(state, step * state["steps"])


@register_jitable
def turn(state, moments, seconds):
    """Let the body turn freely."""
    march(state, tumble_acceleration, moments, STEP, SAMPLE, seconds)


@register_jitable
def recent(state):
    """Time, rates and axis 3 of the last samples, a view (10, N)."""
    return state["past"][:, max(0, state["samples"] - PAST) : state["samples"]]


@register_jitable
def between(a, b):
    """Return the angle between two vectors [degrees]."""
    # The angle from sine and cosine is accurate for parallel vectors too, unlike an arc cosine.
    c = cross(a, b)
    return math.degrees(math.atan2(math.sqrt(np.sum(c * c)), np.sum(a * b)))


word, colour = draw.words_table(), draw.colours_table()
SKIN = space.shades(colour, "#c9d1d9", "#c9d1d9", "#e6dcc4", "#e6dcc4", "#8fb3d9", "#d9775b")
_CORNERS, _INDEX = space.box(1.0, 1.0, 1.0)
_FILLS = np.array(SKIN)
_RATES, _T, _RATE = word("ω in the body", "time [s]", "[rad/s]")
_NAMES = word("ω1", "ω2", "ω3")[0]
_INKS = (draw.BLUE, draw.ORANGE, draw.PURPLE)


@register_jitable
def body(pen, eye, q, sides):
    """Draw the box; the faces across its third axis are blue and red."""
    corners = rotate(q, _CORNERS * sides.reshape((3, 1)))
    space.faces(pen, eye, corners, _INDEX, _FILLS, draw.GREY)


@register_jitable
def rates(pen, state, rectangle, high):
    """Draw the three body rates over the last six seconds."""
    past = recent(state)
    draw.chart(pen, rectangle, (past[0, 0], past[0, 0] + 6.0, -high, high), _T, _RATE, _RATES, 4, 6)
    for k in range(3):
        draw.curve(pen, past[0], past[1 + k], _INKS[k], 2.0)
    draw.window(pen)
    for k in range(3):
        x, y = rectangle[0] + 0.8 * k + 0.3, rectangle[2] - 0.72
        draw.segment(pen, x, y, x + 0.25, y, _INKS[k], 2.5)
        draw.text(pen, x + 0.32, y, _NAMES + k)
