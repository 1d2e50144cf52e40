"""An event inside a step: its time is found, the state is changed there, and the step goes on.

A step of order p is of that order while the motion is smooth. A bounce is not: if it is applied
at the end of the step in which it happened, it is late by up to dt, and whatever the integrator,
the result is of first order. Here the step is cut at the event: the same integrator takes a partial
step, its length is found by root finding, the state is reset, and the rest of the step follows.
The event's time is then as accurate as the integrator, and the order stays (Hairer, Norsett,
Wanner, Solving Ordinary Differential Equations I, 1993, sec. II.6).

A *gap* is a function q -> number that is negative where the state is not allowed; a *reset* is a
function (q, v) -> (q, v) that is applied where the gap closes and must turn the motion away.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numba.extending import register_jitable

from course.check import count, invalid, one_of, positive
from course.rigid_body.integrators import (
    INTEGRATORS,
    STANDARD_GRAVITY,
    Array,
    Step,
    System,
    Trajectory,
)
from course.rigid_body.problems import Problem, pendulum

Gap = Callable[[Any], Any]
Reset = Callable[[Any, Any], tuple[Any, Any]]

# Events of one step after which it gives up: the bounces pile up, or the reset does not turn back.
EVENT_LIMIT = 64
_WIDTH = 4.0 * np.finfo(np.float64).eps


@register_jitable
def time_of_event(q, v, step, acceleration, dt, params, gap):
    """Return the length of the partial step at whose end the gap closes.

    The Illinois form of regula falsi (Dowell and Jarratt 1971) on the length of a partial step,
    with a bisection every third time, so that the bracket is sure to shrink to rounding.

    Args:
        q: positions with gap(q) >= 0, shape (nq,).
        v: velocities, shape (nv,).
        step: an integrator's step; gap must be negative after step(q, v, ..., dt, ...).
        acceleration: function (q, v, params) -> rates of v.
        dt: step [s].
        params: handed on to `acceleration`.
        gap: function q -> number.

    Returns:
        The length [s] from 0 to dt: the side of the last bracket on which the gap is not negative.
    """
    # The bracket: the gap is open at `low` and closed at `high`.
    low, high = 0.0, dt
    gap_low = gap(q)
    end, _ = step(q, v, acceleration, dt, params)
    gap_high = gap(end)
    retained = 0  # the side that the last trial kept: -1 low, 1 high
    for trial in range(200):
        if high - low <= _WIDTH * dt:
            break
        middle = 0.5 * (low + high)
        # Two steps of regula falsi, then a bisection: fast, and sure to end.
        if trial % 3 < 2:
            secant = (low * gap_high - high * gap_low) / (gap_high - gap_low)
            # A root on the bracket's very end would leave the other end where it is.
            middle = min(max(secant, low + 0.5 * _WIDTH * dt), high - 0.5 * _WIDTH * dt)
        end, _ = step(q, v, acceleration, middle, params)
        value = gap(end)
        if value >= 0.0:
            low, gap_low = middle, value
            # The same side twice: the other end's value is halved, or it would stay for ever.
            if retained == 1:
                gap_high = 0.5 * gap_high
            retained = 1
        else:
            high, gap_high = middle, value
            if retained == -1:
                gap_low = 0.5 * gap_low
            retained = -1
    return low


@register_jitable
def step_with_event(q, v, step, acceleration, dt, params, gap, reset):
    """Take one step of any integrator, cut where the gap closes and continued after the reset.

    An event that begins and ends within one step, so that the gap is open at both ends, is not
    seen. A state that starts with a negative gap is stepped as it is.

    Args:
        q: positions, shape (nq,).
        v: velocities, shape (nv,).
        step: (q, v, acceleration, dt, params) -> (q, v).
        acceleration: function (q, v, params) -> rates of v.
        dt: step [s].
        params: handed on to `acceleration`.
        gap: function q -> number; an event is where it turns negative.
        reset: function (q, v) -> (q, v), applied there; it must turn the motion away.

    Returns:
        (q, v, hits): the new state and how many events there were; the inputs are unchanged.

    Raises:
        RuntimeError: after 64 events in one step.
    """
    remaining = dt
    hits = 0
    while True:
        q1, v1 = step(q, v, acceleration, remaining, params)
        # No event in what is left, or below the ground from the start: nothing to find.
        if not (gap(q1) < 0.0 and gap(q) >= 0.0):
            return q1, v1, hits
        if hits == EVENT_LIMIT:
            raise RuntimeError("64 events in one step: the reset does not turn the motion away")
        # Cut the step at the event, reset the state there, and continue with what is left of the
        # step.
        part = time_of_event(q, v, step, acceleration, remaining, params, gap)
        if part > 0.0:
            q, v = step(q, v, acceleration, part, params)
        q, v = reset(q, v)
        remaining -= part
        hits += 1


@register_jitable
def step_with_late_event(q, v, step, acceleration, dt, params, gap, reset):
    """Take the usual shortcut at an impact, which the exact event is compared with.

    A whole step, then the reset if the gap is closed.

    Of first order whatever the integrator, because the reset comes up to dt too late.

    Args, Returns: as for `step_with_event`; at most one event a step.
    """
    q, v = step(q, v, acceleration, dt, params)
    if gap(q) < 0.0:
        q, v = reset(q, v)
        return q, v, 1
    return q, v, 0


def simulate_with_events(
    system: System,
    integrator: str | Step,
    dt: float,
    steps: int,
    gap: Gap,
    reset: Reset,
    handled: bool = True,
) -> tuple[Trajectory, int]:
    """Take `steps` steps from the system's initial state, in plain Python.

    Args:
        system: what to integrate.
        integrator: a name in INTEGRATORS, or a step function.
        dt: step [s], positive.
        steps: number of steps, at least 1.
        gap: see `step_with_event`.
        reset: see `step_with_event`.
        handled: find the events inside the step; False: `step_with_late_event`.

    Returns:
        (trajectory, hits): every state, and the number of events.

    Raises:
        ValueError: for an unknown integrator, or dt or steps out of range.
    """
    if isinstance(integrator, str):
        one_of("integrator", integrator, INTEGRATORS)
    positive("dt", dt, unit="s")
    count("steps", steps, 1)
    step = INTEGRATORS[integrator].step if isinstance(integrator, str) else integrator
    advance = step_with_event if handled else step_with_late_event
    q, v = system.q0, system.v0
    qs, vs = np.empty((steps + 1, *q.shape)), np.empty((steps + 1, *v.shape))
    qs[0], vs[0] = q, v
    total = 0
    for i in range(steps):
        q, v, hits = advance(q, v, step, system.acceleration, dt, system.params, gap, reset)
        qs[i + 1], vs[i + 1] = q, v
        total += hits
    return Trajectory(np.arange(steps + 1, dtype=np.float64) * dt, qs, vs), total


# --- a pendulum between itself and a wall --------------------------------------------------------


@register_jitable
def wall_gap(q):
    """Return angle [rad] left to a wall where the pendulum hangs straight down."""
    return q[0]


@register_jitable
def elastic_wall(q, v):
    """Return elastic impact on that wall: the speed is kept, away from the wall."""
    return q, np.abs(v)


def bouncing_pendulum(
    amplitude: float = 2.0,
    length: float = 1.0,
    gravity: float = STANDARD_GRAVITY,
    duration: float = 2.5,
) -> Problem:
    """Return a pendulum that hits an elastic wall where it hangs straight down.

    By symmetry its angle is the absolute value of the free pendulum's, which has a closed form
    (`problems.pendulum`). Events are where `wall_gap` closes, the reset is `elastic_wall`.

    Args:
        amplitude: initial angle from hanging [rad], between 0 and pi.
        length: [m].
        gravity: [m/s^2].
        duration: length of the run [s]; the default ends well between two impacts.

    Raises:
        ValueError: amplitude out of its range.
    """
    if not 0.0 < amplitude < np.pi:
        raise invalid("amplitude", amplitude, "a number between 0 and pi [rad]")
    free = pendulum(amplitude, length, gravity, duration)

    def truth(t: float) -> tuple[Array, Array]:
        q, v = free.truth(t)
        # The wall mirrors the free pendulum: where its angle is negative, angle and rate change
        # sign.
        return np.abs(q), v if q[0] >= 0.0 else -v

    return Problem(free.system, duration, truth, True, "rad")
