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

# The settings of a run as compiled loops read them, times in microseconds.
SETTINGS = np.dtype(
    [
        ("step", "f8"),  # of the physics
        ("period", "f8"),  # of the control loop
        ("law", "f8"),  # its number in `stages.LAWS`
        ("kp", "f8"),
        ("kd", "f8"),
        ("limits", "f8", 2),  # largest torques [N m]
        ("slew", "f8"),  # by how much a torque may change from command to command [N m]
        ("lag", "f8"),  # share of its way to the command that a torque goes in a step
        ("delay", "f8"),  # of the actuator
        ("perfect", "f8"),  # 1 where the arm is on its reference
        ("sigma", "f8"),  # standard deviation of a measured position [m]
        ("bias", "f8", 2),  # of a measured position [m]
        ("target", "f8", 2),  # position at time 0 [m]
        ("velocity", "f8", 2),  # of the target [m/s]
        ("filtered", "f8"),  # 1 where pictures are filtered
        ("carried", "f8"),  # 1 where the estimate is carried on by its rate
        ("ageless", "f8"),  # 1 where the target's true velocity is known
        ("drift", "f8"),  # of the filter's model
        ("speed", "f8"),  # standard deviation of the target's speed before it is seen [m/s]
        ("replan", "f8"),  # distance of the estimate from the plan's goal that asks for another [m]
        ("hysteresis", "f8"),  # 1 where the arm follows the old plan until the new one is there
        ("end", "f8"),
    ]
)
# What has been done and what comes next, in whole numbers; times in microseconds.
PROGRESS = np.dtype(
    [
        (name, "i8")
        for name in (
            "now",  # steps done
            "taken",  # frames taken
            "arrived",  # frames arrived
            "due",  # when the plan is ready
            "planned",  # 1 where a plan is in force
            "busy",  # 1 while one is made
            "requested",  # 1 once one was asked for
            "interval",  # of the motion, where `state_at` looks first
            "command",  # when the next command is computed
            "wrong",  # what went wrong, an entry of `WRONGS`
            "origin",  # when the plan in force began
        )
    ]
)
# Where the arm is to go.
AIM = np.dtype(
    [
        ("place", "f8", 2),  # estimate of the target [m]
        ("rate", "f8", 2),  # and its velocity [m/s]
        ("stamp", "f8"),  # when it was measured [us]
        ("wait", "f8", 2),  # angles at which the arm waits for a plan [rad]
        ("goal", "f8", 2),  # angles at the end of the plan [rad]
        ("side", "f8"),  # of the elbow there
        ("made", "f8", 2),  # the estimate that the plan was made for [m]
        ("moved", "f8", 2),  # by how much the end has moved since [rad]
        ("fresh", "f8"),  # 1 where that has to be worked out again
    ]
)
# Columns of the log, a row a step: state, reference, command, torque, clearance.
Q, V, REFERENCE, SENT, TORQUE, GAP = 0, 2, 4, 6, 8, 10
# Columns of what was seen, a row a frame: place, covariance (xx, xy, yy), stamp; the estimate, its
# rate, its covariance, and what became of it: 1 used, -1 refused, 0 not there in time.
PLACE, SPREAD, WHEN, GUESS, GUESS_SPREAD, USED = 0, 2, 5, 6, 10, 13
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
def law(settings, model, log, k, desired):
    """Torques into row k.

    `pd_gravity` on a level table with kd on the joint's speed alone, or `computed_torque`.
    """
    q1, q2, v1, v2 = log[k, Q], log[k, Q + 1], log[k, V], log[k, V + 1]
    e1, e2 = settings["kp"] * (desired[0, 0] - q1), settings["kp"] * (desired[0, 1] - q2)
    # PD on the joints, or computed torque with the model's inverse dynamics.
    if settings["law"] == 0.0:
        log[k, SENT], log[k, SENT + 1] = e1 - settings["kd"] * v1, e2 - settings["kd"] * v2
        return
    a1 = desired[2, 0] + e1 + settings["kd"] * (desired[1, 0] - v1)
    a2 = desired[2, 1] + e2 + settings["kd"] * (desired[1, 1] - v2)
    log[k, SENT], log[k, SENT + 1] = two_link_torque(model, 0, q1, q2, v1, v2, a1, a2)


