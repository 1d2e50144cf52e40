"""From event to event on a clock of whole microseconds, and control and physics in between.

`drive` goes from event to event (a picture is taken, one arrives, a plan is ready) and hands the
time between two of them to `advance`, which holds control and physics. It gives the word back to
Python only where a plan is wanted or ready, as planning is chapter 5's. With the course's stages
all of it is compiled; with a library's stage the same source runs as plain Python, and what is
still ours between two events stays compiled.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numba
import numpy as np
from numba import types
from numba.extending import register_jitable

from course.compiled import MATRIX, VECTOR, compiled, function_argument, loop
from course.control.tracking import two_link_torque
from course.kinematics.two_link import accelerations, branches
from course.perception.track import follow
from course.planning.trajectory import state_at
from course.planning.worlds import CLEARANCE, arm_gap

FRAME = "base"  # in which all places are: x and y from the arm's first joint [m]
LEAST = 1e-6  # m; no picture is believed to be better

# --- between two events ---------------------------------------------------------------------------

# Settings as numbers, times in microseconds.
(
    STEP,
    PERIOD,
    KIND,
    KP,
    KD,
    LIMIT1,
    LIMIT2,
    SLEW,
    LAG,
    DELAY,
    PERFECT,
    SIGMA,
    BX,
    BY,
    TX,
    TY,
    VX,
    VY,
    FILTERED,
    CARRIED,
    AGELESS,
    DRIFT,
    SPEED,
    REPLAN,
    KEPT,
    END,
) = range(26)
# Whole numbers that change: steps done, frames taken and arrived, when a plan is ready, whether one
# is in force, under way, was ever asked for; interval of the motion, next command, what went wrong.
(
    NOW,
    TAKEN,
    ARRIVED,
    DUE,
    PLANNED,
    BUSY,
    ASKED,
    INTERVAL,
    COMMAND,
    WRONG,
    ORIGIN,
) = range(11)
# Numbers that change: the place aimed at, its rate and stamp, where the arm waits, the end of its
# path and the side of its elbow, the place that the path was made for; by how much the end has
# moved since, and whether that has to be worked out anew.
AIM, RATE, STAMP, WAIT, GOAL, SIDE, MADE, MOVED, FRESH = 0, 2, 4, 5, 7, 9, 10, 12, 14
# Columns of the log, a row a step: state, reference, command, torque, clearance.
Q, V, REFERENCE, SENT, TORQUE, GAP = 0, 2, 4, 6, 8, 10
# Columns of what was seen, a row a frame: place, covariance (xx, xy, yy), stamp; the estimate, its
# rate, its covariance, and what became of it: 1 used, -1 refused, 0 not there in time.
PLACE, SPREAD, WHEN, GUESS, GUESS_RATE, GUESS_SPREAD, USED = 0, 2, 5, 6, 8, 10, 13
FAR = 2**62
WRONGS = (
    "",
    "perceive: a place that is not finite",
    "perceive: a covariance that is not positive",
    "perceive: a stamp from the future",
    "perceive: another frame",
    "move: the arm diverged",
    "control: a torque that is not finite",
)
ENDED, WANTED, READY, FAILED = range(4)


@register_jitable
def law(n, model, log, k, desired):
    """Torques into row k.

    `pd_gravity` on a level table with kd on the joint's speed alone, or `computed_torque`.
    """
    q1, q2, v1, v2 = log[k, Q], log[k, Q + 1], log[k, V], log[k, V + 1]
    e1, e2 = n[KP] * (desired[0, 0] - q1), n[KP] * (desired[0, 1] - q2)
    if n[KIND] == 0.0:
        log[k, SENT], log[k, SENT + 1] = e1 - n[KD] * v1, e2 - n[KD] * v2
        return
    a1 = desired[2, 0] + e1 + n[KD] * (desired[1, 0] - v1)
    a2 = desired[2, 1] + e2 + n[KD] * (desired[1, 1] - v2)
    log[k, SENT], log[k, SENT + 1] = two_link_torque(model, 0, q1, q2, v1, v2, a1, a2)


@register_jitable
def step(log, k, h, body):
    """The state in row k one step of semi-implicit Euler on; the torques are in `body`."""
    q1, q2, v1, v2 = log[k, Q], log[k, Q + 1], log[k, V], log[k, V + 1]
    a1, a2 = accelerations(q1, q2, v1, v2, body, 0)
    v1, v2 = v1 + h * a1, v2 + h * a2
    log[k, V], log[k, V + 1], log[k, Q], log[k, Q + 1] = v1, v2, q1 + h * v1, q2 + h * v2


def _reference(t, ints, changing, n, table, links, desired):
    """Where the joints should be at a time [us], with rates and accelerations.

    On the path, moved by as much as the aim has moved since it was made, times the share of the
    path that is done.
    """
    if ints[PLANNED] == 0:
        for j in range(2):
            desired[0, j], desired[1, j], desired[2, j] = changing[WAIT + j], 0.0, 0.0
        return
    ints[INTERVAL], share = state_at(table, 1e-6 * (t - ints[ORIGIN]), ints[INTERVAL], desired)
    if changing[FRESH] > 0.0:
        since = 1e-6 * (t - changing[STAMP])
        x, y = (
            changing[AIM] + since * changing[RATE],
            changing[AIM + 1] + since * changing[RATE + 1],
        )
        left, right, bend, _ = branches(links[0, 0], links[1, 0], x, y)
        first, second = (left, bend) if changing[SIDE] == 0.0 else (right, -bend)
        # A whole turn is no move.
        turn = first - changing[GOAL]
        changing[MOVED] = turn - 2.0 * math.pi * round(turn / (2.0 * math.pi))
        changing[MOVED + 1] = second - changing[GOAL + 1]
        if changing[RATE] == 0.0 and changing[RATE + 1] == 0.0:
            changing[FRESH] = 0.0
    desired[0, 0] += share * changing[MOVED]
    desired[0, 1] += share * changing[MOVED + 1]


_INTS, _GRID = (types.Array(numba.int64, k, "C") for k in (1, 2))
_REFERENCE = numba.void(numba.int64, _INTS, VECTOR, VECTOR, MATRIX, MATRIX, MATRIX)
BETWEEN = numba.void(numba.int64, _INTS, VECTOR, VECTOR, *(MATRIX,) * 6)
LOOK = numba.void(numba.int64, VECTOR, _GRID, MATRIX, MATRIX, _INTS, MATRIX)
_DRIVE = numba.int64(
    types.FunctionType(LOOK),
    types.FunctionType(BETWEEN),
    _GRID,
    _INTS,
    MATRIX,
    VECTOR,
    _INTS,
    VECTOR,
    VECTOR,
    *(MATRIX,) * 8,
)

_reference_loop, _gap_loop = loop(_reference, _REFERENCE), loop(arm_gap, CLEARANCE)
law_loop = loop(law, numba.void(VECTOR, MATRIX, MATRIX, numba.int64, MATRIX))
step_loop = loop(step, numba.void(MATRIX, numba.int64, numba.float64, MATRIX))


@register_jitable
def advance(law, step, last, ints, changing, n, table, log, body, model, obstacles, links):
    """Control and physics up to step `last`; the state is in the log."""
    desired, q, h = np.zeros((3, 2)), np.zeros(2), round(n[STEP])
    period, delay = round(n[PERIOD]), math.ceil(n[DELAY] / n[STEP])
    for k in range(ints[NOW], last):
        t = k * h
        if t >= ints[COMMAND] and n[PERFECT] == 0.0:
            ints[COMMAND] += period
            _reference_loop(t, ints, changing, n, table, links, desired)
            law(n, model, log, k, desired)
            for i in range(2):
                u, largest = log[k, SENT + i], n[LIMIT1 + i]
                if not math.isfinite(u):
                    ints[WRONG] = 6
                    return
                log[k, REFERENCE + i] = desired[0, i]
                before = log[k - 1, SENT + i] if k > 0 else 0.0
                u = min(max(u, before - n[SLEW]), before + n[SLEW])
                log[k, SENT + i] = min(max(u, -largest), largest)
        for i in range(2):
            late = log[k - delay, SENT + i] if k >= delay else 0.0
            log[k, TORQUE + i] += n[LAG] * (late - log[k, TORQUE + i])
            body[11 + i, 0] = log[k, TORQUE + i]
        for i in range(GAP):
            log[k + 1, i] = log[k, i]
        if n[PERFECT] > 0.0:
            _reference_loop(t + h, ints, changing, n, table, links, desired)
            for i in range(2):
                log[k + 1, REFERENCE + i] = log[k + 1, Q + i] = desired[0, i]
                log[k + 1, V + i] = desired[1, i]
        else:
            step(log, k + 1, 1e-6 * h, body)
        q[0], q[1] = log[k + 1, Q], log[k + 1, Q + 1]
        log[k + 1, GAP] = _gap_loop(obstacles, links, q) if obstacles.shape[0] > 0 else np.inf
        ints[NOW] = k + 1
        if not (abs(q[0]) < 1e3 and abs(q[1]) < 1e3):
            ints[WRONG] = 5
            return


def between(last, ints, changing, n, table, log, body, model, obstacles, links):
    advance(law, step, last, ints, changing, n, table, log, body, model, obstacles, links)


# --- from event to event --------------------------------------------------------------------------


def observe(k, n, times, noise, log, ints, observed):
    """`perceive`, for compiled loops: frame k into its row of what was seen."""
    since = 1e-6 * times[k, 0]
    sigma = n[SIGMA] * noise[k, 2]
    for i in range(2):
        true = n[TX + i] + since * n[VX + i] + noise[k, i]
        observed[k, PLACE + i] = true + n[BX + i] + sigma * noise[k, 3 + i]
    observed[k, SPREAD] = observed[k, SPREAD + 2] = max(sigma, LEAST) ** 2
    observed[k, SPREAD + 1], observed[k, WHEN] = 0.0, times[k, 2]


def drive(
    perceive,
    advance,
    times,
    order,
    noise,
    n,
    ints,
    changing,
    x,
    P,
    observed,
    table,
    log,
    body,
    model,
    obstacles,
    links,
):
    """Return on to the end, to where a plan is wanted or ready, or to what went wrong."""
    h, end, count = round(n[STEP]), round(n[END]), times.shape[0]
    while True:
        taken = times[ints[TAKEN], 0] if ints[TAKEN] < count else FAR
        arrives = times[order[ints[ARRIVED]], 1] if ints[ARRIVED] < count else FAR
        t = min(min(taken, arrives), min(ints[DUE], end))
        # The last step that begins before the event knows nothing of it.
        last = (t + h - 1) // h
        if last > ints[NOW]:
            advance(last, ints, changing, n, table, log, body, model, obstacles, links)
        if ints[WRONG] > 0:
            return FAILED
        if t >= end:
            return ENDED
        if ints[DUE] == t:
            return READY
        if taken == t:
            perceive(ints[TAKEN], n, times, noise, log, ints, observed)
            ints[TAKEN] += 1
            if ints[WRONG] > 0:
                return FAILED
            continue
        k = order[ints[ARRIVED]]
        ints[ARRIVED] += 1
        row = observed[k]
        if not (math.isfinite(row[PLACE]) and math.isfinite(row[PLACE + 1])):
            ints[WRONG] = 1
        elif not (row[SPREAD] > 0.0 and row[SPREAD] * row[SPREAD + 2] > row[SPREAD + 1] ** 2):
            ints[WRONG] = 2
        elif not row[WHEN] <= t:
            ints[WRONG] = 3
        if ints[WRONG] > 0:
            return FAILED
        R = np.array([[row[SPREAD], row[SPREAD + 1]], [row[SPREAD + 1], row[SPREAD + 2]]])
        if math.isinf(row[SPREAD]) or row[WHEN] < changing[STAMP]:
            row[USED] = -1.0  # nothing was seen, or it is older than what is known
            continue
        if n[FILTERED] == 0.0 or changing[STAMP] < 0.0:
            x[:2], x[2:] = row[PLACE:SPREAD], 0.0
            P[:2, :2], P[2:, 2:] = R, n[SPEED] ** 2 * np.eye(2)
            P[:2, 2:] = P[2:, :2] = 0.0
        else:
            dt = 1e-6 * (row[WHEN] - changing[STAMP])
            follow(x, P, dt, row[PLACE:SPREAD], R, n[DRIFT])
        row[USED], row[GUESS:GUESS_SPREAD] = 1.0, x
        row[GUESS_SPREAD], row[GUESS_SPREAD + 1], row[GUESS_SPREAD + 2] = P[0, 0], P[0, 1], P[1, 1]
        changing[AIM : AIM + 2], changing[STAMP], changing[FRESH] = x[:2], row[WHEN], 1.0
        if n[AGELESS] > 0.0:
            changing[RATE], changing[RATE + 1] = n[VX], n[VY]
        elif n[CARRIED] > 0.0:
            changing[RATE : RATE + 2] = x[2:]
        away = math.hypot(x[0] - changing[MADE], x[1] - changing[MADE + 1])
        if ints[BUSY] == 0 and (ints[ASKED] == 0 or away > n[REPLAN]):
            ints[BUSY] = ints[ASKED] = 1
            changing[MADE : MADE + 2] = x[:2]
            if n[KEPT] == 0.0:
                changing[WAIT : WAIT + 2] = log[ints[NOW], REFERENCE : REFERENCE + 2]
                ints[PLANNED] = 0
            return WANTED


@functools.cache
def kernels() -> tuple[Any, Any, Any]:
    """Return the driver, and our stages in the form in which it takes them."""
    ours = compiled(observe, LOOK), compiled(between, BETWEEN)
    return compiled(drive, _DRIVE), function_argument(ours[0]), function_argument(ours[1])
