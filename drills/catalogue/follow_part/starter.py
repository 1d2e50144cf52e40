import numpy as np


def follow_part(frames, saves, work, late, period, deadline, drift, ticks):
    """Return the commands that a drive uses, (m,) [m]; the table of the task explains the input."""
    # The camera's node: callbacks of one group wait for each other.
    rows = np.asarray(frames, dtype=float)
    calls = [(row[1], 0, work, number) for number, row in enumerate(rows)]
    calls += [(row[0], 1, row[1], -1) for row in np.asarray(saves, dtype=float)]
    free, published = [-np.inf, -np.inf], []
    for time, kind, lasts, number in sorted(calls):
        group = 0
        free[group] = max(time, free[group]) + lasts
        if kind == 0:
            published.append((free[group], free[group], rows[number, 2]))
    # The controller's node: a loop that carries the newest place on to its present.
    sent = []
    wake_up = 0.0
    for lateness in np.asarray(late, dtype=float):
        now = wake_up + lateness
        here = [message for message in published if message[0] <= now]
        if here and now - here[-1][1] <= deadline:
            sent.append((now, here[-1][2] + drift * (now - here[-1][1])))
        wake_up = now + period
    # The drive: one command a tick.
    depth, command, came = 10, 0.0, 0
    queue = []
    driven = np.zeros(len(np.asarray(ticks)))
    for i, tick in enumerate(np.asarray(ticks, dtype=float)):
        while came < len(sent) and sent[came][0] <= tick:
            queue = [*queue, sent[came][1]][-depth:]
            came += 1
        if queue:
            command = queue.pop(0)
        driven[i] = command
    return driven