@register_jitable
def step(log, k, h, body):
    """Advance the state in row k by semi-implicit Euler; the torques are in `body`."""
    # Semi-implicit Euler: velocities first, positions with the new ones.
    q1, q2, v1, v2 = log[k, Q], log[k, Q + 1], log[k, V], log[k, V + 1]
    a1, a2 = accelerations(q1, q2, v1, v2, body, 0)
    v1, v2 = v1 + h * a1, v2 + h * a2
    log[k, V], log[k, V + 1], log[k, Q], log[k, Q + 1] = v1, v2, q1 + h * v1, q2 + h * v2


def _reference(t, progress, aim, table, links, desired):
    """Where the joints should be at a time [us], with rates and accelerations.

    On the path, moved by as much as the aim has moved since it was made, times the share of the
    path that is done.
    """
    # Without a plan in force the arm waits.
    if progress["planned"] == 0:
        for j in range(2):
            desired[0, j], desired[1, j], desired[2, j] = aim["wait"][j], 0.0, 0.0
        return
    progress["interval"], share = state_at(
        table, 1e-6 * (t - progress["origin"]), progress["interval"], desired
    )
    # The target has moved since the plan was made: shift its end to the current inverse kinematics,
    # in proportion to the share of the path that has been driven.
    if aim["fresh"] > 0.0:
        # Carry the target on from the stamp of its estimate to this instant.
        since = 1e-6 * (t - aim["stamp"])
        x, y = (
            aim["place"][0] + since * aim["rate"][0],
            aim["place"][1] + since * aim["rate"][1],
        )
        left, right, bend, _ = branches(links[0, 0], links[1, 0], x, y)
        # The elbow stays on the side on which the plan ends.
        first, second = (left, bend) if aim["side"] == 0.0 else (right, -bend)
        # A whole turn is no move.
        turn = first - aim["goal"][0]
        aim["moved"][0] = turn - 2.0 * math.pi * round(turn / (2.0 * math.pi))
        aim["moved"][1] = second - aim["goal"][1]
        # A target at rest needs this inverse kinematics only once for each estimate.
        if aim["rate"][0] == 0.0 and aim["rate"][1] == 0.0:
            aim["fresh"] = 0.0
    desired[0, 0] += share * aim["moved"][0]
    desired[0, 1] += share * aim["moved"][1]


_INTS, _GRID = (types.Array(numba.int64, k, "C") for k in (1, 2))
_SETTINGS, _PROGRESS, _AIM = (numba.from_dtype(record) for record in (SETTINGS, PROGRESS, AIM))
_REFERENCE = numba.void(numba.int64, _PROGRESS, _AIM, MATRIX, MATRIX, MATRIX)
BETWEEN = numba.void(numba.int64, _PROGRESS, _AIM, _SETTINGS, *(MATRIX,) * 6)
LOOK = numba.void(numba.int64, _SETTINGS, _GRID, MATRIX, MATRIX, _PROGRESS, MATRIX)
_DRIVE = numba.int64(
    types.FunctionType(LOOK),
    types.FunctionType(BETWEEN),
    _GRID,
    _INTS,
    MATRIX,
    _SETTINGS,
    _PROGRESS,
    _AIM,
    VECTOR,
    *(MATRIX,) * 8,
)

_reference_loop, _gap_loop = loop(_reference, _REFERENCE), loop(arm_gap, CLEARANCE)
law_loop = loop(law, numba.void(_SETTINGS, MATRIX, MATRIX, numba.int64, MATRIX))
step_loop = loop(step, numba.void(MATRIX, numba.int64, numba.float64, MATRIX))


