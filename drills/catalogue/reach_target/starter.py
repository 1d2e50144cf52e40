import math

import numpy as np


def reach_target(frames, noise, calibration, drift, start, ticks):
    """Return where the tip is told to be at each tick, (m, 2) [m].

    The task's table says what goes in.
    """
    rows, camera = np.asarray(frames, dtype=float), np.asarray(calibration, dtype=float)
    R, t, belt = camera[:, :2], camera[:, 2], np.asarray(drift, dtype=float)
    seconds, command = 1.0, np.array(start, dtype=float)
    origin = goal = command
    began, reference = -math.inf, np.zeros((len(np.asarray(ticks)), 2))
    for i, now in enumerate(np.asarray(ticks, dtype=float)):
        recent = rows[rows[:, 1] <= now][-5:]
        if len(recent):
            ages = now - recent[:, 1:2]
            target = np.mean(recent[:, 2:] @ R + t + ages * belt, axis=0)
            lost = math.inf
            if began > -math.inf:
                lost = math.dist(target, goal + (now - began - seconds) * belt)
            if lost > 3.0 * noise:
                began = now if began == -math.inf else began
                goal = target + (began + seconds - now) * belt
            share = min((now - began) / seconds, 1.0)
            beyond = max(now - began - seconds, 0.0)
            command = origin + share**2 * (3.0 - 2.0 * share) * (goal - origin) + beyond * belt
        reference[i] = command
    return reference
