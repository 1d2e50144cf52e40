"""How an arm of the chapter moves: two links with dry friction, a late motor and a sampled law.

Between two samples the command switches once, where its delay ends, so any delay is exact. Steps
are Runge-Kutta's of fourth order. Dry friction is Coulomb's and holds as much: a step is cut where
a sliding joint stops, and a joint that is held rests to the last bit.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numba.extending import register_jitable

from course.compiled import MATRIX, VECTOR, loop
from course.control.pid import update

CUBE = numba.types.Array(numba.float64, 3, "C")


@register_jitable
def _accelerations(arm, i, q2, v1, v2, u1, u2, s1, s2):
    """Return both joint accelerations, and the friction torques that would hold the joints.

    A side s is 1 or -1 for a joint that slides there, 0 for one that is held. This is
    `two_link.acceleration` for one arm, with the forces kept apart for the joints that are held.
    """
    c, s = math.cos(q2), math.sin(q2)
    # Mass matrix and bias of the two-link arm; s1, s2 set the sides of the dry friction.
    m11, m12, m22 = arm[0, i] + 2.0 * arm[1, i] * c, arm[2, i] + arm[1, i] * c, arm[2, i]
    f1 = u1 - arm[3, i] * v1 - s1 * arm[5, i] + arm[1, i] * s * v2 * (2.0 * v1 + v2)
    f2 = u2 - arm[4, i] * v2 - s2 * arm[6, i] - arm[1, i] * s * v1 * v1
    a1 = a2 = 0.0
    # Both slide: Cramer's rule. One slides: the held joint does not accelerate and drops out.
    if s1 != 0.0 and s2 != 0.0:
        inverse = 1.0 / (m11 * m22 - m12 * m12)
        a1, a2 = (m22 * f1 - m12 * f2) * inverse, (m11 * f2 - m12 * f1) * inverse
    elif s1 != 0.0:
        a1 = f1 / m11
    elif s2 != 0.0:
        a2 = f2 / m22
    return a1, a2, f1 - m12 * a2, f2 - m12 * a1


@register_jitable
def _side(v, friction, choice):
    """Return where a joint slides: by its speed, or if it rests by a choice of 0, 1 and -1."""
    if friction == 0.0:
        return 1.0
    if v != 0.0:
        return math.copysign(1.0, v)
    return choice


@register_jitable
def _sides(arm, i, q2, v1, v2, u1, u2):
    """Return the sides of both joints that agree with Coulomb's law.

    Who rests starts towards the net torque or is held by no more than its friction. M is positive
    definite, so one choice fits.
    """
    s1 = s2 = 0.0
    # At most nine combinations of sliding and sticking; M is positive definite, so one is
    # consistent.
    for option in range(9):
        t1, t2 = option % 3, option // 3  # 2 stands for -1
        s1 = _side(v1, arm[5, i], t1 if t1 < 2 else -1.0)
        s2 = _side(v2, arm[6, i], t2 if t2 < 2 else -1.0)
        a1, a2, r1, r2 = _accelerations(arm, i, q2, v1, v2, u1, u2, s1, s2)
        # Sticking: the holding torque is within the friction. Sliding from rest: the acceleration
        # agrees.
        first = abs(r1) <= arm[5, i] if s1 == 0.0 else v1 != 0.0 or arm[5, i] == 0.0 or s1 * a1 > 0
        other = abs(r2) <= arm[6, i] if s2 == 0.0 else v2 != 0.0 or arm[6, i] == 0.0 or s2 * a2 > 0
        if first and other:
            break
    return s1, s2


@register_jitable
def _runge_kutta(arm, i, q1, q2, v1, v2, u1, u2, s1, s2, h):
    """Return one step of fourth order with the sides kept."""
    a1, a2, _, _ = _accelerations(arm, i, q2, v1, v2, u1, u2, s1, s2)
    w1, w2 = v1 + 0.5 * h * a1, v2 + 0.5 * h * a2
    b1, b2, _, _ = _accelerations(arm, i, q2 + 0.5 * h * v2, w1, w2, u1, u2, s1, s2)
    x1, x2 = v1 + 0.5 * h * b1, v2 + 0.5 * h * b2
    c1, c2, _, _ = _accelerations(arm, i, q2 + 0.5 * h * w2, x1, x2, u1, u2, s1, s2)
    y1, y2 = v1 + h * c1, v2 + h * c2
    d1, d2, _, _ = _accelerations(arm, i, q2 + h * x2, y1, y2, u1, u2, s1, s2)
    g = h / 6.0
    return (
        q1 + g * (v1 + 2.0 * w1 + 2.0 * x1 + y1),
        q2 + g * (v2 + 2.0 * w2 + 2.0 * x2 + y2),
        v1 + g * (a1 + 2.0 * b1 + 2.0 * c1 + d1),
        v2 + g * (a2 + 2.0 * b2 + 2.0 * c2 + d2),
    )


@register_jitable
def _advance(arm, i, q1, q2, v1, v2, u1, u2, h):
    """Advance by one step, cut where a sliding joint stops."""
    dry1, dry2 = arm[5, i] > 0.0, arm[6, i] > 0.0
    rest = h
    for event in range(8):
        s1, s2 = 1.0, 1.0
        if dry1 or dry2:
            s1, s2 = _sides(arm, i, q2, v1, v2, u1, u2)
        p1, p2, w1, w2 = _runge_kutta(arm, i, q1, q2, v1, v2, u1, u2, s1, s2, rest)
        stops = (dry1 and s1 * w1 < 0.0) or (dry2 and s2 * w2 < 0.0)
        # After seven stops the remaining time is taken as one step, so that the loop ends.
        if not stops or event == 7:
            return p1, p2, w1, w2
        # A joint stops within the step: bisect the time, put it at rest exactly, and go on.
        low, high = 0.0, rest
        for _ in range(40):
            middle = 0.5 * (low + high)
            _, _, x1, x2 = _runge_kutta(arm, i, q1, q2, v1, v2, u1, u2, s1, s2, middle)
            if (dry1 and s1 * x1 < 0.0) or (dry2 and s2 * x2 < 0.0):
                high = middle
            else:
                low = middle
        # `high` is just beyond the stop, so the joint that stops has a speed of 0 or past it.
        q1, q2, v1, v2 = _runge_kutta(arm, i, q1, q2, v1, v2, u1, u2, s1, s2, high)
        v1 = 0.0 if dry1 and s1 * v1 <= 0.0 else v1
        v2 = 0.0 if dry2 and s2 * v2 <= 0.0 else v2
        rest -= high
    return q1, q2, v1, v2


def _episodes(arms, numbers, starts, references, goals, noise, plan, sizes, out, trace):
    """K sets of gains on E episodes; one of anything stands for all of it.

    `numbers` (K, 2, 13) are `Gains.numbers`, `plan` (T, 2, E) torques in place of a law where it is
    not empty, `sizes` (T, DT, STEP, RADIUS, samples to hold, FASTEST, lengths). Rows of `out`
    (4, K E) are those of `Outcome`; those of `trace` (10, K E, T + 1), where it is not empty, are
    pairs of angle, rate, motor torque, measurement and command.
    """
    T, dt, step = int(sizes[0]), sizes[1], sizes[2]
    E, K = starts.shape[1], numbers.shape[0]
    sent, memory = np.zeros((T, 2)), np.zeros((2, 5))
    for j in range(K * E):
        k, e = j // E, j % E
        i, n = e % arms.shape[1], e % noise.shape[2]
        # The delay in whole samples and a rest, as in `split_delay`.
        whole = math.floor(arms[8, i] / dt + 1e-9)
        part = max(0.0, arms[8, i] - whole * dt)
        q1, q2, v1, v2 = starts[0, e], starts[1, e], starts[2, e], starts[3, e]
        memory[:] = 0.0
        u1, u2, inside, streak, distance, diverged = 0.0, 0.0, 0, 0, 0.0, False
        for t in range(T + 1):
            # The tip's distance from its goal.
            x = sizes[6] * math.cos(q1) + sizes[7] * math.cos(q1 + q2) - goals[0, e]
            y = sizes[6] * math.sin(q1) + sizes[7] * math.sin(q1 + q2) - goals[1, e]
            distance = math.hypot(x, y)
            # Written as a negation, so that a NaN counts as diverged.
            diverged = not (abs(v1) < sizes[5] and abs(v2) < sizes[5])
            # The streak of samples within the target decides about "held".
            streak = streak + 1 if distance <= sizes[3] else 0
            inside += 1 if streak > 0 else 0
            # The encoder: bias and noise.
            seen1 = q1 + arms[9, i] + arms[11, i] * noise[t, 0, n]
            seen2 = q2 + arms[10, i] + arms[11, i] * noise[t, 1, n]
            if trace.shape[0]:
                trace[0, j, t], trace[1, j, t], trace[2, j, t], trace[3, j, t] = q1, q2, v1, v2
                trace[4, j, t], trace[5, j, t] = u1, u2
                trace[6, j, t], trace[7, j, t] = seen1, seen2
            if t == T or diverged:
                break
            if plan.shape[0]:
                sent[t] = plan[t, :, e % plan.shape[2]]
            else:
                sent[t, 0] = update(numbers[k, 0], memory[0], references[0, e], seen1, 0.0)
                sent[t, 1] = update(numbers[k, 1], memory[1], references[1, e], seen2, 0.0)
            if trace.shape[0]:
                trace[8, j, t], trace[9, j, t] = sent[t, 0], sent[t, 1]
            # The command switches once within a sample, where its delay ends.
            for half in range(2):
                length = part if half == 0 else dt - part
                if length <= 1e-12:
                    continue
                at = t - whole - 1 + half
                u1 = arms[7, i] * sent[at, 0] if at >= 0 else 0.0
                u2 = arms[7, i] * sent[at, 1] if at >= 0 else 0.0
                # Equal steps, none longer than the limit; the tolerance keeps rounding from adding
                # one.
                steps = math.ceil(length / step - 1e-9)
                for _ in range(steps):
                    q1, q2, v1, v2 = _advance(arms, i, q1, q2, v1, v2, u1, u2, length / steps)
        # Success: inside the target up to the end, for more samples than `HOLD` has.
        held = streak > sizes[4] and not diverged
        # An index into `REASONS`: never there, or left; below, held, or late.
        reason = 3 if inside == 0 else 2
        if held:
            reason = 0
        elif streak > 0:
            reason = 1
        out[0, j], out[1, j] = held, inside * dt
        out[2, j], out[3, j] = math.inf if diverged else distance, 4 if diverged else reason


episodes = loop(
    _episodes, numba.void(MATRIX, CUBE, MATRIX, MATRIX, MATRIX, CUBE, CUBE, VECTOR, MATRIX, CUBE)
)