@register_jitable
def advance(law, step, last, progress, aim, settings, table, log, body, model, obstacles, links):
    """Control and physics up to step `last`; the state is in the log."""
    desired, q, h = np.zeros((3, 2)), np.zeros(2), round(settings["step"])
    # The actuator's delay is rounded up to whole steps.
    period, delay = round(settings["period"]), math.ceil(settings["delay"] / settings["step"])
    for k in range(progress["now"], last):
        t = k * h
        # Control: compute the next command and apply slew limit and saturation.
        if t >= progress["command"] and settings["perfect"] == 0.0:
            progress["command"] += period
            _reference_loop(t, progress, aim, table, links, desired)
            law(settings, model, log, k, desired)
            for i in range(2):
                u, largest = log[k, SENT + i], settings["limits"][i]
                if not math.isfinite(u):
                    progress["wrong"] = 6
                    return
                log[k, REFERENCE + i] = desired[0, i]
                # The last command stands in the row before, as the law has overwritten this one.
                before = log[k - 1, SENT + i] if k > 0 else 0.0
                u = min(max(u, before - settings["slew"]), before + settings["slew"])
                log[k, SENT + i] = min(max(u, -largest), largest)
        # Actuator: transport delay, then a first-order lag, exact for a constant command over the
        # step.
        for i in range(2):
            late = log[k - delay, SENT + i] if k >= delay else 0.0
            log[k, TORQUE + i] += settings["lag"] * (late - log[k, TORQUE + i])
            body[11 + i, 0] = log[k, TORQUE + i]
        # Physics: the row of the log is the state, so a step starts as a copy.
        for i in range(GAP):
            log[k + 1, i] = log[k, i]
        # Ideal control: the arm is exactly on its reference.
        if settings["perfect"] > 0.0:
            _reference_loop(t + h, progress, aim, table, links, desired)
            for i in range(2):
                log[k + 1, REFERENCE + i] = log[k + 1, Q + i] = desired[0, i]
                log[k + 1, V + i] = desired[1, i]
        else:
            step(log, k + 1, 1e-6 * h, body)
        q[0], q[1] = log[k + 1, Q], log[k + 1, Q + 1]
        log[k + 1, GAP] = _gap_loop(obstacles, links, q) if obstacles.shape[0] > 0 else np.inf
        progress["now"] = k + 1
        # Divergence ends the run before infinities spread.
        if not (abs(q[0]) < 1e3 and abs(q[1]) < 1e3):
            progress["wrong"] = 5
            return


def between(last, progress, aim, settings, table, log, body, model, obstacles, links):
    """Advance the physics with this module's control law and integrator up to step `last`."""
    advance(law, step, last, progress, aim, settings, table, log, body, model, obstacles, links)


# --- from event to event --------------------------------------------------------------------------


def observe(k, settings, times, noise, log, progress, observed):
    """`perceive`, for compiled loops: frame k into its row of what was seen."""
    # Columns of `noise`: the shift (2) and the scale that disturb a frame, and its normal numbers
    # (2).
    since = 1e-6 * times[k, 0]
    sigma = settings["sigma"] * noise[k, 2]
    for i in range(2):
        true = settings["target"][i] + since * settings["velocity"][i] + noise[k, i]
        observed[k, PLACE + i] = true + settings["bias"][i] + sigma * noise[k, 3 + i]
    # A floor: a variance of 0 would count as invalid below.
    observed[k, SPREAD] = observed[k, SPREAD + 2] = max(sigma, LEAST) ** 2
    observed[k, SPREAD + 1], observed[k, WHEN] = 0.0, times[k, 2]


