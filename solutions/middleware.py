"""Worked answers of chapter 10, middleware and real time: complete, of the size of an interview."""

import math

import numpy as np
from numpy.typing import ArrayLike


def compatible(offered: ArrayLike, requested: ArrayLike) -> np.ndarray:
    """Return the policies for which a writer offers less than a reader requests.

    Args:
        offered, requested: reliability, durability, deadline [s], liveliness, lease [s],
            destination order and ownership of each end, shape (7,); a time of 0 is none.

    Returns:
        1 where reliability, durability, deadline, liveliness with its lease, destination order or
        ownership fails, else 0, shape (6,).
    """
    offer, wish = (np.array(profile, dtype=float) for profile in (offered, requested))
    for profile in (offer, wish):
        times = profile[[2, 4]]
        profile[[2, 4]] = np.where(times > 0.0, times, np.inf)  # none promises nothing
    less, more = offer < wish, offer > wish
    lively = less[3] or more[4]
    unlike = offer[6] != wish[6]  # neither kind of ownership offers the other
    return np.array([less[0], less[1], more[2], lively, less[5], unlike], dtype=int)


def keep_last(
    stamps: ArrayLike, arrivals: ArrayLike, reads: ArrayLike, depth: int, lifespan: float
) -> tuple[np.ndarray, int]:
    """Return what a reader takes out of a cache of the last messages with a lifespan.

    Args:
        stamps: when each message was written, shape (n,) [s].
        arrivals: when it arrived, rising, (n,) [s].
        reads: when the cache is emptied, rising, (m,) [s].
        depth: how many messages it holds.
        lifespan: age from which a message is gone [s]; 0 for none.

    Returns:
        (numbers of the messages of each read in the order of arrival, then -1, shape (m, depth);
        how many were pushed out by later ones).
    """
    times = np.asarray(arrivals, dtype=float)
    ends = np.asarray(stamps, dtype=float) + (lifespan if lifespan > 0.0 else np.inf)
    taken = np.full((len(np.asarray(reads)), depth), -1)
    cache: list[int] = []
    came = dropped = 0
    for row, now in enumerate(np.asarray(reads, dtype=float)):
        while came < len(times) and times[came] <= now:
            at = times[came]
            cache = [k for k in cache if at < ends[k]]
            if at < ends[came]:
                if len(cache) == depth:
                    cache.pop(0)
                    dropped += 1
                cache.append(came)
            came += 1
        cache = [k for k in cache if now < ends[k]]
        taken[row, : len(cache)] = cache
        cache = []
    return taken, dropped


