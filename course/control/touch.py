"""A mass that touches a wall: the smallest model of contact, for every law at once.

mass x'' = u - damping x' - (wall (x - surface) + wall_damping x' where x > surface). It is solved
exactly between samples, and the instant of touching is found; what it leaves out, against a
contact of MuJoCo, is measured in the chart `contact_regimes`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numba.extending import register_jitable
from numpy.typing import ArrayLike, NDArray

from course.check import count, finite, positive, vector
from course.compiled import MATRIX, VECTOR, loop
from course.control.joint import Record
from course.control.sampled import _EXACT, Law, System, _pid, joint_system, split_delay

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Probe:
    """An arm seen along one axis, and the wall.

    Attributes:
        mass, damping: of the arm, as the wall feels it [kg, N s/m].
        wall, wall_damping: of the surface [N/m, N s/m].
        surface: where it is [m].
    """

    mass: float = 4.0
    damping: float = 20.0
    wall: float = 1e4
    wall_damping: float = 0.0
    surface: float = 0.0

    def __post_init__(self) -> None:
        positive("mass", self.mass, unit="kg")
        for name in ("damping", "wall", "wall_damping"):
            finite(name, getattr(self, name), 0.0)
        finite("surface", self.surface, unit="m")

    def system(self) -> System:
        """Return A and B while it touches, the surface at 0."""
        return joint_system(self.mass, self.damping + self.wall_damping, self.wall)


@dataclass(frozen=True)
class TouchLaw:
    """u = stiffness (x0 - x) + damping (v0 - v) + force + force_gain (force - measured).

    With a virtual mass the measured force moves x0 as it would move that mass (admittance).

    Attributes:
        stiffness, damping: [N/m, N s/m].
        force: desired force on the wall [N].
        force_gain: of the measured force's error.
        mass, give, hold: of the virtual body, inertia, damping and stiffness about the set-point
            [kg, N s/m, N/m]; no body with mass 0.
    """

    stiffness: float = 0.0
    damping: float = 0.0
    force: float = 0.0
    force_gain: float = 0.0
    mass: float = 0.0
    give: float = 0.0
    hold: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            finite(name, value, -math.inf if name == "force" else 0.0)

    def numbers(self) -> Array:
        """Return the same as an array, shape (7,)."""
        return np.array(list(vars(self).values()), dtype=float)

    def linear(self, probe: Probe, dt: float) -> Law:
        """Return the same in contact, the surface at 0, as a law on (x, v)."""
        positive("dt", dt, unit="s")
        A, B, C, D = _linear(self.numbers(), probe.wall, probe.wall_damping, dt)
        return Law(A, B, C, D, dt)


@register_jitable
def _linear(law, wall, wall_damping, dt):
    """Return the matrices A, B, C and D of `Law` for the gains `TouchLaw.numbers`."""
    stiffness, damping, force_gain = law[0], law[1], law[3]
    mass, give, hold = law[4], law[5], law[6]
    if mass == 0.0:  # the force that is measured counts as stiffness and damping
        kp, kd = stiffness + force_gain * wall, damping + force_gain * wall_damping
        return _pid(kp, 0.0, kd, dt, _EXACT, 0.0)
    # The virtual body by semi-implicit Euler with implicit damping, the same step as in `_touch`.
    slow = 1.0 / (1.0 + dt * give / mass)
    place, speed = -slow * dt / mass * hold, slow
    A = np.array([[1.0 + dt * place, dt * speed], [place, speed]])
    push = -slow * dt / mass * np.array([wall, wall_damping])
    B = np.stack((dt * push, push))
    inner = np.array([stiffness, damping])
    return A, B, stiffness * A[0] + damping * A[1], stiffness * B[0] + damping * B[1] - inner


@register_jitable
def _swing(x, v, u, mass, damping, stiffness, t):
    """Return place and speed after t of a damped spring under a steady force, exactly."""
    a = 0.5 * damping / mass
    square = stiffness / mass - a * a
    # A free mass: constant acceleration.
    if stiffness == 0.0 and damping == 0.0:
        return x + v * t + 0.5 * u / mass * t * t, v + u / mass * t
    if stiffness == 0.0:
        # Drag alone: the speed decays to its terminal value.
        once = -math.expm1(-2.0 * a * t) / (2.0 * a)
        final = u / damping
        return x + final * t + (v - final) * once, final + (v - final) * (1.0 - 2.0 * a * once)
    # Underdamped, critically damped and overdamped: one formula, with cos, 1 or cosh.
    rest = u / stiffness
    w = math.sqrt(abs(square))
    decay = math.exp(-a * t)
    if square > 0.0:
        c, s = math.cos(w * t), math.sin(w * t) / w
    elif square < 0.0:
        c, s = math.cosh(w * t), math.sinh(w * t) / w
    else:
        c, s = 1.0, t
    d = x - rest
    place = rest + decay * (d * c + (v + a * d) * s)
    return place, decay * (v * c - (a * v + stiffness / mass * d) * s)


@register_jitable
def held_mass(mass, damping, stiffness, dt, rest):
    """Return the transition matrices of one mass on a spring, as `course.control.sampled.held`.

    It is for compiled code: a command comes `rest` late in the sample [s].
    """
    transition, late = np.empty((2, 2)), dt - rest
    # Columns of the transition: responses to a unit position and to a unit speed.
    for k in range(2):
        x, v = 1.0 * (k == 0), 1.0 * (k == 1)
        transition[:, k] = _swing(x, v, 0.0, mass, damping, stiffness, dt)
    # Response to a unit force: the older command acts for `rest` and its effect then swings on.
    x, v = _swing(0.0, 0.0, 1.0, mass, damping, stiffness, rest)
    before = np.array(_swing(x, v, 0.0, mass, damping, stiffness, late))
    return transition, np.array(_swing(0.0, 0.0, 1.0, mass, damping, stiffness, late)), before


@register_jitable
def _onwards(x, v, u, probe, t):
    """Return place and speed after t, with at most one touching and one leaving in a sample."""
    mass, damping, wall, wall_damping, surface = probe[0], probe[1], probe[2], probe[3], probe[4]
    # At a touch or a release the stiffness changes: the motion is cut there by bisection.
    for _ in range(4):
        touching = x > surface or (x == surface and v > 0.0)
        stiff = wall if touching else 0.0
        slow = damping + wall_damping if touching else damping
        after, speed = _swing(x - surface, v, u, mass, slow, stiff, t)
        # No event in this time: the mass is still on the same side of the surface.
        if (after > 0.0) == touching or after == 0.0:
            return after + surface, speed
        # Bisect for the crossing; `high` stays just beyond it.
        low, high = 0.0, t
        for _ in range(60):
            middle = 0.5 * (low + high)
            if (_swing(x - surface, v, u, mass, slow, stiff, middle)[0] > 0.0) == touching:
                low = middle
            else:
                high = middle
        v = _swing(x - surface, v, u, mass, slow, stiff, high)[1]
        # Exactly at the surface the sign of the speed decides between touch and release.
        x = surface
        t -= high
    return x, v


def _touch(probe, law, dt, whole, part, start, target, surfaces, out):
    """Run the loop; rows of `out` are x, v, force on the wall, command and the desired place."""
    stiffness, damping, desired, gain = law[0], law[1], law[2], law[3]
    mass, give, hold = law[4], law[5], law[6]
    body = probe.copy()
    x, v = start[0], start[1]
    moved, speed = 0.0, 0.0  # of the virtual body, from the set-point
    for k in range(target.size + 1):
        body[4] = surfaces[min(k, target.size - 1)]
        depth = x - body[4]
        # A wall cannot pull, so its damping must not make the measured force negative.
        force = max(0.0, body[2] * depth + body[3] * v) if depth > 0.0 else 0.0
        out[0, k], out[1, k], out[2, k] = x, v, force
        if k == target.size:
            break
        # Admittance: the virtual body moves the set-point, by semi-implicit Euler with implicit
        # damping.
        if mass > 0.0:
            speed = (speed + dt / mass * (desired - force - hold * moved)) / (
                1.0 + dt * give / mass
            )
            moved += dt * speed
        place = target[k] + moved
        command = stiffness * (place - x) + damping * (speed - v)
        if mass == 0.0:
            command += desired + gain * (desired - force)
        out[3, k], out[4, k] = command, place
        # The delay splits the sample: the older command acts first, then the newer one.
        for half in range(2):
            length = part if half == 0 else dt - part
            at = k - whole - 1 + half
            if length > 0.0:
                x, v = _onwards(x, v, out[3, at] if at >= 0 else 0.0, body, length)


_touch_loop = loop(
    _touch,
    numba.void(
        VECTOR, VECTOR, numba.float64, numba.int64, numba.float64, VECTOR, VECTOR, VECTOR, MATRIX
    ),
)


def run_touch(
    probe: Probe,
    law: TouchLaw,
    target: ArrayLike,
    dt: float,
    seconds: float,
    *,
    delay: float = 0.0,
    start: ArrayLike = (0.0, 0.0),
    surface: ArrayLike | None = None,
) -> Record:
    """Run the probe under its law, compiled.

    Args:
        probe: the pushed body, its wall and its sensor.
        law: the law that is run.
        target: set-point of the position, a number or one for each sample, shape (n,) [m].
        dt: sample time [s].
        seconds: length of the run [s]; n = seconds / dt.
        delay: of the command [s].
        start: (x, v) [m, m/s].
        surface: where the wall is, shape (n,) [m]; None for the probe's.

    Returns:
        A `Record`, whose `torque` is the force on the wall and whose `measured` the place wanted.
    """
    n = round(positive("seconds", seconds, unit="s") / positive("dt", dt, unit="s"))
    count("seconds / dt", n, 1)
    desired = np.full(n, 1.0) * vector("target", target, (), (n,), unit="m")
    walls = np.full(n, 1.0) * vector(
        "surface", probe.surface if surface is None else surface, (), (n,), unit="m"
    )
    body, x = np.array(list(vars(probe).values()), dtype=float), vector("start", start, (2,))
    whole, part = split_delay(delay, dt)
    out = np.zeros((5, n + 1))
    _touch_loop(body, law.numbers(), dt, whole, part, x, desired, walls, out)
    times = np.linspace(0.0, n * dt, n + 1)
    return Record(times, out[0], out[1], out[2], out[3, :n], out[4, :n], desired)