def drive(
    perceive,
    advance,
    times,
    order,
    noise,
    settings,
    progress,
    aim,
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
    """Advance until the end of the run, a request for a plan, a plan that is ready, or a fault."""
    h, end, count = round(settings["step"]), round(settings["end"]), times.shape[0]
    while True:
        # The next event: an image is taken, one arrives, a plan is ready, or the end.
        taken = times[progress["taken"], 0] if progress["taken"] < count else FAR
        arrives = times[order[progress["arrived"]], 1] if progress["arrived"] < count else FAR
        t = min(min(taken, arrives), min(progress["due"], end))
        # The last step that begins before the event knows nothing of it.
        last = (t + h - 1) // h
        if last > progress["now"]:
            advance(last, progress, aim, settings, table, log, body, model, obstacles, links)
        if progress["wrong"] > 0:
            return FAILED
        if t >= end:
            return ENDED
        if progress["due"] == t:
            return READY
        if taken == t:
            perceive(progress["taken"], settings, times, noise, log, progress, observed)
            progress["taken"] += 1
            if progress["wrong"] > 0:
                return FAILED
            continue
        # An image has arrived: validate it, filter it, and decide whether to replan.
        k = order[progress["arrived"]]
        progress["arrived"] += 1
        row = observed[k]
        # Contracts: finite position, positive definite covariance, no stamp from the future.
        if not (math.isfinite(row[PLACE]) and math.isfinite(row[PLACE + 1])):
            progress["wrong"] = 1
        elif not (row[SPREAD] > 0.0 and row[SPREAD] * row[SPREAD + 2] > row[SPREAD + 1] ** 2):
            progress["wrong"] = 2
        elif not row[WHEN] <= t:
            progress["wrong"] = 3
        if progress["wrong"] > 0:
            return FAILED
        # Out-of-sequence images, and those without a detection, are ignored.
        R = np.array([[row[SPREAD], row[SPREAD + 1]], [row[SPREAD + 1], row[SPREAD + 2]]])
        if math.isinf(row[SPREAD]) or row[WHEN] < aim["stamp"]:
            row[USED] = -1.0  # nothing was seen, or it is older than what is known
            continue
        # First image, or no filter: start the track from it.
        if settings["filtered"] == 0.0 or aim["stamp"] < 0.0:
            x[:2], x[2:] = row[PLACE:SPREAD], 0.0
            # The speed is unknown: 0 with its prior deviation, and uncorrelated with the position.
            P[:2, :2], P[2:, 2:] = R, settings["speed"] ** 2 * np.eye(2)
            P[:2, 2:] = P[2:, :2] = 0.0
        else:
            # Kalman filter: predict to the stamp of the image, then update.
            dt = 1e-6 * (row[WHEN] - aim["stamp"])
            follow(x, P, dt, row[PLACE:SPREAD], R, settings["drift"])
        row[USED], row[GUESS:GUESS_SPREAD] = 1.0, x
        row[GUESS_SPREAD], row[GUESS_SPREAD + 1], row[GUESS_SPREAD + 2] = P[0, 0], P[0, 1], P[1, 1]
        aim["place"][:], aim["stamp"], aim["fresh"] = x[:2], row[WHEN], 1.0
        # Ideal age uses the target's true velocity; otherwise the filter's rate, if it is to be
        # carried.
        if settings["ageless"] > 0.0:
            aim["rate"][0], aim["rate"][1] = settings["velocity"][0], settings["velocity"][1]
        elif settings["carried"] > 0.0:
            aim["rate"][:] = x[2:]
        # Replan when the target has moved farther than `replan` from where the plan was made.
        away = math.hypot(x[0] - aim["made"][0], x[1] - aim["made"][1])
        if progress["busy"] == 0 and (progress["requested"] == 0 or away > settings["replan"]):
            progress["busy"] = progress["requested"] = 1
            aim["made"][:] = x[:2]
            # Without hysteresis the arm stops where it is until the new plan is ready.
            if settings["hysteresis"] == 0.0:
                aim["wait"][:] = log[progress["now"], REFERENCE : REFERENCE + 2]
                progress["planned"] = 0
            return WANTED


@functools.cache
def kernels() -> tuple[Any, Any, Any]:
    """Return the driver, and our stages in the form in which it takes them."""
    ours = compiled(observe, LOOK), compiled(between, BETWEEN)
    return compiled(drive, _DRIVE), function_argument(ours[0]), function_argument(ours[1])