def fragment_loss(size: int, payload: int, loss: float) -> tuple[float, float, float]:
    """Return the loss of a fragmented message, and how often it is sent until all of it arrives.

    Args:
        size: of the message [byte].
        payload: bytes of it that one fragment carries.
        loss: probability that a fragment is lost, below 1, each independently.

    Returns:
        (probability that at least one is lost when each is sent once, mean number of rounds until
        none is missing, mean number of fragments sent in these).
    """
    n = -(-size // payload)
    lost = -math.expm1(n * math.log1p(-loss))
    rounds, missing = 1.0, loss  # of one fragment, after so many rounds
    while n * missing > 1e-18 * rounds:
        rounds -= math.expm1(n * math.log1p(-missing))
        missing *= loss
    return lost, rounds, n / (1.0 - loss)


def response_times(
    executions: ArrayLike, periods: ArrayLike, deadlines: ArrayLike, blocking: ArrayLike
) -> np.ndarray:
    """Return the longest response times of periodic tasks on one processor that can be interrupted.

    Args:
        executions, periods: of each task, the most important first, shape (n,) [us].
        deadlines: after its release, at most its period, (n,) [us].
        blocking: longest time for which less important tasks can block this one, (n,) [us].

    Returns:
        Of each task, -1 where it can miss its deadline, shape (n,) [us].
    """
    C, T, D, B = (np.asarray(x, dtype=int) for x in (executions, periods, deadlines, blocking))
    times = np.full(len(C), -1)
    for i in range(len(C)):
        before, response = -1, C[i] + B[i]
        while before < response <= D[i]:
            before = response
            releases = -(-before // T[:i])  # of each more important task, rounded up
            response = C[i] + B[i] + releases @ C[:i]
        if response <= D[i]:
            times[i] = response
    return times


def wake_ups(
    start: int, period: int, late: ArrayLike, work: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Return when a periodic loop asks to be woken, and how many of its periods it has to skip.

    Args:
        start: of the first period [ns].
        period: [ns].
        late: how long after the time asked for each cycle really begins, shape (n,) [ns].
        work: how long it then works, (n,) [ns].

    Returns:
        (time that each cycle asked for (n,) [ns], periods skipped right after it (n,)).
    """
    lateness, works = np.asarray(late, dtype=int), np.asarray(work, dtype=int)
    requested, skipped = np.zeros((2, len(works)), dtype=int)
    turn = 0  # number of the period
    for i in range(len(works)):
        requested[i] = start + turn * period
        done = requested[i] + lateness[i] + works[i]
        later = max(turn + 1, -((start - done) // period))  # the first that has not passed
        skipped[i] = later - turn - 1
        turn = later
    return requested, skipped


def follow_part(
    frames: ArrayLike,
    saves: ArrayLike,
    work: float,
    late: ArrayLike,
    period: float,
    deadline: float,
    drift: float,
    ticks: ArrayLike,
) -> np.ndarray:
    """Return the commands that a drive uses to follow a part by camera.

    Args:
        frames: rows (captured, received, place), both times rising, shape (n, 3) [s, m].
        saves: rows (time, how long) of saving a log in the camera's node, (k, 2) [s].
        work: what the callback of an image takes [s].
        late: of each cycle of the controller, (j,) [s].
        period: of the controller [s].
        deadline: oldest information that it acts on [ms].
        drift: velocity of the part [m/s].
        ticks: when the drive takes a command, rising, (m,) [s].

    Returns:
        Place that the drive is told at each tick, 0 before the first command, (m,) [m].
    """
    # The camera's node: callbacks of one group wait for each other.
    rows = np.asarray(frames, dtype=float)
    calls = [(row[1], 0, work, number) for number, row in enumerate(rows)]
    calls += [(row[0], 1, row[1], -1) for row in np.asarray(saves, dtype=float)]
    free, published = [-np.inf, -np.inf], []
    for time, kind, lasts, number in sorted(calls):
        group = kind
        free[group] = max(time, free[group]) + lasts
        if kind == 0:
            published.append((free[group], rows[number, 0], rows[number, 2]))
    # The controller's node: a loop that carries the newest place on to its present.
    sent: list[tuple[float, float]] = []
    wake_up = 0.0
    for cycle, lateness in enumerate(np.asarray(late, dtype=float)):
        now = wake_up + lateness
        here = [message for message in published if message[0] <= now]
        if here and now - here[-1][1] <= 1e-3 * deadline:
            sent.append((now, here[-1][2] + drift * (now - here[-1][1])))
        wake_up = (cycle + 1) * period
    # The drive: one command a tick.
    depth, command, came = 1, 0.0, 0
    queue: list[float] = []
    driven = np.zeros(len(np.asarray(ticks)))
    for i, tick in enumerate(np.asarray(ticks, dtype=float)):
        while came < len(sent) and sent[came][0] <= tick:
            queue = [*queue, sent[came][1]][-depth:]
            came += 1
        if queue:
            command = queue.pop(0)
        driven[i] = command
    return driven


def utilisation(executions: ArrayLike, periods: ArrayLike) -> tuple[float, float, int]:
    """Return the utilization of periodic tasks, Liu and Layland's bound, and what follows.

    Args:
        executions: longest execution time of each task, shape (n,) [s].
        periods: of each task, (n,) [s].

    Returns:
        (utilization, bound, verdict: 1 schedulable, -1 overloaded, 0 undecided).
    """
    n = np.asarray(executions).size
    load = float(np.sum(np.asarray(executions, dtype=float) / np.asarray(periods)))
    bound = n * (2.0 ** (1.0 / n) - 1.0)
    return load, bound, 1 if load <= bound else (-1 if load > 1.0 else 0)
